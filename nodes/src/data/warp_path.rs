//! Paths of alignments in time.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// Which frames of two sequences go together.
#[derive(Clone, Debug, Default, PartialEq, Value)]
pub struct WarpPath {
    /// Pairs of target and source frame, in the order of time.
    #[value(shape = "[l, 2]")]
    pub pairs: NdArray<i64, 2>,
}
