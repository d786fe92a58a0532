//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod changing_field;
mod common;
mod conformance;
mod dense;
mod dual;
mod replay;
#[cfg(feature = "serde")]
mod state;
mod val_batch;
mod val_closed_form;
mod val_constrained;
mod val_dense;
mod val_golden;
mod val_robust;
