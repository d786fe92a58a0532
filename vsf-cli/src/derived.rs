//! Recordings that these commands make, and which of them they replace.

use crate::console::{Console, read_text};
use crate::exit::usage;
use crate::interrupt::writing;
use crate::outputs::unmarked;
use crate::recording::{FieldArgs, Recording};
use anyhow::Context;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vsf::data::{Dataset, RobotRef, Sequence, Splits};
use vsf::pipeline::{Scene, check_torques};
use vsf::robots::urdf_bundle;

/// What is computed from a recording: the word for it, which ends the new one's name, and the command.
pub const SIMULATED: (&str, &str) = ("simulated", "vsf simulate");
pub const PREDICTED: (&str, &str) = ("predicted", "vsf predict");

/// Commands that compute a recording from another one.
pub const COMPUTED: [&str; 2] = [SIMULATED.1, PREDICTED.1];
/// That which converts one.
pub const IMPORT: &str = "vsf import";

/// The recording with these sequences, whose torques are `made` by a field in a scene and this command: named after
/// it, without stored field. Torques that no command would read again are refused.
pub fn derived(
    recording: &Recording,
    (made, command): (&str, &str),
    of: &FieldArgs,
    scene: &Scene,
    sequences: Vec<Sequence>,
) -> anyhow::Result<Dataset> {
    let dataset = &recording.dataset;
    let kept = |ids: &[String]| {
        let known = |id: &&String| sequences.iter().any(|s| s.id == **id);
        ids.iter().filter(known).cloned().collect::<Vec<_>>()
    };
    let mut splits = Splits {
        train: kept(&dataset.splits.train),
        test: kept(&dataset.splits.test),
    };
    if splits.train.is_empty() && splits.test.is_empty() {
        // As of a recording that says nothing of them.
        splits.train = sequences.iter().map(|s| s.id.clone()).collect();
    }
    let name = |path: &PathBuf| {
        let name = path.file_name().unwrap_or(path.as_os_str());
        name.to_string_lossy().into_owned()
    };
    let field = match &of.field {
        Some(path) => Some(format!("the stiffness field {}", name(path))),
        None => (recording.has_points()).then(|| "its stored stiffness field".to_owned()),
    };
    let model = (of.model.path()).map(|path| format!("the corrected model {}", name(path)));
    let by: Vec<String> = field.into_iter().chain(model).collect();
    let torques = format!("torques {made} by {}", by.join(" and "));
    for sequence in &sequences {
        check_torques(scene, &sequence.id, &sequence.torques).with_context(|| torques.clone())?;
    }
    let description = format!(
        "Made from the recording {:?}: {torques}. {}",
        dataset.name, dataset.description
    );
    Ok(Dataset {
        name: format!("{}, {made}", dataset.name),
        description: description.trim_end().to_owned(),
        splits,
        made_by: Some(command.to_owned()),
        contact: (!scene.rest().is_empty()).then(|| scene.contact_parameters()),
        field: None,
        sequences,
        ..dataset.clone()
    })
}

/// Whether a recording has the name `origin`, or that of one which was [`derived`] from it, in however many steps.
pub fn stems_from(name: &str, origin: &str) -> bool {
    let made = [SIMULATED.0, PREDICTED.0];
    let mut sources = std::iter::successors(Some(name), |name| {
        (made.iter()).find_map(|made| name.strip_suffix(made)?.strip_suffix(", "))
    });
    sources.any(|source| source == origin)
}

/// Where the deviations of a sequence's predicted torques are, in the folder of their recording.
pub fn deviations_of(id: &str) -> PathBuf {
    Path::new(&format!("seq_{id}")).join(Sequence::DEVIATIONS)
}

/// Writes a new recording to the folder `out`, with the files of its robot, which has these
/// `packages`, and others: the folder can be moved. All are written or none.
pub fn save(
    mut dataset: Dataset,
    packages: &BTreeMap<String, PathBuf>,
    out: &Path,
    mut files: Vec<(PathBuf, Vec<u8>)>,
) -> anyhow::Result<()> {
    if let Some(path) = &dataset.robot.path {
        let bundle = urdf_bundle(path, packages)?;
        let bundle = bundle
            .into_iter()
            .map(|(p, b)| (Path::new(Dataset::ROBOT).join(p), b));
        let bundle: Vec<_> = bundle.collect();
        if let Some((urdf, _)) = bundle.first() {
            dataset.robot = RobotRef {
                given: urdf.to_string_lossy().into_owned(),
                path: Some(out.join(urdf)),
            };
        }
        files.extend(bundle);
    }
    // Of a prediction that was there before: they are those of other torques.
    let deviations = dataset.sequences.iter().map(|s| deviations_of(&s.id));
    let deviations: Vec<_> = deviations.collect();
    Ok(writing(|| dataset.save_with(out, &files, &deviations))?)
}

/// Claims a folder for a recording, be it one whose writing was interrupted.
pub fn claim(out: &Path, console: &Console) -> anyhow::Result<()> {
    let was_there = Dataset::maker(out).is_some();
    let what = "a recording that vsf has made";
    console.outputs.folder("--out", out, what, |names| {
        unmarked(names, &["dataset.json"]).filter(|_| !was_there)
    })
}

/// Refuses to replace a recording in the folder of a flag that none of these has made: one that was measured is lost for ever.
pub fn keep_made(flag: &str, out: &Path, by: &[&str]) -> anyhow::Result<()> {
    let metadata = out.join("dataset.json");
    let made_by = match Dataset::maker(out) {
        Some(command) if by.contains(&&*command) => {
            if Dataset::is_edited(out) {
                return Err(usage(format!(
                    "{flag} {}: the recording there was edited since {command:?} wrote it, which would be lost; choose a new \
                     folder, or remove that one",
                    out.display()
                )));
            } else {
                return Ok(());
            }
        }
        Some(command) => format!("is by {command:?}"),
        None if !metadata.exists() => return Ok(()),
        None => {
            read_text(&metadata)?;
            "may be measured (no made_by in its dataset.json)".to_owned()
        }
    };
    Err(usage(format!(
        "{flag} {}: the recording there {made_by} and is replaced by no other kind; choose a new folder, or remove that \
         one",
        out.display()
    )))
}

/// Refuses an output in the place of a robot's file.
pub fn keep_robot(robot: Option<&RobotRef>, console: &Console) -> anyhow::Result<()> {
    let urdf = robot.and_then(|robot| robot.path.as_deref());
    urdf.map_or(Ok(()), |urdf| console.outputs.keep(urdf))
}
