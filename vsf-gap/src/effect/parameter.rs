use super::Site;
use crate::GapError;

/// Whether the prediction depends on a parameter from zero on, or only gives an effect its form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Zero means no effect.
    Amplitude,
    /// A time constant, a range, a threshold: without meaning while all amplitudes are zero.
    Shape,
}

/// One parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name, unique within the effect, such as `c_4`: joints count from 1.
    pub name: String,
    /// SI unit, `1` for ratios.
    pub unit: &'static str,
    /// The joint it belongs to, from 0.
    pub joint: Option<usize>,
    /// Index of the sequence it speaks of alone, among [`Site::sequences`].
    pub sequence: Option<usize>,
    /// Amplitude or shape.
    pub role: Role,
    /// Smallest and largest value that is physically plausible. The range of an amplitude holds 0, and
    /// some of what is above it.
    pub bounds: [f64; 2],
    /// A typical size, small against the change over which the prediction bends: differences are taken over it
    /// while effects are screened and over half of it afterward, starting values are some of it apart, and what is
    /// far beyond (5 of an amplitude while effects are screened, 50 of the others) is thought unlikely. Of a
    /// frequency, the change that puts the wave out of step by a small part of a turn over the recording.
    pub scale: f64,
    /// Whether it is the share by which a joint's torques of the field are scaled; an effect has one for every joint, above
    /// -1, or none. Such shares, the same for all joints, are a scale of the stiffness, which no recording tells from it:
    /// of them, what joints differ by is sought, and told relative to the joint that most others agree with.
    pub scales_field: bool,
    /// Whether what it stands for ends at its lower bound, as friction does at none: a value there is as good as any, and no
    /// sign that something else acts.
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

    /// The same parameter as one of joint `j`, from 0.
    #[must_use]
    pub fn of_joint(self, j: usize) -> Self {
        Self {
            joint: Some(j),
            ..self
        }
    }

    /// The same parameter as one that scales a joint's torques of the field ([`Parameter::scales_field`]).
    #[must_use]
    pub fn of_field(self) -> Self {
        Self {
            scales_field: true,
            ..self
        }
    }

    /// The same parameter as one that ends at its lower bound ([`Parameter::ends_low`]).
    #[must_use]
    pub fn ending_low(self) -> Self {
        Self {
            ends_low: true,
            ..self
        }
    }

    /// The same parameter as one of sequence `s` of the site alone, from 0.
    #[must_use]
    pub fn of_sequence(self, s: usize) -> Self {
        Self {
            sequence: Some(s),
            ..self
        }
    }
}

/// One amplitude per joint, named `<prefix>_<joint from 1>`, with the unit that `unit` gives each. Bounds and scale are those of a rotating joint.
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
