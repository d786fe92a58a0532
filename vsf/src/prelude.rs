//! The names that an online estimation needs: `use vsf::prelude::*;`.

pub use vsf_contact::StickSlip;
pub use vsf_core::{
    Belief, ContactModel, Estimator, Noise, Prediction, RestPoints, Sensor, Session,
};
pub use vsf_filter::{DiagonalKalman, MemoryReplay};
pub use vsf_robots::{JointTorques, RobotModel};
