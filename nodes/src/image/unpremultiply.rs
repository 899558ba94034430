//! `image.unpremultiply`: divides a picture by its alpha.
//!
//! **Method** the way back of `image.premultiply`; where alpha is 0 the colours stay.
//!
//! **Source** T. Porter, T. Duff, Compositing Digital Images, 1984.
//!
//! **Fails when** never; without alpha nothing changes.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "straight": (type: "image.unpremultiply", image: "@plate"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::Picture;
use crate::algo::grade::unpremultiply;
use crate::data::Image;

/// Divides a picture by its alpha.
#[derive(Node)]
#[node(
    id = "image.unpremultiply",
    version = 1,
    outputs = Picture,
    source = "T. Porter, T. Duff, Compositing Digital Images, 1984",
    example = "\"straight\": (type: \"image.unpremultiply\", image: \"@plate\")"
)]
pub(crate) struct ImageUnpremultiply {
    /// The picture.
    image: In<Image>,
}

impl PerFrame for ImageUnpremultiply {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let mut image = self.image.into_owned()?;
        if let Some(alpha) = image.alpha() {
            let channels = image.n_channels();
            unpremultiply(image.samples_mut(), channels, alpha);
        }
        Ok(Picture { image })
    }
}
