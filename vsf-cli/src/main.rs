//! The `vsf` command.
fn main() {}
