use crate::console::{Console, fixed, number, table};
use crate::field_file::FieldFile;
use crate::range::{confidence, count, length, positive};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use vsf::core::RestPoints;
use vsf::core::nalgebra::Point3;
use vsf::pipeline::{RegionOptions, StiffRegion, StiffRegions, stiff_regions};

/// Most regions of the report; JSON has all.
const SHOWN: usize = 10;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
A point is stiff if, with a probability of --confidence, its stiffness is more than --contrast times the \
background. The background is the median of the touched points with any stiffness. Stiff points within --reach \
of each other form a region. Untouched points are left out, if the field stores which were touched. Positions \
are in the world frame.

Example:
  vsf estimate DATASET --out field.npz
  vsf regions field.npz --contrast 3

JSON keys:
  field, points (examined), felt (those with any stiffness)
  background, stiff_from (N/m), contrast, confidence, reach (m)
  scattered (number of stiff points in no region)
  unsure (indices of points that are probably that stiff, but with less
      than that confidence)
  regions (center, bounds ([lower, upper] in m), mean, sd (a bound of the
      standard deviation of the mean: the mean of those of the points),
      largest (N/m), times_background, points (their indices))")]
pub struct Args {
    /// Field, .npz or folder
    field: PathBuf,
    /// Stiffness from which a point is stiff, as a multiple of the background
    #[arg(long, default_value_t = RegionOptions::default().contrast, value_parser = positive)]
    contrast: f64,
    /// Minimum probability that a point is that stiff, 0.5 to below 1
    #[arg(long, default_value_t = RegionOptions::default().confidence, value_parser = confidence)]
    confidence: f64,
    /// Maximum distance between neighboring stiff points of a region [m]; default: 1.8 times the points' spacing
    #[arg(long, value_parser = length)]
    reach: Option<f64>,
    /// Minimum number of points of a region
    #[arg(long, value_name = "POINTS", default_value_t = RegionOptions::default().fewest, value_parser = count)]
    fewest: usize,
}

#[derive(Serialize)]
struct Report<'a> {
    field: String,
    points: usize,
    felt: usize,
    background: Option<f64>,
    stiff_from: Option<f64>,
    contrast: f64,
    confidence: f64,
    reach: f64,
    scattered: usize,
    unsure: &'a [usize],
    regions: Vec<Entry<'a>>,
}

#[derive(Serialize)]
struct Entry<'a> {
    center: [f64; 3],
    bounds: [[f64; 3]; 2],
    mean: f64,
    sd: Option<f64>,
    largest: f64,
    times_background: Option<f64>,
    points: &'a [usize],
}

impl<'a> Entry<'a> {
    fn of(region: &'a StiffRegion, found: &StiffRegions, has_sd: bool) -> Self {
        let coordinates = |p: &Point3<f64>| [p.x, p.y, p.z];
        Self {
            center: coordinates(&region.center),
            bounds: region.bounds.each_ref().map(coordinates),
            mean: region.mean,
            sd: has_sd.then_some(region.sd),
            largest: region.largest,
            times_background: found.background.map(|background| region.mean / background),
            points: &region.points,
        }
    }
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    if args.field.is_dir() && !FieldFile::is_at(&args.field) {
        anyhow::bail!(
            "{} is a recording, or another folder without K.npy; `vsf estimate` makes a field of a recording",
            args.field.display()
        );
    }
    let file = FieldFile::open(&args.field, console)?;
    let path = args.field.display();
    let has_sd = file.field.sd.is_some();
    if !has_sd {
        console.warn(format!(
            "{path}: without K_std, the stiffness alone decides what is stiff; --confidence has no effect"
        ));
    }
    let options = RegionOptions {
        contrast: args.contrast,
        confidence: args.confidence,
        reach: args.reach,
        fewest: args.fewest,
    };
    let rest = RestPoints::new(file.field.points)?;
    let found = stiff_regions(&rest, &file.stored.belief, &file.stored.touched, &options)?;
    if found.background.is_none() {
        let what = if found.looked_at == 0 {
            "no point was touched"
        } else {
            "no touched point has any stiffness"
        };
        console.warn(format!(
            "{path}: {what}: there is no background to compare with"
        ));
    }
    console.results(
        &Report {
            field: path.to_string(),
            points: found.looked_at,
            felt: found.felt,
            background: found.background,
            stiff_from: found.stiff_from,
            contrast: args.contrast,
            confidence: args.confidence,
            reach: found.reach,
            scattered: found.scattered,
            unsure: &found.unsure,
            regions: (found.regions.iter())
                .map(|r| Entry::of(r, &found, has_sd))
                .collect(),
        },
        text(args, &found, !file.stored.touched.is_empty(), has_sd),
    )
}

fn text(args: &Args, found: &StiffRegions, touched: bool, has_sd: bool) -> String {
    let points = if touched { "touched points" } else { "points" };
    let (Some(background), Some(stiff_from)) = (found.background, found.stiff_from) else {
        return format!("none of {} {points} has any stiffness\n", found.looked_at);
    };
    let sure = if has_sd {
        format!(", each point with a probability of {}", args.confidence)
    } else {
        String::new()
    };
    let mut text = format!(
        "background  {} N/m, the median of the {} of {} {points} that have any stiffness\n\
         stiff       from {} N/m on, {} times that{sure}\n\
         regions     of stiff points that are up to {} mm apart\n",
        number(background),
        found.felt,
        found.looked_at,
        number(stiff_from),
        number(args.contrast),
        number(1e3 * found.reach),
    );
    let decimals = (1.0 - found.reach.max(1e-9).log10()).ceil().clamp(3.0, 9.0) as usize;
    let row = |(k, r): (usize, &StiffRegion)| {
        let size = r.bounds[1] - r.bounds[0];
        let vector = |v: [f64; 3]| v.map(|c| fixed(c, decimals)).join(", ");
        vec![
            (k + 1).to_string(),
            r.points.len().to_string(),
            vector([r.center.x, r.center.y, r.center.z]),
            vector([size.x, size.y, size.z]),
            if has_sd {
                format!("{} ± {}", number(r.mean), number(r.sd))
            } else {
                number(r.mean)
            },
            number(r.largest),
            number(r.mean / background),
        ]
    };
    let rows: Vec<Vec<String>> = found
        .regions
        .iter()
        .take(SHOWN)
        .enumerate()
        .map(row)
        .collect();
    let header = [
        "region",
        "points",
        "center x, y, z [m]",
        "size [m]",
        "stiffness [N/m]",
        "largest",
        "times background",
    ];
    if rows.is_empty() {
        text += "no region is that stiff\n";
    } else {
        let _ = write!(text, "\n{}", table(&header, &rows));
    }
    if found.regions.len() > SHOWN {
        let _ = writeln!(
            text,
            "and {} smaller ones (--json has all)",
            found.regions.len() - SHOWN
        );
    }
    if found.scattered > 0 {
        let _ = writeln!(
            text,
            "stiff points in groups of fewer than {}: {}",
            args.fewest, found.scattered
        );
    }
    if !found.unsure.is_empty() {
        let _ = writeln!(
            text,
            "points that are likely that stiff, but less surely: {} (--json has them; further touches there, or a lower --confidence, tell)",
            found.unsure.len()
        );
    }
    text
}
