//! Characters drawn in mixtures of their keys: where their points are, which mixtures are tried, and which is nearest to some points.

use nalgebra::{DMatrix, DVector, Vector2};

use super::super::super::start::{Moments, moments, transport};
use crate::algo::raster::{Affine, apply};

/// What draws a character in any mixture of its keys.
pub trait Drawn {
    /// Number of keys.
    fn n_keys(&self) -> usize;

    /// Points of a key, pixels: how far poses lie apart, and where they are.
    fn key(&self, k: usize) -> &[[f64; 2]];

    /// The keys mixed by these weights, moved by `place` (sample coordinates from pixels of the keys, lines as wide as `line` times
    /// theirs): RGBA in linear light, premultiplied, rows from the top. `None` where nothing can be drawn.
    fn draw(&self, weights: &[f64], place: &Affine, line: f64, size: [usize; 2]) -> Option<Vec<f32>>;
}

/// A motion and the weights of the keys.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPose {
    /// Frame from pictures, pixels.
    pub motion: Affine,
    /// How much of each key; they add up to 1.
    pub weights: Vec<f64>,
}

/// So many keys are tried two by two as well.
const FEW: usize = 8;

/// The weights, adding up to 1, whose mixture of the keys is nearest to `points`; `None` where they are not as many, or the keys are in one
/// place.
pub(in super::super) fn weights_of(drawn: &dyn Drawn, points: &[[f64; 2]]) -> Option<Vec<f64>> {
    let k = drawn.n_keys();
    let base = drawn.key(0);
    if points.len() != base.len() {
        return None;
    }
    let difference = |j: usize| -> Vec<f64> { drawn.key(j).as_flattened().iter().zip(base.as_flattened()).map(|(a, b)| a - b).collect() };
    let columns: Vec<Vec<f64>> = (1..k).map(difference).collect();
    let rest: Vec<f64> = points.as_flattened().iter().zip(base.as_flattened()).map(|(a, b)| a - b).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut h = DMatrix::from_fn(k - 1, k - 1, |i, j| dot(&columns[i], &columns[j]));
    let floor = 1e-9 * h.trace();
    (0..k - 1).for_each(|i| h[(i, i)] += floor);
    let b = DVector::from_fn(k - 1, |i, _| dot(&columns[i], &rest));
    let found = if k == 1 { DVector::zeros(0) } else { nalgebra::Cholesky::new(h)?.solve(&b) };
    let mut weights = vec![1.0 - found.sum()];
    weights.extend(found.iter());
    weights.iter().all(|w| w.is_finite()).then_some(weights)
}

/// The moments of the drawing's coverage in the plane of the keys.
fn drawn_moments(drawn: &dyn Drawn, weights: &[f64]) -> Option<Moments> {
    let points = || (0..drawn.n_keys()).flat_map(|k| drawn.key(k));
    let low = points().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
    let high = points().fold([f64::NEG_INFINITY; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])]);
    // A picture of some hundred samples a side says where the bulk is.
    let step = ((high[0] - low[0]).max(high[1] - low[1]) / 96.0).max(1e-6);
    let size = [0, 1].map(|k| (libm::ceil((high[k] - low[k]) / step) as usize + 2).min(200));
    let s = 1.0 / step;
    let picture = drawn.draw(weights, &Affine::new(s, 0.0, 1.0 - s * low[0], 0.0, s, 1.0 - s * low[1]), s, size)?;
    let alpha: Vec<f32> = picture.chunks_exact(4).map(|p| p[3]).collect();
    let m = moments(&alpha, size[0])?;
    let centre = (m.centre - Vector2::new(1.0, 1.0)) * step + Vector2::from(low);
    Some(Moments { mass: m.mass * step * step, centre, spread: m.spread * (step * step) })
}

/// Each key, and each two of a few, where the moments of the matte put them; else where `found` does.
pub(in super::super) fn every_pose(drawn: &dyn Drawn, found: &Affine, matte: Option<&[f32]>, width: usize) -> Vec<DrawnPose> {
    let k = drawn.n_keys();
    let to = matte.and_then(|m| moments(m, width));
    let mixed =
        |i: usize, j: usize| (0..k).map(|n| 0.5 * (f64::from(u8::from(n == i)) + f64::from(u8::from(n == j)))).collect::<Vec<f64>>();
    let pairs = (0..k).flat_map(|i| (i..k).map(move |j| (i, j))).filter(|(i, j)| i == j || k <= FEW);
    let pose = |(i, j)| {
        let weights = mixed(i, j);
        let moved = to.as_ref().and_then(|to| transport(&drawn_moments(drawn, &weights)?, to, found));
        DrawnPose { motion: moved.unwrap_or(*found), weights }
    };
    pairs.map(pose).collect()
}

/// Root mean square distance of points in pairs.
pub(super) fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sum();
    libm::sqrt(sum / a.len().max(1) as f64)
}

/// Where the points of the keys are in the frame.
pub(crate) fn placed(drawn: &dyn Drawn, pose: &DrawnPose) -> Vec<[f64; 2]> {
    let n = drawn.key(0).len();
    let mixed = |i: usize| {
        let sum = |c: usize| pose.weights.iter().enumerate().map(|(k, w)| w * drawn.key(k)[i][c]).sum::<f64>();
        apply(&pose.motion, Vector2::new(sum(0), sum(1))).into()
    };
    (0..n).map(mixed).collect()
}
