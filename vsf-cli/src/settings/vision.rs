use super::name_of;
use anyhow::Context;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vsf::data::read_text;
use vsf::pipeline::VisionSpec;
use vsf::vision::{GpConfig, KnnConfig, LearnedPrior, RegressorSpec};

/// A method by name, or what other objects teach.
#[derive(Debug, Clone)]
pub enum Vision {
    Kind(VisionKind),
    Learned(PathBuf),
}

impl Vision {
    /// The method, if any.
    pub fn spec(&self) -> anyhow::Result<Option<VisionSpec>> {
        match self {
            Self::Kind(kind) => Ok(kind.spec()),
            Self::Learned(path) => {
                let learned = LearnedPrior::from_json(&read_text(path)?)
                    .with_context(|| path.display().to_string())?;
                Ok(Some(VisionSpec::Learned(Arc::new(learned))))
            }
        }
    }

    /// The file that says it.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Kind(_) => None,
            Self::Learned(path) => Some(path),
        }
    }

    /// Its name, for reports.
    pub fn name(&self) -> String {
        match self {
            Self::Kind(kind) => kind.name(),
            Self::Learned(path) => path.to_string_lossy().into_owned(),
        }
    }
}

/// The value of `--vision`.
pub fn vision(text: &str) -> Result<Vision, String> {
    match VisionKind::from_str(text, false) {
        Ok(kind) => Ok(Vision::Kind(kind)),
        Err(_) if Path::new(text).is_file() => Ok(Vision::Learned(text.into())),
        Err(_) => Err("no such file; methods are none, level, knn, ridge, gp".to_owned()),
    }
}

/// How untouched points are guessed by what the camera sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VisionKind {
    /// Prior mean of zero
    None,
    /// One stiffness, fading behind the visible surface
    Level,
    /// Regression on the 200 nearest touched points in color and position
    Knn,
    /// Linear regression on color and position
    Ridge,
    /// Gaussian process over color and position
    Gp,
}

impl VisionKind {
    /// The method, if any.
    pub fn spec(self) -> Option<VisionSpec> {
        let regression = match self {
            Self::None => return None,
            Self::Level => return Some(VisionSpec::Level),
            Self::Knn => RegressorSpec::Knn(KnnConfig::default()),
            Self::Ridge => RegressorSpec::Ridge,
            Self::Gp => RegressorSpec::GaussianProcess(GpConfig::default()),
        };
        Some(VisionSpec::Regression(regression))
    }

    /// Name, for reports.
    pub fn name(self) -> String {
        name_of(&self)
    }
}
