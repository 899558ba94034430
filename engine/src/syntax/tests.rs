//! Tests of the tree: round trip, errors, agreement with `ron`, and reading values.

mod agreement;
mod errors;
mod format;
mod shape;
mod values;
