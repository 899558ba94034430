//! `image.clean_plate`: the ground of footage whose camera stands still, without the layer that moves in front.
//!
//! **Method** each pixel is the median, channel by channel, of the frames in which the matte leaves it free; where none does, of those that it covers least.
//!
//! **Source** usual practice.
//!
//! **Fails when** the camera moves, or pictures and mattes have different sizes.
//!
//! **Cost** O(frames × pixels). Two frames are in memory, and 64 MiB of samples: footage of n samples a frame with its matte, each of which is read in
//! as many passes as `frames` × n exceeds that.
//!
//! ```ron
//! "clean": (type: "image.clean_plate", image: "@plate", matte: "@matte"),
//! ```

use std::cmp::Ordering;
use std::ops::Range;

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, Sequence, Whole};

use super::Picture;
use crate::data::{Image, Matte};

/// Bytes of samples that are held at a time.
const HELD: usize = 64 << 20;

/// The ground of footage whose camera stands still, without the layer that moves in front.
#[derive(Node)]
#[node(
    id = "image.clean_plate",
    version = 1,
    kind = whole,
    outputs = Picture,
    example = "\"clean\": (type: \"image.clean_plate\", image: \"@plate\", matte: \"@matte\")"
)]
pub(crate) struct ImageCleanPlate {
    /// The footage.
    image: Sequence<Image>,
    /// Matte of what is to go, a frame each, or one for all.
    matte: Sequence<Matte>,
    /// Matte values up to this leave a pixel free. 0 takes untouched pixels only.
    #[input(default = 0.02, range = 0.0..=1.0)]
    threshold: f64,
    /// Most frames that are looked at, evenly spread: more are surer of a ground that shows rarely, fewer are quicker.
    #[input(default = 64, range = 1..=100000)]
    frames: u32,
}

impl Whole for ImageCleanPlate {
    fn run(self, cx: &Context) -> Result<Picture, NodeError> {
        if self.image.is_empty() {
            return Err(NodeError::input("expected at least one frame, found none"));
        }
        let used = self.image.len().min(self.frames as usize);
        let first = self.image.get(0)?;
        // All frames of a few pixels at a time: a median needs every frame, but no frame as a whole.
        let band = (HELD / (used * (first.n_channels() + 1) * size_of::<f32>())).max(1);
        let pixels = first.width() * first.height();
        let mut samples = Vec::with_capacity(first.samples().len());
        for start in (0..pixels).step_by(band) {
            self.push_band(cx, used, &first, start..pixels.min(start + band), &mut samples)?;
        }
        let image = first.with_samples(samples).ok_or_else(|| NodeError::internal("a plate of another size than its footage"))?;
        Ok(Picture { image })
    }
}

impl ImageCleanPlate {
    /// The plate at a range of pixels, from `used` frames.
    fn push_band(&self, cx: &Context, used: usize, first: &Image, band: Range<usize>, plate: &mut Vec<f32>) -> Result<(), NodeError> {
        let (w, h, c) = (first.width(), first.height(), first.n_channels());
        let mut samples = Vec::with_capacity(used * band.len() * c);
        let mut alphas = Vec::with_capacity(used * band.len());
        for k in (0..used).map(|k| k * self.image.len() / used) {
            cx.check()?;
            let picture = self.image.get(k)?;
            let matte = self.matte.get(if self.matte.len() == 1 { 0 } else { k })?;
            if (picture.width(), picture.height(), picture.n_channels()) != (w, h, c) || (matte.width(), matte.height()) != (w, h) {
                return Err(NodeError::input(format!("expected pictures and mattes of {w} x {h} throughout, found another size")));
            }
            samples.extend_from_slice(&picture.samples()[band.start * c..band.end * c]);
            alphas.extend_from_slice(&matte.alpha()[band.clone()]);
        }
        let mut free = Vec::with_capacity(used);
        for pixel in 0..band.len() {
            let alpha = |k: usize| alphas[k * band.len() + pixel];
            let limit = (0..used).map(alpha).fold(f32::INFINITY, f32::min).max(self.threshold as f32);
            for channel in 0..c {
                // A matte value that is no number covers nothing, so that some frame is always left.
                let frames = (0..used).filter(|&k| alpha(k).partial_cmp(&limit) != Some(Ordering::Greater));
                free.clear();
                free.extend(frames.map(|k| samples[(k * band.len() + pixel) * c + channel]));
                let middle = free.len() / 2;
                plate.push(*free.select_nth_unstable_by(middle, f32::total_cmp).1);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::{clock, counted};
    use pegbar_engine::clock::Clock;
    use pegbar_engine::node::{Arg, Cancel, Input, SequenceRef};
    use pegbar_engine::value::ValueRef;
    use std::sync::Arc;

    fn sequence<T: pegbar_engine::value::Value>(values: Vec<T>) -> Sequence<T> {
        let refs = values.into_iter().map(|v| Arc::new(v) as ValueRef).collect::<Vec<ValueRef>>();
        Sequence::from_arg(Arg::Sequence(SequenceRef::new(None, refs))).unwrap()
    }

    #[test]
    fn what_a_matte_covers_in_some_frames_is_taken_from_the_others() {
        let clock = Clock { name: "frames".to_owned(), first: 1, last: 3, fps: (24, 1) };
        let cancel = Cancel::default();
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel };
        let picture = |a: f32, b: f32| Image::new(2, 1, 1, vec![a, b]).unwrap();
        let matte = |a: f32, b: f32| Matte::new(2, 1, vec![a, b]).unwrap();
        let node = ImageCleanPlate {
            image: sequence(vec![picture(9.0, 0.2), picture(0.1, 9.0), picture(0.1, 0.2)]),
            matte: sequence(vec![matte(1.0, 0.0), matte(0.0, 1.0), matte(0.0, 0.0)]),
            threshold: 0.02,
            frames: 64,
        };
        assert_eq!(node.run(&cx).unwrap().image.samples(), [0.1, 0.2]);
        let always = ImageCleanPlate {
            image: sequence(vec![picture(9.0, 0.2), picture(3.0, 0.2)]),
            matte: sequence(vec![matte(1.0, 0.0), matte(0.5, 0.0)]),
            threshold: 0.02,
            frames: 64,
        };
        assert_eq!(always.run(&cx).unwrap().image.samples(), [3.0, 0.2], "the frame that is covered least stands in");
    }

    #[test]
    fn few_frames_are_held_however_many_are_read_and_bands_make_the_same_plate() {
        // One frame is 1.6 MB with its matte, so that 90 are looked at in three bands; the row where one ends has the same median as all others.
        let (width, height, frames) = (1000, 200, 90);
        let value = |k: usize, pixel: usize| ((k * 37 + pixel * 11) % 101) as f32;
        let (image, pictures) =
            counted(frames, move |k| Image::new(width, height, 1, (0..width * height).map(|p| value(k, p)).collect()).unwrap());
        let (matte, mattes) =
            counted(frames, move |k| Matte::new(width, height, (0..width * height).map(|p| ((k + p) % 3) as f32).collect()).unwrap());
        let (clock, cancel) = (clock(frames), Cancel::default());
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel };
        let plate = ImageCleanPlate { image, matte, threshold: 0.02, frames: 1000 }.run(&cx).unwrap().image;
        for (pixel, found) in plate.samples().iter().enumerate() {
            let mut free: Vec<f32> = (0..frames).filter(|k| (k + pixel) % 3 == 0).map(|k| value(k, pixel)).collect();
            free.sort_by(f32::total_cmp);
            assert_eq!(*found, free[free.len() / 2], "pixel {pixel}");
        }
        // The first frame is held throughout, for its windows and channels.
        assert_eq!((pictures.peak(), pictures.reads(), mattes.peak()), (2, 3 * frames + 1, 1));
    }
}
