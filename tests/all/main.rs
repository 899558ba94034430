//! Whole-program tests: every graph that comes with Pegbar, every node type, hostile input at the command line, and truth from drawn footage.
//!
//! One binary, so that it is linked once. `cargo test --test all goldens` runs one part; `goldens/mod.rs` tells how goldens are blessed.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test ends with a panic where something is wrong")]

mod conformance;
mod faults;
mod goldens;
mod hostile;
mod plugins;
mod show;
mod support;
mod truth;
