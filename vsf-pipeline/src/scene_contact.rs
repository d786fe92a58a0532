use vsf_contact::{CellContact, StickSlip};
use vsf_core::{ContactModel, Contacts, CoreError, Posture, RestPoints};

/// The contact model of a [`Scene`](crate::Scene). A clone remembers the same contacts and shares link shapes and
/// sub-points.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum SceneContact {
    /// The rest points alone are moved.
    Points(StickSlip),
    /// Each rest point stands for a cube.
    Cells(CellContact<StickSlip>),
}

impl SceneContact {
    /// Distance from a link's surface at which points in contact rest (m): threshold and padding.
    pub fn level(&self) -> f64 {
        let points = match self {
            Self::Points(points) => points,
            Self::Cells(cells) => cells.inner(),
        };
        points.config().level()
    }
}

impl ContactModel for SceneContact {
    fn reset(&mut self) {
        match self {
            Self::Points(points) => points.reset(),
            Self::Cells(cells) => cells.reset(),
        }
    }

    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        match self {
            Self::Points(points) => points.step(rest, posture, out),
            Self::Cells(cells) => cells.step(rest, posture, out),
        }
    }
}
