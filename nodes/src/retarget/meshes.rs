//! `retarget.meshes`: captured weights and motion put on 3D key models.
//!
//! **Method** control vertices are blended linearly by the captured weights: keys are a mesh each, or one mesh and its morph targets. The captured motion
//! of the picture then moves the result in a plane of the world; what happens out of that plane comes from the keys alone.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (3D models).
//!
//! **Fails when** the keys are not the same vertices and triangles, there is not one weight for each, or a number is not finite.
//!
//! **Cost** O(vertices · keys with a weight) a frame; frames run in parallel.
//!
//! ```ron
//! "otter": (type: "retarget.meshes", meshes: ["@stand", "@stretch", "@squash"], weights: "@capture.weights", motion: "@capture.motion", scale: 0.01),
//! ```

use pegbar_engine::node::{Context, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::{expect_weights, in_world};
use crate::algo::in_plane::{DepthScale, Plane};
use crate::algo::mesh::{blended, moved, unit};
use crate::data::{Affine2, Mesh, MorphTargets, Weights};
use crate::skin::morph;

/// Captured weights and motion put on 3D key models.
///
/// Each model corresponds to the captured key at the same position: where one is more extreme, the other must be more so in the same way.
#[derive(Node)]
#[node(
    id = "retarget.meshes",
    version = 1,
    outputs = RetargetMeshesOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"otter\": (type: \"retarget.meshes\", meshes: [\"@stand\", \"@squash\"], weights: \"@capture.weights\", motion: \"@capture.motion\")"
)]
pub(crate) struct RetargetMeshes {
    /// The key models, one for each captured key; or the one that `morphs` belong to.
    pub(super) meshes: List<In<Mesh>>,
    /// Morph targets of one mesh as keys: one for each captured key, or for each but the first, which is then the mesh itself.
    pub(super) morphs: Option<In<MorphTargets>>,
    /// How much of each key. They add up to 1 where keys are blended; less shrinks towards the world's origin.
    pub(super) weights: In<Weights>,
    /// The captured motion: frame from reference, pixels. None where it is left out.
    pub(super) motion: Option<In<Affine2>>,
    /// The plane of the world that stands for the picture.
    #[input(default = xy)]
    pub(super) plane: Plane,
    /// Metres a pixel: the height of the model over that of the drawing.
    #[input(default = 0.01, range = 0.0..=1000000.0, unit = "m/px")]
    pub(super) scale: f64,
    /// The pixel of the reference frame that stands for the world's origin: between the feet, say.
    #[input(default = (0.0, 0.0), unit = "px")]
    pub(super) origin: [f64; 2],
    /// True where down in the picture is down in the world; false takes the picture's y as it is.
    #[input(default = true)]
    pub(super) flip: bool,
    /// What the motion does to depth.
    #[input(default = one)]
    pub(super) depth_scale: DepthScale,
}

/// The model.
#[derive(Outputs)]
pub(crate) struct RetargetMeshesOutputs {
    /// Blended and moved: metres, Y up.
    pub(super) mesh: Mesh,
}

impl RetargetMeshes {
    fn blend(&self) -> Result<Mesh, NodeError> {
        let (weights, meshes) = (&self.weights.weights, &self.meshes.0);
        let first = meshes.first().ok_or_else(|| NodeError::input("meshes: expected one for each key, found none"))?;
        if let Some(morphs) = &self.morphs {
            let m = morphs.n_targets();
            if meshes.len() != 1 {
                return Err(NodeError::input(format!("meshes: expected one, that the morph targets belong to, found {}", meshes.len())));
            }
            let own = if weights.len() == m + 1 { &weights[1..] } else { &weights[..] };
            expect_weights(own, m)?;
            return morph(first, morphs, own);
        }
        expect_weights(weights, meshes.len())?;
        for (k, mesh) in meshes.iter().enumerate() {
            mesh.validate().map_err(|e| NodeError::input(format!("key {k}: {e}")))?;
            if mesh.positions.len() != first.positions.len() || mesh.triangles != first.triangles {
                let message =
                    format!("key {k}: expected the {} vertices and the triangles of the first, found others", first.positions.len());
                return Err(NodeError::input(message));
            }
        }
        let positions: Vec<_> = meshes.iter().zip(weights).map(|(m, w)| (*w, &m.positions[..])).collect();
        let normals: Vec<_> = meshes.iter().zip(weights).map(|(m, w)| (*w, &m.normals[..])).collect();
        let has_normals = meshes.iter().all(|m| !m.normals.is_empty());
        let normals = if has_normals { blended(&normals).into_iter().map(|n| unit(n.into())).collect() } else { Vec::new() };
        Ok(first.moved(blended(&positions), normals))
    }
}

impl PerFrame for RetargetMeshes {
    fn run(self, _cx: &Context) -> Result<RetargetMeshesOutputs, NodeError> {
        let mesh = self.blend()?;
        let world = in_world(self.motion.as_deref(), (self.plane, self.scale, self.origin), self.flip, self.depth_scale)?;
        let (positions, normals) = moved(&world, &mesh.positions, &mesh.normals);
        if let Some(v) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(NodeError::input(format!("vertex {v}: expected finite positions of all keys, found NaN or infinity")));
        }
        Ok(RetargetMeshesOutputs { mesh: mesh.moved(positions, normals) })
    }
}
