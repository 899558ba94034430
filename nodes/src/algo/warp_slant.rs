//! The warp where the map shrinks along directions that are neither the source's rows nor its columns.
//!
//! The footprint of a target pixel is then a parallelogram of source pixels. The same taps, counted from the corner of the footprint's
//! box, serve every target pixel, so the weights of one tap are found for a block of pixels at a time, one pixel in each lane.

use super::raster::{Affine, Raster};
use super::warp_affine::{Filter, Outside, Source};
use super::window::Window;
use nalgebra::Matrix2;

/// Target pixels whose weights are found at once.
const LANES: usize = 16;
/// Footprints that reach further than this, in source pixels, are left to the plain path: few target pixels have them.
const FARTHEST: f64 = 96.0;
/// What rounding may add to the extent of a row of taps.
const SLACK: f64 = 1e-9;

/// One value for each pixel of a block.
type Lanes = [f32; LANES];

/// The taps of one row of the footprint's box.
struct TapRow {
    /// Column of the first tap, from the box's left.
    first: usize,
    /// Filter coordinates of each tap, less those of the box's top left corner.
    taps: Vec<[f32; 2]>,
}

/// A footprint that is a parallelogram, and the picture under it.
pub(super) struct Slant<'a> {
    raster: Raster<'a>,
    filter: Filter,
    outside: Outside,
    shape: Matrix2<f64>,
    /// Half the sides of the footprint's box.
    reach: [f64; 2],
    /// Taps across the widest row.
    widest: usize,
    rows: Vec<TapRow>,
}

impl<'a> Slant<'a> {
    /// The taps of `shape`, which takes offsets in source pixels to filter coordinates; `None` for more than four channels and for
    /// footprints that are too large.
    pub(super) fn new(raster: Raster<'a>, filter: Filter, outside: Outside, shape: &Matrix2<f64>) -> Option<Self> {
        let (radius, det) = (filter.radius(), shape.determinant());
        let reach =
            [radius * (shape[(1, 1)].abs() + shape[(0, 1)].abs()) / det, radius * (shape[(0, 0)].abs() + shape[(1, 0)].abs()) / det];
        if !(1..=4).contains(&raster.channels) || !reach.iter().all(|r| (0.5..FARTHEST).contains(r)) {
            return None;
        }
        let rows: Vec<TapRow> = (0..=(2.0 * reach[1]) as usize).map(|j| tap_row(shape, radius, reach, j)).collect();
        let widest = rows.iter().map(|row| row.taps.len()).max()?;
        Some(Self { raster, filter, outside, shape: *shape, reach, widest, rows })
    }

    /// Warps through the inverse map `m` into `target`.
    ///
    /// Cost: O(target pixels · taps), and next to nothing where the source is all zero or outside.
    pub(super) fn warp(&self, source: Source<'_>, m: &Affine, target: &mut [f32], window: Window) {
        let origin = [source.origin[0] as f64 + 0.5, source.origin[1] as f64 + 0.5];
        let mut weights = vec![[0.0; LANES]; self.widest];
        for (j, out) in target.chunks_exact_mut(window.width * self.raster.channels).enumerate() {
            let y = window.y.saturating_add(j as i64) as f64 + 0.5;
            let line = [0, 1].map(|r| (m[(r, 0)], m[(r, 1)] * y + (m[(r, 2)] - origin[r])));
            slanted_row(self, line, window.x, &mut weights, out);
        }
    }
}

/// The taps of row `j` of the box that some position of the footprint within its box can weigh.
fn tap_row(shape: &Matrix2<f64>, radius: f64, reach: [f64; 2], j: usize) -> TapRow {
    // The box begins at the first sample within reach, so that its offsets from the centre are in -reach..1 - reach.
    let dy = [j as f64 - reach[1], j as f64 - reach[1] + 1.0];
    let (mut low, mut high) = (-reach[0], reach[0]);
    for r in 0..2 {
        // |a dx + b dy| < radius, at either end of the range of dy.
        let (a, b) = (shape[(r, 0)], shape[(r, 1)]);
        if a != 0.0 {
            let ends = dy.map(|dy| [(-radius - b * dy) / a, (radius - b * dy) / a]);
            low = low.max(ends[0][0].min(ends[0][1]).min(ends[1][0].min(ends[1][1])));
            high = high.min(ends[0][0].max(ends[0][1]).max(ends[1][0].max(ends[1][1])));
        }
    }
    let first = libm::ceil(low + reach[0] - 1.0 - SLACK).max(0.0) as usize;
    let last = libm::floor((high + reach[0] + SLACK).min(2.0 * reach[0]));
    let end = if last < 0.0 { first } else { (last as usize + 1).max(first) };
    let along = |r: usize, i: usize| (shape[(r, 0)] * i as f64 + shape[(r, 1)] * j as f64) as f32;
    TapRow { first, taps: (first..end).map(|i| [along(0, i), along(1, i)]).collect() }
}

/// Where the footprints of a block of target pixels lie.
struct Block {
    /// Column and row of the top left corner of each box.
    left: [i32; LANES],
    top: [i32; LANES],
    /// Filter coordinates of the corner.
    u: Lanes,
    v: Lanes,
}

impl Block {
    /// The pixels from column `x` on; every lane depends on its own column alone, so that any tiling gives the same bits.
    #[inline(always)]
    fn new(slant: &Slant<'_>, line: [(f64, f64); 2], x: i64) -> Self {
        let mut block = Self { left: [0; LANES], top: [0; LANES], u: [0.0; LANES], v: [0.0; LANES] };
        let s = &slant.shape;
        let side = [slant.raster.width as f64, slant.raster.height as f64];
        for k in 0..LANES {
            let column = x.saturating_add(k as i64) as f64 + 0.5;
            // A footprint that is wholly outside may as well lie nearer, so that its corner fits 32 bits.
            let at = |r: usize| (line[r].0 * column + line[r].1).clamp(-slant.reach[r] - 1.0, side[r] + slant.reach[r]);
            let (cx, cy) = (at(0), at(1));
            // Rounding is exact everywhere; the library's is one instruction where the processor has it.
            let (left, top) = ((cx - slant.reach[0]).ceil(), (cy - slant.reach[1]).ceil());
            let (dx, dy) = (left - cx, top - cy);
            (block.left[k], block.top[k]) = (left as i32, top as i32);
            block.u[k] = (s[(0, 0)] * dx + s[(0, 1)] * dy) as f32;
            block.v[k] = (s[(1, 0)] * dx + s[(1, 1)] * dy) as f32;
        }
        block
    }

    /// Columns and rows, from the first to beyond the last, that the first `n` boxes cover together.
    #[inline(always)]
    fn extent(&self, slant: &Slant<'_>, n: usize) -> [[i64; 2]; 2] {
        let sides = [(2.0 * slant.reach[0]) as i64 + 1, slant.rows.len() as i64];
        [(&self.left, sides[0]), (&self.top, sides[1])].map(|(firsts, side)| {
            let low = firsts[..n].iter().fold(i32::MAX, |a, &b| a.min(b));
            let high = firsts[..n].iter().fold(i32::MIN, |a, &b| a.max(b));
            [i64::from(low), i64::from(high) + side]
        })
    }
}

/// One row of the target.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn slanted_row(slant: &Slant<'_>, line: [(f64, f64); 2], window_x: i64, weights: &mut [Lanes], out: &mut [f32]) {
    match slant.raster.channels {
        1 => row_of::<1>(slant, line, window_x, weights, out),
        2 => row_of::<2>(slant, line, window_x, weights, out),
        3 => row_of::<3>(slant, line, window_x, weights, out),
        4 => row_of::<4>(slant, line, window_x, weights, out),
        _ => {}
    }
}

#[inline(always)]
fn row_of<const C: usize>(slant: &Slant<'_>, line: [(f64, f64); 2], window_x: i64, weights: &mut [Lanes], out: &mut [f32]) {
    for (b, pixels) in out.chunks_mut(LANES * C).enumerate() {
        let n = pixels.len() / C;
        let block = Block::new(slant, line, window_x.saturating_add((b * LANES) as i64));
        let extent = block.extent(slant, n);
        if is_zero(slant, extent) {
            pixels.fill(0.0);
            continue;
        }
        let inside =
            [slant.raster.width, slant.raster.height].iter().zip(extent).all(|(&side, [low, high])| low >= 0 && high <= side as i64);
        let mut sums = [[0.0_f32; C]; LANES];
        let mut totals = [0.0_f32; LANES];
        for (j, row) in slant.rows.iter().enumerate() {
            let weights = &mut weights[..row.taps.len()];
            weigh(slant.filter, &block, &row.taps, weights, &mut totals);
            if inside {
                add_inner(slant.raster, &block, j, row.first, weights, &mut sums[..n]);
            } else {
                add_edge(slant, &block, j, row.first, weights, &mut sums[..n]);
            }
        }
        let gains = totals.map(|total| if total > 0.0 { 1.0 / total } else { 0.0 });
        for ((pixel, sum), gain) in pixels.chunks_exact_mut(C).zip(&sums).zip(&gains) {
            for (value, s) in pixel.iter_mut().zip(sum) {
                *value = s * gain;
            }
        }
    }
}

/// Whether every sample that can be seen through `extent` is zero: then so is every mean of them.
#[inline(always)]
fn is_zero(slant: &Slant<'_>, extent: [[i64; 2]; 2]) -> bool {
    let raster = slant.raster;
    let cut = |[low, high]: [i64; 2], side: usize| match slant.outside {
        Outside::Transparent => [low.clamp(0, side as i64) as usize, high.clamp(0, side as i64) as usize],
        // At least the outermost sample is seen.
        Outside::Clamp => [low.clamp(0, side as i64 - 1) as usize, high.clamp(1, side as i64) as usize],
    };
    let ([left, right], [top, bottom]) = (cut(extent[0], raster.width), cut(extent[1], raster.height));
    if left >= right {
        return true;
    }
    // From the middle on, where art is seen first.
    let middle = top.midpoint(bottom);
    (middle..bottom).chain(top..middle).all(|y| {
        let samples = &raster.row(y)[left * raster.channels..right * raster.channels];
        // Without the sign: both zeros are zero.
        samples.iter().fold(0, |bits, v| bits | v.to_bits()) << 1 == 0
    })
}

/// The weights of one row of taps for a block, and their sums.
#[inline(always)]
fn weigh(filter: Filter, block: &Block, taps: &[[f32; 2]], weights: &mut [Lanes], totals: &mut Lanes) {
    match filter {
        Filter::Nearest => {}
        Filter::Bilinear => weigh_with(tent, block, taps, weights, totals),
        Filter::Cubic => weigh_with(catmull_rom, block, taps, weights, totals),
        Filter::Mitchell => weigh_with(mitchell, block, taps, weights, totals),
        Filter::Lanczos3 => weigh_with(lanczos3, block, taps, weights, totals),
    }
}

#[inline(always)]
fn weigh_with(kernel: impl Fn(f32) -> f32, block: &Block, taps: &[[f32; 2]], weights: &mut [Lanes], totals: &mut Lanes) {
    let mut row = [0.0_f32; LANES];
    for (weight, &[u, v]) in weights.iter_mut().zip(taps) {
        for k in 0..LANES {
            weight[k] = kernel((block.u[k] + u).abs()) * kernel((block.v[k] + v).abs());
            row[k] += weight[k];
        }
    }
    for k in 0..LANES {
        totals[k] += row[k];
    }
}

/// Adds one row of taps to the sums of pixels whose boxes are all inside the source.
#[inline(always)]
fn add_inner<const C: usize>(raster: Raster<'_>, block: &Block, j: usize, first: usize, weights: &[Lanes], sums: &mut [[f32; C]]) {
    for (k, sum) in sums.iter_mut().enumerate() {
        let at = ((block.top[k] as usize + j) * raster.width + block.left[k] as usize + first) * C;
        let samples = &raster.data[at..at + weights.len() * C];
        let mut across = [0.0_f32; C];
        for (sample, weight) in samples.chunks_exact(C).zip(weights) {
            for c in 0..C {
                across[c] += sample[c] * weight[k];
            }
        }
        for c in 0..C {
            sum[c] += across[c];
        }
    }
}

/// [`add_inner`] where some taps are outside, in the same order so that both give the same bits.
#[inline(always)]
fn add_edge<const C: usize>(slant: &Slant<'_>, block: &Block, j: usize, first: usize, weights: &[Lanes], sums: &mut [[f32; C]]) {
    let raster = slant.raster;
    let within = |v: i64, side: usize| {
        let clamped = v.clamp(0, side as i64 - 1);
        (clamped == v || slant.outside == Outside::Clamp).then_some(clamped as usize)
    };
    for (k, sum) in sums.iter_mut().enumerate() {
        let Some(y) = within(i64::from(block.top[k]) + j as i64, raster.height) else { continue };
        let samples = raster.row(y);
        let mut across = [0.0_f32; C];
        for (i, weight) in weights.iter().enumerate() {
            let Some(x) = within(i64::from(block.left[k]) + (first + i) as i64, raster.width) else { continue };
            for c in 0..C {
                across[c] += samples[x * C + c] * weight[k];
            }
        }
        for c in 0..C {
            sum[c] += across[c];
        }
    }
}

/// `v` where it is positive. Unlike `max` it is one instruction.
#[inline(always)]
fn positive(v: f32) -> f32 {
    if v > 0.0 { v } else { 0.0 }
}

/// Tent at distance `x`.
#[inline(always)]
fn tent(x: f32) -> f32 {
    positive(1.0 - x)
}

/// Catmull-Rom at distance `x`: both pieces, of which one is taken, so that lanes do not branch.
#[inline(always)]
fn catmull_rom(x: f32) -> f32 {
    let y = positive(2.0 - x);
    let (inner, outer) = (1.0 + x * x * (1.5 * x - 2.5), -0.5 * y * y * (x - 1.0));
    if x < 1.0 { inner } else { outer }
}

/// Mitchell-Netravali at distance `x`, as [`catmull_rom`].
#[inline(always)]
fn mitchell(x: f32) -> f32 {
    let y = positive(2.0 - x);
    let (inner, outer) = (8.0 / 9.0 + x * x * (7.0 / 6.0 * x - 2.0), y * y * (7.0 * y - 6.0) * (1.0 / 18.0));
    if x < 1.0 { inner } else { outer }
}

/// sin(π x) for `x` in 0..=1, from its Taylor series about 0 up to x¹¹, within 6e-8.
#[inline(always)]
fn sin_pi(x: f32) -> f32 {
    let x = if x < 0.5 { x } else { 1.0 - x };
    let t = x * x;
    let tail = 0.082_145_89 + t * -0.007_370_431;
    x * (std::f32::consts::PI + t * (-5.167_712_8 + t * (2.550_164 + t * (-0.599_264_5 + t * tail))))
}

/// Lanczos of radius 3 at distance `x`: 3 sin(π x) sin(π x / 3) / (π x)².
#[inline(always)]
fn lanczos3(x: f32) -> f32 {
    const SCALE: f32 = 0.303_963_55;
    let near = if x < 3.0 { x } else { 3.0 };
    let whole = near as i32;
    let sine = sin_pi(near - whole as f32) * sin_pi(near * (1.0 / 3.0));
    let sign = (1 - 2 * (whole & 1)) as f32;
    // Nearer than this the filter is 1 to the last bit.
    let value = sign * SCALE * sine / (near * near);
    if x < 1e-4 {
        1.0
    } else if x < 3.0 {
        value
    } else {
        0.0
    }
}

#[cfg(test)]
#[path = "warp_slant_tests.rs"]
mod tests;
