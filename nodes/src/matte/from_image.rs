//! `matte.from_image`: a channel of a picture as a matte.
//!
//! **Method** the channel, or the luma as it is seen on screen, through a ramp of width `softness` about `threshold`: `(v - threshold) / softness + 1/2`,
//! cut to 0 to 1. A threshold of 0.5 with a softness of 1 keeps the values.
//!
//! **Source** usual practice; luma by the weights of ITU-R BT.709.
//!
//! **Fails when** the layer is no brighter (or darker, with `invert`) than its ground.
//!
//! **Cost** O(pixels).
//!
//! ```ron
//! "ink": (type: "matte.from_image", image: "@plate", channel: luma, threshold: 0.5, softness: 0.2, invert: true),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::color::srgb_from_linear;
use crate::data::{Image, Matte};

/// Which value of a pixel is the matte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Channel {
    /// Alpha where the picture has one, else luma.
    Auto,
    /// Alpha; all of a picture without one.
    Alpha,
    /// How bright it is on screen.
    Luma,
    /// The first channel on screen.
    Red,
    /// The second channel on screen.
    Green,
    /// The third channel on screen.
    Blue,
}

/// A channel of a picture as a matte: the alpha of a sprite, ink by its darkness, a matte that was read from files.
#[derive(Node)]
#[node(
    id = "matte.from_image",
    version = 1,
    outputs = MatteFromImageOutputs,
    source = "ITU-R BT.709 (luma weights)",
    example = "\"ink\": (type: \"matte.from_image\", image: \"@plate\", channel: luma, threshold: 0.5, softness: 0.2, invert: true)"
)]
pub(crate) struct MatteFromImage {
    /// The picture. A colour lies on black where it is transparent.
    image: In<Image>,
    /// What is taken of each pixel.
    #[input(default = auto)]
    channel: Channel,
    /// The value that becomes one half.
    #[input(default = 0.5, range = 0.0..=1.0)]
    threshold: f64,
    /// Width of the ramp from 0 to 1 about the threshold. 1 about 0.5 keeps the values, 0 is a hard cut.
    #[input(default = 1.0, range = 0.0..=2.0)]
    softness: f64,
    /// Dark is the layer.
    #[input(default = false)]
    invert: bool,
}

/// The matte.
#[derive(Outputs)]
pub(crate) struct MatteFromImageOutputs {
    /// Coverage, 0 to 1, in the picture's format.
    alpha: Matte,
}

/// The value of a pixel that the matte is made of, 0 to 1 on screen.
fn value_of(pixel: &[f32], alpha: Option<usize>, channel: Channel) -> f64 {
    let colours = pixel.len() - usize::from(alpha.is_some());
    let colour = |i: usize| f64::from(pixel.get(if colours < 3 { 0 } else { i }).copied().unwrap_or(0.0));
    let luma = || 0.2126 * colour(0) + 0.7152 * colour(1) + 0.0722 * colour(2);
    let linear = match (channel, alpha) {
        (Channel::Auto | Channel::Alpha, Some(a)) => return f64::from(pixel[a]),
        (Channel::Alpha, None) => return 1.0,
        (Channel::Auto | Channel::Luma, _) => luma(),
        (Channel::Red, _) => colour(0),
        (Channel::Green, _) => colour(1),
        (Channel::Blue, _) => colour(2),
    };
    srgb_from_linear(linear)
}

impl MatteFromImage {
    fn coverage(&self, value: f64) -> f32 {
        let ramp =
            if self.softness > 0.0 { (value - self.threshold) / self.softness + 0.5 } else { f64::from(u8::from(value >= self.threshold)) };
        // Not-a-number is outside, whichever way round.
        let inside = if ramp.is_nan() { 0.0 } else { ramp.clamp(0.0, 1.0) };
        (if self.invert && !ramp.is_nan() { 1.0 - inside } else { inside }) as f32
    }
}

impl PerFrame for MatteFromImage {
    fn run(self, _cx: &Context) -> Result<MatteFromImageOutputs, NodeError> {
        let picture = self.image.in_display()?;
        let alpha = picture.alpha();
        if picture.n_channels() == 0 {
            return Err(NodeError::input("expected a picture with channels, found none"));
        }
        let pixels = picture.samples().chunks_exact(picture.n_channels());
        let matte: Vec<f32> = pixels.map(|p| self.coverage(value_of(p, alpha, self.channel))).collect();
        let alpha = Matte::new(picture.width(), picture.height(), matte)
            .ok_or_else(|| NodeError::internal("a matte of another size than its picture"))?;
        Ok(MatteFromImageOutputs { alpha })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_told_apart() {
        let pixel = [0.2, 0.4, 0.6, 0.5];
        assert_eq!(value_of(&pixel, Some(3), Channel::Auto), 0.5);
        assert_eq!(value_of(&pixel[..3], None, Channel::Alpha), 1.0);
        assert!((value_of(&pixel, Some(3), Channel::Green) - srgb_from_linear(f64::from(0.4f32))).abs() < 1e-12);
        // 18 % grey is seen as 0.4613 of white.
        for grey in [&[0.18f32][..], &[0.18, 1.0], &[0.18, 0.18, 0.18]] {
            let alpha = (grey.len() == 2).then_some(1);
            assert!((value_of(grey, alpha, Channel::Luma) - 0.4613).abs() < 1e-3);
        }
        assert!(value_of(&[f32::NAN], None, Channel::Luma).is_nan());
    }
}
