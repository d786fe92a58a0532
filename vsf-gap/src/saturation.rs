//! Saturated sensors, which no effect represents.

use crate::notes::number;
use crate::{Campaign, GapError, Model};
use vsf_data::TorqueKind;
use vsf_pipeline::{Saturation, Trace, reading_unit, saturated_joints};

impl Campaign {
    /// Sensors that read no more from a level on, judged by the nominal contact. Empty for readings of the actuators, in
    /// which weight dominates.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn saturated(&self) -> Result<Vec<Saturation>, GapError> {
        if self.site.torque_kind == TorqueKind::Measured || self.site.rest.is_empty() {
            return Ok(Vec::new());
        }
        let corrected = self.corrected(&Model::default())?;
        let traces: Vec<Trace> = corrected.into_iter().map(|c| c.trace).collect();
        Ok(saturated_joints(&traces))
    }

    /// Note about a saturated sensor.
    pub(crate) fn of_saturation(&self, found: &Saturation) -> String {
        let joint = &self.site.robot.joints()[found.joint];
        format!(
            "{} readings of {} stay at {} {}, the end of their range, while the touch goes on to change: its sensor looks \
             saturated, which no effect stands for; touch less hard, or leave these readings out",
            found.count,
            joint.name(),
            number(found.level),
            reading_unit(joint)
        )
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A ball comes down on points twice; its first axis reads so much too much, whatever it touches.
    fn pressed(bias: f64) -> Campaign {
        let sequence = |x: f64| -> Vec<_> {
            let row = |k: i32| {
                let height = 0.004 - 0.007 * (1.0 - f64::from(100 - k).abs() / 100.0);
                let noise = 0.01 * f64::from(k * k % 13 - 6) / 6.0;
                let force = [noise + bias, noise, (-800.0 * height).max(0.0) + noise];
                [[x, 0.004, height], force]
            };
            (0..200).map(row).collect()
        };
        Campaign::of_stage(&[sequence(0.004), sequence(0.0)])
    }

    /// An axis that feels little stays at its bias.
    #[test]
    fn biases_are_no_ends_of_a_range() {
        for bias in [0.0, 0.3, -3.0] {
            assert_eq!(pressed(bias).saturated().unwrap(), [], "{bias}");
        }
    }

    #[test]
    fn the_note_names_joint_and_level() {
        let found = Saturation {
            joint: 2,
            level: 1.25,
            count: 40,
            trace: 0,
            row: 7,
        };
        let text = pressed(0.0).of_saturation(&found);
        assert!(
            text.starts_with("40 readings of stage_z stay at 1.250 N, the end"),
            "{text}"
        );
    }
}
