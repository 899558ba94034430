//! Holds: which film frames show one drawing, found through grain.

use super::raster::Raster;

/// What tells two frames of one drawing from two of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How much more two frames differ than their grain for a new drawing: 1 is grain alone. Small sees slight moves, large forgives dirt.
    pub sensitivity: f64,
    /// Share of the picture that must change at the least for a new drawing.
    pub min_area: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { sensitivity: 3.0, min_area: 0.0005 }
    }
}

/// Side of the blocks whose means are compared: grain averages out in them, a moved line does not.
const BLOCK: usize = 8;
/// Smallest grain that is assumed, in encoded units: rounding to eight bits.
const LEAST_GRAIN: f32 = 0.4 / 255.0;

/// Means of the picture's blocks, square-root encoded, all channels but alpha.
///
/// O(samples). A picture smaller than a block is one block.
pub fn block_means(picture: Raster) -> Vec<f32> {
    let colours = if picture.channels == 2 || picture.channels == 4 { picture.channels - 1 } else { picture.channels };
    let (columns, rows) = (picture.width.div_ceil(BLOCK), picture.height.div_ceil(BLOCK));
    let mut sums = vec![0f32; columns * rows * colours];
    for y in 0..picture.height {
        let line = &mut sums[y / BLOCK * columns * colours..(y / BLOCK + 1) * columns * colours];
        for (x, pixel) in picture.row(y).chunks_exact(picture.channels.max(1)).enumerate() {
            let block = &mut line[x / BLOCK * colours..(x / BLOCK + 1) * colours];
            for (sum, sample) in block.iter_mut().zip(pixel) {
                // The square root is close to a display encoding, in which grain is nearly even.
                *sum += if *sample > 0.0 { sample.sqrt() } else { 0.0 };
            }
        }
    }
    for (i, block) in sums.chunks_exact_mut(colours.max(1)).enumerate() {
        let (x, y) = (i % columns.max(1) * BLOCK, i / columns.max(1) * BLOCK);
        let n = BLOCK.min(picture.width - x) * BLOCK.min(picture.height - y);
        block.iter_mut().for_each(|s| *s /= n as f32);
    }
    sums
}

/// For each frame the frame whose drawing it shows: the first of its hold. `means` are those of [`block_means`], one list a frame, all of one length.
///
/// The grain is the median absolute difference of neighbouring frames' block means, taken over the pairs that differ least; a pair shows
/// a new drawing where more than `min_area` of the blocks differ by more than `sensitivity` of its extreme. O(frames × blocks).
pub fn find_holds(means: &[Vec<f32>], options: Options) -> Vec<usize> {
    let pairs: Vec<Vec<f32>> = means.windows(2).map(|p| difference(&p[0], &p[1])).collect();
    // In any footage the stillest pair, or the stillest blocks of it, show grain alone.
    let grain = pairs.iter().map(|d| median(d.clone())).fold(f32::INFINITY, f32::min).max(LEAST_GRAIN / BLOCK as f32);
    let mut holds = Vec::with_capacity(means.len());
    for frame in 0..means.len() {
        let held = frame > 0 && !is_new(&pairs[frame - 1], grain, options);
        holds.push(if held { holds[frame - 1] } else { frame });
    }
    holds
}

fn difference(a: &[f32], b: &[f32]) -> Vec<f32> {
    if a.len() != b.len() {
        return vec![f32::INFINITY; 1];
    }
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect()
}

fn median(mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

fn is_new(difference: &[f32], grain: f32, options: Options) -> bool {
    // At the default of 3 a normal deviate is beyond this (five standard deviations) once in two million.
    let threshold = grain * 2.5 * options.sensitivity as f32;
    let changed = difference.iter().filter(|d| d.is_nan() || **d > threshold).count();
    changed as f64 > (options.min_area * difference.len() as f64).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small disc on a gradient, its centre moving every `step` frames by a pixel and a half, with grain of a standard deviation.
    fn clip(step: usize, sigma: f32, frames: usize) -> Vec<Vec<f32>> {
        let mut seed = 1u32;
        let mut uniform = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from((seed >> 16) as u16) / 65_536.0
        };
        let mut grain = move || (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
        let (w, h) = (160usize, 96usize);
        (0..frames)
            .map(|frame| {
                let centre = 40.0 + 1.5 * (frame / step) as f32;
                let mut pixels = Vec::new();
                for y in 0..h {
                    for x in 0..w {
                        let inside = ((x as f32 - centre).powi(2) + (y as f32 - 48.0).powi(2)).sqrt() < 12.0;
                        let value: f32 = if inside { 0.75 } else { 0.3 + 0.2 * x as f32 / w as f32 };
                        let value = (value + grain() * sigma).max(0.0);
                        pixels.push(value * value);
                    }
                }
                block_means(Raster { data: &pixels, width: w, height: h, channels: 1 })
            })
            .collect()
    }

    #[test]
    fn ones_twos_and_threes_are_found_through_grain() {
        for step in 1..=3 {
            for sigma in [0.0, 1.0, 4.0, 6.0] {
                let holds = find_holds(&clip(step, sigma / 255.0, 24), Options::default());
                let truth: Vec<usize> = (0..24).map(|f| f / step * step).collect();
                assert_eq!(holds, truth, "on {step}s with grain {sigma}/255");
            }
        }
    }

    #[test]
    fn one_frame_and_none_are_fine() {
        assert_eq!(find_holds(&[vec![0.5; 4]], Options::default()), [0]);
        assert!(find_holds(&[], Options::default()).is_empty());
    }
}
