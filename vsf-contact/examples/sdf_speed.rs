//! Bakes the STL meshes given on the command line and prints accuracy and speed.
//!
//! `cargo run --release -p vsf-contact --example sdf_speed -- forearm.stl bracelet.stl`

use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;
use vsf_contact::{Batch, GridOptions, GridSdf, MeshSdf, Sdf, ShapeSdf, UnionSdf};
use vsf_core::{Shape, TriMesh};

fn main() -> Result<(), Box<dyn Error>> {
    let capsules = (0..8)
        .map(|i| {
            let shape = Shape::Capsule {
                radius: 0.04,
                half_length: 0.03,
            };
            ShapeSdf::new(
                &shape,
                &Isometry3::translation(0.0, 0.0, 0.04 * f64::from(i)),
            )
        })
        .collect::<Result<Vec<_>, _>>()?;
    speed("union of 8 capsules", &UnionSdf::new(capsules), 1000);

    let options = GridOptions::default();
    for path in std::env::args().skip(1) {
        let mesh = read_stl(&path)?;
        println!("{path}: {} faces", mesh.faces().len());
        let started = Instant::now();
        let exact = MeshSdf::new(&mesh)?;
        println!("  MeshSdf {:.2} s", started.elapsed().as_secs_f64());
        let started = Instant::now();
        let (grid, report) = GridSdf::bake(&mesh, &options)?;
        println!("  GridSdf {:.2} s", started.elapsed().as_secs_f64());
        println!("  {report:#?}");
        speed("grid", &grid, 1000);
        speed("mesh", &exact, 10);
    }
    Ok(())
}

/// Time of a sample at random points within a body's box: the least mean of many short runs.
fn speed(name: &str, sdf: &dyn Sdf, runs: usize) {
    let (lower, upper) = sdf.bounds();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let (mut sample, mut distance, mut united) = (f64::MAX, f64::MAX, f64::MAX);
    let mut batch = Batch::new();
    for _ in 0..runs {
        let points: [Point3<f64>; 1000] = std::array::from_fn(|_| {
            let t = Vector3::from_fn(|_, _| rng.random::<f64>());
            lower + (upper - lower).component_mul(&t)
        });
        let mean = |f: &dyn Fn(&Point3<f64>)| {
            let started = Instant::now();
            points.iter().for_each(f);
            started.elapsed().as_secs_f64() / points.len() as f64
        };
        sample = sample.min(mean(&|p| {
            black_box(sdf.sample(black_box(p)));
        }));
        distance = distance.min(mean(&|p| {
            black_box(sdf.distance(black_box(p)));
        }));
        batch.clear();
        points
            .iter()
            .take(Batch::CAPACITY)
            .for_each(|p| batch.push(p));
        let started = Instant::now();
        sdf.unite(black_box(&mut batch));
        united = united.min(started.elapsed().as_secs_f64() / batch.len() as f64);
    }
    println!(
        "  {name}: sample {:.1} ns, distance {:.1} ns, sample in a batch {:.1} ns",
        1e9 * sample,
        1e9 * distance,
        1e9 * united
    );
}

fn read_stl(path: &str) -> Result<TriMesh, Box<dyn Error>> {
    let stl = stl_io::read_stl(&mut std::fs::File::open(path)?)?;
    let vertices = stl
        .vertices
        .iter()
        .map(|v| Point3::from(v.0.map(f64::from)))
        .collect();
    let faces = stl
        .faces
        .iter()
        .map(|f| f.vertices.map(|i| i as u32))
        .collect();
    Ok(TriMesh::new(vertices, faces)?)
}
