use vsf::core::bounds;
use vsf::core::nalgebra::Point3;
use vsf::data::{CameraView, Sequence, StiffnessField};
use vsf::pipeline::{Scene, SequencePrediction, StoredEstimate, Trace};
use vsf::plot::{ColorLimit, FieldView, JointTrace, PlotError, TorquePlot};

/// What stands around a field in its picture.
#[derive(Default)]
pub struct Surroundings {
    points_W: Vec<Point3<f64>>,
    colors: Vec<[u8; 3]>,
    robot_W: Vec<Vec<Point3<f64>>>,
}

impl Surroundings {
    /// Adds the surface that a camera saw, every `step`-th pixel of every `step`-th row.
    pub fn camera(mut self, view: &CameraView, near: &[Point3<f64>]) -> Self {
        const STEP: usize = 3;
        const MARGIN: f64 = 0.05;
        if near.is_empty() {
            return self;
        }
        let (lower, upper) = bounds(near);
        let width = view.width as usize;
        for (i, &depth) in view.depth.iter().enumerate().filter(|(_, d)| **d > 0) {
            let (row, column) = (i / width, i % width);
            if row % STEP != 0 || column % STEP != 0 {
                continue;
            }
            let z = f64::from(depth) * view.depth_scale;
            let p_C = Point3::new(
                (column as f64 - view.cx) / view.fx * z,
                (row as f64 - view.cy) / view.fy * z,
                z,
            );
            let p_W = view.X_WC * p_C;
            if (0..3).all(|k| p_W[k] > lower[k] - MARGIN && p_W[k] < upper[k] + MARGIN) {
                self.points_W.push(p_W);
                self.colors.push([
                    view.color[3 * i],
                    view.color[3 * i + 1],
                    view.color[3 * i + 2],
                ]);
            }
        }
        self
    }

    /// Adds the robot at the sample with the most contacts.
    pub fn robot(
        mut self,
        scene: &Scene,
        sequence: &Sequence,
        trace: &Trace,
    ) -> anyhow::Result<Self> {
        let busiest = trace
            .observations
            .iter()
            .enumerate()
            .max_by_key(|(_, o)| o.len());
        let Some((row, _)) = busiest else {
            return Ok(self);
        };
        let mut posture = scene.robot().posture();
        scene
            .robot()
            .update_posture(&sequence.angles[row], &mut posture)?;
        let origin = |link: usize| Point3::from(posture.link_poses()[link].translation.vector);
        let links = scene.robot().links();
        let joints = links.iter().enumerate();
        let joints = joints.filter_map(|(l, link)| Some(vec![origin(link.parent()?), origin(l)]));
        let is_last = |l: usize| links.iter().all(|link| link.parent() != Some(l));
        let tips = scene.link_shapes().iter().filter(|s| is_last(s.link));
        let tips = tips.map(|s| {
            let tip = posture.link_poses()[s.link] * far_end(s.sdf.bounds());
            vec![origin(s.link), tip]
        });
        self.robot_W = joints.chain(tips).collect();
        Ok(self)
    }
}

/// The middle of that side of a box around a shape that is furthest from the origin of its link; the origin where the
/// shape lies around it.
fn far_end((low, high): (Point3<f64>, Point3<f64>)) -> Point3<f64> {
    let middle = vsf::core::nalgebra::center(&low, &high);
    let half = (high - low) / 2.0;
    let reach = |k: &usize| middle[*k].abs() + half[*k];
    let along = (0..3).max_by(|a, b| reach(a).total_cmp(&reach(b)));
    let Some(k) = along.filter(|k| middle[*k].abs() > 0.5 * half[*k]) else {
        return Point3::origin();
    };
    let mut end = middle;
    end[k] += half[k].copysign(middle[k]);
    end
}

/// What a picture of a field shows.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub title: &'a str,
    /// The standard deviation in place of the stiffness.
    pub deviation: bool,
    /// Value at the end of the color bar [N/m].
    pub limit: Option<f64>,
}

/// Draws a field; `draw` chooses the format.
pub fn field<T>(
    field: &StiffnessField,
    around: &Surroundings,
    view: View,
    draw: impl FnOnce(&FieldView) -> Result<T, PlotError>,
) -> anyhow::Result<T> {
    let none = Vec::new();
    let (array, values) = if view.deviation {
        ("K_std", field.sd.as_ref().unwrap_or(&none))
    } else {
        ("K", &field.stiffness)
    };
    if values.is_empty() {
        anyhow::bail!("the field has no standard deviation (K_std)");
    }
    let stored = StoredEstimate::of(field)?;
    draw(&FieldView {
        points_W: &field.points,
        stiffness: values,
        touched: &stored.touched,
        context_W: &around.points_W,
        context_colors: &around.colors,
        robot_W: &around.robot_W,
        title: view.title,
        quantity: if view.deviation {
            "standard deviation"
        } else {
            "stiffness"
        },
        limit: view
            .limit
            .map_or_else(ColorLimit::default, ColorLimit::Value),
        ..FieldView::default()
    })
    .map_err(|e| match &e {
        PlotError::OutOfRange {
            what,
            index,
            value,
            min,
            max,
        } if what == "stiffness" => anyhow::anyhow!(
            "{array} row {index} is {value:?} N/m; pictures show {min:?} to {max:?}"
        ),
        _ => e.into(),
    })
}

/// Draws readings (external torques) against predicted torques of a sequence, with the touched samples shaded.
pub fn torques(
    scene: &Scene,
    trace: &Trace,
    prediction: &SequencePrediction,
    title: &str,
) -> anyhow::Result<String> {
    let column = |rows: &[Vec<f64>], j: usize| rows.iter().map(|r| r[j]).collect::<Vec<_>>();
    let columns: Vec<_> = (0..scene.robot().joint_count())
        .map(|j| {
            let measured: Vec<f64> = trace.observations.iter().map(|o| o.reading()[j]).collect();
            (
                measured,
                column(&prediction.mean, j),
                column(&prediction.sd, j),
            )
        })
        .collect();
    let joints: Vec<JointTrace> = scene
        .robot()
        .joints()
        .iter()
        .enumerate()
        .zip(&columns)
        .map(|((j, joint), (measured, predicted, sigma))| JointTrace {
            name: joint.name(),
            unit: scene.unit(j),
            measured,
            predicted,
            sigma,
            ..JointTrace::default()
        })
        .collect();
    let contact: Vec<bool> = trace.observations.iter().map(|o| !o.is_empty()).collect();
    // Stamps may count from anywhere.
    let start = trace.time.first().copied().unwrap_or(0.0);
    let time: Vec<f64> = trace.time.iter().map(|t| t - start).collect();
    TorquePlot {
        time: &time,
        joints: &joints,
        contact: &contact,
        title,
    }
    .svg()
    .map_err(|e| undrawn(e, &joints))
}

/// That a torque is too large, by its row and joint.
fn undrawn(error: PlotError, joints: &[JointTrace]) -> anyhow::Error {
    if let PlotError::OutOfRange {
        what,
        index,
        value,
        max,
        ..
    } = &error
    {
        for (k, joint) in joints.iter().enumerate() {
            for (array, words) in [
                ("measured", "a reading"),
                ("predicted", "a predicted torque"),
                ("sigma", "a deviation of the predicted torque"),
            ] {
                if *what == format!("joints[{k}].{array}") {
                    let (name, unit) = (joint.name, joint.unit);
                    return anyhow::anyhow!(
                        "row {index} joint {name}: {words} of {value:?} {unit}; plots show at most {max:?}, check the \
                         recording and the field"
                    );
                }
            }
        }
    }
    error.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finger_ends_at_its_tip() {
        let finger = (Point3::new(-0.01, -0.01, 0.0), Point3::new(0.01, 0.01, 0.1));
        assert_eq!(far_end(finger), Point3::new(0.0, 0.0, 0.1));
        let back = (Point3::new(-0.2, 0.0, 0.0), Point3::new(0.0, 0.02, 0.02));
        assert_eq!(far_end(back), Point3::new(-0.2, 0.01, 0.01));
        let ball = (Point3::new(-0.1, -0.1, -0.1), Point3::new(0.1, 0.1, 0.1));
        assert_eq!(far_end(ball), Point3::origin());
    }
}
