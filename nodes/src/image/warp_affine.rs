//! `image.warp_affine`: moves a picture by an affine motion.
//!
//! **Method** see [`crate::algo::warp_affine`]: inverse mapping with a reconstruction filter, its footprint widened where the map shrinks.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, equation 1.
//!
//! **Fails when** the motion is not finite, or makes a picture of more than four million pixels a side.
//!
//! **Cost** O(pixels of the result × taps²).
//!
//! ```ron
//! "swap": (type: "image.warp_affine", image: "@hat", motion: "@track"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Picture, warped};
use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Filter, Outside, WarpOptions};
use crate::data::{Affine2, Image};

/// Moves a picture by an affine motion.
#[derive(Node)]
#[node(
    id = "image.warp_affine",
    version = 1,
    outputs = Picture,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eq. 1",
    example = "\"swap\": (type: \"image.warp_affine\", image: \"@hat\", motion: \"@track\")"
)]
pub(crate) struct ImageWarpAffine {
    /// The picture.
    image: In<Image>,
    /// Where it goes: result from picture, pixels, origin at the top left corner of the format.
    motion: In<Affine2>,
    /// How the picture is read between its pixels.
    #[input(default = bilinear)]
    filter: Filter,
    /// What lies outside the picture.
    #[input(default = transparent)]
    outside: Outside,
    /// Widens the filter where the motion shrinks the picture, so that nothing crawls.
    #[input(default = true)]
    antialias: bool,
    /// True keeps all of the moved picture; false cuts it at the picture's own display window.
    #[input(default = true)]
    expand: bool,
}

impl PerFrame for ImageWarpAffine {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let options = WarpOptions { filter: self.filter, outside: self.outside, antialias: self.antialias };
        warped(&self.image, &Affine::from(&*self.motion), options, self.expand)
    }
}
