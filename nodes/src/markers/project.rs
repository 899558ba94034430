//! `markers.project`: markers of the world as a camera sees them.
//!
//! **Method** x = R X, each marker by itself. What lies behind a perspective camera, or in the plane of its eye, is not seen: NaN, as is what is not known
//! in the world. An orthographic camera has no behind.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.3 (x_2D = R X_3D).
//!
//! **Fails when** the camera is none.
//!
//! **Cost** O(markers).
//!
//! ```ron
//! "seen": (type: "markers.project", markers: "@markers", camera: "@camera"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use crate::algo::camera;
use crate::data::{Camera, Markers2, Markers3};

/// Markers of the world as a camera sees them.
#[derive(Node)]
#[node(
    id = "markers.project",
    version = 1,
    outputs = MarkersProjectOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.3",
    example = "\"seen\": (type: \"markers.project\", markers: \"@markers\", camera: \"@camera\")"
)]
pub(crate) struct MarkersProject {
    /// The markers.
    markers: In<Markers3>,
    /// What sees them.
    camera: In<Camera>,
}

/// The markers in the picture.
#[derive(Outputs)]
pub(crate) struct MarkersProjectOutputs {
    /// Pixels; outside the picture too, NaN behind the camera.
    markers: Markers2,
}

/// Where a point is seen; NaN where it is not.
pub(crate) fn seen(camera: &camera::Camera, point: [f64; 3]) -> [f64; 2] {
    let [x, y, depth] = camera.project(point);
    let is_seen = (camera.is_orthographic() || depth > 0.0) && x.is_finite() && y.is_finite();
    if is_seen { [x, y] } else { [f64::NAN; 2] }
}

impl PerFrame for MarkersProject {
    fn run(self, _cx: &Context) -> Result<MarkersProjectOutputs, NodeError> {
        let camera = camera::Camera::try_from(&*self.camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let points = self.markers.points.iter().map(|p| seen(&camera, *p)).collect();
        Ok(MarkersProjectOutputs { markers: Markers2 { points, names: self.markers.names.clone() } })
    }
}
