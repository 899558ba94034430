//! `skin.linear_blend`: a skinned mesh in each pose of its skeleton.
//!
//! **Method** every vertex is moved by the weighted mean of its joints' motions ([`crate::algo::skin`]); weights are made to add up to 1, normals go
//! with the inverse transpose. Morph targets are added at rest, before the joints move.
//!
//! **Source** Magnenat-Thalmann, Laperrière, Thalmann 1988; Li, Gleicher, Xu, Shum 2003, equation 1.
//!
//! **Fails when** mesh, skeleton and pose have joints of different numbers, or a number is not finite. Strongly twisted joints lose volume: that is the
//! method's own.
//!
//! **Cost** O(vertices · influences) a frame; frames run in parallel once the first is made.
//!
//! ```ron
//! "skin": (type: "skin.linear_blend", mesh: "@otter.mesh", skeleton: "@otter.skeleton", pose: "@otter.pose"),
//! ```

use std::sync::{Arc, OnceLock};

use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs, Setting, Value};

use crate::algo::mesh::{morphed, unit};
use crate::algo::skeleton::world_from_joint;
use crate::algo::skin::Skin;
use crate::data::{Mesh, MorphTargets, Pose, Skeleton, SkinnedMesh, Weights};

/// Numbers that vertices are computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Precision {
    /// 32 bits: faster, within a few millionths of the character's size.
    Single,
    /// 64 bits.
    Double,
}

/// A skinned mesh in each pose of its skeleton.
#[derive(Node)]
#[node(
    id = "skin.linear_blend",
    version = 1,
    kind = recurrent,
    outputs = SkinLinearBlendOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, eq. 1",
    example = "\"skin\": (type: \"skin.linear_blend\", mesh: \"@otter.mesh\", skeleton: \"@otter.skeleton\", pose: \"@otter.pose\")"
)]
pub(crate) struct SkinLinearBlend {
    /// The surface at rest, and what binds it.
    mesh: In<SkinnedMesh>,
    /// Its joints.
    skeleton: In<Skeleton>,
    /// What the joints do.
    pose: In<Pose>,
    /// What the surface is morphed to before it is skinned. Nothing where it is left out.
    morphs: Option<In<MorphTargets>>,
    /// How much of each morph target. None of any where it is left out.
    weights: Option<In<Weights>>,
    /// Numbers that vertices are computed with.
    #[input(default = single)]
    precision: Precision,
}

/// The surface.
#[derive(Outputs)]
pub(crate) struct SkinLinearBlendOutputs {
    /// In the pose: metres, Y up.
    mesh: Mesh,
}

/// The mesh made ready to be skinned, once for all frames.
#[derive(Clone, Debug, Value)]
pub(crate) struct Ready {
    /// Number of vertices.
    #[value(shape = "[]")]
    vertices: i64,
    /// Made again where it is not there, or of another mesh.
    #[value(skip)]
    skin: OnceLock<(Arc<SkinnedMesh>, Arc<Skin>)>,
}

fn made(mesh: &SkinnedMesh, rest: &Mesh) -> Result<Skin, NodeError> {
    let influences = mesh.joints.shape()[1];
    Skin::new(&rest.positions, &rest.normals, influences, mesh.joints.data(), mesh.weights.data(), mesh.n_joints())
        .map_err(|e| NodeError::input(format!("mesh: {e}")))
}

/// World from mesh at rest, for each joint.
fn motions(skeleton: &Skeleton, pose: &Pose, mesh: &SkinnedMesh) -> Result<Vec<nalgebra::Matrix4<f64>>, NodeError> {
    let (own, posed, bound) = (skeleton.n_joints(), pose.n_joints(), mesh.n_joints());
    if own != posed || own != bound {
        let message = format!("expected as many joints in the pose and the mesh as in the skeleton, {own}, found {posed} and {bound}");
        return Err(NodeError::input(message).help("take mesh, skeleton and pose from one file"));
    }
    let joints = pose.joints().map_err(|e| NodeError::input(format!("pose: {e}")))?;
    let local: Vec<_> = joints.iter().map(|j| j.matrix()).collect();
    let world = world_from_joint(&skeleton.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))?;
    Ok(world.iter().zip(mesh.inverse_bind()).map(|(w, b)| w * b).collect())
}

impl Recurrent for SkinLinearBlend {
    type State = Ready;

    fn run(self, state: Option<&Ready>, _cx: &Context) -> Result<(SkinLinearBlendOutputs, Ready), NodeError> {
        let mesh = self.mesh.shared()?;
        let motions = motions(&self.skeleton, &self.pose, &mesh)?;
        let kept = state.and_then(|s| s.skin.get()).filter(|(of, _)| Arc::ptr_eq(of, &mesh)).map(|(_, skin)| skin.clone());
        let rest = mesh.rest();
        let skin = match kept {
            Some(skin) => skin,
            None => Arc::new(made(&mesh, &rest)?),
        };
        let narrow = self.precision == Precision::Single;
        let refused = |e: String| NodeError::input(format!("pose: {e}"));
        let moves = self.weights.as_ref().is_some_and(|w| w.weights.iter().any(|w| *w != 0.0));
        let (positions, normals) = match (&self.morphs, &self.weights) {
            (Some(morphs), Some(weights)) if moves => made(&mesh, &morph(&rest, morphs, &weights.weights)?)?.pose(&motions, narrow),
            _ => skin.pose(&motions, narrow),
        }
        .map_err(refused)?;
        let state = Ready { vertices: positions.len() as i64, skin: OnceLock::from((mesh, skin)) };
        Ok((SkinLinearBlendOutputs { mesh: rest.moved(positions, normals) }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        // All frames start from the first, which makes the mesh ready, so that they need not wait for each other.
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

/// A mesh and so much of each target.
pub(crate) fn morph(mesh: &Mesh, morphs: &MorphTargets, weights: &[f64]) -> Result<Mesh, NodeError> {
    let (m, v) = (morphs.n_targets(), morphs.n_vertices());
    if weights.len() != m || v != mesh.positions.len() {
        let message = format!(
            "expected {} vertices in the morph targets and a weight for each of {m}, found {v} and {}",
            mesh.positions.len(),
            weights.len()
        );
        return Err(NodeError::input(message));
    }
    let of = |pick: fn(&MorphTargets, usize) -> &[[f64; 3]]| (0..m).map(|k| (weights[k], pick(morphs, k))).collect::<Vec<_>>();
    let positions = morphed(&mesh.positions, &of(MorphTargets::target));
    let mut normals = mesh.normals.clone();
    if !normals.is_empty() && !morphs.normals.data().is_empty() {
        normals = morphed(&normals, &of(MorphTargets::target_normals)).into_iter().map(|n| unit(n.into())).collect();
    }
    Ok(mesh.moved(positions, normals))
}
