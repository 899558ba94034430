//! Typed dataflow over time: values, graph files, checking, planning, executing. Knows no animation.

pub mod diag;
pub mod syntax;
