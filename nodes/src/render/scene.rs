//! What drawings of meshes have in common: meshes put together, cameras, lights.

use nalgebra::Vector3;
use pegbar_engine::node::{Fault, In, NodeError};

use crate::algo::camera;
use crate::algo::surface::{Part, Surface};
use crate::data::{Camera, Mesh};

/// The meshes as one surface, whose parts they are.
///
/// Without `edges` it may have none, which is quicker and enough for fills.
pub(super) fn surface_of(meshes: &[In<Mesh>], hard_deg: f64, edges: bool) -> Result<Surface, NodeError> {
    for (i, mesh) in meshes.iter().enumerate() {
        mesh.validate().map_err(|e| NodeError::input(format!("mesh {i}: {e}")))?;
    }
    let parts: Vec<Part<'_>> =
        meshes.iter().map(|m| Part { positions: &m.positions, triangles: &m.triangles, normals: &m.normals }).collect();
    let made = if edges { Surface::new } else { Surface::without_edges };
    made(&parts, hard_deg.to_radians()).map_err(|e| NodeError::input(e.to_string()))
}

/// A camera that can see.
pub(crate) fn seen_by(camera: &Camera) -> Result<camera::Camera, NodeError> {
    camera::Camera::try_from(camera).map_err(|e| NodeError::input(format!("camera: {e}")))
}

/// The direction of a light, of length one.
pub(super) fn toward_light(light: [f64; 3]) -> Result<Vector3<f64>, NodeError> {
    let direction = Vector3::from(light);
    direction.try_normalize(1e-12).filter(|d| d.iter().all(|v| v.is_finite())).ok_or_else(|| {
        let [x, y, z] = light;
        NodeError::new(Fault::Parameters, format!("expected a light from some direction, found ({x}, {y}, {z})"))
    })
}
