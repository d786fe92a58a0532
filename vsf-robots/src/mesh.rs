use crate::{RobotError, file};
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;
use vsf_core::TriMesh;

/// Largest file that is read (bytes): 20 million triangles.
pub(crate) const MAX_LENGTH: u64 = 1 << 30;

/// How files begin that stand for what was not fetched.
const LFS_POINTER: &[u8] = b"version https://git-lfs";

/// Three corners of every face.
type Corners = Vec<[Point3<f64>; 3]>;

/// Reads an STL (binary or text) or OBJ file and scales it. Equal vertices are welded into one, as
/// STL repeats a vertex in each of its faces; faces are kept as they are.
pub(crate) fn load(path: &Path, scale: &Vector3<f64>) -> Result<TriMesh, RobotError> {
    let format = path.extension().unwrap_or_default().to_ascii_lowercase();
    let corners = match format.to_str() {
        Some("stl" | "obj") => {
            let bytes = file::read(path, MAX_LENGTH)?;
            if bytes.starts_with(LFS_POINTER) {
                let why = "it only points to the mesh, in Git LFS; fetch that with `git lfs pull`";
                Err(why.to_owned())
            } else if format == "stl" {
                stl(bytes)
            } else {
                obj(&bytes)
            }
        }
        _ => Err("unknown format; convert it to STL or OBJ".to_owned()),
    };
    corners
        .and_then(|corners| weld(corners, scale))
        .map(|mesh| mesh.with_source(path.display().to_string()))
        .map_err(|reason| RobotError::Mesh {
            path: path.to_owned(),
            reason,
        })
}

const STL_HEADER: usize = 80;

fn stl(mut bytes: Vec<u8>) -> Result<Corners, String> {
    let count = bytes
        .get(STL_HEADER..STL_HEADER + 4)
        .and_then(|b| <[u8; 4]>::try_from(b).ok())
        .map(u32::from_le_bytes);
    let length = count.map(|n| STL_HEADER as u64 + 4 + 50 * u64::from(n));
    // Binary files may begin with "solid" as text does; their length tells.
    let is_binary = length == Some(bytes.len() as u64);
    if !is_binary && bytes.starts_with(b"solid") {
        return stl_text(&bytes);
    }
    if let (Some(n), Some(length)) = (count, length)
        && let Some(left @ 1..) = (bytes.len() as u64).checked_sub(length)
    {
        return Err(format!(
            "{left} bytes are left behind the {n} faces that its header counts"
        ));
    }
    if is_binary {
        // The reader takes any file that begins with "solid " for text.
        bytes[..STL_HEADER].fill(0);
    }
    stl_faces(bytes)
}

/// Text holds one solid or several, one after another.
fn stl_text(bytes: &[u8]) -> Result<Corners, String> {
    let mut corners = Vec::new();
    let mut solid = Vec::new();
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let words = line.trim_ascii();
        if solid.is_empty() && words.is_empty() {
            continue;
        }
        // The reader asks for a space where a solid has no name.
        solid.extend_from_slice(if words == b"solid" { b"solid \n" } else { line });
        if words.starts_with(b"endsolid") {
            corners.extend(stl_faces(std::mem::take(&mut solid))?);
        }
    }
    if solid.is_empty() {
        Ok(corners)
    } else {
        Err("not a complete STL file: it ends without endsolid".to_owned())
    }
}

fn stl_faces(bytes: Vec<u8>) -> Result<Corners, String> {
    let mut cursor = Cursor::new(bytes);
    stl_io::create_stl_reader(&mut cursor)
        .and_then(|faces| {
            faces
                .map(|face| Ok(face?.vertices.map(|v| v.0).map(point)))
                .collect()
        })
        .map_err(|e| format!("not a complete STL file: {e}"))
}

fn obj(bytes: &[u8]) -> Result<Corners, String> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    // Materials say nothing about shape.
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &options, no_materials)
        .map_err(|e| format!("not a valid OBJ file: {e}"))?;
    let mut corners = Vec::new();
    for mesh in models.iter().map(|m| &m.mesh) {
        for face in mesh.indices.chunks_exact(3) {
            let mut face_corners = [Point3::origin(); 3];
            for (corner, &i) in face_corners.iter_mut().zip(face) {
                let at = 3 * i as usize;
                let xyz = mesh.positions.get(at..at + 3);
                let xyz = xyz.and_then(|p| <[f32; 3]>::try_from(p).ok());
                *corner = point(xyz.ok_or_else(|| format!("a face names vertex {i}"))?);
            }
            corners.push(face_corners);
        }
    }
    Ok(corners)
}

fn point(xyz: [f32; 3]) -> Point3<f64> {
    Point3::from(xyz.map(f64::from))
}

fn weld(corners: Corners, scale: &Vector3<f64>) -> Result<TriMesh, String> {
    if scale.iter().any(|s| *s == 0.0 || !s.is_finite()) {
        return Err(format!(
            "scale {:?} must be finite and not zero",
            scale.as_slice()
        ));
    }
    let mirrored = scale.product() < 0.0;
    let (mut vertices, mut faces) = (Vec::new(), Vec::with_capacity(corners.len()));
    let mut index_of: HashMap<[u64; 3], u32> = HashMap::new();
    for face in &corners {
        let mut indices = [0; 3];
        for (index, p) in indices.iter_mut().zip(face) {
            // Adding 0 turns -0 into +0: both are the same place.
            let p = Point3::from(p.coords.component_mul(scale).add_scalar(0.0));
            let key = [p.x, p.y, p.z].map(f64::to_bits);
            let next = u32::try_from(vertices.len()).map_err(|_| "too many vertices")?;
            *index = *index_of.entry(key).or_insert(next);
            if *index == next {
                vertices.push(p);
            }
        }
        if mirrored {
            indices.swap(1, 2);
        }
        faces.push(indices);
    }
    if faces.is_empty() {
        return Err("it has no faces".to_owned());
    }
    TriMesh::new(vertices, faces).map_err(|e| e.to_string())
}
