//! Robots from URDF: kinematics, inverse dynamics, joint-torque sensing
