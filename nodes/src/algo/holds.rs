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

/// Finds holds as frames come, of each pair of neighbours keeping two numbers.
///
/// The grain is the median absolute difference of neighbouring frames' block means, taken over the pairs that differ least; a pair shows
/// a new drawing where more than `min_area` of the blocks differ by more than `sensitivity` of its extreme.
#[derive(Clone, Debug)]
pub struct Finder {
    options: Options,
    before: Option<Vec<f32>>,
    pairs: Vec<Pair>,
}

/// How two neighbouring frames differ.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// The median of their blocks' differences.
    median: f32,
    /// The largest difference that so many blocks reach that they are a new drawing: the pair is one where this is beyond the threshold, which is
    /// known once all pairs are.
    decisive: f32,
}

impl Finder {
    /// Before the first frame.
    pub fn new(options: Options) -> Self {
        Self { options, before: None, pairs: Vec::new() }
    }

    /// The next frame's [`block_means`], as many at every frame. O(blocks).
    pub fn push(&mut self, means: Vec<f32>) {
        if let Some(before) = self.before.replace(means)
            && let Some(now) = &self.before
        {
            self.pairs.push(Pair::new(difference(&before, now), self.options.min_area));
        }
    }

    /// For each frame the frame whose drawing it shows: the first of its hold. O(frames).
    pub fn finish(self) -> Vec<usize> {
        // In any footage the stillest pair, or the stillest blocks of it, show grain alone.
        let grain = self.pairs.iter().map(|p| p.median).fold(f32::INFINITY, f32::min).max(LEAST_GRAIN / BLOCK as f32);
        // At the default of 3 a normal deviate is beyond this (five standard deviations) once in two million.
        let threshold = grain * 2.5 * self.options.sensitivity as f32;
        let mut holds: Vec<usize> = self.before.iter().map(|_| 0).collect();
        for (k, pair) in self.pairs.iter().enumerate() {
            let is_new = pair.decisive.is_nan() || pair.decisive > threshold;
            holds.push(if is_new { k + 1 } else { holds[k] });
        }
        holds
    }
}

impl Pair {
    fn new(mut difference: Vec<f32>, min_area: f64) -> Self {
        let most_held = (min_area * difference.len() as f64).max(1.0) as usize;
        let median = kth(&mut difference, |n| n / 2).unwrap_or(0.0);
        // The number of blocks that are beyond a threshold is more than `most_held` where that many but one are at least as large as this. A
        // difference that is no number stands above all others.
        let decisive = kth(&mut difference, |n| n.checked_sub(most_held + 1).unwrap_or(n)).unwrap_or(f32::NEG_INFINITY);
        Self { median, decisive }
    }
}

/// The value that would stand at the position `at(len)` in rising order; `None` past the end.
fn kth(values: &mut [f32], at: impl FnOnce(usize) -> usize) -> Option<f32> {
    let at = at(values.len());
    (at < values.len()).then(|| *values.select_nth_unstable_by(at, f32::total_cmp).1)
}

fn difference(a: &[f32], b: &[f32]) -> Vec<f32> {
    if a.len() != b.len() {
        return vec![f32::INFINITY; 1];
    }
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn find_holds(means: &[Vec<f32>], options: Options) -> Vec<usize> {
        let mut finder = Finder::new(options);
        means.iter().for_each(|m| finder.push(m.clone()));
        finder.finish()
    }

    /// The same from all frames at once, as the definition reads.
    fn defined(means: &[Vec<f32>], options: Options) -> Vec<usize> {
        let pairs: Vec<Vec<f32>> = means.windows(2).map(|p| difference(&p[0], &p[1])).collect();
        let median = |d: &Vec<f32>| kth(&mut d.clone(), |n| n / 2).unwrap_or(0.0);
        let grain = pairs.iter().map(median).fold(f32::INFINITY, f32::min).max(LEAST_GRAIN / BLOCK as f32);
        let threshold = grain * 2.5 * options.sensitivity as f32;
        let mut holds = Vec::new();
        for frame in 0..means.len() {
            let is_new = |d: &Vec<f32>| {
                let changed = d.iter().filter(|d| d.is_nan() || **d > threshold).count();
                changed as f64 > (options.min_area * d.len() as f64).max(1.0)
            };
            holds.push(if frame == 0 || is_new(&pairs[frame - 1]) { frame } else { holds[frame - 1] });
        }
        holds
    }

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

    proptest! {
        #[test]
        fn two_numbers_a_pair_decide_as_all_blocks_do(
            frames in (0usize..40).prop_flat_map(|n| {
                // Few values, so that ties with the threshold happen.
                let value = prop_oneof![8 => Just(0.0f32), 4 => 0.0f32..0.01, 4 => 0.0f32..1.0, 1 => Just(f32::NAN), 1 => Just(f32::INFINITY)];
                proptest::collection::vec(proptest::collection::vec(value, n), 0..8)
            }),
            sensitivity in 1.0..100.0f64,
            min_area in prop_oneof![Just(0.0), Just(1.0), Just(0.25), 0.0..1.0f64],
        ) {
            let options = Options { sensitivity, min_area };
            prop_assert_eq!(find_holds(&frames, options), defined(&frames, options));
        }
    }

    #[test]
    fn frames_of_other_sizes_are_new_drawings_or_none() {
        let frames = [vec![0.5; 4], vec![0.5; 9], vec![0.5; 9]];
        assert_eq!(find_holds(&frames, Options::default()), defined(&frames, Options::default()));
    }

    #[test]
    fn one_frame_and_none_are_fine() {
        assert_eq!(find_holds(&[vec![0.5; 4]], Options::default()), [0]);
        assert!(find_holds(&[], Options::default()).is_empty());
    }
}
