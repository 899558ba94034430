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

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Filter, Outside, Source, WarpOptions, bounds, warp_affine};
use crate::data::{Affine2, Image};

/// Moves a picture by an affine motion.
#[derive(Node)]
#[node(
    id = "image.warp_affine",
    version = 1,
    outputs = ImageWarpAffineOutputs,
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

/// The moved picture.
#[derive(Outputs)]
pub(crate) struct ImageWarpAffineOutputs {
    /// It, in a data window that holds it.
    image: Image,
}

impl PerFrame for ImageWarpAffine {
    fn run(self, _cx: &Context) -> Result<ImageWarpAffineOutputs, NodeError> {
        let options = WarpOptions { filter: self.filter, outside: self.outside, antialias: self.antialias };
        let motion = Affine::from(&*self.motion);
        let refused = |e: crate::algo::warp_affine::WarpError| NodeError::input(e.to_string());
        let window = self.image.data_window();
        let display = self.image.display_window();
        let mut target = bounds(window, &motion, options).map_err(refused)?;
        if !self.expand || self.outside == Outside::Clamp {
            target = if self.outside == Outside::Clamp { display } else { target.intersect(&display) };
        }
        let channels = self.image.n_channels();
        let len = target
            .samples(channels)
            .ok_or_else(|| NodeError::input("expected a picture that fits into memory, found one that does not"))?;
        let mut samples = vec![0.0; len];
        let source = Source::new(self.image.raster(), [window.x, window.y]);
        warp_affine(source, &motion, options, &mut samples, target).map_err(refused)?;
        let image = Image::new(target.width, target.height, channels, samples)
            .ok_or_else(|| NodeError::internal("a picture of another size than its window"))?;
        Ok(ImageWarpAffineOutputs { image: image.with_channels(self.image.channels()).with_windows(target, display) })
    }
}
