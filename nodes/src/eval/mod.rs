//! Measures of results against truth.

mod rms;

pub(crate) use rms::EvalRms;
