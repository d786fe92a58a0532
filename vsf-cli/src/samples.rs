//! Recordings built into the program; see `data/README.md`.

use crate::console::write_folder;
use std::ffi::OsStr;
use std::fs;
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

/// Pushes at neighboring places. The robot is that of [`ONE_PLACE`].
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
    /// What is in the folder of the recording and was not unpacked so. Names that begin with a dot do not count.
    pub fn changed_in(&self, folder: &Path) -> Option<PathBuf> {
        let differs = |(name, bytes): &(&str, &[u8])| {
            let path = folder.join(name);
            let found = fs::read(&path);
            (path.exists() && found.ok().as_deref() != Some(bytes)).then_some(path)
        };
        let names = folder.read_dir().into_iter().flatten().flatten();
        let is_own = |name: &OsStr| {
            self.files
                .iter()
                .any(|(file, _)| Path::new(file).starts_with(name))
        };
        let mut others = (names.map(|entry| entry.file_name()))
            .filter(|name| !name.to_string_lossy().starts_with('.') && !is_own(name));
        let changed = self.files.iter().find_map(differs);
        changed.or_else(|| others.next().map(|name| folder.join(name)))
    }

    /// Writes the recording to the folder `inner` of an output, and returns where that is.
    pub fn unpack(&self, output: &Path, inner: &Path) -> anyhow::Result<PathBuf> {
        let files = self.files.iter();
        write_folder(output, files.map(|(name, bytes)| (inner.join(name), bytes)))?;
        Ok(output.join(inner))
    }
}
