//! Weights.

use pegbar_engine::Value;

/// How much of each key a shape is made of.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct Weights {
    /// One for each key, in their order; they add up to 1 for key shapes.
    #[value(shape = "[k]")]
    pub weights: Vec<f64>,
}
