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
        Some(names) => {
            let mut names = names.clone();
            names.sort();
            names.join(",")
        }
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
