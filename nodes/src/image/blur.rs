//! `image.blur`: blurs a picture.
//!
//! **Method** see [`crate::algo::filter`]: a Gaussian, or a box.
//!
//! **Source** usual practice.
//!
//! **Fails when** the size is no length.
//!
//! **Cost** O(samples), whatever the size beyond 4 px.
//!
//! ```ron
//! "soft": (type: "image.blur", image: "@plate", size: (4.0, 4.0)),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Setting};

use super::{Picture, made, refused};
use crate::algo::filter::{box_blur, gaussian_blur, gaussian_reach};
use crate::algo::warp_affine::Outside;
use crate::data::Image;

/// What a blur weighs its neighbours with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Kernel {
    /// A bell: `size` is its standard deviation.
    Gaussian,
    /// All alike: `size` is the side.
    Box,
}

/// Blurs a picture.
#[derive(Node)]
#[node(
    id = "image.blur",
    version = 1,
    outputs = Picture,
    example = "\"soft\": (type: \"image.blur\", image: \"@plate\", size: (4.0, 4.0))"
)]
pub(crate) struct ImageBlur {
    /// The picture.
    image: In<Image>,
    /// Standard deviation of the Gaussian, or side of the box, across and down. 0 blurs nothing.
    #[input(default = (2.0, 2.0), range = 0.0..=10000.0, unit = "px")]
    size: [f64; 2],
    /// The kernel.
    #[input(default = gaussian)]
    kernel: Kernel,
    /// What lies outside the picture.
    #[input(default = transparent)]
    outside: Outside,
    /// True grows the data window by the blur's reach.
    #[input(default = true)]
    expand: bool,
}

impl PerFrame for ImageBlur {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let own = self.image.data_window();
        let reach = |size: f64| match self.kernel {
            Kernel::Gaussian => gaussian_reach(size),
            Kernel::Box => (size / 2.0).ceil() as usize,
        };
        let grow = self.expand && self.outside == Outside::Transparent;
        let window = if grow { own.grow(reach(self.size[0]), reach(self.size[1])) } else { own };
        let blur = match self.kernel {
            Kernel::Gaussian => gaussian_blur,
            Kernel::Box => box_blur,
        };
        made(&self.image, window, |source, target| blur(source, self.size, self.outside, target, window).map_err(refused))
    }
}
