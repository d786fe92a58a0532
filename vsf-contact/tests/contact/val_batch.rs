//! Batches give the same bits as single points, whatever else is in them.

use crate::common::Floor;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::sync::{Arc, LazyLock};
use vsf_contact::{
    Batch, ContactConfig, GridOptions, GridSdf, LinkSdf, MeshSdf, Sdf, SdfSample, ShapeSdf,
    StickSlip, UnionSdf,
};
use vsf_core::{ContactModel, Contacts, LinkChains, Posture, RestPoints, Shape, TriMesh};

fn shapes() -> Vec<ShapeSdf> {
    let half_extents = Vector3::new(0.05, 0.08, 0.03);
    let cone = |radius_bottom, radius_top, half_length| Shape::RoundCone {
        radius_bottom,
        radius_top,
        half_length,
    };
    let cylinder = |rounding| Shape::Cylinder {
        radius: 0.04,
        half_length: 0.06,
        rounding,
    };
    let cuboid = |rounding| Shape::Box {
        half_extents,
        rounding,
    };
    let capsule = Shape::Capsule {
        radius: 0.03,
        half_length: 0.06,
    };
    let shapes = [
        Shape::Sphere { radius: 0.05 },
        capsule,
        cone(0.05, 0.02, 0.06),
        cone(0.02, 0.05, 0.02),
        cylinder(0.0),
        cylinder(0.015),
        cuboid(0.0),
        cuboid(0.02),
        // As near as the one before wherever they are.
        cuboid(0.02),
    ];
    let pose = |i: usize| {
        let a = i as f64;
        Isometry3::from_parts(
            Translation3::new(0.02 * a, -0.01 * a, 0.0),
            UnitQuaternion::from_euler_angles(0.3 * a, 0.5 * a, 0.0),
        )
    };
    let posed = shapes.iter().enumerate();
    posed
        .map(|(i, s)| ShapeSdf::new(s, &pose(i / 2 * 2)).unwrap())
        .collect()
}

/// A tetrahedron.
fn mesh() -> TriMesh {
    let vertices = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]];
    let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    TriMesh::new(vertices.map(Point3::from).to_vec(), faces).unwrap()
}

static BODIES: LazyLock<Vec<Box<dyn Sdf>>> = LazyLock::new(|| {
    let options = GridOptions {
        resolution: Some(0.01),
        ..GridOptions::default()
    };
    let grid = || GridSdf::bake(&mesh(), &options).unwrap().0;
    let mut bodies: Vec<Box<dyn Sdf>> = Vec::new();
    for shape in shapes() {
        bodies.push(Box::new(shape));
    }
    let mixed: [Box<dyn Sdf>; 4] = [
        Box::new(UnionSdf::new(shapes())),
        Box::new(grid()),
        Box::new(Arc::new(Floor)),
        Box::new(UnionSdf::<ShapeSdf>::new(Vec::new())),
    ];
    bodies.push(Box::new(UnionSdf::new(Vec::from(mixed))));
    bodies.push(Box::new(UnionSdf::new(shapes())));
    bodies.push(Box::new(UnionSdf::<ShapeSdf>::new(Vec::new())));
    bodies.push(Box::new(MeshSdf::new(&mesh()).unwrap()));
    bodies.push(Box::new(grid()));
    bodies.push(Box::new(Floor));
    bodies
});

/// Anywhere near the bodies, often on an axis, a plane of symmetry or in a center.
fn place() -> impl Strategy<Value = Point3<f64>> {
    let coordinate = || prop_oneof![2 => -0.3..0.3f64, 1 => Just(0.0), 1 => Just(1e-120)];
    prop::array::uniform3(coordinate()).prop_map(Point3::from)
}

fn bits(sample: &SdfSample) -> [u64; 4] {
    let [x, y, z] = sample.normal.into();
    [sample.distance, x, y, z].map(f64::to_bits)
}

proptest! {
    #[test]
    fn a_batch_gives_the_samples_of_its_places(
        places in prop::collection::vec(place(), 0..=Batch::CAPACITY),
    ) {
        for body in BODIES.iter() {
            let mut batch = Batch::new();
            places.iter().for_each(|p| batch.push(p));
            prop_assert_eq!(batch.len(), places.len());
            body.unite(&mut batch);
            for (i, p) in places.iter().enumerate() {
                prop_assert_eq!(batch.place(i), *p);
                prop_assert_eq!(bits(&batch.sample(i)), bits(&body.sample(p)));
            }
        }
    }

    #[test]
    fn a_batch_keeps_the_first_of_the_nearest(
        places in prop::collection::vec(place(), 1..=Batch::CAPACITY),
    ) {
        let mut batch = Batch::new();
        places.iter().for_each(|p| batch.push(p));
        let mut together = batch.clone();
        BODIES.iter().for_each(|body| body.unite(&mut batch));
        // Those that are farther away than another one's box are left out.
        UnionSdf::new(BODIES.iter().collect()).unite(&mut together);
        for (i, p) in places.iter().enumerate() {
            let samples = BODIES.iter().map(|body| body.sample(p));
            let nearest = samples.reduce(|a, b| if b.distance < a.distance { b } else { a });
            let nearest = bits(&nearest.unwrap());
            prop_assert_eq!(bits(&batch.sample(i)), nearest);
            prop_assert_eq!(bits(&together.sample(i)), nearest);
        }
    }
}

/// Two links of several parts each close in on a lattice of points and turn.
fn contacts(points: Vec<Point3<f64>>) -> Vec<Contacts> {
    let rest = RestPoints::new(points).unwrap();
    let links = (0..2).map(|link| LinkSdf {
        link,
        sdf: Arc::new(UnionSdf::new(shapes())),
    });
    let links: Vec<LinkSdf> = links.collect();
    let mut model = StickSlip::new(links, ContactConfig::default()).unwrap();
    let chains = LinkChains::new(0, vec![Vec::new(); 2]).unwrap();
    let mut posture = Posture::new(Arc::new(chains));
    let pose = |side: f64, t: f64| {
        let turn = UnitQuaternion::from_euler_angles(0.5 * t, side * t, 0.2);
        Isometry3::from_parts(
            Translation3::new(side * (0.3 - 0.2 * t), 0.0, 0.05 * t),
            turn,
        )
    };
    let mut step = |i: u32| {
        let t = f64::from(i) / 20.0;
        let poses = [pose(1.0, t), pose(-1.0, t)];
        posture.parts_mut().1.copy_from_slice(&poses);
        let mut out = Contacts::new();
        model.step(&rest, &posture, &mut out).unwrap();
        out
    };
    (0..=20).map(&mut step).collect()
}

#[test]
fn contact_of_a_point_does_not_depend_on_the_others() {
    let points: Vec<Point3<f64>> = (0..27_000)
        .map(|i| {
            let at = |i: i32| 0.01 * f64::from(i - 15);
            Point3::new(at(i / 900), at(i / 30 % 30), at(i % 30))
        })
        .collect();
    let all = contacts(points.clone());
    assert!(all.iter().map(Contacts::len).max().unwrap() > 2000);
    for every in [7, 40] {
        let some = contacts(points.iter().step_by(every).copied().collect());
        assert!(some.iter().map(Contacts::len).max().unwrap() > 10);
        for (all, some) in all.iter().zip(&some) {
            let mut found = 0;
            for k in 0..all.len() {
                let point = all.points()[k] as usize;
                if point.is_multiple_of(every) {
                    assert_eq!(some.points()[found] as usize, point / every);
                    assert_eq!(some.links()[found], all.links()[k]);
                    assert_eq!(some.displacements()[found], all.displacements()[k]);
                    assert_eq!(some.normals()[found], all.normals()[k]);
                    found += 1;
                }
            }
            assert_eq!(found, some.len());
        }
    }
}
