//! Film grain: noise on the display's scale, new in every film frame.

use super::noise::{bell, hash2};
use crate::algo::color::{linear_from_srgb, srgb_from_linear};

/// The transfer curve as straight pieces, fine enough that grain cannot tell.
const PIECES: usize = 4096;
/// The display range that the inverse table covers.
const LOW: f64 = -0.25;
const HIGH: f64 = 1.5;

/// Adds grain of `sigma` / 255 display units to the colours of an RGBA picture in linear light; two thirds of its variance is shared by the
/// three channels, as in a projected print. Alpha stays. Nothing happens where `sigma` is 0. Cost: O(pixels).
pub(crate) fn add_grain(image: &mut [f32], width: usize, sigma: f64, seed: u64, frame: u64) {
    if sigma == 0.0 || width == 0 {
        return;
    }
    let display = table(0.0, 1.2, |root| srgb_from_linear(root * root));
    let light = table(LOW, HIGH, signed_linear);
    let (shared, own) = ((2.0f64 / 3.0).sqrt() * sigma / 255.0, (1.0f64 / 3.0).sqrt() * sigma / 255.0);
    for (k, pixel) in image.chunks_exact_mut(4).enumerate() {
        let hash = hash2((k % width) as i64, (k / width) as i64, seed ^ frame.wrapping_mul(0x2545_f491_4f6c_dd1d));
        let common = shared * bell(hash);
        for (c, v) in pixel[..3].iter_mut().enumerate() {
            let noise = common + own * bell(super::noise::mix(hash ^ (c as u64 + 1)));
            let value = lookup(&display, 0.0, 1.2, f64::from(v.max(0.0)).sqrt());
            *v = lookup(&light, LOW, HIGH, value + noise) as f32;
        }
    }
}

/// The curve continued below zero by its own mirror image, so that grain in black is not cut off.
fn signed_linear(v: f64) -> f64 {
    if v < 0.0 { -linear_from_srgb(-v) } else { linear_from_srgb(v) }
}

fn table(low: f64, high: f64, curve: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..=PIECES).map(|k| curve(low + (high - low) * k as f64 / PIECES as f64)).collect()
}

fn lookup(table: &[f64], low: f64, high: f64, v: f64) -> f64 {
    let t = ((v - low) / (high - low) * PIECES as f64).clamp(0.0, PIECES as f64);
    let i = (t as usize).min(PIECES - 1);
    table[i] + (table[i + 1] - table[i]) * (t - i as f64)
}
