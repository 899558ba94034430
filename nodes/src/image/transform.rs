//! `image.transform`: moves, turns, scales and shears a picture about a centre.
//!
//! **Method** scale, then shear, then rotation about `center`, then translation, as one affine map: see [`crate::algo::warp_affine`].
//!
//! **Source** usual practice.
//!
//! **Fails when** a scale is nought: the picture is gone.
//!
//! **Cost** O(pixels of the result × taps²).
//!
//! ```ron
//! "moved": (type: "image.transform", image: "@hat", rotate_deg: 12.0, scale: (1.0, 0.8), center: (160.0, 120.0)),
//! ```

use nalgebra::{Matrix2, Vector2};
use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Picture, warped};
use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Filter, Outside, WarpOptions};
use crate::data::Image;

/// Moves, turns, scales and shears a picture about a centre.
#[derive(Node)]
#[node(
    id = "image.transform",
    version = 1,
    outputs = Picture,
    example = "\"moved\": (type: \"image.transform\", image: \"@hat\", rotate_deg: 12.0, scale: (1.0, 0.8), center: (160.0, 120.0))"
)]
pub(crate) struct ImageTransform {
    /// The picture.
    image: In<Image>,
    /// Translation, to the right and down.
    #[input(default = (0.0, 0.0), unit = "px")]
    translate: [f64; 2],
    /// Rotation, clockwise as seen on screen. Wire a curve to animate it.
    #[input(default = 0.0, unit = "deg")]
    rotate_deg: f64,
    /// Scale across and down; negative mirrors.
    #[input(default = (1.0, 1.0), range = -10000.0..=10000.0)]
    scale: [f64; 2],
    /// How far x moves to the right a unit down.
    #[input(default = 0.0, range = -100.0..=100.0)]
    shear: f64,
    /// The point that scale, shear and rotation leave where it is, from the top left corner.
    #[input(default = (0.0, 0.0), unit = "px")]
    center: [f64; 2],
    /// How the picture is read between its pixels.
    #[input(default = cubic)]
    filter: Filter,
    /// Widens the filter where the picture shrinks.
    #[input(default = true)]
    antialias: bool,
    /// True keeps all of the moved picture; false cuts it at the display window.
    #[input(default = true)]
    expand: bool,
}

impl PerFrame for ImageTransform {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let (sin, cos) = libm::sincos(self.rotate_deg.to_radians());
        let [sx, sy] = self.scale;
        let linear = Matrix2::new(cos, -sin, sin, cos) * Matrix2::new(sx, self.shear * sy, 0.0, sy);
        let center = Vector2::from(self.center);
        let offset = center + Vector2::from(self.translate) - linear * center;
        let motion = Affine::new(linear.m11, linear.m12, offset.x, linear.m21, linear.m22, offset.y);
        let options = WarpOptions { filter: self.filter, outside: Outside::Transparent, antialias: self.antialias };
        warped(&self.image, &motion, options, self.expand)
    }
}
