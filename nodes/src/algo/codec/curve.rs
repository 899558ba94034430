//! Transfer curves between codes and linear light, exact by tables.
//!
//! **Source**: IEC 61966-2-1:1999, section 5.2 (sRGB). Codes are decoded by the formula in `f64`; encoding is by thresholds: the table holds for
//! each code the least `f32` whose formula rounds to it, so that encoding is that formula's rounding for every `f32`.

use std::sync::LazyLock;

pub(super) use crate::algo::color::{linear_from_srgb, srgb_from_linear};

/// How codes in a file stand for light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Curve {
    /// IEC 61966-2-1.
    Srgb,
    /// Codes are light.
    Linear,
    /// code = light to this power (the PNG `gAMA` value), more than 0.
    Gamma(f64),
}

impl Curve {
    fn to_linear(self, v: f64) -> f64 {
        match self {
            Curve::Srgb => linear_from_srgb(v),
            Curve::Linear => v,
            Curve::Gamma(gamma) => libm::pow(v, 1.0 / gamma),
        }
    }

    /// A float sample of a file as linear light.
    pub(super) fn float_to_linear(self, v: f32) -> f32 {
        match self {
            Curve::Linear => v,
            _ => self.to_linear(f64::from(v)) as f32,
        }
    }

    /// The light of each code from 0 to `max`: `max + 1` entries.
    pub(super) fn table(self, max: u16) -> std::borrow::Cow<'static, [f32]> {
        static SRGB_8: LazyLock<Vec<f32>> = LazyLock::new(|| Curve::Srgb.compute(255));
        static SRGB_16: LazyLock<Vec<f32>> = LazyLock::new(|| Curve::Srgb.compute(65535));
        static LINEAR_8: LazyLock<Vec<f32>> = LazyLock::new(|| Curve::Linear.compute(255));
        static LINEAR_16: LazyLock<Vec<f32>> = LazyLock::new(|| Curve::Linear.compute(65535));
        match (self, max) {
            (Curve::Srgb, 255) => SRGB_8.as_slice().into(),
            (Curve::Srgb, 65535) => SRGB_16.as_slice().into(),
            (Curve::Linear, 255) => LINEAR_8.as_slice().into(),
            (Curve::Linear, 65535) => LINEAR_16.as_slice().into(),
            _ => self.compute(max).into(),
        }
    }

    fn compute(self, max: u16) -> Vec<f32> {
        (0..=max).map(|code| self.to_linear(f64::from(code) / f64::from(max)) as f32).collect()
    }
}

/// Encodes linear light as the nearest code of a curve, in a few operations a sample.
///
/// A float's exponent and upper mantissa bits name a bucket; the table gives the code at the bucket's start, and the thresholds say how many
/// further codes the sample has passed. Values below 0 and NaN give 0, values above 1 the largest code.
pub(super) struct Encoder {
    /// `thresholds[k]` is the least `f32` whose code is `k`; a last entry of infinity ends every search.
    thresholds: Vec<f32>,
    /// The code of the least value of each bucket.
    start: Vec<u16>,
    max: u16,
}

/// Values below this are in bucket 0: 2⁻²², where even 16-bit codes are nought.
const LOWEST: u32 = (127 - 22) << 23;
/// The bits of 1.0.
const ONE: u32 = 127 << 23;
/// Mantissa bits that are not part of a bucket's name: 1024 buckets an octave.
const SHIFT: u32 = 23 - 10;

impl Encoder {
    /// sRGB codes from 0 to `max`, 255 or 65535.
    pub(super) fn srgb(max: u16) -> &'static Encoder {
        static SRGB_8: LazyLock<Encoder> = LazyLock::new(|| Encoder::build(255, srgb_from_linear, linear_from_srgb));
        static SRGB_16: LazyLock<Encoder> = LazyLock::new(|| Encoder::build(65535, srgb_from_linear, linear_from_srgb));
        if max == 255 { &SRGB_8 } else { &SRGB_16 }
    }

    /// Codes proportional to the value, from 0 to `max`, 255 or 65535.
    pub(super) fn linear(max: u16) -> &'static Encoder {
        static LINEAR_8: LazyLock<Encoder> = LazyLock::new(|| Encoder::build(255, |v| v, |v| v));
        static LINEAR_16: LazyLock<Encoder> = LazyLock::new(|| Encoder::build(65535, |v| v, |v| v));
        if max == 255 { &LINEAR_8 } else { &LINEAR_16 }
    }

    fn build(max: u16, forward: fn(f64) -> f64, inverse: fn(f64) -> f64) -> Encoder {
        let scale = f64::from(max);
        let code = |v: f32| libm::floor(forward(f64::from(v)) * scale + 0.5);
        let mut thresholds = vec![0.0f32];
        for k in 1..=max {
            let wanted = f64::from(k);
            let mut v = inverse((wanted - 0.5) / scale) as f32;
            while code(v) >= wanted {
                v = v.next_down();
            }
            while code(v) < wanted {
                v = v.next_up();
            }
            thresholds.push(v);
        }
        thresholds.push(f32::INFINITY);
        let start = bucket_starts(&thresholds);
        Encoder { thresholds, start, max }
    }

    /// The nearest code of `v`.
    #[inline]
    pub(super) fn code(&self, v: f32) -> u16 {
        if v.is_nan() || v < f32::from_bits(LOWEST) {
            return 0;
        }
        if v >= 1.0 {
            return self.max;
        }
        let bucket = ((v.to_bits() - LOWEST) >> SHIFT) as usize;
        let mut code = usize::from(self.start[bucket]);
        while v >= self.thresholds[code + 1] {
            code += 1;
        }
        code as u16
    }
}

fn bucket_starts(thresholds: &[f32]) -> Vec<u16> {
    let mut code = 0;
    (0..=(ONE - LOWEST) >> SHIFT)
        .map(|bucket| {
            let least = f32::from_bits(LOWEST + (bucket << SHIFT));
            while least >= thresholds[code + 1] {
                code += 1;
            }
            code as u16
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_formula(v: f32, max: u16, curve: fn(f64) -> f64) -> u16 {
        let code = (curve(f64::from(v).clamp(0.0, 1.0)) * f64::from(max) + 0.5).floor();
        code as u16
    }

    #[test]
    fn encoder_rounds_as_the_formula_does_around_every_threshold() {
        for max in [255, 65535] {
            let srgb = Encoder::srgb(max);
            for k in 1..=usize::from(max) {
                let t = srgb.thresholds[k];
                for v in [t.next_down().next_down(), t.next_down(), t, t.next_up(), t.next_up().next_up()] {
                    assert_eq!(srgb.code(v), by_formula(v, max, srgb_from_linear), "{v} of {max}");
                }
            }
        }
    }

    #[test]
    fn encoder_rounds_as_the_formula_does_between_thresholds() {
        for max in [255, 65535] {
            let mut bits = 0u32;
            while bits <= ONE + 4_000_000 {
                let v = f32::from_bits(bits);
                assert_eq!(Encoder::srgb(max).code(v), by_formula(v, max, srgb_from_linear), "{v} of {max}");
                assert_eq!(Encoder::linear(max).code(v), by_formula(v, max, |v| v), "{v} of {max}");
                bits += 7_919;
            }
        }
    }

    #[test]
    fn every_code_survives_decoding_and_encoding() {
        for max in [255u16, 65535] {
            let (srgb, linear) = (Curve::Srgb.table(max), Curve::Linear.table(max));
            for code in 0..=max {
                assert_eq!(Encoder::srgb(max).code(srgb[usize::from(code)]), code);
                assert_eq!(Encoder::linear(max).code(linear[usize::from(code)]), code);
            }
        }
    }

    #[test]
    fn values_out_of_range_are_clamped_and_nan_is_nought() {
        for max in [255, 65535] {
            let e = Encoder::srgb(max);
            let found = [f32::NAN, -f32::NAN, -1.0, -0.0, f32::NEG_INFINITY, 1e-40, 1.0, 7.0, f32::INFINITY].map(|v| e.code(v));
            assert_eq!(found, [0, 0, 0, 0, 0, 0, max, max, max]);
        }
    }

    #[test]
    fn srgb_agrees_with_published_figures() {
        // The piecewise formula at a few codes, by hand from IEC 61966-2-1 to seven digits.
        let table = Curve::Srgb.table(255);
        for (code, light) in [(0, 0.0), (10, 0.003_035_27), (11, 0.003_346_54), (128, 0.215_860_5), (188, 0.502_886_5), (255, 1.0)] {
            assert!((table[code] - light).abs() < 2e-7, "{code}: {}", table[code]);
        }
    }
}
