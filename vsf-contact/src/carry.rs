use crate::batch::distances;
use crate::link_pose::LinkPose;
use crate::rivals::Rival;
use crate::slide::Slider;
use crate::surface::{Anchor, Surface};
use crate::{ContactConfig, LinkSdf};
use nalgebra::Point3;
use std::cell::Cell;
use vsf_core::RestPoints;

/// Contacts that are carried at once.
pub(crate) const CHUNK: usize = 2048;
/// The link of a point that has detached.
pub(crate) const DETACHED: u32 = u32::MAX;

/// A point in contact and its place on the link that carries it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Active {
    pub point: u32,
    pub slot: u32,
    pub anchor: Anchor,
}

/// Links in their places, with the points that they carry.
pub(crate) struct Carry<'a> {
    pub links: &'a [LinkSdf],
    pub poses: &'a [LinkPose],
    pub rivals: &'a [Vec<Rival>],
    pub config: &'a ContactConfig,
    pub rest: &'a RestPoints,
}

impl Carry<'_> {
    pub fn surface(&self, slot: u32) -> Surface<'_> {
        Surface {
            sdf: &*self.links[slot as usize].sdf,
            config: self.config,
        }
    }

    /// The rest position of a point in the frame of a link.
    pub fn rest_L(&self, slot: u32, point: u32) -> Point3<f64> {
        self.poses[slot as usize].to_link(&self.rest.positions()[point as usize])
    }

    /// Steps 1-4 of [`StickSlip`](crate::StickSlip) for up to [`CHUNK`] contacts. A point that detaches gets the link
    /// [`DETACHED`].
    pub fn advance(&self, contacts: &mut [Active]) {
        let mut own = [0; CHUNK];
        let mut takers = [None; CHUNK];
        for slot in 0..self.links.len() as u32 {
            let mut len = 0;
            for (i, a) in contacts.iter().enumerate() {
                own[len] = i;
                len += usize::from(a.slot == slot);
            }
            if len > 0 {
                self.slide(slot, &own[..len], contacts);
                self.find_takers(slot, &own[..len], contacts, &mut takers);
            }
        }
        for (a, taker) in contacts.iter_mut().zip(takers) {
            if let Some(taker) = taker {
                self.hand_over(a, taker);
            }
        }
    }

    /// Steps 1-3 for the contacts `own` of one link.
    fn slide(&self, slot: u32, own: &[usize], contacts: &mut [Active]) {
        let contacts = Cell::from_mut(contacts).as_slice_of_cells();
        let mut waiting = own.iter().map(|&i| {
            let Active { anchor, point, .. } = contacts[i].get();
            let rest_L = self.rest_L(slot, point);
            (i, Slider { anchor, rest_L })
        });
        let done = |i: usize, anchor, holds| {
            let slot = if holds { slot } else { DETACHED };
            let point = contacts[i].get().point;
            contacts[i].set(Active {
                point,
                slot,
                anchor,
            });
        };
        self.surface(slot).slide(|| waiting.next(), done);
    }

    /// Finds those of the contacts `own` of one link that are inside another link by more than a slip
    /// step, with the rival in which they are deepest.
    fn find_takers<'a>(
        &'a self,
        slot: u32,
        own: &[usize],
        contacts: &[Active],
        takers: &mut [Option<&'a Rival>; CHUNK],
    ) {
        let mut deepest = [self.config.level() - self.config.slip_step; CHUNK];
        for rival in &self.rivals[slot as usize] {
            let pose = &self.poses[rival.slot];
            let in_box = own.iter().filter_map(|&i| {
                let a = &contacts[i];
                if a.slot == DETACHED {
                    return None;
                }
                let place_R = rival.place_in_box(&a.anchor.place_L, pose)?;
                Some((i, place_R))
            });
            distances(&*self.links[rival.slot].sdf, in_box, |i, distance| {
                if distance < deepest[i] {
                    deepest[i] = distance;
                    takers[i] = Some(rival);
                }
            });
        }
    }

    fn hand_over(&self, a: &mut Active, taker: &Rival) {
        a.slot = taker.slot as u32;
        let surface = self.surface(a.slot);
        a.anchor = surface.project(&taker.place(&a.anchor.place_L));
        let u_R = a.anchor.place_L - self.rest_L(a.slot, a.point);
        if !surface.holds(u_R.dot(&a.anchor.normal_L), u_R.norm_squared()) {
            a.slot = DETACHED;
        }
    }
}
