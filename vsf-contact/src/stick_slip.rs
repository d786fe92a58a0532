use crate::{ContactConfig, LinkSdf, Sdf};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, CoreError, Posture, RestPoints};

/// Points per task when a step runs on several threads.
const CHUNK: usize = 512;
/// Newton corrections of a projection to the surface, and when it is close enough [m].
const PROJECTION_STEPS: usize = 4;
const PROJECTION_TOLERANCE: f64 = 1e-6;

/// Stick-slip contact of a robot's links with independent points (section III-B-a).
///
/// One step, for links in a new posture:
///
/// 1. *Stick*: a point in contact is carried along by its link.
/// 2. *Detach*: it goes back to rest when `u . n < 0`, `n` the outward normal at its place.
/// 3. *Slip*: outside the friction cone it moves by `slip_step` against the tangential part of
///    `u` and back to the surface, again and again until it sticks, detaches or has used up
///    [`ContactConfig::max_slip_iterations`]. A last step is shortened so as not to pass the
///    point of no tangential part.
/// 4. *Hand-over*: a point that is inside another link by more than one `slip_step` is pushed out
///    by that link and owned by it from then on.
/// 5. *Touch*: a point at rest that is closer than `threshold` to a link is moved along the
///    normal to the surface offset by `threshold` (plus padding); the link it is deepest in owns
///    it. The displacement starts at zero, so that refining the time step converges.
///
/// A point that a link leaves and meets again begins anew at step 5. Points are independent:
/// results do not depend on threads or on the order of points.
///
/// Cost of a step: `O(|S| + points near links)`; points elsewhere are never looked at. Memory:
/// one bit per point and 56 bytes per contact.
#[derive(Clone)]
pub struct StickSlip {
    links: Arc<[LinkSdf]>,
    config: ContactConfig,
    active: Vec<Active>,
    merged: Vec<Active>,
    touched: Vec<u64>,
    entering: Vec<Vec<Entering>>,
    poses: Vec<LinkPose>,
}

/// A point in contact: its place on the link that carries it, in the frame of that link.
#[derive(Debug, Clone, Copy)]
struct Active {
    point: u32,
    slot: u32,
    anchor_L: Point3<f64>,
    normal_L: Vector3<f64>,
}

/// A point at rest found within reach of a link.
#[derive(Debug, Clone, Copy)]
struct Entering {
    point: u32,
    slot: u32,
    distance: f64,
}

/// Pose of a link's shape and the ball around it.
#[derive(Debug, Clone, Copy)]
struct LinkPose {
    X_WL: Isometry3<f64>,
    center_W: Point3<f64>,
    radius: f64,
}

impl StickSlip {
    /// A contact model of a robot with the given link shapes.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn new(links: impl Into<Arc<[LinkSdf]>>, config: ContactConfig) -> Result<Self, CoreError> {
        config.validate()?;
        let links = links.into();
        Ok(Self {
            entering: vec![Vec::new(); links.len()],
            poses: Vec::with_capacity(links.len()),
            links,
            config,
            active: Vec::new(),
            merged: Vec::new(),
            touched: Vec::new(),
        })
    }

    /// The parameters.
    pub fn config(&self) -> &ContactConfig {
        &self.config
    }

    fn place_links(&mut self, posture: &Posture) -> Result<(), CoreError> {
        posture.check_finite()?;
        let poses = posture.link_poses();
        if let Some(l) = self.links.iter().find(|l| l.link >= poses.len()) {
            return Err(CoreError::OutOfRange {
                what: "link",
                index: l.link,
                len: poses.len(),
            });
        }
        self.poses.clear();
        self.poses.extend(self.links.iter().map(|l| {
            let (lo, hi) = l.sdf.bounds();
            let X_WL = poses[l.link];
            let center_W = X_WL * nalgebra::center(&lo, &hi);
            LinkPose {
                X_WL,
                center_W,
                radius: 0.5 * (hi - lo).norm(),
            }
        }));
        Ok(())
    }

    /// Steps 1-4 for one point; false when it has detached.
    fn carry(&self, a: &mut Active, p_W: &Point3<f64>) -> bool {
        if !self.slide(a, p_W) {
            return false;
        }
        match self.intruder(a) {
            None => true,
            Some(slot) => {
                let X_WL = &self.poses[slot].X_WL;
                let now_W = self.poses[a.slot as usize].X_WL * a.anchor_L;
                a.slot = slot as u32;
                a.anchor_L = X_WL.inverse_transform_point(&now_W);
                self.project(a);
                let u_L = a.anchor_L - X_WL.inverse_transform_point(p_W);
                u_L.dot(&a.normal_L) >= 0.0
            }
        }
    }

    /// Stick, slip and detach on the owning link; false when the point has detached.
    fn slide(&self, a: &mut Active, p_W: &Point3<f64>) -> bool {
        let rest_L = self.poses[a.slot as usize]
            .X_WL
            .inverse_transform_point(p_W);
        let cosine = self.config.cone_cosine();
        for iteration in 0.. {
            let u = a.anchor_L - rest_L;
            let normal_part = u.dot(&a.normal_L);
            if normal_part < 0.0 {
                return false;
            }
            if normal_part >= cosine * u.norm() || iteration >= self.config.max_slip_iterations {
                break;
            }
            let tangent = u - a.normal_L * normal_part;
            let length = tangent.norm();
            if length > 0.0 {
                a.anchor_L -= tangent * (self.config.slip_step.min(length) / length);
                self.project(a);
            }
        }
        true
    }

    /// Moves the anchor to the offset surface of its link along the normals it meets.
    fn project(&self, a: &mut Active) {
        let sdf = &self.links[a.slot as usize].sdf;
        for _ in 0..PROJECTION_STEPS {
            let s = sdf.sample(&a.anchor_L);
            a.normal_L = s.normal;
            let gap = s.distance - self.config.level();
            a.anchor_L -= s.normal * gap;
            if gap.abs() < PROJECTION_TOLERANCE {
                break;
            }
        }
    }

    /// The other link that the point is deepest in, if by more than a slip step.
    fn intruder(&self, a: &Active) -> Option<usize> {
        let p_W = self.poses[a.slot as usize].X_WL * a.anchor_L;
        let mut deepest = self.config.level() - self.config.slip_step;
        let mut found = None;
        for (slot, pose) in self.poses.iter().enumerate() {
            let reach = pose.radius + self.config.level();
            if slot == a.slot as usize || (p_W - pose.center_W).norm_squared() > reach * reach {
                continue;
            }
            let p_L = pose.X_WL.inverse_transform_point(&p_W);
            let distance = self.links[slot].sdf.distance(&p_L);
            if distance < deepest {
                deepest = distance;
                found = Some(slot);
            }
        }
        found
    }

    /// Step 5 for one link: points at rest within its reach, in any order.
    fn find_entering(&self, slot: usize, rest: &RestPoints, found: &mut Vec<Entering>) {
        found.clear();
        let (link, pose) = (&self.links[slot], &self.poses[slot]);
        let level = self.config.level();
        let (lo, hi) = world_box(&link.sdf, &pose.X_WL, level);
        rest.for_cells_in(&lo, &hi, |cell| {
            // The slack covers distances that are interpolated.
            let center_L = pose.X_WL.inverse_transform_point(&cell.center);
            if link.sdf.distance(&center_L) > 1.1 * cell.radius + level + 1e-3 {
                return;
            }
            for &point in cell.points {
                if self.touched[point as usize / 64] >> (point % 64) & 1 == 1 {
                    continue;
                }
                let p_L = pose
                    .X_WL
                    .inverse_transform_point(&rest.positions()[point as usize]);
                let distance = link.sdf.distance(&p_L);
                if distance < level {
                    found.push(Entering {
                        point,
                        slot: slot as u32,
                        distance,
                    });
                }
            }
        });
    }

    fn enter(&self, e: &Entering, rest: &RestPoints) -> Active {
        let X_WL = &self.poses[e.slot as usize].X_WL;
        let mut a = Active {
            point: e.point,
            slot: e.slot,
            anchor_L: X_WL.inverse_transform_point(&rest.positions()[e.point as usize]),
            normal_L: Vector3::zeros(),
        };
        self.project(&mut a);
        a
    }

    fn carry_all(&mut self, rest: &RestPoints) {
        let mut active = std::mem::take(&mut self.active);
        let this = &*self;
        // A detached point is marked by an impossible slot and removed below.
        let carry = |a: &mut Active| {
            if !this.carry(a, &rest.positions()[a.point as usize]) {
                a.slot = u32::MAX;
            }
        };
        if self.config.parallel && active.len() > CHUNK {
            active
                .par_chunks_mut(CHUNK)
                .for_each(|c| c.iter_mut().for_each(carry));
        } else {
            active.iter_mut().for_each(carry);
        }
        let touched = &mut self.touched;
        active.retain(|a| {
            let keep = a.slot != u32::MAX;
            if !keep {
                touched[a.point as usize / 64] &= !(1 << (a.point % 64));
            }
            keep
        });
        self.active = active;
    }

    fn touch_new(&mut self, rest: &RestPoints) {
        let mut entering = std::mem::take(&mut self.entering);
        let this = &*self;
        if self.config.parallel {
            entering
                .par_iter_mut()
                .enumerate()
                .for_each(|(slot, found)| this.find_entering(slot, rest, found));
        } else {
            for (slot, found) in entering.iter_mut().enumerate() {
                this.find_entering(slot, rest, found);
            }
        }
        if let Some((first, others)) = entering.split_first_mut() {
            others
                .iter()
                .for_each(|found| first.extend_from_slice(found));
            // Of several links, the one the point is deepest in comes first and is kept.
            first.sort_unstable_by(|a, b| {
                a.point
                    .cmp(&b.point)
                    .then(a.distance.total_cmp(&b.distance))
                    .then(a.slot.cmp(&b.slot))
            });
            first.dedup_by_key(|e| e.point);
            self.merge(first, rest);
        }
        self.entering = entering;
    }

    /// Merges new contacts into the active ones, both in order of the point index.
    fn merge(&mut self, entering: &[Entering], rest: &RestPoints) {
        if entering.is_empty() {
            return;
        }
        let mut merged = std::mem::take(&mut self.merged);
        merged.clear();
        let mut old = self.active.iter().copied().peekable();
        for e in entering {
            while let Some(a) = old.next_if(|a| a.point < e.point) {
                merged.push(a);
            }
            merged.push(self.enter(e, rest));
            self.touched[e.point as usize / 64] |= 1 << (e.point % 64);
        }
        merged.extend(old);
        self.merged = std::mem::replace(&mut self.active, merged);
    }
}

/// The axis-aligned world box around a posed shape, grown by `margin`.
fn world_box(sdf: &dyn Sdf, X_WL: &Isometry3<f64>, margin: f64) -> (Point3<f64>, Point3<f64>) {
    let (lo, hi) = sdf.bounds();
    let center = X_WL * nalgebra::center(&lo, &hi);
    let rotation = X_WL.rotation.to_rotation_matrix();
    let half = rotation.matrix().abs() * (0.5 * (hi - lo)).add_scalar(margin);
    (center - half, center + half)
}

impl ContactModel for StickSlip {
    fn reset(&mut self) {
        self.active.clear();
        self.touched.fill(0);
    }

    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        let words = rest.len().div_ceil(64);
        if self.touched.is_empty() {
            self.touched.resize(words, 0);
        }
        CoreError::check_len("rest points (in words of 64)", words, self.touched.len())?;
        self.place_links(posture)?;
        self.carry_all(rest);
        self.touch_new(rest);

        out.clear();
        for a in &self.active {
            let X_WL = &self.poses[a.slot as usize].X_WL;
            let u_W = X_WL * a.anchor_L - rest.positions()[a.point as usize];
            let link = self.links[a.slot as usize].link as u32;
            out.push(a.point, link, u_W, X_WL * a.normal_L)?;
        }
        Ok(())
    }
}

impl std::fmt::Debug for StickSlip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StickSlip")
            .field("links", &self.links.len())
            .field("config", &self.config)
            .field("contacts", &self.active.len())
            .finish_non_exhaustive()
    }
}
