//! Faults of recordings in the words of the command: the flags that set what is wrong, or that help.

use crate::exit::usage;
use crate::settings::MetadataSettings;
use vsf::contact::ContactError;
use vsf::data::DataError;
use vsf::pipeline::PipelineError;
use vsf::robots::RobotError;

/// A fault of the metadata, laid to the flag that set it.
pub fn blame(settings: &MetadataSettings, error: DataError) -> anyhow::Error {
    let key = match &error {
        DataError::Metadata { key, .. } | DataError::UnknownSequence { key, .. } => key,
        DataError::DuplicateSequence { .. } => "splits",
        DataError::TareSamples { .. } => "tare_samples",
        _ => return error.into(),
    };
    match settings.flag(key) {
        Some(flag) => {
            let text = error.to_string();
            let problem = match &error {
                DataError::Metadata { problem, .. } => problem,
                _ => text.split_once("dataset.json: ").map_or(&*text, |(_, p)| p),
            };
            usage(format!("{flag}: {problem}"))
        }
        None => error.into(),
    }
}

/// A fault of the robot, in the words of the command, laid to the flag that made it.
pub fn explain(settings: &MetadataSettings, error: PipelineError) -> anyhow::Error {
    let joints = match &error {
        PipelineError::RobotFile {
            source: RobotError::UnknownJoint { .. } | RobotError::IncompleteJointOrder { .. },
            ..
        } => settings.flag("joints"),
        PipelineError::JointMismatch { key, .. } => settings.flag(key),
        _ => None,
    };
    if let Some(flag) = joints {
        return usage(format!("{flag}: {error}"));
    }
    match &error {
        PipelineError::RobotFile {
            path,
            source: RobotError::UnknownPackage { uri, package },
        } => anyhow::anyhow!(
            "{}: {uri:?} needs the folder of package {package:?}; give it by --package {package}=PATH",
            path.display()
        ),
        PipelineError::Robot(e @ RobotError::UnknownLink { .. }) => usage(format!("--links: {e}")),
        // The automatic spacing never needs so many.
        PipelineError::LinkShape {
            link,
            source:
                ContactError::GridTooLarge {
                    resolution,
                    nodes,
                    max,
                },
            ..
        } => usage(format!(
            "--grid-resolution: at {resolution} m the mesh of link {link:?} needs {nodes} nodes, more than \
             {max}; give a coarser one, or none"
        )),
        _ => error.into(),
    }
}
