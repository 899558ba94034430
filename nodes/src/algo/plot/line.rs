//! Lines of any number of points, at the cost of their pixels.

use kurbo::Point;

use super::super::paint::{BezPath, Cap, FillRule, Join, fill_rows, stroke};

/// A polyline with at most four points in each column of pixels: the first, lowest, highest and last. It covers what the whole line covers to
/// within a column. Cost: O(points).
///
/// Jugel, Jerzak, Hackenbroich, Markl, *M4: A visualization-oriented time series data aggregation*, VLDB 2014.
pub fn reduced(points: &[Point]) -> Vec<Point> {
    let mut out: Vec<Point> = Vec::new();
    let mut start = 0;
    while start < points.len() {
        let column = libm::floor(points[start].x);
        let length = points[start..].iter().take_while(|p| libm::floor(p.x) == column).count().max(1);
        let group = &points[start..start + length];
        start += length;
        if group.len() <= 4 {
            out.extend(group);
            continue;
        }
        let by = |order: fn(f64, f64) -> bool| (1..group.len()).fold(0, |best, i| if order(group[i].y, group[best].y) { i } else { best });
        let mut kept = [0, by(|a, b| a < b), by(|a, b| a > b), group.len() - 1];
        kept.sort_unstable();
        out.extend(kept.iter().map(|&i| group[i]));
    }
    out.dedup();
    out
}

/// A picture of coverages onto which outlines are united.
pub(super) struct Mask {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) cover: Vec<f32>,
}

/// Segments of a line that are drawn at once: crossings are sought among these only.
const CHUNK: usize = 8;

impl Mask {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, cover: vec![0.0; width * height] }
    }

    pub(super) fn clear(&mut self) {
        self.cover.fill(0.0);
    }

    /// Unites with the inside of `path`: the larger coverage counts, so that a line that touches itself gets no seam.
    pub(super) fn unite(&mut self, path: &BezPath) {
        let (cover, width) = (&mut self.cover, self.width);
        fill_rows(path, FillRule::NonZero, width, self.height, |y, x0, row| {
            let start = y * width + x0;
            for (below, &above) in cover[start..].iter_mut().zip(row) {
                *below = below.max(above);
            }
        });
    }

    /// Unites with a pen of `pen` pixels along `points`; one point is a dot.
    pub(super) fn line(&mut self, points: &[Point], pen: f64) {
        let points = reduced(points);
        if let [only] = points[..] {
            self.unite(&super::super::grid::dot(only, pen));
        }
        let mut start = 0;
        while start + 1 < points.len() {
            let end = (start + CHUNK).min(points.len() - 1);
            self.unite(&stroke(&super::super::grid::polyline(&points[start..=end], false), pen, Cap::Round, Join::Round));
            start = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_keeps_the_ends_and_extremes_of_each_column() {
        let points: Vec<Point> = (0..4000).map(|i| Point::new(f64::from(i) / 400.0, libm::sin(f64::from(i) * 0.7) * 5.0)).collect();
        let few = reduced(&points);
        assert!(few.len() <= 40, "found {}", few.len());
        for column in 0..10 {
            let of = |list: &[Point]| list.iter().filter(|p| p.x.floor() == f64::from(column)).map(|p| p.y).collect::<Vec<_>>();
            let (all, kept) = (of(&points), of(&few));
            let ends = |v: &[f64]| v.iter().fold([f64::MAX, f64::MIN], |[a, b], y| [a.min(*y), b.max(*y)]);
            assert_eq!((ends(&all), all[0], all.last()), (ends(&kept), kept[0], kept.last()));
        }
        assert_eq!(reduced(&points[..3]), points[..3]);
        assert!(reduced(&[]).is_empty());
    }

    #[test]
    fn chunks_leave_no_seam() {
        let points: Vec<Point> = (0..=40).map(|i| Point::new(2.0 + f64::from(i), 5.0)).collect();
        let mut mask = Mask::new(44, 10);
        mask.line(&points, 2.0);
        let truth = 80.0 + std::f64::consts::PI;
        let found: f64 = mask.cover.iter().map(|&v| f64::from(v)).sum();
        assert!((found - truth).abs() < 0.02, "expected {truth}, found {found}");
    }
}
