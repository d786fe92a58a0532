use vsf_contact::{CellContact, LinkSdf, StickSlip, thickness};
use vsf_core::{ContactModel, Contacts, CoreError, LinkChains, Posture, RestPoints};

/// A touch that begins may be at least so deep in a link (m): the arm moves on from sample to sample.
const LEAST_DEEP: f64 = 2e-3;

/// The contact model of a [`Scene`](crate::Scene). A clone has the same contacts, and shares link shapes
/// and sub-points.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum SceneContact {
    /// Contact moves only the rest points.
    Points(StickSlip),
    /// Each rest point stands for a cube of sub-points.
    Cells(CellContact<StickSlip>),
}

impl SceneContact {
    fn points(&self) -> &StickSlip {
        match self {
            Self::Points(points) => points,
            Self::Cells(cells) => cells.inner(),
        }
    }

    /// Distance from a link's surface at which points in contact rest (m): threshold plus padding.
    pub fn level(&self) -> f64 {
        self.points().config().level()
    }

    /// What was moved in the last step, which gave `contacts`: these contacts themselves, or those of the
    /// sub-points. Judge depth by these: around a small tip, displacements of sub-points cancel
    /// in the mean of a cell, so that the contacts of cells look too shallow.
    pub fn moved<'a>(&'a self, contacts: &'a Contacts) -> &'a Contacts {
        match self {
            Self::Points(_) => contacts,
            Self::Cells(cells) => cells.sub_contacts(),
        }
    }

    /// Largest displacement (m) of [moved](Self::moved) points by each link of the robot where a touch
    /// begins. If it is larger, the arm is deeper inside of the object, and the beginning of the touch was
    /// not seen.
    ///
    /// It is the [`level`](Self::level) plus the `spacing` of the points, or plus half of how
    /// [thick](thickness) the link is (2 mm at least), whichever is less: no point gets deeper than that
    /// into a thin link.
    pub fn deepest_starts(&self, spacing: f64) -> Vec<f64> {
        let mut deepest = Vec::new();
        for LinkSdf { link, sdf } in self.points().links() {
            let own = spacing.min((0.5 * thickness(&**sdf)).max(LEAST_DEEP));
            deepest.resize(deepest.len().max(link + 1), self.level() + spacing);
            deepest[*link] = self.level() + own;
        }
        deepest
    }
}

impl ContactModel for SceneContact {
    fn reset(&mut self) {
        match self {
            Self::Points(points) => points.reset(),
            Self::Cells(cells) => cells.reset(),
        }
    }

    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        self.points().check_robot(chains)
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
