//! The warp with the filter as wide as the source's samples.
//!
//! Positions are fixed-point numbers of 2⁻⁴⁰ px, summed exactly along a row, so that they do not drift and any tiling of the target
//! gives the same bits.

use super::raster::{Affine, Raster};
use super::warp_affine::{Filter, LARGEST_STEP, Outside, Source, WarpOptions, lanczos_at};
use super::window::Window;
use std::sync::OnceLock;

/// Fractional bits of a position.
const FRACTION: u32 = 40;
/// One pixel as a position.
const ONE: i128 = 1 << FRACTION;

/// Positions along one row of the target: `base + step * x` in fixed point, as sample coordinates (the first sample's centre is 0).
#[derive(Clone, Copy)]
struct Line {
    base: i128,
    step: i128,
}

impl Line {
    /// Positions along one axis of the source: `row` of the inverse map at target row `y`, with `shift` added.
    fn new(m: &Affine, row: usize, y: i64, window_x: i64, origin: i64, shift: f64) -> Self {
        let start = m[(row, 0)] * 0.5 + m[(row, 1)] * (y as f64 + 0.5) + (m[(row, 2)] - origin as f64 - 0.5 + shift);
        let limit = LARGEST_STEP * LARGEST_STEP / 1024.0;
        let step = fixed(m[(row, 0)]);
        let base = fixed(start.clamp(-limit, limit)).saturating_add(step.saturating_mul(i128::from(window_x)));
        Self { base, step }
    }

    /// The columns x of 0..n with low <= position < high.
    fn columns(&self, low: i128, high: i128, n: usize) -> (usize, usize) {
        let n = n as i128;
        let (first, last) = match self.step.cmp(&0) {
            std::cmp::Ordering::Equal if low <= self.base && self.base < high => (0, n),
            std::cmp::Ordering::Equal => (0, 0),
            std::cmp::Ordering::Greater => (ceil_div(low - self.base, self.step), ceil_div(high - self.base, self.step)),
            std::cmp::Ordering::Less => ((self.base - high).div_euclid(-self.step) + 1, (self.base - low).div_euclid(-self.step) + 1),
        };
        let first = first.clamp(0, n);
        (first as usize, last.clamp(first, n) as usize)
    }

    /// The position at column `x`.
    fn at(&self, x: usize) -> i128 {
        self.base.saturating_add(self.step.saturating_mul(x as i128))
    }

    /// From column `x` on, in 64 bits: positions inside the source fit, and the arithmetic wraps on the way there.
    fn from(&self, x: usize) -> Walk {
        Walk { start: self.at(x) as i64, step: self.step as i64 }
    }
}

/// A [`Line`] from its first inner column, in 64 bits.
#[derive(Clone, Copy)]
struct Walk {
    start: i64,
    step: i64,
}

/// Nearest position in fixed point.
fn fixed(v: f64) -> i128 {
    libm::rint(v * ONE as f64) as i128
}

fn ceil_div(a: i128, positive: i128) -> i128 {
    -(-a).div_euclid(positive)
}

/// What one row needs besides its positions.
#[derive(Clone, Copy)]
struct Job<'a> {
    raster: Raster<'a>,
    filter: Filter,
    outside: Outside,
    taps: usize,
    ahead: Ahead,
}

/// The warp with the filter as wide as the source's samples.
pub(super) fn warp_points(source: Source<'_>, m: &Affine, options: WarpOptions, target: &mut [f32], window: Window) {
    let raster = source.raster;
    let taps = if options.filter == Filter::Nearest { 1 } else { 2 * options.filter.radius() as usize };
    let job = Job { raster, filter: options.filter, outside: options.outside, taps, ahead: Ahead::new(m) };
    let shift = if taps == 1 { 0.5 } else { 0.0 };
    for (i, out) in target.chunks_exact_mut(window.width * raster.channels).enumerate() {
        let y = window.y.saturating_add(i as i64);
        let line_x = Line::new(m, 0, y, window.x, source.origin[0], shift);
        let line_y = Line::new(m, 1, y, window.x, source.origin[1], shift);
        warp_row(&job, line_x, line_y, out, window.width);
    }
}

/// One row: transparent, edge, inner, edge, transparent.
fn warp_row(job: &Job<'_>, line_x: Line, line_y: Line, out: &mut [f32], width: usize) {
    let (channels, taps) = (job.raster.channels, job.taps as i128);
    let (before, after) = ((taps - 1) / 2, taps / 2);
    let (w, h) = (job.raster.width as i128, job.raster.height as i128);
    let meet = |a: (usize, usize), b: (usize, usize)| (a.0.max(b.0), a.1.min(b.1).max(a.0.max(b.0)));
    let touched = match job.outside {
        Outside::Clamp => (0, width),
        Outside::Transparent => {
            meet(line_x.columns(-after * ONE, (w + before) * ONE, width), line_y.columns(-after * ONE, (h + before) * ONE, width))
        }
    };
    let inner =
        meet(line_x.columns(before * ONE, (w - after).max(0) * ONE, width), line_y.columns(before * ONE, (h - after).max(0) * ONE, width));
    let inner = (inner.0.clamp(touched.0, touched.1), inner.1.clamp(touched.0, touched.1));
    // The inner kernels count pixels in 32 bits.
    let is_small = channels <= 4 && job.raster.width.saturating_mul(job.raster.height) <= u32::MAX as usize;
    let inner = if inner.1 > inner.0 && is_small { inner } else { (touched.1, touched.1) };
    out[..touched.0 * channels].fill(0.0);
    out[touched.1 * channels..].fill(0.0);
    for x in (touched.0..inner.0).chain(inner.1..touched.1) {
        edge_pixel(job, line_x.at(x), line_y.at(x), &mut out[x * channels..(x + 1) * channels]);
    }
    if inner.1 > inner.0 {
        inner_row(
            job.raster,
            job.filter,
            line_x.from(inner.0),
            line_y.from(inner.0),
            job.ahead,
            &mut out[inner.0 * channels..inner.1 * channels],
        );
    }
}

/// One pixel whose filter is partly outside the source.
fn edge_pixel(job: &Job<'_>, x: i128, y: i128, out: &mut [f32]) {
    match job.filter {
        Filter::Nearest => edge_taps(job, x, y, &|_| [1.0], out),
        Filter::Bilinear => edge_taps(job, x, y, &|t| [1.0 - t, t], out),
        Filter::Cubic => edge_taps(job, x, y, &catmull_rom, out),
        Filter::Mitchell => edge_taps(job, x, y, &mitchell, out),
        Filter::Lanczos3 => edge_taps(job, x, y, &|t| lanczos(lanczos_table(), t), out),
    }
}

/// One pixel by its `N`² taps, each tested against the source's edges.
fn edge_taps<const N: usize>(job: &Job<'_>, x: i128, y: i128, weights: &impl Fn(f32) -> [f32; N], out: &mut [f32]) {
    let Raster { data, width, height, channels } = job.raster;
    // Beyond a few pixels outside, a clamped picture is constant.
    let near = |v: i128, side: usize| v.clamp(-16 * ONE, (side as i128 + 16) * ONE) as i64;
    let (x, y) = (near(x, width), near(y, height));
    let (wx, wy) = (weights(fraction(x)), weights(fraction(y)));
    let (left, top) = (whole(x) - (N as i64 - 1) / 2, whole(y) - (N as i64 - 1) / 2);
    let inside = |v: i64, side: usize| {
        let clamped = v.clamp(0, side as i64 - 1);
        (clamped == v || job.outside == Outside::Clamp).then_some(clamped as usize)
    };
    for (c, value) in out.iter_mut().enumerate() {
        let mut sum = 0.0;
        for (j, wy) in wy.iter().enumerate() {
            let Some(row) = inside(top + j as i64, height) else { continue };
            let mut across = 0.0;
            for (i, wx) in wx.iter().enumerate() {
                if let Some(column) = inside(left + i as i64, width) {
                    across += data[(row * width + column) * channels + c] * wx;
                }
            }
            sum += across * wy;
        }
        *value = sum;
    }
}

/// The whole part of a position.
#[inline(always)]
fn whole(v: i64) -> i64 {
    v >> FRACTION
}

/// The fraction of a position, of which 24 bits are exact in `f32`.
#[inline(always)]
fn fraction(v: i64) -> f32 {
    (((v >> (FRACTION - 24)) & 0xff_ffff) as i32) as f32 * (1.0 / 16_777_216.0)
}

/// Catmull-Rom weights of the four samples around fraction `t`.
#[inline(always)]
fn catmull_rom(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    [-0.5 * t * u * u, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + u * u * (1.5 * u - 2.5), -0.5 * u * t * t]
}

/// Mitchell-Netravali weights of the four samples around fraction `t`.
#[inline(always)]
fn mitchell(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    let inner = |v: f32| 8.0 / 9.0 + v * v * (7.0 / 6.0 * v - 2.0);
    // The outer cubic of eq. 8 about its double root at distance 2, with v = 2 - distance.
    let outer = |v: f32| v * v * (7.0 * v - 6.0) * (1.0 / 18.0);
    [outer(u), inner(t), inner(u), outer(t)]
}

/// Phases of the Lanczos table.
const PHASES: usize = 4096;

/// Normalised Lanczos weights of the six samples around each of `PHASES` + 1 fractions, in rows of eight.
fn lanczos_table() -> &'static [[f32; 8]] {
    static TABLE: OnceLock<Vec<[f32; 8]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        (0..=PHASES)
            .map(|i| {
                let t = i as f64 / PHASES as f64;
                let raw: [f64; 6] = std::array::from_fn(|k| lanczos_at((t + 2.0 - k as f64).abs(), 3.0));
                let sum: f64 = raw.iter().sum();
                std::array::from_fn(|k| if k < 6 { (raw[k] / sum) as f32 } else { 0.0 })
            })
            .collect()
    })
}

/// Lanczos weights at fraction `t`, interpolated between two phases: within 1e-7 of the formula.
#[inline(always)]
fn lanczos(table: &[[f32; 8]], t: f32) -> [f32; 6] {
    let at = t * PHASES as f32;
    let phase = (at as usize).min(PHASES - 1);
    let f = at - phase as f32;
    let (a, b) = (&table[phase], &table[phase + 1]);
    let all: [f32; 8] = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * f);
    [all[0], all[1], all[2], all[3], all[4], all[5]]
}

/// Pixels whose positions are found at once.
const BLOCK: usize = 64;

/// A run of pixels whose taps are all inside the source.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn inner_row(raster: Raster<'_>, filter: Filter, x: Walk, y: Walk, ahead: Ahead, out: &mut [f32]) {
    match raster.channels {
        1 => inner_filter::<1>(raster, filter, x, y, ahead, out),
        2 => inner_filter::<2>(raster, filter, x, y, ahead, out),
        3 => inner_filter::<3>(raster, filter, x, y, ahead, out),
        4 => inner_filter::<4>(raster, filter, x, y, ahead, out),
        _ => {}
    }
}

#[inline(always)]
fn inner_filter<const C: usize>(raster: Raster<'_>, filter: Filter, x: Walk, y: Walk, ahead: Ahead, out: &mut [f32]) {
    match filter {
        Filter::Nearest => inner_taps::<C, 1>(raster, x, y, ahead, &|_| [1.0], out),
        Filter::Bilinear => inner_taps::<C, 2>(raster, x, y, ahead, &|t| [1.0 - t, t], out),
        Filter::Cubic => inner_taps::<C, 4>(raster, x, y, ahead, &catmull_rom, out),
        Filter::Mitchell => inner_taps::<C, 4>(raster, x, y, ahead, &mitchell, out),
        Filter::Lanczos3 => {
            let table = lanczos_table();
            inner_taps::<C, 6>(raster, x, y, ahead, &|t| lanczos(table, t), out);
        }
    }
}

/// Where the taps of a block of pixels begin, and their weights.
#[derive(Clone, Copy)]
struct Block<const N: usize> {
    first: [u32; BLOCK],
    across: [[f32; BLOCK]; N],
    down: [[f32; BLOCK]; N],
}

impl<const N: usize> Block<N> {
    const EMPTY: Self = Self { first: [0; BLOCK], across: [[0.0; BLOCK]; N], down: [[0.0; BLOCK]; N] };

    /// Finds the positions of `BLOCK` pixels from `x`, `y` on; those beyond the run are never looked at.
    #[inline(always)]
    fn fill(&mut self, width: usize, x: Walk, y: Walk, weights: &impl Fn(f32) -> [f32; N]) {
        let before = ((N - 1) / 2) as u32;
        for k in 0..BLOCK {
            let vx = x.start.wrapping_add(x.step.wrapping_mul(k as i64));
            let vy = y.start.wrapping_add(y.step.wrapping_mul(k as i64));
            let (column, row) = ((vx >> FRACTION) as u32, (vy >> FRACTION) as u32);
            self.first[k] = row.wrapping_sub(before).wrapping_mul(width as u32).wrapping_add(column.wrapping_sub(before));
            let (a, b) = (weights(fraction(vx)), weights(fraction(vy)));
            for n in 0..N {
                self.across[n][k] = a[n];
                self.down[n][k] = b[n];
            }
        }
    }
}

/// Which way the source is walked from one target row to the next, in whole pixels.
#[derive(Clone, Copy)]
struct Ahead {
    columns: isize,
    rows: isize,
}

impl Ahead {
    fn new(m: &Affine) -> Self {
        let step = |v: f64| libm::rint(v.clamp(-64.0, 64.0)) as isize;
        let (columns, rows) = (step(m[(0, 1)]), step(m[(1, 1)]));
        if rows == 0 { Self { columns: 4 * columns.signum(), rows } } else { Self { columns: 0, rows } }
    }

    /// Distance in samples from the first of `taps` to what the next target row will be the first to use.
    #[inline(always)]
    fn samples(self, taps: isize, channels: isize, stride: isize) -> isize {
        let reach = |step: isize| if step > 0 { step + taps - 1 } else { step };
        reach(self.rows) * stride + reach(self.columns) * channels
    }
}

/// Asks for the cache line of `data[at]`, where it exists.
#[inline(always)]
#[allow(
    unsafe_code,
    reason = "a slanted walk over the rows defeats the processor's own prefetching: the bilinear warp takes half the time with this"
)]
fn prefetch(data: &[f32], at: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(sample) = data.get(at) {
        // SAFETY: the address is of a live sample, and a prefetch changes nothing that can be seen.
        unsafe { core::arch::x86_64::_mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(std::ptr::from_ref(sample).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (data, at);
}

/// A run of pixels of `C` channels through `N`² taps, in the order of [`edge_taps`] so that both give the same bits.
#[inline(always)]
fn inner_taps<const C: usize, const N: usize>(
    raster: Raster<'_>,
    mut x: Walk,
    mut y: Walk,
    ahead: Ahead,
    weights: &impl Fn(f32) -> [f32; N],
    out: &mut [f32],
) {
    let stride = raster.width * C;
    let ahead = ahead.samples(N as isize, C as isize, stride as isize);
    let mut block = Block::<N>::EMPTY;
    for pixels in out.chunks_mut(BLOCK * C) {
        block.fill(raster.width, x, y, weights);
        for k in 0..pixels.len() / C {
            prefetch(raster.data, (block.first[k] as isize * C as isize).wrapping_add(ahead) as usize);
        }
        for (k, pixel) in pixels.chunks_exact_mut(C).enumerate() {
            let at = block.first[k] as usize * C;
            let mut sum = [0.0_f32; C];
            for j in 0..N {
                let row = &raster.data[at + j * stride..][..N * C];
                let mut across = [0.0_f32; C];
                for i in 0..N {
                    for c in 0..C {
                        across[c] += row[i * C + c] * block.across[i][k];
                    }
                }
                for c in 0..C {
                    sum[c] += across[c] * block.down[j][k];
                }
            }
            pixel.copy_from_slice(&sum);
        }
        x.start = x.start.wrapping_add(x.step.wrapping_mul(BLOCK as i64));
        y.start = y.start.wrapping_add(y.step.wrapping_mul(BLOCK as i64));
    }
}
