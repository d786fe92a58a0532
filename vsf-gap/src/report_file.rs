use crate::{Diagnosis, GapError, MeanErrors, Place};
use std::ops::RangeInclusive;
use vsf_core::RestPoints;
use vsf_data::parse_json;

/// Version of the format.
pub(crate) const SCHEMA: u32 = 1;

/// Rounding of shares that add up to 1.
const ROUNDING: f64 = 1e-9;
const SHARE: RangeInclusive<f64> = -ROUNDING..=1.0 + ROUNDING;
/// Larger than any torque, evidence or parameter of a diagnosis.
const MOST: f64 = 1e16;

impl Diagnosis {
    /// Reads JSON as written by `vsf diagnose --json`. Unknown keys are ignored.
    ///
    /// # Errors
    /// [`GapError::Report`] for anything but JSON of this form and schema, and for impossible numbers: a probability or
    /// share outside 0 .. 1, an error below zero, anything beyond 1e16.
    pub fn from_json(text: &str) -> Result<Self, GapError> {
        let report: Self = parse_json(text.as_bytes()).map_err(|e| {
            GapError::Report(format!(
                "no diagnosis, as `vsf diagnose --json` writes it: {e}"
            ))
        })?;
        if report.schema != SCHEMA {
            return Err(GapError::Report(format!(
                "a diagnosis of schema {}; this version reads {SCHEMA}: diagnose anew",
                report.schema
            )));
        }
        report.check()?;
        Ok(report)
    }

    fn check(&self) -> Result<(), GapError> {
        let Self {
            gap,
            location,
            effects,
            verdict,
            ..
        } = self;
        share("verdict.probability", verdict.probability)?;
        share("verdict.hidden", verdict.hidden)?;

        size("gap.test_error_nominal", gap.test_error_nominal)?;
        size("gap.test_error_corrected", gap.test_error_corrected)?;
        size("gap.noise_floor", gap.noise_floor)?;
        let [low, high] = gap.closed_interval;
        closed("gap.closed_fraction", gap.closed_fraction)?;
        closed("gap.closed_interval", low)?;
        within("gap.closed_interval", high, low..=MOST)?;
        for (key, errors) in [("gap.free", gap.free), ("gap.contact", gap.contact)] {
            if let Some(MeanErrors {
                nominal, corrected, ..
            }) = errors
            {
                size(key, nominal)?;
                size(key, corrected)?;
            }
        }
        size("gap.threshold", gap.threshold.unwrap_or(0.0))?;
        size(
            "gap.threshold_nominal",
            gap.threshold_nominal.unwrap_or(0.0),
        )?;

        for (key, parts) in [
            ("where.joint", &location.joint),
            ("where.phase", &location.phase),
            ("where.link", &location.link),
            ("where.sequence", &location.sequence),
            ("where.frequency", &location.frequency),
        ] {
            for part in parts {
                share(key, part.share)?;
                part.interval.iter().try_for_each(|&s| share(key, s))?;
                size(key, part.excess)?;
                if let Place::Frequency(band) = part.of {
                    band.into_iter().try_for_each(|hz| size(key, hz))?;
                }
            }
        }
        for region in &location.region {
            share("where.region", region.share)?;
            within("where.region", region.radius, 0.0..=RestPoints::FARTHEST)?;
            let mut center = region.center.iter();
            center.try_for_each(|&x| {
                within(
                    "where.region",
                    x,
                    -RestPoints::FARTHEST..=RestPoints::FARTHEST,
                )
            })?;
        }

        for effect in effects {
            let key = |of: &str| format!("effect {:?}: {of}", effect.effect);
            share(&key("probability"), effect.probability)?;
            share(&key("absorbed_share"), effect.absorbed_share.unwrap_or(0.0))?;
            closed(
                &key("closed_fraction"),
                effect.closed_fraction.unwrap_or(0.0),
            )?;
            size(&key("test_error"), effect.test_error.unwrap_or(0.0))?;
            let scores = [Some(effect.score), effect.null_score, effect.test_score];
            for score in scores.into_iter().flatten() {
                within(&key("score"), score, -MOST..=MOST)?;
            }
            if let Some(rough) = effect.roughness {
                let parts = [rough.contact, rough.joint, rough.walk];
                parts
                    .into_iter()
                    .try_for_each(|r| size(&key("roughness"), r))?;
            }
            for p in &effect.parameters {
                within(&key(&p.name), p.value, -MOST..=MOST)?;
                size(&key(&p.name), p.sd)?;
            }
            for limit in &effect.shows_from {
                within(&key(&limit.name), limit.value.unwrap_or(0.0), -MOST..=MOST)?;
            }
        }
        Ok(())
    }
}

fn share(key: &str, value: f64) -> Result<(), GapError> {
    within(key, value, SHARE)
}

fn size(key: &str, value: f64) -> Result<(), GapError> {
    within(key, value, 0.0..=MOST)
}

/// Checks the share of a gap that is closed. It is below zero where the gap grows, and may exceed one by noise.
fn closed(key: &str, value: f64) -> Result<(), GapError> {
    within(key, value, -MOST..=MOST)
}

fn within(key: &str, value: f64, range: RangeInclusive<f64>) -> Result<(), GapError> {
    if range.contains(&value) {
        return Ok(());
    }
    // What is allowed for rounding is no part of the range.
    let (from, to) = (range.start().round() + 0.0, range.end().round());
    Err(GapError::Report(format!(
        "a diagnosis in which {key} is {value:?}; it must be in {from:?} .. {to:?}"
    )))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const REPORT: &str = r#"{
        "schema": 1, "dataset": "", "notes": [], "next_experiment": {"action": "", "why": ""},
        "gap": {"test_error_nominal": 2.0, "test_error_corrected": 1.0, "noise_floor": 0.1, "closed_fraction": 0.7,
            "closed_interval": [-0.5, 1.0], "unit": "N m"},
        "where": {"joint": [{"joint": "a", "share": 1.0000000001, "interval": [0.5, 1.0], "excess": 1.5}], "phase": [],
            "link": [], "sequence": [], "region": [{"center": [0.0, 0.0, 0.0], "radius": 0.01, "share": 1.0}],
            "frequency": [{"frequency": [0.5, 1.5], "share": 0.5, "interval": [0.5, 0.5], "excess": 1.5}]},
        "effects": [{"effect": "payload", "probability": 0.9, "score": 120.0,
            "parameters": [{"name": "m", "value": 0.3, "std": 0.01, "unit": "kg"}], "joints": [], "test_error": 1.0,
            "closed_fraction": 0.7, "absorbed_share": 0.25, "roughness": null, "ambiguous_with": [], "testable": true}],
        "verdict": {"effects": ["payload"], "kind": "effects", "probability": 0.9, "effect_set_95": ["payload"]}}"#;

    #[test]
    fn a_report_reads_as_it_is_written() {
        let report = Diagnosis::from_json(REPORT).unwrap();
        let again = Diagnosis::from_json(&serde_json::to_string(&report).unwrap()).unwrap();
        assert_eq!(again, report);
    }

    #[test]
    fn numbers_that_no_diagnosis_has_are_refused() {
        for (from, to, told) in [
            (r#""schema": 1"#, r#""schema": 2"#, "diagnose anew"),
            (
                r#""probability": 0.9, "effect_set"#,
                r#""probability": 1e308, "effect_set"#,
                "verdict.probability is 1e308; it must be in 0.0 .. 1.0",
            ),
            (
                r#""probability": 0.9, "score"#,
                r#""probability": -7, "score"#,
                r#"effect "payload": probability is -7.0"#,
            ),
            (
                r#""test_error_nominal": 2.0"#,
                r#""test_error_nominal": -2.0"#,
                "gap.test_error_nominal",
            ),
            (
                r#""closed_interval": [-0.5"#,
                r#""closed_interval": [-1e300"#,
                "gap.closed_interval",
            ),
            (r#""share": 1.0000000001"#, r#""share": 1.1"#, "where.joint"),
            (r#""radius": 0.01"#, r#""radius": 1e9"#, "where.region"),
            (
                r#""frequency": [0.5"#,
                r#""frequency": [-0.5"#,
                "where.frequency",
            ),
            (
                r#""std": 0.01"#,
                r#""std": 1e300"#,
                r#"effect "payload": m is 1e300"#,
            ),
            (
                r#""value": 0.3"#,
                r#""value": -1e300"#,
                r#"effect "payload": m is -1e300"#,
            ),
            (
                r#""absorbed_share": 0.25"#,
                r#""absorbed_share": 3"#,
                "absorbed_share",
            ),
            (
                r#""closed_interval": [-0.5, 1.0]"#,
                r#""closed_interval": [0.9, 0.5]"#,
                "gap.closed_interval is 0.5",
            ),
            (
                r#""roughness": null"#,
                r#""roughness": {"contact": 1e308, "joint": 0}"#,
                "roughness is 1e308",
            ),
            (r#""notes": [], "#, "", "notes"),
        ] {
            assert!(REPORT.contains(from), "{from}");
            let error = Diagnosis::from_json(&REPORT.replace(from, to)).unwrap_err();
            assert!(error.to_string().contains(told), "{error}");
        }
    }
}
