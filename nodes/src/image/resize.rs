//! `image.resize`: scales a picture to a size.
//!
//! **Method** see [`crate::algo::filter`]: area means, or a reconstruction filter widened where the picture shrinks.
//!
//! **Source** usual practice.
//!
//! **Fails when** a side is nought.
//!
//! **Cost** O(samples of both).
//!
//! ```ron
//! "half": (type: "image.resize", image: "@plate", size: (320, 180)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Picture, picture, refused, warped};
use crate::algo::filter::{ResizeFilter, resize};
use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Filter, Source, WarpOptions};
use crate::algo::window::Window;
use crate::data::Image;

/// Scales a picture to a size.
#[derive(Node)]
#[node(
    id = "image.resize",
    version = 1,
    outputs = Picture,
    example = "\"half\": (type: \"image.resize\", image: \"@plate\", size: (320, 180))"
)]
pub(crate) struct ImageResize {
    /// The picture.
    image: In<Image>,
    /// New width and height of the display window.
    #[input(unit = "px", range = 1..=65536)]
    size: [i64; 2],
    /// How the picture is read between its pixels.
    #[input(default = cubic)]
    filter: Filter,
}

impl PerFrame for ImageResize {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let (own, display) = (self.image.data_window(), self.image.display_window());
        let [width, height] = self.size.map(|n| usize::try_from(n).unwrap_or(0));
        let across = width as f64 / display.width.max(1) as f64;
        let down = height as f64 / display.height.max(1) as f64;
        let target = Window::at_origin(width, height);
        if own == display {
            let mut samples = vec![0.0; target.samples(self.image.n_channels()).unwrap_or(0)];
            let source = Source::new(self.image.raster(), [own.x, own.y]);
            resize(source, ResizeFilter::Kernel(self.filter), &mut samples, width, height).map_err(refused)?;
            return picture(&self.image, target, target, samples);
        }
        let motion = Affine::new(across, 0.0, -across * display.x as f64, 0.0, down, -down * display.y as f64);
        let out = warped(&self.image, &motion, WarpOptions { filter: self.filter, ..WarpOptions::default() }, true)?;
        let data = out.image.data_window();
        Ok(Picture { image: out.image.with_windows(data, target) })
    }
}
