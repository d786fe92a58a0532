use crate::{CoreError, LinkChains, Posture, RestPoints};
use dyn_clone::DynClone;
use nalgebra::Vector3;

/// The touched points at one time step, in order of the point index: the set `S` and the
/// displacements `u_i` of section III-B. Buffers are reused between steps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Contacts {
    points: Vec<u32>,
    links: Vec<u32>,
    displacements: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
}

impl Contacts {
    /// Creates an empty set of contacts.
    pub fn new() -> Self {
        Self::default()
    }

    /// Removes all contacts and keeps the allocated memory.
    pub fn clear(&mut self) {
        self.points.clear();
        self.links.clear();
        self.displacements.clear();
        self.normals.clear();
    }

    /// Adds the contact of a point with the link that moves it.
    ///
    /// `u_W` is the displacement of the point from rest (m), `n_W` the outward unit normal of the link at the
    /// contact.
    ///
    /// # Errors
    /// A point index that is not larger than the previous one, or a displacement or normal that is not finite.
    pub fn push(
        &mut self,
        point: u32,
        link: u32,
        u_W: Vector3<f64>,
        n_W: Vector3<f64>,
    ) -> Result<(), CoreError> {
        if let Some(&previous) = self.points.last()
            && point <= previous
        {
            return Err(CoreError::Unordered {
                previous: previous as usize,
                index: point as usize,
            });
        }
        if !(u_W.norm_squared() + n_W.norm_squared()).is_finite() {
            let (what, vector) = if u_W.norm_squared().is_finite() {
                ("contact normal of point", n_W)
            } else {
                ("contact displacement of point", u_W)
            };
            return Err(CoreError::NotFinite {
                what,
                index: point as usize,
                value: vector.norm(),
            });
        }
        self.points.push(point);
        self.links.push(link);
        self.displacements.push(u_W);
        self.normals.push(n_W);
        Ok(())
    }

    /// Checks that every touched point exists in `rest` and every touching link in `posture`.
    ///
    /// # Errors
    /// [`CoreError::OutOfRange`] names a point or link that does not exist.
    pub fn check_fits(&self, rest: &RestPoints, posture: &Posture) -> Result<(), CoreError> {
        let within = |what, index: Option<&u32>, len| match index.map(|i| *i as usize) {
            Some(index) if index >= len => Err(CoreError::OutOfRange { what, index, len }),
            _ => Ok(()),
        };
        // Points increase.
        within("touched point", self.points.last(), rest.len())?;
        let links = posture.link_poses().len();
        within("touching link", self.links.iter().max(), links)
    }

    /// Number of contacts, `|S|`.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True when nothing is touched.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Indices of the touched points, strictly increasing.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// For each contact, the index of the link that touches the point.
    pub fn links(&self) -> &[u32] {
        &self.links
    }

    /// Displacements from rest `u_i` (m), world frame.
    pub fn displacements(&self) -> &[Vector3<f64>] {
        &self.displacements
    }

    /// Outward unit normals of the touching surface, world frame.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }
}

/// Determines which points a robot in a given posture touches, and how far it displaces them.
///
/// A model is stateful: it remembers sticking points from step to step. It never reads the belief
/// (the paper's decoupling, section III-B), so contacts can be recorded once and replayed through
/// any estimator.
///
/// Models are [`Clone`]. `Box<dyn ContactModel>` is itself a model and can be cloned.
pub trait ContactModel: DynClone + Send + Sync {
    /// Forgets all contacts, to start a new touch sequence.
    fn reset(&mut self);

    /// Checks that the model fits the robot with these chains, for example that the links of its shapes exist.
    ///
    /// [`Session::new`](crate::Session::new) calls this once. The default accepts every robot.
    ///
    /// # Errors
    /// The model does not fit the robot; the error says why.
    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        let _ = chains;
        Ok(())
    }

    /// Moves the robot to `posture` and writes the contacts into `out`, which is cleared first.
    ///
    /// Contacts refer to points of `rest` and links of `posture`. Normals have unit length.
    ///
    /// # Errors
    /// A posture that does not fit the model, was never written or is not finite ([`Posture::check`]). The contact
    /// state is then unchanged.
    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError>;
}

dyn_clone::clone_trait_object!(ContactModel);

impl std::fmt::Debug for dyn ContactModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ContactModel").finish_non_exhaustive()
    }
}

impl<C: ContactModel + ?Sized> ContactModel for Box<C>
where
    Self: Clone,
{
    fn reset(&mut self) {
        (**self).reset();
    }
    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        (**self).check_robot(chains)
    }
    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        (**self).step(rest, posture, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_finite_is_named() {
        let (zero, nan) = (Vector3::zeros(), Vector3::new(f64::NAN, 0.0, 0.0));
        for (u_W, n_W, says) in [
            (nan, zero, "displacement of point[3]"),
            (zero, nan, "normal of point[3]"),
        ] {
            let error = Contacts::new()
                .push(3, 0, u_W, n_W)
                .unwrap_err()
                .to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
