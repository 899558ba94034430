//! Key shapes and key pictures: what lies between them, and the space that they span.

mod align;
mod basis;
mod inbetween;

pub(crate) use align::{AlignTo, align};
pub(crate) use basis::KeysBasis;
pub(crate) use inbetween::KeysInbetween;

use pegbar_engine::array::NdArray;
use pegbar_engine::node::NodeError;

use crate::data::KeyShapes;

/// The points of each key.
pub(crate) fn contours(keys: &KeyShapes) -> Vec<Vec<[f64; 2]>> {
    let n = keys.points.shape()[1];
    let points = keys.points.data().as_chunks().0;
    if n == 0 { vec![Vec::new(); keys.points.shape()[0]] } else { points.chunks_exact(n).map(<[_]>::to_vec).collect() }
}

/// Keys of points.
fn key_shapes(points: &[Vec<[f64; 2]>], names: Vec<String>, closed: bool) -> Result<KeyShapes, NodeError> {
    let n = points.first().map_or(0, Vec::len);
    let flat = points.iter().flatten().flatten().copied().collect();
    let points = NdArray::new([points.len(), n, 2], flat).ok_or_else(|| NodeError::internal("key shapes of different lengths"))?;
    Ok(KeyShapes { points, names, closed })
}
