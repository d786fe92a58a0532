//! A field and a recording as one page to look at from all sides.

mod cloud;
mod motion;
mod numbers;
mod page;
mod shapes;

pub use cloud::Cloud;
pub use motion::{Motion, in_air, in_scene};
pub use page::{View, page};
