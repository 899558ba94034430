//! Pictures made small enough for a page: box-filtered in linear light, over a checkerboard where they are transparent, as JPEG.

use pegbar_nodes::algo::codec::{EncodeOptions, Format, Picture, encode_to_vec};
use pegbar_nodes::algo::raster::Raster;

use super::html::base64;

/// The two greys behind transparent pictures, linear light, and the size of a square in pixels.
const GREYS: [f32; 2] = [0.60, 0.45];
const SQUARE: usize = 8;
const QUALITY: u8 = 82;

/// A picture of a page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Thumb {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue in linear light.
    pub(crate) rgb: Vec<f32>,
}

impl Thumb {
    /// `raster` in at most `most` pixels each way. Of one or two channels the first is shown grey; `alpha` is the channel that says how solid a pixel is.
    pub(crate) fn of(raster: Raster<'_>, alpha: Option<usize>, most: [usize; 2]) -> Option<Self> {
        let (w, h) = (raster.width, raster.height);
        if w == 0 || h == 0 || raster.channels == 0 {
            return None;
        }
        let share = (most[0] as f64 / w as f64).min(most[1] as f64 / h as f64).min(1.0);
        let side = |n: usize| ((n as f64 * share).round() as usize).max(1);
        let (width, height) = (side(w), side(h));
        let mut rgb = Vec::with_capacity(width * height * 3);
        for y in 0..height {
            for x in 0..width {
                let mean = mean(&raster, [x * w / width, (x + 1) * w / width], [y * h / height, (y + 1) * h / height]);
                let grey = GREYS[(x / SQUARE + y / SQUARE) % 2];
                let below = alpha.map_or(0.0, |a| (1.0 - mean[a.min(3)].clamp(0.0, 1.0)) * grey);
                let colour = if raster.channels < 3 { [mean[0]; 3] } else { [mean[0], mean[1], mean[2]] };
                rgb.extend(colour.map(|v| v + below));
            }
        }
        Some(Self { width, height, rgb })
    }

    /// The file of it as a data URI; `None` where it cannot be written, which no size that is made here keeps it from.
    pub(crate) fn uri(self) -> Option<String> {
        let picture = Picture::new(self.rgb, self.width, self.height, &["R", "G", "B"])?;
        let options = EncodeOptions { quality: QUALITY, threads: 1, ..EncodeOptions::new(Format::Jpeg) };
        let bytes = encode_to_vec(&picture, &options).ok()?;
        Some(format!("data:image/jpeg;base64,{}", base64(&bytes)))
    }
}

/// Mean of the first four channels over a rectangle, of one pixel at least. What is not finite counts as nought.
fn mean(raster: &Raster<'_>, [x0, x1]: [usize; 2], [y0, y1]: [usize; 2]) -> [f32; 4] {
    let (x1, y1) = (x1.max(x0 + 1), y1.max(y0 + 1));
    let n = raster.channels.min(4);
    let mut sum = [0.0f32; 4];
    for y in y0..y1 {
        let row = &raster.row(y)[x0 * raster.channels..x1 * raster.channels];
        for pixel in row.chunks_exact(raster.channels) {
            for c in 0..n {
                sum[c] += if pixel[c].is_finite() { pixel[c] } else { 0.0 };
            }
        }
    }
    let count = ((x1 - x0) * (y1 - y0)) as f32;
    sum.map(|s| s / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_are_means_and_what_is_transparent_shows_the_squares() {
        let data: Vec<f32> = (0..4 * 2).flat_map(|i| [i as f32, 0.0, 1.0, 1.0]).collect();
        let thumb = Thumb::of(Raster::new(&data, 4, 2, 4).unwrap(), Some(3), [2, 2]).unwrap();
        assert_eq!((thumb.width, thumb.height, thumb.rgb), (2, 1, vec![2.5, 0.0, 1.0, 4.5, 0.0, 1.0]));
        let clear = Thumb::of(Raster::new(&[0.0; 16 * 4], 16, 1, 4).unwrap(), Some(3), [16, 16]).unwrap();
        assert_eq!((clear.rgb[0], clear.rgb[8 * 3]), (GREYS[0], GREYS[1]));
        let grey = Thumb::of(Raster::new(&[0.5, f32::NAN], 2, 1, 1).unwrap(), None, [9, 9]).unwrap();
        assert_eq!(grey.rgb, [0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
        assert!(Thumb::of(Raster::new(&[], 0, 4, 3).unwrap(), None, [9, 9]).is_none());
    }

    #[test]
    fn the_file_is_a_picture_again() {
        let uri = Thumb { width: 3, height: 2, rgb: vec![0.25; 18] }.uri().unwrap();
        assert!(uri.starts_with("data:image/jpeg;base64,/9j/"), "{uri}");
    }
}
