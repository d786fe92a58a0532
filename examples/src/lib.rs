//! Parts of the studies that are more than one file.

#![forbid(unsafe_code)]

pub mod live;

mod picture;
pub use picture::write_picture;
