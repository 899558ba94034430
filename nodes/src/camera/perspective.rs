//! `camera.perspective`: a camera that sees what is near larger.
//!
//! **Method** an orbit about a target, then the perspective projection of glTF 2.0, section 3.10.3.4.
//!
//! **Source** Khronos, *glTF 2.0 Specification*.
//!
//! **Fails when** an angle is not finite, the field of view is not within 0 to 180 degrees, or `near` is not within 0 to `far`.
//!
//! **Cost** O(1).
//!
//! ```ron
//! "camera": (type: "camera.perspective", azimuth_deg: 30.0, fov_deg: 35.0, distance: 5.0, size: (1280, 720), target: (0.0, 1.0, 0.0)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, PerFrame};

use super::{Made, depths, made, setting, size_of};
use crate::algo::camera::{Orbit, perspective};

/// A camera that sees what is near larger.
#[derive(Node)]
#[node(
    id = "camera.perspective",
    version = 1,
    outputs = Made,
    source = "Khronos, glTF 2.0, section 3.10.3.4",
    example = "\"camera\": (type: \"camera.perspective\", azimuth_deg: 30.0, fov_deg: 35.0, distance: 5.0, size: (1280, 720))"
)]
pub(crate) struct CameraPerspective {
    /// Angle about the vertical: at 0 the camera stands on +z and looks along −z, at 90 it stands on +x.
    #[input(default = 0.0, unit = "°")]
    azimuth_deg: f64,
    /// Angle above the horizon; at 90 it looks straight down, with −z at the top where the azimuth is 0.
    #[input(default = 0.0, unit = "°")]
    elevation_deg: f64,
    /// Turn of the camera about its own axis, anticlockwise for whoever holds it.
    #[input(default = 0.0, unit = "°")]
    roll_deg: f64,
    /// Angle from the top of the picture to its bottom.
    #[input(default = 40.0, range = 0.001..=179.0, unit = "°")]
    fov_deg: f64,
    /// Width and height of the picture.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// The point in the middle of the picture.
    #[input(default = (0.0, 0.0, 0.0), unit = "m")]
    target: [f64; 3],
    /// From the target to the camera.
    #[input(default = 5.0, unit = "m")]
    distance: f64,
    /// The least depth that is seen.
    #[input(default = 0.01, range = 1e-9..=1e9, unit = "m")]
    near: f64,
    /// The depth at 1 in clip space. What lies beyond is drawn all the same.
    #[input(default = 1000.0, unit = "m")]
    far: f64,
}

impl PerFrame for CameraPerspective {
    fn run(self, _cx: &Context) -> Result<Made, NodeError> {
        depths(self.near, self.far, f64::MIN_POSITIVE)?;
        if !(self.fov_deg > 0.0 && self.fov_deg < 180.0) {
            return Err(setting("a field of view of more than 0 and less than 180 degrees", self.fov_deg.to_string()));
        }
        let orbit = Orbit {
            target: self.target,
            azimuth: self.azimuth_deg.to_radians(),
            elevation: self.elevation_deg.to_radians(),
            roll: self.roll_deg.to_radians(),
            distance: self.distance,
        };
        made(orbit, perspective(self.fov_deg.to_radians(), size_of(self.size), self.near, self.far), self.size)
    }
}
