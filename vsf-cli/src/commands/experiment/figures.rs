//! Figs. 4, 5 and 7 as files.

use super::paper::Entry;
use crate::console::write_folder;
use crate::file_kind::FileKind;
use crate::pictures::{self, Surroundings, View};
use crate::recording::Recording;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use vsf::data::StiffnessField;
use vsf::pipeline::{Estimate, Experiment, UpdateTime, UpdateTimes, VisionSpec};
use vsf::plot::{Curve, CurvePlot};

/// A folder of figures.
pub struct Figures<'a> {
    folder: &'a Path,
    written: RefCell<Vec<PathBuf>>,
}

impl<'a> Figures<'a> {
    /// Names of the tables, in words and for machines, and of Fig. 4.
    pub const REPORT: &'static str = "report.md";
    pub const RESULTS: &'static str = "report.json";
    pub const UPDATE_TIMES: &'static str = "update_time.svg";

    /// What a file of this name is, if it is one of the folder's: figures of recordings begin with their number.
    pub fn kind(name: &str) -> Option<FileKind> {
        let is_numbered = || {
            let (number, _) = name.split_once('_')?;
            (number.len() >= 2 && number.bytes().all(|b| b.is_ascii_digit())).then_some(())
        };
        match name.rsplit_once('.')?.1 {
            _ if name == Self::REPORT => Some(FileKind::Report),
            _ if name == Self::RESULTS => Some(FileKind::Results),
            "svg" if name == Self::UPDATE_TIMES => Some(FileKind::Svg),
            "svg" => is_numbered().map(|()| FileKind::Svg),
            "png" => is_numbered().map(|()| FileKind::Png),
            _ => None,
        }
    }

    pub fn new(folder: &'a Path) -> Self {
        Self {
            folder,
            written: RefCell::default(),
        }
    }

    pub fn written(&self) -> Vec<PathBuf> {
        self.written.borrow().clone()
    }

    /// Writes or replaces a file of the folder.
    pub fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.folder.join(name);
        write_folder(self.folder, [(name, bytes)])?;
        let mut written = self.written.borrow_mut();
        if !written.contains(&path) {
            written.push(path);
        }
        Ok(())
    }

    /// Fig. 4.
    pub fn update_times(&self, stages: &[UpdateTimes]) -> anyhow::Result<()> {
        let column = |of: fn(&UpdateTime) -> f64| -> Vec<Vec<f64>> {
            stages
                .iter()
                .map(|s| s.times.iter().map(of).collect())
                .collect()
        };
        let (x, y) = (column(|t| t.contacts), column(|t| t.median_ms));
        let (low, high) = (column(|t| t.low_ms), column(|t| t.high_ms));
        let curve = |k: usize| Curve {
            name: stages[k].stage,
            x: &x[k],
            y: &y[k],
            low: &low[k],
            high: &high[k],
        };
        let curves: Vec<_> = (0..stages.len()).map(curve).collect();
        let plot = CurvePlot {
            curves: &curves,
            title: "Time of an update against its contacts (median, quartiles)",
            x_label: "contacts",
            y_label: "time [ms]",
            log_y: true,
        };
        self.write(Self::UPDATE_TIMES, plot.svg()?.as_bytes())
    }

    /// Fig. 7 of a recording, where it has one.
    pub fn curve(&self, number: usize, entry: &Entry) -> anyhow::Result<()> {
        let Some(last) = entry.curve.last() else {
            return Ok(());
        };
        let x: Vec<f64> = entry.curve.iter().map(|p| p.sequences as f64).collect();
        let of_method = |k: usize| -> Vec<f64> {
            let places = entry.curve.iter();
            places.map(|p| p.errors[k].evaluation.mean_error).collect()
        };
        let y: Vec<_> = (0..last.errors.len()).map(of_method).collect();
        let curve = |(k, errors): (usize, &vsf::pipeline::MethodErrors)| Curve {
            name: errors.method.name(),
            x: &x,
            y: &y[k],
            ..Curve::default()
        };
        let curves: Vec<_> = last.errors.iter().enumerate().map(curve).collect();
        let plot = CurvePlot {
            curves: &curves,
            title: &format!("{}: error against train sequences", entry.recording),
            x_label: "train sequences",
            y_label: &format!("mean error of predicted torques [{}]", entry.unit),
            log_y: false,
        };
        let name = format!("{}_curve.svg", file_stem(number, &entry.recording));
        self.write(&name, plot.svg()?.as_bytes())
    }

    /// Fig. 5: the field of the train sequences by touch alone and, with a camera, with what it
    /// sees, in the same colors.
    pub fn fields(
        &self,
        number: usize,
        recording: &Recording,
        experiment: &Experiment,
        vision: Option<&VisionSpec>,
    ) -> anyhow::Result<Vec<String>> {
        let name = &recording.dataset.name;
        let blind = experiment.blind_field()?;
        let limit = quantile(&blind);
        let mut around = Surroundings::default();
        if let Some(view) = &recording.dataset.camera {
            around = around.camera(view, experiment.scene().rest().positions());
        }
        let field = |estimate: &Estimate| -> anyhow::Result<StiffnessField> {
            Ok(estimate.to_field(experiment.scene(), experiment.hyper()?, name, &[])?)
        };
        let draw = |estimate: &Estimate, suffix: &str, how: &str| {
            let view = View {
                title: &format!("{name}, {how}"),
                deviation: false,
                limit,
            };
            let png = pictures::field(&field(estimate)?, &around, view, |v| v.png())?;
            let file = format!("{}_{suffix}.png", file_stem(number, name));
            self.write(&file, &png)?;
            Ok::<_, anyhow::Error>(file)
        };
        let mut written = vec![draw(&blind, "blind", "touch alone")?];
        if let Some(vision) = vision
            && let Some(mut seen) = experiment.vision_field(vision)?
        {
            // All points have a value: touched, guessed, or nothing there.
            seen.touched.fill(true);
            written.push(draw(&seen, "vision", "touch and vision")?);
        }
        Ok(written)
    }
}

/// The 99 % quantile of the stiffness of touched points; `None` where none has any.
fn quantile(estimate: &Estimate) -> Option<f64> {
    let all = estimate.belief.mean().iter().zip(&estimate.touched);
    let mut values: Vec<f64> = all
        .filter(|(k, t)| **t && **k > 0.0)
        .map(|(k, _)| *k)
        .collect();
    values.sort_by(f64::total_cmp);
    values.get((0.99 * values.len() as f64) as usize).copied()
}

/// The start of the names of a recording's files: different for every recording, and plain.
pub fn file_stem(number: usize, recording: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = recording.chars().take(60).map(plain).collect();
    format!("{number:02}_{name}")
}
