//! The quadratic program on a given set of keys: sum and bounds, by active sets.

use super::Problem;

/// Where a weight stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Free,
    Low,
    High,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct End {
    /// Cost of the weights.
    pub(super) cost: f64,
    /// Largest violation of the optimality conditions over the size of the gradient.
    pub(super) kkt: f64,
    /// The cost is above the least possible by no more than this (weak duality).
    pub(super) gap: f64,
}

/// A primal active-set solver and its memory.
///
/// From a feasible start: a Newton step in the free weights, cut at the first bound, which then holds its weight; where the step is whole,
/// the held weight whose multiplier has the wrong sign most is let go (Nocedal, Wright, *Numerical Optimization*, 2006, algorithm 16.3).
/// One of the free weights is eliminated by the sum, so that steps keep it to rounding.
#[derive(Clone, Debug)]
pub(super) struct Boxed {
    lower: f64,
    upper: f64,
    gram: Vec<f64>,
    linear: Vec<f64>,
    gradient: Vec<f64>,
    side: Vec<Side>,
    free: Vec<usize>,
    factor: Vec<f64>,
    step: Vec<f64>,
}

/// Pivots below this share of their diagonal are rounding: such a key is a mixture of the others.
const DEPENDENT: f64 = 1e-13;

impl Boxed {
    pub(super) fn new(n: usize, lower: f64, upper: f64) -> Self {
        let (vector, matrix) = (vec![0.0; n], vec![0.0; n * n]);
        Self {
            lower,
            upper,
            gram: matrix.clone(),
            linear: vector.clone(),
            gradient: vector.clone(),
            side: vec![Side::Free; n],
            free: Vec::with_capacity(n),
            factor: matrix,
            step: vector,
        }
    }

    /// Weights of least cost on the keys of `set`, in its order.
    pub(super) fn solve(&mut self, problem: &Problem, set: &[usize], weights: &mut [f64]) -> End {
        let (n, k) = (set.len(), problem.linear.len());
        for (i, &a) in set.iter().enumerate() {
            self.linear[i] = problem.linear[a];
            for (j, &b) in set.iter().enumerate() {
                self.gram[i * n + j] = problem.gram[a * k + b];
            }
        }
        let weights = &mut weights[..n];
        self.start(weights);
        // The gradient's own size, so that what is left of it can be told from rounding.
        let scale = (0..n).fold(f64::MIN_POSITIVE, |s, i| s.max(self.gram[i * n + i]).max(self.linear[i].abs()));
        let mut refined = false;
        for _ in 0..20 * n + 20 {
            self.slope(weights);
            if self.free.len() > 1 && !self.advance(weights) {
                refined = false;
                continue;
            }
            self.slope(weights);
            if self.release(n, 1e-13 * scale) {
                refined = false;
            } else if refined || self.free.len() < 2 {
                break;
            } else {
                // A second step from the end takes out what rounding left of the first.
                refined = true;
            }
        }
        self.end(problem.constant, weights, scale)
    }

    /// As much as can be on the first keys; what then stands at a bound is held there.
    fn start(&mut self, weights: &mut [f64]) {
        let mut rest = 1.0;
        self.free.clear();
        for (i, w) in weights.iter_mut().enumerate() {
            *w = self.upper.min(rest);
            rest -= *w;
            self.side[i] = if *w >= self.upper {
                Side::High
            } else if *w <= self.lower {
                Side::Low
            } else {
                Side::Free
            };
            if self.side[i] == Side::Free {
                self.free.push(i);
            }
        }
    }

    /// Half the gradient of the cost: G w - b.
    fn slope(&mut self, weights: &[f64]) {
        let n = weights.len();
        for i in 0..n {
            let row = &self.gram[i * n..(i + 1) * n];
            self.gradient[i] = row.iter().zip(weights.iter()).map(|(g, w)| g * w).sum::<f64>() - self.linear[i];
        }
    }

    /// A Newton step of the free weights; false where a bound cut it.
    fn advance(&mut self, weights: &mut [f64]) -> bool {
        let n = weights.len();
        self.newton(n);
        let (mut share, mut cut) = (1.0, None);
        for (at, &i) in self.free.iter().enumerate() {
            let (w, p) = (weights[i], self.step[at]);
            let room = if p < 0.0 { self.lower - w } else { self.upper - w };
            // Compared before dividing: steps may be of any size.
            if p != 0.0 && room.abs() < share * p.abs() {
                (share, cut) = (room / p, Some((at, p < 0.0)));
            }
        }
        for (at, &i) in self.free.iter().enumerate() {
            weights[i] += share * self.step[at];
        }
        let Some((at, low)) = cut else { return true };
        let i = self.free.remove(at);
        (self.side[i], weights[i]) = if low { (Side::Low, self.lower) } else { (Side::High, self.upper) };
        false
    }

    /// The step to the least cost over the free weights, the first of which takes what the others leave of the sum.
    fn newton(&mut self, n: usize) {
        let (first, m) = (self.free[0], self.free.len() - 1);
        let g = |i: usize, j: usize| self.gram[i * n + j];
        for a in 0..m {
            let i = self.free[a + 1];
            for b in 0..=a {
                let j = self.free[b + 1];
                self.factor[a * n + b] = (g(i, j) - g(i, first)) + (g(first, first) - g(first, j));
            }
            self.step[a + 1] = self.gradient[first] - self.gradient[i];
        }
        // Cholesky; a key that depends on those before it keeps its weight.
        for a in 0..m {
            for b in 0..=a {
                let sum: f64 = (0..b).map(|c| self.factor[a * n + c] * self.factor[b * n + c]).sum();
                let left = self.factor[a * n + b] - sum;
                if b < a {
                    let pivot = self.factor[b * n + b];
                    self.factor[a * n + b] = if pivot == 0.0 { 0.0 } else { left / pivot };
                } else {
                    let whole = self.factor[a * n + a].max(DEPENDENT * g(first, first).max(g(self.free[a + 1], self.free[a + 1])));
                    self.factor[a * n + a] = if left > DEPENDENT * whole { left.sqrt() } else { 0.0 };
                }
            }
        }
        for a in 0..m {
            let sum: f64 = (0..a).map(|c| self.factor[a * n + c] * self.step[c + 1]).sum();
            let pivot = self.factor[a * n + a];
            self.step[a + 1] = if pivot == 0.0 { 0.0 } else { (self.step[a + 1] - sum) / pivot };
        }
        for a in (0..m).rev() {
            let sum: f64 = (a + 1..m).map(|c| self.factor[c * n + a] * self.step[c + 1]).sum();
            let pivot = self.factor[a * n + a];
            self.step[a + 1] = if pivot == 0.0 { 0.0 } else { (self.step[a + 1] - sum) / pivot };
        }
        self.step[0] = -self.step[1..=m].iter().sum::<f64>();
    }

    /// The multiplier of the sum: what the gradient is at free weights; with none free, between what the held ones ask for.
    fn multiplier(&self, n: usize) -> f64 {
        if let Some(first) = self.free.first() {
            return self.gradient[*first];
        }
        let high = (0..n).filter(|&i| self.side[i] == Side::High).map(|i| self.gradient[i]).fold(f64::NEG_INFINITY, f64::max);
        let low = (0..n).filter(|&i| self.side[i] == Side::Low).map(|i| self.gradient[i]).fold(f64::INFINITY, f64::min);
        match (high.is_finite(), low.is_finite()) {
            (true, true) => 0.5 * (high + low),
            (true, false) => high,
            _ => low,
        }
    }

    /// Lets go of the weight that wants it most; with none free, of one at each bound. False where none does by more than `tolerance`.
    fn release(&mut self, n: usize, tolerance: f64) -> bool {
        let level = self.multiplier(n);
        let wish = |i: usize| match self.side[i] {
            Side::Free => 0.0,
            Side::Low => level - self.gradient[i],
            Side::High => self.gradient[i] - level,
        };
        let most = |side: Option<Side>| {
            let all = (0..n).filter(|&i| side.is_none_or(|s| s == self.side[i])).filter(|&i| wish(i) > tolerance);
            all.fold(None, |best: Option<usize>, i| if best.is_none_or(|b| wish(i) > wish(b)) { Some(i) } else { best })
        };
        let freed = if self.free.is_empty() { [most(Some(Side::Low)), most(Some(Side::High))] } else { [most(None), None] };
        for i in freed.into_iter().flatten() {
            self.side[i] = Side::Free;
            self.free.push(i);
        }
        freed != [None, None]
    }

    fn end(&self, constant: f64, weights: &[f64], scale: f64) -> End {
        let level = self.multiplier(weights.len());
        let mut end = End { cost: constant, ..End::default() };
        for (i, w) in weights.iter().enumerate() {
            let slope = self.gradient[i] - level;
            end.cost += w * (self.gradient[i] - self.linear[i]);
            let wrong = match self.side[i] {
                Side::Free => slope.abs(),
                Side::Low => -slope,
                Side::High => slope,
            };
            end.kkt = end.kkt.max(wrong / scale);
            end.gap += 2.0 * if slope > 0.0 { slope * (w - self.lower) } else { -slope * (self.upper - w) };
        }
        end
    }
}
