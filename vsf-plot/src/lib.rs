//! Pictures of stiffness fields and torque predictions
