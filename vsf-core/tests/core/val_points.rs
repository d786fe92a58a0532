//! The broad-phase grid against brute force.

use proptest::prelude::*;
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_core::{Block, CoreError, RestPoints};

fn found(rest: &RestPoints, lo: Point3<f64>, hi: Point3<f64>) -> Vec<u32> {
    let mut found = Vec::new();
    rest.for_cells_in(&lo, &hi, |cell| {
        for &p in cell.points {
            let distance = (rest.positions()[p as usize] - cell.center).norm();
            assert!(
                distance <= cell.radius,
                "point {p} lies outside its cell's ball"
            );
            found.push(p);
        }
    });
    found.sort_unstable();
    found
}

fn check(positions: Vec<Point3<f64>>, lo: Point3<f64>, hi: Point3<f64>) {
    let rest = RestPoints::new(positions).unwrap();
    let found = found(&rest, lo, hi);
    assert!(
        found.windows(2).all(|w| w[0] < w[1]),
        "a point was visited twice"
    );
    for (i, p) in rest.positions().iter().enumerate() {
        let inside = (0..3).all(|k| lo[k] <= p[k] && p[k] <= hi[k]);
        assert!(
            !inside || found.contains(&(i as u32)),
            "point {i} in the box was missed"
        );
    }
}

/// The points of a block, each of which must lie in the ball of the block.
fn in_block(rest: &RestPoints, block: &Block) -> Vec<u32> {
    let (center, radius) = rest.ball(block);
    let mut points = Vec::new();
    rest.block_points(block, |cell| points.extend_from_slice(cell));
    for &p in &points {
        let distance = (rest.positions()[p as usize] - center).norm();
        assert!(distance <= radius, "point {p} lies outside of its block");
    }
    points.sort_unstable();
    points
}

/// Children share out the points of their parent, down to the cells.
fn check_blocks(rest: &RestPoints, block: &Block) {
    if block.is_cell() {
        assert_eq!(rest.children(block).count(), 0);
        return;
    }
    let children = rest.children(block);
    let mut points: Vec<u32> = children.flat_map(|child| in_block(rest, &child)).collect();
    points.sort_unstable();
    assert_eq!(points, in_block(rest, block));
    rest.children(block)
        .for_each(|child| check_blocks(rest, &child));
}

fn check_tree(positions: Vec<Point3<f64>>) {
    let rest = RestPoints::new(positions).unwrap();
    let all: Vec<u32> = (0..rest.len() as u32).collect();
    let mut held = in_block(&rest, &rest.root());
    held.extend(rest.strays());
    held.sort_unstable();
    assert_eq!(held, all);
    check_blocks(&rest, &rest.root());
}

proptest! {
    #[test]
    fn blocks_share_out_all_points(
        points in prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), 0..300),
        scale in prop::array::uniform3(prop::sample::select(vec![0.0, 1e-3, 1.0, 4e5])),
    ) {
        let scaled = points.iter().map(|p| {
            Point3::from([0, 1, 2].map(|k| 1.0 + scale[k] * p[k]))
        });
        check_tree(scaled.collect());
    }

    #[test]
    fn every_point_in_the_box_is_visited_once(
        points in prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), 0..300),
        flat in prop::array::uniform3(prop::bool::ANY),
        a in prop::array::uniform3(-3.0..3.0f64),
        size in prop::array::uniform3(0.0..4.0f64),
    ) {
        let positions = points.iter().map(|p| {
            Point3::from([0, 1, 2].map(|k| if flat[k] { 0.5 } else { p[k] }))
        });
        let lo = Point3::from(a);
        check(positions.collect(), lo, lo + Vector3::from(size));
    }
}

#[test]
fn coincident_points_and_far_outliers() {
    let mut positions = vec![Point3::new(0.1, 0.2, 0.3); 500];
    check(
        positions.clone(),
        Point3::new(0.0, 0.0, 0.0),
        Point3::new(1.0, 1.0, 1.0),
    );
    positions.push(Point3::new(1e6, -1e6, 1e6));
    check_tree(positions.clone());
    check(
        positions,
        Point3::new(0.0, 0.0, 0.0),
        Point3::new(1.0, 1.0, 1.0),
    );
}

/// The spacing is that of places, however many points are at each.
#[test]
fn repeated_points_keep_their_spacing() {
    let lattice =
        (0..1000).map(|i| 0.01 * Vector3::new(i % 10, i / 10 % 10, i / 100).cast::<f64>());
    let lattice: Vec<Point3<f64>> = lattice.map(Point3::from).collect();
    let spacing = |points: Vec<Point3<f64>>| RestPoints::new(points).unwrap().spacing();
    let plain = spacing(lattice.clone());
    assert!((plain - 0.01).abs() < 1e-12, "{plain}");
    for copies in [&lattice[..600], &lattice[..]] {
        assert_eq!(spacing([&lattice, copies].concat()), plain);
    }
    assert_eq!(spacing(vec![lattice[7]; 5]), 0.0);
}

/// A single point a kilometer off does not make one cell of all others.
#[test]
fn strays_leave_the_grid_as_it_is() {
    let lattice: Vec<_> = (0..8000)
        .map(|i| Point3::new((i / 400) as f64, (i / 20 % 20) as f64, (i % 20) as f64) * 0.01)
        .collect();
    let mut points = lattice.clone();
    points.insert(4321, Point3::new(1e3, -1e3, 1e3));
    points.push(Point3::new(0.0, 1e6, 0.0));
    let [alone, rest] = [lattice, points].map(|p| RestPoints::new(p).unwrap());
    assert_eq!(alone.strays(), []);
    assert_eq!(rest.strays(), [4321, 8001]);
    check_tree(rest.positions().to_vec());
    let (lower, upper) = (Point3::origin(), Point3::origin() + Vector3::repeat(0.03));
    let [few, same] = [&alone, &rest].map(|r| found(r, lower, upper).len());
    assert_eq!(few, same);
    assert!(few < 500, "{few} of 8000 points");
    assert!((rest.spacing() - 0.01).abs() < 1e-12);
    let far = Vector3::repeat(2e3);
    check(rest.positions().to_vec(), lower - far, lower + far);
    // A tenth of the points is a part of the object, wherever it is.
    let two = (0..1000).map(|i| {
        Point3::new(
            if i % 10 == 0 { 1e3 } else { 0.0 },
            0.0,
            0.01 * f64::from(i),
        )
    });
    assert_eq!(RestPoints::new(two.collect()).unwrap().strays(), []);
}

#[test]
fn a_small_box_in_a_large_lattice_visits_few_points() {
    let n = 40;
    let lattice = (0..n * n * n)
        .map(|i| Point3::new((i / n / n) as f64, (i / n % n) as f64, (i % n) as f64) * 0.01);
    let rest = RestPoints::new(lattice.collect()).unwrap();
    let found = found(
        &rest,
        Point3::new(0.1, 0.1, 0.1),
        Point3::new(0.12, 0.12, 0.12),
    );
    assert!(
        found.len() < 400,
        "{} of {} points visited",
        found.len(),
        rest.len()
    );
}

#[test]
fn positions_that_are_not_finite_are_refused() {
    let error = RestPoints::new(vec![Point3::origin(), Point3::new(0.0, f64::NAN, 0.0)]);
    assert_eq!(
        error.unwrap_err().to_string(),
        "rest points[1] is NaN; every value must be finite"
    );
}

#[test]
fn spacing_is_the_typical_nearest_distance() {
    let lattice = (0..1000)
        .map(|i| Point3::new((i / 100) as f64, (i / 10 % 10) as f64, (i % 10) as f64) * 0.02);
    let rest = RestPoints::new(lattice.collect()).unwrap();
    assert!((rest.spacing() - 0.02).abs() < 1e-12);
    // Two scans of one object, that differ by rounding.
    let twice = rest.positions().iter();
    let twice = twice.flat_map(|p| [*p, p + Vector3::new(1e-6, -1e-7, 0.0)]);
    let rest = RestPoints::new(twice.collect()).unwrap();
    assert!((rest.spacing() - 0.02).abs() < 2e-6);
    assert_eq!(
        RestPoints::new(vec![Point3::origin()]).unwrap().spacing(),
        0.0
    );
    assert_eq!(RestPoints::new(Vec::new()).unwrap().spacing(), 0.0);
    for value in [1.1e6, -1e155, f64::MAX] {
        let error = RestPoints::new(vec![Point3::origin(), Point3::new(0.0, value, 0.0)]);
        assert_eq!(error.unwrap_err(), CoreError::TooFar { index: 1, value });
    }
    let far = vec![Point3::origin(), Point3::new(1e6, 0.0, 0.0)];
    assert_eq!(RestPoints::new(far).unwrap().spacing(), 1e6);
    let ends = [-1e6, 1e6].map(|x| Point3::new(x, 0.0, 0.0));
    check_tree(ends.to_vec());
    assert_eq!(RestPoints::new(ends.to_vec()).unwrap().spacing(), 2e6);
}

/// Clouds so small that no cell size is a normal number are one cell.
#[test]
fn clouds_of_no_size_are_one_cell() {
    for extent in [5e-324, 1e-310, 1e-300] {
        let points = (0..64).map(|i| Point3::new(f64::from(i % 2) * extent, 0.0, 0.0));
        let rest = RestPoints::new(points.collect()).unwrap();
        let far = Vector3::repeat(1.0);
        assert_eq!(
            found(&rest, Point3::origin() - far, Point3::origin() + far).len(),
            64
        );
    }
}

/// Lattices, random clouds, surfaces and lines are no clusters; pairs are, however near.
#[test]
fn pairs_are_told_from_clouds() {
    let of = |points: Vec<Point3<f64>>| RestPoints::new(points).unwrap().clustering();
    let lattice: Vec<Point3<f64>> = (0..1000)
        .map(|i| Point3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64) * 0.005)
        .collect();
    let line = (0..100).map(|i| Point3::new(0.01 * i as f64, 0.0, 0.0));
    let random = (0..2000).map(|i| {
        let of = |share: f64| (f64::from(i) * share).fract();
        Point3::new(of(0.754_877), of(0.569_840), of(0.312_345))
    });
    let sheet = lattice
        .iter()
        .map(|p| Point3::new(p.x, p.y, 0.0) + Vector3::z() * 0.1 * p.z);
    for (points, at_most) in [
        (lattice.clone(), 1.8),
        (line.collect(), 4.1),
        (sheet.collect(), 15.0),
        (random.collect(), 4.0),
    ] {
        let found = of(points).unwrap();
        assert!((1.0..at_most).contains(&found), "{found}");
    }
    for apart in [1e-9, 1e-6, 1e-4] {
        let moved = lattice.iter().map(|p| p + Vector3::x() * apart);
        let found = of(lattice.iter().copied().chain(moved).collect()).unwrap();
        assert!((found * apart / 0.005 - 1.0).abs() < 0.5, "{found}");
    }
    // The very same places do not count.
    assert!(of([&lattice[..], &lattice[..]].concat()).unwrap() < 1.8);
    assert_eq!(of(lattice[..8].to_vec()), None);
}
