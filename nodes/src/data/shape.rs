//! Contours.

use pegbar_engine::Value;

/// A contour: points along a closed or open line.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct Shape {
    /// Points in order, pixels, origin at the top left corner of the format.
    #[value(shape = "[n, 2]")]
    pub points: Vec<[f64; 2]>,
    /// True where the last point joins the first. Default: false.
    #[value(text)]
    pub closed: bool,
}

/// Contours that are blended: as many points each, in the same order.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct KeyShapes {
    /// Points of each key, pixels, origin at the top left corner of the format.
    #[value(shape = "[k, n, 2]")]
    pub points: pegbar_engine::array::NdArray<f64, 3>,
    /// Name of each key, or none at all.
    #[value(text)]
    pub names: Vec<String>,
    /// True where the last point of each joins its first. Default: false.
    #[value(text)]
    pub closed: bool,
}

impl KeyShapes {
    /// All points, key by key.
    pub fn by_point(&self) -> &[[f64; 2]] {
        self.points.data().as_chunks().0
    }
}
