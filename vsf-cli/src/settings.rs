//! Parameters shared by the commands, as flags over the library's defaults.

mod estimator;
mod metadata;
mod scene;
mod vision;

pub use estimator::EstimatorSettings;
pub use metadata::MetadataSettings;
pub use scene::SceneSettings;
pub use vision::VisionKind;

use clap::ValueEnum;

/// The name of a value on the command line.
pub fn name_of(value: &impl ValueEnum) -> String {
    let value = value.to_possible_value();
    value.map_or_else(String::new, |v| v.get_name().to_owned())
}
