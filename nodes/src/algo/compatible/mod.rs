//! Compatible triangulations: contours of one point order, each filled with triangles of one connectivity.
//!
//! What as-rigid-as-possible interpolation stands on (Alexa, Cohen-Or, Levin, As-rigid-as-possible shape interpolation, SIGGRAPH 2000, section 3).
//! Diagonals that lie inside every contour are taken first, by dynamic programming over the contour. What is left over is triangulated in each
//! contour by itself, and the triangulations are overlaid in a common convex polygon (Aronov, Seidel, Souvaine, On compatible
//! triangulations of simple polygons, 1993): this cannot fail. The points where diagonals cross become interior points, most of which are then
//! collapsed again; flips, splits and moves that keep every triangle of every contour upright make the angles good (Surazhsky, Gotsman,
//! High quality compatible triangulations, 2004). Last, interior points move to where each contour's triangles are least distorted against
//! the first's. Orientation is decided by exact predicates (Shewchuk 1997).

mod diagonals;
mod mesh;
mod overlay;
mod refine;
#[cfg(test)]
mod tests;

use mesh::Mesh;
use robust::{Coord, orient2d};

/// A point or a step in the plane, pixels.
pub type Point = [f64; 2];

/// Most points of a contour: the search for common diagonals is cubic in them.
pub const MOST_POINTS: usize = 1000;

/// Why contours have no compatible triangulation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompatibleError {
    /// No contour at all.
    #[error("expected at least one contour, found none")]
    Empty,
    /// Too few points, or too many.
    #[error("expected contours of 3 to {MOST_POINTS} points, found {found}; resample them")]
    Points {
        /// Points found.
        found: usize,
    },
    /// Contours of different numbers of points.
    #[error("expected {expected} points in contour {contour} as in contour 0, found {found}; resample them to as many")]
    Count {
        /// The contour, from 0.
        contour: usize,
        /// Points of contour 0.
        expected: usize,
        /// Points found.
        found: usize,
    },
    /// NaN, infinity, or so large that areas are.
    #[error("expected finite points, found NaN, infinity or one beyond 1e100 at point {point} of contour {contour}")]
    NotFinite {
        /// The contour, from 0.
        contour: usize,
        /// The point, from 0.
        point: usize,
    },
    /// Edges that cross or touch.
    #[error("expected a contour that does not cross or touch itself, found that edges {first} and {second} of contour {contour} do")]
    Crossing {
        /// The contour, from 0.
        contour: usize,
        /// An edge, by its first point.
        first: usize,
        /// Another edge, by its first point.
        second: usize,
    },
    /// All points on one line.
    #[error("expected a contour with an inside, found that all points of contour {contour} lie on one line")]
    Flat {
        /// The contour, from 0.
        contour: usize,
    },
    /// Contours that run opposite ways.
    #[error("expected contours that run the same way round, found contour {contour} against contour 0; reverse the order of its points")]
    Mirrored {
        /// The contour, from 0.
        contour: usize,
    },
    /// Rounding left a triangle without area.
    #[error(
        "expected contours that can be filled with triangles in double precision, found one without area in contour {contour}; remove points that nearly touch"
    )]
    Degenerate {
        /// The contour, from 0.
        contour: usize,
    },
}

/// How fine the triangles are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Longest inner edge over the spacing of the contour's points next to it. Infinite adds no point for good angles.
    pub spacing: f64,
    /// Most interior points for each point of a contour.
    pub most_inner: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { spacing: 1.6, most_inner: 3.0 }
    }
}

/// Triangles of one connectivity in several contours.
#[derive(Clone, Debug, PartialEq)]
pub struct Compatible {
    /// Corners, by point; their area x₁y₂ - x₂y₁ is positive in every contour.
    pub triangles: Vec<[u32; 3]>,
    /// For each contour its own points in their order, then the interior points.
    pub points: Vec<Vec<Point>>,
    /// Points of a contour.
    pub n_contour: usize,
}

impl Compatible {
    /// Least angle of the triangles in contour `k`, in radians.
    pub fn min_angle(&self, k: usize) -> f64 {
        let p = &self.points[k];
        let angle = |a: Point, b: Point, c: Point| {
            let (u, v) = (sub(b, a), sub(c, a));
            libm::atan2(cross(u, v), dot(u, v))
        };
        let angles = self.triangles.iter().flat_map(|t| {
            let [a, b, c] = t.map(|i| p[i as usize]);
            [angle(a, b, c), angle(b, c, a), angle(c, a, b)]
        });
        angles.fold(f64::INFINITY, f64::min)
    }
}

pub(crate) fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

pub(crate) fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(crate) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(crate) fn lerp(a: Point, b: Point, t: f64) -> Point {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
}

/// Twice the signed area of a triangle; its sign is exact.
pub(crate) fn orient(a: Point, b: Point, c: Point) -> f64 {
    let coord = |p: Point| Coord { x: p[0], y: p[1] };
    orient2d(coord(a), coord(b), coord(c))
}

/// Fills `contours`, closed and of one point order, with triangles of one connectivity.
///
/// Errors: contours that have no inside or cross themselves, of different numbers of points, that run opposite ways, or are not finite.
/// Cost: O(n³) for n points, with a constant of a nanosecond; O(n²) interior points at the worst, before they are collapsed.
pub fn triangulate(contours: &[&[Point]], options: Options) -> Result<Compatible, CompatibleError> {
    let turned = validate(contours)?;
    // Inside, everything runs so that areas are positive: a mirror image where it does not.
    let mirror = |p: &Point| if turned { [p[0], -p[1]] } else { *p };
    let mut points: Vec<Vec<Point>> = contours.iter().map(|c| c.iter().map(mirror).collect()).collect();
    let n = points[0].len();
    let triangles = base(&mut points);
    let mut mesh = Mesh::new(n, points, triangles);
    refine::improve(&mut mesh, options);
    if let Some(contour) = mesh.degenerate() {
        return Err(CompatibleError::Degenerate { contour });
    }
    let (triangles, points) = mesh.into_parts();
    let upright = |[a, b, c]: [u32; 3]| if turned { [a, c, b] } else { [a, b, c] };
    Ok(Compatible {
        triangles: triangles.into_iter().map(upright).collect(),
        points: points.iter().map(|p| p.iter().map(mirror).collect()).collect(),
        n_contour: n,
    })
}

/// Triangles from common diagonals, and overlays where these do not reach; adds interior points.
fn base(points: &mut [Vec<Point>]) -> Vec<[usize; 3]> {
    let parts = diagonals::partition(points);
    let mut triangles = parts.triangles;
    for hole in parts.holes {
        triangles.extend(overlay::overlay(&hole, points));
    }
    triangles
}

/// Refuses what cannot be filled; true where the contours run against the positive sense.
fn validate(contours: &[&[Point]]) -> Result<bool, CompatibleError> {
    let first = contours.first().ok_or(CompatibleError::Empty)?;
    let expected = first.len();
    if !(3..=MOST_POINTS).contains(&expected) {
        return Err(CompatibleError::Points { found: expected });
    }
    let mut turned = false;
    for (contour, points) in contours.iter().enumerate() {
        if points.len() != expected {
            return Err(CompatibleError::Count { contour, expected, found: points.len() });
        }
        if let Some(point) = points.iter().position(|p| !p.iter().all(|v| v.abs() <= 1e100)) {
            return Err(CompatibleError::NotFinite { contour, point });
        }
        if points.iter().all(|p| orient(points[0], points[expected / 2], *p) == 0.0) && flat(points) {
            return Err(CompatibleError::Flat { contour });
        }
        if let Some((first, second)) = touching(points) {
            return Err(CompatibleError::Crossing { contour, first, second });
        }
        let negative = is_negative(points);
        if contour > 0 && negative != turned {
            return Err(CompatibleError::Mirrored { contour });
        }
        turned = negative;
    }
    Ok(turned)
}

/// Whether all points lie on one line.
fn flat(points: &[Point]) -> bool {
    let far = points.iter().copied().find(|p| *p != points[0]);
    far.is_none_or(|far| points.iter().all(|p| orient(points[0], far, *p) == 0.0))
}

/// Whether a simple polygon runs against the positive sense: the turn at its leftmost corner says so exactly.
fn is_negative(points: &[Point]) -> bool {
    let n = points.len();
    // The lowest of the leftmost points is an extreme point of the hull, so that its turn is not zero.
    let corner = (0..n).min_by(|&a, &b| points[a][0].total_cmp(&points[b][0]).then(points[a][1].total_cmp(&points[b][1])));
    let i = corner.unwrap_or(0);
    orient(points[(i + n - 1) % n], points[i], points[(i + 1) % n]) < 0.0
}

/// Two edges that meet elsewhere than at the corner that they share.
fn touching(points: &[Point]) -> Option<(usize, usize)> {
    let n = points.len();
    let end = |i: usize| points[(i + 1) % n];
    if let Some(i) = (0..n).find(|&i| points[i] == end(i)) {
        return Some((i, (i + 1) % n));
    }
    for i in 0..n {
        let (a, b) = (points[i], end(i));
        for j in i + 1..n {
            let (c, d) = (points[j], end(j));
            let apart = |k: usize| a[k].max(b[k]) < c[k].min(d[k]) || c[k].max(d[k]) < a[k].min(b[k]);
            if apart(0) || apart(1) {
                continue;
            }
            let meet = if j == i + 1 {
                folds_back(a, b, d)
            } else if (j + 1) % n == i {
                folds_back(c, d, b)
            } else {
                segments_meet(a, b, c, d)
            };
            if meet {
                return Some((i, j));
            }
        }
    }
    None
}

/// Whether the edge b-c lies back along a-b.
fn folds_back(a: Point, b: Point, c: Point) -> bool {
    orient(a, b, c) == 0.0 && dot(sub(a, b), sub(c, b)) > 0.0
}

fn segments_meet(a: Point, b: Point, c: Point, d: Point) -> bool {
    let sides = |p, q, r, s| {
        let (x, y) = (orient(p, q, r), orient(p, q, s));
        !(x > 0.0 && y > 0.0 || x < 0.0 && y < 0.0)
    };
    // Where all four are on one line the boxes, which overlap, decide.
    sides(a, b, c, d) && sides(c, d, a, b)
}
