//! Key shapes and key pictures: picked by hand and found, what lies between them, and the space that they span.

mod align;
mod basis;
mod choose;
mod draw;
mod inbetween;
mod pick;

pub(crate) use align::{AlignTo, align};
pub(crate) use basis::KeysBasis;
pub(crate) use choose::KeysChoose;
pub(crate) use draw::KeysDraw;
pub(crate) use inbetween::KeysInbetween;
pub(crate) use pick::KeysPick;

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::fit_affine::finite;
use crate::algo::key_weights::WeightsError;
use crate::data::{KeyShapes, Shape};

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

/// What cannot be solved, as the node's error.
pub(crate) fn refused(error: WeightsError) -> NodeError {
    match error {
        WeightsError::Bounds { .. } => NodeError::new(Fault::Parameters, error.to_string()),
        _ => NodeError::input(error.to_string()),
    }
}

/// That shapes can be keys together: all open or all closed, of as many points, which are finite.
fn alike<'a>(shapes: impl IntoIterator<Item = (i64, &'a Shape)>) -> Result<(), NodeError> {
    let mut first = None;
    for (frame, shape) in shapes {
        let (n, closed) = *first.get_or_insert((shape.points.len(), shape.closed));
        if (shape.points.len(), shape.closed) != (n, closed) {
            let kind = |closed| if closed { "closed" } else { "open" };
            let found = format!("{} with {} at frame {frame}", kind(shape.closed), shape.points.len());
            let message = format!("expected contours that are all {} with {n} points, found {found}", kind(closed));
            return Err(NodeError::input(message).help("`shape.resample` brings contours to one count"));
        }
        finite(&shape.points).map_err(|e| NodeError::input(format!("frame {frame}: {e}")))?;
    }
    Ok(())
}

/// Keys of points one behind the other, named by their frames.
fn named(frames: &[i64], points: &[[f64; 2]], closed: bool) -> Result<KeyShapes, NodeError> {
    let n = points.len() / frames.len().max(1);
    let points = NdArray::new([frames.len(), n, 2], points.as_flattened().to_vec());
    let points = points.ok_or_else(|| NodeError::internal("keys of another size than their shapes"))?;
    Ok(KeyShapes { points, names: frames.iter().map(i64::to_string).collect(), closed })
}
