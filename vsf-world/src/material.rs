//! The material law of one element: a node on its spring, or a joint of a plant.

use crate::effect::Effect;
use nalgebra::{Point3, Vector3};
use rand::{Rng, RngExt};

/// Speed at which the power law of viscosity equals the linear one \[m/s\].
const REFERENCE_SPEED: f64 = 0.05;

/// Time constant with which matter follows the motion of its surface \[s\].
const ENTRAINMENT: f64 = 0.06;

/// Material law. The default is a linear spring.
#[derive(Debug, Clone, Default)]
pub(crate) struct Material {
    stiffening: Option<(f64, f64)>,
    damage: Option<(f64, f64, f64)>,
    plastic: Option<(f64, f64)>,
    viscous: Option<(f64, f64)>,
    relaxation: Option<([f64; 3], [f64; 3])>,
    fibers: Option<(f64, f64, f64)>,
    drag: Option<(f64, f64)>,
    /// Mean stiffness of the object \[N/m\]. Everywhere, mass and drag are those of a mean element.
    pub typical_stiffness: f64,
}

/// State of one element.
#[derive(Debug, Clone)]
pub(crate) struct Element {
    /// Stiffness \[N/m\].
    pub stiffness: f64,
    /// Displacement at the last step \[m\].
    pub u: Vector3<f64>,
    /// Shift of its rest position \[m\].
    set: Vector3<f64>,
    set_path: f64,
    /// Largest displacement so far \[m\].
    largest: f64,
    branches: [Vector3<f64>; 3],
    flow: Vector3<f64>,
    /// Direction of the fiber.
    fiber: Vector3<f64>,
    /// Variation of strength, for yield and adhesion, about 1.
    pub strength: f64,
}

/// Force and slope of an element at a trial displacement.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Response {
    /// Force on the element \[N\], opposite to the displacement.
    pub force: Vector3<f64>,
    /// A bound of the slope, for steps toward equilibrium [N/m].
    pub slope: f64,
}

impl Element {
    pub fn new(stiffness: f64, rng: &mut impl Rng) -> Self {
        Self {
            stiffness,
            u: Vector3::zeros(),
            set: Vector3::zeros(),
            set_path: 0.0,
            largest: 0.0,
            branches: [Vector3::zeros(); 3],
            flow: Vector3::zeros(),
            fiber: Vector3::x(),
            strength: rng.random_range(0.6..1.4),
        }
    }

    pub fn reset(&mut self) {
        self.u = Vector3::zeros();
        self.set = Vector3::zeros();
        self.set_path = 0.0;
        self.largest = 0.0;
        self.branches = [Vector3::zeros(); 3];
        self.flow = Vector3::zeros();
    }

    /// True if nothing moves or pulls any more.
    pub fn is_still(&self) -> bool {
        let still = |v: &Vector3<f64>| v.norm_squared() < 1e-10;
        still(&(self.u - self.set)) && still(&self.flow) && self.branches.iter().all(still)
    }
}

impl Material {
    pub fn new(effects: &[Effect]) -> Self {
        let mut m = Self::default();
        for effect in effects {
            match *effect {
                Effect::StrainStiffening { gain, length_m } => {
                    m.stiffening = Some((gain, length_m))
                }
                Effect::DamageSoftening {
                    threshold_m,
                    scale_m,
                    max,
                } => {
                    m.damage = Some((threshold_m, scale_m, max));
                }
                Effect::PlasticSet { yield_m, hardening } => m.plastic = Some((yield_m, hardening)),
                Effect::Viscoelastic { eta_s, power } => m.viscous = Some((eta_s, power)),
                Effect::StressRelaxation { g, tau_s } => m.relaxation = Some((g, tau_s)),
                Effect::Anisotropy {
                    alpha,
                    heading,
                    winding,
                } => {
                    m.fibers = Some((alpha, heading, winding));
                }
                Effect::InertiaDrag { mass_s2, drag_s } => m.drag = Some((mass_s2, drag_s)),
                _ => {}
            }
        }
        m
    }

    /// Sets the fiber direction of an element at `place`.
    pub fn lay_fiber(&self, element: &mut Element, place: &Point3<f64>) {
        if let Some((_, heading, winding)) = self.fibers {
            let angle = heading + winding * (place.z + 0.5 * place.y);
            element.fiber = Vector3::new(angle.cos(), angle.sin(), 0.4).normalize();
        }
    }

    /// Shift of the rest position after `u`, and how far it has moved in all.
    fn flow_to(&self, e: &Element, u: &Vector3<f64>) -> (Vector3<f64>, f64) {
        let Some((yield_m, hardening)) = self.plastic else {
            return (e.set, e.set_path);
        };
        let stretch = u - e.set;
        let length = stretch.norm();
        let limit = yield_m * e.strength + hardening * e.set_path;
        if length <= limit {
            return (e.set, e.set_path);
        }
        let step = (length - limit) / (1.0 + hardening);
        (e.set + stretch * (step / length), e.set_path + step)
    }

    /// Force of the element at displacement `u`, `dt` after its last step.
    pub fn response(&self, e: &Element, u: &Vector3<f64>, dt: f64) -> Response {
        let (set, _) = self.flow_to(e, u);
        let stretch = u - set;
        let length = stretch.norm();
        let mut factor = 1.0;
        if let Some((gain, scale)) = self.stiffening {
            factor += gain * ((length / scale).min(5.0).cosh() - 1.0);
        }
        if let Some(damage) = self.damage {
            factor *= 1.0 - damaged(damage, e.largest.max(length));
        }
        let mut pull = stretch * factor;
        let mut slope = factor;
        if let Some((gain, scale)) = self.stiffening {
            slope += gain * (length / scale) * (length / scale).min(5.0).sinh();
        }
        if let Some((alpha, ..)) = self.fibers {
            pull += e.fiber * (alpha * factor * e.fiber.dot(&stretch));
            slope *= 1.0 + alpha;
        }
        let step = u - e.u;
        if let Some((g, tau)) = self.relaxation {
            for k in 0..3 {
                let fade = (-dt / tau[k]).exp();
                pull += (e.branches[k] + step) * (g[k] * fade);
                slope += g[k] * fade;
            }
        }
        if let Some((eta, power)) = self.viscous {
            let v = step / dt;
            let ease = (v.norm().max(1e-3) / REFERENCE_SPEED).powf(power - 1.0);
            pull += v * (eta * ease);
            slope += eta * ease / dt;
        }
        let mut force = -pull * e.stiffness;
        slope *= e.stiffness;
        if let Some((mass, drag)) = self.drag {
            let (mass, drag) = (mass * self.typical_stiffness, drag * self.typical_stiffness);
            let follow = 1.0 - (-dt / ENTRAINMENT).exp();
            let change = (step / dt - e.flow) * follow;
            force -= (e.flow + change) * drag + change * (mass / dt);
            slope += (drag + mass / dt) * follow / dt;
        }
        Response { force, slope }
    }

    /// Accepts `u` as the displacement of this step.
    pub fn commit(&self, e: &mut Element, u: Vector3<f64>, dt: f64) {
        (e.set, e.set_path) = self.flow_to(e, &u);
        e.largest = e.largest.max((u - e.set).norm());
        let step = u - e.u;
        if let Some((_, tau)) = self.relaxation {
            for (branch, tau) in e.branches.iter_mut().zip(tau) {
                *branch = (*branch + step) * (-dt / tau).exp();
            }
        }
        if self.drag.is_some() {
            e.flow += (step / dt - e.flow) * (1.0 - (-dt / ENTRAINMENT).exp());
        }
        e.u = u;
    }
}

/// Share of the stiffness that is lost after a displacement of `largest`.
fn damaged((threshold, scale, max): (f64, f64, f64), largest: f64) -> f64 {
    let beyond = ((largest - threshold) / scale).max(0.0);
    max * (1.0 - (-beyond.powf(1.6)).exp())
}
