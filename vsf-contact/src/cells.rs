use nalgebra::{Point3, Vector3};
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, CoreError, LinkChains, Posture, RestPoints};

/// Cubes around rest points, each sampled by sub-points. Clones share the sub-points.
#[derive(Debug, Clone)]
pub struct Cells {
    fine: Arc<RestPoints>,
    per_cell: usize,
    count: usize,
}

impl Cells {
    /// Creates cubes of edge `spacing` (m, > 0) around the rest points, with `per_axis` sub-points
    /// along each edge (1 to 8), evenly spaced and symmetric about the rest point.
    ///
    /// # Errors
    /// A parameter out of range, or more sub-points than [`RestPoints`] holds.
    pub fn new(rest: &RestPoints, spacing: f64, per_axis: usize) -> Result<Self, CoreError> {
        if !(spacing > 0.0 && spacing.is_finite()) {
            return Err(CoreError::Parameter {
                name: "cell edge",
                value: spacing,
                range: "> 0 m",
            });
        }
        if !(1..=8).contains(&per_axis) {
            return Err(CoreError::Parameter {
                name: "sub-points per cell edge",
                value: per_axis as f64,
                range: "1 to 8",
            });
        }
        let per_cell = per_axis.pow(3);
        RestPoints::check_count(rest.len().saturating_mul(per_cell))?;
        let offset = |i: usize| spacing * ((i as f64 + 0.5) / per_axis as f64 - 0.5);
        let axis = || 0..per_axis;
        let fine: Vec<Point3<f64>> = rest
            .positions()
            .iter()
            .flat_map(|p| {
                axis().flat_map(move |x| {
                    axis().flat_map(move |y| {
                        axis().map(move |z| p + Vector3::new(offset(x), offset(y), offset(z)))
                    })
                })
            })
            .collect();
        // Name the rest point, which the caller knows.
        let of_point = |error| match error {
            CoreError::TooFar { index, value } => CoreError::TooFar {
                index: index / per_cell,
                value,
            },
            other => other,
        };
        Ok(Self {
            fine: Arc::new(RestPoints::new(fine).map_err(of_point)?),
            per_cell,
            count: rest.len(),
        })
    }
}

/// Contact of cells: every rest point stands for a cube of the object, sampled by sub-points.
///
/// Rest points are often a centimeter apart, and a push is a few centimeters deep. With points alone,
/// contact comes and goes in jumps of whole cells. Here the inner model moves the sub-points, and the
/// displacement of a cube is the mean over its sub-points, so that a partly touched cube counts in
/// part. A cube's stiffness is that of all of its sub-points together.
///
/// The mean displacement acts at the displaced center of the cube, so that moments are off by at most
/// the force times the offset of the sub-points from the center. The link of a cube is that of its most
/// displaced sub-point. The cost is that of the inner model on all sub-points.
#[derive(Debug, Clone)]
pub struct CellContact<C> {
    inner: C,
    cells: Cells,
    contacts: Contacts,
}

impl<C: ContactModel> CellContact<C> {
    /// Creates the contact model of `cells` from a model that moves their sub-points.
    pub fn new(inner: C, cells: Cells) -> Self {
        Self {
            inner,
            cells,
            contacts: Contacts::new(),
        }
    }

    /// The model that moves the sub-points.
    pub fn inner(&self) -> &C {
        &self.inner
    }

    /// The model that moves the sub-points, to change its knowledge of the world.
    pub fn inner_mut(&mut self) -> &mut C {
        &mut self.inner
    }

    /// The contacts of the sub-points in the last step. Their indices count sub-points, grouped by rest point: those of the
    /// first rest point come first.
    pub fn sub_contacts(&self) -> &Contacts {
        &self.contacts
    }

    /// The mean displacement of the sub-points `range` of one cell.
    fn average(&self, range: std::ops::Range<usize>, out: &mut Contacts) -> Result<(), CoreError> {
        let (mut u_W, mut n_W) = (Vector3::zeros(), Vector3::zeros());
        let (mut link, mut most) = (self.contacts.links()[range.start], -1.0);
        for k in range.clone() {
            let u = self.contacts.displacements()[k];
            if u.norm_squared() > most {
                (link, most) = (self.contacts.links()[k], u.norm_squared());
            }
            u_W += u;
            n_W += self.contacts.normals()[k];
        }
        let normal = n_W
            .try_normalize(1e-12)
            .unwrap_or(self.contacts.normals()[range.start]);
        let cell = self.contacts.points()[range.start] as usize / self.cells.per_cell;
        out.push(cell as u32, link, u_W / self.cells.per_cell as f64, normal)
    }
}

impl<C: ContactModel + Clone> ContactModel for CellContact<C> {
    fn reset(&mut self) {
        self.inner.reset();
        self.contacts.clear();
    }

    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        self.inner.check_robot(chains)
    }

    /// `rest` must be the points that the cells were made from. Only their number is checked.
    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        CoreError::check_len("rest points", rest.len(), self.cells.count)?;
        self.inner
            .step(&self.cells.fine, posture, &mut self.contacts)?;
        out.clear();
        let cell = |k: usize| self.contacts.points()[k] as usize / self.cells.per_cell;
        let mut start = 0;
        for k in 1..=self.contacts.len() {
            if k == self.contacts.len() || cell(k) != cell(start) {
                self.average(start..k, out)?;
                start = k;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn points_too_far_are_named_and_not_their_sub_points() {
        let points = [0.0, 0.01, 1e6].map(|x| Point3::new(x, 0.0, 0.0));
        let rest = RestPoints::new(points.to_vec()).unwrap();
        let error = Cells::new(&rest, 0.01, 2).unwrap_err();
        assert!(
            matches!(error, CoreError::TooFar { index: 2, value } if value > 1e6),
            "{error}"
        );
    }

    /// The sub-points would take a hundred GB.
    #[test]
    fn more_sub_points_than_can_be_counted_are_refused_at_once() {
        let points = (0..8_400_000).map(|i| Point3::new(0.01 * f64::from(i), 0.0, 0.0));
        let rest = RestPoints::new(points.collect()).unwrap();
        assert!(matches!(
            Cells::new(&rest, 0.01, 8),
            Err(CoreError::TooMany { .. })
        ));
    }
}
