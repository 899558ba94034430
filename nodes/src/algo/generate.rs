//! Pictures made from nothing: constants, checkerboards and gradients.

use super::window::Window;

/// Every pixel of `target` is `color`, of as many channels as it has values.
pub fn constant(color: &[f32], target: &mut [f32]) {
    if color.is_empty() {
        return;
    }
    for pixel in target.chunks_exact_mut(color.len()) {
        pixel.copy_from_slice(color);
    }
}

/// Squares of `size` = [width, height] pixels, `first` where their column and row numbers add up to an even number; the plane's origin is a corner.
///
/// Sizes below one pixel are taken as one. Nothing is written where the colours have different channels or `target` does not fit `window`.
pub fn checkerboard(first: &[f32], second: &[f32], size: [f64; 2], target: &mut [f32], window: Window) {
    let size = size.map(|s| if s >= 1.0 { s } else { 1.0 });
    fill(first.len(), target, window, |x, y, pixel| {
        let number = libm::floor(x / size[0]) + libm::floor(y / size[1]);
        let odd = number - 2.0 * libm::floor(number / 2.0) > 0.5;
        if first.len() == second.len() {
            pixel.copy_from_slice(if odd { second } else { first });
        }
    });
}

/// How a gradient goes from its first colour to its second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, pegbar_engine::Setting)]
pub enum Ramp {
    /// In proportion.
    #[default]
    Linear,
    /// 3t² − 2t³.
    Smooth,
}

impl Ramp {
    fn at(self, t: f64) -> f64 {
        let t = if t.is_nan() { 1.0 } else { t.clamp(0.0, 1.0) };
        match self {
            Self::Linear => t,
            Self::Smooth => t * t * (3.0 - 2.0 * t),
        }
    }
}

/// From `first` at the point `from` to `second` at the point `to` (pixels), constant across the line and beyond its ends.
///
/// Where the points coincide, all is `second`.
pub fn linear_gradient(first: &[f32], second: &[f32], from: [f64; 2], to: [f64; 2], ramp: Ramp, target: &mut [f32], window: Window) {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length_sq = dx * dx + dy * dy;
    fill(first.len(), target, window, |x, y, pixel| {
        let t = ((x - from[0]) * dx + (y - from[1]) * dy) / length_sq;
        blend(first, second, ramp.at(if length_sq > 0.0 { t } else { 1.0 }), pixel);
    });
}

/// From `first` at `centre` to `second` on the ellipse with half axes `radius` (pixels) and beyond.
pub fn radial_gradient(first: &[f32], second: &[f32], centre: [f64; 2], radius: [f64; 2], ramp: Ramp, target: &mut [f32], window: Window) {
    fill(first.len(), target, window, |x, y, pixel| {
        let t = libm::hypot((x - centre[0]) / radius[0], (y - centre[1]) / radius[1]);
        blend(first, second, ramp.at(t), pixel);
    });
}

fn blend(first: &[f32], second: &[f32], t: f64, pixel: &mut [f32]) {
    for ((o, a), b) in pixel.iter_mut().zip(first).zip(second) {
        *o = (f64::from(*a) + t * (f64::from(*b) - f64::from(*a))) as f32;
    }
}

/// Calls `paint` with the centre of each pixel.
fn fill(channels: usize, target: &mut [f32], window: Window, mut paint: impl FnMut(f64, f64, &mut [f32])) {
    if window.is_empty() || channels == 0 || window.samples(channels) != Some(target.len()) {
        return;
    }
    for (j, row) in target.chunks_exact_mut(window.width * channels).enumerate() {
        let y = window.y as f64 + j as f64 + 0.5;
        for (i, pixel) in row.chunks_exact_mut(channels).enumerate() {
            paint(window.x as f64 + i as f64 + 0.5, y, pixel);
        }
    }
}

#[cfg(test)]
#[path = "generate_tests.rs"]
mod tests;
