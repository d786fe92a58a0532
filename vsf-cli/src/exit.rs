use crate::console::complain;
use std::io;
use std::process::ExitCode;
use vsf::contact::ContactError;
use vsf::core::CoreError;
use vsf::data::DataError;
use vsf::pipeline::PipelineError;
use vsf::robots::RobotError;

/// A wish that cannot be met as it was put, in one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// A [`Usage`] error.
pub fn usage(problem: impl Into<String>) -> anyhow::Error {
    Usage(problem.into()).into()
}

/// Prints the error and its causes in one line and chooses the exit code.
pub fn report(error: &anyhow::Error) -> ExitCode {
    complain_of(error);
    ExitCode::from(code(error))
}

/// Prints the error and its causes in one line.
pub fn complain_of(error: &anyhow::Error) {
    complain(format_args!("error: {}", message(error)));
}

/// The error and its causes.
pub fn message(error: &anyhow::Error) -> String {
    let mut line = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // Many messages already quote their cause, and some causes already name the place.
        if cause.starts_with(&format!("{line}: ")) {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
}

fn code(error: &anyhow::Error) -> u8 {
    if error
        .chain()
        .any(|e| e.is::<Usage>() || is_parameter(e) || is_in_the_way(e))
    {
        2
    } else if error.chain().any(is_refusal) && !error.chain().any(is_missing) {
        3
    } else {
        1
    }
}

/// Of the system; text that is no text is the input's own fault.
fn is_refusal(error: &(dyn std::error::Error + 'static)) -> bool {
    let refused = |e: &io::Error| e.kind() != io::ErrorKind::InvalidData;
    error.downcast_ref().is_some_and(refused)
}

/// A file that a robot names and that is not there, such as a mesh.
fn is_missing(error: &(dyn std::error::Error + 'static)) -> bool {
    match error.downcast_ref() {
        Some(PipelineError::Robot(RobotError::Read { source, .. })) => {
            source.kind() == io::ErrorKind::NotFound
        }
        _ => false,
    }
}

/// In the folder that a flag names for the results.
fn is_in_the_way(error: &(dyn std::error::Error + 'static)) -> bool {
    matches!(
        error.downcast_ref(),
        Some(DataError::Leftover { .. } | DataError::Link { .. })
    )
}

fn is_parameter(error: &(dyn std::error::Error + 'static)) -> bool {
    let core = |e: &CoreError| matches!(e, CoreError::Parameter { .. });
    match error.downcast_ref::<PipelineError>() {
        Some(PipelineError::Core(e) | PipelineError::Contact(ContactError::Core(e))) => core(e),
        _ => false,
    }
}
