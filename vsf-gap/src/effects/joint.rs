//! What the effects of the joints share.

use crate::effect::slides;
use crate::{Parameter, Site};

/// The first unit where a joint turns, the second where it slides.
pub(super) fn unit(
    site: &Site,
    turning: &'static str,
    sliding: &'static str,
) -> impl Fn(usize) -> &'static str {
    move |j| if slides(site, j) { sliding } else { turning }
}

/// Parameters of the joints, with these bounds and this scale where they slide.
pub(super) fn where_sliding(
    site: &Site,
    mut parameters: Vec<Parameter>,
    bounds: [f64; 2],
    scale: f64,
) -> Vec<Parameter> {
    for (j, p) in parameters.iter_mut().enumerate() {
        if slides(site, j) {
            (p.bounds, p.scale) = (bounds, scale);
        }
    }
    parameters
}

/// Unit of a speed that all joints share.
pub(super) fn speed_unit(site: &Site) -> &'static str {
    let sliding = (0..site.joints()).filter(|&j| slides(site, j)).count();
    match sliding {
        0 => "rad/s",
        n if n == site.joints() => "m/s",
        _ => "rad/s or m/s",
    }
}

/// The sign of a velocity, smooth within `eps`: dry friction without a jump at rest.
pub(super) fn sign(velocity: f64, eps: f64) -> f64 {
    (velocity / eps).tanh()
}
