use crate::Sdf;
use crate::batch::distances;
use crate::link_pose::LinkPose;
use nalgebra::{Matrix3, Point3};
use std::cell::Cell;
use vsf_core::{Block, RestPoints};

/// A front is rebuilt when its number of watches exceeds twice the initial number by more than this.
const GROWTH: usize = 1024;
/// It is also rebuilt when the link has traveled this far (m), which keeps the sum of its motions accurate.
const FAR: f64 = 10.0;

/// Finds the rest points that come within reach of one link, by conservative advancement.
///
/// Points are watched in blocks, and one by one near the surface. The distance from the surface
/// changes no faster than the link moves (it is 1-Lipschitz up to [`Sdf::slack`]). So every watch
/// knows how far the link must travel before its result may change, and is skipped until then. The
/// result is the same as if every point were checked in every step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Front {
    blocks: Vec<Watch<Block>>,
    points: Vec<Watch<u32>>,
    /// Watches after the set-up.
    at_first: usize,
    /// Upper bound (m) of how far the link has moved since the set-up: in the frame of the link, nothing
    /// within [`NEAR`] radii of its center has moved farther.
    travel: f64,
    last: Option<(Point3<f64>, Matrix3<f64>)>,
}

/// Radii of the link around its center for which turns are counted.
const NEAR: f64 = 2.0;

/// Points that stay within reach, or out of it, while the link has traveled less than `due`.
#[derive(Debug, Clone, Copy)]
struct Watch<T> {
    due: f64,
    what: T,
}

/// What lies within reach of a link: the inside of its surface offset by `level`, in its box.
pub(crate) struct Reach<'a> {
    pub sdf: &'a dyn Sdf,
    pub pose: &'a LinkPose,
    pub level: f64,
    pub slack: f64,
}

/// Whether the points of a ball are within reach, and how far the link may travel (m) before that
/// may change (`credit`). If the credit is not positive, the ball may be partly within reach.
struct Outlook {
    within: bool,
    credit: f64,
}

impl Reach<'_> {
    /// Distance from the surface, if the point is within reach.
    pub fn distance(&self, p_W: &Point3<f64>) -> Option<f64> {
        let p_L = self.pose.to_link(p_W);
        if self.pose.outside(&p_L) > 0.0 {
            return None;
        }
        let distance = self.sdf.distance(&p_L);
        (distance < self.level).then_some(distance)
    }

    fn outlook(&self, center_W: &Point3<f64>, radius: f64) -> Outlook {
        match self.look(center_W, radius) {
            Look::Far(outlook) => outlook,
            Look::Near(p_L, near) => self.near_outlook(&near, self.sdf.distance(&p_L)),
        }
    }

    /// What is known of a ball without its distance from the surface.
    fn look(&self, center_W: &Point3<f64>, radius: f64) -> Look {
        let arm = (center_W - self.pose.center_W).norm();
        // Distances are rounded.
        let unsure = radius + 1e-13 * (self.pose.scale + arm);
        // Far away the ball around the link is good enough; its turns move nothing.
        let apart = arm - self.pose.radius - unsure;
        if apart > 0.25 * NEAR * self.pose.radius {
            return Look::Far(Outlook {
                within: false,
                credit: apart,
            });
        }
        let p_L = self.pose.to_link(center_W);
        let near = Near {
            outside: self.pose.outside(&p_L),
            unsure,
            stays_near: NEAR * self.pose.radius - arm - unsure,
        };
        Look::Near(p_L, near)
    }

    fn near_outlook(&self, near: &Near, distance: f64) -> Outlook {
        let excess = (distance - self.level).max(near.outside);
        Outlook {
            within: excess < 0.0,
            credit: (excess.abs() - self.slack - near.unsure).min(near.stays_near),
        }
    }
}

/// A ball seen from a link: so far away that its distance from the surface does not matter, or
/// where its center is in the link's frame.
enum Look {
    Far(Outlook),
    Near(Point3<f64>, Near),
}

/// A ball near a link.
#[derive(Clone, Copy)]
struct Near {
    /// How far its center is outside of the link's box.
    outside: f64,
    /// Its radius and the rounding of distances.
    unsure: f64,
    /// How far the link may travel until the ball may be further away than [`NEAR`].
    stays_near: f64,
}

impl Front {
    /// Forgets all points.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.points.clear();
        self.last = None;
    }

    /// Takes the link's new pose and visits all points within reach that may not have been so at the
    /// previous pose, and some that were. After [`Front::clear`] it visits all points within reach.
    /// Points in `skip` that are watched singly are left for a later step in which they are not skipped.
    pub fn advance(
        &mut self,
        reach: &Reach,
        rest: &RestPoints,
        skip: impl Fn(u32) -> bool,
        mut visit: impl FnMut(u32),
    ) {
        let pose = reach.pose;
        let Some((center_W, R_WL)) = self.last.replace((pose.center_W, pose.R_WL)) else {
            return self.set_up(reach, rest, visit);
        };
        // Of a difference of rotations, both singular values that are not zero are the chord.
        let chord = (pose.R_WL - R_WL).norm() / 2f64.sqrt();
        self.travel += (pose.center_W - center_W).norm() + NEAR * pose.radius * chord;
        let travel = self.travel;
        Watch::renew(&mut self.points, travel, reach, rest, skip, &mut visit);
        // Backward, so that the blocks that are added behind are not met.
        for i in (0..self.blocks.len()).rev() {
            if self.blocks[i].is_due(travel) {
                let block = self.blocks.swap_remove(i).what;
                self.watch(&block, reach, rest, &mut visit);
            }
        }
        if self.watches() > 2 * self.at_first + GROWTH || travel > FAR {
            self.set_up(reach, rest, |_| ());
        }
    }

    fn watches(&self) -> usize {
        self.blocks.len() + self.points.len()
    }

    fn set_up(&mut self, reach: &Reach, rest: &RestPoints, mut visit: impl FnMut(u32)) {
        self.blocks.clear();
        self.points.clear();
        self.travel = 0.0;
        self.watch(&rest.root(), reach, rest, &mut visit);
        self.watch_points(rest.strays(), reach, rest, &mut visit);
        self.at_first = self.watches();
    }

    /// Watches a block, or its parts when the surface may pass through it.
    fn watch(
        &mut self,
        block: &Block,
        reach: &Reach,
        rest: &RestPoints,
        visit: &mut impl FnMut(u32),
    ) {
        let (center_W, radius) = rest.ball(block);
        let outlook = reach.outlook(&center_W, radius);
        if outlook.credit > 0.0 {
            if outlook.within {
                rest.block_points(block, |points| points.iter().for_each(|&p| visit(p)));
            }
            let watch = Watch::new(*block, &outlook, self.travel);
            self.blocks.push(watch);
        } else if block.is_cell() {
            rest.block_points(block, |points| {
                self.watch_points(points, reach, rest, visit);
            });
        } else {
            for child in rest.children(block) {
                self.watch(&child, reach, rest, visit);
            }
        }
    }

    fn watch_points(
        &mut self,
        points: &[u32],
        reach: &Reach,
        rest: &RestPoints,
        visit: &mut impl FnMut(u32),
    ) {
        let old = self.points.len();
        let due = f64::NEG_INFINITY;
        self.points
            .extend(points.iter().map(|&what| Watch { due, what }));
        let new = &mut self.points[old..];
        Watch::renew(new, self.travel, reach, rest, |_| false, visit);
    }
}

impl Watch<u32> {
    /// Looks at the points that are due, and visits those within reach.
    fn renew(
        watches: &mut [Self],
        travel: f64,
        reach: &Reach,
        rest: &RestPoints,
        skip: impl Fn(u32) -> bool,
        mut visit: impl FnMut(u32),
    ) {
        let watches = Cell::from_mut(watches).as_slice_of_cells();
        let due = (watches.iter()).filter(|w| w.get().is_due(travel) && !skip(w.get().what));
        let near = due.filter_map(|watch| {
            let point = watch.get().what;
            match reach.look(&rest.positions()[point as usize], 0.0) {
                Look::Near(p_L, near) => Some(((watch, near), p_L)),
                Look::Far(outlook) => {
                    watch.set(Self::new(point, &outlook, travel));
                    None
                }
            }
        });
        distances(reach.sdf, near, |(watch, near), distance| {
            let point = watch.get().what;
            let outlook = reach.near_outlook(&near, distance);
            watch.set(Self::new(point, &outlook, travel));
            if outlook.within {
                visit(point);
            }
        });
    }
}

impl<T> Watch<T> {
    fn new(what: T, outlook: &Outlook, travel: f64) -> Self {
        Self {
            due: travel + outlook.credit * (1.0 - 1e-9),
            what,
        }
    }

    /// Also when the numbers are not finite.
    fn is_due(&self, travel: f64) -> bool {
        let holds = travel < self.due;
        !holds
    }
}
