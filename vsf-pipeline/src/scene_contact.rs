use vsf_contact::{CellContact, LinkSdf, StickSlip, thickness};
use vsf_core::{ContactModel, Contacts, CoreError, LinkChains, Posture, RestPoints};

/// A touch that begins may be at least so deep in a link (m): the arm moves on from sample to sample.
const LEAST_DEEP: f64 = 2e-3;

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
    fn points(&self) -> &StickSlip {
        match self {
            Self::Points(points) => points,
            Self::Cells(cells) => cells.inner(),
        }
    }

    /// Distance from a link's surface at which points in contact rest (m): threshold and padding.
    pub fn level(&self) -> f64 {
        self.points().config().level()
    }

    /// What was moved in the last step, whose `contacts` are these: they themselves, or the contacts of sub-points, whose
    /// displacements in and around a small tip cancel each other in the mean of a cell.
    pub fn moved<'a>(&'a self, contacts: &'a Contacts) -> &'a Contacts {
        match self {
            Self::Points(_) => contacts,
            Self::Cells(cells) => cells.sub_contacts(),
        }
    }

    /// How far a link may displace what it [moves](Self::moved) where a touch begins (m), link by link of the robot: with the arm
    /// deeper inside of the object, the beginning was not seen. Beyond the [`level`](Self::level) that is the `spacing` of the points, or half
    /// of what the link is [thick](thickness), 2 mm at least: no point comes deeper than that into a thin one.
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
