//! How long occlusion and extrapolation take: `cargo run --release -p vsf-vision --example
//! vision_speed`.

use std::error::Error;
use std::time::Instant;
use vsf_core::Belief;
use vsf_core::nalgebra::{Isometry3, Point3};
use vsf_vision::{Bounds, Camera, Extrapolation, KnnRegressor, OcclusionGrid, RgbdView, Seen};

/// The quickest of five runs (s).
fn quickest<T>(mut run: impl FnMut() -> Result<T, Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    let mut least = f64::INFINITY;
    for _ in 0..5 {
        let start = Instant::now();
        run()?;
        least = least.min(start.elapsed().as_secs_f64());
    }
    Ok(least)
}

fn main() -> Result<(), Box<dyn Error>> {
    // A wavy surface 1 m away, colored in bands.
    let (width, height) = (640, 480);
    let camera = Camera {
        fx: 500.0,
        fy: 500.0,
        cx: 319.5,
        cy: 239.5,
        X_WC: Isometry3::identity(),
    };
    let pixels = || (0..width * height).map(|i| (i % width, i / width));
    let depth: Vec<u16> = pixels()
        .map(|(u, v)| {
            (1000.0 + 30.0 * ((u as f64) / 40.0).sin() * ((v as f64) / 30.0).cos()) as u16
        })
        .collect();
    let color: Vec<u8> = pixels()
        .flat_map(|(u, v)| [(u / 3 % 256) as u8, (v / 2 % 256) as u8, 60])
        .collect();
    let view = RgbdView::new(camera, (width, height), &color, &depth, 0.001)?;
    let bounds = Bounds::new(Point3::new(-0.25, -0.25, 0.8), Point3::new(0.25, 0.25, 1.3))?;
    let grid = quickest(|| Ok(OcclusionGrid::new(&view, &bounds, OcclusionGrid::CELLS)?))?;
    println!("occlusion of 100 x 100 x 100 cells: {:.0} ms", 1e3 * grid);

    let coarse = OcclusionGrid::new(&view, &bounds, [55; 3])?;
    let surface = view.cloud(&bounds).downsampled(0.006)?;
    let (points, _) = coarse.rest_points(&surface);
    let seen = Seen::new(&view, &points, 0.004)?;
    let touched: Vec<bool> = points.iter().map(|p| p.x < -0.2 && p.z < 1.1).collect();
    let level = |t: &bool| if *t { 8.0 } else { 0.0 };
    let doubt = |t: &bool| if *t { 4.0 } else { 100.0 };
    let field = Belief::new(
        touched.iter().map(level).collect(),
        touched.iter().map(doubt).collect(),
    )?;
    let mut knn = Extrapolation::new(KnnRegressor::default(), KnnRegressor::default());
    let all = quickest(|| Ok(knn.extend(&points, &seen, &field, &touched, 100.0)?))?;
    println!(
        "extrapolation from {} touched points to {} points, 200 neighbors: {:.0} ms",
        touched.iter().filter(|t| **t).count(),
        points.len(),
        1e3 * all
    );
    Ok(())
}
