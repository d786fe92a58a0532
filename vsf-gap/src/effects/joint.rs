//! What the effects of the joints share.

use crate::Site;
use crate::effect::slides;

/// The first unit where a joint turns, the second where it slides.
pub(super) fn unit(
    site: &Site,
    turning: &'static str,
    sliding: &'static str,
) -> impl Fn(usize) -> &'static str {
    move |j| if slides(site, j) { sliding } else { turning }
}

/// The sign of a velocity, smooth within `eps`: dry friction without a jump at rest.
pub(super) fn sign(velocity: f64, eps: f64) -> f64 {
    (velocity / eps).tanh()
}
