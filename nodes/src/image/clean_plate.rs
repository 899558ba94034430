//! `image.clean_plate`: the ground of footage whose camera stands still, without the layer that moves in front.
//!
//! **Method** each pixel is the median, channel by channel, of the frames in which the matte leaves it free; where none does, of those that it covers least.
//!
//! **Source** usual practice.
//!
//! **Fails when** the camera moves, or pictures and mattes have different sizes.
//!
//! **Cost** O(frames × pixels).
//!
//! ```ron
//! "clean": (type: "image.clean_plate", image: "@plate", matte: "@matte"),
//! ```

use std::cmp::Ordering;
use std::sync::Arc;

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, Sequence, Whole};

use super::Picture;
use crate::data::{Image, Matte};

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
        let total = self.image.len();
        let used = total.min(self.frames as usize);
        let mut pictures = Vec::with_capacity(used);
        let mut mattes = Vec::with_capacity(used);
        for k in (0..used).map(|k| k * total / used) {
            pictures.push(self.image.get(k)?);
            mattes.push(self.matte.get(if self.matte.len() == 1 { 0 } else { k })?);
        }
        let Some(first) = pictures.first().cloned() else { return Err(NodeError::input("expected at least one frame, found none")) };
        for (picture, matte) in pictures.iter().zip(&mattes) {
            let (w, h, c) = (first.width(), first.height(), first.n_channels());
            if (picture.width(), picture.height(), picture.n_channels()) != (w, h, c) || (matte.width(), matte.height()) != (w, h) {
                return Err(NodeError::input(format!("expected pictures and mattes of {w} x {h} throughout, found another size")));
            }
        }
        let mut samples = Vec::with_capacity(first.samples().len());
        for row in 0..first.height() {
            cx.check()?;
            for pixel in row * first.width()..(row + 1) * first.width() {
                self.push_pixel(&pictures, &mattes, pixel, &mut samples);
            }
        }
        let image = first.with_samples(samples).ok_or_else(|| NodeError::internal("a plate of another size than its footage"))?;
        Ok(Picture { image })
    }
}

impl ImageCleanPlate {
    fn push_pixel(&self, pictures: &[Arc<Image>], mattes: &[Arc<Matte>], pixel: usize, samples: &mut Vec<f32>) {
        let least = mattes.iter().map(|m| m.alpha()[pixel]).fold(f32::INFINITY, f32::min);
        let limit = least.max(self.threshold as f32);
        let channels = pictures[0].n_channels();
        for c in 0..channels {
            // A matte value that is no number covers nothing, so that some frame is always left.
            let free = pictures.iter().zip(mattes).filter(|(_, m)| m.alpha()[pixel].partial_cmp(&limit) != Some(Ordering::Greater));
            let mut values: Vec<f32> = free.map(|(p, _)| p.samples()[pixel * channels + c]).collect();
            let middle = values.len() / 2;
            samples.push(*values.select_nth_unstable_by(middle, f32::total_cmp).1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pegbar_engine::clock::Clock;
    use pegbar_engine::node::{Arg, Cancel, Input, SequenceRef};
    use pegbar_engine::value::ValueRef;

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
}
