//! Recordings built into the program; see `data/README.md`.

use crate::console::write_folder;
use std::path::{Path, PathBuf};

/// Files of a recording by their paths in its folder.
pub struct Sample {
    pub name: &'static str,
    files: &'static [(&'static str, &'static [u8])],
}

macro_rules! sample {
    ($name:literal: $($file:literal),* $(,)?) => {
        Sample {
            name: $name,
            files: &[$(($file, include_bytes!(concat!("../data/", $name, "/", $file)))),*],
        }
    };
}

/// Pushes at one place.
pub const ONE_PLACE: Sample = sample!["orange_tree":
    "README.md",
    "camera/camera.json",
    "camera/color.png",
    "camera/depth.png",
    "points.npy",
    "robot.urdf",
    "seq_000/angles.npy",
    "seq_000/time.npy",
    "seq_000/torques.npy",
    "seq_000/velocities.npy",
    "seq_001/angles.npy",
    "seq_001/time.npy",
    "seq_001/torques.npy",
    "seq_001/velocities.npy",
    "seq_004/angles.npy",
    "seq_004/time.npy",
    "seq_004/torques.npy",
    "seq_004/velocities.npy",
    "seq_007/angles.npy",
    "seq_007/time.npy",
    "seq_007/torques.npy",
    "seq_007/velocities.npy",
    "dataset.json",
];

/// Pushes at neighbouring places. The robot is that of [`ONE_PLACE`].
pub const NEAR_PLACES: Sample = sample!["orange_tree_partial":
    "camera/camera.json",
    "camera/color.png",
    "camera/depth.png",
    "points.npy",
    "seq_000/angles.npy",
    "seq_000/torques.npy",
    "seq_001/angles.npy",
    "seq_001/torques.npy",
    "seq_002/angles.npy",
    "seq_002/torques.npy",
    "seq_003/angles.npy",
    "seq_003/torques.npy",
    "seq_004/angles.npy",
    "seq_004/torques.npy",
    "dataset.json",
];

/// Pushes at separate places. The robot is that of [`ONE_PLACE`].
pub const FAR_PLACES: Sample = sample!["orange_tree_no":
    "camera/camera.json",
    "camera/color.png",
    "camera/depth.png",
    "points.npy",
    "seq_000/angles.npy",
    "seq_000/torques.npy",
    "seq_001/angles.npy",
    "seq_001/torques.npy",
    "seq_002/angles.npy",
    "seq_002/torques.npy",
    "seq_003/angles.npy",
    "seq_003/torques.npy",
    "dataset.json",
];

impl Sample {
    /// Writes the recording to the folder `inner` of an output, and returns where that is.
    pub fn unpack(&self, output: &Path, inner: &Path) -> anyhow::Result<PathBuf> {
        let files = self.files.iter();
        write_folder(output, files.map(|(name, bytes)| (inner.join(name), bytes)))?;
        Ok(output.join(inner))
    }
}
