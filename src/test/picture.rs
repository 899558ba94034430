//! Small pictures of values that are pictures, and of how two of them differ.

use pegbar_engine::value::{ValueRef, downcast};
use pegbar_nodes::algo::codec::{self, ColorMode, DecodeOptions, EncodeOptions, Format, Level, Picture};
use pegbar_nodes::data::{Image, Matte};

/// The longest side of a small picture: what a director needs to see what is meant, in tens of kilobytes, so that a repository can hold hundreds.
const LONGEST: usize = 320;
/// Channels of a picture in codes.
const CHANNELS: usize = 4;

/// How a value is looked at.
type Show = fn(&ValueRef) -> Option<Picture>;
/// Types that are pictures.
const PICTURES: [(&str, Show); 2] = [("Image", image), ("Matte", matte)];

/// True for types that are pictures.
pub(crate) fn is_picture(type_name: &str) -> bool {
    PICTURES.iter().any(|(name, _)| *name == type_name)
}

fn image(value: &ValueRef) -> Option<Picture> {
    let image = downcast::<Image>(value.clone())?;
    let image = image.in_display().ok()?;
    let names = image.channels();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let (width, height, n) = (image.width(), image.height(), names.len());
    if matches!(names[..], ["Y"] | ["Y", "A"] | ["R", "G", "B"] | ["R", "G", "B", "A"]) {
        return Picture::new(image.samples().to_vec(), width, height, &names);
    }
    // Depths, vectors and the like: the first of their numbers, as grey.
    Picture::new(image.samples().chunks(n.max(1)).filter_map(|p| p.first().copied()).collect(), width, height, &["Y"])
}

fn matte(value: &ValueRef) -> Option<Picture> {
    let matte = downcast::<Matte>(value.clone())?;
    Picture::new(matte.alpha().to_vec(), matte.width(), matte.height(), &["Y"])
}

/// A value as a small PNG; `None` for what is no picture, or has no pixels.
pub(crate) fn small(value: &ValueRef) -> Option<Vec<u8>> {
    let (_, show) = PICTURES.iter().find(|(name, _)| *name == value.type_name())?;
    codec::encode_to_vec(&shrink(&show(value)?)?, &png()).ok()
}

fn png() -> EncodeOptions {
    EncodeOptions { level: Level::High, threads: 1, ..EncodeOptions::new(Format::Png) }
}

/// Means of the pixels under each of the small picture's.
fn shrink(picture: &Picture) -> Option<Picture> {
    let longest = picture.width.max(picture.height);
    if longest == 0 || longest <= LONGEST {
        return (longest > 0).then(|| picture.clone());
    }
    let side = |n: usize| (n * LONGEST).div_ceil(longest).max(1);
    let (width, height, n) = (side(picture.width), side(picture.height), picture.channels.len());
    let span = |k: usize, small: usize, large: usize| k * large / small..((k + 1) * large / small).max(k * large / small + 1);
    let mut pixels = Vec::with_capacity(width * height * n);
    for (y, x) in (0..width * height).map(|i| (i / width, i % width)) {
        for c in 0..n {
            let under = span(y, height, picture.height)
                .flat_map(|y| span(x, width, picture.width).map(move |x| (y * picture.width + x) * n + c))
                .filter_map(|i| picture.pixels.get(i).copied().filter(|v| v.is_finite()));
            let (sum, count) = under.fold((0.0f64, 0u32), |(s, n), v| (s + f64::from(v), n + 1));
            pixels.push(if count == 0 { 0.0 } else { (sum / f64::from(count)) as f32 });
        }
    }
    let names: Vec<&str> = picture.channels.iter().map(String::as_str).collect();
    Picture::new(pixels, width, height, &names)
}

/// A picture in codes of 0 to 255, colour times alpha.
struct Codes {
    width: usize,
    height: usize,
    pixels: Vec<[f32; CHANNELS]>,
}

impl Codes {
    fn of(png: &[u8]) -> Option<Self> {
        let options = DecodeOptions { color: ColorMode::Data, threads: 1, ..DecodeOptions::default() };
        let picture = codec::decode(png, &options).ok()?;
        let n = picture.channels.len();
        let pixel = |p: &[f32]| match *p {
            [y] => [y, y, y, 1.0],
            [y, a] => [y * a, y * a, y * a, a],
            [r, g, b] => [r, g, b, 1.0],
            [r, g, b, a, ..] => [r * a, g * a, b * a, a],
            [] => [0.0; CHANNELS],
        };
        let pixels = picture.pixels.chunks(n.max(1)).map(|p| pixel(p).map(|v| v * 255.0)).collect();
        Some(Self { width: picture.width, height: picture.height, pixels })
    }
}

/// In what two small pictures differ.
pub(crate) struct PixelDifference {
    /// Pixels that differ by more than is allowed, and all of them.
    pub(crate) beyond: (usize, usize),
    /// The most that a pixel differs by, in codes, and where: column and row.
    pub(crate) worst: (f32, usize, usize),
    /// The differences as a PNG, as they are.
    pub(crate) png: Vec<u8>,
    /// The same times so much that they are seen.
    pub(crate) amplified: Vec<u8>,
    /// By what.
    pub(crate) gain: f32,
}

/// Compares two small pictures pixel by pixel; `None` where they are not of one size, or no pictures.
pub(crate) fn differ(expected: &[u8], found: &[u8], allowed: f64) -> Option<PixelDifference> {
    let (expected, found) = (Codes::of(expected)?, Codes::of(found)?);
    if (expected.width, expected.height) != (found.width, found.height) {
        return None;
    }
    let apart = |(a, b): (&[f32; CHANNELS], &[f32; CHANNELS])| std::array::from_fn(|c| (a[c] - b[c]).abs());
    let apart: Vec<[f32; CHANNELS]> = expected.pixels.iter().zip(&found.pixels).map(apart).collect();
    let most = |p: &[f32; CHANNELS]| p.iter().copied().fold(0.0f32, f32::max);
    let beyond = apart.iter().filter(|p| f64::from(most(p)) > allowed + 1e-3).count();
    let (at, worst) = apart.iter().enumerate().fold((0, 0.0f32), |(at, m), (i, p)| if most(p) > m { (i, most(p)) } else { (at, m) });
    let gain = if worst > 0.0 { (255.0 / worst).floor().max(1.0) } else { 1.0 };
    let picture = |gain: f32| {
        // A difference of alpha alone is shown as grey.
        let shown = |p: &[f32; CHANNELS]| [p[0].max(p[3]), p[1].max(p[3]), p[2].max(p[3])].map(|v| (v * gain / 255.0).min(1.0));
        let picture = Picture::new(apart.iter().flat_map(shown).collect(), found.width, found.height, &["R", "G", "B"])?;
        codec::encode_to_vec(&picture, &EncodeOptions { color: ColorMode::Data, ..png() }).ok()
    };
    let (width, worst_at) = (found.width.max(1), at);
    Some(PixelDifference {
        beyond: (beyond, apart.len()),
        worst: (worst, worst_at % width, worst_at / width),
        png: picture(1.0)?,
        amplified: picture(gain)?,
        gain,
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn value(side: usize, spot: f32) -> ValueRef {
        let mut samples = vec![0.25; side * side * 3];
        samples[(side + 2) * 3] = spot;
        Arc::new(Image::new(side, side, 3, samples).unwrap())
    }

    #[test]
    fn a_pixel_that_differs_is_found_where_it_is() {
        let (a, b) = (small(&value(8, 0.25)).unwrap(), small(&value(8, 1.0)).unwrap());
        let none = differ(&a, &a, 0.0).unwrap();
        assert_eq!((none.beyond, none.worst.0), ((0, 64), 0.0));
        let one = differ(&a, &b, 3.0).unwrap();
        // 0.25 of linear light is code 137 of sRGB.
        assert_eq!((one.beyond, one.worst), ((1, 64), (118.0, 2, 1)));
        assert_eq!(one.gain, 2.0);
        assert!(differ(&a, &small(&value(9, 0.25)).unwrap(), 3.0).is_none());
    }

    #[test]
    fn large_pictures_are_means_and_others_stay() {
        let large = Codes::of(&small(&value(1000, 0.25)).unwrap()).unwrap();
        assert_eq!((large.width, large.height), (LONGEST, LONGEST));
        assert!(large.pixels.iter().all(|p| *p == [137.0, 137.0, 137.0, 255.0]));
        assert!(small(&(Arc::new(pegbar_engine::value::Curve { value: 1.0 }) as ValueRef)).is_none());
    }
}
