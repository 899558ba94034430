//! Typed dataflow over time: values, graph files, checking, planning, executing. Knows no animation.

extern crate self as pegbar_engine;

pub mod array;
pub mod atomic;
pub mod bundle;
pub mod cache;
pub mod check;
pub mod clock;
pub mod diag;
pub mod diff;
pub mod draw;
pub mod edit;
pub mod exec;
pub mod golden;
pub mod graph;
pub mod job;
pub mod key;
pub mod node;
pub mod npz;
pub mod origin;
pub mod plan;
pub mod plugin;
pub mod record;
pub mod registry;
pub mod setting;
pub mod stamp;
mod sync;
pub mod syntax;
pub mod upgrade;
pub mod value;
pub mod why;

pub use pegbar_derive::{Node, Outputs, Setting, Value};

#[cfg(test)]
mod tests;
