//! `image.checkerboard`: a checkerboard, to see warps on.
//!
//! **Method** squares from the top left corner.
//!
//! **Source** usual practice.
//!
//! **Fails when** never.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "checks": (type: "image.checkerboard", size: (640, 360)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, PerFrame};

use super::{Picture, generated, premultiplied};
use crate::algo::generate::checkerboard;

/// A checkerboard, to see warps on.
#[derive(Node)]
#[node(
    id = "image.checkerboard",
    version = 1,
    outputs = Picture,
    example = "\"checks\": (type: \"image.checkerboard\", size: (640, 360))"
)]
pub(crate) struct ImageCheckerboard {
    /// Width and height.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// Side of a square, across and down.
    #[input(default = (32.0, 32.0), range = 1.0..=65536.0, unit = "px")]
    squares: [f64; 2],
    /// The first colour, as light, not premultiplied.
    #[input(default = (0.1, 0.1, 0.1, 1.0))]
    first: [f64; 4],
    /// The second colour.
    #[input(default = (0.5, 0.5, 0.5, 1.0))]
    second: [f64; 4],
}

impl PerFrame for ImageCheckerboard {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let (first, second) = (premultiplied(self.first), premultiplied(self.second));
        generated(self.size, |samples, window| checkerboard(&first, &second, self.squares, samples, window))
    }
}
