//! Contact by the flags that set it.

use vsf::data::ContactParameters;

/// What parameters of contact are, by their flags, and what others are in their place.
pub fn difference(was: &ContactParameters, is: &ContactParameters) -> Option<(String, String)> {
    let pairs = contact_flags(was).into_iter().zip(contact_flags(is));
    let (was, is): (Vec<_>, Vec<_>) = pairs
        .filter(|((_, was), (_, is))| was != is)
        .map(|((flag, was), (_, is))| (format!("{flag} {was}"), is))
        .unzip();
    (!was.is_empty()).then(|| (was.join(" "), is.join(" and ")))
}

/// Parameters of contact by their flags.
pub fn contact_flags(contact: &ContactParameters) -> [(&'static str, String); 8] {
    let links = match &contact.links {
        Some(names) => names.join(","),
        None => "(all)".to_owned(),
    };
    [
        ("--threshold", contact.threshold.to_string()),
        ("--friction", contact.friction.to_string()),
        ("--slip-step", contact.slip_step.to_string()),
        (
            "--max-slip-iterations",
            contact.max_slip_iterations.to_string(),
        ),
        ("--padding", contact.padding.to_string()),
        ("adhesion", contact.adhesion.to_string()),
        ("--subdivision", contact.subdivision.to_string()),
        ("--links", links),
    ]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use vsf::pipeline::{Scene, SceneOptions};

    #[test]
    fn what_differs_is_told_by_its_flags() {
        let robot = vsf::robots::planar_arm(2, 0.3, 0.03).unwrap();
        let points = vec![vsf::core::nalgebra::Point3::origin()];
        let scene = |links: Option<Vec<String>>| {
            let options = SceneOptions {
                links,
                ..SceneOptions::default()
            };
            Scene::new(robot.clone(), points.clone(), &options).unwrap()
        };
        let all = scene(None).contact_parameters();
        let names: Vec<String> = (robot.colliders().iter())
            .map(|c| robot.links()[c.link].name().to_owned())
            .collect();
        let one = scene(Some(vec![names[0].clone()])).contact_parameters();
        let told = Some(("--links (all)".to_owned(), names[0].clone()));
        assert_eq!(difference(&all, &one), told);
        // All of them named are no choice, in a scene and in what is stored.
        let named = ContactParameters {
            links: Some(names.clone()),
            ..all.clone()
        };
        let scene = scene(Some(names));
        assert_eq!(difference(&all, &scene.contact_parameters()), None);
        assert_eq!(difference(&all, &scene.as_stored_here(&named)), None);
        let rough = ContactParameters {
            threshold: 0.5,
            friction: 1.0,
            ..all.clone()
        };
        let told = (
            "--threshold 0.002 --friction 0.15".to_owned(),
            "0.5 and 1".to_owned(),
        );
        assert_eq!(difference(&all, &rough), Some(told));
    }
}
