//! Weights set by hand.

#[cfg(test)]
mod graph_tests;
mod keys;

pub(crate) use keys::WeightsKeys;
