//! A contour as an affine motion of mixed keys: the capture of Bregler, Loeb, Chuang, Deshpande 2002, section 3.2.
//!
//! Equation (4) is minimised by turns, as in the paper: the motion for the keys as they are mixed (equations 5 and 6), then the weights for
//! the motion (equation 7 under its three constraints, [`super::key_weights`]). Each turn is exact, so that the error never rises. Beyond
//! the paper:
//! - the translation is taken out of both turns, and after them a Gauss-Newton step moves motion and weights together on the chosen
//!   keys: turns alone crawl where motion and keys do like things;
//! - the first weights come from the shape brought back instead of the keys brought forward. |Σ w S - (B V + e)|² is linear in the weights,
//!   in B and in e together, so that one quadratic program finds the best of all sets of keys at once, without a first guess of the motion.
//!   Where the shape is made of the keys exactly, that is the answer. The nearest single keys are starts as well;
//! - the spread of the answer is told: least squares' own standard deviations, and the condition of the last system;
//! - a whole sequence may be made smooth ([`smooth`]).

mod sequence;
mod system;
#[cfg(test)]
mod tests;

pub use sequence::{Smoothed, smooth};

use nalgebra::{DMatrix, DVector};
use system::{System, motion_row, n_motions};

use crate::algo::fit_affine::{Fit, centroid, fit_finite};
use crate::algo::key_weights::{Certificate, KeySpace, Limits, Problem, Solver, WeightsError};
use crate::algo::raster::Affine;
use crate::algo::track_affine::Model;

/// What a capture is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Motions that are allowed.
    pub model: Model,
    /// The three constraints on weights.
    pub limits: Limits,
    /// A round that lowers the squared error by less than this share of it is the last.
    pub tolerance: f64,
    /// Most rounds from each start.
    pub max_rounds: usize,
    /// Single keys that are started from beside the start that looks at all keys together.
    pub starts: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { model: Model::Affine, limits: Limits::default(), tolerance: 1e-10, max_rounds: 100, starts: 2 }
    }
}

/// What was captured of one shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Frame from keys, pixels.
    pub motion: Affine,
    /// One a key.
    pub weights: Vec<f64>,
    /// The keys as they are mixed and moved: what the capture makes of the shape.
    pub shape: Vec<[f64; 2]>,
    /// Root mean square distance of its points from the shape's, pixels.
    pub rms: f64,
    /// Of the weights, under the motion that was found.
    pub certificate: Certificate,
    /// Squared error after each round, pixels²: it never rises. What a sequence is smoothed by comes after it.
    pub errors: Vec<f64>,
    /// Whether the last round was one that changed next to nothing.
    pub converged: bool,
    /// Largest over least eigenvalue of the last system, its columns scaled to one length: how much less sure the least sure direction is.
    pub condition: f64,
    /// Standard deviations of a1, a2, a3, a4, of the place of the shape's centre in x and y, and of each weight (0 for those that stand at
    /// nought or at a bound).
    pub deviations: Vec<f64>,
}

/// Where a capture stands.
#[derive(Clone, Debug)]
struct State {
    /// From centred mixed keys to the shape.
    motion: Affine,
    weights: Vec<f64>,
    error: f64,
    certificate: Certificate,
}

/// The keys, ready for any number of shapes.
#[derive(Clone, Debug)]
pub struct Capturer {
    options: Options,
    /// The keys, each about its own centre: where a key lies is the motion's, not the weights'.
    space: KeySpace,
    keys: Vec<[f64; 2]>,
    centres: Vec<[f64; 2]>,
    solver: Solver,
    problem: Problem,
    mixed: Vec<[f64; 2]>,
    pull: Pull,
}

/// Weights that are wished for beside the shape: part of the error is so many times their squared distance.
#[derive(Clone, Debug, Default)]
struct Pull {
    strength: f64,
    towards: Vec<f64>,
}

impl Pull {
    fn cost(&self, weights: &[f64]) -> f64 {
        if self.strength <= 0.0 {
            return 0.0;
        }
        self.strength * weights.iter().zip(&self.towards).map(|(w, t)| (w - t) * (w - t)).sum::<f64>()
    }

    fn add(&self, problem: &mut Problem) {
        if self.strength > 0.0 {
            problem.pull(self.strength, &self.towards);
        }
    }
}

/// Steps of Gauss and Newton that are halved at most so often.
const HALVINGS: usize = 4;

impl Capturer {
    /// `n_keys` keys of as many points each, one behind the other.
    ///
    /// # Errors
    /// As [`KeySpace::new`] and [`Solver::new`].
    pub fn new(n_keys: usize, points: &[[f64; 2]], options: Options) -> Result<Self, WeightsError> {
        // The keys as they came are looked at first, so that an error tells their own numbers.
        let n = KeySpace::new(n_keys, points)?.n_points();
        let solver = Solver::new(n_keys, options.limits)?;
        let centres: Vec<[f64; 2]> = points.chunks_exact(n).map(centroid).collect();
        let keys: Vec<[f64; 2]> = points.iter().enumerate().map(|(i, p)| [p[0] - centres[i / n][0], p[1] - centres[i / n][1]]).collect();
        let space = KeySpace::new(n_keys, &keys)?;
        Ok(Self { options, space, keys, centres, solver, problem: Problem::default(), mixed: vec![[0.0; 2]; n], pull: Pull::default() })
    }

    /// Captures one shape.
    ///
    /// # Errors
    /// A shape with another number of points than the keys, or with one that is not finite.
    pub fn capture(&mut self, shape: &[[f64; 2]]) -> Result<Capture, WeightsError> {
        self.space.check(shape)?;
        self.pull.strength = 0.0;
        let mut best: Option<(State, Vec<f64>, bool)> = None;
        for weights in self.starts(shape) {
            let (state, errors, converged) = self.descend(shape, &weights, self.options.max_rounds);
            // Of starts that end alike the first stays.
            if best.as_ref().is_none_or(|b| state.error < b.0.error * (1.0 - 1e-9)) {
                best = Some((state, errors, converged));
            }
        }
        let Some((state, errors, converged)) = best else { return Err(WeightsError::NoKeys) };
        Ok(self.finish(shape, shape, 1.0, state, errors, converged))
    }

    /// First weights, in the order in which they are tried.
    fn starts(&mut self, shape: &[[f64; 2]]) -> Vec<Vec<f64>> {
        let k = self.space.n_keys();
        let mut errors: Vec<(f64, usize)> =
            self.keys.chunks_exact(shape.len()).enumerate().map(|(at, key)| (fit_finite(key, shape, self.options.model).rms, at)).collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let alone = |at: usize| (0..k).map(|i| f64::from(u8::from(i == at))).collect();
        let mut starts = vec![self.together(shape)];
        starts.extend(errors.iter().take(self.options.starts).map(|e| alone(e.1)));
        starts
    }

    /// The weights with which the keys come nearest to some motion of the shape.
    fn together(&mut self, shape: &[[f64; 2]]) -> Vec<f64> {
        let (n, k) = (shape.len(), self.space.n_keys());
        let columns = motions_of(shape, self.options.model);
        let [xx, _, yy] = self.space.products();
        self.problem.gram.clear();
        self.problem.gram.extend(xx.iter().zip(yy).map(|(a, b)| a + b));
        self.problem.linear.clear();
        self.problem.linear.resize(k, 0.0);
        let mean: Vec<f64> = [0, 1].iter().flat_map(|&c| self.space.mean().iter().map(move |p| p[c])).collect();
        self.problem.constant = product(&mean, &mean);
        let difference = |key: usize| {
            let (x, y) = self.space.difference(key);
            x.iter().chain(y).copied().collect::<Vec<f64>>()
        };
        let keys: Vec<Vec<f64>> = (0..k).map(difference).collect();
        for (l, key) in self.problem.linear.iter_mut().zip(&keys) {
            *l = -product(key, &mean);
        }
        for column in &columns {
            debug_assert_eq!(column.len(), 2 * n);
            let (along, rest): (Vec<f64>, f64) = (keys.iter().map(|key| product(key, column)).collect(), product(&mean, column));
            for i in 0..k {
                for j in 0..k {
                    self.problem.gram[i * k + j] -= along[i] * along[j];
                }
                self.problem.linear[i] += along[i] * rest;
            }
            self.problem.constant -= rest * rest;
        }
        let mut weights = vec![0.0; k];
        self.solver.solve(&self.problem, &mut weights);
        weights
    }

    /// Rounds from weights, until they change next to nothing.
    fn descend(&mut self, shape: &[[f64; 2]], weights: &[f64], rounds: usize) -> (State, Vec<f64>, bool) {
        let mut state = self.refit(shape, weights.to_vec());
        let mut errors = vec![state.error];
        // Below this all is rounding of the coordinates.
        let floor = 1e-30 * shape.len() as f64 * shape.iter().flatten().fold(1.0, |m: f64, v| m.max(v.abs())).powi(2);
        for _ in 0..rounds {
            let before = state.error;
            let turned = self.turn(shape, &state);
            let stepped = self.step(shape, turned.as_ref().unwrap_or(&state));
            match stepped.or(turned) {
                Some(better) => state = better,
                None => return (state, errors, true),
            }
            errors.push(state.error);
            if before - state.error <= self.options.tolerance * before || state.error <= floor {
                return (state, errors, true);
            }
        }
        (state, errors, false)
    }

    /// The best motion for weights.
    fn refit(&mut self, shape: &[[f64; 2]], weights: Vec<f64>) -> State {
        self.space.mix(&weights, &mut self.mixed);
        let Fit { motion, rms, .. } = fit_finite(&self.mixed, shape, self.options.model);
        let error = rms * rms * shape.len() as f64 + self.pull.cost(&weights);
        State { motion, weights, error, certificate: Certificate::default() }
    }

    /// Weights for the motion, motion for the weights; `None` where that is no better.
    fn turn(&mut self, shape: &[[f64; 2]], state: &State) -> Option<State> {
        let mut weights = vec![0.0; self.space.n_keys()];
        self.space.problem(&state.motion, shape, &mut self.problem);
        self.pull.add(&mut self.problem);
        let certificate = self.solver.solve(&self.problem, &mut weights);
        let next = State { certificate, ..self.refit(shape, weights) };
        (next.error < state.error).then_some(next)
    }

    /// A Gauss-Newton step in motion and weights together, on the keys in use; `None` where it is no better.
    fn step(&mut self, shape: &[[f64; 2]], state: &State) -> Option<State> {
        let free = self.free(&state.weights);
        if free.len() < 2 {
            return None;
        }
        let (system, residual) = self.system(shape, state, &free);
        let delta = system.factor()?.solve(&residual);
        let mut changes = vec![0.0; state.weights.len()];
        for (at, key) in free[1..].iter().enumerate() {
            let change = delta[system.motions + at] * system.scale[system.motions + at];
            changes[*key] += change;
            changes[free[0]] -= change;
        }
        let room = |w: f64, c: f64| if c < 0.0 { (self.options.limits.lower - w) / c } else { (self.options.limits.upper - w) / c };
        let mut share = state.weights.iter().zip(&changes).filter(|(_, c)| **c != 0.0).fold(1.0f64, |s, (w, c)| s.min(room(*w, *c)));
        for _ in 0..=HALVINGS {
            let weights = state.weights.iter().zip(&changes).map(|(w, c)| w + share * c).collect();
            let next = State { certificate: state.certificate, ..self.refit(shape, weights) };
            if next.error < state.error {
                return Some(next);
            }
            share *= 0.5;
        }
        None
    }

    /// Keys whose weights may go either way.
    fn free(&self, weights: &[f64]) -> Vec<usize> {
        let Limits { lower, upper, .. } = self.options.limits;
        (0..weights.len()).filter(|&k| weights[k] != 0.0 && weights[k] > lower && weights[k] < upper).collect()
    }

    /// The linear system about a state, and its right-hand side.
    fn system(&mut self, shape: &[[f64; 2]], state: &State, free: &[usize]) -> (System, DVector<f64>) {
        self.space.mix(&state.weights, &mut self.mixed);
        let m = &state.motion;
        let linear = |x: f64, y: f64| [m[(0, 0)] * x + m[(0, 1)] * y, m[(1, 0)] * x + m[(1, 1)] * y];
        let (motions, keys) = (n_motions(self.options.model), free.len().saturating_sub(1));
        let (p, points) = (motions + keys, 2 * shape.len());
        let wishes = if self.pull.strength > 0.0 { free.len() } else { 0 };
        let mut jacobian = DMatrix::zeros(points + wishes, p);
        let mut residual = DVector::zeros(points + wishes);
        for (i, (s, v)) in self.mixed.iter().zip(shape).enumerate() {
            let at = linear(s[0], s[1]);
            for c in 0..2 {
                residual[2 * i + c] = v[c] - at[c] - m[(c, 2)];
                for (j, value) in motion_row(self.options.model, *s, at, c).into_iter().take(motions).enumerate() {
                    jacobian[(2 * i + c, j)] = value;
                }
            }
        }
        for (j, key) in free.iter().skip(1).enumerate() {
            let ((x, y), (bx, by)) = (self.space.difference(*key), self.space.difference(free[0]));
            for i in 0..shape.len() {
                let d = linear(x[i] - bx[i], y[i] - by[i]);
                (jacobian[(2 * i, motions + j)], jacobian[(2 * i + 1, motions + j)]) = (d[0], d[1]);
            }
        }
        let root = self.pull.strength.sqrt();
        for (at, &key) in free.iter().enumerate().take(wishes) {
            residual[points + at] = root * (self.pull.towards[key] - state.weights[key]);
            match at {
                0 => (0..keys).for_each(|j| jacobian[(points, motions + j)] = -root),
                _ => jacobian[(points + at, motions + at - 1)] = root,
            }
        }
        // Columns of one length, so that turns, shifts and weights can be compared.
        let scale: Vec<f64> = jacobian.column_iter().map(|c| 1.0 / c.norm().max(f64::MIN_POSITIVE)).collect();
        jacobian.column_iter_mut().zip(&scale).for_each(|(mut c, s)| c *= *s);
        let right = jacobian.tr_mul(&residual);
        (System { normal: jacobian.tr_mul(&jacobian), scale, motions }, right)
    }

    /// The mixed keys, moved.
    fn moved(&mut self, state: &State) -> Vec<[f64; 2]> {
        self.space.mix(&state.weights, &mut self.mixed);
        let m = state.motion;
        self.mixed.iter().map(|s| [0, 1].map(|c| m[(c, 0)] * s[0] + m[(c, 1)] * s[1] + m[(c, 2)])).collect()
    }

    /// The answer in the keys' own coordinates, for a state that was found for `target` in place of `shape`, errors counted in `unit`.
    fn finish(&mut self, shape: &[[f64; 2]], target: &[[f64; 2]], unit: f64, state: State, errors: Vec<f64>, converged: bool) -> Capture {
        self.space.problem(&state.motion, target, &mut self.problem);
        self.pull.add(&mut self.problem);
        let mut weights = vec![0.0; state.weights.len()];
        let found = self.solver.solve(&self.problem, &mut weights);
        let (m, moved) = (state.motion, self.moved(&state));
        let error = if unit == 1.0 { state.error } else { moved.iter().zip(shape).map(|(a, b)| distance_sq(*a, *b)).sum() };
        // What the smoothing asks for is the same for all weights of the frame, so that bounds keep their distance from the cost.
        let own = |total: f64| (error + unit * (total - state.error)).max(0.0);
        let certificate = Certificate { cost: error, lower_bound: own(found.lower_bound), runner_up: own(found.runner_up), ..found };
        let free = self.free(&state.weights);
        let (system, _) = self.system(target, &state, &free);
        let (points, fitted) = (2 * shape.len(), system.scale.len());
        let variance = if points > fitted { error / (points - fitted) as f64 } else { f64::NAN };
        let (condition, deviations) = system.spread(self.options.model, &state.motion, &free, state.weights.len(), variance);
        // The keys lie about their own centres here: how these mix goes back into the translation.
        let centre = state.weights.iter().zip(&self.centres).fold([0.0; 2], |s, (w, c)| [s[0] + w * c[0], s[1] + w * c[1]]);
        let back = |c: usize| m[(c, 2)] - m[(c, 0)] * centre[0] - m[(c, 1)] * centre[1];
        let motion = Affine::new(m[(0, 0)], m[(0, 1)], back(0), m[(1, 0)], m[(1, 1)], back(1));
        let rms = (error / shape.len() as f64).sqrt();
        Capture { motion, weights: state.weights, shape: moved, rms, certificate, errors, converged, condition, deviations }
    }
}

fn distance_sq(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

/// Orthonormal columns that span the motions of a centred shape as far as they are linear: all x, then all y.
fn motions_of(shape: &[[f64; 2]], model: Model) -> Vec<Vec<f64>> {
    let c = centroid(shape);
    let (x, y): (Vec<f64>, Vec<f64>) = shape.iter().map(|p| (p[0] - c[0], p[1] - c[1])).unzip();
    let zero = vec![0.0; x.len()];
    let columns = match model {
        // Without turns there is nothing to bring back but the shape as it is, which the first round does.
        Model::Translation => Vec::new(),
        Model::Rigid | Model::Similarity => {
            let back: Vec<f64> = y.iter().map(|v| -v).collect();
            vec![[x.clone(), y].concat(), [back, x].concat()]
        }
        Model::Affine => {
            let apart = [[x.clone(), zero.clone()].concat(), [y.clone(), zero.clone()].concat()];
            let below = [[zero.clone(), x].concat(), [zero, y].concat()];
            apart.into_iter().chain(below).collect()
        }
    };
    orthonormal(columns)
}

/// Gram-Schmidt, twice; columns that depend on those before them are left out.
fn orthonormal(columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        let whole = product(&column, &column).sqrt();
        for _ in 0..2 {
            for done in &out {
                let share = product(&column, done);
                column.iter_mut().zip(done).for_each(|(c, d)| *c -= share * d);
            }
        }
        let left = product(&column, &column).sqrt();
        if left > 1e-9 * whole {
            column.iter_mut().for_each(|c| *c /= left);
            out.push(column);
        }
    }
    out
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
