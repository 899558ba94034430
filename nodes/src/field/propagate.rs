//! `field.propagate`: a field of one frame taken along a motion.
//!
//! **Method** each vector goes with its vertex from the example's frame to every other: T = (sum w M(t)) (sum w M(t_e))⁻¹, by the rotation of T, by T, or by
//! its inverse transpose ([`crate::algo::field::propagate`]). At the example's own frame it is the field to the bit.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.6, equations 2 and 3; Turkowski 1990; Higham 1986 (the polar factor).
//!
//! **Fails when** mesh, skeleton, pose and field do not go together, or the frame is not one of the motion. Limbs that are folded flat are held by `limit`.
//!
//! **Cost** O(vertices · influences) a frame; frames run in parallel.
//!
//! ```ron
//! "along": (type: "field.propagate", field: "@lifted", mesh: "@ant.mesh", skeleton: "@ant.skeleton", pose: "@warp.pose", frame: 12),
//! ```

use pegbar_engine::node::{Context, Frames, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::expect_vertices;
use crate::algo::field::{Bound, Transport, propagate};
use crate::data::{Field3, Pose, Skeleton, SkinnedMesh};
use crate::skin::motions;

/// A field of one frame taken along a motion.
#[derive(Node)]
#[node(
    id = "field.propagate",
    version = 1,
    outputs = FieldPropagateOutputs,
    uses_frame,
    source = "Li, Gleicher, Xu, Shum 2003, eqs. 2-3; Turkowski 1990; Higham 1986",
    example = "\"along\": (type: \"field.propagate\", field: \"@lifted\", mesh: \"@ant.mesh\", skeleton: \"@ant.skeleton\", pose: \"@warp.pose\", frame: 12)"
)]
pub(crate) struct FieldPropagate {
    /// How far each vertex is moved at the example's frame.
    field: In<Field3>,
    /// The surface at rest, and what binds it.
    mesh: In<SkinnedMesh>,
    /// Its joints.
    skeleton: In<Skeleton>,
    /// What they do, as edited for the example.
    pose: Frames<Pose>,
    /// The example's frame.
    frame: i64,
    /// How vectors go with what moves them.
    #[input(default = rotation)]
    transport: Transport,
    /// Stretch of a limb at which it is cut, and its inverse: 1 knows rotations alone, much lets a limb that is folded flat make spikes.
    #[input(default = 4.0, range = 1.0..=1000.0)]
    limit: f64,
}

/// The field along the motion.
#[derive(Outputs)]
pub(crate) struct FieldPropagateOutputs {
    /// In the world.
    field: Field3,
}

impl PerFrame for FieldPropagate {
    fn run(self, cx: &Context) -> Result<FieldPropagateOutputs, NodeError> {
        let mesh = &self.mesh;
        expect_vertices(self.field.vectors.len(), mesh.positions.len())?;
        let of = |frame: i64| motions(&self.skeleton, self.pose.at(frame)?, mesh);
        let (then, now) = (of(self.frame)?, of(cx.frame)?);
        if then == now {
            return Ok(FieldPropagateOutputs { field: (*self.field).clone() });
        }
        let bound = Bound { influences: mesh.joints.shape()[1], joints: mesh.joints.data(), weights: mesh.weights.data() };
        let vectors = propagate(&self.field.vectors, &bound, &then, &now, self.transport, self.limit);
        match vectors.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            Some(v) => Err(NodeError::input(format!("vertex {v}: expected a finite displacement, found {:?}", self.field.vectors[v]))),
            None => Ok(FieldPropagateOutputs { field: Field3 { vectors } }),
        }
    }

    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        if cx.frame == self.frame { vec![cx.frame] } else { vec![cx.frame, self.frame] }
    }
}
