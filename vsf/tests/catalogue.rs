//! The guide's table of the catalogue says what the code has.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;
use vsf::core::RestPoints;
use vsf::core::nalgebra::{Point3, Vector3};
use vsf::data::TorqueKind;
use vsf::gap::{Effect, Parameter, Site, effects};
use vsf::robots::kinova_gen3;

/// The name without the joints, links or sequences that it speaks of: `c_4` is one of `c_<i>`.
fn family(p: &Parameter) -> String {
    let mut letters = ["<i>", "<j>"].into_iter();
    let part = |s: &str| match s.parse::<usize>() {
        Ok(_) => letters.next().unwrap_or("<k>").to_owned(),
        Err(_) => s.to_owned(),
    };
    p.name.split('_').map(part).collect::<Vec<_>>().join("_")
}

fn row(site: &Site, effect: &dyn Effect) -> String {
    let mut families: Vec<(String, &str, [f64; 2])> = Vec::new();
    for p in effect.parameters(site) {
        let name = family(&p);
        match families.iter_mut().find(|(n, ..)| *n == name) {
            // Not a number where joints or links differ.
            Some((.., bounds)) if *bounds != p.bounds => *bounds = [f64::NAN; 2],
            Some(_) => (),
            None => families.push((name, p.unit, p.bounds)),
        }
    }
    let text = |(name, unit, [low, high]): &(String, &str, [f64; 2])| {
        let range = if low.is_nan() {
            "by link,".to_owned()
        } else {
            format!("{low} to {high}")
        };
        let unit = if *unit == "1" { "" } else { unit };
        format!("`{name}` {range} {unit}").trim_end().to_owned()
    };
    let parameters: Vec<String> = families.iter().map(text).collect();
    format!(
        "| `{}` | {} | {} |\n",
        effect.name(),
        effect.summary(),
        parameters.join("<br>")
    )
}

#[test]
fn the_guide_lists_every_effect_with_its_parameters() {
    let site = Site {
        robot: Arc::new(kinova_gen3().unwrap()),
        rest: Arc::new(
            RestPoints::new(vec![Point3::origin(), Point3::new(0.01, 0.0, 0.0)]).unwrap(),
        ),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        torque_kind: TorqueKind::Measured,
        friction: 0.15,
        sequences: vec!["1".to_owned(), "2".to_owned()],
        duration: 60.0,
        sequence_duration: 30.0,
    };
    let rows: String = effects::catalogue()
        .iter()
        .map(|e| row(&site, e.as_ref()))
        .collect();
    let page = include_str!("../src/guide/catalogue.md");
    assert!(
        page.contains(&rows),
        "the table of the guide should be:\n{rows}"
    );
}
