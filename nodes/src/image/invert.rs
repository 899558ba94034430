//! `image.invert`: turns black into white.
//!
//! **Method** each colour c becomes a - c, which is 1 - c where the picture is opaque; alpha stays.
//!
//! **Source** usual practice.
//!
//! **Fails when** never.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "negative": (type: "image.invert", image: "@plate"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::Picture;
use crate::data::Image;

/// Turns black into white.
#[derive(Node)]
#[node(
    id = "image.invert",
    version = 1,
    outputs = Picture,
    example = "\"negative\": (type: \"image.invert\", image: \"@plate\")"
)]
pub(crate) struct ImageInvert {
    /// The picture.
    image: In<Image>,
}

impl PerFrame for ImageInvert {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let mut image = self.image.into_owned()?;
        let (channels, alpha) = (image.n_channels(), image.alpha());
        for pixel in image.samples_mut().chunks_exact_mut(channels.max(1)) {
            let white = alpha.map_or(1.0, |a| pixel[a]);
            for (c, v) in pixel.iter_mut().enumerate() {
                *v = if Some(c) == alpha { *v } else { white - *v };
            }
        }
        Ok(Picture { image })
    }
}
