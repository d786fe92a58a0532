use crate::lattice::Lattice;
use crate::{ContactError, GridError, GridOptions, GridReport, GridSdf, MeshOpenness};
use nalgebra::Point3;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;
use vsf_core::TriMesh;

/// Layout of a file: magic, version, key, checksum of the payload, payload; little endian.
const MAGIC: [u8; 8] = *b"VSFGRID\n";
/// To be raised whenever the layout or the way grids are made changes.
const VERSION: u32 = 2;
const HEADER: usize = 8 + 4 + 32 + 32;
/// Numbers (8 bytes each) of the payload before the nodes.
const NUMBERS: usize = 3 + 22;

/// How the cache of grids was used.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum CacheUse {
    /// No cache folder was given.
    Off,
    /// The grid was read from the cache.
    Hit,
    /// The grid was made and stored.
    Stored,
    /// The cached file was unusable, for this reason. The grid was made again and stored.
    Replaced(String),
    /// The grid was made but could not be stored, for this reason.
    NotStored(String),
}

type Made = (GridSdf, GridReport);

/// Reads the grid that belongs to the mesh and the options, or makes and stores it.
pub(crate) fn read_or(
    folder: &Path,
    mesh: &TriMesh,
    options: &GridOptions,
    make: impl FnOnce() -> Result<Made, ContactError>,
) -> Result<Made, ContactError> {
    let key = key(mesh, options);
    let path = folder.join(format!("{}.vsfcache", key.to_hex()));
    let unfit = match read(&path, key.as_bytes(), options) {
        Ok(made) => return Ok(made),
        Err(Unfit::Missing) => None,
        Err(Unfit::Bad(reason)) => Some(reason),
    };
    let (grid, mut report) = make()?;
    report.cache = match (store(folder, &path, key.as_bytes(), &grid, &report), unfit) {
        (Err(error), _) => CacheUse::NotStored(format!("{}: {error}", folder.display())),
        (Ok(()), Some(reason)) => CacheUse::Replaced(reason),
        (Ok(()), None) => CacheUse::Stored,
    };
    Ok((grid, report))
}

/// Hash of everything that the grid depends on.
fn key(mesh: &TriMesh, options: &GridOptions) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&VERSION.to_le_bytes());
    let resolution = options.resolution.unwrap_or(0.0);
    for x in [resolution, options.max_error, options.margin] {
        hasher.update(&x.to_le_bytes());
    }
    for n in [options.max_nodes, mesh.vertices().len(), mesh.faces().len()] {
        hasher.update(&(n as u64).to_le_bytes());
    }
    for x in mesh.vertices().iter().flat_map(|v| v.coords.iter()) {
        hasher.update(&x.to_le_bytes());
    }
    for i in mesh.faces().iter().flatten() {
        hasher.update(&i.to_le_bytes());
    }
    hasher.finalize()
}

enum Unfit {
    Missing,
    Bad(String),
}

fn bad(reason: &str) -> Unfit {
    Unfit::Bad(reason.to_owned())
}

fn read(path: &Path, key: &[u8; 32], options: &GridOptions) -> Result<Made, Unfit> {
    let refused = |e: io::Error| match e.kind() {
        io::ErrorKind::NotFound => Unfit::Missing,
        _ => Unfit::Bad(e.to_string()),
    };
    // A pipe would be waited for.
    if !fs::metadata(path).map_err(refused)?.is_file() {
        return Err(bad("no file"));
    }
    let file = File::open(path).map_err(refused)?;
    // However long the file is, no more is read than a legal one can hold.
    let most = (HEADER + 8 * NUMBERS).saturating_add(options.max_nodes.saturating_mul(4)) as u64;
    let mut bytes = Vec::new();
    let read = file.take(most.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|e| Unfit::Bad(e.to_string()))?;
    if bytes.len() as u64 > most {
        return Err(bad("longer than any grid within max_nodes"));
    }
    parse(&bytes, key, options.max_error)
}

fn parse(bytes: &[u8], key: &[u8; 32], max_error: f64) -> Result<Made, Unfit> {
    let Some((header, payload)) = bytes.split_at_checked(HEADER) else {
        return Err(bad("shorter than its header"));
    };
    if header[..8] != MAGIC {
        return Err(bad("not a grid file"));
    }
    if header[8..12] != VERSION.to_le_bytes() {
        return Err(bad("of another version"));
    }
    if header[12..44] != *key {
        return Err(bad("made for another mesh or other options"));
    }
    if header[44..] != *blake3::hash(payload).as_bytes() {
        return Err(bad("truncated or altered: the checksum differs"));
    }
    let Some((numbers, nodes)) = payload.split_at_checked(8 * NUMBERS) else {
        return Err(bad("shorter than its numbers"));
    };
    let words: Vec<[u8; 8]> = numbers.as_chunks().0.to_vec();
    let dims = [0, 1, 2].map(|a| usize::try_from(u64::from_le_bytes(words[a])).unwrap_or(0));
    let x: Vec<f64> = words[3..].iter().map(|w| f64::from_le_bytes(*w)).collect();
    let values: Vec<f32> = nodes
        .as_chunks()
        .0
        .iter()
        .map(|v| f32::from_le_bytes(*v))
        .collect();
    let count = dims[0]
        .checked_mul(dims[1])
        .and_then(|n| n.checked_mul(dims[2]));
    let fits = count == Some(values.len()) && 4 * values.len() == nodes.len();
    if !fits || dims.iter().any(|n| *n < 2) {
        return Err(bad("its size is not that of its grid"));
    }
    let finite = x.iter().all(|v| v.is_finite()) && values.iter().all(|v| v.is_finite());
    if !finite || x[3] <= 0.0 {
        return Err(bad("it holds numbers out of range"));
    }
    let point = |i: usize| Point3::new(x[i], x[i + 1], x[i + 2]);
    let lattice = Lattice {
        origin: point(0),
        spacing: x[3],
        dims,
    };
    let report = GridReport {
        resolution: x[3],
        nodes: values.len(),
        error: GridError {
            rms: x[10],
            p99: x[11],
            max: x[12],
            normal_median: x[13],
            normal_p95: x[14],
            sure_share: x[15],
            turned_share: x[16],
        },
        reached: x[11] <= max_error,
        openness: MeshOpenness {
            boundary_edges: x[17] as usize,
            edges: x[18] as usize,
            unsure_share: x[19],
            sheet_area: x[20],
            sheet_spacing: x[21],
        },
        cache: CacheUse::Hit,
    };
    Ok((
        GridSdf {
            lattice,
            values,
            lower: point(4),
            upper: point(7),
        },
        report,
    ))
}

fn to_bytes(key: &[u8; 32], grid: &GridSdf, report: &GridReport) -> Vec<u8> {
    let mut payload = Vec::with_capacity(8 * NUMBERS + 4 * grid.values.len());
    for n in grid.lattice.dims {
        payload.extend((n as u64).to_le_bytes());
    }
    let (origin, lower, upper) = (grid.lattice.origin, grid.lower, grid.upper);
    let (error, open) = (&report.error, &report.openness);
    let numbers: [&[f64]; 7] = [
        &[origin.x, origin.y, origin.z, grid.lattice.spacing],
        &[lower.x, lower.y, lower.z, upper.x, upper.y, upper.z],
        &[error.rms, error.p99, error.max],
        &[error.normal_median, error.normal_p95],
        &[error.sure_share, error.turned_share],
        &[open.boundary_edges as f64, open.edges as f64],
        &[open.unsure_share, open.sheet_area, open.sheet_spacing],
    ];
    payload.extend(numbers.concat().iter().flat_map(|x| x.to_le_bytes()));
    payload.extend(grid.values.iter().flat_map(|v| v.to_le_bytes()));

    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(key);
    bytes.extend(blake3::hash(&payload).as_bytes());
    bytes.extend(payload);
    bytes
}

/// Writes a temporary file and renames it, so that no reader sees half a grid.
fn store(
    folder: &Path,
    path: &Path,
    key: &[u8; 32],
    grid: &GridSdf,
    report: &GridReport,
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut options = tempfile::Builder::new();
    options.prefix(".vsf-").suffix(".part");
    // Readable as any other file is, not only by its owner as temporary files are.
    #[cfg(unix)]
    options.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = options.tempfile_in(folder)?;
    // Not through the wrapper, which adds its own name to errors.
    file.as_file_mut().write_all(&to_bytes(key, grid, report))?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}
