use crate::front::{Front, Reach};
use crate::link_pose::LinkPose;
use crate::rivals::Rival;
use crate::slip::{Anchor, Surface};
use crate::{ContactConfig, LinkSdf};
use nalgebra::Point3;
use rayon::prelude::*;
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, CoreError, Posture, RestPoints};

/// Points per task when a step runs on several threads.
const CHUNK: usize = 512;
/// The link of a point that has detached.
const DETACHED: u32 = u32::MAX;

/// Stick-slip contact of a robot's links with independent points (section III-B-a).
///
/// One step, for links in a new posture:
///
/// 1. *Stick*: a point in contact is carried along by its link.
/// 2. *Detach*: it goes back to rest when `u . n < 0`, `n` the outward normal at its place, and
///    `|u|` exceeds [`ContactConfig::adhesion`], 0 unless set.
/// 3. *Slip*: outside the friction cone it moves by `slip_step` against the tangential part of
///    `u` and back to the surface, again and again until it sticks, detaches or has used up
///    [`ContactConfig::max_slip_iterations`]. A last step is shortened so as not to pass the
///    point of no tangential part. Slip never lengthens `u`, and a step that shortens it by less
///    than a twentieth of what it would on a plane is taken back: a point wedged in a notch of
///    the link stays there. Many steps are taken at once, as a return mapping: along the tangent
///    and back to the surface, on smooth surfaces to within a slip step of where single steps end.
///    Between two parts of a link it slips along their crease, held by the friction of both.
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
/// Cost of a step: `O(|S| + points near surfaces of links)`; a point elsewhere is looked at again
/// when a link has moved as far as it was away. Nothing is allocated once the buffers have grown.
/// Memory: one bit per point, 56 bytes per contact and at most 50 per link and point near its
/// surface; together with [`RestPoints`] less than 48 bytes per point that no link is near.
#[derive(Clone)]
pub struct StickSlip {
    links: Arc<[LinkSdf]>,
    config: ContactConfig,
    active: Vec<Active>,
    detached: Vec<u32>,
    /// Number of rest points since the last reset.
    cloud: Option<usize>,
    touched: Vec<u64>,
    entering: Vec<Vec<Entering>>,
    poses: Vec<LinkPose>,
    fronts: Vec<Front>,
    rivals: Vec<Vec<Rival>>,
}

/// A point in contact and its place on the link that carries it.
#[derive(Debug, Clone, Copy)]
struct Active {
    point: u32,
    slot: u32,
    anchor: Anchor,
}

/// A point at rest found within reach of a link.
#[derive(Debug, Clone, Copy)]
struct Entering {
    point: u32,
    slot: u32,
    distance: f64,
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
            fronts: vec![Front::default(); links.len()],
            poses: Vec::with_capacity(links.len()),
            rivals: Vec::new(),
            links,
            config,
            active: Vec::new(),
            detached: Vec::new(),
            cloud: None,
            touched: Vec::new(),
        })
    }

    /// The parameters.
    pub fn config(&self) -> &ContactConfig {
        &self.config
    }

    fn place_links(&mut self, posture: &Posture) -> Result<(), CoreError> {
        posture.check()?;
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
        Rival::find(&self.poses, &mut self.rivals);
        Ok(())
    }

    fn surface(&self, slot: u32) -> Surface<'_> {
        Surface {
            sdf: &*self.links[slot as usize].sdf,
            config: &self.config,
        }
    }

    /// Steps 1-4 for one point; a point that detaches gets no link.
    fn carry(&self, a: &mut Active, p_W: &Point3<f64>) {
        let rest_L = self.poses[a.slot as usize].to_link(p_W);
        if !self.surface(a.slot).slide(&mut a.anchor, &rest_L) {
            a.slot = DETACHED;
        } else if let Some((slot, place_R)) = self.intruder(a) {
            a.slot = slot;
            let surface = self.surface(slot);
            a.anchor = surface.project(&place_R);
            let u_R = a.anchor.place_L - self.poses[slot as usize].to_link(p_W);
            if !surface.holds(u_R.dot(&a.anchor.normal_L), u_R.norm_squared()) {
                a.slot = DETACHED;
            }
        }
    }

    /// The link, other than the owner, that a contact is deepest in, if by more than a slip step,
    /// and the place in its frame.
    fn intruder(&self, a: &Active) -> Option<(u32, Point3<f64>)> {
        let mut deepest = self.config.level() - self.config.slip_step;
        let mut found = None;
        for rival in &self.rivals[a.slot as usize] {
            let pose = &self.poses[rival.slot];
            let Some(p_R) = rival.place_in_box(&a.anchor.place_L, pose) else {
                continue;
            };
            let distance = self.links[rival.slot].sdf.distance(&p_R);
            if distance < deepest {
                deepest = distance;
                found = Some((rival.slot as u32, p_R));
            }
        }
        found
    }

    fn is_touched(&self, point: u32) -> bool {
        self.touched[point as usize / 64] >> (point % 64) & 1 == 1
    }

    /// Step 5 for one link: points at rest within its reach, in any order.
    fn find_entering(
        &self,
        slot: usize,
        rest: &RestPoints,
        front: &mut Front,
        found: &mut Vec<Entering>,
    ) {
        found.clear();
        let reach = Reach {
            sdf: &*self.links[slot].sdf,
            pose: &self.poses[slot],
            level: self.config.level(),
            slack: self.links[slot].sdf.slack(),
        };
        let mut enter = |point: u32| {
            if self.is_touched(point) {
                return;
            }
            if let Some(distance) = reach.distance(&rest.positions()[point as usize]) {
                let slot = slot as u32;
                found.push(Entering {
                    point,
                    slot,
                    distance,
                });
            }
        };
        front.advance(&reach, rest, &mut enter);
        // What the front knows of them is old: they were in contact.
        self.detached.iter().for_each(|&point| enter(point));
    }

    fn enter(&self, e: &Entering, rest: &RestPoints) -> Active {
        let p_W = &rest.positions()[e.point as usize];
        let p_L = self.poses[e.slot as usize].to_link(p_W);
        Active {
            point: e.point,
            slot: e.slot,
            anchor: self.surface(e.slot).project(&p_L),
        }
    }

    fn carry_all(&mut self, rest: &RestPoints) {
        let mut active = std::mem::take(&mut self.active);
        let this = &*self;
        let carry = |a: &mut Active| this.carry(a, &rest.positions()[a.point as usize]);
        if self.config.parallel && active.len() > CHUNK {
            active
                .par_chunks_mut(CHUNK)
                .for_each(|c| c.iter_mut().for_each(carry));
        } else {
            active.iter_mut().for_each(carry);
        }
        self.detached.clear();
        let (touched, detached) = (&mut self.touched, &mut self.detached);
        active.retain(|a| {
            let keep = a.slot != DETACHED;
            if !keep {
                touched[a.point as usize / 64] &= !(1 << (a.point % 64));
                detached.push(a.point);
            }
            keep
        });
        self.active = active;
    }

    fn touch_new(&mut self, rest: &RestPoints) {
        let mut entering = std::mem::take(&mut self.entering);
        let mut fronts = std::mem::take(&mut self.fronts);
        let this = &*self;
        if self.config.parallel {
            entering
                .par_iter_mut()
                .zip(&mut fronts)
                .enumerate()
                .for_each(|(slot, (found, front))| this.find_entering(slot, rest, front, found));
        } else {
            for (slot, (found, front)) in entering.iter_mut().zip(&mut fronts).enumerate() {
                this.find_entering(slot, rest, front, found);
            }
        }
        self.fronts = fronts;
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
        let Some(first) = entering.first().map(|e| self.enter(e, rest)) else {
            return;
        };
        // From the back, so that every contact moves once.
        let mut old = self.active.len();
        self.active.resize(old + entering.len(), first);
        for (before, e) in entering.iter().enumerate().rev() {
            while old > 0 && self.active[old - 1].point > e.point {
                self.active[old + before] = self.active[old - 1];
                old -= 1;
            }
            self.active[old + before] = self.enter(e, rest);
            self.touched[e.point as usize / 64] |= 1 << (e.point % 64);
        }
    }
}

impl ContactModel for StickSlip {
    fn reset(&mut self) {
        self.active.clear();
        self.fronts.iter_mut().for_each(Front::clear);
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
            let u_W = pose.to_world(&a.anchor.place_L) - rest.positions()[a.point as usize];
            let n_W = pose.R_WL * a.anchor.normal_L;
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
