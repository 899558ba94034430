//! Jitter taken out of curves, and nothing else: zero phase, and impacts stay sharp.
//!
//! The curve x minimises Σ (x - y)² + λ Σ w (third difference of x)²: the smoothing of Whittaker (1923) with differences of third order, which leaves every
//! parabola as it is, so that an apex keeps its height. Where third differences stand out of the jitter (contacts, accents, snaps) the weights w leave them free;
//! weights and curve are found in turn (iteratively reweighted least squares, with the weights of Geman and McClure).

/// How curves are smoothed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smooth {
    /// What swings faster than once in so many frames is jitter.
    pub window: f64,
    /// How many times the jitter a jerk must be to be meant.
    pub keep: f64,
}

/// Rounds of weights and curve.
const ROUNDS: usize = 30;
/// Weight of a frame that must not move.
const PINNED: f64 = 1e12;

impl Smooth {
    /// Smooths curves that belong together, one value at each of `times`, which rise; those of `pinned` frames stay. O(n).
    pub fn apply(&self, curves: &[Vec<f64>], times: &[f64], pinned: &[bool]) -> Vec<Vec<f64>> {
        let n = times.len();
        if n < 4 || curves.is_empty() {
            return curves.to_vec();
        }
        let stencils: Vec<[f64; 4]> = (0..n - 3).map(|i| stencil(&times[i..i + 4], step(times))).collect();
        let jerk = |x: &[f64], i: usize| (0..4).map(|k| stencils[i][k] * x[i + k]).sum::<f64>();
        let jitter: Vec<f64> = curves.iter().map(|y| level(&(0..n - 3).map(|i| jerk(y, i)).collect::<Vec<_>>())).collect();
        let strength = libm::pow(self.window / std::f64::consts::TAU, 6.0);
        let mut found = curves.to_vec();
        for _ in 0..ROUNDS {
            let stands_out = |i: usize| {
                let all = found.iter().zip(&jitter).map(|(x, s)| {
                    let j = jerk(x, i).abs();
                    if *s > 0.0 {
                        j / s
                    } else if j > 0.0 {
                        f64::INFINITY
                    } else {
                        0.0
                    }
                });
                all.fold(0.0f64, f64::max)
            };
            let weights: Vec<f64> = (0..n - 3).map(|i| strength * weight(stands_out(i) / self.keep)).collect();
            let next: Vec<Vec<f64>> = curves.iter().map(|y| solve(y, &stencils, &weights, pinned)).collect();
            let moved = next.iter().flatten().zip(found.iter().flatten()).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            found = next;
            if moved == 0.0 {
                break;
            }
        }
        for (x, y) in found.iter_mut().zip(curves) {
            x.iter_mut().zip(y).zip(pinned).filter(|(_, p)| **p).for_each(|((x, y), _)| *x = *y);
        }
        found
    }
}

/// The usual step between times.
fn step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).collect();
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The third difference at four times, as that of even steps: 6 step³ times the divided difference.
fn stencil(times: &[f64], step: f64) -> [f64; 4] {
    std::array::from_fn(|k| {
        let product: f64 = (0..4).filter(|j| *j != k).map(|j| times[k] - times[j]).product();
        6.0 * step * step * step / product
    })
}

/// The usual size of third differences: their median magnitude as a standard deviation.
fn level(jerks: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = jerks.iter().map(|j| j.abs()).collect();
    let middle = sizes.len() / 2;
    *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745
}

/// Weight of a jerk that is so many times what is kept.
fn weight(r: f64) -> f64 {
    let q = 1.0 / (1.0 + r * r);
    q * q
}

/// Solves (P + Dᵀ W D) x = P y, a band of three: by L D Lᵀ.
fn solve(y: &[f64], stencils: &[[f64; 4]], weights: &[f64], pinned: &[bool]) -> Vec<f64> {
    let n = y.len();
    // Solved for what is to be added, so that a curve without jerks stays as it is to the last bit.
    let mut band = vec![[0.0f64; 4]; n];
    let mut x = vec![0.0f64; n];
    for (i, b) in band.iter_mut().enumerate() {
        b[0] = if pinned[i] { PINNED } else { 1.0 };
    }
    for (i, (s, w)) in stencils.iter().zip(weights).enumerate() {
        let jerk: f64 = (0..4).map(|k| s[k] * y[i + k]).sum();
        for a in 0..4 {
            x[i + a] -= w * s[a] * jerk;
            for b in a..4 {
                band[i + a][b - a] += w * s[a] * s[b];
            }
        }
    }
    for i in 0..n {
        let pivot = band[i][0];
        for k in 1..4.min(n - i) {
            let factor = band[i][k] / pivot;
            for j in k..4.min(n - i) {
                band[i + k][j - k] -= factor * band[i][j];
            }
            x[i + k] -= factor * x[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (1..4.min(n - i)).map(|k| band[i][k] * x[i + k]).sum();
        x[i] = (x[i] - known) / band[i][0];
    }
    x.iter().zip(y).map(|(x, y)| x + y).collect()
}
