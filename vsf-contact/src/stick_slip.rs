use crate::carry::{Active, CHUNK, Carry, DETACHED};
use crate::front::{Front, Reach};
use crate::link_pose::LinkPose;
use crate::rivals::Rival;
use crate::{ContactConfig, LinkSdf};
use rayon::prelude::*;
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, CoreError, LinkChains, Posture, RestPoints};

/// Stick-slip contact of a robot's links with independent points (section III-B-a).
///
/// Below, `u` is the displacement of a point from rest and `n` the outward normal of the link's surface
/// at the point. One step takes the links to a new posture:
///
/// 1. *Stick*: a point in contact is carried along by its link.
/// 2. *Detach*: it returns to rest when `u . n < 0` and `|u|` exceeds [`ContactConfig::adhesion`],
///    which is 0 by default.
/// 3. *Slip*: outside the friction cone it moves by `slip_step` against the tangential part of `u` and
///    back to the surface. This is repeated until it sticks, detaches or has used up
///    [`ContactConfig::max_slip_iterations`].
///    - The last step is shortened so that it does not overshoot the place without a tangential part.
///    - Slip never lengthens `u`. A step is undone if it decreases `|u|²` by less than a twentieth of
///      what it would on a plane (a tenth for a step to where no tangential part is left). So a point
///      wedged in a notch of the link stays there.
///    - Many steps are taken at once as a return mapping: along the tangent and back to the surface.
///      On smooth surfaces the result is within a slip step of where single steps end.
///    - Between two parts of a link the point slips along their crease, held by the friction of both.
/// 4. *Hand-over*: a point that is inside the offset surface of another link (see 5) by more than one
///    `slip_step` is pushed out by that link, which owns it from then on. Links that squeeze a point
///    take turns.
/// 5. *Touch*: a point at rest that is closer to a link than `threshold` plus padding is moved along the
///    normal to the surface offset by that distance. The link in which it is deepest owns it. The
///    displacement starts at zero, so that the result converges as the time step is refined.
///
/// A point that a link leaves and meets again starts over at step 5. Points are independent: results
/// do not depend on threads or on the order of points. All steps between two resets must use the same
/// rest points; a different number of them is an error.
///
/// Cost of a step: `O(|S| + points near surfaces of links)`. Any other point is checked again only when
/// a link has moved as far as it was away. Nothing is allocated once the buffers have grown. Memory: one
/// bit per point, 56 bytes per contact, and at most 50 bytes per link and point near its surface;
/// together with [`RestPoints`] less than 48 bytes per point that no link is near.
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

/// A point at rest found within reach of a link.
#[derive(Debug, Clone, Copy)]
struct Entering {
    point: u32,
    slot: u32,
    distance: f64,
}

impl StickSlip {
    /// Creates a contact model of a robot with the given link shapes.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn new(links: impl Into<Arc<[LinkSdf]>>, config: ContactConfig) -> Result<Self, CoreError> {
        config.check()?;
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

    /// The shapes of the links.
    pub fn links(&self) -> &[LinkSdf] {
        &self.links
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

    fn carry<'a>(&'a self, rest: &'a RestPoints) -> Carry<'a> {
        Carry {
            links: &self.links,
            poses: &self.poses,
            rivals: &self.rivals,
            config: &self.config,
            rest,
        }
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
        front.advance(&reach, rest, |point| self.is_touched(point), &mut enter);
        // What the front knows of them is old: they were in contact.
        self.detached.iter().for_each(|&point| enter(point));
    }

    fn enter(&self, e: &Entering, rest: &RestPoints) -> Active {
        let carry = self.carry(rest);
        let p_L = carry.rest_L(e.slot, e.point);
        Active {
            point: e.point,
            slot: e.slot,
            anchor: carry.surface(e.slot).project(&p_L),
        }
    }

    fn carry_all(&mut self, rest: &RestPoints) {
        let mut active = std::mem::take(&mut self.active);
        let carry = self.carry(rest);
        if self.config.parallel && active.len() > CHUNK {
            active
                .par_chunks_mut(CHUNK)
                .for_each(|contacts| carry.advance(contacts));
        } else {
            active
                .chunks_mut(CHUNK)
                .for_each(|contacts| carry.advance(contacts));
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

    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        let len = chains.link_count();
        match self.links.iter().find(|l| l.link >= len) {
            None => Ok(()),
            Some(LinkSdf { link: index, .. }) => Err(CoreError::OutOfRange {
                what: "link of a shape",
                index: *index,
                len,
            }),
        }
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
