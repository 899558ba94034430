//! The plane carried by a curve that bends: what a line of action does to a drawing (Bregler et al. 2002, Figure 13).
//!
//! Each place of the plane is near some parts of the curve and far from others. Its frame is the mean of theirs, weighted by a power of the
//! distance as in moving least squares (Schaefer, McPhail, Warren, Image deformation using moving least squares, SIGGRAPH 2006), but with turns
//! followed along the curve, so that they may pass half a turn: p' = q* + R(θ*) (p - p*). On the curve that is the curve; beyond its ends the plane goes
//! with the ends.

use super::arap::{ArapError, followed};
use super::compatible::{Point, dot, lerp, sub};

/// Pieces that a curve is cut into, about.
const PIECES: f64 = 256.0;

/// How the plane follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Weight of a part of the curve at distance d is d to minus twice this, 1 or more. Small spreads turns wide, large follows the nearest part alone.
    pub falloff: f64,
    /// How much a part that is stretched gets narrower: 0 not at all, 1 so that areas are kept.
    pub volume: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { falloff: 2.0, volume: 0.0 }
    }
}

/// A piece of the curve.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: Point,
    to: Point,
    /// Of the undeformed curve.
    length: f64,
    /// Direction of the undeformed curve, of length 1.
    along: Point,
    /// Radians.
    turn: f64,
    /// Logarithm of the new length over the old.
    stretch: f64,
}

/// A curve and what it has become.
#[derive(Clone, Debug)]
pub struct CurveBend {
    pieces: Vec<Piece>,
    /// Squared distance under which nothing is nearer.
    blur: f64,
    options: Options,
}

impl CurveBend {
    /// The curve `from`, bent to `to`.
    ///
    /// Errors: curves of less than two points or without length, of different numbers of points, or that are not finite. Cost: O(points).
    pub fn new(from: &[Point], to: &[Point], options: Options) -> Result<Self, ArapError> {
        for (key, points) in [from, to].into_iter().enumerate() {
            if points.len() != from.len() {
                return Err(ArapError::Count { key, expected: from.len(), found: points.len() });
            }
            if !points.iter().flatten().all(|v| v.is_finite()) {
                return Err(ArapError::NotFinite { key });
            }
        }
        let before = followed(from, None);
        let after = followed(to, Some(&before));
        let whole: f64 = before.iter().map(|e| e[1]).sum();
        if !(whole > 0.0 && whole.is_finite()) {
            return Err(ArapError::Short);
        }
        let edges: Vec<[f64; 2]> = before.iter().zip(&after).map(|(b, a)| [a[0] - b[0], stretch(b[1], a[1])]).collect();
        let step = whole / PIECES;
        let mut pieces = Vec::new();
        for (i, edge) in before.iter().enumerate().filter(|(_, e)| e[1] > 0.0) {
            let (sin, cos) = libm::sincos(edge[0]);
            let n = libm::ceil(edge[1] / step).max(1.0);
            for k in 0..n as usize {
                let t = (k as f64 + 0.5) / n;
                let [turn, stretch] = at(&edges, i, t);
                let (from, to) = (lerp(from[i], from[i + 1], t), lerp(to[i], to[i + 1], t));
                pieces.push(Piece { from, to, length: edge[1] / n, along: [cos, sin], turn, stretch });
            }
        }
        Ok(Self { pieces, blur: 0.25 * step * step, options })
    }

    /// Where a place of the plane goes. Cost: O(pieces), a few hundred.
    pub fn at(&self, p: Point) -> Point {
        let (mut sum, mut from, mut to) = (0.0, [0.0; 2], [0.0; 2]);
        let (mut along, mut turn, mut stretch) = ([0.0; 2], 0.0, 0.0);
        // About the nearest piece, so that far places lose nothing.
        let distance = |s: &Piece| dot(sub(p, s.from), sub(p, s.from)) + self.blur;
        let nearest = self.pieces.iter().map(distance).fold(f64::INFINITY, f64::min);
        for s in &self.pieces {
            let share = nearest / distance(s);
            let w = s.length * if self.options.falloff == 2.0 { share * share } else { libm::pow(share, self.options.falloff) };
            sum += w;
            for c in 0..2 {
                from[c] += w * (s.from[c] - p[c]);
                to[c] += w * (s.to[c] - p[c]);
                along[c] += w * s.along[c];
            }
            turn += w * s.turn;
            stretch += w * s.stretch;
        }
        let mut rest = from.map(|v| -v / sum);
        if self.options.volume != 0.0 {
            rest = self.narrowed(rest, along, stretch / sum);
        }
        let (sin, cos) = libm::sincos(turn / sum);
        [p[0] + to[0] / sum + cos * rest[0] - sin * rest[1], p[1] + to[1] / sum + sin * rest[0] + cos * rest[1]]
    }

    /// A step from the curve, shorter across it as the curve gets longer.
    fn narrowed(&self, step: Point, along: Point, stretch: f64) -> Point {
        let length = libm::hypot(along[0], along[1]);
        if length == 0.0 {
            return step;
        }
        let across = [-along[1] / length, along[0] / length];
        let change = (libm::exp(-self.options.volume * stretch) - 1.0) * dot(step, across);
        [step[0] + change * across[0], step[1] + change * across[1]]
    }
}

fn stretch(before: f64, after: f64) -> f64 {
    // Within what a drawing can show, so that an edge that vanishes does not blow up what is beside it.
    if before > 0.0 { libm::log((after / before).clamp(0.01, 100.0)) } else { 0.0 }
}

/// Turn and stretch at a place of an edge: between those of the corners, which are the means of the edges there.
fn at(edges: &[[f64; 2]], i: usize, t: f64) -> [f64; 2] {
    let corner = |k: usize, c: usize| {
        let (a, b) = (edges[k.saturating_sub(1)], edges[k.min(edges.len() - 1)]);
        (a[c] + b[c]) / 2.0
    };
    [0, 1].map(|c| corner(i, c) + (corner(i + 1, c) - corner(i, c)) * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn line(n: usize) -> Vec<Point> {
        (0..=n).map(|i| [100.0 * i as f64 / n as f64, 0.0]).collect()
    }

    /// The line rolled into an arc of `angle`.
    fn arc(n: usize, angle: f64) -> Vec<Point> {
        let radius = 100.0 / angle;
        let place = |i| angle * f64::from(i) / n as f64;
        (0..=n as u32).map(place).map(|a| [radius * libm::sin(a), radius - radius * libm::cos(a)]).collect()
    }

    fn distance(a: Point, b: Point) -> f64 {
        libm::hypot(a[0] - b[0], a[1] - b[1])
    }

    #[test]
    fn what_only_moves_is_carried_rigidly() {
        let (sin, cos) = libm::sincos(2.5);
        let turn = |p: Point| [10.0 + cos * p[0] - sin * p[1], sin * p[0] + cos * p[1] - 3.0];
        let from = arc(30, 2.0);
        let to: Vec<Point> = from.iter().copied().map(turn).collect();
        for options in [Options::default(), Options { falloff: 1.0, volume: 1.0 }] {
            let bend = CurveBend::new(&from, &to, options).unwrap();
            for p in [[0.0, 0.0], [500.0, -300.0], [50.0, 20.0], from[7]] {
                assert!(distance(bend.at(p), turn(p)) < 1e-9, "{p:?}");
            }
        }
    }

    #[test]
    fn the_curve_goes_where_it_goes_also_past_half_a_turn() {
        for angle in [1.0, 3.0, 5.5] {
            let (from, to) = (line(60), arc(60, angle));
            let bend = CurveBend::new(&from, &to, Options::default()).unwrap();
            assert!(from.iter().zip(&to).all(|(p, q)| distance(bend.at(*p), *q) < 0.25), "{angle}");
            // Beside the curve the plane turns as it does.
            let radius = 100.0 / angle;
            let middle = bend.at([50.0, 4.0]);
            let truth = [(radius - 4.0) * libm::sin(angle / 2.0), radius - (radius - 4.0) * libm::cos(angle / 2.0)];
            assert!(distance(middle, truth) < 0.5, "{angle}: {middle:?} {truth:?}");
        }
    }

    /// Beyond an end the plane goes with the end: not with the mean of the curve.
    #[test]
    fn beyond_an_end_the_plane_goes_with_it() {
        let bend = CurveBend::new(&line(60), &arc(60, PI / 2.0), Options::default()).unwrap();
        let radius = 200.0 / PI;
        assert!(distance(bend.at([-6.0, 0.0]), [-6.0, 0.0]) < 0.6);
        assert!(distance(bend.at([106.0, 0.0]), [radius, radius + 6.0]) < 0.6);
    }

    #[test]
    fn a_stretched_curve_keeps_areas_where_that_is_asked_for() {
        let long: Vec<Point> = line(20).iter().map(|p| [2.0 * p[0], 0.0]).collect();
        let y = |volume| CurveBend::new(&line(20), &long, Options { falloff: 2.0, volume }).unwrap().at([50.0, 10.0])[1];
        assert!((y(0.0) - 10.0).abs() < 1e-9 && (y(1.0) - 5.0).abs() < 1e-9 && (y(0.5) - 50.0_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn curves_that_carry_nothing_are_refused() {
        let fails = |from: &[Point], to: &[Point]| CurveBend::new(from, to, Options::default()).unwrap_err();
        assert_eq!(fails(&[], &[]), ArapError::Short);
        assert_eq!(fails(&[[1.0, 1.0]; 3], &line(2)), ArapError::Short);
        assert_eq!(fails(&line(2), &line(3)), ArapError::Count { key: 1, expected: 3, found: 4 });
        assert_eq!(fails(&line(1), &[[0.0, f64::NAN], [1.0, 0.0]]), ArapError::NotFinite { key: 1 });
        // What shrinks to a point is allowed: it goes there.
        let point = CurveBend::new(&line(4), &[[7.0, 8.0]; 5], Options::default()).unwrap().at([50.0, 0.0]);
        assert!(distance(point, [7.0, 8.0]) < 0.25, "{point:?}");
    }
}
