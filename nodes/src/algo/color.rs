//! Colour: the sRGB transfer function both ways, CIE XYZ, L\*a\*b\* and Oklab.
//!
//! Linear RGB has the Rec. 709 primaries and the D65 white, 1.0 being diffuse white. The scalar functions on `f64` are the reference; those on `f32` and on slices are for
//! whole pictures, built only of operations that IEEE 754 rounds exactly, so that the bits are the same on every processor and vector width.
//!
//! **Source** IEC 61966-2-1:1999 (sRGB, with the constants that make the two pieces meet); CIE 15:2004 (L\*a\*b\*); B. Ottosson, *A perceptual color space for image
//! processing*, 2020 (Oklab).

use std::sync::LazyLock;

/// XYZ of the D65 white (CIE 15, 2° observer, Y = 1), as the sRGB matrix below maps (1, 1, 1).
pub const WHITE_D65: [f64; 3] = [0.950_455_927_051_671_7, 1.0, 1.089_057_750_759_878_4];

/// XYZ from linear RGB: Rec. 709 primaries with white (0.3127, 0.3290), in full precision.
pub const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [0.412_390_799_265_959_5, 0.357_584_339_383_877_96, 0.180_480_788_401_834_3],
    [0.212_639_005_871_510_36, 0.715_168_678_767_755_9, 0.072_192_315_360_733_71],
    [0.019_330_818_715_591_85, 0.119_194_779_794_625_99, 0.950_532_152_249_660_6],
];

/// Linear RGB from XYZ, the inverse of [`XYZ_FROM_RGB`].
pub const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.240_969_941_904_521_3, -1.537_383_177_570_093_5, -0.498_610_760_293_003_3],
    [-0.969_243_636_280_879_8, 1.875_967_501_507_720_6, 0.041_555_057_407_175_61],
    [0.055_630_079_696_993_61, -0.203_976_958_888_976_57, 1.056_971_514_242_878_6],
];

/// Where the linear toe of the encoding ends, in linear light.
const TOE_LINEAR: f64 = 0.003_130_668_442_500_634_6;
/// Where the linear toe of the encoding ends, in encoded values.
const TOE_ENCODED: f64 = TOE_LINEAR * 12.92;
/// Where the straight foot of the L\* curve ends, (6/29)³.
const LAB_FOOT: f64 = 216.0 / 24389.0;
/// The slope of the straight foot over 116, (29/6)² / 3.
const LAB_SLOPE: f64 = 841.0 / 108.0;

/// Linear light from an sRGB value; odd about zero, so that out-of-gamut values survive a round trip. NaN stays NaN.
pub fn linear_from_srgb(v: f64) -> f64 {
    let a = v.abs();
    let linear = if a <= TOE_ENCODED { a / 12.92 } else { libm::pow((a + 0.055) / 1.055, 2.4) };
    linear.copysign(v)
}

/// An sRGB value from linear light; the inverse of [`linear_from_srgb`].
pub fn srgb_from_linear(v: f64) -> f64 {
    let a = v.abs();
    let encoded = if a <= TOE_LINEAR { a * 12.92 } else { 1.055 * libm::pow(a, 1.0 / 2.4) - 0.055 };
    encoded.copysign(v)
}

/// Cube root of a positive normal `f32`, relative error below 3·10⁻⁷; vectorises. Zero and negative input give a tiny or meaningless number and never a panic.
///
/// The exponent is divided by three in integer arithmetic (after Kahan), then two steps of Halley's iteration triple the number of right bits each.
#[inline(always)]
pub fn cbrt_f32(x: f32) -> f32 {
    // Division of the bits by three, exact enough through `f32`: the guess needs five bits only.
    let guess = f32::from_bits(((x.to_bits() as i32 as f32) * (1.0 / 3.0)) as i32 as u32).to_bits().wrapping_add(709_921_077);
    let mut y = f32::from_bits(guess);
    for _ in 0..2 {
        let cube = y * y * y;
        y *= (cube + x + x) / (cube + cube + x);
    }
    y
}

/// Linear light from an sRGB value, `f32`, relative error below 8·10⁻⁷; vectorises.
///
/// v^2.4 = v² · (v²)^(1/5), the fifth root by Newton's iteration.
#[inline(always)]
pub fn linear_from_srgb_f32(v: f32) -> f32 {
    let a = v.abs();
    let t = (a + 0.055) * (1.0 / 1.055);
    let square = t * t;
    let curved = square * fifth_root(square);
    let straight = a * (1.0 / 12.92);
    let linear = if a <= TOE_ENCODED as f32 { straight } else { curved };
    linear.copysign(v)
}

/// An sRGB value from linear light, `f32`, absolute error below 8·10⁻⁷ up to 2; vectorises.
///
/// v^(5/12) = s · cbrt(s)² with s = v^(1/4).
#[inline(always)]
pub fn srgb_from_linear_f32(v: f32) -> f32 {
    let a = v.abs();
    let s = a.sqrt().sqrt();
    let root = cbrt_f32(s);
    let curved = 1.055 * (s * (root * root)) - 0.055;
    let straight = a * 12.92;
    let encoded = if a <= TOE_LINEAR as f32 { straight } else { curved };
    encoded.copysign(v)
}

/// Fifth root of a positive normal `f32`: the exponent over five, then three steps of Newton's iteration.
#[inline(always)]
fn fifth_root(x: f32) -> f32 {
    let guess = ((x.to_bits() as i32 as f32) * 0.2) as i32 as u32;
    // Four fifths of the bits of 1.0, less the shift that centres the error of the straight-line logarithm.
    let mut y = f32::from_bits(guess.wrapping_add(851_987_000));
    for _ in 0..3 {
        let y2 = y * y;
        y = 0.8 * y + 0.2 * x / (y2 * y2);
    }
    y
}

/// Linear light of each of the 256 codes of eight-bit sRGB, correctly rounded.
pub static LINEAR_FROM_SRGB_U8: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f64 / 255.0) as f32));

/// Linear light of each of the 65536 codes of sixteen-bit sRGB, correctly rounded.
pub static LINEAR_FROM_SRGB_U16: LazyLock<Box<[f32]>> =
    LazyLock::new(|| (0..=u16::MAX).map(|code| linear_from_srgb(f64::from(code) / 65535.0) as f32).collect());

/// Linear light from eight-bit sRGB codes, sample by sample, to the shorter of the two slices. O(n), a table look-up each.
pub fn linear_from_srgb_u8_slice(codes: &[u8], out: &mut [f32]) {
    let table = &*LINEAR_FROM_SRGB_U8;
    for (o, &c) in out.iter_mut().zip(codes) {
        *o = table[usize::from(c)];
    }
}

/// Linear light from sixteen-bit sRGB codes, sample by sample, to the shorter of the two slices. O(n), a table look-up each.
pub fn linear_from_srgb_u16_slice(codes: &[u16], out: &mut [f32]) {
    let table = &**LINEAR_FROM_SRGB_U16;
    for (o, &c) in out.iter_mut().zip(codes) {
        *o = table[usize::from(c)];
    }
}

/// Linear light from sRGB values in place. O(n).
pub fn linear_from_srgb_slice(values: &mut [f32]) {
    map_in_place(values, false);
}

/// sRGB values from linear light in place. O(n).
pub fn srgb_from_linear_slice(values: &mut [f32]) {
    map_in_place(values, true);
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn map_in_place(values: &mut [f32], encode: bool) {
    if encode {
        for v in values {
            *v = srgb_from_linear_f32(*v);
        }
    } else {
        for v in values {
            *v = linear_from_srgb_f32(*v);
        }
    }
}

/// How the bits of a positive `f32` choose a bucket: eight bits of exponent and the top seven of the mantissa.
const BUCKET_SHIFT: u32 = 16;
/// The first bucket, 2⁻¹³: what is smaller encodes to code 0.
const BUCKET_FIRST: u32 = (127 - 13) << 7;
/// Buckets from 2⁻¹³ to 1.
const BUCKETS: usize = 13 << 7;

/// The smallest linear values that round to each eight-bit code, and the code at the start of each bucket.
struct EncodeU8 {
    thresholds: [f32; 257],
    codes: [u8; BUCKETS],
}

static ENCODE_U8: LazyLock<EncodeU8> = LazyLock::new(|| {
    let mut thresholds = [f32::INFINITY; 257];
    for (code, t) in thresholds.iter_mut().enumerate().take(256) {
        *t = if code == 0 { 0.0 } else { round_up_f32(linear_from_srgb((code as f64 - 0.5) / 255.0)) };
    }
    let codes = std::array::from_fn(|bucket| {
        let start = f32::from_bits((BUCKET_FIRST + bucket as u32) << BUCKET_SHIFT);
        thresholds[1..256].iter().take_while(|t| **t <= start).count() as u8
    });
    EncodeU8 { thresholds, codes }
});

/// The smallest `f32` not below `v` (positive).
fn round_up_f32(v: f64) -> f32 {
    let near = v as f32;
    if f64::from(near) < v { f32::from_bits(near.to_bits() + 1) } else { near }
}

/// The eight-bit sRGB code nearest to a linear value, exactly: what rounding 255 times the exact curve gives. Below 0 and NaN give 0, above 1 gives 255.
pub fn srgb_u8_from_linear(v: f32) -> u8 {
    encode_u8(&ENCODE_U8, v)
}

#[inline(always)]
fn encode_u8(t: &EncodeU8, v: f32) -> u8 {
    if v >= 1.0 {
        return 255;
    }
    // Negative numbers and NaN fail the comparison; no bucket holds more than one threshold, which a test walks through.
    if v > f32::from_bits(BUCKET_FIRST << BUCKET_SHIFT) {
        let bucket = ((v.to_bits() >> BUCKET_SHIFT) - BUCKET_FIRST) as usize;
        let code = t.codes[bucket];
        code + u8::from(v >= t.thresholds[usize::from(code) + 1])
    } else {
        0
    }
}

/// Eight-bit sRGB codes from linear light, each rounded exactly as by [`srgb_u8_from_linear`], to the shorter of the two slices. O(n), two look-ups each.
pub fn srgb_u8_from_linear_slice(values: &[f32], out: &mut [u8]) {
    let table = &*ENCODE_U8;
    for (o, &v) in out.iter_mut().zip(values) {
        *o = encode_u8(table, v);
    }
}

/// The smallest linear value that rounds to each sixteen-bit code; the last entry is above every value.
static THRESHOLDS_U16: LazyLock<Box<[f32]>> = LazyLock::new(|| {
    let lower = (1..=u16::MAX).map(|code| round_up_f32(linear_from_srgb((f64::from(code) - 0.5) / 65535.0)));
    std::iter::once(0.0).chain(lower).chain([f32::INFINITY]).collect()
});

/// The sixteen-bit sRGB code nearest to a linear value, exactly. Below 0 and NaN give 0, above 1 gives 65535.
pub fn srgb_u16_from_linear(v: f32) -> u16 {
    encode_u16(&THRESHOLDS_U16, v)
}

#[inline(always)]
fn encode_u16(thresholds: &[f32], v: f32) -> u16 {
    if v.is_nan() || v <= 0.0 {
        return 0;
    }
    if v >= 1.0 {
        return u16::MAX;
    }
    // The fast curve is within one code of the truth; the thresholds settle which one it is.
    let near = (srgb_from_linear_f32(v) * 65535.0 + 0.5).clamp(0.0, 65535.0) as usize;
    if v < thresholds[near] {
        (near - 1) as u16
    } else if v >= thresholds[near + 1] {
        (near + 1) as u16
    } else {
        near as u16
    }
}

/// Sixteen-bit sRGB codes from linear light, each rounded exactly, to the shorter of the two slices. O(n).
pub fn srgb_u16_from_linear_slice(values: &[f32], out: &mut [u16]) {
    let thresholds = &**THRESHOLDS_U16;
    for (o, &v) in out.iter_mut().zip(values) {
        *o = encode_u16(thresholds, v);
    }
}

/// A 3×3 matrix times a column.
fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2])
}

/// CIE XYZ (Y of white is 1) from linear RGB.
pub fn xyz_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    times(&XYZ_FROM_RGB, rgb)
}

/// Linear RGB from CIE XYZ.
pub fn rgb_from_xyz(xyz: [f64; 3]) -> [f64; 3] {
    times(&RGB_FROM_XYZ, xyz)
}

/// CIE L\*a\*b\* (L\* 0 to 100) from XYZ, the white being D65. The straight foot goes on below zero, so that negative light is finite.
pub fn lab_from_xyz(xyz: [f64; 3]) -> [f64; 3] {
    let f = |t: f64| if t > LAB_FOOT { libm::cbrt(t) } else { LAB_SLOPE * t + 4.0 / 29.0 };
    let [x, y, z] = std::array::from_fn(|i| f(xyz[i] / WHITE_D65[i]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// XYZ from CIE L\*a\*b\*, the inverse of [`lab_from_xyz`].
pub fn xyz_from_lab(lab: [f64; 3]) -> [f64; 3] {
    let y = (lab[0] + 16.0) / 116.0;
    let f = |t: f64| if t > 6.0 / 29.0 { t * t * t } else { (t - 4.0 / 29.0) / LAB_SLOPE };
    let curve = [f(y + lab[1] / 500.0), f(y), f(y - lab[2] / 200.0)];
    std::array::from_fn(|i| curve[i] * WHITE_D65[i])
}

/// CIE L\*a\*b\* from linear RGB.
pub fn lab_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    lab_from_xyz(xyz_from_rgb(rgb))
}

/// Linear RGB from CIE L\*a\*b\*.
pub fn rgb_from_lab(lab: [f64; 3]) -> [f64; 3] {
    rgb_from_xyz(xyz_from_lab(lab))
}

/// The rows of XYZ from linear RGB over the white, as `f32`: what the curve of L\*a\*b\* takes.
const LAB_ROWS: [[f32; 3]; 3] = {
    let mut rows = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        rows[i / 3][i % 3] = (XYZ_FROM_RGB[i / 3][i % 3] / WHITE_D65[i / 3]) as f32;
        i += 1;
    }
    rows
};

/// CIE L\*a\*b\* from linear RGB in `f32`, within 10⁻⁴ of the exact value inside the gamut; vectorises.
#[inline(always)]
pub fn lab_from_rgb_f32(rgb: [f32; 3]) -> [f32; 3] {
    let curve = |row: &[f32; 3]| {
        let t = row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2];
        let root = cbrt_f32(t);
        let foot = LAB_SLOPE as f32 * t + (4.0 / 29.0) as f32;
        if t > LAB_FOOT as f32 { root } else { foot }
    };
    let (x, y, z) = (curve(&LAB_ROWS[0]), curve(&LAB_ROWS[1]), curve(&LAB_ROWS[2]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Cone responses from linear RGB, of Ottosson's Oklab.
const LMS_FROM_RGB: [[f64; 3]; 3] = [
    [0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9],
    [0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6],
    [0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5],
];
const OKLAB_FROM_ROOTS: [[f64; 3]; 3] = [
    [0.210_454_255_3, 0.793_617_785_0, -0.004_072_046_8],
    [1.977_998_495_1, -2.428_592_205_0, 0.450_593_709_9],
    [0.025_904_037_1, 0.782_771_766_2, -0.808_675_766_0],
];
const ROOTS_FROM_OKLAB: [[f64; 3]; 3] =
    [[1.0, 0.396_337_777_4, 0.215_803_757_3], [1.0, -0.105_561_345_8, -0.063_854_172_8], [1.0, -0.089_484_177_5, -1.291_485_548_0]];
const RGB_FROM_LMS: [[f64; 3]; 3] = [
    [4.076_741_662_1, -3.307_711_591_3, 0.230_969_929_2],
    [-1.268_438_004_6, 2.609_757_401_1, -0.341_319_396_5],
    [-0.004_196_086_3, -0.703_418_614_7, 1.707_614_701_0],
];

/// Oklab (L 0 to 1) from linear RGB. Negative cone responses keep their sign.
pub fn oklab_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    times(&OKLAB_FROM_ROOTS, times(&LMS_FROM_RGB, rgb).map(libm::cbrt))
}

/// Linear RGB from Oklab; the inverse of [`oklab_from_rgb`] to the seven digits that its matrices were published with.
pub fn rgb_from_oklab(lab: [f64; 3]) -> [f64; 3] {
    times(&RGB_FROM_LMS, times(&ROOTS_FROM_OKLAB, lab).map(|v| v * v * v))
}

/// Oklab from linear RGB in `f32`; negative cone responses are taken as zero. Vectorises.
#[inline(always)]
pub fn oklab_from_rgb_f32(rgb: [f32; 3]) -> [f32; 3] {
    let row = |m: &[f64; 3], v: [f32; 3]| m[0] as f32 * v[0] + m[1] as f32 * v[1] + m[2] as f32 * v[2];
    // The root of the smallest input that is let through is 10⁻¹⁰, far below what a picture holds.
    let root = |m: &[f64; 3]| cbrt_f32(row(m, rgb).max(1e-30));
    let roots = [root(&LMS_FROM_RGB[0]), root(&LMS_FROM_RGB[1]), root(&LMS_FROM_RGB[2])];
    [row(&OKLAB_FROM_ROOTS[0], roots), row(&OKLAB_FROM_ROOTS[1], roots), row(&OKLAB_FROM_ROOTS[2], roots)]
}

/// Relative luminance, the Y of XYZ, of linear RGB.
pub fn luminance(rgb: [f64; 3]) -> f64 {
    XYZ_FROM_RGB[1][0] * rgb[0] + XYZ_FROM_RGB[1][1] * rgb[1] + XYZ_FROM_RGB[1][2] * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() <= tolerance, "expected {b}, found {a}");
    }

    #[test]
    fn the_curve_meets_its_anchors_and_inverts() {
        close(linear_from_srgb(0.5), 0.214_041_140_482_232_55, 1e-7);
        close(srgb_from_linear(0.18), 0.461_356_129_500_441_6, 1e-7);
        assert_eq!(linear_from_srgb(0.0), 0.0);
        close(srgb_from_linear(1.0), 1.0, 2e-16);
        for i in -300..=300 {
            let v = f64::from(i) / 200.0;
            close(srgb_from_linear(linear_from_srgb(v)), v, 1e-12);
        }
        assert!(linear_from_srgb(f64::NAN).is_nan());
        // The two pieces meet, so that no value is skipped at the toe.
        let e = 1e-9;
        close(srgb_from_linear(TOE_LINEAR + e), srgb_from_linear(TOE_LINEAR - e), 1e-7);
    }

    #[test]
    fn the_fast_curves_are_within_their_stated_errors() {
        for i in 1..=200_000u32 {
            let v = i as f32 * 1e-5;
            close(f64::from(srgb_from_linear_f32(v)), srgb_from_linear(f64::from(v)), 8e-7);
            let exact = linear_from_srgb(f64::from(v));
            close(f64::from(linear_from_srgb_f32(v)), exact, 8e-7 * exact);
            let root = libm::cbrt(f64::from(v));
            close(f64::from(cbrt_f32(v)), root, root * 3e-7);
        }
        assert_eq!(srgb_from_linear_f32(0.0), 0.0);
        assert_eq!(linear_from_srgb_f32(-0.01), -linear_from_srgb_f32(0.01));
    }

    #[test]
    fn slices_agree_with_scalars() {
        let mut values: Vec<f32> = (0..1003).map(|i| i as f32 / 700.0 - 0.2).collect();
        let before = values.clone();
        srgb_from_linear_slice(&mut values);
        assert!(values.iter().zip(&before).all(|(a, b)| a.to_bits() == srgb_from_linear_f32(*b).to_bits()));
        linear_from_srgb_slice(&mut values);
        assert!(values.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-6 + 1e-6 * b.abs()));
    }

    #[test]
    fn eight_bits_round_exactly() {
        for code in 0..=255u8 {
            assert_eq!(srgb_u8_from_linear(LINEAR_FROM_SRGB_U8[usize::from(code)]), code);
        }
        for i in 0..400_000u32 {
            let v = i as f32 / 390_000.0;
            let exact = (srgb_from_linear(f64::from(v)) * 255.0 + 0.5).floor().clamp(0.0, 255.0);
            assert_eq!(f64::from(srgb_u8_from_linear(v)), exact, "linear {v}");
        }
        // Each threshold itself is the first value of its code, the one below it the last of the code before.
        for code in 1..=255usize {
            let t = ENCODE_U8.thresholds[code];
            assert_eq!(usize::from(srgb_u8_from_linear(t)), code);
            assert_eq!(usize::from(srgb_u8_from_linear(f32::from_bits(t.to_bits() - 1))), code - 1);
        }
        assert_eq!([f32::NAN, -1.0, f32::NEG_INFINITY, f32::INFINITY, 2.0].map(srgb_u8_from_linear), [0, 0, 0, 255, 255]);
    }

    #[test]
    fn sixteen_bits_round_exactly() {
        for code in 0..=u16::MAX {
            let t = THRESHOLDS_U16[usize::from(code)];
            assert_eq!(srgb_u16_from_linear(LINEAR_FROM_SRGB_U16[usize::from(code)]), code);
            assert_eq!(srgb_u16_from_linear(t), code);
        }
        assert_eq!([f32::NAN, -1.0, f32::INFINITY].map(srgb_u16_from_linear), [0, 0, 65535]);
        let mut out = [9u16; 2];
        srgb_u16_from_linear_slice(&[0.0, 1.0], &mut out);
        assert_eq!(out, [0, 65535]);
    }

    #[test]
    fn lab_agrees_with_published_values() {
        // scikit-image 0.25 `rgb2lab` (D65, 2°) of sRGB red, green, blue and a mid colour.
        let cases = [
            ([1.0, 0.0, 0.0], [53.2408, 80.0925, 67.2032]),
            ([0.0, 1.0, 0.0], [87.7347, -86.1827, 83.1793]),
            ([0.0, 0.0, 1.0], [32.2970, 79.1875, -107.8602]),
            ([1.0, 1.0, 1.0], [100.0, 0.0, 0.0]),
        ];
        for (srgb, lab) in cases {
            let found = lab_from_rgb(srgb.map(linear_from_srgb));
            for i in 0..3 {
                // The published matrix has seven digits, which moves the blue corner by 0.02.
                close(found[i], lab[i], 0.02);
            }
        }
    }

    #[test]
    fn spaces_invert() {
        for i in 0..512 {
            let rgb = [(i % 8) as f64 / 7.0, (i / 8 % 8) as f64 / 7.0, (i / 64) as f64 / 7.0];
            let (back, ok) = (rgb_from_lab(lab_from_rgb(rgb)), rgb_from_oklab(oklab_from_rgb(rgb)));
            let fast = lab_from_rgb_f32(rgb.map(|v| v as f32));
            let exact = lab_from_rgb(rgb);
            let fast_ok = oklab_from_rgb_f32(rgb.map(|v| v as f32));
            let exact_ok = oklab_from_rgb(rgb);
            for c in 0..3 {
                close(back[c], rgb[c], 1e-12);
                close(ok[c], rgb[c], 2e-6);
                close(f64::from(fast[c]), exact[c], 2e-4);
                close(f64::from(fast_ok[c]), exact_ok[c], 2e-6);
            }
        }
        close(luminance([1.0; 3]), 1.0, 1e-12);
        // Ottosson's table: XYZ (0.950, 1, 1.089) is (1, 0, 0).
        close(oklab_from_rgb([1.0; 3])[0], 1.0, 1e-6);
    }
}
