//! A contour as an affine motion of mixed keys: the capture of Bregler, Loeb, Chuang, Deshpande 2002, section 3.2.
//!
//! Equation (4) is minimised by turns, as in the paper: the motion for the keys as they are mixed (equations 5 and 6), then the weights for the motion (equation 7 under
//! its three constraints, [`super::key_weights`]). Each turn is exact, so that the error never rises. Beyond the paper:
//! - the translation is taken out of both turns, and after them a Gauss-Newton step moves motion and weights together on the chosen
//!   keys: turns alone crawl where motion and keys do like things;
//! - the first weights come from the shape brought back instead of the keys brought forward. |Σ w S - (B V + e)|² is linear in the weights, in B and in
//!   e together, so that one quadratic program finds the best of all sets of keys at once, without a first guess of the motion. Where the shape is made of
//!   the keys exactly, that is the answer. The nearest single keys are starts as well;
//! - the spread of the answer is told: least squares' own standard deviations, and the condition of the last system.

use nalgebra::{DMatrix, DVector};

use super::fit_affine::{Fit, centroid, fit_finite};
use super::key_weights::{Certificate, KeySpace, Limits, Problem, Solver, WeightsError};
use super::raster::Affine;
use super::track_affine::Model;

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
    /// Squared error after each round, pixels²: it never rises.
    pub errors: Vec<f64>,
    /// Whether the last round was one that changed next to nothing.
    pub converged: bool,
    /// Largest over least eigenvalue of the last system, its columns scaled to one length: how much less sure the least sure direction is.
    pub condition: f64,
    /// Standard deviations of a1, a2, a3, a4, of the place of the shape's centre in x and y, and of each weight (0 for those that stand at nought or at a bound).
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
        Ok(Self { options, space, keys, centres, solver, problem: Problem::default(), mixed: vec![[0.0; 2]; n] })
    }

    /// Captures one shape.
    ///
    /// # Errors
    /// A shape with another number of points than the keys, or with one that is not finite.
    pub fn capture(&mut self, shape: &[[f64; 2]]) -> Result<Capture, WeightsError> {
        self.space.check(shape)?;
        let mut best: Option<(State, Vec<f64>, bool)> = None;
        for weights in self.starts(shape) {
            let (state, errors, converged) = self.descend(shape, &weights);
            // Of starts that end alike the first stays.
            if best.as_ref().is_none_or(|b| state.error < b.0.error * (1.0 - 1e-9)) {
                best = Some((state, errors, converged));
            }
        }
        let Some((state, errors, converged)) = best else { return Err(WeightsError::NoKeys) };
        Ok(self.finish(shape, state, errors, converged))
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
    fn descend(&mut self, shape: &[[f64; 2]], weights: &[f64]) -> (State, Vec<f64>, bool) {
        let mut state = self.refit(shape, weights.to_vec());
        let mut errors = vec![state.error];
        // Below this all is rounding of the coordinates.
        let floor = 1e-30 * shape.len() as f64 * shape.iter().flatten().fold(1.0, |m: f64, v| m.max(v.abs())).powi(2);
        for _ in 0..self.options.max_rounds {
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
        State { motion, weights, error: rms * rms * shape.len() as f64, certificate: Certificate::default() }
    }

    /// Weights for the motion, motion for the weights; `None` where that is no better.
    fn turn(&mut self, shape: &[[f64; 2]], state: &State) -> Option<State> {
        let mut weights = vec![0.0; self.space.n_keys()];
        self.space.problem(&state.motion, shape, &mut self.problem);
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
        let p = motions + keys;
        let mut jacobian = DMatrix::zeros(2 * shape.len(), p);
        let mut residual = DVector::zeros(2 * shape.len());
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
        // Columns of one length, so that turns, shifts and weights can be compared.
        let scale: Vec<f64> = jacobian.column_iter().map(|c| 1.0 / c.norm().max(f64::MIN_POSITIVE)).collect();
        jacobian.column_iter_mut().zip(&scale).for_each(|(mut c, s)| c *= *s);
        let right = jacobian.tr_mul(&residual);
        (System { normal: jacobian.tr_mul(&jacobian), scale, motions }, right)
    }

    /// The answer in the keys' own coordinates.
    fn finish(&mut self, shape: &[[f64; 2]], mut state: State, errors: Vec<f64>, converged: bool) -> Capture {
        self.space.problem(&state.motion, shape, &mut self.problem);
        let mut weights = vec![0.0; state.weights.len()];
        let certificate = self.solver.solve(&self.problem, &mut weights);
        state.certificate = Certificate { cost: state.error, ..certificate };
        let free = self.free(&state.weights);
        let (system, _) = self.system(shape, &state, &free);
        let points = 2 * shape.len();
        let variance = if points > system.scale.len() { state.error / (points - system.scale.len()) as f64 } else { f64::NAN };
        let (condition, deviations) = system.spread(self.options.model, &state.motion, &free, state.weights.len(), variance);
        self.space.mix(&state.weights, &mut self.mixed);
        let m = state.motion;
        let moved = self.mixed.iter().map(|s| [0, 1].map(|c| m[(c, 0)] * s[0] + m[(c, 1)] * s[1] + m[(c, 2)])).collect();
        // The keys lie about their own centres here: how these mix goes back into the translation.
        let centre = state.weights.iter().zip(&self.centres).fold([0.0; 2], |s, (w, c)| [s[0] + w * c[0], s[1] + w * c[1]]);
        let motion = Affine::new(
            m[(0, 0)],
            m[(0, 1)],
            m[(0, 2)] - m[(0, 0)] * centre[0] - m[(0, 1)] * centre[1],
            m[(1, 0)],
            m[(1, 1)],
            m[(1, 2)] - m[(1, 0)] * centre[0] - m[(1, 1)] * centre[1],
        );
        let rms = (state.error / shape.len() as f64).sqrt();
        let State { weights, certificate, .. } = state;
        Capture { motion, weights, shape: moved, rms, certificate, errors, converged, condition, deviations }
    }
}

/// Parameters of a motion.
fn n_motions(model: Model) -> usize {
    match model {
        Model::Translation => 2,
        Model::Rigid => 3,
        Model::Similarity => 4,
        Model::Affine => 6,
    }
}

/// Derivatives of coordinate `c` of a moved point: `s` before the linear part, `at` after it. The translation's come first.
fn motion_row(model: Model, s: [f64; 2], at: [f64; 2], c: usize) -> [f64; 6] {
    let mut row = [0.0; 6];
    row[c] = 1.0;
    let turned = if c == 0 { -at[1] } else { at[0] };
    match model {
        Model::Translation => {}
        Model::Rigid => row[2] = turned,
        Model::Similarity => (row[2], row[3]) = (if c == 0 { s[0] } else { s[1] }, if c == 0 { -s[1] } else { s[0] }),
        Model::Affine => (row[2 + 2 * c], row[3 + 2 * c]) = (s[0], s[1]),
    }
    row
}

/// The normal equations of a Gauss-Newton step.
struct System {
    normal: DMatrix<f64>,
    /// What each parameter is counted in.
    scale: Vec<f64>,
    /// The motion's parameters come first.
    motions: usize,
}

impl System {
    fn factor(&self) -> Option<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
        self.normal.clone().cholesky()
    }

    /// Condition, and standard deviations of a1 to a4, the centre and the weights, for a variance of the coordinates.
    fn spread(&self, model: Model, motion: &Affine, free: &[usize], n_keys: usize, variance: f64) -> (f64, Vec<f64>) {
        let values = self.normal.clone().symmetric_eigenvalues();
        let (least, most) = (values.min(), values.max());
        let condition = if least > 1e-15 * most { most / least } else { f64::INFINITY };
        let inverse = if condition.is_finite() { self.factor().map(|f| f.inverse()) } else { None };
        let Some(inverse) = inverse else { return (f64::INFINITY, vec![f64::INFINITY; 6 + n_keys]) };
        let deviation = |row: &[(usize, f64)]| {
            let sum: f64 = row
                .iter()
                .flat_map(|a| row.iter().map(move |b| (a, b)))
                .map(|(a, b)| a.1 * self.scale[a.0] * inverse[(a.0, b.0)] * self.scale[b.0] * b.1)
                .sum();
            (variance * sum.max(0.0)).sqrt()
        };
        let mut out: Vec<f64> = linear_rows(model, motion).iter().map(|r| deviation(r)).collect();
        out.extend([deviation(&[(0, 1.0)]), deviation(&[(1, 1.0)])]);
        out.resize(6 + n_keys, 0.0);
        for (at, key) in free.iter().enumerate().skip(1) {
            out[6 + key] = deviation(&[(self.motions + at - 1, 1.0)]);
        }
        if let Some(first) = free.first() {
            // The first takes what the others leave of the sum.
            let all: Vec<(usize, f64)> = (1..free.len()).map(|at| (self.motions + at - 1, -1.0)).collect();
            out[6 + first] = deviation(&all);
        }
        (condition, out)
    }
}

/// How a1 to a4 depend on the parameters.
fn linear_rows(model: Model, m: &Affine) -> [Vec<(usize, f64)>; 4] {
    match model {
        Model::Translation => [(); 4].map(|()| Vec::new()),
        Model::Rigid => [-m[(1, 0)], -m[(1, 1)], m[(0, 0)], m[(0, 1)]].map(|d| vec![(2, d)]),
        Model::Similarity => [vec![(2, 1.0)], vec![(3, -1.0)], vec![(3, 1.0)], vec![(2, 1.0)]],
        Model::Affine => [2, 3, 4, 5].map(|j| vec![(j, 1.0)]),
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::raster::apply;

    struct Rng(u64);
    impl Rng {
        /// In -1..1.
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }

        /// Nearly normal.
        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.next()).sum::<f64>() * 0.5
        }
    }

    /// Blobs with bumps of their own.
    fn keys(k: usize, n: usize, seed: u64) -> Vec<[f64; 2]> {
        let mut rng = Rng(seed);
        let mut out = Vec::new();
        for key in 0..k {
            let bumps: Vec<(f64, f64, f64)> = (2..7).map(|h| (f64::from(h), 25.0 * rng.next() / f64::from(h), 3.0 * rng.next())).collect();
            for i in 0..n {
                let t = i as f64 / n as f64 * std::f64::consts::TAU;
                let r = 90.0 + bumps.iter().map(|(h, a, p)| 2.0 * a * libm::cos(h * t + p)).sum::<f64>();
                out.push([30.0 * key as f64 + r * libm::cos(t), 50.0 + r * libm::sin(t)]);
            }
        }
        out
    }

    fn mixed(keys: &[[f64; 2]], n: usize, weights: &[f64], m: &Affine) -> Vec<[f64; 2]> {
        let at = |i: usize| {
            weights.iter().enumerate().fold([0.0; 2], |s, (k, w)| [s[0] + w * keys[k * n + i][0], s[1] + w * keys[k * n + i][1]])
        };
        (0..n).map(|i| apply(m, at(i).into()).into()).collect()
    }

    /// A motion of the model and weights on three of `k` keys.
    fn truth(rng: &mut Rng, k: usize, model: Model) -> (Affine, Vec<f64>) {
        let mut weights = vec![0.0; k];
        let at = ((rng.next() + 1.0) * 0.5 * k as f64) as usize % k;
        let (a, b) = (0.5 + 0.3 * rng.next(), 0.3 + 0.2 * rng.next());
        (weights[at], weights[(at + 1) % k], weights[(at + 3) % k]) = (a, b, 1.0 - a - b);
        let (s, c) = libm::sincos(2.5 * rng.next());
        let scale = if model == Model::Rigid { 1.0 } else { 1.0 + 0.4 * rng.next() };
        let (shear, stretch) = if model == Model::Affine { (0.3 * rng.next(), 1.0 + 0.3 * rng.next()) } else { (0.0, 1.0) };
        let (d, e) = (40.0 * rng.next(), 40.0 * rng.next());
        (Affine::new(scale * c, -scale * s * stretch + shear, d, scale * s, scale * c * stretch, e), weights)
    }

    #[test]
    fn the_motion_and_the_weights_are_found_again() {
        for model in [Model::Affine, Model::Similarity, Model::Rigid] {
            let mut rng = Rng(7);
            for trial in 0..20 {
                let keys = keys(6, 120, 100 + trial);
                let (m, w) = truth(&mut rng, 6, model);
                let shape = mixed(&keys, 120, &w, &m);
                let found = Capturer::new(6, &keys, Options { model, ..Options::default() }).unwrap().capture(&shape).unwrap();
                assert!(found.errors.windows(2).all(|e| e[1] <= e[0]), "{:?}", found.errors);
                let off = found.weights.iter().zip(&w).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                let linear = (found.motion.fixed_view::<2, 2>(0, 0) - m.fixed_view::<2, 2>(0, 0)).amax();
                assert!(
                    off < 1e-6 && linear < 1e-6 && (found.motion - m).amax() < 1e-4 && found.rms < 1e-6,
                    "{model:?} {trial}: {off} {linear} {found:?}"
                );
                assert!(found.converged && found.errors.len() < 40);
            }
        }
    }

    #[test]
    fn noise_moves_the_weights_as_much_as_the_deviations_say() {
        let (mut rng, mut off, mut told, mut count) = (Rng(3), 0.0, 0.0, 0.0);
        for trial in 0..30 {
            // Drawings some 500 px across.
            let keys: Vec<_> = keys(5, 200, 500 + trial).into_iter().map(|[x, y]| [2.5 * x, 2.5 * y]).collect();
            let (m, w) = truth(&mut rng, 5, Model::Affine);
            let mut shape = mixed(&keys, 200, &w, &m);
            shape.iter_mut().flatten().for_each(|v| *v += rng.normal());
            let found = Capturer::new(5, &keys, Options::default()).unwrap().capture(&shape).unwrap();
            assert!(found.errors.windows(2).all(|e| e[1] <= e[0]));
            for (k, (a, b)) in found.weights.iter().zip(&w).enumerate() {
                assert!((a - b).abs() < 0.02, "trial {trial}: {:?} for {w:?}, deviations {:?}", found.weights, &found.deviations[6..]);
                off += (a - b) * (a - b);
                told += found.deviations[6 + k] * found.deviations[6 + k];
                count += 1.0;
            }
        }
        // Thirty trials of three weights: their mean square is known to about a fifth.
        let ratio: f64 = off / told;
        assert!((0.5..2.0).contains(&ratio), "{ratio} over {count}");
    }

    #[test]
    fn a_key_is_itself() {
        let keys = keys(4, 50, 1);
        let mut capturer = Capturer::new(4, &keys, Options::default()).unwrap();
        for k in 0..4 {
            let found = capturer.capture(&keys[k * 50..(k + 1) * 50]).unwrap();
            assert!((found.weights[k] - 1.0).abs() < 1e-9 && found.rms < 1e-9, "{found:?}");
            assert!((found.motion - super::super::raster::identity()).amax() < 1e-7);
        }
    }

    #[test]
    fn degenerate_keys_and_shapes_are_answered() {
        let one = keys(1, 40, 9);
        let repeated = [&one[..], &one[..], &one[..]].concat();
        let line: Vec<_> = (0..40).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        let point = vec![[5.0, 5.0]; 40];
        for model in [Model::Affine, Model::Similarity, Model::Rigid, Model::Translation] {
            let options = Options { model, ..Options::default() };
            for keys in [&one[..], &repeated, &line, &point, &[&one[..], &line, &point].concat()] {
                let mut capturer = Capturer::new(keys.len() / 40, keys, options).unwrap();
                for shape in [&one, &line, &point] {
                    let found = capturer.capture(shape).unwrap();
                    assert!(found.rms.is_finite() && (found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{found:?}");
                    assert!(found.errors.windows(2).all(|e| e[1] <= e[0]));
                }
            }
        }
        let found = Capturer::new(3, &repeated, Options::default()).unwrap().capture(&one).unwrap();
        assert_eq!(found.weights, [1.0, 0.0, 0.0]);
    }
}
