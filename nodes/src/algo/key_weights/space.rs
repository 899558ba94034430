//! The keys as the solver sees them: what they share over all frames.

use super::{Problem, WeightsError, dot};
use crate::algo::fit_affine::finite;
use crate::algo::raster::Affine;

/// Keys with their products, from which the Gram matrix of equation (7) follows under any affine motion without another look at the points.
///
/// Keys are held as their differences from their mean: the weights add up to 1, so that the mean drops out and nothing large is subtracted
/// from something as large.
#[derive(Clone, Debug, PartialEq)]
pub struct KeySpace {
    n_keys: usize,
    n_points: usize,
    mean: Vec<[f64; 2]>,
    /// Differences from the mean, `n_keys` rows of all x, then all y.
    differences: Vec<f64>,
    /// Sums over points of x x, of x y + y x, and of y y, for each pair of keys.
    products: [Vec<f64>; 3],
    /// Scratch: the shape as the motion's transpose brings it back, all x, then all y.
    target: Vec<f64>,
}

impl KeySpace {
    /// `n_keys` keys of as many points each, one behind the other. O(keys² × points).
    ///
    /// # Errors
    /// No keys, no points, or a coordinate that is not finite.
    pub fn new(n_keys: usize, points: &[[f64; 2]]) -> Result<Self, WeightsError> {
        if n_keys == 0 {
            return Err(WeightsError::NoKeys);
        }
        let n = points.len() / n_keys;
        if n == 0 {
            return Err(WeightsError::NoPoints);
        }
        if let Err(super::super::fit_affine::FitError::NotFinite { at, x, y }) = finite(points) {
            return Err(WeightsError::Key { key: at / n, at: at % n, x, y });
        }
        let mean: Vec<[f64; 2]> = (0..n)
            .map(|i| [0, 1].map(|c| points[i][c] + (1..n_keys).map(|k| points[k * n + i][c] - points[i][c]).sum::<f64>() / n_keys as f64))
            .collect();
        let mut differences = Vec::with_capacity(2 * n * n_keys);
        for key in points.chunks_exact(n) {
            for c in 0..2 {
                differences.extend(key.iter().zip(&mean).map(|(p, m)| p[c] - m[c]));
            }
        }
        let mut products = [(); 3].map(|()| vec![0.0; n_keys * n_keys]);
        for k in 0..n_keys {
            for l in 0..=k {
                let ((xk, yk), (xl, yl)) = (row(&differences, n, k), row(&differences, n, l));
                for (of, value) in products.iter_mut().zip([dot(xk, xl), dot(xk, yl) + dot(yk, xl), dot(yk, yl)]) {
                    (of[k * n_keys + l], of[l * n_keys + k]) = (value, value);
                }
            }
        }
        Ok(Self { n_keys, n_points: n, mean, differences, products, target: vec![0.0; 2 * n] })
    }

    /// Keys.
    pub fn n_keys(&self) -> usize {
        self.n_keys
    }

    /// Points of each.
    pub fn n_points(&self) -> usize {
        self.n_points
    }

    /// Mean of the keys.
    pub fn mean(&self) -> &[[f64; 2]] {
        &self.mean
    }

    /// Difference of key `k` from the mean: all x, and all y.
    pub fn difference(&self, k: usize) -> (&[f64], &[f64]) {
        row(&self.differences, self.n_points, k)
    }

    /// Sums over points of x x, of x y + y x, and of y y, for each pair of differences.
    pub fn products(&self) -> &[Vec<f64>; 3] {
        &self.products
    }

    /// The keys mixed by weights that add up to 1, into `shape`. O(points × weights that are not zero).
    pub fn mix(&self, weights: &[f64], shape: &mut [[f64; 2]]) {
        shape.copy_from_slice(&self.mean);
        for (k, &w) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            let (x, y) = self.difference(k);
            for (i, p) in shape.iter_mut().enumerate() {
                p[0] += w * x[i];
                p[1] += w * y[i];
            }
        }
    }

    /// Equation (7) for a shape and the motion that brings the keys to it: O(keys² + keys × points), without allocation once `problem` has
    /// its size.
    ///
    /// `shape` has as many points as the keys, all finite.
    pub fn problem(&mut self, motion: &Affine, shape: &[[f64; 2]], problem: &mut Problem) {
        let (n, k) = (self.n_points, self.n_keys);
        let (a, b, c, d) = (motion[(0, 0)], motion[(0, 1)], motion[(1, 0)], motion[(1, 1)]);
        let (dx, dy) = (motion[(0, 2)], motion[(1, 2)]);
        let [xx, xy, yy] = &self.products;
        let (pxx, pxy, pyy) = (a * a + c * c, a * b + c * d, b * b + d * d);
        problem.gram.resize(k * k, 0.0);
        problem.linear.resize(k, 0.0);
        for (i, g) in problem.gram.iter_mut().enumerate() {
            *g = pxx * xx[i] + pxy * xy[i] + pyy * yy[i];
        }
        let (tx, ty) = self.target.split_at_mut(n);
        problem.constant = 0.0;
        for (i, (v, m)) in shape.iter().zip(&self.mean).enumerate() {
            let (u, v) = (v[0] - (a * m[0] + b * m[1] + dx), v[1] - (c * m[0] + d * m[1] + dy));
            problem.constant += u * u + v * v;
            (tx[i], ty[i]) = (a * u + c * v, b * u + d * v);
        }
        for (l, row) in problem.linear.iter_mut().zip(self.differences.chunks_exact(2 * n)) {
            *l = dot(row, &self.target);
        }
    }

    /// Whether a shape can be made of the keys.
    ///
    /// # Errors
    /// Another number of points, or one that is not finite.
    pub fn check(&self, shape: &[[f64; 2]]) -> Result<(), WeightsError> {
        if shape.len() != self.n_points {
            return Err(WeightsError::Counts { expected: self.n_points, found: shape.len() });
        }
        Ok(finite(shape)?)
    }
}

fn row(differences: &[f64], n: usize, k: usize) -> (&[f64], &[f64]) {
    differences[2 * n * k..2 * n * (k + 1)].split_at(n)
}
