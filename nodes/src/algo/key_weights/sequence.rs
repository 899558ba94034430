//! Weights that change smoothly over time: beyond the paper, which has "no temporal constraints" and jitters for it.

use super::{Certificate, Problem, Solver};

/// Most sweeps over the frames.
const SWEEPS: usize = 400;
/// A sweep that changes no weight by more than this is the last.
const STILL: f64 = 1e-10;

/// Factors of the frames two before to two after in the gradient of the sum of squared second differences, at frame `t` of `n`.
pub(super) fn stencil(t: usize, n: usize) -> [f64; 5] {
    let mut out = [0.0; 5];
    // Second differences are centred on the frames that have both neighbours.
    for (centre, own) in [(t.wrapping_sub(1), 1.0), (t, -2.0), (t + 1, 1.0)] {
        if centre >= 1 && centre < n.saturating_sub(1) {
            for (at, factor) in [(centre - 1, 1.0), (centre, -2.0), (centre + 1, 1.0)] {
                out[at + 2 - t] += own * factor;
            }
        }
    }
    out
}

/// Mean squared length of the keys' differences: the unit of smoothness, so that its effect does not depend on the size of the drawing.
pub(crate) fn unit(problem: &Problem) -> f64 {
    let k = problem.linear.len().max(1);
    problem.gram.iter().step_by(k + 1).sum::<f64>() / k as f64
}

/// Makes the weights of all frames the least of cost plus `smoothness` times the squared second differences of the weights over time.
///
/// Costs are counted in units of the mean squared length of the keys' differences. Frames are solved one after the other with their neighbours held, each exactly
/// within its constraints, in sweeps; no sweep raises the total. With as many weights as keys the problem is convex and the answer the least there
/// is; with fewer, it is the nearest from where it starts. `weights` come in solved on their own, `n_keys` a frame; certificates are of the frame's
/// share of the total.
pub fn smooth(
    solver: &mut Solver,
    problems: &[Problem],
    smoothness: f64,
    weights: &mut [Vec<f64>],
    certificates: &mut [Certificate],
) -> usize {
    let n = problems.len();
    let mut own = Problem::default();
    let Some(first) = problems.first() else { return 0 };
    let mut new = vec![0.0; first.linear.len()];
    for sweep in 1..=SWEEPS {
        let mut moved = 0.0f64;
        for t in 0..n {
            let factors = stencil(t, n);
            pulled(&problems[t], weights, t, smoothness, factors, &mut own);
            let found = solver.solve(&own, &mut new);
            certificates[t] = Certificate { cost: problems[t].cost(&new).max(0.0), ..found };
            moved = weights[t].iter().zip(&new).fold(moved, |m, (a, b)| m.max((a - b).abs()));
            weights[t].copy_from_slice(&new);
        }
        if moved <= STILL {
            return sweep;
        }
    }
    SWEEPS
}

/// The problem of frame `t` with its neighbours held.
pub(crate) fn pulled(problem: &Problem, weights: &[Vec<f64>], t: usize, smoothness: f64, factors: [f64; 5], out: &mut Problem) {
    let (k, strength) = (problem.linear.len(), smoothness * unit(problem));
    out.clone_from(problem);
    out.gram.iter_mut().step_by(k + 1).for_each(|g| *g += strength * factors[2]);
    for (at, factor) in factors.iter().enumerate().filter(|(at, f)| *at != 2 && **f != 0.0) {
        let Some(other) = (t + at).checked_sub(2).and_then(|s| weights.get(s)) else { continue };
        out.linear.iter_mut().zip(other).for_each(|(l, w)| *l -= strength * factor * w);
    }
}
