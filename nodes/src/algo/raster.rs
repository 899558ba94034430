//! Borrowed pictures: interleaved `f32` samples, rows from the top, and the geometry conventions that go with them.

use nalgebra::{Matrix2x3, Vector2};

/// An affine map of the plane, target from source, in pixels (2×3: linear part, then translation).
///
/// Image space has its origin at the top left corner, x to the right, y down; the centre of the sample at column `i`, row `j` is (i + ½, j + ½).
pub type Affine = Matrix2x3<f64>;

/// A picture that is read: `height` rows of `width` pixels of `channels` interleaved samples.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// Samples, `width * height * channels` of them, row by row.
    pub data: &'a [f32],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples a pixel.
    pub channels: usize,
}

impl<'a> Raster<'a> {
    /// A view of `data`; `None` where its length is not `width * height * channels`.
    pub fn new(data: &'a [f32], width: usize, height: usize, channels: usize) -> Option<Self> {
        let len = width.checked_mul(height)?.checked_mul(channels)?;
        (data.len() == len).then_some(Self { data, width, height, channels })
    }

    /// One row of samples.
    pub fn row(&self, y: usize) -> &'a [f32] {
        let n = self.width * self.channels;
        &self.data[y * n..(y + 1) * n]
    }
}

/// `m` applied to a point.
pub fn apply(m: &Affine, p: Vector2<f64>) -> Vector2<f64> {
    m.fixed_view::<2, 2>(0, 0) * p + m.column(2)
}

/// `outer` after `inner`.
pub fn compose(outer: &Affine, inner: &Affine) -> Affine {
    let linear = outer.fixed_view::<2, 2>(0, 0) * inner.fixed_view::<2, 2>(0, 0);
    let offset = apply(outer, inner.column(2).into());
    Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), offset])
}

/// The inverse map; `None` where the linear part is singular.
pub fn invert(m: &Affine) -> Option<Affine> {
    let linear = m.fixed_view::<2, 2>(0, 0).into_owned().try_inverse()?;
    let offset = -(linear * m.column(2));
    Some(Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), offset]))
}

/// The map that moves nothing.
pub fn identity() -> Affine {
    Affine::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
}
