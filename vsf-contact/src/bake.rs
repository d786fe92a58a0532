use std::path::PathBuf;

/// How meshes become grids.
#[derive(Debug, Clone, PartialEq)]
pub struct GridOptions {
    /// Spacing of the grid [m], > 0; `None` (default) halves it from 1/16 of the mesh's size until
    /// the measured error reaches `max_error`.
    pub resolution: Option<f64>,
    /// Goal of the automatic resolution [m], > 0, default 0.5 mm.
    pub max_error: f64,
    /// Distance [m] from the mesh up to which the grid reaches, > 0, default 3 cm.
    pub margin: f64,
    /// Most nodes of one grid (4 bytes each), >= 64, default 16 million.
    pub max_nodes: usize,
    /// Folder that keeps finished grids, created when missing; `None` (default) keeps none.
    pub cache_dir: Option<PathBuf>,
}

impl Default for GridOptions {
    fn default() -> Self {
        Self {
            resolution: None,
            max_error: 0.5e-3,
            margin: 0.03,
            max_nodes: 16_000_000,
            cache_dir: None,
        }
    }
}

/// What a grid made from a mesh is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct GridReport {
    /// Spacing of the nodes [m].
    pub resolution: f64,
}
