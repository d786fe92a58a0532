//! Views against closed forms: pinhole geometry, planes, spheres, boxes that hide what is behind.

use proptest::prelude::*;
use vsf_core::CoreError;
use vsf_core::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use vsf_vision::{
    Bounds, Camera, OcclusionGrid, PointCloud, RgbdView, Seen, Sight, Visibility, VisionError, lab,
};

const SIZE: (usize, usize) = (160, 120);

/// At (0, 0, 1), looking along x: world x is depth, world -y right, world -z down.
fn camera() -> Camera {
    let axes = UnitQuaternion::from_basis_unchecked(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
    Camera {
        fx: 120.0,
        fy: 120.0,
        cx: 79.5,
        cy: 59.5,
        X_WC: Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0), axes),
    }
}

/// Renders the depth (m) that `hit` gives for the ray through each pixel, 0 where there is none.
fn view(hit: impl Fn(&Point3<f64>, &Vector3<f64>) -> f64) -> RgbdView {
    let camera = camera();
    let eye = Point3::from(camera.X_WC.translation.vector);
    let depth: Vec<u16> = (0..SIZE.0 * SIZE.1)
        .map(|i| {
            let (u, v) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            // One meter along z, so that the parameter of the ray is the depth.
            let ray = camera.unproject(u, v, 1.0) - eye;
            (hit(&eye, &ray) * 1e4).round() as u16
        })
        .collect();
    let color: Vec<u8> = (0..SIZE.0 * SIZE.1)
        .flat_map(|i| [(i % 200) as u8, 50, 7])
        .collect();
    RgbdView::new(camera, SIZE, &color, &depth, 1e-4).unwrap()
}

fn sphere(eye: &Point3<f64>, ray: &Vector3<f64>) -> f64 {
    let from = eye - Point3::new(1.0, 0.0, 1.0);
    let (a, b, c) = (
        ray.norm_squared(),
        ray.dot(&from),
        from.norm_squared() - 0.04,
    );
    let root = b * b - a * c;
    if root < 0.0 {
        0.0
    } else {
        (-b - root.sqrt()) / a
    }
}

fn around_sphere() -> Bounds {
    Bounds::new(Point3::new(0.7, -0.3, 0.7), Point3::new(1.3, 0.3, 1.3)).unwrap()
}

proptest! {
    #[test]
    fn projecting_undoes_unprojecting(u in -50.0f64..200.0, v in -50.0f64..200.0, z in 0.1f64..9.0) {
        let p_W = camera().unproject(u, v, z);
        let (pu, pv, pz) = camera().project(&p_W).unwrap();
        prop_assert!((pu - u).abs() < 1e-8 && (pv - v).abs() < 1e-8 && (pz - z).abs() < 1e-10);
    }
}

#[test]
fn axes_are_those_of_opencv() {
    let middle = camera().unproject(79.5, 59.5, 2.0);
    assert!((middle - Point3::new(2.0, 0.0, 1.0)).norm() < 1e-12);
    let right = camera().unproject(79.5 + 120.0, 59.5, 2.0);
    assert!((right - Point3::new(2.0, -2.0, 1.0)).norm() < 1e-12);
    let below = camera().unproject(79.5, 59.5 + 60.0, 2.0);
    assert!((below - Point3::new(2.0, 0.0, 0.0)).norm() < 1e-12);
    assert!(camera().project(&Point3::new(-1.0, 0.0, 1.0)).is_none());
}

#[test]
fn the_cloud_of_a_sphere_lies_on_it() {
    let cloud = view(sphere).cloud(&around_sphere());
    assert!(cloud.len() > 1000);
    let center = Point3::new(1.0, 0.0, 1.0);
    for p in &cloud.positions {
        assert!(((p - center).norm() - 0.2).abs() < 1.5e-4, "{p}");
        assert!(p.x < 1.0);
    }
    let narrow = Bounds::new(Point3::new(0.7, 0.0, 0.7), Point3::new(1.3, 0.3, 1.3)).unwrap();
    let half = view(sphere).cloud(&narrow);
    assert!(half.positions.iter().all(|p| narrow.contains(p)) && half.len() < cloud.len());
}

#[test]
fn normals_of_a_sphere_point_outward() {
    let cloud = view(sphere).cloud(&around_sphere());
    let eye = Point3::new(0.0, 0.0, 1.0);
    let normals = cloud.normals(12, &eye).unwrap();
    for (p, n) in cloud.positions.iter().zip(&normals) {
        let radial = (p - Point3::new(1.0, 0.0, 1.0)) / 0.2;
        assert!((n.norm() - 1.0).abs() < 1e-9);
        // Where the surface turns away from the camera its neighbors lie to one side.
        if radial.x < -0.5 {
            assert!(radial.dot(n) > 0.97, "{p}: {n}");
        }
    }
}

#[test]
fn outliers_stand_apart() {
    let mut cloud = view(sphere).cloud(&around_sphere());
    let clean = cloud.len();
    for k in 0..3 {
        cloud
            .positions
            .push(Point3::new(0.75, 0.25, 0.72 + 0.25 * f64::from(k)));
        cloud.colors.push([255; 3]);
    }
    let keep = cloud.inliers(10, 3.0).unwrap();
    assert!(keep[clean..].iter().all(|k| !k));
    let lost = keep[..clean].iter().filter(|k| !**k).count();
    assert!(lost * 50 < clean, "{lost} of {clean}");
    assert_eq!(cloud.filtered(&keep).unwrap().len(), clean - lost);
}

#[test]
fn downsampling_keeps_one_mean_per_cube() {
    let at = |x: f64| Point3::new(x, 0.5, -0.5);
    let cloud = PointCloud {
        positions: vec![at(0.1), at(0.3), at(1.5), at(-0.1)],
        colors: vec![[10, 0, 0], [20, 0, 0], [7, 8, 9], [1, 1, 1]],
    };
    let thin = cloud.downsampled(1.0).unwrap();
    assert_eq!(thin.colors, [[1, 1, 1], [15, 0, 0], [7, 8, 9]]);
    assert!((thin.positions[1] - at(0.2)).norm() < 1e-12);
    let mut reversed = cloud.clone();
    reversed.positions.reverse();
    reversed.colors.reverse();
    assert_eq!(reversed.downsampled(1.0).unwrap().colors, thin.colors);
    for wrong in [0.0, -1.0, f64::NAN, 1e-20, 1e-320] {
        assert!(cloud.downsampled(wrong).is_err());
    }
    let mut lost = cloud.clone();
    lost.positions[2].y = f64::NAN;
    assert!(matches!(
        lost.downsampled(1.0),
        Err(CoreError::NotFinite { index: 2, .. })
    ));
}

/// What each cell is by the exact ray from the eye to its center.
#[test]
fn cells_around_a_sphere_are_free_on_it_or_behind() {
    let bounds = around_sphere();
    let grid = OcclusionGrid::new(&view(sphere), &bounds, [40; 3]).unwrap();
    let reach = 0.5 * grid.edges().norm();
    let eye = Point3::new(0.0, 0.0, 1.0);
    let mut counts = [0; 3];
    for (i, &cell) in grid.cells().iter().enumerate() {
        let ray = (grid.center(i) - eye) / grid.center(i).x;
        let depth = sphere(&eye, &ray);
        let expected = match grid.center(i).x - depth {
            _ if depth == 0.0 => Visibility::Free,
            behind if behind < -reach => Visibility::Free,
            behind if behind <= reach => Visibility::Surface,
            _ => Visibility::Occluded,
        };
        counts[0] += 1;
        // A pixel is 8 mm wide here: at the rim of the sphere that decides.
        let rim =
            ((grid.center(i) - eye).cross(&Vector3::x()).norm() / grid.center(i).x - 0.2).abs();
        if cell != expected {
            counts[1] += 1;
            counts[2] += usize::from(rim > 0.02);
        }
    }
    let [all, wrong, inside] = counts;
    assert!(wrong * 50 < all, "{wrong} of {all}");
    assert!(inside * 100 < all, "{inside} of {all}");
    let (points, surface) = grid.rest_points(&view(sphere).cloud(&bounds));
    let hidden = grid.centers(Visibility::Occluded).count();
    assert_eq!(points.len(), surface + hidden);
    assert!(hidden > 5000);
}

#[test]
fn what_is_not_in_the_picture_may_be_there() {
    let bounds = Bounds::new(Point3::new(-2.0, -0.1, 0.9), Point3::new(-1.0, 0.1, 1.1)).unwrap();
    let behind = OcclusionGrid::new(&view(sphere), &bounds, [3; 3]).unwrap();
    assert!(behind.cells().iter().all(|c| *c == Visibility::Occluded));
    let empty = OcclusionGrid::new(&view(|_, _| 0.0), &around_sphere(), [3; 3]).unwrap();
    assert!(empty.cells().iter().all(|c| *c == Visibility::Free));
    assert!(OcclusionGrid::new(&view(sphere), &bounds, [3, 0, 3]).is_err());
    assert!(OcclusionGrid::new(&view(sphere), &bounds, [usize::MAX; 3]).is_err());
}

#[test]
fn points_are_seen_hidden_or_unknown() {
    // The surface is at 0.8; the first point lies in the air before it.
    let points = [0.79, 0.797, 0.8, 0.85].map(|x| Point3::new(x, 0.0, 1.0));
    let away = Point3::new(-1.0, 0.0, 1.0);
    let all = [points[0], points[1], points[2], points[3], away];
    let seen = Seen::new(&view(sphere), &all, 0.004).unwrap();
    assert_eq!(seen.visible, [false, true, true, false, false]);
    let occupancy = seen.occupancy(0.05).unwrap();
    assert_eq!(occupancy[..3], [0.0, 1.0, 1.0]);
    assert!(
        (occupancy[3] - (-1.0f64).exp()).abs() < 0.01,
        "{occupancy:?}"
    );
    assert_eq!(occupancy[4], 0.0);
    let without_fading = seen.occupancy(f64::INFINITY).unwrap();
    assert_eq!(without_fading, [0.0, 1.0, 1.0, 1.0, 0.0]);
    assert!(seen.occupancy(0.0).is_err());
    assert!(Seen::new(&view(sphere), &points, -1.0).is_err());
    assert_eq!(view(sphere).sight(&away), Sight::Outside);
}

#[test]
fn refuses_images_and_cameras_that_do_not_fit() {
    let new = |camera: Camera, color: usize, depth: usize, scale: f64| {
        RgbdView::new(camera, (2, 2), &vec![0; color], &vec![0; depth], scale)
    };
    assert!(new(camera(), 12, 4, 0.001).is_ok());
    assert!(new(camera(), 11, 4, 0.001).is_err());
    assert!(new(camera(), 12, 5, 0.001).is_err());
    assert!(new(camera(), 12, 4, 0.0).is_err());
    let wrong = [
        Camera {
            fx: 0.0,
            ..camera()
        },
        Camera {
            fy: f64::NAN,
            ..camera()
        },
        Camera {
            cx: f64::INFINITY,
            ..camera()
        },
    ];
    assert!(wrong.into_iter().all(|c| new(c, 12, 4, 0.001).is_err()));
    let flat = Point3::new(0.0, 1.0, 1.0);
    assert!(Bounds::new(Point3::origin(), flat).is_err());
    let few = PointCloud {
        positions: vec![flat; 2],
        colors: vec![[0; 3]; 2],
    };
    assert!(matches!(
        few.normals(5, &flat),
        Err(VisionError::Core(CoreError::TooFew { .. }))
    ));
    assert!(few.inliers(0, 1.0).is_err() && few.inliers(1, f64::NAN).is_err());
    assert!(few.inliers(5, 1.0).is_ok());
    assert!(few.inliers(1, f64::INFINITY).is_err());
    let none = few.inliers(0, 2.0).unwrap_err();
    assert_eq!(none.to_string(), "0 neighbors, at least 1 are needed");
}

#[test]
fn more_neighbors_than_points_are_all_points() {
    let cloud = view(sphere).cloud(&around_sphere());
    let cloud = cloud.downsampled(0.05).unwrap();
    let eye = Point3::new(0.0, 0.0, 1.0);
    let all = cloud.normals(cloud.len(), &eye).unwrap();
    let kept = cloud.inliers(cloud.len() - 1, 2.0).unwrap();
    for k in [1 << 40, usize::MAX] {
        assert_eq!(cloud.normals(k, &eye).unwrap(), all);
        assert_eq!(cloud.inliers(k, 2.0).unwrap(), kept);
    }
}

#[test]
fn refuses_clouds_that_are_none() {
    let eye = Point3::new(0.0, 0.0, 1.0);
    let at = |x: f64| Point3::new(x, -x, 0.5 * x);
    let cloud = |scale: f64| PointCloud {
        positions: (1..6).map(|i| at(scale * f64::from(i))).collect(),
        colors: vec![[0; 3]; 5],
    };
    for wrong in [1e200, f64::NAN] {
        assert!(cloud(wrong).normals(3, &eye).is_err());
        assert!(cloud(wrong).inliers(3, 2.0).is_err());
        assert!(cloud(1.0).normals(3, &at(wrong)).is_err());
    }
    let normals = cloud(1.0).normals(3, &at(1e99)).unwrap();
    assert!(normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-9));
    let mut bare = cloud(1.0);
    bare.colors.truncate(2);
    let expected = "colors has length 2, expected 5";
    for lost in [bare.filtered(&[true; 5]), bare.downsampled(0.1)] {
        assert_eq!(lost.unwrap_err().to_string(), expected);
    }
}

#[test]
fn a_grid_has_cells_along_every_edge() {
    let grid = |dims| OcclusionGrid::new(&view(sphere), &around_sphere(), dims).unwrap_err();
    let flat = grid([0, 1, 1]).to_string();
    assert_eq!(flat, "cells along an edge = 0.0 is out of range: >= 1");
    let huge = grid([usize::MAX; 3]).to_string();
    assert!(huge.ends_with("are more than the 1073741824 that are supported"));
    assert_eq!(grid([0, usize::MAX, 2]).to_string(), flat);
}

/// Values of B. Lindbloom's CIE color calculator (sRGB, D65), to its rounding.
#[test]
fn lab_of_known_colors() {
    for (rgb, expected) in [
        ([255, 0, 0], [53.24, 80.09, 67.20]),
        ([0, 255, 0], [87.73, -86.18, 83.18]),
        ([0, 0, 255], [32.30, 79.19, -107.86]),
        ([0, 0, 0], [0.0, 0.0, 0.0]),
    ] {
        let found = lab(rgb);
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 0.05, "{rgb:?}: {found:?}");
        }
    }
}
