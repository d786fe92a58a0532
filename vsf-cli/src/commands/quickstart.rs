use crate::commands::estimate::text::{how, noise_text};
use crate::commands::evaluate::measure;
use crate::console::{Console, number, table, write_file};
use crate::exit::usage;
use crate::field_file::save;
use crate::file_kind::FileKind;
use crate::fit::fit;
use crate::pictures::{self, Surroundings, View};
use crate::recording::{Recording, SplitPart};
use crate::samples::ONE_PLACE;
use crate::settings::{EstimatorSettings, SceneSettings};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;
use vsf::pipeline::{Baseline, Evaluation, evaluate, predict};

const FOLDER: &str = "vsf-quickstart";
const RECORDING: &str = "recording";
const FILES: [(&str, FileKind); 4] = [
    ("field.npz", FileKind::Npz),
    ("field.ply", FileKind::Ply),
    ("field.png", FileKind::Png),
    ("torques.svg", FileKind::Svg),
];

const HEAD: &str = "\
A Kinova Gen3 pushes into a small orange tree (simulated, by a rigid-body engine that knows no
springs). From the joint angles and torques of one push, vsf estimates how stiff the tree is at
every point, then predicts the torques of three other pushes.

";

/// Keys: as those of `estimate` and `evaluate`.
#[derive(Serialize)]
struct Report<'a> {
    folder: &'a str,
    prior_sd: f64,
    noise_sd: &'a [f64],
    touched_points: usize,
    field: &'a Evaluation,
    zero: &'a Evaluation,
    knn: &'a Evaluation,
}

/// The main job on an embedded recording.
pub fn run(console: &Console) -> anyhow::Result<()> {
    let start = Instant::now();
    let folder = Path::new(FOLDER);
    console
        .outputs
        .folder("the quick start's", folder, "its own", |_| None)?;
    if let Some(path) = ONE_PLACE.changed_in(&folder.join(RECORDING)) {
        return Err(usage(format!(
            "{}: it is not as the quick start writes it, which would replace it; start in another folder, or move \
             {FOLDER}/ away",
            path.display()
        )));
    }
    for (name, kind) in FILES {
        kind.check("the quick start's", &folder.join(name))?;
    }
    let [npz, ply, png, svg] = FILES.map(|(name, _)| folder.join(name));
    console.report(HEAD)?;
    let dataset = ONE_PLACE.unpack(folder, RECORDING.as_ref())?;
    let recording = Recording::open(&dataset, &SceneSettings::default(), console)?;
    let train = recording.sequences(None, SplitPart::Train)?;
    let test = recording.sequences(None, SplitPart::Test)?;
    let scene = recording.scene_to_learn(None, None, console)?;
    let learned = recording.traces(&scene, &train, console)?;
    let chosen = fit(
        &scene,
        None,
        &learned,
        &EstimatorSettings::default(),
        None,
        console,
    )?;
    let hyper = &chosen.prior.hyper;

    let unseen = recording.traces(&scene, &test, console)?;
    let ours = evaluate(&scene, &chosen.estimate.belief, &unseen)?;
    let of = |baseline: Baseline| measure(&baseline, &recording, &scene, &test, &unseen);
    let (zero, knn) = (of(Baseline::Zero)?, of(Baseline::Knn { k: 50 })?);

    let name = &recording.dataset.name;
    let field = chosen.estimate.to_field(&scene, hyper, name, &learned)?;
    save(&field, &npz)?;
    save(&field, &ply)?;
    let mut around = Surroundings::default().robot(&scene, train[0], &learned[0])?;
    if let Some(view) = &recording.dataset.camera {
        around = around.camera(view, &field.points);
    }
    let view = View {
        title: "Orange tree, stiffness estimated from one push",
        deviation: false,
        limit: None,
    };
    let picture = pictures::field(&field, &around, view, |v| v.png())?;
    write_file(&png, &picture)?;
    let prediction = predict(&scene, &chosen.estimate.belief, &hyper.noise_sd, &unseen[0])?;
    let title = format!(
        "Orange tree, push {}, not used for the estimate",
        unseen[0].id
    );
    let plot = pictures::torques(&scene, &unseen[0], &prediction, &title)?;
    write_file(&svg, plot.as_bytes())?;

    let touched_points = chosen.estimate.touched.iter().filter(|t| **t).count();
    let mut text = format!(
        "{touched_points} of {} points were touched; prior N(0, {}²) N/m and noise sd {},\n{}.\n\n",
        scene.rest().len(),
        number(hyper.prior_sd),
        noise_text(&scene, &hyper.noise_sd),
        how(chosen.prior.method),
    );
    text += &errors(&ours, &zero, &knn);
    text += &tail(start.elapsed().as_secs_f64());
    let report = Report {
        folder: FOLDER,
        prior_sd: hyper.prior_sd,
        noise_sd: &hyper.noise_sd,
        touched_points,
        field: &ours,
        zero: &zero,
        knn: &knn,
    };
    console.results(&report, text)
}

fn errors(ours: &Evaluation, zero: &Evaluation, knn: &Evaluation) -> String {
    let all = std::iter::once(vec![
        "all".to_owned(),
        number(ours.mean_error),
        number(zero.mean_error),
        number(knn.mean_error),
    ]);
    let each = (0..ours.per_sequence.len()).map(|k| {
        let error = |e: &Evaluation| number(e.per_sequence[k].mean_error);
        vec![
            ours.per_sequence[k].sequence.clone(),
            error(ours),
            error(zero),
            error(knn),
        ]
    });
    let rows: Vec<_> = each.chain(all).collect();
    let header = [
        "unseen push",
        "stiffness field",
        "zero torque",
        "nearest neighbors",
    ];
    format!(
        "Mean error of the predicted joint torques, ||tau_hat - tau|| [N m]:\n{}",
        table(&header, &rows)
    )
}

fn tail(seconds: f64) -> String {
    format!(
        "
Done in {seconds:.1} s. In ./{FOLDER}:
  field.png    the field: stiff parts dark, untouched points gray
  torques.svg  measured and predicted torques of one unseen push
  field.ply    the field as a colored point cloud (MeshLab, CloudCompare, Blender)
  field.npz    the field for NumPy and for the other commands
  recording/   the touch recording: angles, torques, points, robot

Next:
  vsf info {FOLDER}/recording
  vsf view {FOLDER}/recording --field {FOLDER}/field.npz --out view.html
  vsf evaluate {FOLDER}/recording --field {FOLDER}/field.npz --baseline zero,knn
  vsf estimate {FOLDER}/recording --preset paper --out paper.npz
  vsf --help
"
    )
}
