//! Pen lines as outlines: constant width by kurbo's stroke expansion, and ink whose width varies along the line.

use kurbo::{BezPath, Cap, Join, PathEl, Point, Stroke, StrokeOpts, Vec2};

/// The outline of the centre line `path` drawn with a pen of `width` pixels. Fill it by the non-zero rule.
///
/// A width that is not positive and finite, or a path that is not finite, gives an empty outline.
pub fn stroke(path: &BezPath, width: f64, cap: Cap, join: Join) -> BezPath {
    if !(width.is_finite() && width > 0.0 && path.is_finite()) {
        return BezPath::new();
    }
    let style = Stroke::new(width).with_caps(cap).with_join(join);
    kurbo::stroke(path.iter(), &style, &StrokeOpts::default(), 1e-2)
}

/// The sub-paths of `path` as polylines, chords within `tolerance` pixels of the curves, each with whether it is closed.
///
/// A closed polyline does not repeat its first point. A path that is not finite gives none.
pub fn flatten(path: &BezPath, tolerance: f64) -> Vec<(Vec<Point>, bool)> {
    let mut lines: Vec<(Vec<Point>, bool)> = Vec::new();
    if !path.is_finite() || tolerance.is_nan() {
        return lines;
    }
    kurbo::flatten(path.iter(), tolerance.max(1e-9), |el| match el {
        PathEl::MoveTo(p) => lines.push((vec![p], false)),
        PathEl::LineTo(p) => {
            if let Some((points, _)) = lines.last_mut().filter(|(points, _)| points.last() != Some(&p)) {
                points.push(p);
            }
        }
        PathEl::ClosePath => {
            if let Some((points, closed)) = lines.last_mut() {
                *closed = true;
                if points.len() > 1 && points.first() == points.last() {
                    points.pop();
                }
            }
        }
        PathEl::QuadTo(..) | PathEl::CurveTo(..) => {}
    });
    lines
}

/// The outline of an ink line through `points`, `width_at(s)` pixels wide at the fraction `s` (0 to 1) of its length. Fill by the non-zero rule.
///
/// An open line has round ends of its width there, so that a width which falls to zero tapers to a point. A closed line becomes a ring, whose
/// width should be periodic. Points should lie closer together than the line is wide; sharp corners are rounded. Cost: O(n).
pub fn ink(points: &[Point], closed: bool, width_at: impl Fn(f64) -> f64) -> BezPath {
    let widths: Vec<f64> = arc_fractions(points, closed).into_iter().map(width_at).collect();
    ink_widths(points, &widths, closed)
}

/// [`ink`] with a width in pixels for each point. Lists of different lengths, or a point that is not finite, give an empty outline.
pub fn ink_widths(points: &[Point], widths: &[f64], closed: bool) -> BezPath {
    let mut line: Vec<(Point, f64)> = points.iter().copied().zip(widths.iter().map(|w| (w / 2.0).max(0.0))).collect();
    line.dedup_by_key(|v| v.0);
    if closed && line.len() > 1 && line.first().map(|v| v.0) == line.last().map(|v| v.0) {
        line.pop();
    }
    let n = line.len();
    if n < 2 || points.len() != widths.len() || line.iter().any(|v| !v.0.is_finite()) {
        return BezPath::new();
    }
    let between = |i: usize, j: usize| direction(line[i % n].0, line[j % n].0);
    let mut left = Vec::with_capacity(n + 8);
    let mut right = Vec::with_capacity(n + 8);
    for i in 0..n {
        let before = if i > 0 || closed { between(i + n - 1, i) } else { between(0, 1) };
        let after = if i + 1 < n || closed { between(i, i + 1) } else { before };
        offset_vertex(&mut left, &mut right, line[i].0, before, after, line[i].1);
    }
    right.reverse();
    if closed {
        let mut out = polygon(&left);
        out.extend(polygon(&right));
        return out;
    }
    // The arc at the far end runs from the left side round to the right one, and the one at the near end back.
    let (first, last) = (line[0], line[n - 1]);
    let mut outline = left;
    push_arc(&mut outline, last.0, normal(between(n - 2, n - 1)) * last.1, std::f64::consts::PI);
    outline.extend(right);
    push_arc(&mut outline, first.0, normal(between(0, 1)) * -first.1, std::f64::consts::PI);
    polygon(&outline)
}

/// The fraction of the whole length at which each point lies.
fn arc_fractions(line: &[Point], closed: bool) -> Vec<f64> {
    let mut sum = 0.0;
    let mut lengths = vec![0.0];
    for pair in line.windows(2) {
        sum += distance(pair[0], pair[1]);
        lengths.push(sum);
    }
    let closing = line.first().zip(line.last()).map_or(0.0, |(a, b)| distance(*b, *a));
    let total = if closed { sum + closing } else { sum };
    lengths.iter_mut().for_each(|s| *s /= total.max(f64::MIN_POSITIVE));
    lengths.truncate(line.len());
    lengths
}

fn distance(a: Point, b: Point) -> f64 {
    let d = b - a;
    (d.x * d.x + d.y * d.y).sqrt()
}

fn direction(a: Point, b: Point) -> Vec2 {
    (b - a) / distance(a, b).max(f64::MIN_POSITIVE)
}

/// The direction turned left as drawn, for y down.
fn normal(d: Vec2) -> Vec2 {
    Vec2::new(d.y, -d.x)
}

/// The two offset points of a vertex; a corner adds an arc on its outer side.
fn offset_vertex(left: &mut Vec<Point>, right: &mut Vec<Point>, p: Point, before: Vec2, after: Vec2, half: f64) {
    let turn = libm::atan2(before.cross(after), before.dot(after));
    if turn.abs() < 0.3 {
        let mean = before + after;
        let n = normal(mean / (mean.x * mean.x + mean.y * mean.y).sqrt()) * half;
        left.push(p + n);
        right.push(p - n);
        return;
    }
    let n = normal(before) * half;
    // For y down a positive turn is to the right as drawn, so that the left side is the outer one.
    let (outer, inner, start) = if turn > 0.0 { (left, right, n) } else { (right, left, -n) };
    outer.push(p + start);
    push_arc(outer, p, start, turn);
    inner.extend([p - start, p, p - normal(after) * half * turn.signum()]);
}

/// Points on the arc about `centre` from `centre + start` through `sweep` radians, without its first point.
fn push_arc(out: &mut Vec<Point>, centre: Point, start: Vec2, sweep: f64) {
    let radius = (start.x * start.x + start.y * start.y).sqrt();
    let steps = (libm::sqrt(radius.clamp(0.0, 1e4)) * 11.0 * sweep.abs()).ceil().max(1.0) as usize;
    for k in 1..=steps {
        let (sin, cos) = libm::sincos(sweep * k as f64 / steps as f64);
        out.push(centre + Vec2::new(start.x * cos - start.y * sin, start.x * sin + start.y * cos));
    }
}

/// The closed path through `points`.
pub fn polygon(points: &[Point]) -> BezPath {
    let mut out = BezPath::with_capacity(points.len() + 1);
    for (i, &p) in points.iter().enumerate() {
        if i == 0 { out.move_to(p) } else { out.line_to(p) }
    }
    if !points.is_empty() {
        out.close_path();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::{FillRule, coverage, svg_path};
    use super::*;

    fn area(path: &BezPath, size: usize) -> f64 {
        coverage(path, FillRule::NonZero, size, size).iter().map(|&v| f64::from(v)).sum()
    }

    #[test]
    fn ink_of_constant_width_equals_the_stroke() {
        let path = svg_path("M6 20C12 2 24 40 34 14").unwrap();
        let (points, closed) = flatten(&path, 1e-4).remove(0);
        let ours = coverage(&ink(&points, closed, |_| 5.0), FillRule::NonZero, 40, 40);
        let theirs = coverage(&stroke(&path, 5.0, Cap::Round, Join::Round), FillRule::NonZero, 40, 40);
        // Kurbo's offset curves are within a hundredth of a pixel.
        let worst = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.025, "found {worst}");
    }

    #[test]
    fn ink_rounds_corners_as_the_stroke_does() {
        for d in ["M5 5L30 8L8 30", "M5 5L8 30L30 8", "M6 8L30 8L30 30L6 30Z"] {
            let path = svg_path(d).unwrap();
            let (points, closed) = flatten(&path, 1e-4).remove(0);
            let ours = area(&ink(&points, closed, |_| 5.0), 40);
            let theirs = area(&stroke(&path, 5.0, Cap::Round, Join::Round), 40);
            assert!((ours - theirs).abs() < 0.2, "{d}: expected {theirs}, found {ours}");
        }
    }

    #[test]
    fn ink_of_a_taper_is_a_triangle() {
        let points: Vec<Point> = (0..=20).map(|i| Point::new(4.0 + f64::from(i), 10.0)).collect();
        // A triangle of base 6 and length 20, and the half disc of the round end at the base.
        let truth = 60.0 + 4.5 * std::f64::consts::PI;
        let found = area(&ink(&points, false, |s| 6.0 * (1.0 - s)), 40);
        assert!((found - truth).abs() < 0.02, "expected {truth}, found {found}");
    }

    #[test]
    fn ink_of_bad_input_is_empty() {
        assert!(ink(&[], false, |_| 1.0).elements().is_empty());
        assert!(ink(&[Point::ZERO, Point::ZERO], true, |_| 1.0).elements().is_empty());
        assert!(ink(&[Point::ZERO, Point::new(f64::NAN, 0.0)], false, |_| 1.0).elements().is_empty());
        assert!(stroke(&svg_path("M0 0L5 5").unwrap(), f64::NAN, Cap::Butt, Join::Miter).elements().is_empty());
        assert_eq!(coverage(&ink(&[Point::ZERO, Point::new(1.0, 0.0)], false, |_| f64::NAN), FillRule::NonZero, 1, 1), [0.0]);
    }
}
