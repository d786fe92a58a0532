//! Deviation of the built-in Gen3's collision shapes from the maker's meshes, both ways.

use nalgebra::{Isometry3, Point3, Vector3};
use std::io::Write;
use std::path::Path;
use vsf_core::{Shape, TriMesh};
use vsf_robots::{RobotModel, UrdfOptions, kinova_gen3};

type P3 = Point3<f64>;
type V3 = Vector3<f64>;

/// Rays shot at each link; a quarter to a half of them find a point that counts.
const RAYS: usize = 800;

/// Where a link meets the next one: origin of that joint, direction out of the link [m]. The last
/// columns bound what the next link hides, as depth along that direction and distance from it.
type Face = (&'static str, [f64; 3], [f64; 3], f64, f64);

#[rustfmt::skip]
const DISTAL_FACES: [Face; 7] = [
    // The top of the base is an open cup, which the shoulder fills.
    ("Base_Link",            [0.0, 0.0, 0.15643],          [0.0, 0.0, 1.0],  -0.017, 0.0445),
    ("Shoulder_Link",        [0.0, 0.005375, -0.12838],    [0.0, 1.0, 0.0],  0.011,  0.047),
    ("HalfArm1_Link",        [0.0, -0.21038, -0.006375],   [0.0, -1.0, 0.0], 0.011,  0.047),
    ("HalfArm2_Link",        [0.0, 0.006375, -0.21038],    [0.0, 1.0, 0.0],  0.011,  0.047),
    ("ForeArm_Link",         [0.0, -0.20843, -0.006375],   [0.0, -1.0, 0.0], 0.011,  0.047),
    ("SphericalWrist1_Link", [0.0, 0.00017505, -0.10593],  [0.0, 1.0, 0.0],  0.011,  0.047),
    ("SphericalWrist2_Link", [0.0, -0.10593, -0.00017505], [0.0, -1.0, 0.0], 0.011,  0.047),
];

/// Whether a neighbor hides the point, inside it or face to face.
fn hidden(link: &str, p_L: &P3) -> bool {
    let within = |origin: P3, out: V3, depth: f64, radius: f64| {
        let along = (p_L - origin).dot(&out);
        along > depth && (p_L - origin - along * out).norm() < radius
    };
    let collar = link != "Base_Link" && within(P3::origin(), V3::z(), -0.0155, 0.047);
    let face = DISTAL_FACES.iter().find(|f| f.0 == link);
    collar || face.is_some_and(|f| within(f.1.into(), f.2.into(), f.3, f.4))
}

/// Rays that enter a box, uniform over all lines that meet it, as origin and direction.
fn rays(low: P3, high: P3) -> impl Iterator<Item = (P3, V3)> {
    // Kronecker sequence in five dimensions: x^6 = x + 1.
    const X: f64 = 1.134_724_138_401_519_4;
    let e = high - low;
    let areas = [e.y * e.z, e.z * e.x, e.x * e.y];
    (1..=RAYS).map(move |k| {
        let u = |i: i32| (0.5 + k as f64 * X.powi(-i)).fract();
        // A face in proportion to its area, a point on it, and Lambert's cosine law for directions.
        let mut pick = 2.0 * u(1) * areas.iter().sum::<f64>();
        let side = (0..5).find(|s| {
            pick -= areas[s % 3];
            pick < 0.0
        });
        let side = side.unwrap_or(5);
        let (x, y, z) = ((side + 1) % 3, (side + 2) % 3, side % 3);
        let (mut origin, mut d) = (low, V3::zeros());
        origin[x] += u(2) * e[x];
        origin[y] += u(3) * e[y];
        let (r, angle) = (u(4).sqrt(), std::f64::consts::TAU * u(5));
        d[x] = r * angle.cos();
        d[y] = r * angle.sin();
        d[z] = (1.0 - r * r).sqrt();
        if side >= 3 {
            origin[z] = high[z];
            d[z] = -d[z];
        }
        (origin, d)
    })
}

/// Signed distance of a point to a primitive in its own frame.
fn signed_distance(shape: &Shape, p: &P3) -> f64 {
    let r = p.x.hypot(p.y);
    let outside = |d: V3| d.sup(&V3::zeros()).norm() + d.max().min(0.0);
    match *shape {
        Shape::Sphere { radius } => p.coords.norm() - radius,
        Shape::Capsule {
            radius,
            half_length,
        } => r.hypot((p.z.abs() - half_length).max(0.0)) - radius,
        Shape::RoundCone {
            radius_bottom,
            radius_top,
            half_length,
        } => {
            // The nearest of all balls of the sweep, by ternary search.
            let ball = |t: f64| {
                let radius = radius_bottom + (radius_top - radius_bottom) * t;
                r.hypot(p.z - half_length * (2.0 * t - 1.0)) - radius
            };
            let (mut a, mut b) = (0.0, 1.0);
            for _ in 0..80 {
                let (s, t) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
                if ball(s) < ball(t) { b = t } else { a = s }
            }
            ball((a + b) / 2.0)
        }
        Shape::Cylinder {
            radius,
            half_length,
            rounding: q,
        } => outside(V3::new(r - radius + q, p.z.abs() - half_length + q, -1.0)) - q,
        Shape::Box {
            half_extents,
            rounding: q,
        } => outside(p.coords.abs() - half_extents.add_scalar(-q)) - q,
        _ => panic!("not a primitive: {shape:?}"),
    }
}

type Placed = (Isometry3<f64>, Shape);

fn union(shapes: &[Placed], p_L: &P3) -> f64 {
    let each = shapes
        .iter()
        .map(|(X, s)| signed_distance(s, &X.inverse_transform_point(p_L)));
    each.fold(f64::INFINITY, f64::min)
}

/// First point of the union along a ray, by sphere tracing.
fn trace(shapes: &[Placed], origin: &P3, d: &V3, length: f64) -> Option<P3> {
    let mut t = 0.0;
    while t < length {
        let distance = union(shapes, &(origin + t * d));
        if distance < 1e-6 {
            return Some(origin + t * d);
        }
        t += distance;
    }
    None
}

/// Corners of a triangle and a ball that holds it.
struct Triangle([P3; 3], P3, f64);

fn triangles(mesh: &TriMesh) -> Vec<Triangle> {
    let corners = |f: &[u32; 3]| f.map(|i| mesh.vertices()[i as usize]);
    let triangle = |c: [P3; 3]| {
        let center = P3::from((c[0].coords + c[1].coords + c[2].coords) / 3.0);
        let radius = c.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        Triangle(c, center, radius)
    };
    mesh.faces().iter().map(corners).map(triangle).collect()
}

/// First point of the mesh along a ray, seen from either side of its faces.
fn cast(mesh: &[Triangle], origin: &P3, d: &V3) -> Option<P3> {
    let mut first = f64::INFINITY;
    for Triangle([a, b, c], center, radius) in mesh {
        let w = center - origin;
        let along = w.dot(d);
        if w.norm_squared() - along * along > radius * radius {
            continue;
        }
        // Cramer's rule for origin + t d = a + u (b - a) + v (c - a).
        let (ab, ac, ao) = (b - a, c - a, origin - a);
        let det = ab.dot(&d.cross(&ac));
        let u = ao.dot(&d.cross(&ac)) / det;
        let v = d.dot(&ao.cross(&ab)) / det;
        let t = ac.dot(&ao.cross(&ab)) / det;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 {
            first = first.min(t);
        }
    }
    first.is_finite().then(|| origin + first * d)
}

fn distance_to_mesh(mesh: &[Triangle], p: &P3) -> f64 {
    let to_segment = |a: &P3, b: &P3| {
        let ab = b - a;
        let t = ((p - a).dot(&ab) / ab.norm_squared()).clamp(0.0, 1.0);
        (p - a - t * ab).norm()
    };
    let mut best = f64::INFINITY;
    for Triangle([a, b, c], center, radius) in mesh {
        if (p - center).norm() - radius > best {
            continue;
        }
        let n = (b - a).cross(&(c - a));
        let above = |a: &P3, b: &P3| n.cross(&(b - a)).dot(&(p - a)) >= 0.0;
        let distance = if n.norm() > 0.0 && above(a, b) && above(b, c) && above(c, a) {
            ((p - a).dot(&n) / n.norm()).abs()
        } else {
            let edges = [to_segment(a, b), to_segment(b, c), to_segment(c, a)];
            edges.into_iter().fold(f64::INFINITY, f64::min)
        };
        best = best.min(distance);
    }
    best
}

/// Deviations [mm] of the mesh from the shapes and of the shapes from the mesh, each over what can
/// be seen from outside and no neighbor hides.
fn deviations(link: &str, mesh: &TriMesh, shapes: &[Placed]) -> [Vec<f64>; 2] {
    let margin = V3::repeat(0.02);
    let corner =
        |pick: fn(&P3, &P3) -> P3| mesh.vertices().iter().copied().reduce(|a, b| pick(&a, &b));
    let low = corner(|a, b| a.inf(b)).unwrap() - margin;
    let high = corner(|a, b| a.sup(b)).unwrap() + margin;
    let length = (high - low).norm();
    let mesh = triangles(mesh);
    let mut found = [Vec::new(), Vec::new()];
    for (origin, d) in rays(low, high) {
        let seen = |p: &P3| !hidden(link, p);
        if let Some(p) = cast(&mesh, &origin, &d).filter(seen) {
            found[0].push(1e3 * union(shapes, &p).abs());
        }
        if let Some(p) = trace(shapes, &origin, &d, length).filter(seen) {
            found[1].push(1e3 * distance_to_mesh(&mesh, &p));
        }
    }
    found
}

/// Median, 90th percentile and maximum.
fn summary(values: &[f64]) -> [f64; 3] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    [sorted[n / 2], sorted[n * 9 / 10], sorted[n - 1]]
}

fn shapes_of(robot: &RobotModel, link: &str) -> Vec<Placed> {
    let index = robot.link_index(link).unwrap();
    let own = robot.colliders().iter().filter(|c| c.link == index);
    own.map(|c| (c.X_LS, c.shape.clone())).collect()
}

#[test]
fn the_shapes_lie_on_the_meshes() {
    let urdf = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/kinova_gen3/kinova_gen3.urdf");
    if !urdf.exists() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: the maker's meshes are not on this machine"
        );
        return;
    }
    let maker = RobotModel::from_urdf_file(&urdf, &UrdfOptions::default()).unwrap();
    let ours = kinova_gen3().unwrap();
    let mut last_four = [Vec::new(), Vec::new()];
    for (k, link) in maker.links()[1..9].iter().map(|l| l.name()).enumerate() {
        let meshes = shapes_of(&maker, link);
        let [(X_LS, Shape::Mesh(mesh))] = &meshes[..] else {
            panic!("{link}: one mesh expected")
        };
        assert_eq!(*X_LS, Isometry3::identity());
        let found = deviations(link, mesh, &shapes_of(&ours, link));
        for (values, all) in found.iter().zip(&mut last_four) {
            let [median, p90, max] = summary(values);
            eprintln!(
                "{link:21} {:4} {median:.2} {p90:.2} {max:.2} mm",
                values.len()
            );
            assert!(values.len() > RAYS / 8, "{link}");
            assert!(median < 0.8 && p90 < 2.5 && max < 7.0, "{link}");
            if k >= 4 {
                all.extend(values);
            }
        }
    }
    for values in &last_four {
        let [median, p90, max] = summary(values);
        eprintln!(
            "last four links       {:4} {median:.2} {p90:.2} {max:.2} mm",
            values.len()
        );
        assert!(median < 0.4 && p90 < 1.5 && max < 6.0);
    }
}
