//! A page for each of the first tasks. Every example is compiled, and run unless it needs files of your own.
//!
//! 1. [`first_field`]: from a touch recording on disk to a field, its errors and a picture.
//! 2. [`recordings`]: your own recordings, ROS bags and other MCAP files, CSV files; results in Foxglove and rviz.
//! 3. [`your_robot`]: URDF files, package maps, joint order, shapes.
//! 4. [`your_parts`]: an estimator, a sensor and a contact model of your own.
//! 5. [`filter_health`]: is the filter right about how much it knows?
//! 6. [`sim_to_real`]: reading a diagnosis of what the model lacks.
//! 7. [`judgment`]: how a diagnosis decides.
//! 8. [`catalogue`]: the effects, their parameters and bounds.
//! 9. [`your_effects`]: an effect of your own, and a corrected model in your own program.
//! 10. [`touch_protocol`]: how to touch so that effects can be told apart.
//! 11. [`accuracy`]: how well it predicts, how fast it is, and its limits.
//! 12. [`from_openvsf`]: folders, fields and options of OpenVSF, and what differs here.

#[doc = include_str!("guide/first_field.md")]
pub mod first_field {}

#[doc = include_str!("guide/recordings.md")]
pub mod recordings {}

#[doc = include_str!("guide/your_robot.md")]
pub mod your_robot {}

#[doc = include_str!("guide/your_parts.md")]
pub mod your_parts {}

#[doc = include_str!("guide/filter_health.md")]
pub mod filter_health {}

#[doc = include_str!("guide/sim_to_real.md")]
pub mod sim_to_real {}

#[doc = include_str!("guide/judgment.md")]
pub mod judgment {}

#[doc = include_str!("guide/catalogue.md")]
pub mod catalogue {}

#[doc = include_str!("guide/your_effects.md")]
pub mod your_effects {}

#[doc = include_str!("guide/touch_protocol.md")]
pub mod touch_protocol {}

#[doc = include_str!("guide/accuracy.md")]
pub mod accuracy {}

#[doc = include_str!("guide/from_openvsf.md")]
pub mod from_openvsf {}
