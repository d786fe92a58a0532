//! Writes what the fuzz targets start from to `corpus/`: `cargo run --bin seeds` in `fuzz/`.

use postcard::to_allocvec;
use std::error::Error;
use std::fs;
use std::path::Path;
use vsf::contact::GridSdf;
use vsf::core::{Belief, Estimator, Noise, Observation};
use vsf::data::McapExport;
use vsf::gap::effects::catalogue;
use vsf::gap::{Model, ModelFile};
use vsf::vision::{Features, GpConfig, KnnConfig, LearnedPrior, RegressorSpec, Samples};
use vsf_fuzz::{
    Dense, JOINTS, Plain, RECORDED, field, recording, replay, scratch, site, tetrahedron,
};

type Result = std::result::Result<(), Box<dyn Error>>;

fn main() -> Result {
    recordings()?;
    clouds()?;
    states()?;
    models()?;
    looks()?;
    cache()?;
    robots()?;
    // Contact, and then lines as they are.
    seed(
        "live",
        "lines",
        b"\0\0{\"t\": 0.1, \"q\": [0, 0.1, 0.2], \"tau\": [1, 2, 3]}\nno sample\n",
    )?;
    // Any bytes are a run of these.
    let any: Vec<u8> = (0..400).map(|i| (i * 37 % 251) as u8).collect();
    for which in 0..27 {
        for target in ["corrector", "live", "session"] {
            seed(target, &which.to_string(), &[&[which], &any[..]].concat())?;
        }
    }
    Ok(())
}

fn seed(target: &str, name: &str, bytes: &[u8]) -> Result {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("corpus")
        .join(target);
    fs::create_dir_all(&folder)?;
    Ok(fs::write(folder.join(format!("seed-{name}")), bytes)?)
}

fn recordings() -> Result {
    let folder = scratch().join("recording");
    recording().save(&folder)?;
    for (which, name) in RECORDED.iter().enumerate() {
        let bytes = fs::read(folder.join(name))?;
        seed(
            "dataset",
            &which.to_string(),
            &[&[which as u8], &bytes[..]].concat(),
        )?;
    }
    seed("field", "1", &fs::read(folder.join("vsf.npz"))?)?;
    let bag = scratch().join("recording.mcap");
    let joints: Vec<String> = (1..=JOINTS).map(|j| format!("joint_{j}")).collect();
    McapExport {
        recording: Some(&recording()),
        joints: &joints,
        ..McapExport::default()
    }
    .save(&bag)?;
    seed("mcap", "1", &fs::read(bag)?)?;
    let header = "time,q_joint_1,q_joint_2,q_joint_3,tau_joint_1,tau_joint_2,tau_joint_3\n";
    seed(
        "csv",
        "1",
        format!("{header}0,1,2,3,4,5,6\n0.1,1,2,3,4,5,6\n").as_bytes(),
    )
}

fn clouds() -> Result {
    let path = scratch().join("field.ply");
    field().save_ply(&path, None)?;
    seed("ply", "binary", &fs::read(path)?)?;
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 1 2 3 4 5\n\
         3 4 5 6 7 8\n3 0 1 1\n";
    seed("ply", "ascii", text.as_bytes())?;
    for kind in ["ascii", "binary", "binary_compressed"] {
        let header = format!(
            "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n\
             WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {kind}\n"
        );
        let packed = [
            &33u32.to_le_bytes()[..],
            &32u32.to_le_bytes(),
            &[31],
            &[7; 32],
        ]
        .concat();
        let data = match kind {
            "ascii" => b"1 2 3 4\n5 6 7 8\n",
            "binary" => &packed[9..],
            _ => &packed[..],
        };
        seed("pcd", kind, &[header.as_bytes(), data].concat())?;
    }
    Ok(())
}

fn states() -> Result {
    let prior = Belief::uniform(6, 1.0, 2.0)?;
    let mut plain = Plain::new(prior.clone());
    let mut replay = replay(prior.clone())?;
    let mut dense = Dense::new(prior)?;
    let mut obs = Observation::new(Noise::uniform(2, 0.5)?);
    for points in [[0, 2], [1, 3], [2, 5]] {
        obs.rebuild(6, &points, &[3.0, 1.0], |k, w| {
            w.copy_from_slice(&[1.0, k as f64])
        })?;
        plain.update(&obs)?;
        replay.update(&obs)?;
        replay.diffuse(0.1)?;
        dense.update(&obs)?;
    }
    let binary = [
        to_allocvec(&plain)?,
        to_allocvec(&replay)?,
        to_allocvec(&dense)?,
    ];
    let json = [
        serde_json::to_vec(&plain)?,
        serde_json::to_vec(&replay)?,
        serde_json::to_vec(&dense)?,
    ];
    for (k, (binary, json)) in binary.iter().zip(&json).enumerate() {
        seed(
            "state",
            &format!("binary-{k}"),
            &[&[2 * k as u8], &binary[..]].concat(),
        )?;
        seed(
            "state",
            &format!("json-{k}"),
            &[&[2 * k as u8 + 1], &json[..]].concat(),
        )?;
    }
    Ok(())
}

fn models() -> Result {
    let site = site();
    for effect in catalogue() {
        let parameters = effect.parameters(&site);
        let theta: Vec<f64> = parameters
            .iter()
            .map(|p| p.scale.clamp(p.bounds[0], p.bounds[1]))
            .collect();
        let model = Model::of(&effect, &theta);
        let text = ModelFile::new(&site, &model, &theta)?.to_json();
        seed("model", effect.name(), text.as_bytes())?;
    }
    Ok(())
}

fn looks() -> Result {
    let heights: Vec<f64> = (0..12).map(|i| 0.1 * f64::from(i)).collect();
    let features = Features::new(12).with_column("height", &heights)?;
    let samples = Samples::new(features, heights, vec![0.1; 12])?;
    for (name, regressor) in [
        ("knn", RegressorSpec::Knn(KnnConfig::default())),
        ("ridge", RegressorSpec::Ridge),
        ("gp", RegressorSpec::GaussianProcess(GpConfig::default())),
    ] {
        let prior = LearnedPrior::fit(regressor, &[samples.clone(), samples.clone()])?;
        seed("looks", name, prior.to_json().as_bytes())?;
    }
    Ok(())
}

fn cache() -> Result {
    // After magic, version, key and checksum.
    const HEADER: usize = 76;
    let folder = scratch().join("cache");
    let (mesh, options) = tetrahedron(&folder);
    GridSdf::bake(&mesh, &options)?;
    for entry in fs::read_dir(folder)? {
        seed("cache", "1", &fs::read(entry?.path())?[HEADER..])?;
    }
    Ok(())
}

fn robots() -> Result {
    let urdf = r#"<robot name="r"><link name="a"><inertial><origin xyz="0 0 1"/><mass value="2"/>
        <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial><collision><origin
        rpy="1 0 0"/><geometry><box size="1 2 3"/></geometry></collision></link><link name="b">
        <collision><geometry><cylinder radius="1" length="2"/></geometry></collision></link>
        <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="3" velocity="4"/></joint></robot>"#;
    seed("urdf", "1", urdf.as_bytes())?;
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
        endloop\nendfacet\nendsolid a\n";
    seed("mesh", "stl-text", &[&[0], text.as_bytes()].concat())?;
    let corners = [0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let face: Vec<u8> = corners
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .chain([0, 0])
        .collect();
    let binary = [&[0; 81][..], &1u32.to_le_bytes(), &face].concat();
    seed("mesh", "stl-binary", &binary)?;
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 1\nf 1 2 3\nf -4//1 -3//1 -2//1 -1//1\n";
    seed("mesh", "obj", &[&[1], obj.as_bytes()].concat())
}
