//! Pictures that are blended.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// Pictures of one size that are blended, or span a space.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct KeyImages {
    /// Samples of each key, rows from the top, the first at the origin: linear light, premultiplied by alpha where there is one.
    #[value(shape = "[k, h, w, c]")]
    pub pixels: NdArray<f32, 4>,
    /// Name of each key, or none at all.
    #[value(text)]
    pub names: Vec<String>,
}
