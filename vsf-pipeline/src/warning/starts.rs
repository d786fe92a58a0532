use super::{PipelineWarning, malformed};
use crate::live::deepest_start;
use crate::readings::check_sequence;
use crate::{PipelineError, Scene, SceneContact};
use rayon::prelude::*;
use vsf_core::{ContactModel, Contacts};
use vsf_data::Sequence;

/// Reports touches that begin inside of the object. If [`Sequence::check`] refuses a sequence, or if it has
/// other joints than the robot, only that is reported.
pub fn touch_warnings(scene: &Scene, sequences: &[&Sequence]) -> Vec<PipelineWarning> {
    let checked = |s: &&Sequence| (s.id.clone(), check_sequence(scene.robot(), s));
    let malformed = malformed(sequences.iter().map(checked));
    if malformed.is_empty() {
        warning(scene, sequences).into_iter().collect()
    } else {
        malformed
    }
}

/// The deepest that the arm is inside of the object where a touch begins, beyond what a touch that begins in
/// contact presses.
fn warning(scene: &Scene, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let contact = scene.contact_model().ok()?;
    let most = contact.deepest_starts(scene.rest().spacing());
    let starts = sequences
        .iter()
        .flat_map(|s| s.touches().map(move |touch| (*s, touch.start)));
    let starts: Vec<(&Sequence, usize)> = starts.collect();
    let inside = |&(sequence, row): &(&Sequence, usize)| {
        let (link, depth) = deepest(scene, contact.clone(), sequence, row, &most).ok()??;
        Some((sequence.id.clone(), row, link, depth))
    };
    let found: Vec<_> = starts.par_iter().filter_map(inside).collect();
    let others = found.len().saturating_sub(1);
    let (sequence, row, link, depth) = found.into_iter().max_by(|a, b| a.3.total_cmp(&b.3))?;
    Some(PipelineWarning::StartsInside {
        sequence,
        row,
        link: scene.robot().links()[link].name().to_owned(),
        depth,
        others,
    })
}

/// The link that is too deep inside in a row that nothing is known before, and how deep (m).
fn deepest(
    scene: &Scene,
    mut contact: SceneContact,
    sequence: &Sequence,
    row: usize,
    most: &[f64],
) -> Result<Option<(usize, f64)>, PipelineError> {
    let mut posture = scene.robot().posture();
    scene
        .robot()
        .update_posture(&sequence.angles[row], &mut posture)?;
    let mut contacts = Contacts::new();
    contact.step(scene.rest(), &posture, &mut contacts)?;
    Ok(deepest_start(contact.moved(&contacts), most))
}
