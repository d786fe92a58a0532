use crate::{ContactConfig, LinkSdf};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, CoreError, Posture, RestPoints};

/// Points per task when a step runs on several threads.
const CHUNK: usize = 512;
/// Newton corrections of a projection to the surface, and when it is close enough (m).
const PROJECTION_STEPS: usize = 4;
const PROJECTION_TOLERANCE: f64 = 1e-6;
/// Tangential displacement that always sticks (m): rounding without friction.
const STICK_TOLERANCE: f64 = 1e-9;

/// Stick-slip contact of a robot's links with independent points (section III-B-a).
///
/// One step, for links in a new posture:
///
/// 1. *Stick*: a point in contact is carried along by its link.
/// 2. *Detach*: it goes back to rest when `u . n < 0`, `n` the outward normal at its place.
/// 3. *Slip*: outside the friction cone it moves by `slip_step` against the tangential part of
///    `u` and back to the surface, again and again until it sticks, detaches or has used up
///    [`ContactConfig::max_slip_iterations`]. A last step is shortened so as not to pass the
///    point of no tangential part. Slip never lengthens `u`: a point wedged in a notch of the
///    link stays there.
/// 4. *Hand-over*: a point that is inside another link by more than one `slip_step` is pushed out
///    by that link and owned by it from then on. Links that squeeze a point take turns.
/// 5. *Touch*: a point at rest that is closer than `threshold` to a link is moved along the
///    normal to the surface offset by `threshold` (plus padding); the link it is deepest in owns
///    it. The displacement starts at zero, so that refining the time step converges.
///
/// A point that a link leaves and meets again begins anew at step 5. Points are independent:
/// results do not depend on threads or on the order of points. All steps between two resets take
/// the same rest points; another number of them is an error.
///
/// Cost of a step: `O(|S| + points near links)`; points elsewhere are never looked at. Nothing is
/// allocated once the buffers have grown. Memory: one bit per point and 112 bytes per contact.
#[derive(Clone)]
pub struct StickSlip {
    links: Arc<[LinkSdf]>,
    config: ContactConfig,
    active: Vec<Active>,
    merged: Vec<Active>,
    /// Number of rest points since the last reset.
    cloud: Option<usize>,
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

/// Pose of a link's shape and the box in the link frame that holds all places in contact with it.
#[derive(Debug, Clone)]
struct LinkPose {
    R_WL: Matrix3<f64>,
    p_WL: Vector3<f64>,
    lower_L: Point3<f64>,
    upper_L: Point3<f64>,
}

impl LinkPose {
    fn new(X_WL: &Isometry3<f64>, (lower, upper): (Point3<f64>, Point3<f64>), margin: f64) -> Self {
        Self {
            R_WL: X_WL.rotation.to_rotation_matrix().into_inner(),
            p_WL: X_WL.translation.vector,
            lower_L: lower - Vector3::repeat(margin),
            upper_L: upper + Vector3::repeat(margin),
        }
    }

    fn to_link(&self, p_W: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.R_WL.tr_mul(&(p_W.coords - self.p_WL)))
    }

    fn to_world(&self, p_L: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.R_WL * p_L.coords + self.p_WL)
    }

    /// Whether a ball in the link frame reaches into the box.
    fn is_near(&self, center_L: &Point3<f64>, radius: f64) -> bool {
        let clamped = center_L.sup(&self.lower_L).inf(&self.upper_L);
        (center_L - clamped).norm_squared() <= radius * radius
    }

    /// The axis-aligned box in world around the box.
    fn world_box(&self) -> (Point3<f64>, Point3<f64>) {
        let center = self.to_world(&nalgebra::center(&self.lower_L, &self.upper_L));
        let half = self.R_WL.abs() * (0.5 * (self.upper_L - self.lower_L));
        (center - half, center + half)
    }

    /// Whether squares of displacements that the link can cause stay finite.
    fn is_bounded(&self) -> bool {
        let radius = self.lower_L.coords.norm() + self.upper_L.coords.norm();
        (4.0 * (self.p_WL.norm() + radius)).powi(2).is_finite()
    }
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
            cloud: None,
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
        self.poses.clear();
        for l in self.links.iter() {
            let X_WL = poses.get(l.link).ok_or(CoreError::OutOfRange {
                what: "link",
                index: l.link,
                len: poses.len(),
            })?;
            let pose = LinkPose::new(X_WL, l.sdf.bounds(), self.config.level());
            if !pose.is_bounded() {
                return Err(CoreError::NotFinite {
                    what: "squared size and distance of link",
                    index: l.link,
                    value: f64::INFINITY,
                });
            }
            self.poses.push(pose);
        }
        Ok(())
    }

    /// Steps 1-4 for one point; false when it has detached.
    fn carry(&self, a: &mut Active, p_W: &Point3<f64>) -> bool {
        if !self.slide(a, p_W) {
            return false;
        }
        let now_W = self.poses[a.slot as usize].to_world(&a.anchor_L);
        let Some(slot) = self.intruder(a.slot as usize, &now_W) else {
            return true;
        };
        let pose = &self.poses[slot];
        a.slot = slot as u32;
        a.anchor_L = pose.to_link(&now_W);
        self.project(a);
        (a.anchor_L - pose.to_link(p_W)).dot(&a.normal_L) >= 0.0
    }

    /// Stick, slip and detach on the owning link; false when the point has detached.
    fn slide(&self, a: &mut Active, p_W: &Point3<f64>) -> bool {
        let rest_L = self.poses[a.slot as usize].to_link(p_W);
        for iteration in 0.. {
            let u = a.anchor_L - rest_L;
            let normal_part = u.dot(&a.normal_L);
            if normal_part < 0.0 {
                return false;
            }
            let tangent = u - a.normal_L * normal_part;
            let length = tangent.norm();
            let sticks = length <= self.config.friction * normal_part + STICK_TOLERANCE;
            if sticks || iteration >= self.config.max_slip_iterations {
                break;
            }
            let before = *a;
            a.anchor_L -= tangent * (self.config.slip_step.min(length) / length);
            self.project(a);
            if (a.anchor_L - rest_L).norm_squared() >= u.norm_squared() {
                *a = before;
                break;
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

    /// The link, other than the owner, that the place is deepest in, if by more than a slip step.
    fn intruder(&self, owner: usize, p_W: &Point3<f64>) -> Option<usize> {
        let mut deepest = self.config.level() - self.config.slip_step;
        let mut found = None;
        for (slot, pose) in self.poses.iter().enumerate() {
            if slot == owner {
                continue;
            }
            let p_L = pose.to_link(p_W);
            if !pose.is_near(&p_L, 0.0) {
                continue;
            }
            let distance = self.links[slot].sdf.distance(&p_L);
            if distance < deepest {
                deepest = distance;
                found = Some(slot);
            }
        }
        found
    }

    fn is_touched(&self, point: u32) -> bool {
        self.touched[point as usize / 64] >> (point % 64) & 1 == 1
    }

    /// Step 5 for one link: points at rest within its reach, in any order.
    fn find_entering(&self, slot: usize, rest: &RestPoints, found: &mut Vec<Entering>) {
        found.clear();
        let (sdf, pose) = (&self.links[slot].sdf, &self.poses[slot]);
        let level = self.config.level();
        let (lower, upper) = pose.world_box();
        rest.for_cells_in(&lower, &upper, |cell| {
            let center_L = pose.to_link(&cell.center);
            if !pose.is_near(&center_L, cell.radius)
                || cell.points.iter().all(|&point| self.is_touched(point))
                // The slack covers distances that are interpolated.
                || sdf.distance(&center_L) > 1.1 * cell.radius + level + 1e-3
            {
                return;
            }
            for &point in cell.points {
                if self.is_touched(point) {
                    continue;
                }
                let p_L = pose.to_link(&rest.positions()[point as usize]);
                if !pose.is_near(&p_L, 0.0) {
                    continue;
                }
                let distance = sdf.distance(&p_L);
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
        let pose = &self.poses[e.slot as usize];
        let mut a = Active {
            point: e.point,
            slot: e.slot,
            anchor_L: pose.to_link(&rest.positions()[e.point as usize]),
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

impl ContactModel for StickSlip {
    fn reset(&mut self) {
        self.active.clear();
        self.cloud = None;
    }

    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        let cloud = self.cloud.unwrap_or(rest.len());
        CoreError::check_len("rest points", rest.len(), cloud)?;
        self.place_links(posture)?;
        if self.cloud.is_none() {
            self.cloud = Some(cloud);
            self.touched.clear();
            self.touched.resize(cloud.div_ceil(64), 0);
        }
        self.carry_all(rest);
        self.touch_new(rest);

        out.clear();
        for a in &self.active {
            let slot = a.slot as usize;
            let pose = &self.poses[slot];
            let u_W = pose.to_world(&a.anchor_L) - rest.positions()[a.point as usize];
            let n_W = pose.R_WL * a.normal_L;
            out.push(a.point, self.links[slot].link as u32, u_W, n_W)?;
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
