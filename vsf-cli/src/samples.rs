//! Recordings built into the program; see `data/README.md`.

use crate::console::{create_folder, write_file};
use std::path::{Path, PathBuf};

/// Files of a recording by their paths in its folder.
pub struct Sample {
    name: &'static str,
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
    /// Writes the recording to a folder of its name and returns that.
    pub fn unpack_into(&self, parent: &Path) -> anyhow::Result<PathBuf> {
        let folder = parent.join(self.name);
        self.unpack(&folder)?;
        Ok(folder)
    }

    /// Writes the recording to a folder.
    pub fn unpack(&self, folder: &Path) -> anyhow::Result<()> {
        for (name, bytes) in self.files {
            let path = folder.join(name);
            if let Some(parent) = path.parent() {
                create_folder(parent)?;
            }
            write_file(&path, bytes)?;
        }
        Ok(())
    }
}
