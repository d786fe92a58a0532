use super::MetadataSettings;
use crate::exit::usage;
use crate::range::{length, not_negative, offset, spacing, whole};
use clap::Args;
use std::path::PathBuf;
use vsf::contact::{ContactConfig, GridOptions};
use vsf::data::ContactParameters;
use vsf::pipeline::SceneOptions;

/// The recording and the contact model. Each part is a group of its own: clap leaves the group of a
/// struct empty that has parts.
#[derive(Debug, Clone, Default, Args)]
pub struct SceneSettings {
    #[command(flatten)]
    pub metadata: MetadataSettings,
    #[command(flatten)]
    contact: ContactSettings,
}

/// The contact model.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Contact (defaults to what a given field stores)")]
pub struct ContactSettings {
    /// Names of the links that may touch the object; default: all links with collision shapes
    #[arg(long, value_delimiter = ',')]
    links: Option<Vec<String>>,
    /// Contact threshold delta [m]: a point is touched within this distance of a link's surface; default: 0.8 of
    /// the points' spacing
    ///
    /// The default is limited to 0.0001 to 0.01 (see also --thresholds of `estimate`); for `diagnose` it is 0.002.
    /// A field, corrected model or simulated recording brings its own. A field that does not store it is taken to
    /// have 0.002.
    #[arg(long, value_parser = length)]
    threshold: Option<f64>,
    /// Friction coefficient nu_f; default: 0.15
    #[arg(long, value_parser = not_negative)]
    friction: Option<f64>,
    /// Slip step lambda_s [m]; default: 0.0001. A smaller step takes more steps for the same slip, see
    /// --max-slip-iterations
    #[arg(long, value_parser = length)]
    slip_step: Option<f64>,
    /// Maximum number of slip steps of a point per sample; default: as many as add up to 2 cm (200 steps of 0.0001
    /// m)
    #[arg(long, value_parser = whole(1..=u32::MAX))]
    max_slip_iterations: Option<u32>,
    /// Offset added to the robot's surface [m]; default: 0
    #[arg(long, value_parser = offset)]
    padding: Option<f64>,
    /// Sub-points per edge of the cube that a rest point stands for, 1 to 8; default: 2. With 1, the rest points
    /// alone move, as in the paper, at an eighth of the cost
    #[arg(long, value_parser = whole(1_usize..=8))]
    subdivision: Option<usize>,
    /// Spacing of the distance grids of meshes [m], 1e-6 to 1; default: chosen for an error of 0.5 mm
    #[arg(long, value_parser = spacing)]
    grid_resolution: Option<f64>,
    /// Folder in which to cache distance grids
    #[arg(long)]
    cache_dir: Option<PathBuf>,
}

impl SceneSettings {
    /// With a contact threshold (m), if one is given, and defaults for the rest.
    pub fn with_threshold(threshold: Option<f64>) -> Self {
        Self {
            contact: ContactSettings {
                threshold,
                ..ContactSettings::default()
            },
            ..Self::default()
        }
    }

    /// Whether the links that may touch are given.
    pub fn has_links(&self) -> bool {
        self.contact.links.is_some()
    }

    /// Refuses a link that is named twice, which no field could remember.
    pub fn check_links(&self) -> anyhow::Result<()> {
        let links = self.contact.links.as_deref().unwrap_or_default();
        let twice = |(k, link): &(usize, &String)| links[..*k].contains(link);
        match links.iter().enumerate().find(twice) {
            Some((_, link)) => Err(usage(format!("--links names {link:?} twice"))),
            None => Ok(()),
        }
    }

    /// Whether the contact threshold is given.
    pub fn has_threshold(&self) -> bool {
        self.contact.threshold.is_some()
    }

    /// Flags of contact that depend on the points' spacing and are not given.
    pub fn left_open(&self) -> Vec<&'static str> {
        let open = [
            ("--threshold", self.contact.threshold.is_none()),
            ("--subdivision", self.contact.subdivision.is_none()),
        ];
        open.iter()
            .filter(|(_, open)| *open)
            .map(|(flag, _)| *flag)
            .collect()
    }

    /// How the scene is put together: the flags, over the contact that a field or a model remembers, over the defaults.
    pub fn options(&self, remembered: Option<&ContactParameters>) -> SceneOptions {
        let given = &self.contact;
        let below = SceneOptions::default();
        let below = match remembered {
            Some(contact) => below.with_contact_of(contact),
            None => below,
        };
        let defaults = match given.slip_step {
            Some(step) => below.contact.with_slip_step(step),
            None => below.contact,
        };
        SceneOptions {
            contact: ContactConfig {
                threshold: given.threshold.unwrap_or(defaults.threshold),
                friction: given.friction.unwrap_or(defaults.friction),
                max_slip_iterations: given
                    .max_slip_iterations
                    .unwrap_or(defaults.max_slip_iterations),
                padding: given.padding.unwrap_or(defaults.padding),
                ..defaults
            },
            grid: GridOptions {
                resolution: given.grid_resolution,
                cache_dir: given.cache_dir.clone(),
                ..GridOptions::default()
            },
            links: given.links.clone().or(below.links),
            packages: self.metadata.packages(),
            subdivision: given.subdivision.unwrap_or(below.subdivision),
        }
    }
}
