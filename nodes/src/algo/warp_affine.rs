//! Pictures under an affine map.
//!
//! Every pixel of the target looks up its source position through the inverse map, and a filter reconstructs the picture there.
//! Positions are fixed-point numbers of 2⁻⁴⁰ px, summed exactly along a row, so that they do not drift and any tiling of the target
//! gives the same bits. Where the map shrinks, the filter's footprint is widened along the directions that shrink
//! (Heckbert, Fundamentals of Texture Mapping and Image Warping, 1989, section 3.5: reconstruction, then prefilter).

use super::merge;
use super::raster::{Affine, Raster, invert};
use super::warp_area;
use super::window::Window;
use nalgebra::Matrix2;
use std::sync::OnceLock;

/// Fractional bits of a position.
const FRACTION: u32 = 40;
/// One pixel as a position.
const ONE: i128 = 1 << FRACTION;
/// Maps whose inverse steps over more pixels than this are taken as singular.
const LARGEST_STEP: f64 = 1099511627776.0;
/// Sources wider or higher than this are refused, so that every position inside fits 64 bits.
pub const LARGEST_SIDE: usize = 1 << 22;
/// Above this local scale the footprint is not widened: the aliasing is slight, and the plain kernels are several times faster.
const ANTIALIAS_FROM: f64 = 0.9;
/// Below this local scale the footprint is widened fully; between the two it grows steadily, so that a zoom does not pop.
const ANTIALIAS_FULL: f64 = 0.7;

/// How a picture is reconstructed between its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, pegbar_engine::Setting)]
pub enum Filter {
    /// The sample nearest to the position: for ids and masks. Never widened.
    Nearest,
    /// Tent of radius 1.
    #[default]
    Bilinear,
    /// Catmull-Rom cubic of radius 2: sharp, interpolates, undershoots slightly (Keys 1981, a = -1/2).
    Cubic,
    /// Mitchell-Netravali cubic of radius 2 with B = C = 1/3 (SIGGRAPH 1988, eq. 8): softer, does not interpolate.
    Mitchell,
    /// Sinc windowed by a sinc, of radius 3: the sharpest, rings at hard edges.
    Lanczos3,
}

impl Filter {
    /// Distance in samples beyond which the filter is zero; a half for `Nearest`.
    pub fn radius(self) -> f64 {
        match self {
            Self::Nearest => 0.5,
            Self::Bilinear => 1.0,
            Self::Cubic | Self::Mitchell => 2.0,
            Self::Lanczos3 => 3.0,
        }
    }

    /// The filter at signed distance `x` in samples, not normalised.
    pub fn at(self, x: f64) -> f64 {
        let x = x.abs();
        match self {
            Self::Nearest => f64::from(u8::from(x <= 0.5)),
            Self::Bilinear => (1.0 - x).max(0.0),
            Self::Cubic => cubic_at(x, 0.0, 0.5),
            Self::Mitchell => cubic_at(x, 1.0 / 3.0, 1.0 / 3.0),
            Self::Lanczos3 => lanczos_at(x, 3.0),
        }
    }

    /// Whether a picture filtered at its own sample positions is itself.
    pub fn interpolates(self) -> bool {
        self != Self::Mitchell
    }
}

/// The cubics of Mitchell and Netravali, Reconstruction filters in computer graphics, 1988, eq. 8, for `x` >= 0.
fn cubic_at(x: f64, b: f64, c: f64) -> f64 {
    if x < 1.0 {
        ((12.0 - 9.0 * b - 6.0 * c) * x * x * x + (-18.0 + 12.0 * b + 6.0 * c) * x * x + 6.0 - 2.0 * b) / 6.0
    } else if x < 2.0 {
        ((-b - 6.0 * c) * x * x * x + (6.0 * b + 30.0 * c) * x * x + (-12.0 * b - 48.0 * c) * x + 8.0 * b + 24.0 * c) / 6.0
    } else {
        0.0
    }
}

/// sinc(x) sinc(x / radius) for `x` >= 0.
pub(super) fn lanczos_at(x: f64, radius: f64) -> f64 {
    if x < 1e-9 {
        1.0
    } else if x < radius {
        let p = std::f64::consts::PI * x;
        libm::sin(p) * libm::sin(p / radius) * radius / (p * p)
    } else {
        0.0
    }
}

/// What lies outside the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, pegbar_engine::Setting)]
pub enum Outside {
    /// Zero in every channel; pixels at the edge are filtered against it.
    #[default]
    Transparent,
    /// The nearest pixel of the source.
    Clamp,
}

/// How to warp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WarpOptions {
    /// Reconstruction filter.
    pub filter: Filter,
    /// What lies outside the source.
    pub outside: Outside,
    /// Whether the footprint is widened where the map shrinks (local scale below 0.9, fully below 0.7).
    pub antialias: bool,
}

impl Default for WarpOptions {
    fn default() -> Self {
        Self { filter: Filter::Bilinear, outside: Outside::Transparent, antialias: true }
    }
}

/// Why a picture could not be warped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WarpError {
    /// The map has a NaN or an infinity.
    #[error("expected a finite affine map, found NaN or infinity in it")]
    NotFinite,
    /// The slice does not fit the window.
    #[error("expected {expected} samples for the window, found {found}")]
    Length {
        /// Samples that the window has.
        expected: usize,
        /// Samples given.
        found: usize,
    },
    /// A side is beyond what is supported.
    #[error("expected sides up to {limit} pixels, found {found}; scale the picture down first")]
    TooLarge {
        /// Largest side.
        limit: usize,
        /// Side found.
        found: usize,
    },
}

/// The source picture and where it lies.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Samples.
    pub raster: Raster<'a>,
    /// Column and row of its first sample in the plane.
    pub origin: [i64; 2],
}

impl<'a> Source<'a> {
    /// A picture whose first sample is at `origin`.
    pub fn new(raster: Raster<'a>, origin: [i64; 2]) -> Self {
        Self { raster, origin }
    }

    /// Its data window.
    pub fn window(&self) -> Window {
        Window::new(self.origin[0], self.origin[1], self.raster.width, self.raster.height)
    }
}

/// Warps `source` by `target_from_source` into `target`, which holds `target_window` with the source's channels, row by row.
///
/// A singular map gives an empty (all zero) picture. The identity and whole-pixel translations are exact copies for every filter that
/// interpolates; Mitchell softens them as it softens any other translation, so that a slow pan does not pulse.
/// Any split of the target into windows gives the same bits. A NaN sample of the source reaches the pixels whose filter covers it.
///
/// Errors: a map that is not finite, a `target` of the wrong length, a source side over [`LARGEST_SIDE`].
/// Cost: O(target pixels · taps²); with antialiasing O(target pixels + source pixels · (2 radius)²).
pub fn warp_affine(
    source: Source<'_>,
    target_from_source: &Affine,
    options: WarpOptions,
    target: &mut [f32],
    target_window: Window,
) -> Result<(), WarpError> {
    let raster = source.raster;
    check(target_from_source, &raster)?;
    let expected = target_window.samples(raster.channels).unwrap_or(usize::MAX);
    if target.len() != expected {
        return Err(WarpError::Length { expected, found: target.len() });
    }
    if target.is_empty() {
        return Ok(());
    }
    let source_from_target = if source.window().is_empty() { None } else { usable_inverse(target_from_source) };
    let Some(source_from_target) = source_from_target else {
        target.fill(0.0);
        return Ok(());
    };
    if let Some(shift) = whole_translation(target_from_source, options) {
        copy_shifted(source, shift, options.outside, target, target_window);
        return Ok(());
    }
    match footprint(target_from_source, options) {
        Some(shape) => warp_area::warp(source, &source_from_target, &shape, options, target, target_window),
        None => warp_points(source, &source_from_target, options, target, target_window),
    }
    Ok(())
}

/// Refuses what cannot be warped.
fn check(map: &Affine, raster: &Raster<'_>) -> Result<(), WarpError> {
    if !map.iter().all(|v| v.is_finite()) {
        return Err(WarpError::NotFinite);
    }
    let side = raster.width.max(raster.height);
    if side > LARGEST_SIDE {
        return Err(WarpError::TooLarge { limit: LARGEST_SIDE, found: side });
    }
    let expected = raster.width.saturating_mul(raster.height).saturating_mul(raster.channels);
    if raster.data.len() != expected {
        return Err(WarpError::Length { expected, found: raster.data.len() });
    }
    Ok(())
}

/// The inverse map, unless it steps too far for anything to be seen.
fn usable_inverse(target_from_source: &Affine) -> Option<Affine> {
    invert(target_from_source).filter(|m| m.iter().all(|v| v.abs() <= LARGEST_STEP))
}

/// The translation in whole pixels that the map is, if it is one and the filter leaves such maps alone.
fn whole_translation(map: &Affine, options: WarpOptions) -> Option<[i64; 2]> {
    let linear_is_identity = map[(0, 0)] == 1.0 && map[(1, 1)] == 1.0 && map[(0, 1)] == 0.0 && map[(1, 0)] == 0.0;
    let (x, y) = (map[(0, 2)], map[(1, 2)]);
    let whole = libm::floor(x) == x && libm::floor(y) == y && x.abs() <= LARGEST_STEP && y.abs() <= LARGEST_STEP;
    (linear_is_identity && whole && options.filter.interpolates()).then_some([x as i64, y as i64])
}

/// Copies the source moved by `shift`.
fn copy_shifted(source: Source<'_>, shift: [i64; 2], outside: Outside, target: &mut [f32], window: Window) {
    let raster = source.raster;
    let channels = raster.channels;
    let left = window.x.saturating_sub(shift[0]).saturating_sub(source.origin[0]);
    let top = window.y.saturating_sub(shift[1]).saturating_sub(source.origin[1]);
    let (width, height) = (raster.width as i64, raster.height as i64);
    // The columns of the target that see the source.
    let first = (-left).clamp(0, window.width as i64) as usize;
    let last = (width.saturating_sub(left)).clamp(first as i64, window.width as i64) as usize;
    for (i, out) in target.chunks_exact_mut(window.width * channels).enumerate() {
        let wanted = top.saturating_add(i as i64);
        let y = wanted.clamp(0, height - 1);
        if y != wanted && outside == Outside::Transparent {
            out.fill(0.0);
            continue;
        }
        let row = raster.row(y as usize);
        if last > first {
            let from = (left + first as i64) as usize * channels;
            out[first * channels..last * channels].copy_from_slice(&row[from..from + (last - first) * channels]);
        }
        for x in (0..first).chain(last..window.width) {
            let pixel = &mut out[x * channels..(x + 1) * channels];
            match outside {
                Outside::Transparent => pixel.fill(0.0),
                Outside::Clamp => {
                    let from = left.saturating_add(x as i64).clamp(0, width - 1) as usize * channels;
                    pixel.copy_from_slice(&row[from..from + channels]);
                }
            }
        }
    }
}

/// The widened footprint: the matrix that takes an offset in source pixels to filter coordinates; `None` where nothing is widened.
///
/// With A = U Σ Vᵀ the linear part, it is V min(Σ, 1) Vᵀ: the target's own filter along directions that shrink, the source's
/// along directions that grow, and the identity where nothing shrinks.
fn footprint(target_from_source: &Affine, options: WarpOptions) -> Option<Matrix2<f64>> {
    if !options.antialias || options.filter == Filter::Nearest {
        return None;
    }
    let (a, b, c, d) = (target_from_source[(0, 0)], target_from_source[(0, 1)], target_from_source[(1, 0)], target_from_source[(1, 1)]);
    // AᵀA = V Σ² Vᵀ, of which the rotation V is in closed form.
    let (p, q, r) = (a * a + c * c, a * b + c * d, b * b + d * d);
    let (mean, half) = ((p + r) / 2.0, (p - r) / 2.0);
    let spread = libm::hypot(half, q);
    let major = libm::sqrt((mean + spread).max(0.0));
    let minor = ((a * d - b * c) / major).abs();
    let (large, small) = (filter_scale(major), filter_scale(minor));
    if small >= 1.0 {
        return None;
    }
    // V min(Σ,1) Vᵀ = average · I + difference · (AᵀA's traceless part, normalised).
    let (average, difference) = ((large + small) / 2.0, (large - small) / 2.0);
    let (cos, sin) = if spread > 0.0 { (half / spread, q / spread) } else { (1.0, 0.0) };
    Some(Matrix2::new(average + difference * cos, difference * sin, difference * sin, average - difference * cos))
}

/// The scale of the filter where the map scales by `scale`: 1 down to 0.9, `scale` below 0.7, in a straight line between.
fn filter_scale(scale: f64) -> f64 {
    let blend = ((scale - ANTIALIAS_FULL) / (ANTIALIAS_FROM - ANTIALIAS_FULL)).clamp(0.0, 1.0);
    if scale >= 1.0 { 1.0 } else { ANTIALIAS_FULL.min(scale) + blend * (1.0 - ANTIALIAS_FULL) }
}

/// The data window of the warped picture: every target pixel outside it is transparent (or, with [`Outside::Clamp`], beyond the
/// warped frame). Empty for an empty source or a singular map.
///
/// Errors: a map that is not finite, or a result with a side over [`LARGEST_SIDE`].
pub fn bounds(source: Window, target_from_source: &Affine, options: WarpOptions) -> Result<Window, WarpError> {
    if !target_from_source.iter().all(|v| v.is_finite()) {
        return Err(WarpError::NotFinite);
    }
    if source.is_empty() || usable_inverse(target_from_source).is_none() {
        return Ok(Window::default());
    }
    let window = match whole_translation(target_from_source, options) {
        Some([x, y]) => Window::new(source.x.saturating_add(x), source.y.saturating_add(y), source.width, source.height),
        None => mapped_bounds(source, target_from_source, options),
    };
    let side = window.width.max(window.height);
    if side > LARGEST_SIDE {
        return Err(WarpError::TooLarge { limit: LARGEST_SIDE, found: side });
    }
    Ok(window)
}

/// The pixels whose filter can reach the source.
fn mapped_bounds(source: Window, map: &Affine, options: WarpOptions) -> Window {
    let reach = match options.outside {
        Outside::Transparent => reach(map, options),
        Outside::Clamp => [0.0; 2],
    };
    let xs = [source.x as f64 - reach[0], source.right() as f64 + reach[0]];
    let ys = [source.y as f64 - reach[1], source.bottom() as f64 + reach[1]];
    let span = |row: usize| {
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| map[(row, 0)] * xs[i] + map[(row, 1)] * ys[j] + map[(row, 2)]);
        let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
        let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // The slack covers the rounding of the positions; a pixel too many is merely transparent.
        let slack = 1e-9 * (1.0 + low.abs().max(high.abs()) * 1e-3);
        match options.outside {
            // The pixels whose centres are within.
            Outside::Transparent => (libm::ceil(low - 0.5 - slack) as i64, libm::floor(high - 0.5 + slack) as i64 + 1),
            // The pixels that are touched.
            Outside::Clamp => (libm::floor(low + slack) as i64, libm::ceil(high - slack) as i64),
        }
    };
    let ((left, right), (top, bottom)) = (span(0), span(1));
    Window::from_bounds(left, top, right, bottom)
}

/// How far beyond the outermost pixels' edges the filter reaches, in source pixels.
fn reach(map: &Affine, options: WarpOptions) -> [f64; 2] {
    let radius = options.filter.radius();
    let widened = footprint(map, options).and_then(|shape| shape.try_inverse());
    match widened {
        Some(inverse) => {
            let extent = |row: usize| radius * (inverse[(row, 0)].abs() + inverse[(row, 1)].abs()) - 0.5;
            [extent(0), extent(1)]
        }
        None => [radius - 0.5; 2],
    }
}

/// `source` warped and laid over `background` in place; both have the same number of channels, the last of which is alpha.
///
/// The result is that of [`warp_affine`] followed by [`merge::over_in_place`], bit for bit, but the warped picture never leaves the cache.
/// Errors as [`warp_affine`].
pub fn warp_affine_over(
    source: Source<'_>,
    target_from_source: &Affine,
    options: WarpOptions,
    background: &mut [f32],
    window: Window,
) -> Result<(), WarpError> {
    let channels = source.raster.channels;
    let expected = window.samples(channels).unwrap_or(usize::MAX);
    if background.len() != expected {
        return Err(WarpError::Length { expected, found: background.len() });
    }
    if background.is_empty() {
        return check(target_from_source, &source.raster);
    }
    // A strip of half a megabyte stays in the cache, and is high enough for the tables of a strip to pay.
    let rows = (131_072 / (window.width * channels)).max(1);
    let mut layer = vec![0.0; rows * window.width * channels];
    for (i, part) in background.chunks_mut(rows * window.width * channels).enumerate() {
        let height = part.len() / (window.width * channels);
        let strip = Window::new(window.x, window.y + (i * rows) as i64, window.width, height);
        let layer = &mut layer[..part.len()];
        warp_affine(source, target_from_source, options, layer, strip)?;
        merge::over_in_place(layer, part, channels);
    }
    Ok(())
}

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
fn warp_points(source: Source<'_>, m: &Affine, options: WarpOptions, target: &mut [f32], window: Window) {
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

#[cfg(test)]
#[path = "warp_affine_tests.rs"]
mod tests;
