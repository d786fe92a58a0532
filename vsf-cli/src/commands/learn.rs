use crate::console::{Console, plural, write_file};
use crate::exit::usage;
use crate::file_kind::FileKind;
use crate::outputs::place;
use crate::range::ending;
use crate::recording::Recording;
use crate::settings::SceneSettings;
use anyhow::Context;
use serde::Serialize;
use std::borrow::Cow;
use std::path::PathBuf;
use vsf::core::RestPoints;
use vsf::pipeline::PipelineError;
use vsf::vision::{GpConfig, KnnConfig, LearnedPrior, RegressorSpec, Samples, Seen};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The touched points of each field are described by color, depth behind the visible surface and height, and \
their stiffness is learned over all objects. `vsf estimate NEW --vision FILE` uses the result as the mean of \
the prior for another recording with a camera/.

Example:
  vsf learn plant_a=a.npz plant_b=b.npz --out plants.json
  vsf estimate plant_c --vision plants.json

JSON keys: out, objects, points.")]
pub struct Args {
    /// Recordings with a camera/, each with the field estimated from it; without =FIELD, the one stored in the
    /// recording
    #[arg(required = true, value_name = "RECORDING[=FIELD]", value_parser = object)]
    objects: Vec<Object>,
    /// File for the result, .json
    #[arg(long, value_name = "FILE", value_parser = ending("json"))]
    out: PathBuf,
    /// Regression of stiffness on appearance
    #[arg(long, value_enum, default_value = "ridge")]
    regressor: Kind,
}

/// A recording and its field.
#[derive(Debug, Clone)]
struct Object {
    recording: PathBuf,
    field: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// The 200 nearest neighbors
    Knn,
    /// Linear regression
    Ridge,
    /// Gaussian process
    Gp,
}

#[derive(Serialize)]
struct Report<'a> {
    out: Cow<'a, str>,
    objects: usize,
    points: usize,
}

fn object(text: &str) -> Result<Object, String> {
    // A folder may have = in its name.
    let (recording, field) = match text.rsplit_once('=') {
        Some((recording, field)) if !PathBuf::from(text).is_dir() => (recording, Some(field)),
        _ => (text, None),
    };
    if recording.is_empty() || field.is_some_and(str::is_empty) {
        Err("must be RECORDING or RECORDING=FIELD".to_owned())
    } else {
        Ok(Object {
            recording: recording.into(),
            field: field.map(PathBuf::from),
        })
    }
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let kind = Some(FileKind::Learned);
    console.outputs.file("--out", &args.out, kind)?;
    for (k, object) in args.objects.iter().enumerate() {
        let recording = place(&object.recording);
        if args.objects[..k]
            .iter()
            .any(|o| place(&o.recording) == recording)
        {
            let name = object.recording.display();
            return Err(usage(format!("{name} is given twice")));
        }
    }
    let samples = |object: &Object| {
        let place = || object.recording.display().to_string();
        samples(object, console).with_context(place)
    };
    let learned = args.objects.iter().map(samples);
    let (names, samples): (Vec<String>, Vec<Samples>) = learned.collect::<Result<_, _>>()?;
    let regressor = match args.regressor {
        Kind::Knn => RegressorSpec::Knn(KnnConfig::default()),
        Kind::Ridge => RegressorSpec::Ridge,
        Kind::Gp => RegressorSpec::GaussianProcess(GpConfig::default()),
    };
    let learned = LearnedPrior::fit(regressor, &samples)?.with_names(names);
    write_file(&args.out, learned.to_json().as_bytes())?;
    let (objects, points) = learned.learned_from();
    let out = args.out.to_string_lossy();
    let s = plural(objects);
    let text =
        format!("learned from {points} touched points of {objects} object{s}\nwrote {out}\n");
    console.results(
        &Report {
            out,
            objects,
            points,
        },
        text,
    )
}

/// The name of an object, and what it teaches.
fn samples(object: &Object, console: &Console) -> anyhow::Result<(String, Samples)> {
    let recording = Recording::open(&object.recording, &SceneSettings::default(), console)?;
    let view = recording.view()?.ok_or(PipelineError::NoCamera)?;
    let given = object.field.as_deref();
    let file = recording.stored_or(given, console)?.ok_or_else(|| {
        let name = object.recording.display();
        usage(format!(
            "{name}=FIELD is required: the recording stores no field; `vsf estimate` makes one"
        ))
    })?;
    recording.check_field(&file, console)?;
    let stored = &file.stored;
    let says_all = !stored.touched.is_empty() && file.field.sd.is_some();
    let Some(prior_sd) = stored.prior_sd.filter(|_| says_all) else {
        let path = file.path.display();
        anyhow::bail!(
            "{path}: without K_std, touched and prior_sd; give a field that `vsf estimate` wrote"
        );
    };
    let rest = RestPoints::new(file.field.points.clone())?;
    let points = rest.positions();
    let seen = Seen::new(&view, points, 0.5 * rest.spacing())?;
    let variance = prior_sd * prior_sd;
    let samples = LearnedPrior::samples(&seen, &stored.belief, &stored.touched, variance)?;
    Ok((recording.dataset.name, samples))
}
