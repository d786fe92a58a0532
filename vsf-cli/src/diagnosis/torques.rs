use anyhow::Context;
use vsf::gap::{Campaign, LocatedShare, Model, Motion, Outcome, Place, Residuals};
use vsf::pipeline::reading_unit;
use vsf::plot::{JointTrace, TorquePlot};

/// Torques of a checked sequence before and after, as SVG.
pub struct Torques {
    /// ID of the sequence: the one with the largest nominal error.
    pub sequence: String,
    /// The joints in which most of the gap is located.
    pub worst: String,
    /// All joints, these first, where there are more.
    pub all: Option<String>,
}

/// Joints that are shown first.
const WORST: usize = 3;

/// One joint over a sequence.
struct Curves {
    joint: usize,
    measured: Vec<f64>,
    nominal: Vec<f64>,
    corrected: Vec<f64>,
}

/// Draws the sequence on which the nominal model is worst.
pub fn torques(outcome: &Outcome) -> anyhow::Result<Option<Torques>> {
    let (campaign, checked) = (&outcome.campaign, &outcome.checked);
    let error = |s: &usize| {
        let rows = &outcome.nominal.rows[*s];
        rows.iter().map(|r| r * r).sum::<f64>() / rows.len().max(1) as f64
    };
    let worst = (0..checked.len()).max_by(|a, b| error(a).total_cmp(&error(b)));
    let Some(s) = worst.filter(|s| !checked[*s].is_empty()) else {
        return Ok(None);
    };
    let motion = &checked[s];
    let joints = campaign.site().joints();
    let of = |table: &[f64], j: usize| table.iter().skip(j).step_by(joints).copied().collect();
    let measured = |r: &Residuals| -> Vec<f64> {
        let pairs = r.rows[s].iter().zip(&r.predicted[s]);
        pairs
            .map(|(residual, predicted)| residual + predicted)
            .collect()
    };
    let measured = measured(&outcome.nominal);
    let mut curves: Vec<Curves> = (0..joints)
        .map(|j| Curves {
            joint: j,
            measured: of(&measured, j),
            nominal: of(&outcome.nominal.predicted[s], j),
            corrected: of(&outcome.corrected.predicted[s], j),
        })
        .collect();
    let share = |c: &Curves| {
        let joint = campaign.site().robot.joints()[c.joint].name();
        let own = |l: &&LocatedShare| matches!(&l.of, Place::Joint(name) if name == joint);
        let located = &outcome.diagnosis.location.joint;
        located.iter().find(own).map_or(0.0, |l| l.share)
    };
    curves.sort_by(|a, b| share(b).total_cmp(&share(a)));
    let corrects = !outcome.model.parts.is_empty();
    let draw =
        |curves: &[Curves]| svg(campaign, motion, curves, corrects).context(motion.id.clone());
    let all = if joints > WORST {
        Some(draw(&curves)?)
    } else {
        None
    };
    curves.truncate(WORST);
    Ok(Some(Torques {
        sequence: motion.id.clone(),
        worst: draw(&curves)?,
        all,
    }))
}

/// Without a correction (`corrects`), the nominal model is the one that predicts.
fn svg(
    campaign: &Campaign,
    motion: &Motion,
    curves: &[Curves],
    corrects: bool,
) -> anyhow::Result<String> {
    let log = campaign.contact_log(&Model::default(), motion)?;
    let contact: Vec<bool> = log.contacts.iter().map(|c| !c.is_empty()).collect();
    let start = motion.clock.first().copied().unwrap_or(0.0);
    let time: Vec<f64> = motion.clock.iter().map(|t| t - start).collect();
    let joints: Vec<JointTrace> = (curves.iter())
        .map(|c| {
            let joint = &campaign.site().robot.joints()[c.joint];
            JointTrace {
                name: joint.name(),
                unit: reading_unit(joint),
                measured: &c.measured,
                predicted: &c.corrected,
                nominal: if corrects { &c.nominal } else { &[] },
                sigma: &[],
            }
        })
        .collect();
    let title = format!("Sequence {}", motion.id);
    let touches = contact.contains(&true);
    Ok(TorquePlot {
        time: &time,
        joints: &joints,
        contact: if touches { &contact } else { &[] },
        title: &title,
    }
    .svg()?)
}
