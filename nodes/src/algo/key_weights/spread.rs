//! How sure weights are.

use nalgebra::DMatrix;

use super::{Limits, Problem};

/// Condition of the system for the weights that are free (neither nought nor at a bound), its columns scaled to one length, and the
/// standard deviation of each weight when the shape has `coordinates` numbers whose errors are what the cost leaves. Weights that are not
/// free deviate by 0.
///
/// The condition is 1 where at most two weights are free, and infinite, as the deviations are, where free keys do the same thing.
pub fn spread(problem: &Problem, weights: &[f64], limits: Limits, coordinates: usize) -> (f64, Vec<f64>) {
    let k = weights.len();
    let free: Vec<usize> = (0..k).filter(|&i| weights[i] != 0.0 && weights[i] > limits.lower && weights[i] < limits.upper).collect();
    let mut out = vec![0.0; k];
    // A weight that is free alone takes what the others leave: it has no choice.
    let Some((&first, rest)) = free.split_first().filter(|f| !f.1.is_empty()) else { return (1.0, out) };
    let g = |i: usize, j: usize| problem.gram[i * k + j];
    // The first takes what the others leave of the sum.
    let system =
        DMatrix::from_fn(rest.len(), rest.len(), |a, b| (g(rest[a], rest[b]) - g(rest[a], first)) + (g(first, first) - g(first, rest[b])));
    let scale: Vec<f64> = system.diagonal().iter().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(rest.len(), rest.len(), |a, b| system[(a, b)] * scale[a] * scale[b]);
    let values = scaled.symmetric_eigenvalues();
    let condition = values.max() / values.min();
    let known = (0.0..1e15).contains(&condition);
    let Some(inverse) = scaled.cholesky().filter(|_| known).map(|f| f.inverse()) else {
        free.iter().for_each(|&i| out[i] = f64::INFINITY);
        return (f64::INFINITY, out);
    };
    let spare = coordinates as f64 - rest.len() as f64;
    let variance = if spare > 0.0 { problem.cost(weights).max(0.0) / spare } else { f64::NAN };
    let of = |a: usize, b: usize| inverse[(a, b)] * scale[a] * scale[b];
    for (a, &i) in rest.iter().enumerate() {
        out[i] = (variance * of(a, a)).sqrt();
    }
    let all: f64 = (0..rest.len()).flat_map(|a| (0..rest.len()).map(move |b| (a, b))).map(|(a, b)| of(a, b)).sum();
    out[first] = (variance * all.max(0.0)).sqrt();
    (condition, out)
}
