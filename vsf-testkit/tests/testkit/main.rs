//! Each suite passes a good part, and finds each fault of broken ones by name.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod contacts;
#[cfg(feature = "effects")]
mod effects;
mod estimators;
#[cfg(feature = "regressors")]
mod regressors;
mod sensors;
#[cfg(feature = "shapes")]
mod shapes;
