use crate::RobotError;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Path of the file that `uri` names: `package://name/...` (looked up in `packages`), `file://...`, or
/// a path. Relative paths start at `dir`.
pub(crate) fn resolve(
    uri: &str,
    dir: &Path,
    packages: &BTreeMap<String, PathBuf>,
) -> Result<PathBuf, RobotError> {
    if let Some(rest) = uri.strip_prefix("package://") {
        let (package, inside) = rest.split_once('/').unwrap_or((rest, ""));
        return match packages.get(package) {
            Some(folder) => Ok(folder.join(inside)),
            None => Err(RobotError::UnknownPackage {
                uri: uri.to_owned(),
                package: package.to_owned(),
            }),
        };
    }
    let path = uri.strip_prefix("file://").unwrap_or(uri);
    if path.contains("://") {
        return Err(RobotError::UnsupportedUri {
            uri: uri.to_owned(),
        });
    }
    Ok(dir.join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_become_paths() {
        let packages = BTreeMap::from([("arm".to_owned(), PathBuf::from("/opt/arm"))]);
        let at = |uri| resolve(uri, Path::new("/robots"), &packages);
        assert_eq!(
            at("package://arm/m/a.stl").unwrap(),
            Path::new("/opt/arm/m/a.stl")
        );
        assert_eq!(at("file:///m/a.stl").unwrap(), Path::new("/m/a.stl"));
        assert_eq!(at("m/a.stl").unwrap(), Path::new("/robots/m/a.stl"));
        assert_eq!(at("/m/a.stl").unwrap(), Path::new("/m/a.stl"));
        let Err(RobotError::UnknownPackage { package, .. }) = at("package://hand/a.stl") else {
            panic!()
        };
        assert_eq!(package, "hand");
        assert!(matches!(
            at("http://x/a.stl"),
            Err(RobotError::UnsupportedUri { .. })
        ));
    }
}
