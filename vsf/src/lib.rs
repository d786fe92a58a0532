//! Volumetric stiffness fields from joint angles and joint torques
