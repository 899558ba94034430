//! `image.from_matte`: shows a matte as a picture.
//!
//! **Method** one channel of grey, or a colour cut out by the matte.
//!
//! **Source** usual practice.
//!
//! **Fails when** never.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "shown": (type: "image.from_matte", matte: "@matte"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::Picture;
use crate::data::{Image, Matte};

/// Shows a matte as a picture.
#[derive(Node)]
#[node(
    id = "image.from_matte",
    version = 1,
    outputs = Picture,
    example = "\"shown\": (type: \"image.from_matte\", matte: \"@matte\")"
)]
pub(crate) struct ImageFromMatte {
    /// The matte.
    matte: In<Matte>,
    /// True gives one grey channel; false gives `color` cut out by the matte.
    #[input(default = true)]
    grey: bool,
    /// The colour where the matte is 1, as light.
    #[input(default = (1.0, 1.0, 1.0))]
    color: [f64; 3],
}

impl PerFrame for ImageFromMatte {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let (width, height) = (self.matte.width(), self.matte.height());
        let [r, g, b] = self.color.map(|v| v as f32);
        let (channels, samples) = if self.grey {
            (1, self.matte.alpha().to_vec())
        } else {
            (4, self.matte.alpha().iter().flat_map(|&a| [r * a, g * a, b * a, a]).collect())
        };
        let image =
            Image::new(width, height, channels, samples).ok_or_else(|| NodeError::internal("a picture of another size than its matte"))?;
        Ok(Picture { image })
    }
}
