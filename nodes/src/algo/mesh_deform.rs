//! The inside of a contour that follows its outline, and control points inside of it.
//!
//! The contour is filled with triangles once ([`super::compatible`]). When it moves, the inside takes the shape that turns but hardly stretches: rotations of the
//! triangles and places of the points are found in turn (Sorkine, Alexa, As-rigid-as-possible surface modeling, SGP 2007; Liu et al., A local/global
//! approach to mesh parameterization, SGP 2008), by one sparse factorisation for all frames.

use super::arap::Skyline;
use super::compatible::{CompatibleError, Options, Point, cross, dot, orient, sub, triangulate};

/// Rounds of turning triangles and placing points; a picture does not change any more after fewer.
const ROUNDS: usize = 12;
/// How much a control point holds the mesh, against the stiffest point of the mesh.
const HOLD: f64 = 1e6;

/// Why an inside cannot follow.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeformError {
    /// The contour has no triangles.
    #[error("{0}")]
    Compatible(#[from] CompatibleError),
    /// Another number of points.
    #[error("expected {expected} {what} as there were before, found {found}")]
    Count {
        /// Contour points, or control points.
        what: &'static str,
        /// As many as before.
        expected: usize,
        /// Points found.
        found: usize,
    },
    /// NaN, infinity, or so large that areas are.
    #[error("expected finite {what}, found NaN, infinity or one beyond 1e100 at point {at}")]
    NotFinite {
        /// Contour points, or control points.
        what: &'static str,
        /// The point, from 0.
        at: usize,
    },
    /// A control point that is not inside.
    #[error("expected control points inside the contour, found point {at} outside")]
    Outside {
        /// The point, from 0.
        at: usize,
    },
    /// Control points that cannot be told apart.
    #[error("expected control points that are apart, found some that hold the same place")]
    Held,
}

const CONTOUR: &str = "contour points";
const CONTROL: &str = "control points";

/// A point inside a triangle: its corners, and their shares.
#[derive(Clone, Copy, Debug)]
struct Inside {
    corners: [u32; 3],
    shares: [f64; 3],
}

/// A filled contour, ready to be deformed.
#[derive(Debug)]
pub struct MeshDeform {
    triangles: Vec<[u32; 3]>,
    points: Vec<Point>,
    n_contour: usize,
    controls: Vec<Inside>,
    /// For each triangle twice its area, and the weights of its edges opposite the corners: half the cotangents of the angles there.
    weights: Vec<[f64; 3]>,
    hold: f64,
    /// Of the points inside.
    matrix: Option<Skyline>,
}

impl MeshDeform {
    /// Fills `contour`, closed; `controls` are points inside that will be said where to go.
    ///
    /// Errors: a contour that has no inside or crosses itself, points that are not finite, control points outside or in one place.
    /// Cost: O(n³) with a constant of a nanosecond.
    pub fn new(contour: &[Point], controls: &[Point]) -> Result<Self, DeformError> {
        let mesh = triangulate(&[contour], Options::default())?;
        let points = mesh.points.into_iter().next().unwrap_or_default();
        finite(controls, CONTROL)?;
        let find = |(at, p): (usize, &Point)| inside(&mesh.triangles, &points, *p).ok_or(DeformError::Outside { at });
        let controls = controls.iter().enumerate().map(find).collect::<Result<Vec<_>, _>>()?;
        let weights: Vec<[f64; 3]> = mesh.triangles.iter().map(|t| cotangents(t.map(|i| points[i as usize]))).collect();
        let n = mesh.n_contour;
        let mut made = Self { triangles: mesh.triangles, points, n_contour: n, controls, weights, hold: 0.0, matrix: None };
        made.factor()?;
        Ok(made)
    }

    /// Corners of the triangles, by point.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The contour's points, then those inside.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Points of the contour.
    pub fn n_contour(&self) -> usize {
        self.n_contour
    }

    fn factor(&mut self) -> Result<(), DeformError> {
        let n = self.n_contour;
        if self.points.len() == n {
            return Ok(());
        }
        let mut entries = Vec::new();
        let mut add = |i: u32, j: u32, v: f64| {
            if i as usize >= n && j as usize >= n && i >= j {
                entries.push((i - n as u32, j - n as u32, v));
            }
        };
        let mut stiffest: f64 = 0.0;
        for (t, w) in self.triangles.iter().zip(&self.weights) {
            for k in 0..3 {
                let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
                stiffest = stiffest.max(w[k].abs());
                [(a, a, w[k]), (b, b, w[k]), (a, b, -w[k]), (b, a, -w[k])].into_iter().for_each(|(i, j, v)| add(i, j, v));
            }
        }
        self.hold = HOLD * stiffest;
        for c in &self.controls {
            for (i, a) in c.corners.iter().zip(c.shares) {
                c.corners.iter().zip(c.shares).for_each(|(j, b)| add(*i, *j, self.hold * a * b));
            }
        }
        self.matrix = Some(Skyline::definite(self.points.len() - n, &entries).ok_or(DeformError::Held)?);
        Ok(())
    }

    /// All points, where the contour and the control points are as said.
    ///
    /// Errors: other numbers of points than before, points that are not finite. Cost: O(n √n) a round.
    pub fn deform(&self, contour: &[Point], controls: &[Point]) -> Result<Vec<Point>, DeformError> {
        for (what, found, expected) in [(CONTOUR, contour.len(), self.n_contour), (CONTROL, controls.len(), self.controls.len())] {
            if found != expected {
                return Err(DeformError::Count { what, expected, found });
            }
        }
        finite(contour, CONTOUR)?;
        finite(controls, CONTROL)?;
        let mut points = contour.to_vec();
        points.resize(self.points.len(), [0.0; 2]);
        let Some(matrix) = &self.matrix else { return Ok(points) };
        // To begin with nothing turns but the whole, which leaves the smoothest inside.
        let mut turns = vec![turn(self.points[..self.n_contour].iter().zip(contour)); self.triangles.len()];
        for _ in 0..ROUNDS {
            self.place(matrix, &turns, controls, &mut points);
            for ((t, w), turn) in self.triangles.iter().zip(&self.weights).zip(&mut turns) {
                *turn = self.turned(t, w, &points);
            }
        }
        self.place(matrix, &turns, controls, &mut points);
        Ok(points)
    }

    /// The rotation nearest to what a triangle has become: cosine and sine.
    fn turned(&self, t: &[u32; 3], weights: &[f64; 3], points: &[Point]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for k in 0..3 {
            let (a, b) = (t[(k + 1) % 3] as usize, t[(k + 2) % 3] as usize);
            let (u, v) = (sub(self.points[b], self.points[a]), sub(points[b], points[a]));
            sum = [sum[0] + weights[k] * dot(u, v), sum[1] + weights[k] * cross(u, v)];
        }
        unit(sum)
    }

    /// Places the points inside so that edges are nearest to turned ones.
    fn place(&self, matrix: &Skyline, turns: &[[f64; 2]], controls: &[Point], points: &mut [Point]) {
        let n = self.n_contour;
        let mut sides = vec![0.0; 2 * (points.len() - n)];
        let mut add = |i: u32, v: Point| {
            if i as usize >= n {
                let at = 2 * (i as usize - n);
                (0..2).for_each(|c| sides[at + c] += v[c]);
            }
        };
        let held = |i: u32| if (i as usize) < n { points[i as usize] } else { [0.0; 2] };
        for ((t, w), [cos, sin]) in self.triangles.iter().zip(&self.weights).zip(turns) {
            for k in 0..3 {
                let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
                let u = sub(self.points[b as usize], self.points[a as usize]);
                let edge = [cos * u[0] - sin * u[1], sin * u[0] + cos * u[1]].map(|v| w[k] * v);
                let (pa, pb) = (held(a).map(|v| w[k] * v), held(b).map(|v| w[k] * v));
                add(a, [pb[0] - edge[0], pb[1] - edge[1]]);
                add(b, [pa[0] + edge[0], pa[1] + edge[1]]);
            }
        }
        for (c, target) in self.controls.iter().zip(controls) {
            let known = |d: usize| c.corners.iter().zip(c.shares).map(|(i, s)| s * held(*i)[d]).sum::<f64>();
            let rest = [target[0] - known(0), target[1] - known(1)];
            c.corners.iter().zip(c.shares).for_each(|(i, s)| add(*i, rest.map(|v| self.hold * s * v)));
        }
        matrix.solve(&mut sides, 2);
        points[n..].copy_from_slice(sides.as_chunks().0);
    }
}

fn finite(points: &[Point], what: &'static str) -> Result<(), DeformError> {
    match points.iter().position(|p| !p.iter().all(|v| v.abs() <= 1e100)) {
        Some(at) => Err(DeformError::NotFinite { what, at }),
        None => Ok(()),
    }
}

fn unit([c, s]: [f64; 2]) -> [f64; 2] {
    let length = libm::hypot(c, s);
    if length > 0.0 { [c / length, s / length] } else { [1.0, 0.0] }
}

/// The rotation that takes some points nearest to others.
fn turn<'a>(pairs: impl Iterator<Item = (&'a Point, &'a Point)> + Clone) -> [f64; 2] {
    let n = pairs.clone().count().max(1) as f64;
    let mean = |pick: fn((&'a Point, &'a Point)) -> &'a Point| {
        let sum = pairs.clone().map(pick).fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
        sum.map(|v| v / n)
    };
    let (a, b) = (mean(|p| p.0), mean(|p| p.1));
    let sum = pairs.clone().map(|(p, q)| (sub(*p, a), sub(*q, b))).fold([0.0; 2], |s, (u, v)| [s[0] + dot(u, v), s[1] + cross(u, v)]);
    unit(sum)
}

/// Half the cotangent of the angle at each corner.
fn cotangents(t: [Point; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let (u, v) = (sub(t[(k + 1) % 3], t[k]), sub(t[(k + 2) % 3], t[k]));
        0.5 * dot(u, v) / cross(u, v)
    })
}

/// The triangle that a point is in.
fn inside(triangles: &[[u32; 3]], points: &[Point], p: Point) -> Option<Inside> {
    triangles.iter().find_map(|corners| {
        let [a, b, c] = corners.map(|i| points[i as usize]);
        let parts = [orient(b, c, p), orient(c, a, p), orient(a, b, p)];
        let sum: f64 = parts.iter().sum();
        let shares = parts.map(|v| v / sum);
        shares.iter().all(|s| *s >= 0.0).then_some(Inside { corners: *corners, shares })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of points around an ellipse.
    fn ellipse(n: usize, a: f64, b: f64) -> Vec<Point> {
        let angle = |i: usize| i as f64 / n as f64 * std::f64::consts::TAU;
        (0..n).map(|i| [a * libm::cos(angle(i)), b * libm::sin(angle(i))]).collect()
    }

    fn farthest(a: &[Point], b: &[Point]) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn an_affine_contour_has_an_affine_inside() {
        let deform = MeshDeform::new(&ellipse(40, 60.0, 40.0), &[]).unwrap();
        let (sin, cos) = libm::sincos(2.8);
        for [a, b, c, d] in
            [[1.0, 0.0, 0.0, 1.0], [cos, -sin, sin, cos], [2.0, 0.0, 0.0, 2.0], [0.2 * cos, -0.2 * sin, 0.2 * sin, 0.2 * cos]]
        {
            let map = |p: &Point| [a * p[0] + b * p[1] + 7.0, c * p[0] + d * p[1] - 5.0];
            let truth: Vec<Point> = deform.points().iter().map(map).collect();
            let found = deform.deform(&truth[..40], &[]).unwrap();
            assert!(farthest(&found, &truth) < 1e-9);
        }
    }

    #[test]
    fn control_points_go_where_they_are_told() {
        let (contour, controls) = (ellipse(40, 60.0, 40.0), [[-20.0, 3.0], [25.0, -1.0]]);
        let deform = MeshDeform::new(&contour, &controls).unwrap();
        let to = [[-20.0, 12.0], [18.0, -4.0]];
        let found = deform.deform(&contour, &to).unwrap();
        for (c, target) in deform.controls.iter().zip(to) {
            let at = [0, 1].map(|d| c.corners.iter().zip(c.shares).map(|(i, s)| s * found[*i as usize][d]).sum::<f64>());
            assert!(farthest(&[at], &[target]) < 1e-3, "{at:?}");
        }
        assert_eq!(&found[..40], contour.as_slice());
    }

    /// A bar bent by a third of a turn: no triangle is turned over, and none shrinks to nothing.
    #[test]
    fn the_inside_of_a_bent_bar_stays_upright() {
        let (below, above) = ((0..=40).map(|i| [f64::from(i), 0.0]), (0..=40).rev().map(|i| [f64::from(i), 8.0]));
        let bar: Vec<Point> = below.chain(above).collect();
        let bend = |p: &Point| {
            let (radius, (sin, cos)) = (40.0 / 2.1, libm::sincos(p[0] * 2.1 / 40.0));
            [(radius - p[1]) * sin, radius - (radius - p[1]) * cos]
        };
        let deform = MeshDeform::new(&bar, &[]).unwrap();
        assert!(deform.points().len() > bar.len());
        let found = deform.deform(&bar.iter().map(bend).collect::<Vec<_>>(), &[]).unwrap();
        let truth: Vec<Point> = deform.points().iter().map(bend).collect();
        assert!(farthest(&found, &truth) < 0.5, "{}", farthest(&found, &truth));
        assert!(deform.triangles().iter().map(|t| t.map(|i| found[i as usize])).all(|[a, b, c]| orient(a, b, c) > 0.0));
    }

    #[test]
    fn what_cannot_follow_is_refused() {
        let contour = ellipse(12, 10.0, 10.0);
        let new = |controls: &[Point]| MeshDeform::new(&contour, controls).unwrap_err();
        assert_eq!(new(&[[0.0, 0.0], [20.0, 0.0]]), DeformError::Outside { at: 1 });
        assert_eq!(new(&[[f64::NAN, 0.0]]), DeformError::NotFinite { what: CONTROL, at: 0 });
        let line = CompatibleError::Flat { contour: 0 };
        assert_eq!(MeshDeform::new(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], &[]).unwrap_err(), DeformError::Compatible(line));
        let deform = MeshDeform::new(&contour, &[[0.0, 0.0]]).unwrap();
        let count = |what, expected, found| Err(DeformError::Count { what, expected, found });
        assert_eq!(deform.deform(&contour[1..], &[[0.0, 0.0]]), count(CONTOUR, 12, 11));
        assert_eq!(deform.deform(&contour, &[]), count(CONTROL, 1, 0));
        let mut bad = contour.clone();
        bad[3][1] = f64::INFINITY;
        assert_eq!(deform.deform(&bad, &[[0.0, 0.0]]), Err(DeformError::NotFinite { what: CONTOUR, at: 3 }));
        // A contour that shrinks to a point has an inside that is finite at least.
        assert!(deform.deform(&[[1.0, 2.0]; 12], &[[1.0, 2.0]]).unwrap().iter().flatten().all(|v| v.is_finite()));
    }
}
