//! Pictures carried by a mesh: in each triangle the affine map of its corners (Bregler et al. 2002, section 3.4, photographs).
//!
//! Every pixel of the target whose centre is in a triangle looks up its place in the source. Where the map shrinks, several places inside the
//! pixel are averaged, so that nothing crawls. Tiles of the target give the same bits.

use super::compatible::{Point, cross, sub};
use super::raster::{Affine, Raster};
use super::warp_affine::{Filter, Source};
use super::window::Window;

/// Most places that are averaged each way; a picture shrunk more than this aliases.
const MOST_PLACES: usize = 16;
/// How far outside a triangle, as a share of it, a pixel may lie: neighbours leave no crack.
const SLACK: f64 = 1e-9;

/// One picture on a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshWarp<'a> {
    /// The picture.
    pub source: Source<'a>,
    /// Corners of the triangles, by point; those that come later lie above.
    pub triangles: &'a [[u32; 3]],
    /// Points in the picture.
    pub from: &'a [Point],
    /// Points in the target.
    pub to: &'a [Point],
    /// How the picture is read between its pixels.
    pub filter: Filter,
}

impl MeshWarp<'_> {
    /// Writes the pixels of `target`, which holds `window`, whose centres are in a triangle; all others are left alone.
    ///
    /// A triangle that is flat in the target covers nothing; one that is flat in the source shows the line that it is there. Points that are
    /// not finite draw nothing. Cost: O(pixels in triangles · taps² · places).
    pub fn draw(&self, target: &mut [f32], window: Window) {
        for t in self.triangles {
            let corners = |points: &[Point]| t.map(|i| points.get(i as usize).copied().unwrap_or([f64::NAN; 2]));
            if let Some(map) = affine(corners(self.to), corners(self.from)) {
                self.triangle(corners(self.to), &map, target, window);
            }
        }
    }

    fn triangle(&self, corners: [Point; 3], map: &Affine, target: &mut [f32], window: Window) {
        let channels = self.source.raster.channels;
        let [top, bottom] = ends(corners.map(|c| c[1]), window.y, window.height);
        let places = [0, 1].map(|d| places(libm::hypot(map[(0, d)], map[(1, d)]), self.filter));
        for y in top..bottom {
            let row = window.y as f64 + y as f64 + 0.5;
            let Some(span) = span(corners, row) else { continue };
            let [left, right] = ends([span[0], span[1], span[1]], window.x, window.width);
            for x in left..right {
                let at = [window.x as f64 + x as f64 + 0.5, row];
                let pixel = (y * window.width + x) * channels;
                self.pixel(at, map, places, &mut target[pixel..pixel + channels]);
            }
        }
    }

    /// The mean over a grid of places in one pixel.
    fn pixel(&self, at: Point, map: &Affine, [nx, ny]: [usize; 2], out: &mut [f32]) {
        out.fill(0.0);
        let weight = 1.0 / (nx * ny) as f32;
        for j in 0..ny {
            for i in 0..nx {
                let x = at[0] + (i as f64 + 0.5) / nx as f64 - 0.5;
                let y = at[1] + (j as f64 + 0.5) / ny as f64 - 0.5;
                let place = [0, 1].map(|r| map[(r, 0)] * x + map[(r, 1)] * y + map[(r, 2)] - self.source.origin[r] as f64 - 0.5);
                sample(&self.source.raster, place, self.filter, weight, out);
            }
        }
    }
}

/// How many places are averaged along an axis of a pixel that is so long in the source.
fn places(length: f64, filter: Filter) -> usize {
    if filter == Filter::Nearest { 1 } else { (libm::ceil(length - 0.1).max(1.0) as usize).min(MOST_PLACES) }
}

/// The first pixel and the one after the last whose centres lie between the least and the greatest of `at`.
fn ends(at: [f64; 3], origin: i64, len: usize) -> [usize; 2] {
    let low = at[0].min(at[1]).min(at[2]) - origin as f64 - 0.5;
    let high = at[0].max(at[1]).max(at[2]) - origin as f64 - 0.5;
    let slack = SLACK * (high - low).max(1.0);
    let first = libm::ceil(low - slack).clamp(0.0, len as f64) as usize;
    let last = (libm::floor(high + slack) + 1.0).clamp(first as f64, len as f64) as usize;
    [first, last]
}

/// Where a row crosses a triangle.
fn span(corners: [Point; 3], y: f64) -> Option<[f64; 2]> {
    let mut found: Option<[f64; 2]> = None;
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let (low, high) = (a[1].min(b[1]), a[1].max(b[1]));
        let slack = SLACK * (high - low).max(1.0);
        if y < low - slack || y > high + slack {
            continue;
        }
        let ends = if high > low {
            let x = a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1])).clamp(0.0, 1.0);
            [x, x]
        } else {
            [a[0].min(b[0]), a[0].max(b[0])]
        };
        found = Some(found.map_or(ends, |f| [f[0].min(ends[0]), f[1].max(ends[1])]));
    }
    found
}

/// The affine map that takes the corners `from` to `to`; `None` where `from` is flat or not finite.
fn affine(from: [Point; 3], to: [Point; 3]) -> Option<Affine> {
    let (u, v) = (sub(from[1], from[0]), sub(from[2], from[0]));
    let area = cross(u, v);
    let (p, q) = (sub(to[1], to[0]), sub(to[2], to[0]));
    let row = |k: usize| {
        let (a, b) = ((p[k] * v[1] - q[k] * u[1]) / area, (q[k] * u[0] - p[k] * v[0]) / area);
        [a, b, to[0][k] - a * from[0][0] - b * from[0][1]]
    };
    let (x, y) = (row(0), row(1));
    let map = Affine::new(x[0], x[1], x[2], y[0], y[1], y[2]);
    map.iter().all(|m| m.is_finite()).then_some(map)
}

/// Adds `weight` times the picture at a place in sample coordinates; outside of it there is nothing.
fn sample(raster: &Raster<'_>, [x, y]: [f64; 2], filter: Filter, weight: f32, out: &mut [f32]) {
    let radius = filter.radius();
    let [(x0, wx), (y0, wy)] = [(x, radius), (y, radius)].map(|(at, radius)| taps(at, radius, filter));
    for (j, b) in wy.iter().enumerate().filter(|(_, b)| **b != 0.0) {
        let row = y0 + j as f64;
        if !(row >= 0.0 && row < raster.height as f64) {
            continue;
        }
        let samples = raster.row(row as usize);
        for (i, a) in wx.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            let column = x0 + i as f64;
            if !(column >= 0.0 && column < raster.width as f64) {
                continue;
            }
            let at = column as usize * raster.channels;
            let w = a * b * weight;
            out.iter_mut().zip(&samples[at..at + raster.channels]).for_each(|(o, s)| *o += w * s);
        }
    }
}

/// The first sample that a filter at `at` covers, and the weights of that and the five after it, which add up to 1.
fn taps(at: f64, radius: f64, filter: Filter) -> (f64, [f32; 6]) {
    if filter == Filter::Nearest {
        return (libm::floor(at + 0.5), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
    let first = libm::floor(at) - radius + 1.0;
    let n = (2.0 * radius) as usize;
    let raw: [f64; 6] = std::array::from_fn(|k| if k < n { filter.at(first + k as f64 - at) } else { 0.0 });
    let sum: f64 = raw.iter().sum();
    (first, raw.map(|w| (w / sum) as f32))
}

/// A band of `width` around a contour, as triangles over `n` more points after `points`: what lies just outside goes with the edge.
///
/// Returns the points of the band, to be put after all others, for each set of points; `first` is the number of all points before them.
pub fn band(contour: &[Point], width: f64) -> Vec<Point> {
    let n = contour.len();
    let area: f64 = (0..n).map(|i| cross(contour[i], contour[(i + 1) % n])).sum();
    let out = |d: Point| {
        let length = libm::hypot(d[0], d[1]).max(f64::MIN_POSITIVE);
        if area > 0.0 { [d[1] / length, -d[0] / length] } else { [-d[1] / length, d[0] / length] }
    };
    let place = |i: usize| {
        let (p, q, r) = (contour[(i + n - 1) % n], contour[i], contour[(i + 1) % n]);
        let (a, b) = (out(sub(q, p)), out(sub(r, q)));
        // The mitre, no longer than twice the width at sharp corners.
        let sum = [a[0] + b[0], a[1] + b[1]];
        let length = (sum[0] * sum[0] + sum[1] * sum[1]) / 2.0;
        let scale = width / length.max(0.5);
        [q[0] + sum[0] * scale, q[1] + sum[1] * scale]
    };
    (0..n).map(place).collect()
}

/// Triangles between a contour, points 0 to n, and its [`band`], points from `first` on.
pub fn band_triangles(n: usize, first: usize) -> Vec<[u32; 3]> {
    let quad = |i: usize| {
        let (a, b, c, d) = (i as u32, ((i + 1) % n) as u32, (first + i) as u32, (first + (i + 1) % n) as u32);
        [[a, c, d], [a, d, b]]
    };
    (0..n).flat_map(quad).collect()
}

#[cfg(test)]
mod tests;
