//! `field.lift`: a field of the picture as one of the world, parallel to the picture.
//!
//! **Method** each vertex gets the vector that keeps its depth and is seen as its displacement, in an orthographic view and in perspective; what is hidden
//! gets it too ([`crate::algo::field::lift`]).
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.5, figure 7.
//!
//! **Fails when** the field is of another mesh, or a vertex is not finite. Behind the camera nothing moves. The depth is a guess: seen from elsewhere the shape is
//! flat.
//!
//! **Cost** O(vertices).
//!
//! ```ron
//! "lifted": (type: "field.lift", field: "@warp.field", mesh: "@posed", camera: "@camera"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::expect_vertices;
use crate::algo::camera::Camera as Viewed;
use crate::algo::field::lift;
use crate::data::{Camera, Field2, Field3, Mesh};

/// A field of the picture as one of the world, parallel to the picture.
#[derive(Node)]
#[node(
    id = "field.lift",
    version = 1,
    outputs = FieldLiftOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.5",
    example = "\"lifted\": (type: \"field.lift\", field: \"@warp.field\", mesh: \"@posed\", camera: \"@camera\")"
)]
pub(crate) struct FieldLift {
    /// How far each vertex is moved in the picture.
    field: In<Field2>,
    /// The mesh as it is posed there.
    mesh: In<Mesh>,
    /// Who sees it.
    camera: In<Camera>,
}

/// The field.
#[derive(Outputs)]
pub(crate) struct FieldLiftOutputs {
    /// In the world.
    field: Field3,
}

impl PerFrame for FieldLift {
    fn run(self, _cx: &Context) -> Result<FieldLiftOutputs, NodeError> {
        expect_vertices(self.field.vectors.len(), self.mesh.positions.len())?;
        let camera = Viewed::try_from(&*self.camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let vectors = lift(&self.mesh.positions, &self.field.vectors, &camera);
        match vectors.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            Some(v) => {
                Err(NodeError::input(format!("vertex {v}: expected a finite displacement and place, found {:?}", self.field.vectors[v])))
            }
            None => Ok(FieldLiftOutputs { field: Field3 { vectors } }),
        }
    }
}
