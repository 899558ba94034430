//! Second differences over time: frames solved together.
//!
//! Conjugate gradients, each frame's own system as the preconditioner. A constraint of a frame is kept by every step, since its solver keeps it.

use nalgebra::Vector3;

use super::LiftError;
use super::linear::{Pose, System};
use super::subspace::inner;

/// Steps at most; they are usually some dozens.
const STEPS: usize = 400;

/// D of the second differences, transposed, times D, times `x`: its own adjoint.
fn bent(x: &[Pose], weight: f64, y: &mut [Pose]) {
    for k in 1..x.len() - 1 {
        for m in 0..x[k].len() {
            let second: Vector3<f64> = (x[k - 1][m] - 2.0 * x[k][m] + x[k + 1][m]) * weight;
            y[k - 1][m] += second;
            y[k][m] -= 2.0 * second;
            y[k + 1][m] += second;
        }
    }
}

/// What `bent` has on its diagonal.
fn diagonal(k: usize, n: usize) -> f64 {
    // Middle of the difference about k, and end of those about its neighbours.
    let is_middle = |j: Option<usize>| j.is_some_and(|j| j >= 1 && j + 1 < n);
    let of = |j: Option<usize>, w: f64| if is_middle(j) { w } else { 0.0 };
    of(Some(k), 4.0) + of(k.checked_sub(1), 1.0) + of(Some(k + 1), 1.0)
}

fn dot(a: &[Pose], b: &[Pose]) -> f64 {
    a.iter().zip(b).map(|(a, b)| inner(a, b)).sum()
}

fn add(x: &mut [Pose], d: &[Pose], by: f64) {
    x.iter_mut().flatten().zip(d.iter().flatten()).for_each(|(x, d)| *x += d * by);
}

/// The least sum of all frames' energies and `weight` times the squared second differences of what they add to `priors`.
pub(super) fn solve(systems: &[System], priors: &[&Pose], weight: f64) -> Result<Vec<Pose>, (usize, LiftError)> {
    let n = systems.len();
    let own = systems.iter().enumerate().map(|(k, s)| s.solver(weight * diagonal(k, n)).map_err(|e| (k, e)));
    let solvers = own.collect::<Result<Vec<_>, _>>()?;
    let each = |right: &[Pose], pulled: bool| {
        let one = |(k, right): (usize, &Pose)| solvers[k].solve(right, pulled).ok_or((k, LiftError::Undetermined));
        right.iter().enumerate().map(one).collect::<Result<Vec<Pose>, _>>()
    };
    let times = |x: &[Pose]| {
        let mut y: Vec<Pose> = systems.iter().zip(x).map(|(s, x)| s.times(x)).collect();
        bent(x, weight, &mut y);
        y
    };
    let priors: Vec<Pose> = priors.iter().map(|p| (*p).clone()).collect();
    let near: Vec<Pose> = (0..n).map(|k| systems[k].start(&priors[k], weight * diagonal(k, n))).collect();
    let mut x = each(&near, true)?;
    let mut rest: Vec<Pose> = systems.iter().map(System::right).collect();
    bent(&priors, weight, &mut rest);
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
