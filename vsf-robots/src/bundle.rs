use crate::{RobotError, file, mesh, resource, urdf};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use urdf_rs::Geometry;

/// Collects the files of a robot, to be written into a folder of their own.
///
/// Each file comes with its path in that folder: first the URDF, then the meshes of its collision
/// shapes. The returned URDF refers to the meshes by relative paths, so that the robot can be read from there
/// without `packages`. Visual meshes are left out.
///
/// `packages` are as in [`UrdfOptions::packages`](crate::UrdfOptions::packages).
///
/// # Errors
/// A file that cannot be read, text that is not URDF, or addresses that name no file. Messages name the
/// file.
pub fn urdf_bundle(
    path: impl AsRef<Path>,
    packages: &BTreeMap<String, PathBuf>,
) -> Result<Vec<(PathBuf, Vec<u8>)>, RobotError> {
    let path = path.as_ref();
    let origin = path.display().to_string();
    let mut text = urdf::text_of(path)?;
    let robot = urdf::parse(&text, &origin)?;
    let shapes = robot.links.iter().flat_map(|l| &l.collision);
    let mut addresses: Vec<&str> = shapes
        .filter_map(|c| match &c.geometry {
            Geometry::Mesh { filename, .. } => Some(filename.as_str()),
            _ => None,
        })
        .collect();
    addresses.sort_unstable();
    addresses.dedup();

    let dir = path.parent().unwrap_or(Path::new(""));
    let mut meshes: Vec<(PathBuf, Vec<u8>)> = Vec::new();
    for address in &addresses {
        let source = resource::resolve(address, dir, packages)?;
        let name = source.file_name().unwrap_or_default().to_string_lossy();
        let is_free = |place: &String| {
            let is_other = !addresses.contains(&place.as_str());
            place == address || (is_other && meshes.iter().all(|(p, _)| *p != Path::new(place)))
        };
        let numbered = (1..=addresses.len()).map(|k| format!("meshes/{k}_{name}"));
        let place = std::iter::once(format!("meshes/{name}")).chain(numbered);
        let place = place.into_iter().find(is_free).unwrap_or_default();
        text = renamed(&text, address, &place).ok_or_else(|| RobotError::Urdf {
            origin: origin.clone(),
            reason: format!("the address {address:?} is not written plainly"),
        })?;
        let bytes = file::read(&source, mesh::MAX_LENGTH)?;
        meshes.push((place.into(), bytes));
    }
    meshes.sort();
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    meshes.insert(0, (name, text.into_bytes()));
    Ok(meshes)
}

/// Replaces the value `from` by `to` in all attributes; `None` if no attribute has this value.
fn renamed(text: &str, from: &str, to: &str) -> Option<String> {
    let escape = |s: &str| s.replace('&', "&amp;").replace('<', "&lt;");
    let (from, to) = (escape(from), escape(to));
    let mut renamed = text.to_owned();
    for quote in ['"', '\''] {
        let quoted = |s: &str| format!("{quote}{s}{quote}");
        renamed = renamed.replace(&quoted(&from), &quoted(&to));
    }
    (renamed != text || from == to).then_some(renamed)
}
