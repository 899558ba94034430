//! Rotations: logarithms, paths between two, means of many.

use nalgebra::{Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};
use pegbar_engine::Setting;

/// Half the rotation vector of a quaternion: axis times angle on the sphere of quaternions, 0 to pi. A quaternion and its opposite, which turn alike,
/// have different logarithms.
pub fn log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (v, w) = (q.vector().into_owned(), q.scalar());
    let sine = v.norm();
    if sine > 0.0 {
        v * (libm::atan2(sine, w) / sine)
    } else if w >= 0.0 {
        v
    } else {
        // Half way round the sphere every direction leads there.
        Vector3::new(std::f64::consts::PI, 0.0, 0.0)
    }
}

/// The quaternion whose [`log`] is `v`.
pub fn exp(v: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = v.norm();
    let over = if angle > 0.0 { libm::sin(angle) / angle } else { 1.0 };
    UnitQuaternion::new_normalize(Quaternion::from_parts(libm::cos(angle), v * over))
}

/// Of `q` and its opposite, which turn alike, the one nearer to `to`.
pub fn near(q: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.coords.dot(&to.coords) < 0.0 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { *q }
}

/// The rotation `t` of the shorter way from `a` (0) to `b` (1), beyond them too, at constant angular speed (Shoemake 1985).
pub fn slerp(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, t: f64) -> UnitQuaternion<f64> {
    a * exp(&(log(&(a.inverse() * near(b, a))) * t))
}

/// Which mean of several rotations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Mean {
    /// The rotation from which the weighted ways to all keys add up to nought (Karcher 1977): the shortest way at constant speed for two, and beyond them.
    Karcher,
    /// The rotation with the least weighted squared distance between matrices (Markley et al. 2007).
    Chordal,
}

/// Rounds of [`Mean::Karcher`] before it is given up.
const ROUNDS: usize = 200;

/// The weighted mean of rotations; weights may be negative and are taken relative to their sum. `None` where there is none: no rotations, weights that add
/// up to nought, or so wild that the Karcher mean does not settle.
///
/// Each rotation stands for the nearer of its two quaternions, seen from the chordal mean of the weights' amounts, so that the way beyond a key goes on
/// turning instead of the other way round. Cost: O(rotations · rounds); a few rounds but for rotations far apart.
pub fn mean(rotations: &[UnitQuaternion<f64>], weights: &[f64], kind: Mean) -> Option<UnitQuaternion<f64>> {
    let sum: f64 = weights.iter().sum();
    if rotations.is_empty() || rotations.len() != weights.len() || !sum.is_finite() || sum.abs() < 1e-9 {
        return None;
    }
    let weights: Vec<f64> = weights.iter().map(|w| w / sum).collect();
    match kind {
        Mean::Chordal => chordal(rotations, &weights),
        Mean::Karcher => {
            let start = chordal(rotations, &weights.iter().map(|w| w.abs()).collect::<Vec<_>>())?;
            let near: Vec<_> = rotations.iter().map(|q| near(q, &start)).collect();
            karcher(&near, &weights, start)
        }
    }
}

/// Eigenvector of the greatest eigenvalue of the sum of w q q^T.
fn chordal(rotations: &[UnitQuaternion<f64>], weights: &[f64]) -> Option<UnitQuaternion<f64>> {
    let mut sum = Matrix4::zeros();
    for (q, w) in rotations.iter().zip(weights) {
        sum += q.coords * q.coords.transpose() * *w;
    }
    let found = SymmetricEigen::try_new(sum, f64::EPSILON, 1000)?;
    let greatest = found.eigenvalues.imax();
    let q = UnitQuaternion::try_new(Quaternion::from_vector(found.eigenvectors.column(greatest).into_owned()), 0.5)?;
    // Of the two that turn alike the one nearer to the first key, whatever the solver gave.
    Some(near(&q, &near(rotations.first()?, &UnitQuaternion::identity())))
}

fn karcher(near: &[UnitQuaternion<f64>], weights: &[f64], start: UnitQuaternion<f64>) -> Option<UnitQuaternion<f64>> {
    let step_at = |m: &UnitQuaternion<f64>| {
        let inverse = m.inverse();
        near.iter().zip(weights).map(|(q, w)| log(&(inverse * q)) * *w).sum::<Vector3<f64>>()
    };
    let (mut at, mut share) = (start, 1.0);
    let mut step = step_at(&at);
    for _ in 0..ROUNDS {
        if step.norm() < 1e-15 {
            break;
        }
        let next = at * exp(&(step * share));
        let next_step = step_at(&next);
        if next_step.norm() < step.norm() {
            (at, step) = (next, next_step);
            share = (share * 2.0).min(1.0);
        } else if share > 1e-3 {
            share /= 2.0;
        } else {
            break;
        }
    }
    (step.norm() < 1e-9).then_some(at)
}
