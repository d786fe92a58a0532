use crate::contact::contact_config;
use crate::links::Links;
use crate::{Campaign, Compensator, ContactLog, GapError, Model, Motion};
use vsf_core::Contacts;
use vsf_data::TorqueKind;

impl Campaign {
    /// First-order change of the contacts `log` of a model `base` under a small change of the model, without running
    /// contact anew.
    ///
    /// Where a link's surface moves by `d`, the points that it touches follow along its normal, `u + n (n . d)`, and slip
    /// along it. No new point is touched. `None` if the model changes more of contact than places and padding. Unlike the
    /// difference of two simulated contacts, the result has no noise from points that come into contact one by one.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn answer(
        &self,
        base: &Model,
        model: &Model,
        motion: &Motion,
        log: &ContactLog,
    ) -> Result<Option<ContactLog>, GapError> {
        let mut effects = model.compensator(&self.site)?;
        let Some(padding) = self.padding(&*base.compensator(&self.site)?, &*effects) else {
            return Ok(None);
        };
        let mut answer = ContactLog {
            rigid: Vec::new(),
            moved: Vec::with_capacity(log.moved.len()),
            ..log.clone()
        };
        let measured = self.site.torque_kind == TorqueKind::Measured;
        let mut workspace = self.site.robot.dynamics_workspace();
        let mut links = Links::new(self.site.joints());
        effects.begin_sequence(&motion.id);
        for touch in &motion.touches {
            effects.begin_touch();
            for row in touch.clone() {
                // As in a run of contact: the force known when a sample begins.
                let force = if row > touch.start {
                    log.forces[row - 1]
                } else {
                    nalgebra::Vector3::zeros()
                };
                let sample = motion.sample(row, touch.start, force);
                let posture = &mut answer.postures[row];
                links.place(&self.site, &mut *effects, &sample, posture)?;
                if measured {
                    let change = links.rigid_change(&self.site, &sample, &mut workspace)?;
                    answer.rigid.extend(change);
                }
                answer.moved.extend(links.all());
                let before = &log.contacts[row];
                let mut contacts = Contacts::new();
                for k in 0..before.len() {
                    let (p, link) = (before.points()[k], before.links()[k]);
                    let (u, n) = (before.displacements()[k], before.normals()[k]);
                    let x = self.site.rest.positions()[p as usize] + u;
                    let on_link = log.postures[row].link_poses()[link as usize].inverse() * x;
                    let moved = posture.link_poses()[link as usize] * on_link - x;
                    contacts.push(p, link, u + n * (n.dot(&moved) + padding), n)?;
                }
                answer.contacts[row] = contacts;
            }
        }
        Ok(Some(answer))
    }

    /// Difference in padding between two sets of effects; `None` if they change more of contact.
    fn padding(&self, base: &dyn Compensator, other: &dyn Compensator) -> Option<f64> {
        let [base, mut other] = [base, other].map(|c| contact_config(&self.scene, c));
        let padding = other.padding - base.padding;
        other.padding = base.padding;
        (other == base).then_some(padding)
    }
}
