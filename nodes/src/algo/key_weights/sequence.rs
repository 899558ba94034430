//! Weights that change smoothly over time.

use super::{Certificate, Problem, Solver};
use crate::algo::smoothness::{Bends, Smoothing, bends};

/// Most sweeps over the frames.
const SWEEPS: usize = 400;
/// A sweep that changes no weight by more than this is the last.
const STILL: f64 = 1e-10;

/// Mean squared length of the keys' differences over all frames: the unit of smoothness, so that its effect does not depend on the size of
/// the drawing.
pub(super) fn unit(problems: &[Problem]) -> f64 {
    let of = |p: &Problem| p.gram.iter().step_by(p.linear.len() + 1).sum::<f64>() / p.linear.len().max(1) as f64;
    problems.iter().map(of).sum::<f64>() / problems.len().max(1) as f64
}

/// Makes the weights of all frames the least of cost plus the price of the weights' bends, in units of the mean squared length of the keys'
/// differences.
///
/// Frames are solved one after the other with their neighbours held, each exactly within its constraints, in sweeps; no sweep raises the
/// total. With as many weights as keys the problem is convex and the answer the least there is; with fewer, it is the nearest from where it
/// starts. `weights` come in solved on their own, one a key, frame by frame; certificates are of the frame's share of the total. Sweeps,
/// and whether the last changed next to nothing. `between` is asked now and then and may stop with an error of its own.
///
/// # Errors
/// That of `between`.
pub fn smooth<E>(
    solver: &mut Solver,
    problems: &[Problem],
    smoothing: Smoothing,
    weights: &mut [Vec<f64>],
    certificates: &mut [Certificate],
    mut between: impl FnMut() -> Result<(), E>,
) -> Result<(usize, bool), E> {
    let (bends, unit) = (Bends::new(smoothing, &bends(weights)), unit(problems));
    let mut own = Problem::default();
    let mut new = vec![0.0; problems.first().map_or(0, |p| p.linear.len())];
    for sweep in 1..=SWEEPS {
        let mut moved = 0.0f64;
        for t in 0..problems.len() {
            between()?;
            own.clone_from(&problems[t]);
            if let Some((strength, towards)) = bends.towards(weights, t) {
                own.pull(unit * strength, &towards);
            }
            let found = solver.solve(&own, &mut new);
            certificates[t] = of_total(&problems[t], &new, found);
            moved = weights[t].iter().zip(&new).fold(moved, |m, (a, b)| m.max((a - b).abs()));
            weights[t].copy_from_slice(&new);
        }
        if moved <= STILL {
            return Ok((sweep, true));
        }
    }
    Ok((SWEEPS, false))
}

/// The certificate with what the neighbours ask for taken off again, so that costs compare with the frame's own.
fn of_total(problem: &Problem, weights: &[f64], found: Certificate) -> Certificate {
    let cost = problem.cost(weights).max(0.0);
    let own = |total: f64| (total - found.cost + cost).max(0.0);
    Certificate { cost, lower_bound: own(found.lower_bound), runner_up: own(found.runner_up), ..found }
}
