//! `image.sharpen`: sharpens a picture.
//!
//! **Method** unsharp mask: the picture and `amount` of what a Gaussian blur takes from it.
//!
//! **Source** usual practice.
//!
//! **Fails when** the size is no length.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "crisp": (type: "image.sharpen", image: "@plate", amount: 0.5),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Picture, made, refused};
use crate::algo::filter::unsharp;
use crate::algo::warp_affine::Outside;
use crate::data::Image;

/// Sharpens a picture.
#[derive(Node)]
#[node(
    id = "image.sharpen",
    version = 1,
    outputs = Picture,
    example = "\"crisp\": (type: \"image.sharpen\", image: \"@plate\", amount: 0.5)"
)]
pub(crate) struct ImageSharpen {
    /// The picture.
    image: In<Image>,
    /// Standard deviation of the blur: how large the details are that are raised.
    #[input(default = 1.0, range = 0.0..=10000.0, unit = "px")]
    size: f64,
    /// How much they are raised: 0 not at all, 1 doubles them; negative softens.
    #[input(default = 0.5, range = -1.0..=100.0)]
    amount: f64,
}

impl PerFrame for ImageSharpen {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let window = self.image.data_window();
        let amount = self.amount as f32;
        made(&self.image, window, |source, target| unsharp(source, self.size, amount, Outside::Clamp, target, window).map_err(refused))
    }
}
