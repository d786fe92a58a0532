use super::joint::{sign, speed_unit, unit};
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check, slides,
};
use std::ops::Range;

/// Friction and inertia of a joint that are driven by the motion of another one, as in gears that share a housing or
/// tendons that run past a joint: `-c_jk tanh(qd_k / eps) - d_jk qd_k - i_jk qdd_k`.
///
/// Parameters `c_<j>_<k>` (N m or N), `d_<j>_<k>` (N m s/rad, N s/m, ...) and `i_<j>_<k>` (kg m², kg, ...) for every joint
/// `j` and every other joint `k`, and the shape `eps` (rad/s or m/s). All neighbors along the arm may act together, or any
/// one pair alone. Tell-tale: the residual of one joint follows the velocity or the acceleration of another.
///
/// # Reference
/// B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo, *Robotics: Modelling, Planning and Control*,
/// 2009, chapter 7, doi:10.1007/978-1-84628-642-1.
#[derive(Debug, Clone, Copy)]
pub struct JointCoupling;

#[derive(Clone)]
struct Coupling {
    /// Joint, the one that drives it, dry and viscous friction, inertia.
    pairs: Vec<(usize, usize, [f64; OF_PAIR])>,
    eps: f64,
}

/// Parameters of a pair.
const OF_PAIR: usize = 3;

/// Every joint with each of the others.
fn pairs(site: &Site) -> impl Iterator<Item = (usize, usize)> {
    let d = site.joints();
    (0..d).flat_map(move |j| (0..d).filter(move |k| *k != j).map(move |k| (j, k)))
}

fn of_pair(pair: usize) -> Range<usize> {
    OF_PAIR * pair..OF_PAIR * (pair + 1)
}

impl Effect for JointCoupling {
    fn name(&self) -> &str {
        "joint_coupling"
    }

    fn summary(&self) -> &str {
        "the motion of joint k drags joint j: dry friction `c_j_k`, nearly full from twice the speed `eps` on, viscous `d_j_k`, inertia `i_j_k`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Joints]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::MoveInAir).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let dry = unit(site, "N m", "N");
        let of_turning = [
            unit(site, "N m s/rad", "N s/rad"),
            unit(site, "kg m^2", "kg m"),
        ];
        let of_sliding = [unit(site, "N m s/m", "N s/m"), unit(site, "kg m", "kg")];
        let of_pair = |(j, k): (usize, usize)| {
            let name = |letter| format!("{letter}_{}_{}", j + 1, k + 1);
            let c = Parameter::amplitude(name('c'), dry(j), [-50.0, 50.0], 0.3);
            let [viscous, inertia] = if slides(site, k) {
                &of_sliding
            } else {
                &of_turning
            };
            let d = Parameter::amplitude(name('d'), viscous(j), [-200.0, 200.0], 2.0);
            let i = Parameter::amplitude(name('i'), inertia(j), [-50.0, 50.0], 0.1);
            [c.of_joint(j), d.of_joint(j), i.of_joint(j)]
        };
        let mut parameters: Vec<_> = pairs(site).flat_map(of_pair).collect();
        parameters.push(Parameter::shape("eps", speed_unit(site), [1e-3, 0.2], 0.01));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let n = pairs(site).count();
        let mut start = vec![0.0; OF_PAIR * n];
        start.push(0.02);
        vec![start; 1 + n]
    }

    fn acting(&self, site: &Site, start: usize) -> Vec<usize> {
        let (joints, chains) = (site.robot.joints(), site.robot.chains());
        let before = |j: usize| {
            let (_, others) = chains.chain(joints[j].child()).split_last()?;
            others.last().map(|&k| k as usize)
        };
        let near = |(j, k)| before(j) == Some(k) || before(k) == Some(j);
        match start.checked_sub(1) {
            Some(alone) => of_pair(alone).collect(),
            None => {
                let near = (pairs(site).enumerate()).filter(|(_, pair)| near(*pair));
                let near: Vec<usize> = near.flat_map(|(n, _)| of_pair(n)).collect();
                // Joints of separate branches have no neighbors: the first pair is as good as any.
                if near.is_empty() && site.joints() > 1 {
                    of_pair(0).collect()
                } else {
                    near
                }
            }
        }
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let n = OF_PAIR * pairs(site).count();
        check(self.name(), theta, n + 1)?;
        let (of_pairs, _) = theta[..n].as_chunks();
        let acting = pairs(site)
            .zip(of_pairs)
            .filter(|(_, t)| **t != [0.0; OF_PAIR]);
        Ok(Box::new(Coupling {
            pairs: acting.map(|((j, k), t)| (j, k, *t)).collect(),
            eps: theta[n],
        }))
    }
}

impl Compensator for Coupling {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        for (j, k, [c, d, i]) in &self.pairs {
            let v = sample.qd[*k];
            tau[*j] -= c * sign(v, self.eps) + d * v + i * sample.qdd[*k];
        }
    }
}
