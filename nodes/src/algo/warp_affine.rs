//! Pictures under an affine map.
//!
//! Every pixel of the target looks up its source position through the inverse map, and a filter reconstructs the picture there.
//! Any tiling of the target gives the same bits. Where the map shrinks, the filter's footprint is widened along the directions that shrink
//! (Heckbert, Fundamentals of Texture Mapping and Image Warping, 1989, section 3.5: reconstruction, then prefilter).

use super::merge;
use super::raster::{Affine, Raster, invert};
use super::warp_area;
use super::warp_points::warp_points;
use super::window::Window;
use nalgebra::Matrix2;

/// Maps whose inverse steps over more pixels than this are taken as singular.
pub(super) const LARGEST_STEP: f64 = 1099511627776.0;
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

#[cfg(test)]
#[path = "warp_affine_tests.rs"]
mod tests;
