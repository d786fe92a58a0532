//! Parts of the studies that are more than one file.

#![forbid(unsafe_code)]

mod picture;
pub use picture::write_picture;
