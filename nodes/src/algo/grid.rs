//! Overlays that show a motion on footage: contours, a deforming grid, the axes of an affine frame.
//!
//! Straight lines stay straight under an affine map, so that the ends of each grid line are mapped and the pen is laid on afterwards: lines
//! keep their width however the grid is squashed.

use kurbo::{BezPath, Point, Shape as _};
use nalgebra::Vector2;

use super::raster::{Affine, apply};

/// What cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OverlayError {
    /// A point that is not a number, or infinitely far out.
    #[error("expected finite points, found point {point} at ({x}, {y})")]
    Point {
        /// Its position in the contour, from 0.
        point: usize,
        /// Its column.
        x: f64,
        /// Its row.
        y: f64,
    },
    /// A motion that is not finite.
    #[error("expected a finite motion, found [{a1}, {a2}, {a3}, {a4}, {dx}, {dy}]", a1 = .0[(0, 0)], a2 = .0[(0, 1)], a3 = .0[(1, 0)], a4 = .0[(1, 1)], dx = .0[(0, 2)], dy = .0[(1, 2)])]
    Motion(Affine),
}

/// Okabe and Ito's colours that all kinds of sight tell apart, as 0xRRGGBB, in an order that shows on footage.
pub const ON_FOOTAGE: [u32; 7] = [0xE69F00, 0x56B4E9, 0x009E73, 0xD55E00, 0xCC79A7, 0xF0E442, 0x0072B2];

fn place(motion: &Affine, p: [f64; 2], origin: [f64; 2]) -> Point {
    let q = apply(motion, Vector2::from(p));
    Point::new(q.x - origin[0], q.y - origin[1])
}

/// The motion, if every number of it is finite.
///
/// # Errors
/// [`OverlayError::Motion`].
pub fn finite_motion(motion: Affine) -> Result<Affine, OverlayError> {
    if motion.iter().all(|v| v.is_finite()) { Ok(motion) } else { Err(OverlayError::Motion(motion)) }
}

/// The points of a contour (pixels of the plane) under `motion`, measured from `origin`. Cost: O(points).
///
/// # Errors
/// [`OverlayError::Point`] for the first point that is not finite.
pub fn moved(points: &[[f64; 2]], motion: &Affine, origin: [f64; 2]) -> Result<Vec<Point>, OverlayError> {
    let bad = points.iter().position(|p| !(p[0].is_finite() && p[1].is_finite()));
    match bad.map(|point| (point, points[point])) {
        Some((point, [x, y])) => Err(OverlayError::Point { point, x, y }),
        None => Ok(points.iter().map(|&p| place(motion, p, origin)).collect()),
    }
}

/// The path through `points`, closed or open; without points the empty path.
pub fn polyline(points: &[Point], closed: bool) -> BezPath {
    let mut path = BezPath::new();
    for (i, &p) in points.iter().enumerate() {
        if i == 0 { path.move_to(p) } else { path.line_to(p) }
    }
    if closed && points.len() > 1 {
        path.close_path();
    }
    path
}

/// A disc of `diameter` pixels, within a thousandth of a pixel.
pub fn dot(centre: Point, diameter: f64) -> BezPath {
    kurbo::Circle::new(centre, diameter / 2.0).to_path(1e-3)
}

/// Centre lines of a grid of `[columns, rows]` cells over `[left, top, right, bottom]` (reference pixels) under `motion`, measured from `origin`.
///
/// The first two lines of each direction are the sides of the box: `columns + 1` lines down and `rows + 1` across. This is the overlay of
/// Bregler, Loeb, Chuang and Deshpande 2002, figure 3.
pub fn grid(bounds: [f64; 4], cells: [usize; 2], motion: &Affine, origin: [f64; 2]) -> BezPath {
    let [left, top, right, bottom] = bounds;
    let mut path = BezPath::new();
    let mut line = |a: [f64; 2], b: [f64; 2]| {
        path.move_to(place(motion, a, origin));
        path.line_to(place(motion, b, origin));
    };
    for i in 0..=cells[0] {
        let x = left + (right - left) * (i as f64 / cells[0].max(1) as f64);
        line([x, top], [x, bottom]);
    }
    for j in 0..=cells[1] {
        let y = top + (bottom - top) * (j as f64 / cells[1].max(1) as f64);
        line([left, y], [right, y]);
    }
    path
}

/// An arrow from `tail` to `tip` for a pen of `width` pixels: the shaft's centre line, and the head to be filled.
///
/// The head is as long as the arrow at the most, and empty where the arrow has no length.
pub fn arrow(tail: Point, tip: Point, width: f64) -> (BezPath, BezPath) {
    let d = tip - tail;
    let length = libm::hypot(d.x, d.y);
    if !(length > 0.0 && length.is_finite()) {
        return (BezPath::new(), BezPath::new());
    }
    let along = d / length;
    let across = kurbo::Vec2::new(-along.y, along.x);
    let size = (width * 4.5).min(length);
    let base = tip - along * size;
    let shaft = polyline(&[tail, base + along * (size * 0.2)], false);
    (shaft, polyline(&[tip, base + across * (size * 0.42), base - across * (size * 0.42)], true))
}

/// Where the axes of the frame at `at` (reference pixels) end under `motion`, measured from `origin`: the origin, the tip of x and that of y,
/// `length` reference pixels away.
pub fn axes(at: [f64; 2], length: f64, motion: &Affine, origin: [f64; 2]) -> [Point; 3] {
    [at, [at[0] + length, at[1]], [at[0], at[1] + length]].map(|p| place(motion, p, origin))
}

#[cfg(test)]
mod tests {
    use super::super::paint::{FillRule, coverage};
    use super::super::raster::identity;
    use super::*;

    fn area(path: &BezPath, size: usize) -> f64 {
        coverage(path, FillRule::NonZero, size, size).iter().map(|&v| f64::from(v)).sum()
    }

    #[test]
    fn a_dot_covers_the_area_of_its_disc() {
        let found = area(&dot(Point::new(10.3, 9.8), 12.0), 20);
        assert!((found - 36.0 * std::f64::consts::PI).abs() < 0.02, "found {found}");
    }

    #[test]
    fn grid_lines_end_where_the_motion_takes_the_box() {
        let motion = Affine::new(2.0, 0.5, -3.0, -0.25, 1.5, 4.0);
        let path = grid([1.0, 2.0, 9.0, 8.0], [4, 3], &motion, [0.5, 0.0]);
        assert_eq!(path.elements().len(), 2 * (5 + 4));
        assert_eq!(path.elements()[0], kurbo::PathEl::MoveTo(Point::new(2.0 + 1.0 - 3.0 - 0.5, -0.25 + 3.0 + 4.0)));
        let last = path.elements()[path.elements().len() - 1];
        assert_eq!(last, kurbo::PathEl::LineTo(Point::new(18.0 + 4.0 - 3.0 - 0.5, -2.25 + 12.0 + 4.0)));
        assert_eq!(grid([0.0, 0.0, 1.0, 1.0], [0, 0], &identity(), [0.0, 0.0]).elements().len(), 4, "no cells is no division by nought");
    }

    #[test]
    fn an_arrow_points_from_its_tail_to_its_tip() {
        let (shaft, head) = arrow(Point::new(2.0, 10.0), Point::new(18.0, 10.0), 2.0);
        let bounds = head.bounding_box();
        assert!((bounds.x1 - 18.0).abs() < 1e-12 && (bounds.x0 - 9.0).abs() < 1e-12);
        assert!(shaft.bounding_box().x0 == 2.0 && shaft.bounding_box().x1 < 18.0);
        let (shaft, head) = arrow(Point::new(1.0, 1.0), Point::new(1.0, 1.0), 2.0);
        assert!(shaft.elements().is_empty() && head.elements().is_empty());
    }

    #[test]
    fn points_and_motions_that_are_not_finite_are_named() {
        let error = moved(&[[1.0, 2.0], [f64::NAN, 4.0]], &identity(), [0.0; 2]).unwrap_err();
        assert_eq!(error.to_string(), "expected finite points, found point 1 at (NaN, 4)");
        let motion = Affine::new(1.0, 0.0, f64::INFINITY, 0.0, 1.0, 0.0);
        assert_eq!(finite_motion(motion).unwrap_err().to_string(), "expected a finite motion, found [1, 0, 0, 1, inf, 0]");
        assert_eq!(moved(&[], &identity(), [0.0; 2]), Ok(Vec::new()));
    }
}
