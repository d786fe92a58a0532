use crate::{JOINTS, points};
use std::sync::{Arc, LazyLock};
use vsf::contact::{CellContact, Cells, ContactConfig, StickSlip, link_sdfs};
use vsf::core::RestPoints;
use vsf::pipeline::SceneContact;
use vsf::robots::{RobotModel, planar_arm};

/// An arm and the points that it touches.
pub struct World {
    /// The arm.
    pub robot: RobotModel,
    /// The points.
    pub rest: Arc<RestPoints>,
    contact: StickSlip,
    cells: Cells,
}

/// The world that sessions run in.
pub static WORLD: LazyLock<World> = LazyLock::new(|| {
    let robot = planar_arm(JOINTS, 0.3, 0.03).expect("an arm");
    let links = link_sdfs(robot.colliders(), &Default::default()).expect("capsules");
    let rest = RestPoints::new(points()).expect("points");
    World {
        contact: StickSlip::new(links.links, ContactConfig::default()).expect("contact"),
        cells: Cells::new(&rest, 0.03, 2).expect("cells"),
        rest: Arc::new(rest),
        robot,
    }
});

impl World {
    /// Contact of points or of cells, before the first touch.
    pub fn contact(&self, of_cells: bool) -> SceneContact {
        let points = self.contact.clone();
        if of_cells {
            SceneContact::Cells(CellContact::new(points, self.cells.clone()))
        } else {
            SceneContact::Points(points)
        }
    }
}
