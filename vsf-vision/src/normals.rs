use crate::neighbors::{Neighbors, check_reach};
use crate::{PointCloud, VisionError};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use vsf_core::CoreError;

impl PointCloud {
    /// Unit normals of the surface that the points lie on, turned toward the camera at `eye`.
    ///
    /// A normal is the direction in which the `k` nearest points spread least. `k` is at least 3, commonly
    /// 20, and includes the point itself; if there are fewer points, all are used. Points whose neighbors
    /// all coincide get the direction to the camera.
    ///
    /// # Errors
    /// Fewer than 3 points or neighbors, or a coordinate that is not within -1e100 to 1e100 m.
    ///
    /// # Reference
    /// H. Hoppe et al., *Surface reconstruction from unorganized points*, SIGGRAPH 1992,
    /// doi:10.1145/133994.134011, section 3.1.
    pub fn normals(&self, k: usize, eye: &Point3<f64>) -> Result<Vec<Vector3<f64>>, VisionError> {
        let tree = self.tree(3, k, 3)?;
        check_reach("eye", eye.coords.as_slice())?;
        let k = k.min(self.len());
        let of_point = |p: &Point3<f64>| {
            let mut found = Vec::with_capacity(k);
            tree.nearest(p.coords.as_slice(), k, &mut found);
            let near = || found.iter().map(|n| self.positions[n.index].coords);
            let mean = near().sum::<Vector3<f64>>() / found.len() as f64;
            let spread: Matrix3<f64> = near().map(|q| (q - mean) * (q - mean).transpose()).sum();
            let view = (eye - p).try_normalize(0.0).unwrap_or(Vector3::z());
            if spread.trace() <= 0.0 {
                return view;
            }
            let eigen = SymmetricEigen::new(spread);
            let normal = eigen
                .eigenvectors
                .column(eigen.eigenvalues.imin())
                .into_owned();
            normal * if normal.dot(&view) < 0.0 { -1.0 } else { 1.0 }
        };
        Ok(self.positions.par_iter().map(of_point).collect())
    }

    /// Flags the points that are not outliers.
    ///
    /// A point is kept if its mean distance to its `k` nearest others exceeds the mean of that distance
    /// over all points by no more than `ratio` standard deviations (commonly 2). `k` is at least 1,
    /// commonly 20; if there are fewer points, all are used.
    ///
    /// # Errors
    /// Fewer than 2 points, a `k` of 0, a ratio that is not positive and finite, or a coordinate that is
    /// not within -1e100 to 1e100 m.
    ///
    /// # Reference
    /// R. B. Rusu et al., *Towards 3D point cloud based object maps for household environments*,
    /// Robotics and Autonomous Systems 56, 2008, doi:10.1016/j.robot.2008.08.005, section 3.
    pub fn inliers(&self, k: usize, ratio: f64) -> Result<Vec<bool>, VisionError> {
        if !(ratio > 0.0 && ratio.is_finite()) {
            return Err(CoreError::Parameter {
                name: "outlier ratio",
                value: ratio,
                range: "> 0",
            }
            .into());
        }
        let tree = self.tree(2, k, 1)?;
        let among = k.saturating_add(1).min(self.len());
        let of_point = |p: &Point3<f64>| {
            let mut found = Vec::with_capacity(among);
            tree.nearest(p.coords.as_slice(), among, &mut found);
            let sum: f64 = found.iter().map(|n| n.squared.sqrt()).sum();
            // The nearest is the point itself, or one at the same place.
            sum / (found.len() - 1) as f64
        };
        let distances: Vec<f64> = self.positions.par_iter().map(of_point).collect();
        let n = distances.len() as f64;
        let mean = distances.iter().sum::<f64>() / n;
        let variance = distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n;
        let most = mean + ratio * variance.sqrt();
        Ok(distances.iter().map(|d| *d <= most).collect())
    }

    /// For `k` neighbors each, where there are at least so many points and neighbors.
    fn tree(&self, points: usize, k: usize, neighbors: usize) -> Result<Neighbors, VisionError> {
        for (what, got, least) in [("points", self.len(), points), ("neighbors", k, neighbors)] {
            if got < least {
                return Err(CoreError::TooFew { what, got, least }.into());
            }
        }
        let rows: Vec<f64> = (self.positions.iter())
            .flat_map(|p| [p.x, p.y, p.z])
            .collect();
        check_reach("coordinate of the point cloud", &rows)?;
        Neighbors::new(&rows, 3)
    }
}
