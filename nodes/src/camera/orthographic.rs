//! `camera.orthographic`: a camera whose lines of sight are parallel.
//!
//! **Method** an orbit about a target, then the orthographic projection of glTF 2.0, section 3.10.3.2.
//!
//! **Source** Jain, Sheikh, Hodgins, *Leveraging the Talent of Hand Animators to Create Three-Dimensional Animation*, 2009, section 3 (the
//! animator's camera); Khronos, *glTF 2.0 Specification*.
//!
//! **Fails when** an angle is not finite, the scale is not positive, or `near` is not below `far`.
//!
//! **Cost** O(1).
//!
//! ```ron
//! "camera": (type: "camera.orthographic", azimuth_deg: 30.0, elevation_deg: 10.0, scale: 240.0, size: (1280, 720), target: (0.0, 1.0, 0.0)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, NodeError, PerFrame};

use super::{Made, depths, made, setting, size_of};
use crate::algo::camera::{Orbit, orthographic};

/// A camera whose lines of sight are parallel.
#[derive(Node)]
#[node(
    id = "camera.orthographic",
    version = 1,
    outputs = Made,
    source = "Khronos, glTF 2.0, section 3.10.3.2",
    example = "\"camera\": (type: \"camera.orthographic\", azimuth_deg: 30.0, elevation_deg: 10.0, scale: 240.0, size: (1280, 720))"
)]
pub(crate) struct CameraOrthographic {
    /// Angle about the vertical: at 0 the camera stands on +z and looks along −z, at 90 it stands on +x.
    #[input(default = 0.0, unit = "°")]
    azimuth_deg: f64,
    /// Angle above the horizon; at 90 it looks straight down, with −z at the top where the azimuth is 0.
    #[input(default = 0.0, unit = "°")]
    elevation_deg: f64,
    /// Turn of the camera about its own axis, anticlockwise for whoever holds it.
    #[input(default = 0.0, unit = "°")]
    roll_deg: f64,
    /// Pixels a metre.
    #[input(default = 100.0, range = 0.0..=1e9, unit = "px/m")]
    scale: f64,
    /// Width and height of the picture.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// The point in the middle of the picture.
    #[input(default = (0.0, 0.0, 0.0), unit = "m")]
    target: [f64; 3],
    /// From the target to the camera: nothing that is seen depends on it, but the depths do.
    #[input(default = 10.0, unit = "m")]
    distance: f64,
    /// The least depth that is seen. What lies behind the camera is seen too where it is negative.
    #[input(default = 0.01, unit = "m")]
    near: f64,
    /// The depth at 1 in clip space. What lies beyond is drawn all the same.
    #[input(default = 1000.0, unit = "m")]
    far: f64,
}

impl PerFrame for CameraOrthographic {
    fn run(self, _cx: &Context) -> Result<Made, NodeError> {
        depths(self.near, self.far, f64::NEG_INFINITY)?;
        if !(self.scale > 0.0 && self.scale.is_finite()) {
            return Err(setting("a scale above 0", self.scale.to_string()));
        }
        let orbit = Orbit {
            target: self.target,
            azimuth: self.azimuth_deg.to_radians(),
            elevation: self.elevation_deg.to_radians(),
            roll: self.roll_deg.to_radians(),
            distance: self.distance,
        };
        made(orbit, orthographic(self.scale, size_of(self.size), self.near, self.far), self.size)
    }
}
