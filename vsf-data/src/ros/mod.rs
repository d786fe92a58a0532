//! Recordings and fields as ROS messages in MCAP files, and recordings made from joint states in MCAP or CSV files.
//!
//! What messages do not hold is attached to the file, named by its path in the folder of the recording: `dataset.json`,
//! `points.npy` and, for each sequence in order, `seq_<ID>/time.npy`. The length of the latter is the number of joint
//! states in the sequence.

mod container;
mod csv_files;
mod export;
mod import;
mod joint_log;
mod messages;
mod topics;
mod wire;

pub use export::{EffortPrediction, McapExport};
pub use joint_log::{Clock, JointLog};
pub(crate) use messages::SECOND;

use crate::dataset::POINTS;
use crate::metadata;
use crate::sequence::PREFIX;

/// The topic of the recorded joint states in files that [`McapExport`] wrote.
const RECORDED: &str = "/joint_states";

fn times_path(id: &str) -> String {
    format!("{PREFIX}{id}/time.npy")
}

/// The ID of the sequence whose times are attached under this name.
fn times_of(name: &str) -> Option<&str> {
    name.strip_prefix(PREFIX)?.strip_suffix("/time.npy")
}

fn is_part(name: &str) -> bool {
    name == metadata::FILE || name == POINTS || times_of(name).is_some()
}
