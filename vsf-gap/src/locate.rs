use crate::bootstrap::Bootstrap;
use crate::closure::Residuals;
use crate::{Campaign, GapError, Model, Motion, Phase, center};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use vsf_core::median;

/// Edge of the cells (m) that regions are made of, and most regions named.
const CELL: f64 = 0.06;
const REGIONS: usize = 5;
/// Most octaves of a rate.
const OCTAVES: usize = 10;

/// The share of the gap in one part of the recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LocatedShare {
    /// The part, under the key of its kind.
    #[serde(flatten)]
    pub of: Place,
    /// Share of the energy of the gap, 0 to 1.
    ///
    /// For a frequency band, it is the share of everything that the nominal model leaves, noise included. What changes too
    /// slowly for a touch to show, constants included, is in the band from 0.
    pub share: f64,
    /// 95 % interval of the share; of zero width where there is none (frequencies).
    pub interval: [f64; 2],
    /// RMS residual of the nominal model beyond the noise on the checked sequences (N m or N).
    ///
    /// For frequency bands, the noise is included. 0 if none of the checked sequences is in this part.
    pub excess: f64,
}

/// A part of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Place {
    /// Name of a joint.
    Joint(String),
    /// A phase of a touch.
    Phase(Phase),
    /// Name of the link in contact; `None` in free motion, which is `"none"` in JSON.
    Link(#[serde(with = "link_or_none")] Option<String>),
    /// ID of a sequence.
    Sequence(String),
    /// Lower and upper frequency (Hz).
    Frequency([f64; 2]),
}

/// Serialization of the link in contact.
mod link_or_none {
    use serde::{Deserialize, Deserializer, Serializer};

    const NONE: &str = "none";

    pub(super) fn serialize<S: Serializer>(
        link: &Option<String>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        to.serialize_str(link.as_deref().unwrap_or(NONE))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<String>, D::Error> {
        let name = String::deserialize(from)?;
        Ok(Some(name).filter(|name| name != NONE))
    }
}

/// The share of the gap in a region of space.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Region {
    /// Center (m, world).
    pub center: [f64; 3],
    /// Radius (m).
    pub radius: f64,
    /// Share of the energy of the gap in contact.
    pub share: f64,
}

/// Where the gap lies.
///
/// If effects are named, shares are those of the torques that they change; otherwise, those of the residuals of the nominal
/// model on the checked sequences.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Location {
    /// By joint.
    pub joint: Vec<LocatedShare>,
    /// By phase.
    pub phase: Vec<LocatedShare>,
    /// By link in contact.
    pub link: Vec<LocatedShare>,
    /// By sequence.
    pub sequence: Vec<LocatedShare>,
    /// By region of space.
    pub region: Vec<Region>,
    /// By frequency, always of the residuals.
    pub frequency: Vec<LocatedShare>,
}

/// One sample and the parts that it belongs to.
struct Row {
    sequence: usize,
    phase: Phase,
    link: Option<usize>,
    place: Option<Point3<f64>>,
    /// Energy of the gap per joint.
    energy: Vec<f64>,
    /// Squared residual of the nominal model minus the noise, per joint, on checked sequences.
    excess: Option<Vec<f64>>,
}

/// Finds where the gap lies. `model` with `field` is the corrected model, `before` the residuals of
/// the nominal one on the sequences `checked`.
pub(crate) fn locate(
    campaign: &Campaign,
    model: &Model,
    field: &[f64],
    before: &Residuals,
    checked: &[Motion],
    seed: u64,
) -> Result<Location, GapError> {
    let (d, noise) = (campaign.site.joints(), &campaign.noise);
    let nominal = Model::default();
    let named = !model.parts.is_empty();
    let all: Vec<&Motion> = if named {
        campaign.train.iter().chain(campaign.test.iter()).collect()
    } else {
        checked.iter().collect()
    };
    let mut rows = Vec::new();
    let mut ids: Vec<String> = Vec::new();
    // The whole session at once: what an effect does to the object lasts.
    let change = if named {
        Some((
            campaign.residuals(model, field, &all)?,
            campaign.residuals(&nominal, field, &all)?,
        ))
    } else {
        None
    };
    for (sequence, motion) in all.iter().copied().enumerate() {
        let logs = campaign.contact_logs(&nominal, &[motion])?;
        let phases = campaign.phases(motion, &logs[0])?;
        let tested = checked.iter().position(|m| m.is(motion));
        // Parts of one sequence are one.
        let of = (ids.iter().position(|id| *id == motion.id)).unwrap_or_else(|| {
            ids.push(motion.id.clone());
            ids.len() - 1
        });
        for (row, &phase) in phases.iter().enumerate() {
            let at = center(&logs[0].touch(&campaign.site, row));
            let beyond =
                |s: usize, j: usize| before.rows[s][row * d + j].powi(2) - noise[j].sd.powi(2);
            let excess: Option<Vec<f64>> = tested.map(|s| (0..d).map(|j| beyond(s, j)).collect());
            let energy = match &change {
                Some((with, without)) => (0..d)
                    .map(|j| {
                        let k = row * d + j;
                        (with.predicted[sequence][k] - without.predicted[sequence][k]).powi(2)
                    })
                    .collect(),
                // Only checked sequences are looked at then.
                None => excess.clone().unwrap_or_default(),
            };
            rows.push(Row {
                sequence: of,
                phase,
                link: at.map(|(link, _)| link),
                place: at.map(|(_, p)| p),
                energy,
                excess,
            });
        }
    }
    let mut bootstrap = Bootstrap::new(&all, seed);
    let robot = &campaign.site.robot;
    let mut parts = |ofs: Vec<Place>, member: &dyn Fn(&Row, usize) -> Option<usize>| {
        shares(&rows, d, ofs, member, &mut bootstrap)
    };
    let joint = parts(
        robot
            .joints()
            .iter()
            .map(|j| Place::Joint(j.name().to_owned()))
            .collect(),
        &|_, j| Some(j),
    );
    let phase = parts(
        Phase::ALL.iter().map(|p| Place::Phase(*p)).collect(),
        &|row, _| Phase::ALL.iter().position(|p| *p == row.phase),
    );
    let links: Vec<usize> = (0..robot.link_count())
        .filter(|l| rows.iter().any(|r| r.link == Some(*l)))
        .collect();
    let mut names: Vec<Place> = links
        .iter()
        .map(|&l| Place::Link(Some(robot.links()[l].name().to_owned())))
        .collect();
    names.push(Place::Link(None));
    let link = parts(names, &|row, _| match row.link {
        Some(l) => links.iter().position(|k| *k == l),
        None => Some(links.len()),
    });
    let sequence = parts(ids.into_iter().map(Place::Sequence).collect(), &|row, _| {
        Some(row.sequence)
    });
    Ok(Location {
        joint,
        phase,
        link,
        sequence,
        region: regions(&rows),
        frequency: frequencies(before, checked),
    })
}

/// Shares of energy by parts that samples or joints belong to.
fn shares(
    rows: &[Row],
    joints: usize,
    ofs: Vec<Place>,
    member: &dyn Fn(&Row, usize) -> Option<usize>,
    bootstrap: &mut Bootstrap,
) -> Vec<LocatedShare> {
    let add = |sample: usize, sums: &mut [f64]| {
        let row = &rows[sample];
        for j in 0..joints {
            if let Some(k) = member(row, j) {
                sums[k] += row.energy[j];
            }
        }
    };
    let share = |sums: &[f64]| {
        let total: f64 = sums.iter().map(|s| s.max(0.0)).sum();
        let of_total = |s: &f64| if total > 0.0 { s.max(0.0) / total } else { 0.0 };
        sums.iter().map(of_total).collect()
    };
    let found = bootstrap.intervals(ofs.len(), add, share);
    let mut parts: Vec<LocatedShare> = (ofs.into_iter().enumerate())
        .map(|(k, of)| {
            let (mut excess, mut count) = (0.0, 0usize);
            for row in rows {
                let Some(beyond) = &row.excess else { continue };
                for j in (0..joints).filter(|&j| member(row, j) == Some(k)) {
                    excess += beyond[j];
                    count += 1;
                }
            }
            LocatedShare {
                of,
                share: found[k].value,
                interval: found[k].interval,
                excess: (excess / count.max(1) as f64).max(0.0).sqrt(),
            }
        })
        .collect();
    parts.sort_by(|a, b| b.share.total_cmp(&a.share));
    parts
}

/// The cells with most of the energy in contact.
fn regions(rows: &[Row]) -> Vec<Region> {
    let mut cells: std::collections::BTreeMap<[i64; 3], (f64, Vector3<f64>, f64)> =
        std::collections::BTreeMap::new();
    for row in rows {
        let Some(p) = row.place else { continue };
        let energy: f64 = row.energy.iter().sum();
        let key = [0, 1, 2].map(|axis| (p[axis] / CELL).floor() as i64);
        let cell = cells.entry(key).or_insert((0.0, Vector3::zeros(), 0.0));
        cell.0 += energy;
        cell.1 += p.coords;
        cell.2 += 1.0;
    }
    let total: f64 = cells.values().map(|(energy, ..)| energy.max(0.0)).sum();
    let mut found: Vec<Region> = (cells.values())
        .filter(|(energy, ..)| *energy > 0.0)
        .map(|(energy, sum, count)| Region {
            center: (sum / *count).into(),
            radius: 0.5 * CELL,
            share: energy / total,
        })
        .collect();
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found.truncate(REGIONS);
    found
}

/// Energy of residuals by octaves, touch by touch. Sequences with other sample rates have octaves of their own.
fn frequencies(before: &Residuals, motions: &[Motion]) -> Vec<LocatedShare> {
    let d = before.joints;
    let mut bands: Vec<([f64; 2], f64, usize)> = Vec::new();
    // What changes more slowly than a touch shows, constant parts included.
    let mut slow = ([0.0; 2], 0.0, 0);
    for (rows, motion) in before.rows.iter().zip(motions) {
        for touch in &motion.touches {
            let Some(step) = median_step(&motion.clock[touch.clone()]) else {
                continue;
            };
            let rows = &rows[touch.start * d..touch.end * d];
            let octaves = octaves(rows, d);
            let lowest = 0.5_f64.powi(octaves.len() as i32 + 1) / step;
            let all: f64 = rows.iter().map(|r| r * r).sum();
            let quick: f64 = octaves.iter().sum();
            slow.0[1] = lowest.max(slow.0[1]);
            (slow.1, slow.2) = (slow.1 + (all - quick).max(0.0), slow.2 + rows.len());
            for (octave, energy) in octaves.into_iter().enumerate() {
                let rate = 0.5_f64.powi(octave as i32) / step;
                let is_of =
                    |b: &&mut ([f64; 2], f64, usize)| (b.0[1] / (0.5 * rate)).log2().abs() < 0.5;
                match bands.iter_mut().find(is_of) {
                    Some(b) => (b.1, b.2) = (b.1 + energy, b.2 + rows.len()),
                    None => bands.push(([0.25 * rate, 0.5 * rate], energy, rows.len())),
                }
            }
        }
    }
    bands.sort_by(|a, b| b.0[1].total_cmp(&a.0[1]));
    bands.extend((slow.2 > 0).then_some(slow));
    let total: f64 = bands.iter().map(|b| b.1).sum();
    bands
        .into_iter()
        .map(|(band, energy, count)| {
            let share = if total > 0.0 { energy / total } else { 0.0 };
            LocatedShare {
                of: Place::Frequency(band),
                share,
                interval: [share, share],
                excess: (energy / count.max(1) as f64).sqrt(),
            }
        })
        .collect()
}

/// Median time between samples (s), if time increases.
fn median_step(clock: &[f64]) -> Option<f64> {
    let steps = clock.windows(2).map(|t| t[1] - t[0]);
    median(steps.collect()).filter(|step| *step > 0.0)
}

/// Energy of the octaves of `d` signals, downward from half the sample rate: differences of means over twice as many
/// samples each time.
fn octaves(rows: &[f64], d: usize) -> Vec<f64> {
    let mut means = rows.to_vec();
    let mut energies = Vec::new();
    while means.len() >= 4 * d && energies.len() < OCTAVES {
        let samples = 2.0_f64.powi(energies.len() as i32 + 1);
        let (mut half, mut energy) = (Vec::with_capacity(means.len() / 2), 0.0);
        for two in means.chunks_exact(2 * d) {
            for j in 0..d {
                half.push(0.5 * (two[j] + two[d + j]));
                energy += (0.5 * (two[j] - two[d + j])).powi(2);
            }
        }
        energies.push(energy * samples);
        means = half;
    }
    energies
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn free_motion_is_the_link_none_in_json() {
        for (place, json) in [
            (
                Place::Link(None),
                r#"{"link":"none","share":1.0,"interval":[1.0,1.0],"excess":0.0}"#,
            ),
            (
                Place::Link(Some("palm".to_owned())),
                r#"{"link":"palm","share":1.0,"interval":[1.0,1.0],"excess":0.0}"#,
            ),
        ] {
            let share = LocatedShare {
                of: place,
                share: 1.0,
                interval: [1.0; 2],
                excess: 0.0,
            };
            assert_eq!(serde_json::to_string(&share).unwrap(), json);
            assert_eq!(serde_json::from_str::<LocatedShare>(json).unwrap(), share);
        }
    }

    /// Touches with pauses between them, of a residual that alternates from sample to sample at one rate, and of one
    /// that does so at another.
    #[test]
    fn frequencies_are_those_of_each_touch() {
        let of = |step: f64, rows: usize| {
            let mut motion = Motion::counting(2 * rows, vec![0..rows, rows..2 * rows]);
            let clock = |k: usize| step * k as f64 + if k < rows { 0.0 } else { 9.0 };
            motion.clock = (0..2 * rows).map(clock).collect();
            motion
        };
        let motions = [of(0.01, 100), of(0.2, 20)];
        let alternating = |rows: usize| (0..rows).map(|k| 1.0 - 2.0 * (k % 2) as f64).collect();
        let before = Residuals {
            joints: 1,
            rows: vec![alternating(200), alternating(40)],
            predicted: Vec::new(),
        };
        let found = frequencies(&before, &motions);
        let share = |highest: f64| {
            let is_of = |l: &&LocatedShare| matches!(l.of, Place::Frequency([_, b]) if (b - highest).abs() < 1e-6);
            found.iter().find(is_of).unwrap().share
        };
        assert!((share(50.0) - 200.0 / 240.0).abs() < 1e-12, "{found:?}");
        let other: Vec<_> = found.iter().filter(|l| l.share > 0.0).collect();
        assert_eq!(other.len(), 2, "{found:?}");
        // Its 2.5 Hz lie nearest to the octave below 3.125 Hz.
        assert!((share(3.125) - 40.0 / 240.0).abs() < 1e-12, "{found:?}");
        // A constant is slower than all of them.
        let constant = Residuals {
            rows: before
                .rows
                .iter()
                .map(|rows| vec![2.0; rows.len()])
                .collect(),
            ..before
        };
        let found = frequencies(&constant, &motions);
        let slowest = found.last().unwrap();
        assert!(matches!(slowest.of, Place::Frequency([0.0, _])) && slowest.share == 1.0);
    }
}
