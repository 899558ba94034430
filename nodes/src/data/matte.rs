//! Mattes.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// How much of each pixel belongs to a layer: 0 none, 1 all.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct Matte {
    /// Coverage, rows from the top, 0 to 1.
    #[value(shape = "[h, w]")]
    alpha: NdArray<f32, 2>,
}

impl Matte {
    /// A matte of `[height, width]` coverages; `None` where their number is another.
    pub fn new(width: usize, height: usize, alpha: Vec<f32>) -> Option<Self> {
        Some(Self { alpha: NdArray::new([height, width], alpha)? })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.alpha.shape()[1]
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.alpha.shape()[0]
    }

    /// The coverages.
    pub fn alpha(&self) -> &[f32] {
        self.alpha.data()
    }
}
