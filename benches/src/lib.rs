//! Benches of the workspace live in `benches/`.
