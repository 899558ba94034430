//! The vectorised passes over whole pictures: colours to coordinates, coordinates to posteriors, posteriors to log odds.
//!
//! Only additions, multiplications, divisions, roots and integer operations, in an order that the source fixes: the same bits whatever the vector width.

use super::gaussian::Gaussian;
use super::{Model, Space};
use crate::algo::color;
use crate::algo::raster::Raster;

/// Pixels worked on at a time, so that the coordinates stay in the first-level cache.
const BLOCK: usize = 256;
/// The largest log odds that a single pixel may hold against its neighbours.
const MAX_LOG_ODDS: f32 = 8.0;

/// 2 to the power `t` for |t| up to 126, relative error below 3·10⁻⁷.
#[inline(always)]
pub(super) fn exp2_f32(t: f32) -> f32 {
    // Adding 1.5·2²³ leaves the rounded integer in the low bits.
    const MAGIC: f32 = 12_582_912.0;
    let t = t.clamp(-126.0, 126.0);
    let shifted = t + MAGIC;
    let f = t - (shifted - MAGIC);
    let p = 1.54e-4_f32;
    let p = p * f + 1.333_355_8e-3;
    let p = p * f + 9.618_129e-3;
    let p = p * f + 5.550_411e-2;
    let p = p * f + 0.240_226_5;
    let p = p * f + std::f32::consts::LN_2;
    let p = p * f + 1.0;
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3f80_0000))
}

/// Natural logarithm of a positive normal number, absolute error below 10⁻⁶.
#[inline(always)]
fn ln_f32(x: f32) -> f32 {
    // The mantissa is taken between √½ and √2, where the series of artanh converges fastest.
    let bits = x.to_bits().wrapping_sub(0x3f35_04f3);
    let exponent = (bits as i32 >> 23) as f32;
    let m = f32::from_bits((bits & 0x007f_ffff).wrapping_add(0x3f35_04f3));
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = 2.0 * s * (1.0 + s2 * (1.0 / 3.0 + s2 * (0.2 + s2 * (1.0 / 7.0))));
    exponent * std::f32::consts::LN_2 + series
}

/// 1 / (1 + e⁻ˣ).
#[inline(always)]
pub(super) fn sigmoid_f32(x: f32) -> f32 {
    1.0 / (1.0 + exp2_f32(x * -std::f32::consts::LOG2_E))
}

/// The coordinates of every pixel, one plane each.
pub(super) struct Planes {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) z: Vec<f32>,
}

/// Linear RGB of a pixel; NaN and negative light are taken as black, absurd light is limited.
#[inline(always)]
pub(super) fn clean_rgb(pixel: &[f32]) -> [f32; 3] {
    let clean = |v: f32| if v > 0.0 { v.min(64.0) } else { 0.0 };
    match pixel {
        [r, g, b, ..] => [clean(*r), clean(*g), clean(*b)],
        [v, ..] => [clean(*v); 3],
        [] => [0.0; 3],
    }
}

/// Coordinates of one colour in units of about one just noticeable difference (hence the 100 for spaces that run from 0 to 1).
#[inline(always)]
pub(super) fn coordinates(space: Space, rgb: [f32; 3]) -> [f32; 3] {
    match space {
        Space::Lab => color::lab_from_rgb_f32(rgb),
        Space::Oklab => color::oklab_from_rgb_f32(rgb).map(|v| v * 100.0),
        Space::Display => rgb.map(|v| color::srgb_from_linear_f32(v) * 100.0),
        Space::Linear => rgb.map(|v| v * 100.0),
    }
}

/// The coordinates of every pixel of `image`. O(pixels).
pub(super) fn planes(image: Raster<'_>, space: Space) -> Planes {
    let n = image.width * image.height;
    let mut out = Planes { x: vec![0.0; n], y: vec![0.0; n], z: vec![0.0; n] };
    let blocks = out.x.chunks_mut(BLOCK).zip(out.y.chunks_mut(BLOCK)).zip(out.z.chunks_mut(BLOCK));
    for (((x, y), z), pixels) in blocks.zip(image.data.chunks(BLOCK * image.channels)) {
        split_channels(pixels, image.channels, x, y, z);
        convert(space, x, y, z);
    }
    out
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn split_channels(pixels: &[f32], channels: usize, x: &mut [f32], y: &mut [f32], z: &mut [f32]) {
    // A constant stride lets the compiler shuffle instead of gather.
    match channels {
        3 => split_constant::<3>(pixels, x, y, z),
        4 => split_constant::<4>(pixels, x, y, z),
        _ => {
            for (((x, y), z), pixel) in x.iter_mut().zip(y).zip(z).zip(pixels.chunks_exact(channels)) {
                [*x, *y, *z] = clean_rgb(pixel);
            }
        }
    }
}

#[inline(always)]
fn split_constant<const C: usize>(pixels: &[f32], x: &mut [f32], y: &mut [f32], z: &mut [f32]) {
    for (((x, y), z), pixel) in x.iter_mut().zip(y).zip(z).zip(pixels.as_chunks::<C>().0) {
        [*x, *y, *z] = clean_rgb(pixel);
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn convert(space: Space, x: &mut [f32], y: &mut [f32], z: &mut [f32]) {
    // The space is a constant in each loop, which is what lets it vectorise.
    match space {
        Space::Lab => convert_with(|c| coordinates(Space::Lab, c), x, y, z),
        Space::Oklab => convert_with(|c| coordinates(Space::Oklab, c), x, y, z),
        Space::Display => convert_with(|c| coordinates(Space::Display, c), x, y, z),
        Space::Linear => convert_with(|c| coordinates(Space::Linear, c), x, y, z),
    }
}

#[inline(always)]
fn convert_with(f: impl Fn([f32; 3]) -> [f32; 3], x: &mut [f32], y: &mut [f32], z: &mut [f32]) {
    for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
        [*x, *y, *z] = f([*x, *y, *z]);
    }
}

/// A component made ready for [`accumulate`]: its weighted density is 2^(offset − |rows (x − mean)|²).
#[derive(Clone, Copy)]
pub(super) struct Packed {
    mean: [f32; 3],
    rows: [f32; 6],
    offset: f32,
}

/// Components ready for evaluation, the side's share of all pixels in their weights. Those without weight or with a singular covariance are left out.
pub(super) fn pack(side: &[Gaussian], share: f64) -> Vec<Packed> {
    let scale = libm::sqrt(0.5 * std::f64::consts::LOG2_E);
    let pack_one = |g: &Gaussian| {
        let w = g.whitening()?;
        let offset = (libm::log(g.weight * share) + w.log_norm) * std::f64::consts::LOG2_E;
        offset.is_finite().then(|| Packed {
            mean: w.mean.map(|v| v as f32),
            rows: w.rows.map(|v| (v * scale) as f32),
            offset: offset as f32,
        })
    };
    side.iter().filter_map(pack_one).collect()
}

#[inline(always)]
fn accumulate(c: &Packed, x: &[f32], y: &[f32], z: &[f32], sum: &mut [f32]) {
    let (m, r) = (c.mean, c.rows);
    for (((s, &x), &y), &z) in sum.iter_mut().zip(x).zip(y).zip(z) {
        let d = [x - m[0], y - m[1], z - m[2]];
        let a = r[0] * d[0];
        let b = r[1] * d[0] + r[2] * d[1];
        let e = r[3] * d[0] + r[4] * d[1] + r[5] * d[2];
        *s += exp2_f32(c.offset - (a * a + b * b + e * e));
    }
}

/// The three mixtures made ready, and the floors that colours unlike all of them fall back on.
pub(super) struct PackedModel {
    sides: [Vec<Packed>; 3],
    floors: [f32; 3],
}

impl PackedModel {
    pub(super) fn new(model: &Model) -> Self {
        let floors = model.floors().map(|v| v as f32);
        let shares = model.shares();
        Self { sides: [pack(&model.foreground, shares[0]), pack(&model.background, shares[1]), pack(&model.ink, shares[2])], floors }
    }
}

/// Posterior probability of the layer into `layer`; that of ink (empty for a model without it), and the sum over pixels of the log likelihood.
///
/// O(pixels × components).
pub(super) fn posterior(planes: &Planes, model: &PackedModel, layer: &mut [f32]) -> (Vec<f32>, f64) {
    let n = planes.x.len();
    let mut ink = vec![0.0; if model.sides[2].is_empty() { 0 } else { n }];
    let mut log_likelihood = 0.0;
    for start in (0..n).step_by(BLOCK) {
        let range = start..(start + BLOCK).min(n);
        let ink_block = if ink.is_empty() { &mut [][..] } else { &mut ink[range.clone()] };
        let (x, y, z) = (&planes.x[range.clone()], &planes.y[range.clone()], &planes.z[range.clone()]);
        log_likelihood += f64::from(posterior_block(model, x, y, z, &mut layer[range], ink_block));
    }
    (ink, log_likelihood)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn posterior_block(model: &PackedModel, x: &[f32], y: &[f32], z: &[f32], layer: &mut [f32], ink: &mut [f32]) -> f32 {
    let mut sums = [[0.0f32; BLOCK]; 3];
    for ((sum, side), floor) in sums.iter_mut().zip(&model.sides).zip(model.floors) {
        sum.fill(floor);
        for c in side {
            accumulate(c, x, y, z, sum);
        }
    }
    let [fg, bg, ik] = &mut sums;
    for ((i, total), f) in ik.iter_mut().zip(bg.iter_mut()).zip(fg.iter_mut()) {
        *total += *i + *f;
        let inverse = 1.0 / *total;
        *f *= inverse;
        *i *= inverse;
    }
    layer.copy_from_slice(&fg[..layer.len()]);
    ink.copy_from_slice(&ik[..ink.len()]);
    // Sixteen sums side by side, added in a fixed order.
    let mut lanes = [0.0f32; 16];
    for chunk in bg[..layer.len()].chunks(16) {
        for (l, t) in lanes.iter_mut().zip(chunk) {
            *l += ln_f32(*t);
        }
    }
    lanes.iter().sum()
}

/// Log odds of probabilities in place, limited so that a few neighbours can outvote a pixel.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
pub(super) fn log_odds(values: &mut [f32]) {
    for v in values {
        let p = v.clamp(1e-6, 1.0 - 1e-6);
        *v = ln_f32(p / (1.0 - p)).clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS);
    }
}

/// Means of the samples and of the smaller of each and its complement.
pub(super) fn mean_and_ambiguity(values: &[f32]) -> (f64, f64) {
    let (mut sum, mut doubt) = (0.0f64, 0.0f64);
    for block in values.chunks(BLOCK) {
        let [s, d] = block_sums(block);
        sum += f64::from(s);
        doubt += f64::from(d);
    }
    let n = values.len().max(1) as f64;
    (sum / n, doubt / n)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn block_sums(values: &[f32]) -> [f32; 2] {
    // Sixteen sums side by side, added in a fixed order.
    let mut lanes = [[0.0f32; 16]; 2];
    for chunk in values.chunks(16) {
        for (i, v) in chunk.iter().enumerate() {
            lanes[0][i] += v;
            lanes[1][i] += v.min(1.0 - v);
        }
    }
    lanes.map(|l| l.iter().sum())
}

/// Stretches probabilities so that `low` becomes 0 and `high` 1.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
pub(super) fn clip(values: &mut [f32], low: f32, high: f32) {
    let scale = 1.0 / (high - low).max(1e-6);
    for v in values {
        *v = ((*v - low) * scale).clamp(0.0, 1.0);
    }
}
