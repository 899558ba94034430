//! Solvers.

mod key_weights;

pub(crate) use key_weights::{SolveKeyWeights, bounds, in_frame};
