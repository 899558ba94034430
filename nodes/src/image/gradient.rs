//! `image.gradient`: a picture that goes from one colour to another.
//!
//! **Method** in proportion, or eased, along a line or out from a point.
//!
//! **Source** usual practice.
//!
//! **Fails when** never; where `from` and `to` are one point it is the second colour.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "sky": (type: "image.gradient", size: (640, 360), from: (0.0, 0.0), to: (0.0, 360.0)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, PerFrame};

use super::{Picture, generated, premultiplied};
use crate::algo::generate::{Ramp, linear_gradient, radial_gradient};

/// A picture that goes from one colour to another.
#[derive(Node)]
#[node(
    id = "image.gradient",
    version = 1,
    outputs = Picture,
    example = "\"sky\": (type: \"image.gradient\", size: (640, 360), from: (0.0, 0.0), to: (0.0, 360.0))"
)]
pub(crate) struct ImageGradient {
    /// Width and height.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// Where the first colour is: the start of the line, or the centre.
    #[input(default = (0.0, 0.0), unit = "px")]
    from: [f64; 2],
    /// Where the second colour is: the end of the line, or a point on the circle.
    #[input(default = (0.0, 360.0), unit = "px")]
    to: [f64; 2],
    /// The first colour, as light, not premultiplied.
    #[input(default = (0.0, 0.0, 0.0, 1.0))]
    first: [f64; 4],
    /// The second colour.
    #[input(default = (1.0, 1.0, 1.0, 1.0))]
    second: [f64; 4],
    /// How it goes from one to the other.
    #[input(default = linear)]
    ramp: Ramp,
    /// True spreads it out from a point.
    #[input(default = false)]
    radial: bool,
}

impl PerFrame for ImageGradient {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let (first, second) = (premultiplied(self.first), premultiplied(self.second));
        let radius = libm::hypot(self.to[0] - self.from[0], self.to[1] - self.from[1]);
        generated(self.size, |samples, window| {
            if self.radial {
                radial_gradient(&first, &second, self.from, [radius; 2], self.ramp, samples, window);
            } else {
                linear_gradient(&first, &second, self.from, self.to, self.ramp, samples, window);
            }
        })
    }
}
