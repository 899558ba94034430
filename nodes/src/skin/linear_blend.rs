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
    version = 2,
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
pub(crate) fn motions(skeleton: &Skeleton, pose: &Pose, mesh: &SkinnedMesh) -> Result<Vec<nalgebra::Matrix4<f64>>, NodeError> {
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
        if let Some(v) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            let error = NodeError::input(format!("pose: expected vertices at finite places, found vertex {v} at {:?}", positions[v]));
            return Err(error.help("`precision: double` has a wider range"));
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::clock;
    use pegbar_engine::node::Cancel;

    /// Twelve vertices on two joints, the upper scaled evenly, the lower along its axes; keys at frames 0 and 10 of 24 a second.
    const BAR: &[u8] = include_bytes!("testdata/bar.gltf");

    /// What Blender 5.0.1 (bpy, glTF importer) makes of it at frames 5 and 10, world positions with Y up.
    const BLENDER: [(f64, [[f64; 3]; 12]); 2] = [
        (
            5.0 / 24.0,
            [
                [0.17473644, -0.446539104, 0.097796544],
                [0.038570918, 0.034409776, 0.109925851],
                [0.125263602, 0.046539083, 0.602203488],
                [0.261429131, -0.434409797, 0.590074182],
                [1.364713192, -0.01677388, -0.157279074],
                [1.173073292, 0.347915232, -0.084426463],
                [1.301419258, 0.297601521, 0.423815548],
                [1.493059158, -0.067087576, 0.350962996],
                [2.632534266, 1.127982378, -0.326427609],
                [2.413157225, 1.434541583, -0.223213345],
                [2.562329769, 1.353006363, 0.29301089],
                [2.78170681, 1.046447158, 0.189796656],
            ],
        ),
        (
            10.0 / 24.0,
            [
                [0.300000042, -0.700000048, 0.399999976],
                [0.096597001, -0.136725232, 0.436725199],
                [0.300000042, -0.100000009, 1.0],
                [0.503403068, -0.663274825, 0.963274777],
                [1.545937777, -0.000578716, -0.14329417],
                [1.337267399, 0.293521076, -0.02051717],
                [1.686810017, 0.217594177, 0.526279032],
                [1.895480394, -0.076505616, 0.403502047],
                [2.365801096, 2.39168191, -0.007920101],
                [2.154496908, 2.551194429, 0.157882735],
                [2.577109575, 2.418941021, 0.696439624],
                [2.788413525, 2.259428501, 0.530636787],
            ],
        ),
    ];

    fn posed(seconds: f64, precision: Precision, scale: f64) -> Result<Mesh, NodeError> {
        let document = crate::algo::gltf::Document::open(BAR, &mut |_| Err(String::new())).unwrap();
        let rig = document.rig().unwrap();
        let bar = document.character(&rig, None, None).unwrap();
        let rest: Vec<_> = rig.rest.iter().map(|j| j.matrix()).collect();
        let mesh = Mesh { positions: bar.positions, triangles: Arc::new(bar.triangles), ..Mesh::default() };
        let weights = bar.weights.iter().map(|w| w * scale).collect();
        let node = SkinLinearBlend {
            mesh: In::new(SkinnedMesh::new(mesh, bar.influences, bar.joints, weights, &rig.inverse_bind).unwrap()),
            skeleton: In::new(Skeleton::new(rig.parents.clone(), &rest, rig.names.clone()).unwrap()),
            pose: In::new(document.sample(None).unwrap().pose(&rig, seconds).into_iter().collect()),
            morphs: None,
            weights: None,
            precision,
        };
        let clock = clock(1);
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
        node.run(None, &cx).map(|(out, _)| out.mesh)
    }

    #[test]
    fn a_bar_of_scaled_joints_bends_as_in_blender() {
        for (seconds, truth) in BLENDER {
            for (precision, scale) in [(Precision::Single, 1.0), (Precision::Double, 1.0), (Precision::Double, 0.3)] {
                let mesh = posed(seconds, precision, scale).unwrap();
                let worst = mesh.positions.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst < 2e-6, "{seconds} {precision:?} {scale}: {worst}");
            }
        }
    }

    #[test]
    fn single_and_double_precision_agree_and_repeat() {
        let (a, b) = (posed(0.3, Precision::Single, 1.0).unwrap(), posed(0.3, Precision::Double, 1.0).unwrap());
        let worst = a.positions.iter().flatten().zip(b.positions.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst > 0.0 && worst < 1e-6, "{worst}");
        assert_eq!(a, posed(0.3, Precision::Single, 1.0).unwrap());
    }

    #[test]
    fn joints_of_other_numbers_are_refused() {
        let skeleton = Skeleton::new(vec![-1], &[nalgebra::Matrix4::identity()], Vec::new()).unwrap();
        let error = motions(&skeleton, &Pose::default(), &SkinnedMesh::default()).unwrap_err();
        assert_eq!(error.message, "expected as many joints in the pose and the mesh as in the skeleton, 1, found 0 and 0");
    }

    #[test]
    fn morph_targets_are_added_at_rest() {
        let mesh = Mesh { positions: vec![[1.0, 0.0, 0.0]], normals: vec![[0.0, 1.0, 0.0]], ..Mesh::default() };
        let stack = |rows: Vec<f64>| pegbar_engine::array::NdArray::new([2, 1, 3], rows).unwrap();
        let positions = stack(vec![0.0, 1.0, 0.0, 0.0, 0.0, 4.0]);
        let morphs = MorphTargets { positions, normals: stack(vec![0.0, -1.0, 0.0, 1.0, 0.0, 0.0]), names: Vec::new() };
        let made = morph(&mesh, &morphs, &[0.5, 0.25]).unwrap();
        assert_eq!(made.positions, [[1.0, 0.5, 1.0]]);
        assert_eq!(made.normals, [unit(nalgebra::Vector3::new(0.25, 0.5, 0.0))]);
        let error = morph(&mesh, &morphs, &[1.0]).unwrap_err().message;
        assert_eq!(error, "expected 1 vertices in the morph targets and a weight for each of 2, found 1 and 1");
    }
}
