//! Motion over time as an animator thinks of it, and filters on it: smooth, exaggerate, anticipate, follow through, pin.
//!
//! A filter sees curves in groups that belong together. An affine motion is taken apart about a pivot into the pivot's path, a rotation without jumps, a size
//! and a squash (the two numbers of a traceless symmetric logarithm), so that each stays a motion of its kind however it is filtered: a rotation never
//! shrinks, and what is squashed keeps its area.

pub mod cartoon;
pub mod exaggerate;
pub mod pin;
pub mod smooth;
mod split;

pub use split::{Split, SplitError, still_point};

/// What a group of curves is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The path of the pivot, x and y, pixels.
    Translation,
    /// An angle, radians, without jumps.
    Rotation,
    /// The logarithm of the mean scale.
    Size,
    /// The squash: the two numbers of the traceless part of the logarithm of the stretch.
    Squash,
    /// Weights, which add up to 1.
    Weights,
    /// Numbers of any meaning.
    Values,
}

/// Curves that belong together, one value a frame each.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// What they are.
    pub kind: Kind,
    /// The curves.
    pub curves: Vec<Vec<f64>>,
}

/// Which frames show a drawing of their own, and which drawing each frame shows: a hold is filtered as one and stays one.
#[derive(Clone, Debug, PartialEq)]
pub struct Holds {
    /// Middle of each drawing's frames.
    pub times: Vec<f64>,
    /// Position of the first frame of each drawing.
    pub first: Vec<usize>,
    /// The drawing that each frame shows.
    pub drawing: Vec<usize>,
}

impl Holds {
    /// Every frame a drawing.
    pub fn none(n: usize) -> Self {
        Self { times: (0..n).map(|k| k as f64).collect(), first: (0..n).collect(), drawing: (0..n).collect() }
    }

    /// Neighbouring frames that show the same source frame are one drawing.
    pub fn of(source_frames: &[f64]) -> Self {
        let (mut first, mut drawing): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
        for (k, s) in source_frames.iter().enumerate() {
            if k == 0 || source_frames[k - 1] != *s {
                first.push(k);
            }
            drawing.push(first.len() - 1);
        }
        let end = |d: usize| first.get(d + 1).copied().unwrap_or(source_frames.len());
        let times = (0..first.len()).map(|d| 0.5 * (first[d] + end(d) - 1) as f64).collect();
        Self { times, first, drawing }
    }

    /// One value a drawing.
    pub fn drawings(&self, curve: &[f64]) -> Vec<f64> {
        self.first.iter().map(|&k| curve[k]).collect()
    }

    /// One value a frame.
    pub fn frames(&self, drawings: &[f64]) -> Vec<f64> {
        self.drawing.iter().map(|&d| drawings[d]).collect()
    }
}

/// Weights brought back to a sum of 1 within bounds, with the least change: each is moved by one amount and cut.
///
/// Bounds that hold no such weights are not looked at.
pub fn bounded(weights: &mut [f64], lower: f64, upper: f64) {
    let n = weights.len() as f64;
    if weights.is_empty() || !(n * lower <= 1.0 && n * upper >= 1.0) {
        return;
    }
    let sum = |shift: f64, w: &[f64]| w.iter().map(|v| (v + shift).clamp(lower, upper)).sum::<f64>();
    let spread = weights.iter().fold(1.0f64, |a, v| a.max(v.abs())) + lower.abs() + upper.abs();
    let (mut low, mut high) = (-2.0 * spread, 2.0 * spread);
    let even = (1.0 - weights.iter().sum::<f64>()) / n;
    let plain = weights.iter().all(|v| (lower..=upper).contains(&(v + even)));
    for _ in 0..if plain { 0 } else { 100 } {
        let middle = 0.5 * (low + high);
        if sum(middle, weights) < 1.0 { low = middle } else { high = middle }
    }
    let shift = if plain { even } else { 0.5 * (low + high) };
    weights.iter_mut().for_each(|v| *v = (*v + shift).clamp(lower, upper));
}

#[cfg(test)]
mod tests;
