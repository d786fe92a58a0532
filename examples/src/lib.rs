//! The studies lie beside this file, one example each.
