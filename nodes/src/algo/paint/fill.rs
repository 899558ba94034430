//! Exact area coverage of a filled path, right for overlaps.
//!
//! Adding signed areas alone, as font rasterisers do, doubles or cancels where a path overlaps itself. Here each row of pixels is cut into
//! slabs at every vertex and crossing, so that within a slab the edges are ordered from left to right; the winding number is walked along that
//! order, and only the edges where the fill begins or ends add their signed area. Coverage is then exact for either rule.

use kurbo::{BezPath, PathEl, Point};

/// How far, in pixels, the chords of a flattened curve may lie from it: a quarter of one step of 8 bit at most.
pub const FLATTEN_TOLERANCE: f64 = 1e-3;

/// Points further out than this many pixels are moved to it, which bounds the work of flattening.
const FAR: f64 = 1e7;

/// Which winding numbers are inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FillRule {
    /// All but zero: overlaps unite.
    #[default]
    NonZero,
    /// The odd ones: overlaps alternate.
    EvenOdd,
}

impl FillRule {
    fn is_inside(self, winding: i32) -> bool {
        match self {
            Self::NonZero => winding != 0,
            Self::EvenOdd => winding & 1 == 1,
        }
    }
}

/// The area of each pixel of a `width` by `height` picture that `path` fills, 0 to 1, row by row.
///
/// Open sub-paths are closed by a line. A path with a coordinate that is not finite fills nothing. The list is empty where `width * height`
/// overflows. Exact for polygons up to rounding; curves are flattened to [`FLATTEN_TOLERANCE`]. Cost: that of [`fill_rows`], plus the picture.
pub fn coverage(path: &BezPath, rule: FillRule, width: usize, height: usize) -> Vec<f32> {
    let mut out = vec![0.0; width.checked_mul(height).unwrap_or(0)];
    if !out.is_empty() {
        fill_rows(path, rule, width, height, |y, x0, row| {
            let start = y * width + x0;
            out[start..start + row.len()].copy_from_slice(row);
        });
    }
    out
}

/// Calls `emit(y, x0, row)` for each row that `path` may touch, from the top: `row[i]` is the filled area of the pixel at column `x0 + i`.
///
/// Cost: O(n log n) for n edges, plus for each row O(slabs × edges of the row), plus the pixels that are emitted.
pub fn fill_rows(path: &BezPath, rule: FillRule, width: usize, height: usize, mut emit: impl FnMut(usize, usize, &[f32])) {
    if width == 0 || height == 0 {
        return;
    }
    let edges = edges_of(path, height as f64);
    let mut row = Row::new(width);
    let mut next = 0;
    let mut active: Vec<Edge> = Vec::new();
    let mut y = 0;
    while y < height && (next < edges.len() || !active.is_empty()) {
        if active.is_empty() {
            y = y.max(edges[next].y0 as usize);
        }
        let (top, bottom) = (y as f64, y as f64 + 1.0);
        active.retain(|e| e.y1 > top);
        while next < edges.len() && edges[next].y0 < bottom {
            active.push(edges[next]);
            next += 1;
        }
        row.add(&active, rule, top);
        row.flush(|x0, cover| emit(y, x0, cover));
        y += 1;
    }
}

/// A straight edge that runs down, from (x0, y0) to (x1, y1); `winding` is +1 where the path ran down too and −1 where it ran up.
#[derive(Clone, Copy, Debug)]
struct Edge {
    x0: f64,
    y0: f64,
    x1: f64,
    y1: f64,
    winding: i32,
}

impl Edge {
    fn x_at(&self, y: f64) -> f64 {
        if y <= self.y0 {
            self.x0
        } else if y >= self.y1 {
            self.x1
        } else {
            self.x0 + (self.x1 - self.x0) * ((y - self.y0) / (self.y1 - self.y0))
        }
    }
}

/// The edges of `path` between rows 0 and `height`, by their upper ends.
fn edges_of(path: &BezPath, height: f64) -> Vec<Edge> {
    if !path.is_finite() {
        return Vec::new();
    }
    let mut edges = Vec::new();
    let (mut start, mut last) = (Point::ZERO, Point::ZERO);
    kurbo::flatten(path.iter().map(clamp_element), FLATTEN_TOLERANCE, |el| match el {
        PathEl::MoveTo(p) => {
            push_edge(&mut edges, last, start, height);
            (start, last) = (p, p);
        }
        PathEl::LineTo(p) => {
            push_edge(&mut edges, last, p, height);
            last = p;
        }
        PathEl::ClosePath => {
            push_edge(&mut edges, last, start, height);
            last = start;
        }
        PathEl::QuadTo(..) | PathEl::CurveTo(..) => {}
    });
    push_edge(&mut edges, last, start, height);
    edges.sort_by(|a, b| a.y0.total_cmp(&b.y0));
    edges
}

fn clamp_element(el: PathEl) -> PathEl {
    let near = |p: Point| Point::new(p.x.clamp(-FAR, FAR), p.y.clamp(-FAR, FAR));
    match el {
        PathEl::MoveTo(p) => PathEl::MoveTo(near(p)),
        PathEl::LineTo(p) => PathEl::LineTo(near(p)),
        PathEl::QuadTo(a, p) => PathEl::QuadTo(near(a), near(p)),
        PathEl::CurveTo(a, b, p) => PathEl::CurveTo(near(a), near(b), near(p)),
        PathEl::ClosePath => PathEl::ClosePath,
    }
}

fn push_edge(edges: &mut Vec<Edge>, a: Point, b: Point, height: f64) {
    let (upper, lower, winding) = if a.y < b.y { (a, b, 1) } else { (b, a, -1) };
    if upper.y == lower.y || lower.y <= 0.0 || upper.y >= height {
        return;
    }
    let whole = Edge { x0: upper.x, y0: upper.y, x1: lower.x, y1: lower.y, winding };
    let (y0, y1) = (upper.y.max(0.0), lower.y.min(height));
    edges.push(Edge { x0: whole.x_at(y0), y0, x1: whole.x_at(y1), y1, winding });
}

/// The part of an edge within a slab.
#[derive(Clone, Copy)]
struct Piece {
    top: f64,
    bottom: f64,
    winding: i32,
}

/// One row of pixels in the making: differences of coverage from left to right.
struct Row {
    width: usize,
    delta: Vec<f64>,
    cover: Vec<f32>,
    /// The columns whose differences were touched.
    low: usize,
    high: usize,
    cuts: Vec<f64>,
    crossings: Vec<f64>,
    pieces: Vec<Piece>,
}

impl Row {
    fn new(width: usize) -> Self {
        let delta = vec![0.0; width + 2];
        Self { width, delta, cover: Vec::new(), low: usize::MAX, high: 0, cuts: Vec::new(), crossings: Vec::new(), pieces: Vec::new() }
    }

    /// Adds the fill of the row whose upper side is at `top`.
    fn add(&mut self, active: &[Edge], rule: FillRule, top: f64) {
        let bottom = top + 1.0;
        let mut cuts = std::mem::take(&mut self.cuts);
        cuts.clear();
        cuts.extend([top, bottom]);
        cuts.extend(active.iter().flat_map(|e| [e.y0, e.y1]).filter(|&y| y > top && y < bottom));
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup();
        for pair in cuts.windows(2) {
            self.add_slab(active, rule, pair[0], pair[1]);
        }
        self.cuts = cuts;
    }

    /// Adds a slab that no edge begins or ends in, cutting it further where edges cross.
    fn add_slab(&mut self, active: &[Edge], rule: FillRule, y0: f64, y1: f64) {
        if self.order_pieces(active, y0, y1) {
            return self.add_pieces(rule, y1 - y0);
        }
        let mut crossings = std::mem::take(&mut self.crossings);
        crossings.clear();
        crossings.extend([y0, y1]);
        for (i, a) in self.pieces.iter().enumerate() {
            for b in &self.pieces[i + 1..] {
                let (d0, d1) = (b.top - a.top, b.bottom - a.bottom);
                if d0 * d1 < 0.0 {
                    crossings.push((y0 + (y1 - y0) * (d0 / (d0 - d1))).clamp(y0, y1));
                }
            }
        }
        crossings.sort_unstable_by(f64::total_cmp);
        crossings.dedup();
        for pair in crossings.windows(2) {
            self.order_pieces(active, pair[0], pair[1]);
            self.add_pieces(rule, pair[1] - pair[0]);
        }
        self.crossings = crossings;
    }

    /// Gathers the pieces of a slab from left to right; false where two of them cross within it.
    fn order_pieces(&mut self, active: &[Edge], y0: f64, y1: f64) -> bool {
        self.pieces.clear();
        for e in active.iter().filter(|e| e.y0 <= y0 && e.y1 >= y1) {
            self.pieces.push(Piece { top: e.x_at(y0), bottom: e.x_at(y1), winding: e.winding });
        }
        self.pieces.sort_by(|a, b| (a.top + a.bottom).total_cmp(&(b.top + b.bottom)));
        self.pieces.windows(2).all(|p| p[0].top <= p[1].top && p[0].bottom <= p[1].bottom)
    }

    /// Walks the winding number over the ordered pieces and adds those where the fill begins or ends.
    fn add_pieces(&mut self, rule: FillRule, dy: f64) {
        let mut winding = 0;
        for i in 0..self.pieces.len() {
            let piece = self.pieces[i];
            let was = rule.is_inside(winding);
            winding += piece.winding;
            let is = rule.is_inside(winding);
            if was != is {
                self.add_line(piece.top, piece.bottom, if is { dy } else { -dy });
            }
        }
    }

    /// Adds the area right of a line from `xa` to `xb` that spans `dy` of the row's height (signed).
    fn add_line(&mut self, xa: f64, xb: f64, dy: f64) {
        let right = self.width as f64;
        let (mut a, b) = if xa < xb { (xa, xb) } else { (xb, xa) };
        if a >= right {
            return;
        }
        if b <= 0.0 {
            return self.add_delta(0, dy, 0.0);
        }
        let slope = dy / (b - a);
        if a < 0.0 {
            self.add_delta(0, -a * slope, 0.0);
            a = 0.0;
        }
        let first = a as usize;
        if b <= first as f64 + 1.0 {
            let height = if xa.min(xb) < 0.0 { (b - a) * slope } else { dy };
            return self.add_delta(first, height, (a + b) / 2.0 - first as f64);
        }
        let b = b.min(right);
        let mut column = first;
        while (column as f64) < b {
            let end = b.min(column as f64 + 1.0);
            self.add_delta(column, (end - a) * slope, (a + end) / 2.0 - column as f64);
            a = end;
            column += 1;
        }
    }

    /// Adds an edge piece of signed `height` in `column`, whose mean distance from the column's left side is `inset`.
    fn add_delta(&mut self, column: usize, height: f64, inset: f64) {
        self.delta[column] += height * (1.0 - inset);
        self.delta[column + 1] += height * inset;
        self.low = self.low.min(column);
        self.high = self.high.max(column + 1);
    }

    /// Sums the differences to coverage, hands the touched columns on, and clears the row.
    fn flush(&mut self, emit: impl FnOnce(usize, &[f32])) {
        if self.low >= self.width {
            return;
        }
        self.cover.clear();
        let mut sum = 0.0;
        for value in &mut self.delta[self.low..=self.high] {
            sum += *value;
            *value = 0.0;
            // Differences that cancel leave rounding behind, which is not paint.
            self.cover.push(if sum < 1e-12 { 0.0 } else { sum.min(1.0) as f32 });
        }
        // What is still inside after the last edge goes on to the right side, which clipped the path.
        let rest = if sum > 1e-9 { sum.min(1.0) as f32 } else { 0.0 };
        let end = if rest > 0.0 { self.width } else { (self.high + 1).min(self.width) };
        self.cover.resize(end - self.low, rest);
        emit(self.low, &self.cover);
        (self.low, self.high) = (usize::MAX, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{stroke, svg_path};
    use super::*;
    use kurbo::{Cap, Circle, Join, Shape};
    use proptest::prelude::*;

    fn area(path: &BezPath, rule: FillRule, size: usize) -> f64 {
        coverage(path, rule, size, size).iter().map(|&v| f64::from(v)).sum()
    }

    fn rect(x0: f64, y0: f64, x1: f64, y1: f64) -> BezPath {
        svg_path(&format!("M{x0} {y0}L{x1} {y0} {x1} {y1} {x0} {y1}Z")).unwrap()
    }

    /// The area of a disc of radius `r` at the origin within x ≤ `x`, y ≤ `y`, by the integral of the clipped half-chord.
    fn disc_quadrant(r: f64, x: f64, y: f64) -> f64 {
        let (x, y) = (x.clamp(-r, r), y.clamp(-r, r));
        let integral = |t: f64| 0.5 * (t * (r * r - t * t).max(0.0).sqrt() + r * r * (t / r).clamp(-1.0, 1.0).asin());
        // Columns where the whole chord, a part of it, or nothing of it lies below y.
        let reach = (r * r - y * y).max(0.0).sqrt();
        let side = |lo: f64, hi: f64| {
            let hi = hi.min(x);
            if hi <= lo { 0.0 } else { if y > 0.0 { 2.0 * (integral(hi) - integral(lo)) } else { 0.0 } }
        };
        let hi = reach.min(x);
        let middle = if hi <= -reach { 0.0 } else { integral(hi) - integral(-reach) + y * (hi + reach) };
        side(-r, -reach) + middle + side(reach, r)
    }

    #[test]
    fn fill_of_a_circle_is_its_analytic_area() {
        let (cx, cy, r) = (16.3, 15.8, 11.7);
        let path = Circle::new((cx, cy), r).to_path(1e-6);
        let cover = coverage(&path, FillRule::NonZero, 32, 32);
        let at = |i: usize, j: usize| disc_quadrant(r, i as f64 - cx, j as f64 - cy);
        for y in 0..32 {
            for x in 0..32 {
                let truth = at(x + 1, y + 1) - at(x, y + 1) - at(x + 1, y) + at(x, y);
                let found = f64::from(cover[y * 32 + x]);
                // The flattening tolerance bounds the error of each pixel by about 1e-3.
                assert!((found - truth).abs() < 1.0 / 255.0 / 2.0, "pixel {x},{y}: expected {truth}, found {found}");
            }
        }
    }

    #[test]
    fn fill_of_a_triangle_is_exact() {
        // Half of a 1x1 pixel, and slopes that cross several columns: y = x / 4.
        let cover = coverage(&svg_path("M0 0L4 0L4 1Z").unwrap(), FillRule::NonZero, 4, 1);
        assert_eq!(cover, [0.125, 0.375, 0.625, 0.875]);
    }

    #[test]
    fn fill_unites_overlaps_and_even_odd_alternates() {
        let mut two = rect(1.25, 1.25, 5.5, 5.5);
        two.extend(rect(3.5, 3.5, 7.75, 7.75));
        let (one, both) = (4.25 * 4.25, 2.0 * 2.0);
        assert!((area(&two, FillRule::NonZero, 9) - (2.0 * one - both)).abs() < 1e-5);
        assert!((area(&two, FillRule::EvenOdd, 9) - (2.0 * one - 2.0 * both)).abs() < 1e-5);
    }

    #[test]
    fn fill_does_not_cancel_opposite_windings() {
        let mut two = rect(1.25, 1.0, 4.5, 3.0);
        two.extend(svg_path("M2.5 1L2.5 3L6.75 3L6.75 1Z").unwrap());
        // Where the windings cancel, from 2.5 to 4.5, the winding number is zero.
        assert!((area(&two, FillRule::NonZero, 9) - 2.0 * (1.25 + 2.25)).abs() < 1e-5);
        // A bow tie has both windings and keeps both halves.
        assert!((area(&svg_path("M1 1L5 5L5 1L1 5Z").unwrap(), FillRule::NonZero, 6) - 8.0).abs() < 1e-5);
    }

    #[test]
    fn fill_of_a_pentagram_follows_the_rule() {
        let point = |k: usize| {
            let angle = std::f64::consts::TAU * (k * 2 % 5) as f64 / 5.0;
            (10.0 + 9.0 * angle.sin(), 10.0 - 9.0 * angle.cos())
        };
        let d: String = (0..5).map(|k| format!("{}{} {}", if k == 0 { 'M' } else { 'L' }, point(k).0, point(k).1)).collect();
        let star = svg_path(&d).unwrap();
        let gap = area(&star, FillRule::NonZero, 20) - area(&star, FillRule::EvenOdd, 20);
        let (r, fifth) = (9.0 * (std::f64::consts::PI * 0.4).cos() / (std::f64::consts::PI * 0.2).cos(), std::f64::consts::PI * 0.4);
        assert!((gap - 2.5 * r * r * fifth.sin()).abs() < 1e-4, "the inner pentagon");
    }

    #[test]
    fn fill_of_a_stroke_that_crosses_itself_never_passes_one() {
        let path = svg_path("M2 2C30 30 30 2 2 28").unwrap();
        let outline = stroke(&path, 4.0, Cap::Round, Join::Round);
        let cover = coverage(&outline, FillRule::NonZero, 32, 32);
        assert!(cover.iter().all(|&v| (0.0..=1.0).contains(&v)));
        for t in [0.1, 0.35, 0.5, 0.8] {
            let p = kurbo::ParamCurve::eval(&path.segments().next().unwrap(), t);
            assert_eq!(cover[p.y as usize * 32 + p.x as usize], 1.0, "at {t}");
        }
    }

    #[test]
    fn fill_clips_on_all_sides() {
        let cover = coverage(&rect(-50.0, -50.0, 50.0, 50.0), FillRule::NonZero, 3, 2);
        assert_eq!(cover, [1.0; 6]);
        let cover = coverage(&rect(-9.0, 0.5, 1.5, 9.0), FillRule::NonZero, 3, 2);
        assert_eq!(cover, [0.5, 0.25, 0.0, 1.0, 0.5, 0.0]);
        let cover = coverage(&svg_path("M-4 0L4 0L4 1Z").unwrap(), FillRule::NonZero, 2, 1);
        assert_eq!(cover, [0.5625, 0.6875]);
        assert_eq!(coverage(&rect(9.0, 9.0, 12.0, 12.0), FillRule::NonZero, 3, 2), [0.0; 6]);
    }

    #[test]
    fn fill_survives_bad_input() {
        assert!(coverage(&rect(0.0, 0.0, 1.0, 1.0), FillRule::NonZero, 0, 5).is_empty());
        assert!(coverage(&BezPath::new(), FillRule::NonZero, usize::MAX, 2).is_empty());
        let mut nan = BezPath::new();
        nan.move_to((f64::NAN, 0.0));
        nan.line_to((1.0, 1.0));
        assert_eq!(coverage(&nan, FillRule::NonZero, 2, 2), [0.0; 4]);
        assert_eq!(coverage(&svg_path("M-1e300 -1e300H1e300V1e300H-1e300Z").unwrap(), FillRule::NonZero, 2, 1), [1.0, 1.0]);
    }

    proptest! {
        #[test]
        fn fill_is_the_same_when_a_path_is_drawn_twice(points in prop::collection::vec((-4.0..20.0f64, -4.0..20.0f64), 3..9)) {
            let d: String = points.iter().enumerate().map(|(i, p)| format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, p.0, p.1)).collect();
            let once = svg_path(&d).unwrap();
            let mut twice = once.clone();
            twice.extend(once.iter());
            let (a, b) = (coverage(&once, FillRule::NonZero, 16, 16), coverage(&twice, FillRule::NonZero, 16, 16));
            for (a, b) in a.iter().zip(&b) {
                prop_assert!((a - b).abs() < 1e-6);
            }
            prop_assert!(coverage(&twice, FillRule::EvenOdd, 16, 16).iter().all(|&v| v < 1e-6));
        }

        #[test]
        fn fill_of_both_rules_agrees_on_samples(points in prop::collection::vec((0.0..8.0f64, 0.0..8.0f64), 3..8)) {
            let d: String = points.iter().enumerate().map(|(i, p)| format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, p.0, p.1)).collect();
            let path = svg_path(&(d + "Z")).unwrap();
            for rule in [FillRule::NonZero, FillRule::EvenOdd] {
                let (cover, n) = (area(&path, rule, 8), 80);
                let inside = (0..n * n).filter(|k| {
                    let p = kurbo::Point::new((k % n) as f64 * 8.0 / n as f64 + 0.05, (k / n) as f64 * 8.0 / n as f64 + 0.05);
                    rule.is_inside(path.winding(p))
                });
                let sampled = inside.count() as f64 * 64.0 / (n * n) as f64;
                // The boundary, at most 8 sides of 11 px, passes through cells of 0.1 px: counting errs by less than this.
                prop_assert!((cover - sampled).abs() < 1.0, "expected {sampled}, found {cover}");
            }
        }
    }
}
