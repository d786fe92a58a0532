use crate::mesh_distance::{Triangle, corners};
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::PI;

/// Triangles that a leaf of the tree sums one by one.
const LEAF: usize = 8;
/// A cluster farther than this many of its radii is replaced by its expansion.
const FAR: f64 = 3.0;

/// Generalized winding number of a triangle mesh: 1 inside, 0 outside, in between near openings.
///
/// Near triangles contribute their exact solid angle, far clusters the first two terms of their
/// expansion. The error is below 0.02, far less than the distance of 0 and 1 from 1/2.
///
/// # Reference
/// Jacobson, Kavan, Sorkine-Hornung: Robust inside-outside segmentation using generalized winding
/// numbers, 2013, doi:10.1145/2461912.2461916. Barill et al.: Fast winding numbers for soups and
/// clouds, 2018, doi:10.1145/3197517.3201337, eq. 13-15.
pub(crate) struct WindingTree {
    triangles: Vec<Triangle>,
    clusters: Vec<Cluster>,
}

/// A leaf holds few triangles, or many copies of one, which is evaluated once.
struct Cluster {
    center: Point3<f64>,
    radius: f64,
    /// Sum of the area vectors.
    dipole: Vector3<f64>,
    /// Sum of (centroid - center) (area vector)^T.
    quadrupole: Matrix3<f64>,
    first: usize,
    len: usize,
    /// How often the triangles of a leaf count.
    times: f64,
    /// Index of the second child (the first one follows its parent); 0 in a leaf.
    second_child: usize,
}

impl WindingTree {
    pub fn new(triangles: Vec<Triangle>) -> Self {
        let mut tree = Self {
            triangles,
            clusters: Vec::new(),
        };
        if !tree.triangles.is_empty() {
            tree.grow(0, tree.triangles.len());
        }
        tree
    }

    fn grow(&mut self, first: usize, len: usize) {
        let id = self.clusters.len();
        self.clusters
            .push(cluster(&self.triangles[first..first + len], first));
        let part = &mut self.triangles[first..first + len];
        if let Some(times) = copies(part) {
            (self.clusters[id].len, self.clusters[id].times) = (1, times);
            return;
        }
        if len <= LEAF {
            return;
        }
        let (lower, upper) = part.iter().map(centroid).fold(
            (
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ),
            |(lower, upper), c| (lower.inf(&c.coords), upper.sup(&c.coords)),
        );
        let axis = (upper - lower).imax();
        // Stable sorts: the same input gives the same tree on every machine.
        if lower == upper {
            part.sort_by_key(corners);
        } else {
            part.sort_by(|a, b| centroid(a)[axis].total_cmp(&centroid(b)[axis]));
        }
        let half = len / 2;
        self.grow(first, half);
        self.clusters[id].second_child = self.clusters.len();
        self.grow(first + half, len - half);
    }

    /// The winding number at `p`.
    pub fn at(&self, p: &Point3<f64>) -> f64 {
        if self.clusters.is_empty() {
            return 0.0;
        }
        let (mut sum, mut near) = (0.0, Angles::default());
        // The tree halves its triangles, so that its depth stays below 32.
        let mut stack = [0usize; 40];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let id = stack[top];
            let c = &self.clusters[id];
            let r = c.center - p;
            let distance_squared = r.norm_squared();
            if distance_squared > (FAR * c.radius).powi(2) {
                sum += c.expansion(&r, distance_squared);
            } else if c.second_child == 0 {
                let triangles = &self.triangles[c.first..c.first + c.len];
                let halves = triangles.iter().map(|t| half_solid_angle(t, p));
                if c.times == 1.0 {
                    halves.for_each(|half| near.add(half));
                } else {
                    sum += c.times * halves.map(|[x, y]| 2.0 * y.atan2(x)).sum::<f64>();
                }
            } else {
                stack[top] = id + 1;
                stack[top + 1] = c.second_child;
                top += 2;
            }
        }
        (sum + 2.0 * near.sum()) / (4.0 * PI)
    }
}

impl Cluster {
    fn expansion(&self, r: &Vector3<f64>, r2: f64) -> f64 {
        let inverse3 = 1.0 / (r2 * r2.sqrt());
        let first = self.dipole.dot(r);
        let second = self.quadrupole.trace() - 3.0 * (self.quadrupole * r).dot(r) / r2;
        (first + second) * inverse3
    }
}

fn cluster(triangles: &[Triangle], first: usize) -> Cluster {
    let area_vectors = triangles
        .iter()
        .map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)));
    let (mut total, mut weighted) = (0.0, Vector3::zeros());
    for (t, n) in triangles.iter().zip(area_vectors.clone()) {
        total += n.norm();
        weighted += n.norm() * centroid(t).coords;
    }
    let center = if total > 0.0 {
        Point3::from(weighted / total)
    } else {
        triangles[0][0]
    };
    let mut dipole = Vector3::zeros();
    let mut quadrupole = Matrix3::zeros();
    let mut radius = 0.0f64;
    for (t, n) in triangles.iter().zip(area_vectors) {
        dipole += n;
        quadrupole += (centroid(t) - center) * n.transpose();
        radius = t.iter().fold(radius, |r, v| r.max((v - center).norm()));
    }
    Cluster {
        center,
        radius,
        dipole,
        quadrupole,
        first,
        len: triangles.len(),
        times: 1.0,
        second_child: 0,
    }
}

/// How often the first triangle counts if all others are copies of it: +1 for every copy, whichever corner it starts
/// at, and -1 for every copy that is turned over. `None` if there is a different triangle.
fn copies(triangles: &[Triangle]) -> Option<f64> {
    let [a, b, c] = triangles[0];
    let turn = |t: &Triangle| {
        if [[a, b, c], [b, c, a], [c, a, b]].contains(t) {
            Some(1.0)
        } else if [[c, b, a], [b, a, c], [a, c, b]].contains(t) {
            Some(-1.0)
        } else {
            None
        }
    };
    triangles.iter().map(turn).sum()
}

fn centroid(t: &Triangle) -> Point3<f64> {
    Point3::from((t[0].coords + t[1].coords + t[2].coords) / 3.0)
}

/// A complex number whose angle is half the signed solid angle of a triangle (van Oosterom, Strackee 1983,
/// doi:10.1109/TBME.1983.325207).
fn half_solid_angle(t: &Triangle, p: &Point3<f64>) -> [f64; 2] {
    let [a, b, c] = [t[0] - p, t[1] - p, t[2] - p];
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let volume = a.dot(&b.cross(&c));
    let scale = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    [scale, volume]
}

/// A sum of angles of complex numbers: the angle of their product, plus the full turns lost by it. It takes one arctangent
/// in total.
struct Angles {
    product: [f64; 2],
    turns: f64,
}

impl Default for Angles {
    fn default() -> Self {
        Self {
            product: [1.0, 0.0],
            turns: 0.0,
        }
    }
}

impl Angles {
    /// Adds the angle of a number, from -pi to pi. Zero adds nothing; a number that is not finite makes the sum NaN.
    #[inline]
    fn add(&mut self, [x, y]: [f64; 2]) {
        let [a, b] = self.product;
        let (re, im) = (a * x - b * y, a * y + b * x);
        let size = re.abs() + im.abs();
        if size == 0.0 {
            return;
        }
        // Turning forward by at most half a turn, a product leaves the upper half-plane only across pi; turning
        // backward, the lower one only across -pi. The sign of a zero counts.
        let [forward, above, ends_above] = [y, b, im].map(f64::is_sign_positive);
        if forward && above && !ends_above {
            self.turns += 1.0;
        } else if !forward && !above && ends_above {
            self.turns -= 1.0;
        }
        self.product = [re / size, im / size];
    }

    fn sum(&self) -> f64 {
        let [x, y] = self.product;
        y.atan2(x) + 2.0 * PI * self.turns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(numbers: &[[f64; 2]]) {
        let mut sum = Angles::default();
        numbers.iter().for_each(|z| sum.add(*z));
        let expected: f64 = numbers.iter().map(|[x, y]| y.atan2(*x)).sum();
        assert!(
            (sum.sum() - expected).abs() < 1e-11,
            "{numbers:?}: {} not {expected}",
            sum.sum()
        );
    }

    proptest! {
        #[test]
        fn val_angles_of_products(parts in prop::collection::vec((-PI..PI, 1e-12..1e3), 0..300)) {
            let number = |(angle, size): &(f64, f64)| [size * angle.cos(), size * angle.sin()];
            check(&parts.iter().map(number).collect::<Vec<_>>());
        }
    }

    /// Whose products lie at half a turn, on either side.
    #[test]
    fn val_angles_of_eighths_of_a_turn() {
        let eighths = [
            [0.0, 0.0],
            [1.0, 0.0],
            [1.0, -0.0],
            [-1.0, 0.0],
            [-1.0, -0.0],
            [0.0, 1.0],
            [0.0, -1.0],
            [1.0, 1.0],
            [1.0, -1.0],
            [-1.0, 1.0],
            [-1.0, -1.0],
        ];
        for a in eighths {
            for b in eighths {
                for c in eighths {
                    eighths.iter().for_each(|d| check(&[a, b, c, *d]));
                }
            }
        }
        let mut beyond = Angles::default();
        beyond.add([f64::NAN, 1.0]);
        beyond.add([1.0, 1.0]);
        assert!(beyond.sum().is_nan());
    }

    /// A query near a triangle asks all clusters around it, so that copies must not make any.
    #[test]
    fn copies_make_no_clusters() {
        let corner = |k: usize| Point3::new((k % 3) as f64, (k % 5) as f64, (k % 7) as f64);
        let faces = (0..64).map(|k| [corner(k), corner(k + 1), corner(k + 2)]);
        let copied: Vec<Triangle> = (0..1000)
            .flat_map(|k| {
                faces
                    .clone()
                    .map(move |[a, b, c]| [[a, b, c], [b, c, a], [c, b, a]][k % 3])
            })
            .collect();
        let asked: usize = WindingTree::new(copied)
            .clusters
            .iter()
            .map(|c| c.len)
            .filter(|n| *n <= LEAF)
            .sum();
        assert!(asked < 1000, "{asked} of 64000");
    }
}
