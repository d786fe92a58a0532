use crate::console::{Console, number, write_file};
use crate::exit::usage;
use crate::range::{corners, ending, finite, fits, positive};
use crate::recording::Recording;
use crate::settings::SceneSettings;
use anyhow::Context;
use serde::Serialize;
use std::borrow::Cow;
use std::path::PathBuf;
use vsf::data::Table;
use vsf::pipeline::PipelineError;
use vsf::vision::{Bounds, OcclusionGrid};

/// Most cells of the box: each is looked at.
const MOST_CELLS: f64 = 1e8;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The points are those of the visible surface, one per cube of the spacing, and the centers of the cubes of the \
box that lie behind it or outside the image, where the object may be. Space that the camera sees through gets \
no points (section IV-A of the paper).

Example:
  vsf points my_recording --out my_recording/points.npy

JSON keys: out, points, surface, occluded, spacing, box.")]
pub struct Args {
    /// Folder of the recording, with a camera/
    dataset: PathBuf,
    /// New file for the points, .npy, (N, 3) [m]
    #[arg(long, value_parser = ending("npy"))]
    out: PathBuf,
    /// Spacing of the points [m]
    #[arg(long, default_value_t = 0.01, value_parser = positive)]
    spacing: f64,
    /// Box around the object: two opposite corners x,y,z,x,y,z in the world frame [m]; default: the recording's
    /// object_bbox
    #[arg(long = "box", id = "box", value_delimiter = ',', num_args = 1, allow_hyphen_values = true,
        value_name = "X,Y,Z,X,Y,Z", value_parser = finite)]
    corners: Option<Vec<f64>>,
}

#[derive(Serialize)]
struct Report<'a> {
    out: Cow<'a, str>,
    points: usize,
    surface: usize,
    occluded: usize,
    spacing: f64,
    r#box: [[f64; 3]; 2],
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let out = args.out.to_string_lossy();
    if args.out.exists() {
        return Err(usage(format!(
            "--out {out} is there already; choose a new file"
        )));
    }
    let recording = Recording::open(&args.dataset, &SceneSettings::default(), console)?;
    // Only now: a new file may lie in the recording.
    console.outputs.file("--out", &args.out, None)?;
    let view = recording.view()?.ok_or(PipelineError::NoCamera)?;
    let corners = match (&args.corners, recording.dataset.object_bbox) {
        (Some(given), _) => corners(given)?,
        (None, Some(recorded)) => recorded,
        (None, None) => {
            return Err(usage(
                "--box is required: the recording has no object_bbox around the object",
            ));
        }
    };
    fits(args.spacing, &corners)?;
    let [lower, upper] = corners;
    let bounds = Bounds::new(lower, upper).context("object_bbox")?;
    let cells = bounds
        .size()
        .map(|edge| (edge / args.spacing).round().max(1.0));
    if cells.product() > MOST_CELLS {
        let spacing = args.spacing;
        return Err(usage(format!(
            "--spacing {spacing:?} makes more than {MOST_CELLS:e} cells of the box"
        )));
    }
    let spinner = console.spinner("looking behind the surface");
    let surface = view.cloud(&bounds).downsampled(args.spacing)?;
    let grid = OcclusionGrid::new(&view, &bounds, cells.map(|n| n as usize).into())?;
    let (points, seen) = grid.rest_points(&surface);
    spinner.finish_and_clear();
    if points.is_empty() {
        anyhow::bail!(
            "{}: the camera sees through all of the box; is it where the object is?",
            args.dataset.display()
        );
    }
    let coordinates = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    if seen == 0 {
        console.warn(
            "no seen surface is in the box: its points are hidden by what is in front of it, or outside of the \
             picture; is it where the object is?",
        );
    }
    write_file(&args.out, &Table::new(3, coordinates)?.npy())?;
    let report = Report {
        out,
        points: points.len(),
        surface: seen,
        occluded: points.len() - seen,
        spacing: args.spacing,
        r#box: [lower, upper].map(Into::into),
    };
    console.results(
        &report,
        format!(
            "wrote {}: {} points {} m apart, {} on the seen surface and {} behind it\n",
            report.out,
            report.points,
            number(report.spacing),
            report.surface,
            report.occluded
        ),
    )
}
