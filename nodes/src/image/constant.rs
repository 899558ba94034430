//! `image.constant`: a picture of one colour.
//!
//! **Method** every pixel alike.
//!
//! **Source** usual practice.
//!
//! **Fails when** never.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "grey": (type: "image.constant", size: (640, 360), color: (0.18, 0.18, 0.18, 1.0)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, PerFrame};

use super::{Picture, generated, premultiplied};
use crate::algo::generate::constant;

/// A picture of one colour.
#[derive(Node)]
#[node(
    id = "image.constant",
    version = 1,
    outputs = Picture,
    example = "\"grey\": (type: \"image.constant\", size: (640, 360), color: (0.18, 0.18, 0.18, 1.0))"
)]
pub(crate) struct ImageConstant {
    /// Width and height.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// The colour, as light: red, green, blue, alpha, not premultiplied.
    #[input(default = (0.0, 0.0, 0.0, 1.0))]
    color: [f64; 4],
}

impl PerFrame for ImageConstant {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        generated(self.size, |samples, _| constant(&premultiplied(self.color), samples))
    }
}
