//! `mesh.smooth`: a mesh without its bumps, of the same volume.
//!
//! **Method** every vertex moves to the mean of its neighbours; then all move out along their normals by the one distance that restores the volume.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2.
//!
//! **Fails when** a position is not finite. The rims of an open mesh stay where they are.
//!
//! **Cost** O(vertices) an iteration.
//!
//! ```ron
//! "smooth": (type: "mesh.smooth", mesh: "@skin", iterations: 2),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use crate::algo::fairing::Fair;
use crate::algo::surface::{Part, Surface};
use crate::data::Mesh;

/// A mesh without its bumps, of the same volume.
#[derive(Node)]
#[node(
    id = "mesh.smooth",
    version = 1,
    outputs = MeshSmoothOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.2",
    example = "\"smooth\": (type: \"mesh.smooth\", mesh: \"@skin\", iterations: 2)"
)]
pub(crate) struct MeshSmooth {
    /// The mesh.
    pub(super) mesh: In<Mesh>,
    /// How often each vertex is moved to the mean of its neighbours. 0 leaves the mesh as it is; many melt it to a ball.
    #[input(default = 2, range = 0..=1000)]
    pub(super) iterations: u32,
}

/// The smooth mesh.
#[derive(Outputs)]
pub(crate) struct MeshSmoothOutputs {
    /// The same triangles; normals are left to whoever needs them.
    pub(super) mesh: Mesh,
}

impl PerFrame for MeshSmooth {
    fn run(self, _cx: &Context) -> Result<MeshSmoothOutputs, NodeError> {
        let mesh = &self.mesh;
        let refused = |e: String| NodeError::input(format!("mesh: {e}"));
        mesh.validate().map_err(refused)?;
        if self.iterations == 0 {
            return Ok(MeshSmoothOutputs { mesh: Mesh::clone(mesh) });
        }
        let part = Part { positions: &mesh.positions, triangles: &mesh.triangles, normals: &[] };
        let surface = Surface::new(&[part], std::f64::consts::PI).map_err(|e| refused(e.to_string()))?;
        let mut fair = Fair::new(&surface);
        fair.smooth(self.iterations).map_err(|e| refused(e.to_string()))?;
        // Vertices at one place, as at the seams of a texture, stay together.
        let positions = surface.joined.iter().map(|&j| fair.positions[j as usize]).collect();
        Ok(MeshSmoothOutputs { mesh: mesh.moved(positions, Vec::new()) })
    }
}
