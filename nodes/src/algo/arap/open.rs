//! Open curves: no triangles, so that edges turn and stretch instead (B16 of the papers' list; Sederberg, Gao, Wang, Mu, 2-D shape
//! blending: an intrinsic solution to the vertex path problem, SIGGRAPH 1993).

use super::angles::wrapped;
use super::{ArapError, Gauge, held, sole};
use crate::algo::compatible::{Point, sub};

/// Open curves of one point order, ready to be blended.
///
/// Each edge's angle is followed along the curve, past half a turn, and blended; so is the logarithm of its length. The mean of the points, or
/// one of them, goes along the blend of the keys'.
#[derive(Debug)]
pub struct OpenBlend {
    keys: Vec<Vec<Point>>,
    /// For each key and edge the angle in radians and the length.
    edges: Vec<Vec<[f64; 2]>>,
    /// How much each point counts in what holds the blend in place; they add up to one.
    gauge: Vec<f64>,
}

impl OpenBlend {
    /// Prepares `keys`.
    ///
    /// Errors: no key, keys of different numbers of points, keys that are not finite, a gauge at a point that there is not.
    pub fn new(keys: &[&[Point]], gauge: Gauge) -> Result<Self, ArapError> {
        let expected = keys.first().map_or(0, |k| k.len());
        if expected == 0 {
            return Err(ArapError::Empty { keys: keys.len(), triangles: 0 });
        }
        for (key, points) in keys.iter().enumerate() {
            if points.len() != expected {
                return Err(ArapError::Count { key, expected, found: points.len() });
            }
            if !points.iter().flatten().all(|v| v.is_finite()) {
                return Err(ArapError::NotFinite { key });
            }
        }
        let mut edges: Vec<Vec<[f64; 2]>> = Vec::with_capacity(keys.len());
        for key in keys {
            let own = followed(key, edges.first());
            edges.push(own);
        }
        let gauge = match gauge {
            Gauge::Centroid => vec![1.0 / expected as f64; expected],
            Gauge::Vertex(v) => held(v, expected)?,
        };
        Ok(Self { keys: keys.iter().map(|k| k.to_vec()).collect(), edges, gauge })
    }

    /// A blend by weights that add up to 1; where one key has all the weight, that key itself.
    ///
    /// Errors: another number of weights than of keys.
    pub fn blend(&self, weights: &[f64]) -> Result<Vec<Point>, ArapError> {
        if weights.len() != self.keys.len() {
            return Err(ArapError::Weights { expected: self.keys.len(), found: weights.len() });
        }
        if let Some(key) = sole(weights) {
            return Ok(self.keys[key].clone());
        }
        let n = self.keys[0].len();
        let mut points = vec![[0.0; 2]; n];
        for i in 0..n - 1 {
            let each = || self.edges.iter().zip(weights).map(|(e, w)| (e[i], *w));
            let angle: f64 = each().map(|(e, w)| w * e[0]).sum();
            let (sin, cos) = libm::sincos(angle);
            let length = blended_length(each().map(|(e, w)| (e[1], w)));
            points[i + 1] = [points[i][0] + length * cos, points[i][1] + length * sin];
        }
        for c in 0..2 {
            let mean = |p: &[Point]| p.iter().zip(&self.gauge).map(|(p, g)| g * p[c]).sum::<f64>();
            let shift = self.keys.iter().zip(weights).map(|(k, w)| w * mean(k)).sum::<f64>() - mean(&points);
            points.iter_mut().for_each(|p| p[c] += shift);
        }
        Ok(points)
    }
}

/// The geometric mean by weights; where a length is 0, the arithmetic one, which stays finite.
fn blended_length(lengths: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    if lengths.clone().any(|(l, _)| l <= 0.0) {
        return lengths.map(|(l, w)| l * w).sum::<f64>().max(0.0);
    }
    libm::exp(lengths.map(|(l, w)| w * libm::log(l)).sum())
}

/// Angles and lengths of a curve's edges, by themselves; against the first key the turn goes on from edge to edge, and is half a turn at the most on the mean.
pub(crate) fn followed(points: &[Point], first: Option<&Vec<[f64; 2]>>) -> Vec<[f64; 2]> {
    let mut edges = Vec::with_capacity(points.len().saturating_sub(1));
    let mut turn = 0.0;
    for (i, pair) in points.windows(2).enumerate() {
        let d = sub(pair[1], pair[0]);
        let length = libm::hypot(d[0], d[1]);
        let base = first.map_or_else(|| edges.last().map_or(0.0, |e: &[f64; 2]| e[0]), |f| f[i][0]);
        // An edge without length turns as the one before it.
        if length > 0.0 {
            turn += wrapped(libm::atan2(d[1], d[0]) - base - turn);
        }
        edges.push([base + turn, length]);
        if first.is_none() {
            turn = 0.0;
        }
    }
    if let Some(first) = first {
        let n = edges.len().max(1) as f64;
        let mean = edges.iter().zip(first).map(|(e, f)| e[0] - f[0]).sum::<f64>() / n;
        let turns = wrapped(mean) - mean;
        edges.iter_mut().for_each(|e| e[0] += turns);
    }
    edges
}
