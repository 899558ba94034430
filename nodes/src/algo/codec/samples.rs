//! Stored samples to linear, premultiplied light and back.

use std::borrow::Cow;

use super::curve::{Curve, Encoder, srgb_from_linear};
use super::threads::for_bands;
use super::{CodecError, ColorMode, Depth, Dither, EncodeOptions, NonFinite, Picture};

/// Samples as a file stores them.
pub(super) enum Stored {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

/// What the last channel is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Alpha {
    /// No alpha.
    None,
    /// Colours are not multiplied by it.
    Straight,
    /// Colours are multiplied by it, as stored (in codes, where there is a curve).
    Associated,
}

/// An interleaved picture as stored, with what its numbers mean.
pub(super) struct Coded {
    pub(super) stored: Stored,
    pub(super) width: usize,
    pub(super) channels: usize,
    pub(super) alpha: Alpha,
    pub(super) curve: Curve,
}

impl Coded {
    /// The samples as linear premultiplied light, or as plain numbers in `Data` mode.
    pub(super) fn into_pixels(mut self, color: ColorMode, threads: usize) -> Vec<f32> {
        match color {
            ColorMode::Auto => {}
            ColorMode::Srgb => self.curve = Curve::Srgb,
            ColorMode::Linear => self.curve = Curve::Linear,
            ColorMode::Data => {
                self.curve = Curve::Linear;
                self.alpha = Alpha::None;
            }
        }
        match std::mem::replace(&mut self.stored, Stored::U8(Vec::new())) {
            Stored::U8(codes) => self.decode_codes(&codes, 255, threads),
            Stored::U16(codes) => self.decode_codes(&codes, 65535, threads),
            Stored::F32(values) => self.decode_floats(values, threads),
        }
    }

    fn decode_codes<T: Copy + Into<usize> + Sync>(&self, codes: &[T], max: u16, threads: usize) -> Vec<f32> {
        let (table, linear) = (self.curve.table(max), Curve::Linear.table(max));
        let row = self.width * self.channels;
        let mut out = vec![0.0f32; codes.len()];
        for_bands(&mut out, row, threads, |first, out| {
            let codes = &codes[first * row..first * row + out.len()];
            match (self.alpha, self.channels) {
                (Alpha::None, _) => {
                    for (to, &code) in out.iter_mut().zip(codes) {
                        *to = table[code.into()];
                    }
                }
                (Alpha::Straight, 2) => straight::<2, T>(codes, out, &table, &linear),
                (Alpha::Straight, 4) => straight::<4, T>(codes, out, &table, &linear),
                _ => self.decode_any_alpha(codes, out, max),
            }
        });
        out
    }

    /// Colours that were multiplied as codes are divided as codes, made linear, and multiplied again.
    fn decode_any_alpha<T: Copy + Into<usize>>(&self, codes: &[T], out: &mut [f32], max: u16) {
        let scale = f64::from(max);
        for (to, from) in out.chunks_exact_mut(self.channels).zip(codes.chunks_exact(self.channels)) {
            let value = |code: T| {
                let code: usize = code.into();
                code as f64 / scale
            };
            let alpha = value(from[self.channels - 1]);
            for (to, &code) in to.iter_mut().zip(&from[..self.channels - 1]) {
                *to = self.associate(value(code), alpha) as f32;
            }
            to[self.channels - 1] = alpha as f32;
        }
    }

    fn associate(&self, value: f64, alpha: f64) -> f64 {
        let light = |v: f64| f64::from(self.curve.float_to_linear(v as f32));
        match self.alpha {
            Alpha::Straight => light(value) * alpha,
            Alpha::Associated if self.curve == Curve::Linear || alpha <= 0.0 => light(value),
            Alpha::Associated => light(value / alpha) * alpha,
            Alpha::None => light(value),
        }
    }

    fn decode_floats(&self, mut values: Vec<f32>, threads: usize) -> Vec<f32> {
        if self.curve == Curve::Linear && self.alpha != Alpha::Straight {
            return values;
        }
        let n = self.channels;
        for_bands(&mut values, self.width * n, threads, |_, values| {
            for pixel in values.chunks_exact_mut(n) {
                let colours = if self.alpha == Alpha::None { n } else { n - 1 };
                let alpha = if self.alpha == Alpha::None { 1.0 } else { f64::from(pixel[n - 1]) };
                for value in &mut pixel[..colours] {
                    *value = self.associate(f64::from(*value), alpha) as f32;
                }
            }
        });
        values
    }
}

fn straight<const N: usize, T: Copy + Into<usize>>(codes: &[T], out: &mut [f32], table: &[f32], linear: &[f32]) {
    for (to, from) in out.as_chunks_mut::<N>().0.iter_mut().zip(codes.as_chunks::<N>().0) {
        let alpha = linear[from[N - 1].into()];
        for i in 0..N - 1 {
            to[i] = table[from[i].into()] * alpha;
        }
        to[N - 1] = alpha;
    }
}

/// The channels of `picture` in the order in which integer formats store them, as indices; the last is alpha where there are 2 or 4.
///
/// Errors where the names are not exactly Y, Y A, R G B or R G B A in some order.
pub(super) fn usual_order(picture: &Picture, format: &'static str, with_alpha: bool) -> Result<Vec<usize>, CodecError> {
    let find = |name: &str| picture.channels.iter().position(|c| c == name);
    let orders: &[&[&str]] = &[&["Y"], &["R", "G", "B"], &["Y", "A"], &["R", "G", "B", "A"]];
    let orders = if with_alpha { orders } else { &orders[..2] };
    for order in orders {
        let found: Vec<usize> = order.iter().filter_map(|name| find(name)).collect();
        if found.len() == order.len() && found.len() == picture.channels.len() {
            return Ok(found);
        }
    }
    // A single channel of any name is a grey picture: a matte or a depth has no other place to go.
    if picture.channels.len() == 1 {
        return Ok(vec![0]);
    }
    let choices =
        if with_alpha { "one channel, Y A, R G B or R G B A" } else { "one channel or R G B: drop the alpha, or write png, tiff or exr" };
    Err(CodecError::Combination { format, found: format!("the channels {}", picture.channels.join(" ")), choices: choices.into() })
}

/// The picture's samples as codes from 0 to 255, in the given channel order.
pub(super) fn to_u8(picture: &Picture, order: &[usize], options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    check_finite(picture, options)?;
    if options.dither == Dither::None {
        return Ok(to_codes(picture, order, options, 255, |_, _, code| code as u8));
    }
    // 65535 = 255 * 257, so codes of 16 bits that came from 8 are multiples of 257 and no threshold below 257 moves them.
    Ok(to_codes(picture, order, options, 65535, |x, y, code| ((u32::from(code) + bayer_threshold(x, y)) / 257) as u8))
}

/// The picture's samples as codes from 0 to 65535, in the given channel order.
pub(super) fn to_u16(picture: &Picture, order: &[usize], options: &EncodeOptions) -> Result<Vec<u16>, CodecError> {
    check_finite(picture, options)?;
    Ok(to_codes(picture, order, options, 65535, |_, _, code| code))
}

/// A threshold from 2 to 255 out of the 8 by 8 Bayer matrix (Bayer 1973), spread evenly over the 257 steps between two 8-bit codes.
fn bayer_threshold(x: usize, y: usize) -> u32 {
    let mut rank = 0;
    for bit in 0..3 {
        let (bx, by) = ((x >> bit) & 1, (y >> bit) & 1);
        rank |= ((bx ^ by) << 1 | by) << (2 * (2 - bit));
    }
    (rank as u32 * 257 + 128) / 64
}

fn to_codes<T: Copy + Default + Send>(
    picture: &Picture,
    order: &[usize],
    options: &EncodeOptions,
    max: u16,
    finish: impl Fn(usize, usize, u16) -> T + Sync,
) -> Vec<T> {
    let n = order.len();
    let linear = matches!(options.color, ColorMode::Linear | ColorMode::Data);
    let encoder = if linear { Encoder::linear(max) } else { Encoder::srgb(max) };
    let alpha_encoder = Encoder::linear(max);
    let divides = n.is_multiple_of(2) && options.color != ColorMode::Data;
    let row = picture.width * n;
    let mut out = vec![T::default(); picture.height * row];
    let conversion = Conversion { encoder, alpha_encoder, divides, order, finish };
    for_bands(&mut out, row, options.threads, |first, out| {
        for (y, to) in out.chunks_exact_mut(row).enumerate() {
            let from = &picture.pixels[(first + y) * row..(first + y + 1) * row];
            match n {
                2 => conversion.row_with_alpha::<2, T>(from, to, first + y),
                4 => conversion.row_with_alpha::<4, T>(from, to, first + y),
                _ => conversion.row(from, to, first + y),
            }
        }
    });
    out
}

/// How the samples of a picture become codes.
struct Conversion<'a, F> {
    encoder: &'static Encoder,
    alpha_encoder: &'static Encoder,
    divides: bool,
    order: &'a [usize],
    finish: F,
}

impl<F> Conversion<'_, F> {
    fn row_with_alpha<const N: usize, T>(&self, from: &[f32], to: &mut [T], y: usize)
    where
        F: Fn(usize, usize, u16) -> T,
    {
        let order: [usize; N] = std::array::from_fn(|c| self.order[c] % N);
        for (x, (to, from)) in to.as_chunks_mut::<N>().0.iter_mut().zip(from.as_chunks::<N>().0).enumerate() {
            let alpha = from[order[N - 1]];
            for c in 0..N - 1 {
                let value = from[order[c]];
                let value = if self.divides { unpremultiply(value, alpha) } else { value };
                to[c] = (self.finish)(x, y, self.encoder.code(value));
            }
            to[N - 1] = (self.finish)(x, y, self.alpha_encoder.code(alpha));
        }
    }

    fn row<T>(&self, from: &[f32], to: &mut [T], y: usize)
    where
        F: Fn(usize, usize, u16) -> T,
    {
        let n = self.order.len();
        for (x, (to, from)) in to.chunks_exact_mut(n).zip(from.chunks_exact(n)).enumerate() {
            for (to, c) in to.iter_mut().zip(self.order) {
                *to = (self.finish)(x, y, self.encoder.code(from[*c]));
            }
        }
    }
}

/// The bytes of 16-bit codes.
pub(super) fn bytes_of_u16(codes: &[u16], bytes: impl Fn(u16) -> [u8; 2]) -> Vec<u8> {
    let mut out = vec![0u8; codes.len() * 2];
    for (to, code) in out.as_chunks_mut::<2>().0.iter_mut().zip(codes) {
        *to = bytes(*code);
    }
    out
}

/// The colour under an alpha of nought or less is nought: nothing of it could be seen, and reading would lose it.
#[inline]
pub(super) fn unpremultiply(value: f32, alpha: f32) -> f32 {
    if alpha >= 1.0 {
        value
    } else if alpha > 0.0 {
        value / alpha
    } else {
        0.0
    }
}

fn check_finite(picture: &Picture, options: &EncodeOptions) -> Result<(), CodecError> {
    if options.non_finite == NonFinite::Clamp {
        return Ok(());
    }
    let Some(at) = picture.pixels.iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let (pixel, c) = (at / picture.channels.len(), at % picture.channels.len());
    let channel = picture.channels[c].clone();
    Err(CodecError::NotFinite { value: picture.pixels[at], channel, x: pixel % picture.width, y: pixel / picture.width })
}

/// The samples for a float file: as they are, but in sRGB mode with the curve laid on (colours divided by alpha and multiplied again).
pub(super) fn to_floats<'a>(picture: &'a Picture, options: &EncodeOptions) -> Cow<'a, [f32]> {
    if options.color != ColorMode::Srgb {
        return Cow::Borrowed(&picture.pixels);
    }
    let n = picture.channels.len();
    let alpha_at = picture.channels.iter().position(|c| c == "A");
    let mut out = picture.pixels.clone();
    for pixel in out.chunks_exact_mut(n) {
        let alpha = alpha_at.map_or(1.0, |at| pixel[at]);
        for (_, value) in pixel.iter_mut().enumerate().filter(|(c, _)| Some(*c) != alpha_at) {
            let straight = if alpha > 0.0 { *value / alpha } else { *value };
            let code = srgb_from_linear(f64::from(straight)) as f32;
            *value = if alpha > 0.0 { code * alpha } else { code };
        }
    }
    Cow::Owned(out)
}

/// The depth name of integers, for formats of both.
pub(super) fn depth_of_bits(bits: u8) -> Depth {
    if bits > 8 { Depth::U16 } else { Depth::U8 }
}
