//! Affine maps as path, rotation, size and squash about a pivot.

use nalgebra::{Matrix2, Vector2};

use super::{Group, Kind};
use crate::algo::raster::{Affine, apply};

/// Why maps cannot be taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SplitError {
    /// NaN or infinity.
    #[error("expected a finite affine map, found NaN or infinity at position {at} of the motion")]
    NotFinite {
        /// The frame, from 0.
        at: usize,
    },
    /// A map that loses an axis, or the first that mirrors otherwise than the one before.
    #[error("expected maps with an area that all mirror or all do not, found another at position {at} of the motion")]
    Flat {
        /// The frame, from 0.
        at: usize,
    },
}

/// Maps taken apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    pivot: Vector2<f64>,
    mirrored: bool,
}

impl Split {
    /// The curves of `maps` about `pivot`: translation, rotation, size, squash. O(n).
    ///
    /// The linear part is R exp(S): a rotation after a symmetric stretch.
    ///
    /// # Errors
    /// Maps that are not finite, are singular, or change orientation on the way.
    pub fn new(maps: &[Affine], pivot: [f64; 2]) -> Result<(Self, Vec<Group>), SplitError> {
        if let Some(at) = maps.iter().position(|m| !m.iter().all(|v| v.is_finite())) {
            return Err(SplitError::NotFinite { at });
        }
        let area = |m: &Affine| m[(0, 0)] * m[(1, 1)] - m[(0, 1)] * m[(1, 0)];
        let mirrored = maps.first().is_some_and(|m| area(m) < 0.0);
        if let Some(at) = maps.iter().position(|m| area(m).abs() < 1e-12 || (area(m) < 0.0) != mirrored) {
            return Err(SplitError::Flat { at });
        }
        let pivot = Vector2::from(pivot);
        let mut curves: [Vec<f64>; 6] = Default::default();
        for m in maps {
            let at = apply(m, pivot);
            let (angle, size, squash) = polar(&upright(m, mirrored));
            let angle = curves[2].last().map_or(angle, |before: &f64| before + nearest_turn(angle - before));
            for (c, v) in curves.iter_mut().zip([at.x, at.y, angle, size, squash[0], squash[1]]) {
                c.push(v);
            }
        }
        let [x, y, angle, size, a, b] = curves;
        let group = |kind, curves| Group { kind, curves };
        let groups = vec![
            group(Kind::Translation, vec![x, y]),
            group(Kind::Rotation, vec![angle]),
            group(Kind::Size, vec![size]),
            group(Kind::Squash, vec![a, b]),
        ];
        Ok((Self { pivot, mirrored }, groups))
    }

    /// The maps of curves as [`Split::new`] gives them.
    pub fn join(&self, groups: &[Group]) -> Vec<Affine> {
        let curves: Vec<&Vec<f64>> = groups.iter().flat_map(|g| &g.curves).collect();
        let [x, y, angle, size, a, b] = curves[..] else { return Vec::new() };
        let map = |k: usize| {
            let (s, c) = libm::sincos(angle[k]);
            let linear = Matrix2::new(c, -s, s, c) * exponential(size[k], [a[k], b[k]]);
            let linear = if self.mirrored { linear * Matrix2::new(-1.0, 0.0, 0.0, 1.0) } else { linear };
            let t = Vector2::new(x[k], y[k]) - linear * self.pivot;
            Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
        };
        (0..x.len()).map(map).collect()
    }
}

/// The linear part with its mirror, if any, taken off.
fn upright(m: &Affine, mirrored: bool) -> Matrix2<f64> {
    let linear = m.fixed_view::<2, 2>(0, 0).into_owned();
    if mirrored { linear * Matrix2::new(-1.0, 0.0, 0.0, 1.0) } else { linear }
}

/// An angle brought to -π to π.
fn nearest_turn(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * libm::round(angle / std::f64::consts::TAU)
}

/// Angle, logarithmic size, and the traceless part [[a, b], [b, -a]] of the logarithm of the stretch, of a map that keeps orientation.
fn polar(m: &Matrix2<f64>) -> (f64, f64, [f64; 2]) {
    let angle = libm::atan2(m[(1, 0)] - m[(0, 1)], m[(0, 0)] + m[(1, 1)]);
    let (s, c) = libm::sincos(angle);
    let stretch = Matrix2::new(c, s, -s, c) * m;
    // A symmetric matrix m I + d (cos, sin; sin, -cos) has the eigenvalues m ± d.
    let (mean, half) = (0.5 * (stretch[(0, 0)] + stretch[(1, 1)]), 0.5 * (stretch[(0, 0)] - stretch[(1, 1)]));
    let off = 0.5 * (stretch[(0, 1)] + stretch[(1, 0)]);
    let d = libm::hypot(half, off);
    let (large, small) = (libm::log(mean + d), libm::log(m.determinant() / (mean + d)));
    let share = if d > 0.0 { 0.5 * (large - small) / d } else { 0.0 };
    (angle, 0.5 * (large + small), [half * share, off * share])
}

/// exp(size I + [[a, b], [b, -a]]).
fn exponential(size: f64, [a, b]: [f64; 2]) -> Matrix2<f64> {
    let d = libm::hypot(a, b);
    let (cosh, sinh) = (libm::cosh(d), if d > 1e-9 { libm::sinh(d) / d } else { 1.0 });
    Matrix2::new(cosh + sinh * a, sinh * b, sinh * b, cosh - sinh * a) * libm::exp(size)
}

/// The point of the reference whose way is the shortest, by least squares over the frames: the hinge of a motion. The origin where all points move alike.
pub fn still_point(maps: &[Affine]) -> [f64; 2] {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for pair in maps.windows(2) {
        let d = pair[1] - pair[0];
        let linear = d.fixed_view::<2, 2>(0, 0).into_owned();
        normal += linear.transpose() * linear;
        right -= linear.transpose() * d.column(2);
    }
    let floor = 1e-12 * normal.trace();
    let found = (normal + Matrix2::identity() * floor).try_inverse().map(|i| i * right);
    found.filter(|p| normal.trace() > 1e-18 && p.iter().all(|v| v.abs() < 1e9)).map_or([0.0; 2], Into::into)
}
