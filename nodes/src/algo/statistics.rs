//! Mean, least and greatest sample of each channel.
//!
//! Sums are taken in double precision in a fixed number of lanes that are added up in order, so that the bits are the same on every processor.

use super::warp_affine::Source;
use super::window::Window;

/// Samples that are summed side by side: a multiple of the usual numbers of channels, so that a lane is of one channel throughout.
const LANES: usize = 24;

/// What there is to say of the samples of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// The mean; no number where a sample is none.
    pub mean: f64,
    /// The least sample. Samples that are no number are passed over; infinity where there is no other.
    pub minimum: f32,
    /// The greatest, likewise; negative infinity where there is no other.
    pub maximum: f32,
}

#[derive(Clone)]
struct Lanes {
    sum: [f64; LANES],
    least: [f32; LANES],
    greatest: [f32; LANES],
}

impl Lanes {
    const EMPTY: Self = Self { sum: [0.0; LANES], least: [f32::INFINITY; LANES], greatest: [f32::NEG_INFINITY; LANES] };

    #[inline(always)]
    fn add(&mut self, i: usize, sample: f32) {
        self.sum[i] += f64::from(sample);
        // No number is neither less nor greater.
        self.least[i] = if sample < self.least[i] { sample } else { self.least[i] };
        self.greatest[i] = if sample > self.greatest[i] { sample } else { self.greatest[i] };
    }
}

/// The statistics of each channel over `window`, outside of its samples a picture being 0. `None` where the window has no pixels.
///
/// Cost: O(samples), one pass over memory.
pub fn statistics(picture: Source<'_>, window: Window) -> Option<Vec<Statistics>> {
    let (raster, channels) = (picture.raster, picture.raster.channels);
    let pixels = window.samples(1).filter(|n| *n > 0)?;
    let common = picture.window().intersect(&window);
    // Where lanes would mix channels each channel is read by itself.
    let mixed = !LANES.is_multiple_of(channels);
    let mut lanes = vec![Lanes::EMPTY; if mixed { channels } else { 1 }];
    let mut plane = Vec::new();
    for y in 0..common.height {
        let start = (common.x - picture.origin[0]) as usize * channels;
        let row = raster.row((common.y - picture.origin[1]) as usize + y);
        let row = &row[start..start + common.width * channels];
        if !mixed {
            add_row(row, &mut lanes[0]);
            continue;
        }
        for (channel, lanes) in lanes.iter_mut().enumerate() {
            plane.clear();
            plane.extend(row.iter().skip(channel).step_by(channels));
            add_row(&plane, lanes);
        }
    }
    let outside = common.width * common.height < pixels;
    let of = |channel: usize| {
        if mixed { total(&lanes[channel], 0, 1, outside, pixels) } else { total(&lanes[0], channel, channels, outside, pixels) }
    };
    Some((0..channels).map(of).collect())
}

/// Every `step`th lane from `first` on.
fn total(lanes: &Lanes, first: usize, step: usize, outside: bool, pixels: usize) -> Statistics {
    let mut all = Lanes::EMPTY;
    let mut sum = 0.0;
    for i in (first..LANES).step_by(step) {
        sum += lanes.sum[i];
        all.add(0, lanes.least[i]);
        all.add(1, lanes.greatest[i]);
    }
    if outside {
        all.add(0, 0.0);
        all.add(1, 0.0);
    }
    Statistics { mean: sum / pixels as f64, minimum: all.least[0], maximum: all.greatest[1] }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add_row(row: &[f32], lanes: &mut Lanes) {
    let (blocks, rest) = row.as_chunks::<LANES>();
    // Lanes of the row's own stay in registers.
    let mut own = lanes.clone();
    for block in blocks {
        for (i, sample) in block.iter().enumerate() {
            own.add(i, *sample);
        }
    }
    for (i, sample) in rest.iter().enumerate() {
        own.add(i, *sample);
    }
    *lanes = own;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::raster::Raster;
    use proptest::prelude::*;

    fn of(samples: &[f32], width: usize, channels: usize, origin: [i64; 2], window: Window) -> Option<Vec<Statistics>> {
        let height = samples.len() / (width * channels).max(1);
        statistics(Source::new(Raster::new(samples, width, height, channels).unwrap(), origin), window)
    }

    #[test]
    fn each_channel_is_by_itself() {
        let found = of(&[1.0, 10.0, 3.0, -10.0], 2, 2, [0, 0], Window::at_origin(2, 1)).unwrap();
        assert_eq!(found[0], Statistics { mean: 2.0, minimum: 1.0, maximum: 3.0 });
        assert_eq!(found[1], Statistics { mean: 0.0, minimum: -10.0, maximum: 10.0 });
    }

    #[test]
    fn outside_its_samples_a_picture_is_nought_and_beyond_the_window_it_does_not_count() {
        let picture = [4.0, 8.0, 2.0, 6.0];
        let found = of(&picture, 2, 1, [1, 0], Window::at_origin(2, 4)).unwrap();
        assert_eq!(found, [Statistics { mean: 6.0 / 8.0, minimum: 0.0, maximum: 4.0 }]);
        let nothing = of(&picture, 2, 1, [9, 9], Window::at_origin(2, 4)).unwrap();
        assert_eq!(nothing, [Statistics { mean: 0.0, minimum: 0.0, maximum: 0.0 }]);
        assert_eq!(of(&picture, 2, 1, [0, 0], Window::at_origin(0, 4)), None);
    }

    #[test]
    fn what_is_no_number_spoils_the_mean_alone() {
        let found = of(&[f32::NAN, 1.0, -2.0], 3, 1, [0, 0], Window::at_origin(3, 1)).unwrap();
        assert!(found[0].mean.is_nan());
        assert_eq!((found[0].minimum, found[0].maximum), (-2.0, 1.0));
    }

    proptest! {
        #[test]
        fn as_the_definition_has_it(
            (width, height, channels) in (1usize..40, 1usize..6, 1usize..9),
            samples in proptest::collection::vec(-1e3f32..1e3, 40 * 6 * 9),
        ) {
            let samples = &samples[..width * height * channels];
            let found = of(samples, width, channels, [-3, 5], Window::new(-3, 5, width, height)).unwrap();
            prop_assert_eq!(found.len(), channels);
            for (c, found) in found.iter().enumerate() {
                let own: Vec<f32> = samples.iter().skip(c).step_by(channels).copied().collect();
                let sum: f64 = own.iter().copied().map(f64::from).sum();
                let size: f64 = own.iter().map(|v| f64::from(v.abs())).sum();
                // Two orders of adding n numbers differ by n roundings at most.
                prop_assert!((found.mean * own.len() as f64 - sum).abs() <= size * own.len() as f64 * f64::EPSILON);
                prop_assert_eq!(found.minimum, own.iter().copied().fold(f32::INFINITY, f32::min));
                prop_assert_eq!(found.maximum, own.iter().copied().fold(f32::NEG_INFINITY, f32::max));
            }
        }
    }
}
