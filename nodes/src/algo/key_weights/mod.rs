//! How much of each key a shape is made of: the quadratic program of Bregler, Loeb, Chuang, Deshpande 2002, equation (7), under all three
//! constraints.
//!
//! Minimise |V - A Σ w S|² over the weights w, of which at most J are not zero, which add up to 1, and each of which lies between a lower
//! and an upper bound. The answer is exact in the number of weights, not a rounding of the dense answer: all sets of J keys are looked at,
//! most of them only through a bound. Eliminating one key after the other from the Gram matrix (Schur complements) shares nearly all work
//! between the sets, so that the bound of a whole set costs a handful of operations; the sets whose bound is below the best so far are
//! solved with their bounds.

mod boxed;
mod search;
mod sequence;
mod space;
mod spread;
#[cfg(test)]
mod tests;

pub use sequence::smooth;
pub use space::KeySpace;
pub use spread::spread;

use boxed::Boxed;
use search::Search;

/// The three constraints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Most weights that are not zero, from 1.
    pub max_nonzero: usize,
    /// Least weight, at most 0.
    pub lower: f64,
    /// Largest weight, above 0.
    pub upper: f64,
}

impl Default for Limits {
    /// Three keys at a time; the bounds that the paper usually takes.
    fn default() -> Self {
        Self { max_nonzero: 3, lower: -0.5, upper: 1.5 }
    }
}

/// Why weights cannot be solved for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WeightsError {
    /// There are no keys.
    #[error("expected at least one key, found none")]
    NoKeys,
    /// The keys have no points.
    #[error("expected keys with points, found none")]
    NoPoints,
    /// The shape has another number of points than the keys.
    #[error("expected {expected} points, as the keys have, found {found}; `shape.resample` brings contours to one count")]
    Counts {
        /// Points of the keys.
        expected: usize,
        /// Points of the shape.
        found: usize,
    },
    /// A coordinate of a key is infinite or not a number.
    #[error("expected finite keys, found ({x}, {y}) at point {at} of key {key}")]
    Key {
        /// Position of the key, from 0.
        key: usize,
        /// Position of the point, from 0.
        at: usize,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
    },
    /// A coordinate of the shape is infinite or not a number.
    #[error(transparent)]
    Shape(#[from] super::fit_affine::FitError),
    /// The motion is not finite.
    #[error("expected a finite motion, found {0:?}")]
    Motion([f64; 6]),
    /// The bounds hold no weights that add up to 1.
    #[error("expected lower <= 0 and upper >= 1 / {keys}, so that {keys} weights can add up to 1, found {lower} and {upper}")]
    Bounds {
        /// Weights that may be other than zero.
        keys: usize,
        /// The lower bound.
        lower: f64,
        /// The upper bound.
        upper: f64,
    },
}

/// A problem: cost(w) = wᵀ G w - 2 bᵀ w + c.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Problem {
    /// G, `k` rows of `k`: symmetric, without negative eigenvalues.
    pub gram: Vec<f64>,
    /// b, `k` numbers.
    pub linear: Vec<f64>,
    /// c: the cost of no weights at all.
    pub constant: f64,
}

impl Problem {
    /// Cost of weights.
    pub fn cost(&self, weights: &[f64]) -> f64 {
        let k = weights.len();
        let rows = weights.iter().enumerate().map(|(i, w)| w * (dot(&self.gram[i * k..(i + 1) * k], weights) - 2.0 * self.linear[i]));
        rows.sum::<f64>() + self.constant
    }

    /// Adds `strength` times the squared distance of the weights from others.
    pub(crate) fn pull(&mut self, strength: f64, towards: &[f64]) {
        let k = self.linear.len();
        self.gram.iter_mut().step_by(k + 1).for_each(|g| *g += strength);
        self.linear.iter_mut().zip(towards).for_each(|(l, w)| *l += strength * w);
        self.constant += strength * towards.iter().map(|w| w * w).sum::<f64>();
    }
}

/// What proves the weights, beside the weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Certificate {
    /// Cost of the weights.
    pub cost: f64,
    /// Largest violation of the conditions of Karush, Kuhn and Tucker among the chosen keys, over the size of the gradient: rounding alone
    /// when solved.
    pub kkt: f64,
    /// No weights within the constraints cost less, up to rounding: the cost itself where the search was finished.
    pub lower_bound: f64,
    /// No weights on another set of keys cost less than this; infinite where there is no other. Near the cost, the choice of keys is a
    /// toss-up.
    pub runner_up: f64,
    /// Sets of keys that were solved with their bounds.
    pub solved: usize,
    /// Whether every set was looked at or ruled out.
    pub finished: bool,
}

/// Solves problems of one size; all its memory is taken when it is made.
#[derive(Clone, Debug)]
pub struct Solver {
    n_keys: usize,
    limits: Limits,
    boxed: Boxed,
    search: Search,
    order: Vec<usize>,
    picked: Vec<f64>,
}

impl Solver {
    /// For `n_keys` keys.
    ///
    /// # Errors
    /// No keys, or bounds between which no weights add up to 1.
    pub fn new(n_keys: usize, limits: Limits) -> Result<Self, WeightsError> {
        if n_keys == 0 {
            return Err(WeightsError::NoKeys);
        }
        let keys = limits.max_nonzero.clamp(1, n_keys);
        let feasible = limits.lower <= 0.0 && limits.upper > 0.0 && keys as f64 * limits.upper >= 1.0;
        if !feasible {
            return Err(WeightsError::Bounds { keys, lower: limits.lower, upper: limits.upper });
        }
        let limits = Limits { max_nonzero: keys, ..limits };
        Ok(Self {
            n_keys,
            limits,
            boxed: Boxed::new(n_keys, limits.lower, limits.upper),
            search: Search::new(n_keys, keys),
            order: Vec::with_capacity(n_keys),
            picked: vec![0.0; keys],
        })
    }

    /// The weights of least cost within the constraints, into `weights`, one a key.
    ///
    /// Keys that repeat others within rounding get no weight where the others can carry it. A problem of another size than the solver's
    /// leaves `weights` alone and is never finished.
    pub fn solve(&mut self, problem: &Problem, weights: &mut [f64]) -> Certificate {
        let k = self.n_keys;
        if problem.gram.len() != k * k || problem.linear.len() != k || weights.len() != k {
            return Certificate { cost: f64::NAN, kkt: f64::NAN, lower_bound: f64::NEG_INFINITY, ..Certificate::default() };
        }
        // The nearest keys come first: they make a good first set, which rules out the most others.
        let alone = |i: &usize| problem.gram[i * k + i] - 2.0 * problem.linear[*i];
        self.order.clear();
        self.order.extend(0..k);
        self.order.sort_unstable_by(|a, b| alone(a).total_cmp(&alone(b)).then(a.cmp(b)));
        let keys = self.limits.max_nonzero;
        let found = if keys == k {
            search::Found { finished: true, solved: 1, runner_up: f64::INFINITY }
        } else {
            self.search.run(problem, &self.order, &mut self.boxed)
        };
        let set = if keys == k { &self.order[..] } else { self.search.best() };
        let end = self.boxed.solve(problem, set, &mut self.picked);
        weights.fill(0.0);
        set.iter().zip(&self.picked).for_each(|(i, w)| weights[*i] = *w);
        let cost = problem.cost(weights).max(0.0);
        let lower_bound = (cost - end.gap).min(found.runner_up).max(0.0);
        Certificate { cost, kkt: end.kkt, lower_bound, runner_up: found.runner_up.max(0.0), solved: found.solved, finished: found.finished }
    }
}

/// Dot product in four lanes, so that its bits are the same everywhere.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (a, b) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a.zip(b) {
        for i in 0..4 {
            lanes[i] += x[i] * y[i];
        }
    }
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]) + rest
}
