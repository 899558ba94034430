//! Outlines of a matte: level lines by marching squares.
//!
//! Lorensen, Cline 1987 in the plane; saddles are joined or cut as the mean of their corners says, so that no two lines cross. Samples
//! stand at pixel centres, lines lie where a straight line between two of them passes the level. Around the picture there is nothing, so
//! that every outline closes: along the border where the layer leaves the picture.

use super::fit_affine::area;

/// Why there is no outline.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// A coverage is not a number.
    #[error("expected finite coverages, found {value} at column {x}, row {y}")]
    NotFinite {
        /// Column, from 0.
        x: usize,
        /// Row, from 0.
        y: usize,
        /// The coverage.
        value: f32,
    },
}

/// A closed outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Points in pixels, about one for each pixel that the line passes; on screen clockwise around the layer, anticlockwise around a hole.
    pub points: Vec<[f64; 2]>,
    /// Area within, pixels²: negative for a hole.
    pub area: f64,
}

/// Edges of a cell in the order top, right, bottom, left: where a line that has the inside on its right comes in and goes out, for each
/// pattern of corners (top left 1, top right 2, bottom right 4, bottom left 8). Saddles have two lines.
const LINES: [&[(usize, usize)]; 16] = {
    const T: usize = 0;
    const R: usize = 1;
    const B: usize = 2;
    const L: usize = 3;
    [
        &[],
        &[(T, L)],
        &[(R, T)],
        &[(R, L)],
        &[(B, R)],
        &[(T, L), (B, R)],
        &[(B, T)],
        &[(B, L)],
        &[(L, B)],
        &[(T, B)],
        &[(R, T), (L, B)],
        &[(R, B)],
        &[(L, R)],
        &[(T, R)],
        &[(L, T)],
        &[],
    ]
};
/// The saddles where their middle is inside too.
const JOINED: [&[(usize, usize)]; 2] = [&[(0, 1), (2, 3)], &[(3, 0), (1, 2)]];

/// The matte with a border of nothing.
struct Padded<'a> {
    alpha: &'a [f32],
    width: usize,
    height: usize,
}

impl Padded<'_> {
    fn at(&self, x: usize, y: usize) -> f64 {
        let inside = x >= 1 && y >= 1 && x <= self.width && y <= self.height;
        if inside { f64::from(self.alpha[(y - 1) * self.width + x - 1]) } else { 0.0 }
    }

    /// Number of an edge: those to the right of a sample are even, those below it odd.
    fn edge(&self, x: usize, y: usize, side: usize) -> usize {
        let (x, y, below) = match side {
            0 => (x, y, 0),
            1 => (x + 1, y, 1),
            2 => (x, y + 1, 0),
            _ => (x, y, 1),
        };
        2 * (y * (self.width + 2) + x) + below
    }

    /// Where the level is passed on an edge, in pixels.
    fn crossing(&self, edge: usize, level: f64) -> [f64; 2] {
        let (x, y) = (edge / 2 % (self.width + 2), edge / 2 / (self.width + 2));
        let below = edge % 2 == 1;
        let (a, b) = (self.at(x, y), if below { self.at(x, y + 1) } else { self.at(x + 1, y) });
        let t = ((level - a) / (b - a)).clamp(0.0, 1.0);
        let (px, py) = (x as f64 - 0.5, y as f64 - 0.5);
        if below { [px, py + t] } else { [px + t, py] }
    }
}

/// All outlines at `level` (above 0): the largest area first, of equal ones the uppermost, then the leftmost. O(pixels).
///
/// # Errors
/// A coverage that is not finite.
pub fn trace(alpha: &[f32], width: usize, height: usize, level: f64) -> Result<Vec<Outline>, TraceError> {
    if let Some(at) = alpha.iter().position(|a| !a.is_finite()) {
        return Err(TraceError::NotFinite { x: at % width.max(1), y: at / width.max(1), value: alpha[at] });
    }
    let padded = Padded { alpha, width, height };
    let mut next = links(&padded, level);
    let mut outlines = Vec::new();
    for first in 0..next.len() {
        let mut points = Vec::new();
        let mut edge = first;
        while next[edge] != usize::MAX {
            let point = padded.crossing(edge, level);
            // A level that a sample has exactly is passed on up to four edges in one place.
            if points.last() != Some(&point) {
                points.push(point);
            }
            edge = std::mem::replace(&mut next[edge], usize::MAX);
        }
        if points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        if points.len() > 2 {
            outlines.push(Outline { area: area(&points), points });
        }
    }
    // Stable: those of one area stay in the order of rows in which they were met.
    outlines.sort_by(|a, b| b.area.abs().total_cmp(&a.area.abs()));
    Ok(outlines)
}

/// For each edge that a line passes, the edge where it goes on.
fn links(padded: &Padded, level: f64) -> Vec<usize> {
    let (w, h) = (padded.width + 2, padded.height + 2);
    let mut next = vec![usize::MAX; 2 * w * h];
    let inside = |x, y| padded.at(x, y) > level;
    for y in 0..h - 1 {
        let mut right = [inside(0, y), inside(0, y + 1)];
        for x in 0..w - 1 {
            let left = std::mem::replace(&mut right, [inside(x + 1, y), inside(x + 1, y + 1)]);
            let pattern = usize::from(left[0]) | usize::from(right[0]) << 1 | usize::from(right[1]) << 2 | usize::from(left[1]) << 3;
            let mean = || 0.25 * (padded.at(x, y) + padded.at(x + 1, y) + padded.at(x, y + 1) + padded.at(x + 1, y + 1));
            let lines = match pattern {
                5 | 10 if mean() > level => JOINED[usize::from(pattern == 10)],
                _ => LINES[pattern],
            };
            for (from, to) in lines {
                next[padded.edge(x, y, *from)] = padded.edge(x, y, *to);
            }
        }
    }
    next
}

/// Share of an outline's length that lies on the border of the picture.
pub fn on_border(points: &[[f64; 2]], width: usize, height: usize) -> f64 {
    let (w, h) = (width as f64, height as f64);
    let near = |v: f64, edge: f64| (v - edge).abs() <= 0.5;
    let out = |p: &[f64; 2], q: &[f64; 2]| [(0, 0.0), (0, w), (1, 0.0), (1, h)].iter().any(|&(c, e)| near(p[c], e) && near(q[c], e));
    let (mut border, mut whole) = (0.0, 0.0);
    for (i, p) in points.iter().enumerate() {
        let q = &points[(i + 1) % points.len()];
        let length = libm::hypot(q[0] - p[0], q[1] - p[1]);
        whole += length;
        border += if out(p, q) { length } else { 0.0 };
    }
    if whole > 0.0 { border / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Coverage of a disc, by its distance.
    fn disc(size: usize, x: f64, y: f64, r: f64) -> Vec<f32> {
        let at = |i: usize| (r - libm::hypot((i % size) as f64 + 0.5 - x, (i / size) as f64 + 0.5 - y) + 0.5).clamp(0.0, 1.0) as f32;
        (0..size * size).map(at).collect()
    }

    #[test]
    fn a_disc_is_traced_to_a_fraction_of_a_pixel() {
        let found = trace(&disc(64, 30.3, 33.7, 20.0), 64, 64, 0.5).unwrap();
        assert_eq!(found.len(), 1);
        for p in &found[0].points {
            assert!((libm::hypot(p[0] - 30.3, p[1] - 33.7) - 20.0).abs() < 0.1);
        }
        assert!((found[0].area / (std::f64::consts::PI * 400.0) - 1.0).abs() < 2e-3, "clockwise, {}", found[0].area);
        assert_eq!(on_border(&found[0].points, 64, 64), 0.0);
    }

    #[test]
    fn parts_come_by_size_and_holes_are_negative() {
        let mut alpha = vec![0.0; 30 * 20];
        let mut fill = |x0: usize, y0: usize, x1: usize, y1: usize, a: f32| {
            for y in y0..y1 {
                alpha[y * 30 + x0..y * 30 + x1].fill(a);
            }
        };
        fill(1, 1, 5, 5, 1.0);
        fill(10, 2, 26, 18, 1.0);
        fill(14, 6, 20, 12, 0.0);
        let areas: Vec<f64> = trace(&alpha, 30, 20, 0.5).unwrap().iter().map(|o| (o.area * 100.0).round() / 100.0).collect();
        // Corners are cut by the level line: an eighth of a pixel each.
        assert_eq!(areas, [255.5, -35.5, 15.5]);
    }

    #[test]
    fn a_layer_that_leaves_the_picture_closes_along_the_border() {
        let found = trace(&disc(64, 0.0, 30.0, 20.0), 64, 64, 0.5).unwrap();
        assert!((found[0].area / (std::f64::consts::PI * 200.0) - 1.0).abs() < 5e-3);
        let share = on_border(&found[0].points, 64, 64);
        assert!((share - 40.0 / (40.0 + 20.0 * std::f64::consts::PI)).abs() < 0.02, "{share}");
        let whole = trace(&[1.0; 12], 4, 3, 0.5).unwrap();
        assert_eq!((whole.len(), on_border(&whole[0].points, 4, 3)), (1, 1.0));
    }

    #[test]
    fn nothing_has_no_outline_and_what_is_no_number_is_said() {
        assert_eq!(trace(&[0.0; 9], 3, 3, 0.5), Ok(Vec::new()));
        assert_eq!(trace(&[], 0, 0, 0.5), Ok(Vec::new()));
        let error = trace(&[0.0, 0.0, 0.0, 0.0, 0.0, f32::NAN], 3, 2, 0.5).unwrap_err();
        assert_eq!(error.to_string(), "expected finite coverages, found NaN at column 2, row 1");
    }

    proptest! {
        /// Whatever the matte: every line that starts ends, and its area is that of the layer as the level lines have it.
        #[test]
        fn outlines_close(alpha in prop::collection::vec(0.0f32..1.0, 48), level in 0.05f64..0.95) {
            let found = trace(&alpha, 8, 6, level).unwrap();
            for o in &found {
                for (i, p) in o.points.iter().enumerate() {
                    let q = o.points[(i + 1) % o.points.len()];
                    prop_assert!((p[0] - q[0]).abs() <= 1.0 && (p[1] - q[1]).abs() <= 1.0, "a gap in {:?}", o.points);
                }
            }
            let total: f64 = found.iter().map(|o| o.area).sum();
            // A line around the border lies up to half a pixel beyond it.
            prop_assert!((0.0..=9.0 * 7.0).contains(&total));
        }
    }
}
