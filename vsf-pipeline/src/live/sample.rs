use serde::{Deserialize, Serialize};

/// Largest joint position, torque and velocity that is taken, beyond any robot.
const MOST: [f64; 3] = [1e6, 1e12, 1e6];
/// So many letters before what is wrong are told.
const EXCERPT: usize = 20;
/// Latest time that is taken (s): stamps in milliseconds or less since 1970 are later.
const LATEST: f64 = 1e11;

/// One sample of a stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Time \[s\], of any clock.
    pub t: f64,
    /// Joint positions \[rad or m\].
    pub q: Vec<f64>,
    /// Joint torques \[N m or N\]: of the environment on the robot, or at the actuators, whichever the
    /// [`Learner`](super::Learner) expects.
    pub tau: Vec<f64>,
    /// Joint velocities \[rad/s or m/s\]. If they are not given, a [`Learner`](super::Learner) that uses
    /// velocities estimates them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub qd: Option<Vec<f64>>,
    /// Number of the touch, 0 if not given. Contacts are forgotten where it changes. (A mark on the first
    /// sample of a touch alone could be lost with it.)
    #[serde(default)]
    pub touch: u64,
    /// Number of the sequence, 0 if not given. Where it increases, the clock may be another one, and
    /// sensors are tared anew.
    #[serde(default)]
    pub sequence: u64,
}

impl Sample {
    /// Parses a line.
    ///
    /// # Errors
    /// A description of the problem: invalid JSON, a key that is missing, unknown or repeated, another
    /// number of joints, or a number that is not finite or beyond any robot.
    pub fn parse(line: &[u8], joints: usize) -> Result<Self, String> {
        if line.trim_ascii_start().first() != Some(&b'{') {
            return Err(
                "no sample in JSON: not an object, {\"t\": .., \"q\": [..], \"tau\": [..]}"
                    .to_owned(),
            );
        }
        let sample: Self = serde_json::from_slice(line).map_err(|e| {
            let text = e.to_string();
            let what = text.split(" at line ").next().unwrap_or_default();
            // Columns count bytes, from 1.
            let end = e.column().min(line.len());
            let near = String::from_utf8_lossy(&line[end.saturating_sub(EXCERPT)..end]);
            format!(
                "no sample in JSON: {what} (column {}, after {near:?})",
                e.column()
            )
        })?;
        if sample.t.abs() > LATEST {
            let t = sample.t;
            return Err(format!(
                "t is {t:?}, beyond {LATEST:e}; times are in seconds"
            ));
        }
        let rows = [("q", &sample.q), ("tau", &sample.tau)].into_iter();
        let rows = rows.chain(sample.qd.iter().map(|qd| ("qd", qd)));
        for ((name, values), most) in rows.zip(MOST) {
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
