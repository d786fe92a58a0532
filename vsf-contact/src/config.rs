use std::ops::RangeInclusive;
use vsf_core::CoreError;

/// Lengths (m) on the scale of what is touched.
const LENGTHS: RangeInclusive<f64> = 1e-9..=1.0;

/// Parameters of the stick-slip contact model of section III-B-a of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactConfig {
    /// Contact threshold delta (m), 1e-9 to 1, default 2 mm (paper). A point comes into contact
    /// when it is closer than this to the surface of a link. It then lies on the surface offset by
    /// this distance (and the padding), and detaches when `u . n < 0` (with adhesion, when it is pulled further than that).
    pub threshold: f64,
    /// Friction coefficient nu_f (1), >= 0, default 0.15 (paper). A point sticks while its
    /// displacement lies in the cone `u . n >= |u| / sqrt(1 + nu_f²)`, that is, its tangential
    /// part is at most `nu_f` times its normal part.
    pub friction: f64,
    /// Slip step lambda_s (m), the length of one slip iteration, 1e-9 to 1, default 0.1 mm (paper).
    /// [`with_slip_step`](Self::with_slip_step) changes it and keeps how far a point may slip.
    pub slip_step: f64,
    /// Maximum number of slip iterations of one point in one step, >= 0, default 200 (2 cm of slip
    /// at the default slip step). The paper does not specify it. A point slips until it is back in the
    /// friction cone, so that the result converges as the sample rate grows. With 1 it slips once per
    /// sample, with 0 it always sticks.
    pub max_slip_iterations: u32,
    /// Offset added to every link's surface (m), at most 1, default 0. A positive value makes the robot
    /// thicker. `threshold + padding` must be > 0.
    pub padding: f64,
    /// How far (m) a point follows a receding link, 0 to 1, default 0. It detaches when it is farther
    /// than this from its rest position. The paper has no adhesion.
    pub adhesion: f64,
    /// Whether a step may use the threads of the current rayon pool, default false. The result is
    /// bit-equal for any number of threads. Contacts are distributed in chunks of 2048.
    pub parallel: bool,
}

impl Default for ContactConfig {
    fn default() -> Self {
        Self {
            threshold: 2e-3,
            friction: 0.15,
            slip_step: 1e-4,
            max_slip_iterations: 200,
            padding: 0.0,
            adhesion: 0.0,
            parallel: false,
        }
    }
}

impl ContactConfig {
    /// Changes the slip step (m) and keeps how far a point may slip in one step.
    ///
    /// [`max_slip_iterations`](Self::max_slip_iterations) is scaled accordingly, rounded up, to at most `u32::MAX`.
    /// A finer step alone would exhaust the iterations sooner and leave points outside the friction cone.
    ///
    /// ```
    /// let fine = vsf_contact::ContactConfig::default().with_slip_step(1e-5);
    /// assert_eq!(fine.max_slip_iterations, 2000);
    /// ```
    #[must_use]
    pub fn with_slip_step(self, slip_step: f64) -> Self {
        // A millionth of an iteration is rounding.
        let iterations = f64::from(self.max_slip_iterations) * (self.slip_step / slip_step);
        Self {
            slip_step,
            max_slip_iterations: (iterations - 1e-6).ceil() as u32,
            ..self
        }
    }

    /// Checks that all fields lie in their documented ranges.
    ///
    /// # Errors
    /// [`CoreError::Parameter`] names the first value out of range.
    pub fn check(&self) -> Result<(), CoreError> {
        let check = |name, value: f64, ok: bool, range| {
            if ok && value.is_finite() {
                Ok(())
            } else {
                Err(CoreError::Parameter { name, value, range })
            }
        };
        check(
            "contact threshold",
            self.threshold,
            LENGTHS.contains(&self.threshold),
            "1e-9 to 1 m",
        )?;
        check(
            "friction coefficient",
            self.friction,
            self.friction >= 0.0,
            ">= 0",
        )?;
        check(
            "slip step",
            self.slip_step,
            LENGTHS.contains(&self.slip_step),
            "1e-9 to 1 m",
        )?;
        check(
            "adhesion",
            self.adhesion,
            (0.0..=1.0).contains(&self.adhesion),
            "0 to 1 m",
        )?;
        check(
            "padding",
            self.padding,
            self.level() > 0.0 && self.padding <= 1.0,
            "threshold + padding > 0 m, at most 1 m",
        )
    }

    /// Distance from a link's surface at which points in contact lie (m): `threshold + padding`.
    pub fn level(&self) -> f64 {
        self.threshold + self.padding
    }
}
