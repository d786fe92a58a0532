//! Collision meshes: addresses, formats, scale, and what a broken file gets.

use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vsf_core::{Shape, TriMesh};
use vsf_robots::{Meshes, RobotError, RobotModel, UrdfOptions, urdf_bundle};

fn parse(text: &str) -> Result<RobotModel, RobotError> {
    RobotModel::from_urdf_str(text, "/nowhere", &UrdfOptions::default())
}

fn collision(geometry: &str) -> String {
    format!(
        r#"<robot name="r"><link name="shin">
        <collision><geometry>{geometry}</geometry></collision></link></robot>"#
    )
}

/// A file for one test, in a folder that cargo keeps for tests.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("meshes");
    std::fs::create_dir_all(&dir).unwrap();
    let path = dir.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn mesh(path: &Path, scale: &str) -> Result<RobotModel, RobotError> {
    let path = path.display();
    parse(&collision(&format!(r#"<mesh filename="{path}" {scale}/>"#)))
}

#[test]
fn mesh_addresses() {
    let text = collision(r#"<mesh filename="package://arm/a.stl"/>"#);
    let message = parse(&text).unwrap_err().to_string();
    assert!(
        message.contains("'arm'") && message.contains("packages"),
        "{message}"
    );
    let skip = UrdfOptions {
        meshes: Meshes::Skip,
        ..UrdfOptions::default()
    };
    assert!(
        RobotModel::from_urdf_str(&text, "", &skip)
            .unwrap()
            .colliders()
            .is_empty()
    );

    let path = file("mapped.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let text = collision(r#"<mesh filename="package://arm/mapped.obj"/>"#);
    let folder = path.parent().unwrap().to_owned();
    let packages = BTreeMap::from([("arm".to_owned(), folder.clone())]);
    let options = UrdfOptions {
        packages,
        ..UrdfOptions::default()
    };
    assert_eq!(
        RobotModel::from_urdf_str(&text, "", &options)
            .unwrap()
            .colliders()
            .len(),
        1
    );
    let text = collision(r#"<mesh filename="mapped.obj"/>"#);
    assert!(RobotModel::from_urdf_str(&text, &folder, &UrdfOptions::default()).is_ok());
    let uri = format!("<mesh filename=\"file://{}\"/>", path.display());
    assert!(parse(&collision(&uri)).is_ok());

    let missing = parse(&collision(r#"<mesh filename="a/b.stl"/>"#)).unwrap_err();
    assert!(
        missing.to_string().contains("/nowhere/a/b.stl"),
        "{missing}"
    );
}

/// Binary STL of a tetrahedron, its corners written with both signs of zero.
fn tetrahedron() -> Vec<u8> {
    let p = [
        [0.0f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut bytes = vec![b' '; 80];
    bytes[..6].copy_from_slice(b"solid ");
    bytes.extend(4u32.to_le_bytes());
    for (k, face) in faces.iter().enumerate() {
        bytes.extend([0u8; 12]);
        for &i in face {
            for c in p[i] {
                let c = if c == 0.0 && k % 2 == 1 { -0.0 } else { c };
                bytes.extend(c.to_le_bytes());
            }
        }
        bytes.extend([0u8; 2]);
    }
    bytes
}

const TEXT_STL: &str = "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
    vertex 0 1 0\nendloop\nendfacet\nendsolid\n";

fn only_mesh(robot: &RobotModel) -> &TriMesh {
    let [collider] = robot.colliders() else {
        panic!()
    };
    let Shape::Mesh(mesh) = &collider.shape else {
        panic!()
    };
    mesh
}

/// Signed volume: positive for faces that are counter-clockwise seen from outside.
fn volume(mesh: &TriMesh) -> f64 {
    let corner = |i: u32| mesh.vertices()[i as usize].coords;
    let part = |f: &[u32; 3]| corner(f[0]).dot(&corner(f[1]).cross(&corner(f[2]))) / 6.0;
    mesh.faces().iter().map(part).sum()
}

#[test]
fn good_meshes_are_welded_and_scaled() {
    let path = file("good.STL", &tetrahedron());
    let robot = mesh(&path, "").unwrap();
    assert_eq!(
        (
            only_mesh(&robot).vertices().len(),
            only_mesh(&robot).faces().len()
        ),
        (4, 4)
    );
    assert!((volume(only_mesh(&robot)) - 1.0 / 6.0).abs() < 1e-15);
    let scaled = mesh(&path, r#"scale="0.5 2 3""#).unwrap();
    assert!((volume(only_mesh(&scaled)) - 0.5).abs() < 1e-15);
    let mirrored = mesh(&path, r#"scale="-1 1 1""#).unwrap();
    assert!((volume(only_mesh(&mirrored)) - 1.0 / 6.0).abs() < 1e-15);
    assert!(only_mesh(&mirrored).vertices().iter().any(|v| v.x == -1.0));

    let text = mesh(&file("text.stl", TEXT_STL.as_bytes()), "").unwrap();
    assert_eq!(only_mesh(&text).vertices().len(), 3);
    let second = TEXT_STL.replace("vertex 0 0 0", "vertex 0 0 1");
    let several = format!("{TEXT_STL}\n{second}").replace('\n', "\r\n");
    let several = mesh(&file("several.stl", several.as_bytes()), "").unwrap();
    assert_eq!(only_mesh(&several).faces().len(), 2);
    let obj = "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\no b\nv 0 0 1\nf 1 2 5\n";
    let obj = mesh(&file("two.obj", obj.as_bytes()), "").unwrap();
    assert_eq!(
        (
            only_mesh(&obj).vertices().len(),
            only_mesh(&obj).faces().len()
        ),
        (5, 3)
    );
}

#[test]
fn broken_meshes_are_named() {
    let whole = tetrahedron();
    let mut nan = whole.clone();
    nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut empty = whole[..84].to_vec();
    empty[80..84].fill(0);
    let left = [&whole[..], b"more"].concat();
    let open = format!("{TEXT_STL}solid again\n");
    let cases: [(&str, &[u8]); 12] = [
        ("left.stl", &left),
        ("open.stl", open.as_bytes()),
        ("cut.stl", &whole[..200]),
        ("header.stl", &whole[..40]),
        ("nothing.stl", b""),
        ("empty.stl", &empty),
        ("nan.stl", &nan),
        ("cut_text.stl", &TEXT_STL.as_bytes()[..60]),
        ("hollow.stl", b"solid x\nendsolid x\n"),
        ("hollow.obj", b"v 0 0 0\n"),
        ("range.obj", b"v 0 0 0\nf 1 2 3\n"),
        ("shape.dae", b"<COLLADA/>"),
    ];
    for (name, bytes) in cases {
        let error = mesh(&file(name, bytes), "").unwrap_err();
        let is_mesh = matches!(&error, RobotError::Mesh { path, .. } if path.ends_with(name));
        assert!(is_mesh, "{name}: {error}");
    }
    for name in ["pointer.stl", "pointer.obj"] {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n";
        let error = mesh(&file(name, pointer), "").unwrap_err().to_string();
        assert!(error.contains("git lfs pull"), "{error}");
    }
    let path = file("unscalable.stl", &whole);
    for scale in ["0 1 1", "nan 1 1", "1e300 1e300 inf"] {
        assert!(
            mesh(&path, &format!(r#"scale="{scale}""#)).is_err(),
            "{scale}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the bytes are, reading ends with a model or an error.
    #[test]
    fn damaged_meshes_never_panic(at in 0..284usize, byte: u8, cut in 0..285usize, kind in 0..3usize) {
        let (name, mut bytes) = [
            ("fuzz.stl", tetrahedron()),
            ("fuzz_text.stl", TEXT_STL.as_bytes().to_vec()),
            ("fuzz.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf -1 -2 -3\nf 1/1/1 2 3 1\n".to_vec()),
        ][kind].clone();
        let n = bytes.len();
        bytes[at % n] = byte;
        bytes.truncate(cut.max(n / 2));
        let _ = mesh(&file(name, &bytes), "");
    }
}

/// A robot's files in a folder of their own are the same robot, wherever its meshes lay.
#[test]
fn bundles_stand_alone() {
    let scene = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = scene.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    };
    let obj = |k: usize| format!("v 0 0 0\nv {k} 0 0\nv 0 {k} 0\nf 1 2 3\n");
    let files = [
        "robots/meshes/a.obj",
        "robots/x/a.obj",
        "elsewhere/a.obj",
        "b&c.obj",
    ];
    for (k, name) in files.iter().enumerate() {
        std::fs::write(at(name), obj(k + 1)).unwrap();
    }
    let absolute = at("b&c.obj").display().to_string().replace('&', "&amp;");
    let addresses = [
        "meshes/a.obj",
        "x/a.obj",
        "package://arm/a.obj",
        "package://arm/a.obj",
        &absolute,
    ];
    let shape =
        |a: &&str| format!("<collision><geometry><mesh filename='{a}'/></geometry></collision>");
    let shapes: String = addresses.iter().map(shape).collect();
    let text = format!("<robot name=\"r\"><link name=\"shin\">{shapes}</link></robot>");
    std::fs::write(at("robots/r.urdf"), text).unwrap();
    let packages = BTreeMap::from([("arm".to_owned(), at("elsewhere"))]);
    let options = UrdfOptions {
        packages: packages.clone(),
        ..UrdfOptions::default()
    };
    let robot = RobotModel::from_urdf_file(at("robots/r.urdf"), &options).unwrap();

    let bundle = urdf_bundle(at("robots/r.urdf"), &packages).unwrap();
    assert_eq!(bundle.len(), 5);
    assert_eq!(bundle[0].0, Path::new("r.urdf"));
    // What a robot may not be, a bundle may not be either.
    std::fs::write(
        at("bad.urdf"),
        "<!DOCTYPE r [<!ENTITY a 'b'>]><robot name='r'/>",
    )
    .unwrap();
    let refused = urdf_bundle(at("bad.urdf"), &packages).unwrap_err();
    assert!(refused.to_string().contains("entities"), "{refused}");
    drop(scene);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("meshes")).unwrap();
    for (name, bytes) in &bundle {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let urdf = folder.path().join("r.urdf");
    let moved = RobotModel::from_urdf_file(&urdf, &UrdfOptions::default()).unwrap();
    let vertices = |robot: &RobotModel| -> Vec<_> {
        let of = |shape: &Shape| match shape {
            Shape::Mesh(mesh) => mesh.vertices().to_vec(),
            _ => panic!(),
        };
        robot.colliders().iter().map(|c| of(&c.shape)).collect()
    };
    assert_eq!(vertices(&moved), vertices(&robot));
    // Once more, and nothing is renamed.
    assert_eq!(urdf_bundle(&urdf, &BTreeMap::new()).unwrap(), bundle);
}
