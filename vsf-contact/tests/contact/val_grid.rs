//! Exact meshes and grids against closed forms: closed, open, and whatever the thread count.

use crate::common::{ball, cube};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;
use std::sync::LazyLock;
use vsf_contact::{ContactError, GridOptions, GridReport, GridSdf, MeshSdf, Sdf, ShapeSdf};
use vsf_core::{Shape, TriMesh};

fn closed_cube() -> TriMesh {
    let (vertices, faces) = cube(0.04);
    TriMesh::new(vertices, faces).unwrap()
}

/// The cube without its top.
fn open_cube() -> TriMesh {
    let (vertices, faces) = cube(0.04);
    TriMesh::new(vertices, faces[2..].to_vec()).unwrap()
}

fn closed_form() -> ShapeSdf {
    let shape = Shape::Box {
        half_extents: Vector3::repeat(0.04),
        rounding: 0.0,
    };
    ShapeSdf::new(&shape, &Isometry3::identity()).unwrap()
}

fn coarse() -> GridOptions {
    GridOptions {
        resolution: Some(4e-3),
        ..Default::default()
    }
}

static GRID: LazyLock<(GridSdf, GridReport)> =
    LazyLock::new(|| GridSdf::bake(&closed_cube(), &coarse()).unwrap());

/// Points of a lattice that meets no symmetry of the shapes.
fn lattice(reach: f64, n: i32) -> impl Iterator<Item = Point3<f64>> {
    let at = move |i: i32| reach * (2.0 * f64::from(i) + 0.93) / f64::from(n) - reach * 0.97;
    (0..n * n * n).map(move |i| Point3::new(at(i % n), at(i / n % n), at(i / n / n)))
}

#[test]
fn exact_mesh_of_a_cube_is_the_box() {
    let (mesh, closed) = (MeshSdf::new(&closed_cube()).unwrap(), closed_form());
    for p in lattice(0.09, 13) {
        let (m, c) = (mesh.sample(&p), closed.sample(&p));
        assert!((m.distance - c.distance).abs() < 1e-12, "{p}: {m:?} {c:?}");
        let winding = if c.distance < 0.0 { 1.0 } else { 0.0 };
        assert!(
            (mesh.winding_number(&p) - winding).abs() < 0.02,
            "{}",
            mesh.winding_number(&p)
        );
        assert!(mesh.distance(&(p - m.distance * m.normal)).abs() < 1e-9);
    }
    let open = mesh.openness();
    assert_eq!((open.boundary_edges, open.edges), (0, 18));
    assert_eq!((open.sheet_area, open.unsure_share), (0.0, 0.0));
}

#[test]
fn grid_of_a_cube_keeps_the_error_it_reports() {
    let ((grid, report), closed) = (&*GRID, closed_form());
    let mut worst = 0.0f64;
    // As far from the surface as the report looks.
    for p in lattice(0.05, 23).filter(|p| closed.distance(p).abs() < 0.01) {
        worst = worst.max((grid.distance(&p) - closed.distance(&p)).abs());
    }
    // Nowhere more than the bound of interpolation; random points miss some of the worst corner.
    assert!(worst <= 0.5 * 3.0f64.sqrt() * 4e-3, "{worst}");
    assert!(
        (0.6..1.1).contains(&(report.error.max / worst)),
        "{worst} {:?}",
        report.error
    );
    assert!(!report.reached && report.error.rms < report.error.p99);
}

#[test]
fn automatic_resolution_reaches_its_goal_on_a_ball() {
    let (radius, mesh) = (0.05, ball(0.05, 4));
    let (grid, report) = GridSdf::bake(&mesh, &GridOptions::default()).unwrap();
    assert!(report.reached && report.error.p99 <= 0.5e-3, "{report:?}");
    assert_eq!(report.openness.boundary_edges, 0);
    for p in lattice(0.06, 17).filter(|p| p.coords.norm() > 0.02) {
        let s = grid.sample(&p);
        let r = p.coords.norm();
        // The flat faces lie up to 0.2 mm inside of the ball.
        assert!((s.distance - (r - radius)).abs() < 0.7e-3, "{p}: {s:?}");
        // So does the normal follow the faces; deep inside a far one may be the nearest.
        assert!(
            s.distance.abs() > 0.01 || s.normal.angle(&p.coords) < 0.1,
            "{p}: {s:?}"
        );
    }
}

#[test]
fn normals_are_the_gradient_of_the_interpolant() {
    let (grid, _) = &*GRID;
    // Also outside of the grid's box, which ends at 0.055.
    for p in lattice(0.12, 15) {
        let (s, h) = (grid.sample(&p), 1e-7);
        let slope = |h: f64| {
            Vector3::from_fn(|a, _| (grid.distance(&(p + Vector3::ith(a, h))) - s.distance) / h)
        };
        let (forward, backward) = (slope(h), slope(-h));
        if (forward - backward).norm() < 1e-4 {
            assert!(
                (forward.normalize() - s.normal).norm() < 1e-4,
                "{p}: {s:?} {forward}"
            );
        }
        assert!((s.normal.norm() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn outside_of_the_grid_the_distance_is_a_lower_bound() {
    let ((grid, report), closed) = (&*GRID, closed_form());
    for p in lattice(0.5, 21).filter(|p| closed.distance(p) > 0.0) {
        let (g, c) = (grid.distance(&p), closed.distance(&p));
        assert!(g <= c + report.error.max, "{p}: {g} {c}");
        assert!(c < 0.1 || g > 0.7 * c, "{p}: {g} {c}");
    }
}

#[test]
fn an_opening_is_closed_by_a_sheet() {
    let mesh = MeshSdf::new(&open_cube()).unwrap();
    let open = mesh.openness();
    assert_eq!(open.boundary_edges, 4);
    assert!(open.unsure_share > 0.01);
    // The square top has 0.0064 m²; the sheet sags into the cube or spans it.
    assert!((0.005..0.009).contains(&open.sheet_area), "{open:?}");
    assert!(mesh.distance(&Point3::new(0.0, 0.0, -0.01)) < -0.02);
    assert!(mesh.distance(&Point3::new(0.0, 0.0, 0.06)) > 0.01);
    // No jump along a line through the middle of the opening.
    let line = |i: i32| mesh.distance(&Point3::new(1e-3, 2e-3, f64::from(i) * 1e-4));
    for i in 0..600 {
        let jump = (line(i + 1) - line(i)).abs();
        assert!(jump < 1e-4 + 1e-3, "{i}: {} {}", line(i), line(i + 1));
    }
}

/// Faces that are turned over are told from openings, all of them or a few.
#[test]
fn turned_faces_are_counted() {
    let (vertices, faces) = cube(0.04);
    let turned = |which: &dyn Fn(usize) -> bool| {
        let turn = |(k, [a, b, c]): (usize, &[u32; 3])| {
            if which(k) { [*a, *c, *b] } else { [*a, *b, *c] }
        };
        let faces = faces.iter().enumerate().map(turn).collect();
        let mesh = TriMesh::new(vertices.clone(), faces).unwrap();
        GridSdf::bake(&mesh, &coarse()).unwrap().1.error
    };
    let all = turned(&|_| true);
    assert_eq!(all.sure_share, 1.0);
    // About half of the points near the surface are inside.
    assert!((0.4..0.5).contains(&all.turned_share), "{all:?}");
    let few = turned(&|k| k >= 6);
    assert!(few.turned_share > 0.01 || few.sure_share < 0.9, "{few:?}");
    for mesh in [closed_cube(), open_cube()] {
        let (_, report) = GridSdf::bake(&mesh, &coarse()).unwrap();
        assert_eq!(report.error.turned_share, 0.0);
    }
}

/// Copies of faces change neither distance nor side, at whichever corner they begin, and the winding number counts
/// them; faces turned both ways have no inside.
#[test]
fn faces_may_come_several_times() {
    let (vertices, faces) = cube(0.04);
    let copied = |turn: fn([u32; 3], usize) -> [u32; 3]| {
        let copies = (0..6).flat_map(|k| faces.iter().map(move |f| turn(*f, k)));
        MeshSdf::new(&TriMesh::new(vertices.clone(), copies.collect()).unwrap()).unwrap()
    };
    let plain = MeshSdf::new(&closed_cube()).unwrap();
    let turning = copied(|[a, b, c], k| [[a, b, c], [b, c, a], [c, a, b]][k % 3]);
    let mostly = copied(|[a, b, c], k| if k % 3 == 1 { [c, b, a] } else { [a, b, c] });
    let two_sided = copied(|[a, b, c], k| if k % 2 == 1 { [c, b, a] } else { [a, b, c] });
    for p in lattice(0.09, 7) {
        let s = plain.sample(&p);
        assert_eq!((turning.sample(&p), mostly.sample(&p)), (s, s));
        assert_eq!(two_sided.distance(&p), s.distance.abs());
        let side = if s.distance < 0.0 { 1.0 } else { 0.0 };
        for (sdf, times) in [(&turning, 6.0), (&mostly, 2.0), (&two_sided, 0.0)] {
            let winding = sdf.winding_number(&p);
            assert!((winding - times * side).abs() < 0.02 * 6.0, "{winding}");
        }
    }
}

#[test]
fn the_grid_is_the_same_for_any_number_of_threads() {
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let (grid, report) = pool.install(|| GridSdf::bake(&open_cube(), &coarse()).unwrap());
        let bits: Vec<u32> = grid.values().iter().map(|v| v.to_bits()).collect();
        (bits, format!("{report:?}"))
    };
    let one = bits(1);
    assert_eq!(one, bits(2));
    assert_eq!(one, bits(3));
}

#[test]
fn what_cannot_be_gridded_is_refused() {
    let point = TriMesh::new(vec![Point3::origin(); 3], vec![[0, 1, 2]]).unwrap();
    assert_eq!(
        MeshSdf::new(&point).unwrap_err(),
        ContactError::EmptyMesh { faces: 1 }
    );
    let fine = GridOptions {
        resolution: Some(1e-9),
        ..Default::default()
    };
    let error = GridSdf::bake(&closed_cube(), &fine).unwrap_err();
    assert!(
        matches!(error, ContactError::GridTooLarge { .. }),
        "{error}"
    );
    let wide = GridOptions {
        margin: 1e300,
        max_nodes: 5000,
        ..Default::default()
    };
    assert!(GridSdf::bake(&closed_cube(), &wide).is_err());
}

#[test]
fn a_cap_on_nodes_is_reported() {
    let options = GridOptions {
        max_error: 1e-5,
        max_nodes: 150_000,
        ..Default::default()
    };
    let (_, report) = GridSdf::bake(&closed_cube(), &options).unwrap();
    assert!(!report.reached && report.nodes <= 150_000, "{report:?}");
}

proptest! {
    #[test]
    fn grid_is_lipschitz_up_to_its_slack(
        p in prop::array::uniform3(-0.08..0.08f64).prop_map(Point3::from),
        step in prop::array::uniform3(-0.02..0.02f64).prop_map(Vector3::from),
    ) {
        let (grid, report) = &*GRID;
        let change = (grid.distance(&(p + step)) - grid.distance(&p)).abs();
        prop_assert!(change <= step.norm() + grid.slack());
        prop_assert!(grid.slack() <= 3.0f64.sqrt() * report.resolution * (1.0 + 1e-12));
    }
}

#[test]
fn meshes_beyond_the_numbers_are_refused() {
    for (half, offset) in [
        (1e-16, 0.0),
        (1e-16, 1.0),
        (1e148, 0.0),
        (1e238, 0.0),
        (1.0, 1e7),
    ] {
        let (vertices, faces) = cube(half);
        let moved = vertices
            .iter()
            .map(|p| p + Vector3::repeat(offset))
            .collect();
        let mesh = TriMesh::new(moved, faces).unwrap();
        let error = MeshSdf::new(&mesh).unwrap_err();
        let is_named = matches!(
            error,
            ContactError::MeshSize { .. } | ContactError::EmptyMesh { .. }
        );
        assert!(is_named, "{half}, {offset}: {error}");
    }
}
