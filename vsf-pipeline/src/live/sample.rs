use serde::{Deserialize, Serialize};

/// Largest joint position and torque that is taken, beyond any robot.
const MOST: [f64; 2] = [1e6, 1e12];

/// One sample of the stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Time \[s\], of any clock.
    pub t: f64,
    /// Joint positions \[rad or m\].
    pub q: Vec<f64>,
    /// Torques of the environment on the robot, gravity removed \[N m or N\].
    pub tau: Vec<f64>,
    /// Number of the touch, 0 if not given: where it changes contacts are forgotten. A mark on the
    /// first sample of a touch alone could be lost with it.
    #[serde(default)]
    pub touch: u64,
}

impl Sample {
    /// Reads a line.
    ///
    /// # Errors
    /// In words: what is no JSON, a key that is missing, unknown or there twice, another number of
    /// joints, a number that is not finite or beyond any robot.
    pub fn parse(line: &[u8], joints: usize) -> Result<Self, String> {
        let sample: Self = serde_json::from_slice(line).map_err(|e| {
            let text = e.to_string();
            let what = text.split(" at line ").next().unwrap_or_default();
            format!("{what} (column {})", e.column())
        })?;
        for ((name, values), most) in [("q", &sample.q), ("tau", &sample.tau)].iter().zip(MOST) {
            if values.len() != joints {
                let got = values.len();
                return Err(format!(
                    "{name} has {got} numbers, the robot has {joints} joints"
                ));
            }
            if let Some(k) = values.iter().position(|v| v.abs() > most) {
                let value = values[k];
                return Err(format!(
                    "{name}[{k}] is {value:?}, beyond {most:e}; check units"
                ));
            }
        }
        Ok(sample)
    }
}
