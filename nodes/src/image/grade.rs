//! `image.grade`: grades a picture: black and white point, lift, gain, multiply, offset, gamma.
//!
//! **Method** see [`crate::algo::grade`], in that order; colours are taken out of their premultiplication while they are graded.
//!
//! **Source** usual practice.
//!
//! **Fails when** a gamma is not positive, or black point and white point are one.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "graded": (type: "image.grade", image: "@plate", gamma: (1.2, 1.2, 1.2, 1.0)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Picture, refused};
use crate::algo::grade::{Grade, grade, premultiply, unpremultiply};
use crate::data::Image;

/// Grades a picture: black and white point, lift, gain, multiply, offset, gamma.
#[derive(Node)]
#[node(
    id = "image.grade",
    version = 1,
    outputs = Picture,
    example = "\"graded\": (type: \"image.grade\", image: \"@plate\", gamma: (1.2, 1.2, 1.2, 1.0))"
)]
pub(crate) struct ImageGrade {
    /// The picture.
    image: In<Image>,
    /// Value that becomes `lift`.
    #[input(default = (0.0, 0.0, 0.0, 0.0))]
    black_point: [f64; 4],
    /// Value that becomes `gain`.
    #[input(default = (1.0, 1.0, 1.0, 1.0))]
    white_point: [f64; 4],
    /// What black becomes.
    #[input(default = (0.0, 0.0, 0.0, 0.0))]
    lift: [f64; 4],
    /// What white becomes.
    #[input(default = (1.0, 1.0, 1.0, 1.0))]
    gain: [f64; 4],
    /// Factor.
    #[input(default = (1.0, 1.0, 1.0, 1.0))]
    multiply: [f64; 4],
    /// Added after the factor.
    #[input(default = (0.0, 0.0, 0.0, 0.0))]
    offset: [f64; 4],
    /// Above 1 lifts the middle, below 1 lowers it.
    #[input(default = (1.0, 1.0, 1.0, 1.0), range = 0.001..=1000.0)]
    gamma: [f64; 4],
    /// Grade the alpha channel too, by the fourth number of each.
    #[input(default = false)]
    alpha: bool,
    /// Results below 0 become 0.
    #[input(default = true)]
    clamp_black: bool,
    /// Results above 1 become 1.
    #[input(default = false)]
    clamp_white: bool,
}

impl PerFrame for ImageGrade {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let f = |v: [f64; 4]| v.map(|x| x as f32);
        let settings = Grade {
            black_point: f(self.black_point),
            white_point: f(self.white_point),
            lift: f(self.lift),
            gain: f(self.gain),
            multiply: f(self.multiply),
            offset: f(self.offset),
            gamma: f(self.gamma),
            clamp_black: self.clamp_black,
            clamp_white: self.clamp_white,
        };
        let mut image = self.image.into_owned()?;
        let (channels, alpha) = (image.n_channels(), image.alpha());
        let graded = if self.alpha { channels } else { alpha.unwrap_or(channels) };
        if let Some(alpha) = alpha {
            unpremultiply(image.samples_mut(), channels, alpha);
        }
        grade(image.samples_mut(), channels, graded, &settings).map_err(refused)?;
        if let Some(alpha) = alpha {
            premultiply(image.samples_mut(), channels, alpha);
        }
        Ok(Picture { image })
    }
}
