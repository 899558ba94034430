//! Point operations: grading, premultiplication, channel shuffles, cropping.

use super::warp_affine::Source;
use super::window::Window;

/// A grade in the order of Nuke's Grade node: black and white point, lift and gain, multiply, offset, gamma. One value a channel.
///
/// With m = multiply · (gain − lift) / (white point − black point) and o = offset + lift − m · black point, a value v becomes (m v + o)^(1/gamma).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grade {
    /// Value that becomes `lift`. Default 0.
    pub black_point: [f32; 4],
    /// Value that becomes `gain`. Default 1.
    pub white_point: [f32; 4],
    /// What black becomes. Default 0.
    pub lift: [f32; 4],
    /// What white becomes. Default 1.
    pub gain: [f32; 4],
    /// Factor. Default 1.
    pub multiply: [f32; 4],
    /// Added after the factor. Default 0.
    pub offset: [f32; 4],
    /// Exponent's inverse, above 0. Default 1. Negative values are left alone by it.
    pub gamma: [f32; 4],
    /// Whether results below 0 become 0. Default yes.
    pub clamp_black: bool,
    /// Whether results above 1 become 1. Default no.
    pub clamp_white: bool,
}

impl Default for Grade {
    fn default() -> Self {
        let (zero, one) = ([0.0; 4], [1.0; 4]);
        Self {
            black_point: zero,
            white_point: one,
            lift: zero,
            gain: one,
            multiply: one,
            offset: zero,
            gamma: one,
            clamp_black: true,
            clamp_white: false,
        }
    }
}

/// Why a point operation was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GradeError {
    /// Gamma is not positive.
    #[error("expected a gamma above 0, found {found}")]
    Gamma {
        /// Gamma given.
        found: f32,
    },
    /// The white point equals the black point.
    #[error("expected a white point apart from the black point, found both at {found}")]
    Points {
        /// Both points.
        found: f32,
    },
    /// A value is not finite.
    #[error("expected finite values, found NaN or infinity")]
    NotFinite,
    /// The channel does not exist.
    #[error("expected a channel below {channels}, found {found}")]
    Channel {
        /// Channels of the picture.
        channels: usize,
        /// Channel asked for.
        found: usize,
    },
    /// The slice has the wrong length.
    #[error("expected {expected} samples, found {found}")]
    Length {
        /// Samples expected.
        expected: usize,
        /// Samples given.
        found: usize,
    },
}

/// Grades the first `graded` channels (at most 4) of pixels of `channels` samples in place; usually the 3 colours of 4.
///
/// On premultiplied pictures with soft alpha, unpremultiply first. Errors: a gamma not above 0, equal points, values that are not finite.
/// Cost: O(samples); a power a sample where gamma is not 1.
pub fn grade(pixels: &mut [f32], channels: usize, graded: usize, settings: &Grade) -> Result<(), GradeError> {
    let n = graded.min(channels).min(4);
    let mut factor = [1.0_f32; 4];
    let mut offset = [0.0_f32; 4];
    for c in 0..n {
        (factor[c], offset[c]) = coefficients(settings, c)?;
    }
    if channels == 0 {
        return Ok(());
    }
    for pixel in pixels.chunks_exact_mut(channels) {
        for c in 0..n {
            let mut v = factor[c] * pixel[c] + offset[c];
            if settings.gamma[c] != 1.0 && v > 0.0 {
                v = libm::powf(v, 1.0 / settings.gamma[c]);
            }
            if settings.clamp_black && v < 0.0 {
                v = 0.0;
            }
            if settings.clamp_white && v > 1.0 {
                v = 1.0;
            }
            pixel[c] = v;
        }
    }
    Ok(())
}

/// Factor and offset of channel `c`.
fn coefficients(g: &Grade, c: usize) -> Result<(f32, f32), GradeError> {
    let values = [g.black_point[c], g.white_point[c], g.lift[c], g.gain[c], g.multiply[c], g.offset[c], g.gamma[c]];
    if !values.iter().all(|v| v.is_finite()) {
        return Err(GradeError::NotFinite);
    }
    if g.gamma[c] <= 0.0 {
        return Err(GradeError::Gamma { found: g.gamma[c] });
    }
    if g.white_point[c] == g.black_point[c] {
        return Err(GradeError::Points { found: g.black_point[c] });
    }
    let [black, white, lift, gain, multiply, offset, _] = values.map(f64::from);
    let factor = multiply * (gain - lift) / (white - black);
    Ok((factor as f32, (offset + multiply * lift - factor * black) as f32))
}

/// Multiplies the other channels by channel `alpha`.
pub fn premultiply(pixels: &mut [f32], channels: usize, alpha: usize) {
    if alpha >= channels {
        return;
    }
    for pixel in pixels.chunks_exact_mut(channels) {
        let a = pixel[alpha];
        for (c, v) in pixel.iter_mut().enumerate() {
            *v = if c == alpha { *v } else { *v * a };
        }
    }
}

/// Divides the other channels by channel `alpha`; pixels whose alpha is 0 are left alone.
///
/// A quotient is moved by up to two units in its last place, so that [`premultiply`] gives back the same bits wherever any number does.
pub fn unpremultiply(pixels: &mut [f32], channels: usize, alpha: usize) {
    if alpha >= channels {
        return;
    }
    for pixel in pixels.chunks_exact_mut(channels) {
        let a = pixel[alpha];
        if a == 0.0 || a == 1.0 || !a.is_finite() {
            continue;
        }
        for (c, v) in pixel.iter_mut().enumerate() {
            if c != alpha {
                *v = exact_quotient(*v, a);
            }
        }
    }
}

/// The q nearest to v / a with q a = v, or v / a rounded where there is none.
fn exact_quotient(v: f32, a: f32) -> f32 {
    let q = v / a;
    if q * a == v || !q.is_finite() {
        return q;
    }
    [q.next_up(), q.next_down()].into_iter().find(|t| t * a == v).unwrap_or(q)
}

/// Where a channel of a shuffle comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Channel {
    /// A channel of the source, from 0.
    From(usize),
    /// The same value everywhere.
    Value(f32),
}

/// Pixels of `picks.len()` channels, each picked from pixels of `channels`.
///
/// Errors: a channel that does not exist, a target of the wrong length.
pub fn shuffle(source: &[f32], channels: usize, picks: &[Channel], target: &mut [f32]) -> Result<(), GradeError> {
    for pick in picks {
        if let Channel::From(found) = *pick
            && found >= channels
        {
            return Err(GradeError::Channel { channels, found });
        }
    }
    let pixels = source.len() / channels.max(1);
    let expected = pixels.saturating_mul(picks.len());
    if target.len() != expected {
        return Err(GradeError::Length { expected, found: target.len() });
    }
    if expected == 0 {
        return Ok(());
    }
    for (i, out) in target.chunks_exact_mut(picks.len()).enumerate() {
        for (o, pick) in out.iter_mut().zip(picks) {
            *o = match *pick {
                Channel::From(c) => source[i * channels + c],
                Channel::Value(v) => v,
            };
        }
    }
    Ok(())
}

/// The samples of `source` in `window`, zero where it has none.
///
/// Errors: a target of the wrong length.
pub fn crop(source: Source<'_>, target: &mut [f32], window: Window) -> Result<(), GradeError> {
    let channels = source.raster.channels;
    let expected = window.samples(channels).unwrap_or(usize::MAX);
    if target.len() != expected {
        return Err(GradeError::Length { expected, found: target.len() });
    }
    target.fill(0.0);
    let common = window.intersect(&source.window());
    // A common part without columns may still have rows.
    let rows = if common.is_empty() { common.y..common.y } else { common.y..common.bottom() };
    for y in rows {
        let from = &source.raster.row((y - source.origin[1]) as usize)[(common.x - source.origin[0]) as usize * channels..];
        let at = ((y - window.y) as usize * window.width + (common.x - window.x) as usize) * channels;
        target[at..at + common.width * channels].copy_from_slice(&from[..common.width * channels]);
    }
    Ok(())
}

#[cfg(test)]
#[path = "grade_tests.rs"]
mod tests;
