//! The names needed for online estimation: `use vsf::prelude::*;`.

pub use vsf_contact::{ContactConfig, StickSlip, link_sdfs};
pub use vsf_core::{
    Belief, ContactModel, Contacts, CoreError, Estimator, Noise, Observation, Posture, Prediction,
    RestPoints, Sensor, Session, UpdateReport,
};
pub use vsf_filter::{
    CovarianceFilter, DiagonalKalman, DualConfig, DualReplay, FieldPrior, MemoryReplay,
    ReplayConfig,
};
pub use vsf_robots::{JointTorques, RobotModel, UrdfOptions};
