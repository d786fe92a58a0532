use super::Site;
use crate::GapError;

/// Whether a parameter changes the prediction by itself, or only gives an effect its form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Zero means no effect.
    Amplitude,
    /// A time constant, a range or a threshold. It has no influence while all amplitudes are zero.
    Shape,
}

/// One parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name, unique within the effect, such as `c_4`: joints count from 1.
    pub name: String,
    /// SI unit, `1` for ratios.
    pub unit: &'static str,
    /// The joint it belongs to, counted from 0.
    pub joint: Option<usize>,
    /// Index in [`Site::sequences`] of the only sequence that it applies to.
    pub sequence: Option<usize>,
    /// Amplitude or shape.
    pub role: Role,
    /// Smallest and largest physically plausible value. The range of an amplitude contains 0 and some positive values.
    pub bounds: [f64; 2],
    /// A typical size, small compared with the change over which the prediction becomes nonlinear.
    ///
    /// It is the step of finite differences in screening (half of it afterward). Starting values are a few scales apart.
    /// It also bounds the deviation of the prior: at most 5 scales for amplitudes (in screening, and for effects on contact in
    /// the fit, too), at most 50 scales or a quarter of the range for shapes. For a
    /// frequency, it is the change that shifts the phase by a small part of a turn over the recording.
    pub scale: f64,
    /// Whether the parameter is the share by which the field's torques at a joint are scaled.
    ///
    /// An effect has one such share for every joint, above -1, or none. If the share is the same for all joints, it is a
    /// scale of the stiffness, from which no recording can tell it. Only the differences between joints are therefore
    /// fitted, and they are reported relative to the joint that most others agree with.
    pub scales_field: bool,
    /// Whether the quantity physically ends at its lower bound, as friction does at zero.
    ///
    /// A value at that bound is then as good as any other, and no sign that something else acts.
    pub ends_low: bool,
}

impl Parameter {
    /// An amplitude.
    pub fn amplitude(
        name: impl Into<String>,
        unit: &'static str,
        bounds: [f64; 2],
        scale: f64,
    ) -> Self {
        Self {
            name: name.into(),
            unit,
            joint: None,
            sequence: None,
            role: Role::Amplitude,
            bounds,
            scale,
            scales_field: false,
            ends_low: false,
        }
    }

    /// A shape parameter.
    pub fn shape(
        name: impl Into<String>,
        unit: &'static str,
        bounds: [f64; 2],
        scale: f64,
    ) -> Self {
        Self {
            role: Role::Shape,
            ..Self::amplitude(name, unit, bounds, scale)
        }
    }

    /// This parameter as one of joint `j`, counted from 0.
    #[must_use]
    pub fn of_joint(self, j: usize) -> Self {
        Self {
            joint: Some(j),
            ..self
        }
    }

    /// This parameter as one that scales the field's torques at a joint ([`Parameter::scales_field`]).
    #[must_use]
    pub fn of_field(self) -> Self {
        Self {
            scales_field: true,
            ..self
        }
    }

    /// This parameter as one that ends at its lower bound ([`Parameter::ends_low`]).
    #[must_use]
    pub fn ending_low(self) -> Self {
        Self {
            ends_low: true,
            ..self
        }
    }

    /// This parameter as one of sequence `s` of the site alone, counted from 0.
    #[must_use]
    pub fn of_sequence(self, s: usize) -> Self {
        Self {
            sequence: Some(s),
            ..self
        }
    }
}

/// One amplitude per joint, named `<prefix>_<joint from 1>`. `unit` gives the unit of each; bounds and scale are those of a
/// rotating joint.
pub(crate) fn per_joint(
    site: &Site,
    prefix: &str,
    unit: impl Fn(usize) -> &'static str,
    bounds: [f64; 2],
    scale: f64,
) -> Vec<Parameter> {
    (0..site.joints())
        .map(|j| {
            Parameter::amplitude(format!("{prefix}_{}", j + 1), unit(j), bounds, scale).of_joint(j)
        })
        .collect()
}

/// Checks the number of parameters.
pub(crate) fn check(name: &str, theta: &[f64], expected: usize) -> Result<(), GapError> {
    if theta.len() != expected {
        return Err(GapError::Parameters {
            effect: name.to_owned(),
            got: theta.len(),
            expected,
        });
    }
    match theta.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(GapError::NotFinite {
            effect: name.to_owned(),
            index: i,
            value: theta[i],
        }),
        None => Ok(()),
    }
}
