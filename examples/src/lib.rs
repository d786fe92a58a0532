//! The studies lie beside this folder, one per file, each an example of this package:
//! `cargo run --release -p vsf-examples --example online_session`.
