//! A soft body of irregular nodes, each on a spring of its own and tied to its neighbors.
//!
//! A node that the arm has reached stays on the arm's surface and moves with it. If the force that holds it there leaves
//! the friction cone, sliding returns it. All other nodes are where their springs balance. A step consists of a few
//! Gauss-Seidel sweeps over the nodes that are not at rest.

use crate::WorldError;
use crate::arm::{Touch, WorldCapsule};
use crate::body::Body;
use crate::material::{Element, Material, Response};
use crate::nodes::{SPACING, scatter, stiffness_field};
use crate::object::{Meeting, Object, Physics, Site};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Unit, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Sweeps per step.
const SWEEPS: usize = 8;

/// Stiffness of a spring between neighbors relative to that of a mean node.
const TIE: f64 = 0.03;

#[derive(Debug, Clone, Copy)]
struct Hold {
    capsule: usize,
    /// Duration of the hold \[s\].
    dwell: f64,
}

pub(crate) struct Springs {
    body: Body,
    rest: Vec<Point3<f64>>,
    tree: ImmutableKdTree<f64, 3>,
    /// Neighbors of node `i` are `ties[first_tie[i]..first_tie[i + 1]]`.
    ties: Vec<u32>,
    first_tie: Vec<usize>,
    elements: Vec<Element>,
    /// Displacements of the step in progress.
    u: Vec<Vector3<f64>>,
    holds: Vec<Option<Hold>>,
    active: Vec<u32>,
    is_active: Vec<bool>,
    mean_stiffness: f64,
    physics: Physics,
    found: Vec<u32>,
    /// Capsules that may touch something in this step.
    near: Vec<usize>,
}

impl Springs {
    /// Draws a body in front of an arm whose base is at `base`.
    ///
    /// # Errors
    /// [`WorldError::Search`].
    pub fn draw(
        base: &Point3<f64>,
        physics: &Physics,
        rng: &mut Pcg64Mcg,
    ) -> Result<Self, WorldError> {
        let body = Body::draw(base, rng);
        let rest = scatter(&body, rng);
        let stiffness = stiffness_field(&body, &rest, rng);
        let mean_stiffness = stiffness.iter().sum::<f64>() / stiffness.len().max(1) as f64;
        let coordinates: Vec<[f64; 3]> = rest.iter().map(|p| p.coords.into()).collect();
        let tree =
            ImmutableKdTree::new_from_slice(&coordinates).map_err(|e| WorldError::Search {
                problem: e.to_string(),
            })?;
        let mut ties = Vec::new();
        let mut first_tie = vec![0];
        for (i, p) in coordinates.iter().enumerate() {
            let mut near: Vec<u32> = within(&tree, p, 1.55 * SPACING)
                .filter(|&j| j as usize != i)
                .collect();
            near.sort_unstable();
            ties.extend(near);
            first_tie.push(ties.len());
        }
        let elements = stiffness.iter().map(|&k| Element::new(k, rng)).collect();
        let n = rest.len();
        Ok(Self {
            body,
            rest,
            tree,
            ties,
            first_tie,
            elements,
            u: vec![Vector3::zeros(); n],
            holds: vec![None; n],
            active: Vec::new(),
            is_active: vec![false; n],
            mean_stiffness,
            physics: physics.clone(),
            found: Vec::new(),
            near: Vec::new(),
        })
    }

    fn neighbors(&self, i: usize) -> &[u32] {
        &self.ties[self.first_tie[i]..self.first_tie[i + 1]]
    }

    fn wake(&mut self, i: usize) {
        if !self.is_active[i] {
            self.is_active[i] = true;
            self.active.push(i as u32);
        }
    }

    /// Wakes the nodes that the arm has reached, and the neighbors of held nodes.
    fn wake_touched(&mut self, capsules: &[WorldCapsule]) {
        let mut found = std::mem::take(&mut self.found);
        found.clear();
        for &k in &self.near {
            self.inside(&capsules[k], &mut found);
        }
        for k in 0..self.active.len() {
            let i = self.active[k] as usize;
            if self.u[i].norm() > 0.05 * SPACING {
                found.extend_from_slice(self.neighbors(i));
            }
        }
        found.sort_unstable();
        for &i in &found {
            self.wake(i as usize);
        }
        self.found = found;
    }

    /// Nodes whose rest position is inside a capsule.
    fn inside(&self, c: &WorldCapsule, out: &mut Vec<u32>) {
        let mid = nalgebra::center(&c.a, &c.b);
        let reach = c.radius + 0.5 * (c.b - c.a).norm();
        let near = within(&self.tree, &mid.coords.into(), reach);
        out.extend(near.filter(|&i| c.distance(&self.rest[i as usize]).0 < 0.0));
    }

    /// Whether a capsule reaches into the box around the body.
    fn is_near(&self, c: &WorldCapsule) -> bool {
        let [low, high] = self.body.bounds();
        // Neighbors pull nodes out of the box, but never this far.
        let reach = c.radius + 0.02;
        (0..3).all(|k| c.a[k].min(c.b[k]) - reach < high[k] && c.a[k].max(c.b[k]) + reach > low[k])
    }

    /// Force on node `i` at `u` from its spring and its neighbors.
    fn response(&self, i: usize, u: &Vector3<f64>, dt: f64) -> Response {
        let mut r = self.physics.material.response(&self.elements[i], u, dt);
        let tie = TIE * self.mean_stiffness * self.physics.coupling;
        for &j in self.neighbors(i) {
            r.force += (self.u[j as usize] - u) * tie;
            r.slope += tie;
        }
        r
    }

    /// Moves node `i` toward equilibrium, or along the surface that holds it.
    fn relax(&mut self, i: usize, arm: &Meeting<'_>) {
        let r = self.response(i, &self.u[i], arm.dt);
        let mut u = self.u[i] + r.force / r.slope;
        if let Some(hold) = self.holds[i] {
            let x = self.rest[i] + self.u[i];
            let (_, n) = arm.capsules[hold.capsule].distance(&x);
            let pressure = -r.force.dot(&n);
            let along = r.force + n * pressure;
            let excess = along.norm() - self.physics.friction * pressure.max(0.0);
            if pressure < -self.tension(i, &hold) {
                self.holds[i] = None;
            } else if excess > 0.0 {
                u = self.u[i] + along * (excess / (along.norm() * r.slope));
                let (d, n) = arm.capsules[hold.capsule].distance(&(self.rest[i] + u));
                u -= n * d;
            } else {
                u = self.u[i];
            }
        }
        // Out of whatever capsule it is deepest in; twice for creases between two.
        for _ in 0..2 {
            let Some((capsule, d, n)) = deepest(arm.capsules, &self.near, &(self.rest[i] + u))
            else {
                break;
            };
            u -= n * d;
            let dwell = self.holds[i].map_or(0.0, |h| h.dwell);
            self.holds[i] = Some(Hold { capsule, dwell });
        }
        self.u[i] = u;
    }

    /// Tension that the surfaces can bear at node `i` \[N\].
    fn tension(&self, i: usize, hold: &Hold) -> f64 {
        let e = &self.elements[i];
        self.physics.adhesion.map_or(0.0, |(stretch, dwell)| {
            stretch * e.stiffness * e.strength * (1.0 - (-hold.dwell / dwell).exp())
        })
    }

    /// Sum of the ground springs' forces on the nodes \[N\], at the last step.
    #[cfg(test)]
    pub fn ground_force(&self) -> Vector3<f64> {
        let still = |e: &Element| self.physics.material.response(e, &e.u, 1.0).force;
        self.elements.iter().map(still).sum()
    }
}

impl Object for Springs {
    fn reset(&mut self, physics: &Physics) {
        self.physics = physics.clone();
        self.physics.material.typical_stiffness = self.mean_stiffness;
        for (e, p) in self.elements.iter_mut().zip(&self.rest) {
            e.reset();
            self.physics.material.lay_fiber(e, p);
        }
        self.u.fill(Vector3::zeros());
        self.holds.fill(None);
        self.is_active.fill(false);
        self.active.clear();
    }

    fn step(&mut self, arm: &Meeting<'_>, touches: &mut Vec<Touch>) {
        for &i in &self.active {
            let i = i as usize;
            if let Some(hold) = &mut self.holds[i] {
                hold.dwell += arm.dt;
                let c = &arm.capsules[hold.capsule];
                let carried = arm.motion[c.link] * (self.rest[i] + self.u[i]);
                self.u[i] = carried - self.rest[i];
            }
        }
        let mut near = std::mem::take(&mut self.near);
        near.clear();
        near.extend((0..arm.capsules.len()).filter(|&k| self.is_near(&arm.capsules[k])));
        self.near = near;
        self.wake_touched(arm.capsules);
        for _ in 0..SWEEPS {
            for k in 0..self.active.len() {
                self.relax(self.active[k] as usize, arm);
            }
        }
        for &i in &self.active {
            let i = i as usize;
            if let Some(hold) = self.holds[i] {
                touches.push(Touch {
                    link: arm.capsules[hold.capsule].link,
                    point: self.rest[i] + self.u[i],
                    force: self.response(i, &self.u[i], arm.dt).force,
                });
            }
        }
        let material: &Material = &self.physics.material;
        for &i in &self.active {
            let i = i as usize;
            material.commit(&mut self.elements[i], self.u[i], arm.dt);
        }
        let (elements, holds, is_active) = (&self.elements, &self.holds, &mut self.is_active);
        self.active.retain(|&i| {
            let i = i as usize;
            let stays = holds[i].is_some() || !elements[i].is_still();
            is_active[i] = stays;
            stays
        });
    }

    fn recover(&mut self, seconds: f64) {
        const STEPS: usize = 20;
        let motion = Default::default();
        let arm = Meeting {
            capsules: &[],
            motion: &motion,
            dt: seconds / STEPS as f64,
        };
        self.holds.fill(None);
        for _ in 0..STEPS {
            self.step(&arm, &mut Vec::new());
        }
    }

    fn site(&self, from: &Point3<f64>, rng: &mut Pcg64Mcg) -> Option<Site> {
        let center = self.body.center();
        let back = (from - center).xy();
        let heading = back.y.atan2(back.x) + rng.random_range(-1.3..1.3);
        let rise: f64 = rng.random_range(0.1..1.3);
        let out = Vector3::new(
            heading.cos() * rise.cos(),
            heading.sin() * rise.cos(),
            rise.sin(),
        );
        let aside = Vector3::new(
            rng.random_range(-0.04..0.04),
            rng.random_range(-0.04..0.04),
            rng.random_range(-0.03..0.03),
        );
        let point = self.body.ray(&(center + aside + out * 0.5), &-out)?;
        let inward = Unit::new_normalize(-self.body.normal(&point));
        Some(Site {
            point,
            inward,
            depth: 0.04,
        })
    }

    fn overlap(&self, capsule: &WorldCapsule) -> usize {
        let mut found = Vec::new();
        self.inside(capsule, &mut found);
        found.len()
    }

    fn covers(&self, p: &Point3<f64>) -> bool {
        const MARGIN: f64 = 0.01;
        let mut near = within(&self.tree, &p.coords.into(), MARGIN + 0.5 * SPACING);
        near.next().is_some()
    }

    fn bounds(&self) -> [Point3<f64>; 2] {
        self.body.bounds()
    }

    fn scale_stiffness(&mut self, factor: f64) {
        self.elements.iter_mut().for_each(|e| e.stiffness *= factor);
        self.mean_stiffness *= factor;
    }
}

/// The capsule of `near` that a point is deepest in, with the signed distance and normal.
fn deepest(
    capsules: &[WorldCapsule],
    near: &[usize],
    p: &Point3<f64>,
) -> Option<(usize, f64, Vector3<f64>)> {
    // What is held lies on a surface up to rounding.
    const TOUCHING: f64 = -1e-9;
    let mut found = None;
    let mut depth = TOUCHING;
    for &k in near {
        let (d, n) = capsules[k].distance(p);
        if d < depth {
            depth = d;
            found = Some((k, d, n));
        }
    }
    found
}

fn within(
    tree: &ImmutableKdTree<f64, 3>,
    p: &[f64; 3],
    radius: f64,
) -> impl Iterator<Item = u32> + use<> {
    let query = tree
        .query(p)
        .within::<SquaredEuclidean<f64>>(radius * radius);
    query.unsorted().execute().into_iter().map(|n| n.item)
}
