//! Blur and resampling.
//!
//! Everything here is one machine: a separable weighted sum, with a list of weights for each column and each row of the target.
//! Rows are filtered across first, into a ring just high enough for the sums down, so that the picture passes through memory once.

use super::warp_affine::{Filter, Outside, Source};
use super::window::Window;

/// Where a Gaussian ends, in standard deviations: what is cut off has a weight of 7e-6.
const GAUSSIAN_REACH: f64 = 4.5;
/// Above this standard deviation, in pixels, a Gaussian is computed on a coarser grid.
const COARSE_FROM: f64 = 4.0;
/// Largest standard deviation and half box width, in pixels.
pub const LARGEST_BLUR: f64 = 65536.0;

/// Why a picture could not be filtered.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// The size of the blur is no length.
    #[error("expected a blur from 0 to {LARGEST_BLUR} pixels, found {found}")]
    Size {
        /// Size given.
        found: f64,
    },
    /// The slice does not fit the window.
    #[error("expected {expected} samples for the window, found {found}")]
    Length {
        /// Samples that the window has.
        expected: usize,
        /// Samples given.
        found: usize,
    },
}

/// What [`resize`] filters with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ResizeFilter {
    /// Mean over the area of the target pixel; exact for whole-number ratios.
    Area,
    /// A reconstruction filter, widened where the picture shrinks.
    Kernel(Filter),
    /// Catmull-Rom, widened where the picture shrinks.
    #[default]
    CatmullRom,
}

/// Blurs with a Gaussian of standard deviation `sigma` = [x, y] pixels into `target`, which holds `window`; a sigma of 0 blurs nothing.
///
/// Up to 4 px the sampled Gaussian itself is used, cut at 4.5 sigma and normalised. Above, the blur is split into three Gaussians whose
/// variances add up: one onto a grid of every f-th sample, one on that grid, one back, with f = ⌊sigma / 2⌋. Gaussians as wide as the
/// grid's spacing alias by exp(−2π²) = 3e-9, so the result is the same to 2e-5 while the cost no longer grows with sigma.
///
/// Errors: a sigma that is negative, not a number or over [`LARGEST_BLUR`]; a target of the wrong length.
/// Cost: O(samples · min(sigma, 4)).
pub fn gaussian_blur(source: Source<'_>, sigma: [f64; 2], outside: Outside, target: &mut [f32], window: Window) -> Result<(), FilterError> {
    check(source, sigma, target.len(), window)?;
    let [offset_x, offset_y] = offsets(source, window);
    let across = gaussian_axis(offset_x, window.width, source.raster.width, sigma[0], outside);
    let down = gaussian_axis(offset_y, window.height, source.raster.height, sigma[1], outside);
    run_stages(source, &across, &down, target, window);
    Ok(())
}

/// How far a Gaussian blur of `sigma` reaches beyond the picture, in whole pixels.
pub fn gaussian_reach(sigma: f64) -> usize {
    // The coarse grid reaches a little further than the cut of a single Gaussian.
    if sigma > 0.0 && sigma <= LARGEST_BLUR { libm::ceil(GAUSSIAN_REACH * sigma) as usize } else { 0 }
}

/// Means over boxes of `size` = [width, height] pixels centred on each pixel; a size of 1 or less blurs nothing, fractions count in part.
///
/// Errors as [`gaussian_blur`]. Cost: O(samples · (width + height)).
pub fn box_blur(source: Source<'_>, size: [f64; 2], outside: Outside, target: &mut [f32], window: Window) -> Result<(), FilterError> {
    check(source, size, target.len(), window)?;
    let [offset_x, offset_y] = offsets(source, window);
    let axis = |offset: f64, n: usize, side: usize, size: f64| {
        let half = size.max(1.0) / 2.0;
        // Each sample is a square pixel, of which the box covers a part.
        let cover = move |d: f64| (half + 0.5 - d.abs()).clamp(0.0, 1.0);
        vec![Axis::new(n, side, outside, half + 0.5, |i| i as f64 + offset, cover)]
    };
    let across = axis(offset_x, window.width, source.raster.width, size[0]);
    let down = axis(offset_y, window.height, source.raster.height, size[1]);
    run_stages(source, &across, &down, target, window);
    Ok(())
}

/// Resamples the whole source to `width` by `height` pixels; edges are filtered against themselves (the weights inside are normalised).
///
/// The samples are premultiplied, so that colours of transparent pixels do not bleed. Errors: a target of the wrong length.
/// Cost: O((source + target) samples · radius).
pub fn resize(source: Source<'_>, filter: ResizeFilter, target: &mut [f32], width: usize, height: usize) -> Result<(), FilterError> {
    let window = Window::new(source.origin[0], source.origin[1], width, height);
    check(source, [0.0; 2], target.len(), window)?;
    let across = vec![resize_axis(width, source.raster.width, filter)];
    let down = vec![resize_axis(height, source.raster.height, filter)];
    run_stages(source, &across, &down, target, window);
    Ok(())
}

/// Sharpens: source + `amount` · (source − blurred), into `target`, which holds `window`.
///
/// Errors as [`gaussian_blur`].
pub fn unsharp(
    source: Source<'_>,
    sigma: f64,
    amount: f32,
    outside: Outside,
    target: &mut [f32],
    window: Window,
) -> Result<(), FilterError> {
    gaussian_blur(source, [sigma; 2], outside, target, window)?;
    let channels = source.raster.channels;
    let common = window.intersect(&source.window());
    target.iter_mut().for_each(|v| *v *= -amount);
    // A common part without columns may still have rows.
    let rows = if common.is_empty() { common.y..common.y } else { common.y..common.bottom() };
    for y in rows {
        let from = ((y - source.origin[1]) as usize, (common.x - source.origin[0]) as usize);
        let into = ((y - window.y) as usize, (common.x - window.x) as usize);
        let row = &source.raster.row(from.0)[from.1 * channels..][..common.width * channels];
        let out = &mut target[(into.0 * window.width + into.1) * channels..][..common.width * channels];
        for (o, s) in out.iter_mut().zip(row) {
            *o += s * (1.0 + amount);
        }
    }
    Ok(())
}

/// The Gaussian of standard deviation `sigma` px and its derivatives of `order` 0, 1 or 2, sampled at −r..=r with r = ⌈4.5 sigma⌉.
///
/// As convolution kernels these give exact results on polynomials of the order: order 0 sums to 1; order 1 turns the ramp x into 1;
/// order 2 turns a constant into 0 and x²/2 into 1. Empty where sigma is not above 0, is not finite, or the order is above 2.
pub fn gaussian_kernel(sigma: f64, order: u32) -> Vec<f64> {
    if !(sigma > 0.0 && sigma <= LARGEST_BLUR) || order > 2 {
        return Vec::new();
    }
    let r = libm::ceil(GAUSSIAN_REACH * sigma) as i64;
    let xs = move || (-r..=r).map(|i| i as f64);
    let gauss: Vec<f64> = xs().map(|x| gaussian(x, sigma)).collect();
    let total: f64 = gauss.iter().sum();
    let variance = xs().zip(&gauss).map(|(x, g)| x * x * g).sum::<f64>() / total;
    let fourth = xs().zip(&gauss).map(|(x, g)| x * x * x * x * g).sum::<f64>() / total;
    xs().zip(&gauss)
        .map(|(x, g)| match order {
            0 => g / total,
            // A convolution mirrors its kernel, hence the minus.
            1 => -x * g / (total * variance),
            // Solved so that its moments of order 0 and 2 are 0 and 2.
            _ => 2.0 * (x * x - variance) * g / (total * (fourth - variance * variance)),
        })
        .collect()
}

fn gaussian(x: f64, sigma: f64) -> f64 {
    libm::exp(-x * x / (2.0 * sigma * sigma))
}

fn check(source: Source<'_>, size: [f64; 2], len: usize, window: Window) -> Result<(), FilterError> {
    for found in size {
        if !(0.0..=LARGEST_BLUR).contains(&found) {
            return Err(FilterError::Size { found });
        }
    }
    let expected = window.samples(source.raster.channels).unwrap_or(usize::MAX);
    if len != expected {
        return Err(FilterError::Length { expected, found: len });
    }
    Ok(())
}

/// Of the target's first sample in the source's samples.
fn offsets(source: Source<'_>, window: Window) -> [f64; 2] {
    [window.x as f64 - source.origin[0] as f64, window.y as f64 - source.origin[1] as f64]
}

/// Weights for each sample of one axis of a target: `weights[starts[i]..starts[i + 1]]` apply to the samples from `first[i]` on.
#[derive(Debug)]
struct Axis {
    first: Vec<usize>,
    starts: Vec<usize>,
    weights: Vec<f32>,
}

impl Axis {
    /// `n` target samples, of which i is centred at `centre(i)` of `side` source samples and weighs them with `kernel(distance)` as far
    /// as `reach`; weights are normalised over all samples, inside or not.
    fn new(n: usize, side: usize, outside: Outside, reach: f64, centre: impl Fn(usize) -> f64, kernel: impl Fn(f64) -> f64) -> Self {
        let mut axis = Self { first: Vec::with_capacity(n), starts: vec![0], weights: Vec::new() };
        let last = side as f64 - 1.0;
        // Far out nothing changes any more; a whole number, as a narrow kernel may weigh nothing between samples.
        let far = libm::ceil(reach) + 1.0;
        let mut least = 0;
        for i in 0..n {
            let centre = match outside {
                Outside::Clamp => centre(i).clamp(-far, last + far),
                Outside::Transparent => centre(i),
            };
            let (low, high) = (libm::ceil(centre - reach), libm::floor(centre + reach));
            let hits = side > 0 && (outside == Outside::Clamp || (high >= 0.0 && low <= last));
            if hits {
                least = low.clamp(0.0, last) as usize;
                axis.push(centre, low, high, last, outside, &kernel);
            }
            axis.first.push(least);
            axis.starts.push(axis.weights.len());
        }
        axis
    }

    /// Appends the weights of one target sample.
    fn push(&mut self, centre: f64, low: f64, high: f64, last: f64, outside: Outside, kernel: &impl Fn(f64) -> f64) {
        let (from, to) = (low.clamp(0.0, last) as usize, high.clamp(0.0, last) as usize);
        let mut weights = vec![0.0; to + 1 - from];
        let mut total = 0.0;
        let mut at = low;
        while at <= high {
            let weight = kernel(at - centre);
            total += weight;
            let inside = at.clamp(0.0, last);
            if inside == at || outside == Outside::Clamp {
                weights[inside as usize - from] += weight;
            }
            at += 1.0;
        }
        let gain = if total != 0.0 { 1.0 / total } else { 0.0 };
        self.weights.extend(weights.iter().map(|w| (w * gain) as f32));
    }

    /// First sample and weights for target sample `i`.
    fn at(&self, i: usize) -> (usize, &[f32]) {
        (self.first[i], &self.weights[self.starts[i]..self.starts[i + 1]])
    }

    fn len(&self) -> usize {
        self.first.len()
    }

    /// The most weights that a target sample has.
    fn widest(&self) -> usize {
        self.starts.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(0)
    }
}

/// The stages of a Gaussian along one axis: one, or three by way of a coarse grid.
fn gaussian_axis(offset: f64, n: usize, side: usize, sigma: f64, outside: Outside) -> Vec<Axis> {
    let plain = |n: usize, side: usize, sigma: f64, outside: Outside, centre: &dyn Fn(usize) -> f64| {
        // A Gaussian far below a pixel is the sample itself.
        let sigma = sigma.max(1e-3);
        Axis::new(n, side, outside, (GAUSSIAN_REACH * sigma).max(0.5), centre, |d| gaussian(d, sigma))
    };
    if sigma <= COARSE_FROM {
        return vec![plain(n, side, sigma, outside, &|i| i as f64 + offset)];
    }
    let f = libm::floor(sigma / 2.0);
    let rest = libm::sqrt(sigma * sigma - 2.0 * f * f) / f;
    // The grid lies around the target, with room for the two Gaussians that follow; positions far from the source add nothing new.
    let margin = libm::ceil(GAUSSIAN_REACH * (rest + 1.0)) + 1.0;
    let low = offset - margin * f;
    let n_coarse = libm::ceil(n as f64 / f) as usize + 2 * margin as usize + 1;
    vec![
        plain(n_coarse, side, f, outside, &|i| low + i as f64 * f),
        plain(n_coarse, n_coarse, rest, Outside::Transparent, &|i| i as f64),
        plain(n, n_coarse, 1.0, Outside::Transparent, &|i| (i as f64 + offset - low) / f),
    ]
}

fn resize_axis(n: usize, side: usize, filter: ResizeFilter) -> Axis {
    let ratio = side as f64 / n.max(1) as f64;
    let stretch = ratio.max(1.0);
    let centre = |i: usize| (i as f64 + 0.5) * ratio - 0.5;
    let kernel = match filter {
        ResizeFilter::Area => {
            let half = ratio / 2.0;
            // The length that the target pixel and the source pixel share.
            let cover = |d: f64| ((d + 0.5).min(half) - (d - 0.5).max(-half)).max(0.0);
            return Axis::new(n, side, Outside::Transparent, half + 0.5, centre, cover).normalised();
        }
        ResizeFilter::Kernel(Filter::Nearest) => {
            return Axis::new(n, side, Outside::Clamp, 0.0, |i| libm::floor(centre(i) + 0.5), |_| 1.0);
        }
        ResizeFilter::Kernel(kernel) => kernel,
        ResizeFilter::CatmullRom => Filter::Cubic,
    };
    Axis::new(n, side, Outside::Transparent, kernel.radius() * stretch, centre, |d| kernel.at(d / stretch)).normalised()
}

impl Axis {
    /// With the weights that are inside scaled to a sum of one.
    fn normalised(mut self) -> Self {
        for w in self.starts.windows(2) {
            let part = &mut self.weights[w[0]..w[1]];
            let sum: f64 = part.iter().map(|&v| f64::from(v)).sum();
            if sum != 0.0 {
                part.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
            }
        }
        self
    }
}

/// Runs the stages of both axes, pairing them; the axis with fewer is done in its last pass.
fn run_stages(source: Source<'_>, across: &[Axis], down: &[Axis], target: &mut [f32], window: Window) {
    let channels = source.raster.channels;
    if target.is_empty() {
        return;
    }
    if source.window().is_empty() {
        return target.fill(0.0);
    }
    let mut picture: Option<(Vec<f32>, usize, usize)> = None;
    let count = across.len().max(down.len());
    for stage in 0..count {
        let (width, height) = picture.as_ref().map_or((source.raster.width, source.raster.height), |p| (p.1, p.2));
        let data = picture.as_ref().map_or(source.raster.data, |p| &p.0);
        // Shrinking stages come first, growing ones last; the shorter list joins at the end.
        let pick = |list: &'_ [Axis]| stage.checked_sub(count - list.len());
        let (ax, ay) = (pick(across).map(|i| &across[i]), pick(down).map(|i| &down[i]));
        let (w, h) = (ax.map_or(width, Axis::len), ay.map_or(height, Axis::len));
        let from = Picture { data, width, height, channels };
        if stage + 1 == count {
            debug_assert_eq!((w, h), (window.width, window.height));
            run(from, ax, ay, target);
        } else {
            let mut next = vec![0.0; w * h * channels];
            run(from, ax, ay, &mut next);
            picture = Some((next, w, h));
        }
    }
}

/// A picture on its way.
#[derive(Clone, Copy)]
struct Picture<'a> {
    data: &'a [f32],
    width: usize,
    height: usize,
    channels: usize,
}

/// One pass: across into a ring of rows, then down.
fn run(from: Picture<'_>, across: Option<&Axis>, down: Option<&Axis>, target: &mut [f32]) {
    let n = from.width * from.channels;
    let w = across.map_or(from.width, Axis::len) * from.channels;
    let row_across = |y: usize, out: &mut [f32]| {
        let row = &from.data[y * n..(y + 1) * n];
        match across {
            Some(axis) => sum_across(axis, row, from.channels, out),
            None => out.copy_from_slice(row),
        }
    };
    let Some(down) = down else {
        for (y, out) in target.chunks_exact_mut(w).enumerate().take(from.height) {
            row_across(y, out);
        }
        return;
    };
    let capacity = down.widest().max(1);
    let mut ring = vec![0.0; capacity * w];
    // Rows below `done` have been through the ring; the windows of successive target rows only move down.
    let mut done = 0;
    for (y, out) in target.chunks_exact_mut(w).enumerate() {
        let (first, weights) = down.at(y);
        done = done.max(first);
        while done < first + weights.len() {
            let slot = done % capacity;
            row_across(done, &mut ring[slot * w..(slot + 1) * w]);
            done += 1;
        }
        sum_down(&ring, capacity, first, weights, out);
    }
}

/// One row, each target pixel a weighted sum along it.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn sum_across(axis: &Axis, row: &[f32], channels: usize, out: &mut [f32]) {
    if channels == 4 {
        for (i, pixel) in out.chunks_exact_mut(4).enumerate() {
            let (first, weights) = axis.at(i);
            pixel.copy_from_slice(&sum4(&row[first * 4..][..weights.len() * 4], weights));
        }
        return;
    }
    for (i, pixel) in out.chunks_exact_mut(channels).enumerate() {
        let (first, weights) = axis.at(i);
        let taps = &row[first * channels..][..weights.len() * channels];
        for (c, value) in pixel.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (tap, w) in taps.chunks_exact(channels).zip(weights) {
                sum += tap[c] * w;
            }
            *value = sum;
        }
    }
}

/// The weighted sum of pixels of four channels, in four running sums of every fourth pixel.
#[inline(always)]
fn sum4(taps: &[f32], weights: &[f32]) -> [f32; 4] {
    let mut sums = [0.0_f32; 16];
    let mut fours = taps.chunks_exact(16);
    let mut four_weights = weights.chunks_exact(4);
    for (four, w) in (&mut fours).zip(&mut four_weights) {
        for k in 0..16 {
            sums[k] += four[k] * w[k / 4];
        }
    }
    for (k, (pixel, w)) in fours.remainder().chunks_exact(4).zip(four_weights.remainder()).enumerate() {
        for c in 0..4 {
            sums[(k % 4) * 4 + c] += pixel[c] * w;
        }
    }
    std::array::from_fn(|c| (sums[c] + sums[4 + c]) + (sums[8 + c] + sums[12 + c]))
}

/// Samples summed down at once.
const STRIP: usize = 64;

/// One target row as the weighted sum of the rows from `first` on, each at its place in the ring.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn sum_down(ring: &[f32], capacity: usize, first: usize, weights: &[f32], out: &mut [f32]) {
    let w = out.len();
    for (s, strip) in out.chunks_mut(STRIP).enumerate() {
        let from = s * STRIP;
        if strip.len() == STRIP {
            let mut sums = [0.0_f32; STRIP];
            for (k, weight) in weights.iter().enumerate() {
                let row = &ring[((first + k) % capacity) * w + from..][..STRIP];
                for i in 0..STRIP {
                    sums[i] += row[i] * weight;
                }
            }
            strip.copy_from_slice(&sums);
            continue;
        }
        for (i, value) in strip.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (k, weight) in weights.iter().enumerate() {
                sum += ring[((first + k) % capacity) * w + from + i] * weight;
            }
            *value = sum;
        }
    }
}

#[cfg(test)]
#[path = "filter_tests.rs"]
mod tests;
