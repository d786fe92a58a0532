use super::joint::{sign, speed_unit, unit};
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};

/// Friction of a joint that is driven by the motion of its neighbours, as in gears that share a
/// housing: `-c_jk tanh(qd_k / eps) - d_jk qd_k` for `k = j - 1` and `k = j + 1`.
///
/// Parameters `c_<j>_<k>` (N m or N) and `d_<j>_<k>` (N m s/rad or N s/m) for every joint `j` and
/// neighbour `k`, and the shape `eps` (rad/s or m/s). Tell-tale: the residual of one joint follows the
/// velocity of another.
///
/// # Reference
/// B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo, *Robotics: Modelling, Planning and Control*,
/// 2009, chapter 7, doi:10.1007/978-1-84628-642-1.
#[derive(Debug, Clone, Copy)]
pub struct JointCoupling;

struct Coupling {
    /// Joint, the neighbour that drives it, dry and viscous friction.
    pairs: Vec<(usize, usize, f64, f64)>,
    eps: f64,
}

/// Every joint with each of its neighbours.
fn pairs(site: &Site) -> impl Iterator<Item = (usize, usize)> {
    let d = site.joints();
    (0..d).flat_map(move |j| {
        let neighbours = [j.checked_sub(1), Some(j + 1)];
        let inside = neighbours.into_iter().flatten().filter(move |k| *k < d);
        inside.map(move |k| (j, k))
    })
}

impl Effect for JointCoupling {
    fn name(&self) -> &str {
        "joint_coupling"
    }

    fn summary(&self) -> &str {
        "the motion of a neighbouring joint k drags joint j: dry friction `c_j_k`, nearly full from the speed `eps` on, viscous `d_j_k`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Joints]
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let (dry, viscous) = (unit(site, "N m", "N"), unit(site, "N m s/rad", "N s/m"));
        let of_pair = |(j, k): (usize, usize)| {
            let name = |letter| format!("{letter}_{}_{}", j + 1, k + 1);
            let c = Parameter::amplitude(name('c'), dry(j), [-50.0, 50.0], 0.3);
            let d = Parameter::amplitude(name('d'), viscous(j), [-200.0, 200.0], 2.0);
            [c.of_joint(j), d.of_joint(j)]
        };
        let mut parameters: Vec<_> = pairs(site).flat_map(of_pair).collect();
        parameters.push(Parameter::shape("eps", speed_unit(site), [1e-3, 0.2], 0.01));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let mut start = vec![0.0; 2 * pairs(site).count()];
        start.push(0.02);
        vec![start]
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let n = pairs(site).count();
        check(self.name(), theta, 2 * n + 1)?;
        let pairs = pairs(site).zip(theta.chunks_exact(2));
        Ok(Box::new(Coupling {
            pairs: pairs.map(|((j, k), t)| (j, k, t[0], t[1])).collect(),
            eps: theta[2 * n],
        }))
    }
}

impl Compensator for Coupling {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        for (j, k, c, d) in &self.pairs {
            let v = sample.qd[*k];
            tau[*j] -= c * sign(v, self.eps) + d * v;
        }
    }
}
