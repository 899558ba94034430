//! `image.premultiply`: multiplies a picture by its alpha.
//!
//! **Method** for pictures that were read as `data`; all others are premultiplied already.
//!
//! **Source** T. Porter, T. Duff, Compositing Digital Images, 1984.
//!
//! **Fails when** never; without alpha nothing changes.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "pre": (type: "image.premultiply", image: "@plate"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::Picture;
use crate::algo::grade::premultiply;
use crate::data::Image;

/// Multiplies a picture by its alpha.
#[derive(Node)]
#[node(
    id = "image.premultiply",
    version = 1,
    outputs = Picture,
    source = "T. Porter, T. Duff, Compositing Digital Images, 1984",
    example = "\"pre\": (type: \"image.premultiply\", image: \"@plate\")"
)]
pub(crate) struct ImagePremultiply {
    /// The picture.
    image: In<Image>,
}

impl PerFrame for ImagePremultiply {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let mut image = self.image.into_owned()?;
        if let Some(alpha) = image.alpha() {
            let channels = image.n_channels();
            premultiply(image.samples_mut(), channels, alpha);
        }
        Ok(Picture { image })
    }
}
