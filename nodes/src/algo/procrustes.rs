//! The rotation that brings points nearest to others (orthogonal Procrustes without a reflection).
//!
//! **Source** Gower and Dijksterhuis, *Procrustes Problems*, 2004, chapter 4; Jain, Sheikh, Hodgins 2009, section 3.6 (the pelvis); Kabsch 1978 (the sign of
//! the determinant).

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// How much of a rotation points say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// All of it.
    Rotation,
    /// One direction alone, as all points lie on a line through the origin, or are mirrored so that each turn about it is as good.
    Direction,
    /// Nothing: no points, or all of them at the origin.
    Nothing,
}

/// Less of a second direction than this share of the first is none.
const FLAT: f64 = 1e-6;

/// The rotation R with the least sum of |R from - to|², determinant 1, about the origin; pairs with a coordinate that is not finite are left out.
/// What the points leave open is taken from `near`: about a line, the rotation with the shortest way from `near`; else `near` itself. Cost: O(points).
pub fn rotation(from: &[Vector3<f64>], to: &[Vector3<f64>], near: &UnitQuaternion<f64>) -> (UnitQuaternion<f64>, Told) {
    let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
    let pairs = || from.iter().zip(to).filter(|(a, b)| finite(a) && finite(b));
    let size = |side: fn((&Vector3<f64>, &Vector3<f64>)) -> f64| pairs().map(side).fold(0.0, f64::max);
    let (wide_from, wide_to) = (size(|(a, _)| a.amax()), size(|(_, b)| b.amax()));
    if wide_from < f64::MIN_POSITIVE || wide_to < f64::MIN_POSITIVE {
        return (*near, Told::Nothing);
    }
    // Of size one, so that neither millimetres nor light years fall out of the range of numbers.
    let sum: Matrix3<f64> = pairs().map(|(a, b)| (b / wide_to) * (a / wide_from).transpose()).sum();
    let Some((u, v, [first, second])) = leading(&sum) else { return (*near, Told::Nothing) };
    if second <= FLAT * first {
        let swing = UnitQuaternion::rotation_between(&(near * v[0]), &u[0]).unwrap_or_else(|| half_turn(&u[0]));
        return (swing * near, Told::Direction);
    }
    let frame = |a: &[Vector3<f64>; 2]| Matrix3::from_columns(&[a[0], a[1], a[0].cross(&a[1])]);
    let found = Rotation3::from_matrix_unchecked(frame(&u) * frame(&v).transpose());
    (UnitQuaternion::from_rotation_matrix(&found), Told::Rotation)
}

/// A half turn about any axis across `v`.
pub(super) fn half_turn(v: &Vector3<f64>) -> UnitQuaternion<f64> {
    let axis = v.cross(&if v.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() });
    UnitQuaternion::new_normalize(nalgebra::Quaternion::from_imag(axis))
}

/// Two unit vectors at right angles.
type Pair = [Vector3<f64>; 2];

/// The two leading pairs of singular vectors, the first singular value, and what the second direction is worth: the second singular value and the third, or
/// less the third where the best match would be a mirror image. `None` where all is nought.
///
/// The third pair follows from the others (Kabsch's sign), so that flat sets, of which it is not known, turn as well as others.
fn leading(sum: &Matrix3<f64>) -> Option<(Pair, Pair, [f64; 2])> {
    let svd = sum.try_svd(true, true, f64::EPSILON, 1000)?;
    let (u, v_t, s) = (svd.u?, svd.v_t?, svd.singular_values);
    if s[0].is_nan() || s[0] <= f64::MIN_POSITIVE {
        return None;
    }
    let third = if sum.determinant() < 0.0 { -s[2] } else { s[2] };
    let columns = |m: Matrix3<f64>| {
        let first = m.column(0).normalize();
        let second = m.column(1) - first * first.dot(&m.column(1));
        [first, second.try_normalize(0.0).unwrap_or_else(|| half_turn(&first).vector().into_owned())]
    };
    Some((columns(u), columns(v_t.transpose()), [s[0], s[1] + third]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Quaternion;

    fn q([x, y, z, w]: [f64; 4]) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    }

    fn points(of: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        of.iter().map(|p| Vector3::from(*p)).collect()
    }

    // Four points, where they went, and what SciPy 1.17.1 makes of them: `Rotation.align_vectors(to, from)`. Noisy; mirrored in z and turned, with noise;
    // flat in y and turned, with noise.
    type Case = ([[f64; 3]; 4], [[f64; 3]; 4], [f64; 4]);
    const CASES: [Case; 3] = [
        (
            [[0.001, 0.299, -0.274], [-0.891, -0.455, -0.992], [0.06, 1.34, -0.492], [-0.62, 0.49, 0.357]],
            [[0.284, 0.184, -0.176], [0.082, -0.441, -1.531], [0.379, 1.24, -0.078], [-0.651, 0.485, -0.485]],
            [0.013834983632417357, -0.4332439958700848, -0.025723050858275764, 0.9008032848102604],
        ),
        (
            [[-0.539, -0.049, 0.113], [-1.53, -0.478, -0.979], [-0.809, 1.061, -0.808], [-0.033, 0.884, -0.584]],
            [[-0.543, -0.092, -0.045], [-1.38, -0.449, 1.192], [-0.79, 1.099, 0.776], [-0.032, 0.942, 0.485]],
            [0.27034955439092195, 0.5728955621609766, -0.022463251589260137, 0.77343208856688],
        ),
        (
            [[-0.189, 0.0, -0.067], [0.667, 0.0, -0.676], [0.203, 0.0, 0.127], [-1.187, 0.0, -0.196]],
            [[-0.069, 0.177, -0.033], [-0.186, 0.474, -0.679], [0.063, -0.206, -0.202], [0.068, 0.64, 1.053]],
            [0.3298888095781345, 0.4928796784808585, -0.5494806031242895, 0.5884845474996719],
        ),
    ];

    #[test]
    fn turns_are_those_of_scipy_at_any_size() {
        for (from, to, truth) in CASES {
            for size in [1.0, 1e-8, 1e8, 1e-160] {
                let (from, to) = (points(&from).iter().map(|p| p * size).collect::<Vec<_>>(), points(&to));
                let (found, told) = rotation(&from, &to, &UnitQuaternion::identity());
                assert!(found.angle_to(&q(truth)) < 1e-9, "{}", found.angle_to(&q(truth)));
                assert_eq!(told, Told::Rotation);
                assert!((found.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn turns_that_are_exact_are_found_even_by_half_a_turn() {
        let from = points(&CASES[0].0);
        for turn in [[1.0, 0.0, 0.0, 0.0], [0.0, 0.6, 0.8, 0.0], [0.3, -0.2, 0.9, 0.1], [0.0, 0.0, 0.0, 1.0]].map(q) {
            for n in [2, 3, 4] {
                let to: Vec<_> = from[..n].iter().map(|p| turn * p).collect();
                assert!(rotation(&from[..n], &to, &UnitQuaternion::identity()).0.angle_to(&turn) < 1e-9);
            }
        }
    }

    #[test]
    fn what_points_leave_open_is_as_it_was() {
        let near = q([0.2, 0.5, -0.1, 0.8]);
        let (along, to) = (Vector3::new(1.0, 2.0, -0.5), Vector3::new(0.3, 0.1, 1.0).normalize());
        let line: Vec<_> = [1.0, -0.4, 2.0].map(|t| along * t).to_vec();
        let there: Vec<_> = [1.0, -0.4, 2.0].map(|t| to * t).to_vec();
        let (found, told) = rotation(&line, &there, &near);
        assert_eq!(told, Told::Direction);
        assert!((found * along.normalize() - to).norm() < 1e-9);
        // No other rotation that does it is nearer.
        let best = found.angle_to(&near);
        (-6..=6).for_each(|k| {
            let other = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(to), 0.1 * f64::from(k)) * found;
            assert!(other.angle_to(&near) >= best - 1e-12);
        });
        let back: Vec<_> = line.iter().map(|p| near * -p).collect();
        assert!((rotation(&line, &back, &near).0 * line[0] - back[0]).norm() < 1e-9, "turned over");
        let nowhere = vec![Vector3::repeat(f64::NAN), Vector3::zeros(), Vector3::new(f64::INFINITY, 0.0, 0.0)];
        assert_eq!(rotation(&nowhere, &there, &near), (near, Told::Nothing));
        assert_eq!(rotation(&[], &[], &near), (near, Told::Nothing));
        assert_eq!(rotation(&line, &[Vector3::zeros(); 3], &near), (near, Told::Nothing));
    }
}
