//! Fields over the vertices of a mesh: into the world, and along a motion.

mod lift;
mod propagate;

pub(crate) use lift::FieldLift;
pub(crate) use propagate::FieldPropagate;

use pegbar_engine::node::NodeError;

/// Holds a field against the mesh that it lies on.
pub(crate) fn expect_vertices(found: usize, vertices: usize) -> Result<(), NodeError> {
    if found == vertices {
        return Ok(());
    }
    Err(NodeError::input(format!("field: expected a vector for each of {vertices} vertices of the mesh, found {found}")))
}
