//! Where the iterations start: prediction, the moments of the matte, a coarse search.

use nalgebra::{Matrix2, Vector2};

use super::planes::unit;
use super::solve::is_sane;
use crate::algo::raster::{Affine, apply, compose, invert};

/// Area, centroid (pixels) and second central moments of a matte.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    pub(super) mass: f64,
    pub(super) centre: Vector2<f64>,
    pub(super) spread: Matrix2<f64>,
}

impl Moments {
    /// True for a point (pixels) that is four deviations or more from the centroid: the rim of a uniform disc is at two.
    pub(super) fn is_stray(&self, x: f64, y: f64) -> bool {
        let d = Vector2::new(x, y) - self.centre;
        let [[a, b], [_, c]] = self.spread.data.0;
        let det = a * c - b * b;
        det > 0.0 && (c * d.x * d.x - 2.0 * b * d.x * d.y + a * d.y * d.y) > 16.0 * det
    }
}

/// Side of the cells that a matte is summed over before its moments are taken.
const CELL: usize = 4;
/// Cells that are passed over together where nothing is in them.
const RUN: usize = 16;
/// Squared Mahalanobis distance beyond which a cell counts as a stray speck: a uniform disc ends at 4.
const STRAY: f64 = 9.0;

/// The moments of `matte` (`width` columns), specks far from the bulk left out; `None` for an empty matte. O(pixels).
pub(super) fn moments(matte: &[f32], width: usize) -> Option<Moments> {
    if width == 0 {
        return None;
    }
    let cols = width.div_ceil(CELL);
    let mut cells: Vec<(f64, Vector2<f64>)> = Vec::new();
    for (band, rows) in matte.chunks(width * CELL).enumerate() {
        let mut sums = vec![[0.0f32; 3]; cols];
        for (j, row) in rows.chunks_exact(width).enumerate() {
            // Most of a picture is not the character.
            let runs = sums.chunks_mut(RUN).zip(row.chunks(RUN * CELL)).filter(|(_, px)| px.iter().fold(false, |any, m| any | (*m > 0.0)));
            for (cell, px) in runs.flat_map(|(cells, row)| cells.iter_mut().zip(row.chunks(CELL))) {
                for (i, &m) in px.iter().enumerate() {
                    let m = unit(m);
                    cell[0] += m;
                    cell[1] += m * (i as f32 + 0.5);
                    cell[2] += m * (j as f32 + 0.5);
                }
            }
        }
        for (i, s) in sums.iter().enumerate().filter(|(_, s)| s[0] > 0.0) {
            let corner = Vector2::new((i * CELL) as f64, (band * CELL) as f64);
            cells.push((f64::from(s[0]), corner + Vector2::new(f64::from(s[1]), f64::from(s[2])) / f64::from(s[0])));
        }
    }
    let mut found = moments_of(&cells, |_| true)?;
    for _ in 0..4 {
        let inverse = found.spread.try_inverse()?;
        let centre = found.centre;
        found = moments_of(&cells, |p| (p - centre).dot(&(inverse * (p - centre))) <= STRAY)?;
    }
    Some(found)
}

fn moments_of(cells: &[(f64, Vector2<f64>)], keep: impl Fn(Vector2<f64>) -> bool) -> Option<Moments> {
    let kept = || cells.iter().filter(|(_, p)| keep(*p));
    let mass: f64 = kept().map(|(m, _)| m).sum();
    if mass.is_nan() || mass < 1.0 {
        return None;
    }
    let centre = kept().map(|(m, p)| p * *m).sum::<Vector2<f64>>() / mass;
    // Half a pixel of variance stands for the extent of the cells and keeps the matrix regular.
    let spread = kept().map(|(m, p)| (p - centre) * (p - centre).transpose() * *m).sum::<Matrix2<f64>>() / mass + Matrix2::identity() * 0.5;
    Some(Moments { mass, centre, spread })
}

/// The square root of a symmetric positive matrix, in closed form.
fn root(m: &Matrix2<f64>) -> Matrix2<f64> {
    let s = libm::sqrt(m.determinant().max(0.0));
    let t = libm::sqrt((m.trace() + 2.0 * s).max(1e-12));
    (m + Matrix2::identity() * s) / t
}

/// The maps that carry the moments `from` to `to`, one for each of `turns` rotations: equal moments fix a map but for a rotation.
pub(super) fn carrying(from: &Moments, to: &Moments, turns: usize) -> Vec<Affine> {
    let Some(whiten) = root(&from.spread).try_inverse() else { return Vec::new() };
    let colour = root(&to.spread);
    (0..turns)
        .map(|i| {
            let (s, c) = libm::sincos(std::f64::consts::TAU * i as f64 / turns as f64);
            let linear = colour * Matrix2::new(c, -s, s, c) * whiten;
            let t = to.centre - linear * from.centre;
            Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
        })
        .collect()
}

/// The map that carries the moments `from` to `to` and turns as `last` does: the least displacement between the two, once turned.
///
/// The symmetric factor is the optimal transport between the turned spread A and the new one B, A^-1/2 (A^1/2 B A^1/2)^1/2 A^-1/2, whose own rotation is none;
/// so a disc that is squashed is squashed and not turned, and nothing adds up over the frames. `None` where a spread is singular.
pub(super) fn transport(from: &Moments, to: &Moments, last: &Affine) -> Option<Affine> {
    let turn = rotation(last);
    let a = turn * from.spread * turn.transpose();
    let half = root(&a);
    let back = half.try_inverse()?;
    let linear = back * root(&(half * to.spread * half)) * back * turn;
    let t = to.centre - linear * from.centre;
    let m = Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t]);
    is_sane(&m).then_some(m)
}

/// The rotation of the polar decomposition of a map that keeps orientation.
fn rotation(m: &Affine) -> Matrix2<f64> {
    let (c, s) = (m[(0, 0)] + m[(1, 1)], m[(1, 0)] - m[(0, 1)]);
    let size = libm::hypot(c, s);
    if size > 1e-12 { Matrix2::new(c, -s, s, c) / size } else { Matrix2::identity() }
}

/// How far the linear part of `m` is from that of the nearest of `anchors`: 0 for equal, 1 for 60 degrees, 2 at most.
pub(super) fn unrest(m: &Affine, anchors: &[Affine]) -> f64 {
    let linear = |m: &Affine| m.fixed_view::<2, 2>(0, 0).into_owned();
    let from_anchor = |a: &Affine| linear(a).try_inverse().map(|i| (linear(m) * i - Matrix2::identity()).norm() / std::f64::consts::SQRT_2);
    anchors.iter().filter_map(from_anchor).fold(2.0, f64::min)
}

/// The motion after `last` at constant velocity, given the one before it; `None` where that is not a sane map.
pub(super) fn extrapolate(last: &Affine, before: &Affine) -> Option<Affine> {
    let next = compose(&compose(last, &invert(before)?), last);
    is_sane(&next).then_some(next)
}

/// `m` followed by a translation.
pub(super) fn shifted(m: &Affine, dx: f64, dy: f64) -> Affine {
    let mut m = *m;
    m[(0, 2)] += dx;
    m[(1, 2)] += dy;
    m
}

/// The box around `bounds` (left, top, right, bottom) moved by `m`.
pub(super) fn moved_bounds(m: &Affine, bounds: [f64; 4]) -> [f64; 4] {
    let [x0, y0, x1, y1] = bounds;
    let mut out = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for (x, y) in [(x0, y0), (x1, y0), (x0, y1), (x1, y1)] {
        let p = apply(m, Vector2::new(x, y));
        out = [out[0].min(p.x), out[1].min(p.y), out[2].max(p.x), out[3].max(p.y)];
    }
    out
}
