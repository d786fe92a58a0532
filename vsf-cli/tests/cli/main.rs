//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used)]

mod bad_input;
mod browser;
mod commands;
mod common;
mod csv;
mod diagnose;
mod experiments;
mod interrupted;
mod live;
mod mcap;
mod points;
mod regions;
mod replaced;
mod threads;
mod view;
mod warnings;
