//! Live-wire: the cheapest path between two pixels.

use super::feature::Field;
use crate::algo::shortest_way::shortest_way;

/// What a pixel of path costs where the feature is as strong as it gets: what keeps paths straight.
const LEAST: f64 = 0.005;

/// How much a step against the direction of the feature costs.
const TURN: f64 = 0.04;

/// The path between two places through the middles of pixels, the places themselves at its ends.
///
/// Mortensen and Barrett 1995: each step to one of the eight neighbours costs its length times how little of the feature there is, and how far it is off the
/// feature's own direction. The path may leave the box of both ends by `margin` pixels. Cost: O(w log w) with w pixels there.
pub fn livewire(field: &Field, [from, to]: [[f64; 2]; 2], margin: f64) -> Vec<[f64; 2]> {
    let side = |k: usize, n: usize| {
        let low = (from[k].min(to[k]) - margin).clamp(0.0, n.saturating_sub(1) as f64) as usize;
        let high = (from[k].max(to[k]) + margin).clamp(0.0, n.saturating_sub(1) as f64) as usize;
        (low, high - low + 1)
    };
    let ((x0, w), (y0, h)) = (side(0, field.width), side(1, field.height));
    let pixel = |p: [f64; 2]| {
        let x = (p[0].max(0.0) as usize).clamp(x0, x0 + w - 1) - x0;
        let y = (p[1].max(0.0) as usize).clamp(y0, y0 + h - 1) - y0;
        y * w + x
    };
    let window = Window { field, origin: [x0, y0], w, h };
    let (start, end) = (pixel(from), pixel(to));
    let mut path = window.path(start, end);
    path.push(to);
    path[0] = from;
    path
}

struct Window<'a> {
    field: &'a Field,
    origin: [usize; 2],
    w: usize,
    h: usize,
}

impl Window<'_> {
    fn middle(&self, pixel: usize) -> [f64; 2] {
        [(pixel % self.w + self.origin[0]) as f64 + 0.5, (pixel / self.w + self.origin[1]) as f64 + 0.5]
    }

    /// The middles of the pixels from one to another.
    fn path(&self, start: usize, end: usize) -> Vec<[f64; 2]> {
        let way = shortest_way(self.w * self.h, [start, end], |pixel, step| {
            let (x, y) = (pixel % self.w, pixel / self.w);
            let tangent = self.field.tangent(self.middle(pixel));
            for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else { continue };
                if nx >= self.w || ny >= self.h {
                    continue;
                }
                let own = f64::from(self.field.strength[(ny + self.origin[1]) * self.field.width + nx + self.origin[0]]);
                let length = if dx != 0 && dy != 0 { std::f64::consts::SQRT_2 } else { 1.0 };
                let off = 1.0 - ((dx as f64 * tangent[0] + dy as f64 * tangent[1]) / length).abs();
                let lack = 1.0 - own;
                step(ny * self.w + nx, length * (LEAST + lack * lack + TURN * own * off));
            }
        });
        way.unwrap_or_else(|| vec![end]).into_iter().map(|pixel| self.middle(pixel)).collect()
    }
}
