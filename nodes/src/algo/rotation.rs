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

#[cfg(test)]
mod tests {
    use super::*;

    fn q([x, y, z, w]: [f64; 4]) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    }

    /// Angle between two rotations.
    fn apart(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        2.0 * log(&(a.inverse() * near(b, a))).norm()
    }

    // Four rotations, and what SciPy 1.17.1 makes of them: `Rotation.mean(weights)`, `Slerp` at 0.25 and 0.6 from the first to the second, the same way
    // to -0.5 and 1.5, and the fixed point of m <- m exp(sum w log(m^-1 q)).
    const KEYS: [[f64; 4]; 4] = [
        [-0.2518550510672651, -0.04449444227988331, -0.43320324273460287, 0.8642477817977505],
        [0.02589542964677084, -0.10403779583463094, -0.4906407201517241, 0.8647411447885884],
        [-0.4325524693438142, 0.5245081143226848, 0.20932061420440434, 0.7028331805936036],
        [-0.06047210528902546, 0.16520234574108444, -0.27048539390277593, 0.9465141103696323],
    ];
    const WEIGHTS: [f64; 4] = [0.1, 0.4, 0.3, 0.2];
    const CHORDAL: [f64; 4] = [-0.15175895533218492, 0.13070448762953535, -0.2911775396798732, 0.9354684370816368];
    const KARCHER: [f64; 4] = [-0.1817458432672233, 0.16937079447958092, -0.2520856382547624, 0.9352725877615202];
    const BETWEEN: [(f64, [f64; 4]); 4] = [
        (0.25, [-0.18350484979294124, -0.05993473425813576, -0.4512184480080275, 0.8712839433325417]),
        (0.6, [-0.0862674326460834, -0.08100110711117724, -0.4724151221406101, 0.8733960745757274]),
        (-0.5, [-0.3842087461675019, -0.012991336807112328, -0.3904127166567483, 0.8365361768680767]),
        (1.5, [0.1654292057965355, -0.130821148718751, -0.5040752290396902, 0.8375124884955555]),
    ];

    #[test]
    fn means_are_those_of_scipy() {
        let keys = KEYS.map(q);
        for (kind, truth) in [(Mean::Chordal, CHORDAL), (Mean::Karcher, KARCHER)] {
            let found = mean(&keys, &WEIGHTS, kind).unwrap();
            assert!(apart(&found, &q(truth)) < 1e-14, "{kind:?}: {}", apart(&found, &q(truth)));
        }
    }

    #[test]
    fn two_keys_are_joined_by_the_shortest_way_and_beyond() {
        let [a, b, ..] = KEYS.map(q);
        for (t, truth) in BETWEEN {
            assert!(apart(&slerp(&a, &b, t), &q(truth)) < 1e-14);
            let found = mean(&[a, b], &[1.0 - t, t], Mean::Karcher).unwrap();
            assert!(apart(&found, &q(truth)) < 1e-14, "{t}");
        }
    }

    #[test]
    fn weights_beyond_a_key_go_on_turning_even_over_half_a_turn() {
        let about_z = |angle: f64| exp(&Vector3::new(0.0, 0.0, angle / 2.0));
        let found = mean(&[about_z(0.0), about_z(2.6)], &[-0.5, 1.5], Mean::Karcher).unwrap();
        assert!(apart(&found, &about_z(3.9)) < 1e-14);
    }

    #[test]
    fn a_mean_moves_with_its_keys_and_forgets_signs_and_order() {
        let keys = KEYS.map(q);
        let weights = [0.9, 0.7, -0.4, -0.2];
        let turn = exp(&Vector3::new(0.3, -1.0, 0.4));
        let opposite = keys.map(|k| UnitQuaternion::new_unchecked(-k.into_inner()));
        for kind in [Mean::Karcher, Mean::Chordal] {
            let first = mean(&keys, &weights, kind).unwrap();
            assert!(apart(&mean(&keys.map(|k| turn * k), &weights, kind).unwrap(), &(turn * first)) < 1e-12);
            assert!(apart(&mean(&opposite, &weights, kind).unwrap(), &first) < 1e-12);
            let (mut keys, mut turned) = (keys, weights);
            keys.reverse();
            turned.reverse();
            assert!(apart(&mean(&keys, &turned, kind).unwrap(), &first) < 1e-12);
            assert!(apart(&mean(&keys, &turned.map(|w| w * 3.0), kind).unwrap(), &first) < 1e-12);
        }
    }

    #[test]
    fn where_there_is_no_mean_there_is_none() {
        let keys = KEYS.map(q);
        assert_eq!(mean(&[], &[], Mean::Karcher), None);
        assert_eq!(mean(&keys, &[1.0, -1.0, 0.5, -0.5], Mean::Karcher), None);
        assert_eq!(mean(&keys, &[1.0, f64::NAN, 0.5, -0.5], Mean::Chordal), None);
        assert_eq!(mean(&keys, &WEIGHTS[..3], Mean::Chordal), None);
    }

    #[test]
    fn logarithm_and_exponential_undo_each_other_to_the_ends() {
        for v in [[0.0, 0.0, 0.0], [1e-12, 0.0, -1e-13], [0.4, -0.2, 0.9], [0.0, 3.0, 0.5]] {
            let v = Vector3::from(v);
            assert!((log(&exp(&v)) - v).norm() < 1e-14 * (1.0 + v.norm() / 1e-2).min(10.0), "{v}");
        }
        let half = UnitQuaternion::new_unchecked(Quaternion::new(-1.0, 0.0, 0.0, 0.0));
        assert!((exp(&log(&half)).coords - half.coords).norm() < 1e-15);
    }
}
