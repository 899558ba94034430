//! Second differences over time: frames solved together.
//!
//! Conjugate gradients, each frame's own system as the preconditioner. A constraint of a frame is kept by every step, since its solver keeps it.

use super::LiftError;
use super::linear::{Pose, System};
use super::subspace::inner;
use crate::algo::smoothness::{Bends, Smoothing, bends};

/// Steps at most; they are usually some dozens.
const STEPS: usize = 400;

/// Dᵀ W D times `x`, D the second differences and W their prices: its own adjoint.
fn bent(x: &[Pose], bends: &Bends, y: &mut [Pose]) {
    for (k, y) in y.iter_mut().enumerate() {
        for (j, factor) in bends.stencil(k).into_iter().enumerate().filter(|(_, f)| *f != 0.0) {
            if let Some(other) = (k + j).checked_sub(2).and_then(|at| x.get(at)) {
                y.iter_mut().zip(other).for_each(|(y, x)| *y += x * factor);
            }
        }
    }
}

/// Prices of the second differences of what frames, each on its own, add to `priors`: less where they bend many times as hard as they mostly do.
fn prices(systems: &[System], priors: &[Pose], smoothing: Smoothing) -> Result<Bends, (usize, LiftError)> {
    let count = systems.len().saturating_sub(2);
    if smoothing.accents <= 0.0 {
        return Ok(Bends::new(smoothing, &vec![1.0; count]));
    }
    let own = |(k, s): (usize, &System)| {
        let alone = s.solver(0.0).map_err(|e| (k, e))?.solve(&s.right(), true).ok_or((k, LiftError::Undetermined))?;
        Ok(alone.iter().zip(&priors[k]).flat_map(|(x, p)| <[f64; 3]>::from(x - p)).collect())
    };
    let added = systems.iter().enumerate().map(own).collect::<Result<Vec<Vec<f64>>, _>>()?;
    Ok(Bends::new(smoothing, &bends(&added)))
}

fn dot(a: &[Pose], b: &[Pose]) -> f64 {
    a.iter().zip(b).map(|(a, b)| inner(a, b)).sum()
}

fn add(x: &mut [Pose], d: &[Pose], by: f64) {
    x.iter_mut().flatten().zip(d.iter().flatten()).for_each(|(x, d)| *x += d * by);
}

/// The least sum of all frames' energies and the priced squared second differences of what they add to `priors`.
pub(super) fn solve(systems: &[System], priors: &[&Pose], smoothing: Smoothing) -> Result<Vec<Pose>, (usize, LiftError)> {
    let n = systems.len();
    let priors: Vec<Pose> = priors.iter().map(|p| (*p).clone()).collect();
    let prices = prices(systems, &priors, smoothing)?;
    let diagonal: Vec<f64> = (0..n).map(|k| prices.stencil(k)[2]).collect();
    let own = systems.iter().enumerate().map(|(k, s)| s.solver(diagonal[k]).map_err(|e| (k, e)));
    let solvers = own.collect::<Result<Vec<_>, _>>()?;
    let each = |right: &[Pose], pulled: bool| {
        let one = |(k, right): (usize, &Pose)| solvers[k].solve(right, pulled).ok_or((k, LiftError::Undetermined));
        right.iter().enumerate().map(one).collect::<Result<Vec<Pose>, _>>()
    };
    let times = |x: &[Pose]| {
        let mut y: Vec<Pose> = systems.iter().zip(x).map(|(s, x)| s.times(x)).collect();
        bent(x, &prices, &mut y);
        y
    };
    let near: Vec<Pose> = (0..n).map(|k| systems[k].start(&priors[k], diagonal[k])).collect();
    let mut x = each(&near, true)?;
    let mut rest: Vec<Pose> = systems.iter().map(System::right).collect();
    bent(&priors, &prices, &mut rest);
    add(&mut rest, &times(&x), -1.0);
    let mut step = each(&rest, false)?;
    let mut direction = step.clone();
    let mut size = dot(&rest, &step);
    let enough = size * 1e-24;
    for _ in 0..STEPS {
        if !(size > enough && size > 0.0) {
            break;
        }
        let product = times(&direction);
        let by = size / dot(&direction, &product);
        add(&mut x, &direction, by);
        add(&mut rest, &product, -by);
        step = each(&rest, false)?;
        let next = dot(&rest, &step);
        let keep = next / size;
        direction.iter_mut().flatten().zip(step.iter().flatten()).for_each(|(d, s)| *d = *s + *d * keep);
        size = next;
    }
    let finite = |p: &Pose| p.iter().all(|v| v.iter().all(|c| c.is_finite()));
    match x.iter().position(|p| !finite(p)) {
        Some(k) => Err((k, LiftError::Undetermined)),
        None => Ok(x),
    }
}
