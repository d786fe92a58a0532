use crate::{ContactConfig, Sdf};
use nalgebra::{Point3, Vector3};

/// Newton corrections of a projection to the surface.
const PROJECTION_STEPS: usize = 4;
/// Largest gap (m) whose correction is not confirmed by another sample: it is exact for a distance,
/// and leaves a small share of the gap for an interpolated one.
const PROJECTION_TOLERANCE: f64 = 2e-5;
/// Tangential displacement that always sticks (m): rounding without friction.
const STICK_TOLERANCE: f64 = 1e-9;
/// A run of several slip steps is beyond a bend when the normal has turned by more than this (rad),
/// or the gap to the surface at its end is more than this share of its length.
const MAX_TURN: f64 = 0.15;
const MAX_GAP: f64 = 0.1;
/// Least share of the decrease of `|u|²` on a plane that a slip step must reach.
const WEDGED: f64 = 0.05;

/// A link's surface, offset by the threshold, in the frame of the link.
pub(crate) struct Surface<'a> {
    pub sdf: &'a dyn Sdf,
    pub config: &'a ContactConfig,
}

/// A place on that surface, and the normal there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Anchor {
    pub place_L: Point3<f64>,
    pub normal_L: Vector3<f64>,
}

/// The displacement `u` of a point, in parts.
struct Pull {
    square: f64,
    normal: f64,
    tangent: Vector3<f64>,
    length: f64,
    /// By how much the tangential part exceeds the friction cone (m).
    excess: f64,
}

impl Pull {
    fn new(a: &Anchor, rest_L: &Point3<f64>, friction: f64) -> Self {
        let u = a.place_L - rest_L;
        let normal = u.dot(&a.normal_L);
        let tangent = u - a.normal_L * normal;
        let length = tangent.norm();
        Self {
            square: u.norm_squared(),
            normal,
            tangent,
            length,
            excess: length - friction * normal - STICK_TOLERANCE,
        }
    }

    /// Slip of a point between two surfaces, which bear `u` in proportion to its parts along their
    /// normals, each with its own friction; `None` when one of them does not bear.
    fn along_crease(
        &self,
        one: &Vector3<f64>,
        other: &Vector3<f64>,
        friction: f64,
    ) -> Option<Slip> {
        let u = one * self.normal + self.tangent;
        let cosine = one.dot(other);
        let (p, q) = (u.dot(one), u.dot(other));
        let sine_squared = 1.0 - cosine * cosine;
        let (a, b) = (
            (p - cosine * q) / sine_squared,
            (q - cosine * p) / sine_squared,
        );
        let along = u - one * a - other * b;
        let length = along.norm();
        (a > 0.0 && b > 0.0).then(|| Slip {
            direction: -along / length.max(STICK_TOLERANCE),
            length,
            excess: length - friction * (a + b) - STICK_TOLERANCE,
            is_single: false,
        })
    }
}

impl Surface<'_> {
    /// The place on the surface next to another one.
    pub fn project(&self, p_L: &Point3<f64>) -> Anchor {
        let (gap, anchor) = self.correct(p_L);
        self.confirm(gap, anchor)
    }

    /// One correction: the gap that it closes, and where it leads.
    fn correct(&self, p_L: &Point3<f64>) -> (f64, Anchor) {
        let s = self.sdf.sample(p_L);
        let gap = s.distance - self.config.level();
        let anchor = Anchor {
            place_L: p_L - s.normal * gap,
            normal_L: s.normal,
        };
        (gap, anchor)
    }

    /// Further corrections, after one that has closed `gap`.
    fn confirm(&self, mut gap: f64, mut anchor: Anchor) -> Anchor {
        for _ in 1..PROJECTION_STEPS {
            if gap.abs() <= PROJECTION_TOLERANCE {
                break;
            }
            (gap, anchor) = self.correct(&anchor.place_L);
        }
        anchor
    }

    /// Slips until the point sticks; false when it detaches.
    ///
    /// Steps are taken in runs of at most a threshold's length, straight along the tangent and back
    /// to the surface. On a plane that is exactly what single steps do. A run that ends beyond a
    /// bend, shortens `u` too little or ends more than a slip step inside of the friction cone is
    /// tried again with fewer steps, at last with one. Where another surface is in the way the point
    /// slips along the crease between the two.
    pub fn slide(&self, a: &mut Anchor, rest_L: &Point3<f64>) -> bool {
        let step = self.config.slip_step;
        let longest = (self.config.threshold / step).max(1.0);
        let mut left = self.config.max_slip_iterations;
        let mut most = longest;
        // Decrease of the excess per way, 1 on a plane.
        let mut rate = 1.0;
        // Along it, when another surface was found in the way.
        let mut crease = None;
        let mut pull = Pull::new(a, rest_L, self.config.friction);
        while pull.normal >= 0.0 && pull.excess > 0.0 && left > 0 {
            let slip = (crease.take()).unwrap_or_else(|| Slip::on_one_surface(&pull));
            if slip.excess <= 0.0 {
                break;
            }
            let wanted = (slip.excess / (rate * step)).ceil();
            let steps = wanted.min(most).min(f64::from(left)).max(1.0);
            let way = (steps * step).min(slip.length);
            let (gap, next) = self.correct(&(a.place_L + slip.direction * way));
            let turn = (next.normal_L - a.normal_L).norm();
            let is_smooth = gap.abs() <= MAX_GAP * way && turn <= MAX_TURN;
            let against = -slip.direction.dot(&next.normal_L);
            let meets_wall = gap < -MAX_GAP * way && turn > MAX_TURN && against > 0.0;
            if slip.is_single && meets_wall {
                let free = way + gap / against;
                if free >= step {
                    most = (free / step).floor();
                    continue;
                }
                crease = pull.along_crease(&a.normal_L, &next.normal_L, self.config.friction);
                if crease.is_some() {
                    rate = 1.0;
                    continue;
                }
            }
            if slip.is_single && steps > 1.0 && !is_smooth && !meets_wall {
                most = (steps / 4.0).floor();
                continue;
            }
            let next = self.confirm(gap, next);
            let there = Pull::new(&next, rest_L, self.config.friction);
            if pull.square - there.square < 2.0 * WEDGED * slip.length * way {
                if steps == 1.0 {
                    break;
                }
                most = (steps / 4.0).floor();
                continue;
            }
            let decrease = pull.excess - there.excess;
            if slip.is_single && steps > 1.0 && there.excess < -step {
                // Back to the first step in the cone, by the secant.
                most = (pull.excess / decrease * steps).ceil().min(steps - 1.0);
                continue;
            }
            rate = if slip.is_single {
                (decrease / way).clamp(0.1, 2.0)
            } else {
                1.0
            };
            most = (2.0 * steps).min(longest);
            left -= steps as u32;
            (*a, pull) = (next, there);
        }
        self.holds(pull.normal, pull.square)
    }

    /// Whether a point stays in contact whose displacement has this part along the normal and this
    /// square: pressed, or pulled no further than it sticks.
    pub fn holds(&self, normal: f64, square: f64) -> bool {
        normal >= 0.0 || square <= self.config.adhesion * self.config.adhesion
    }
}

/// Where a point slips to.
struct Slip {
    direction: Vector3<f64>,
    /// Part of `u` against that direction (m), and by how much friction does not hold it.
    length: f64,
    excess: f64,
    is_single: bool,
}

impl Slip {
    fn on_one_surface(pull: &Pull) -> Self {
        Self {
            direction: -pull.tangent / pull.length,
            length: pull.length,
            excess: pull.excess,
            is_single: true,
        }
    }
}
