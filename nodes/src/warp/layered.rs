//! `warp.layered`: a posed mesh warped in the picture such that it comes to where it is drawn.
//!
//! **Method** each bone has a free-form deformation of its own, fitted to the correspondences that it moves ([`crate::algo::layered_warp`],
//! [`crate::algo::mffd`]): levels of cubic B-splines one after another, each of which folds nowhere. Vertices go with the mean of their bones' layers,
//! by skin weights, so that limbs that cover each other in the picture move by themselves. A joint that is the same place as the one above it, at rest and
//! posed, is no bone of its own. Or the displacements are spread over the surface
//! ([`crate::algo::surface_field`]), which knows no picture at all. Where triangles are too large for what is drawn, they may be made smaller first
//! ([`crate::algo::tessellate`]).
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, sections 3.3 and 3.4; Lee, Chwa, Hahn, Shin 1995; Choi, Lee 2000.
//!
//! **Fails when** mesh, skeleton and pose do not go together; a pair names a vertex that there is not, or lies behind the camera. What cannot be met without a
//! fold is left in `residual`. Blended layers may still fold a surface: `folds` says where.
//!
//! **Cost** O(bones · (pairs + vertices) · levels); over the surface as a sparse factorisation.
//!
//! ```ron
//! "field": (
//!     type: "warp.layered", correspondences: "@pairs", mesh: "@ant.mesh", skeleton: "@ant.skeleton", pose: "@ant.pose", camera: "@camera",
//! ),
//! ```

use std::sync::Arc;

use pegbar_engine::node::{Context, Fault, In, NodeError, PerFrame};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::camera::Camera as Viewed;
use crate::algo::layered_warp::{Layered, Layering, Layers, Missing, Pair, Posed, folds, layered, places, projected, residuals};
use crate::algo::mffd::{Combine, Options};
use crate::algo::skin::Skin;
use crate::algo::surface_field::{Smooth, spread};
use crate::algo::tessellate::{MOST, Skinned, bent, halves, moved_place};
use crate::data::{Camera, Correspondences, Field2, Mesh, Pose, Skeleton, SkinnedMesh};
use crate::skin::motions;

/// What displacements are spread over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Over {
    /// The picture, in a layer for each bone.
    Layers,
    /// The picture, all bones alike: what covers a drawn part goes with it.
    Picture,
    /// The surface, settled like heat: steep where it must be, and level beyond.
    Harmonic,
    /// The surface, as little bent as may be.
    Biharmonic,
}

/// A posed mesh warped in the picture such that it comes to where it is drawn.
#[derive(Node)]
#[node(
    id = "warp.layered",
    version = 3,
    outputs = WarpLayeredOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, sections 3.3-3.4; Lee, Chwa, Hahn, Shin 1995; Choi, Lee 2000",
    example = "\"field\": (type: \"warp.layered\", correspondences: \"@pairs\", mesh: \"@ant.mesh\", skeleton: \"@ant.skeleton\", pose: \"@ant.pose\", camera: \"@camera\")"
)]
pub(crate) struct WarpLayered {
    /// Places of the mesh, and where they are drawn.
    pub(super) correspondences: In<Correspondences>,
    /// The surface at rest, and what binds it.
    pub(super) mesh: In<SkinnedMesh>,
    /// Its joints.
    pub(super) skeleton: In<Skeleton>,
    /// What they do where it is drawn.
    pub(super) pose: In<Pose>,
    /// Who sees it.
    pub(super) camera: In<Camera>,
    /// What the displacements are spread over.
    #[input(default = layers)]
    pub(super) over: Over,
    /// What a bone does that moves no correspondence.
    #[input(default = parent)]
    pub(super) missing: Missing,
    /// How much a bone must move a correspondence for it to count in the bone's layer: 0 lets the least weight pull, 1 only what the bone moves alone.
    #[input(default = 0.05, range = 0.0..=1.0)]
    pub(super) least_weight: f64,
    /// Cells of the first level across the longer side of the picture; each level has twice as many. 1 moves all alike, many keep what is moved close by.
    #[input(default = 4, range = 1..=1024)]
    pub(super) cells: u32,
    /// Levels at most. Few leave what is drawn in detail in the residual.
    #[input(default = 10, range = 1..=16)]
    pub(super) levels: u32,
    /// How often a level is composed whose moves had to be cut short so that nothing folds.
    #[input(default = 8, range = 1..=100)]
    pub(super) repeats: u32,
    /// Distance at which a place is where it is drawn.
    #[input(default = 0.000001, range = 0.0..=1000.0, unit = "px")]
    pub(super) tolerance: f64,
    /// Levels that are composed fold nowhere; levels that are added up (Lee, Wolberg, Shin 1997) come nearer, and fold.
    #[input(default = composed)]
    pub(super) combine: Combine,
    /// Edges whose middle is drawn further than this from the middle of its ends are halved, so that coarse meshes bend too. 0 halves none; only in layers or the
    /// picture. The `field` is one of the `mesh` that comes out.
    #[input(default = 0.0, range = 0.0..=1000.0, unit = "px")]
    pub(super) tessellate: f64,
    /// How often an edge is halved at most, and its halves.
    #[input(default = 4, range = 1..=8)]
    pub(super) tessellate_rounds: u32,
}

/// The warp, and how well it went.
#[derive(Outputs)]
pub(crate) struct WarpLayeredOutputs {
    /// How far each vertex is moved.
    pub(super) field: Field2,
    /// How far each correspondence is from where it is drawn after that, pixels.
    pub(super) residual: Vector,
    /// The least growth of an area by any layer: the smallest determinant of its derivative, above 0 where nothing folds; 1 over the surface.
    pub(super) least_growth: Curve,
    /// Triangles that turn over in the picture, by their numbers.
    pub(super) folds: Vector,
    /// The mesh at rest, denser where it was asked for: the same surface, for what comes after.
    pub(super) mesh: SkinnedMesh,
    /// How far the middle of any edge is drawn from the middle of its ends, pixels; 0 where it was not asked.
    pub(super) bend: Curve,
}

fn refused(error: impl std::fmt::Display) -> NodeError {
    NodeError::input(error.to_string())
}

impl From<&SkinnedMesh> for Skinned {
    fn from(mesh: &SkinnedMesh) -> Self {
        let influences = mesh.joints.shape()[1];
        let row = |v: usize| v * influences..(v + 1) * influences;
        let bound = |v: usize| mesh.joints.data()[row(v)].iter().copied().zip(mesh.weights.data()[row(v)].iter().copied()).collect();
        Self {
            bound: (0..mesh.positions.len()).map(bound).collect(),
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.to_vec(),
            uvs: mesh.uvs.to_vec(),
            normals: mesh.normals.clone(),
            colors: mesh.colors.to_vec(),
        }
    }
}

/// A mesh with as many influences a vertex as any needs, bound as another is.
fn bound_as(dense: Skinned, mesh: &SkinnedMesh) -> Result<SkinnedMesh, NodeError> {
    let n = dense.bound.iter().map(Vec::len).fold(0, usize::max);
    let padded = dense.bound.iter().flat_map(|own| (0..n).map(|k| own.get(k).copied().unwrap_or_default()));
    let (joints, weights) = padded.unzip();
    let Skinned { positions, triangles, uvs, normals, colors, .. } = dense;
    let surface = Mesh { positions, triangles: Arc::new(triangles), uvs: Arc::new(uvs), normals, colors: Arc::new(colors) };
    SkinnedMesh::new(surface, n, joints, weights, &mesh.inverse_bind()).map_err(|e| NodeError::input(format!("mesh: {e}")))
}

/// The pairs, the mesh that they are on, and how much any of its edges is bent.
type Dense = (Vec<Pair>, SkinnedMesh, f64);

impl WarpLayered {
    /// The mesh as it stands in the world.
    fn posed(&self, mesh: &SkinnedMesh) -> Result<Vec<[f64; 3]>, NodeError> {
        let motions = motions(&self.skeleton, &self.pose, mesh)?;
        let skin = Skin::new(&mesh.positions, &[], mesh.joints.shape()[1], mesh.joints.data(), mesh.weights.data(), mesh.n_joints());
        let moved = skin.map_err(|e| NodeError::input(format!("mesh: {e}")))?.pose(&motions, false);
        Ok(moved.map_err(|e| NodeError::input(format!("pose: {e}")))?.0)
    }

    fn how(&self) -> Layering {
        let (levels, repeats) = (self.levels as usize, self.repeats as usize);
        let fit = Options { combine: self.combine, cells: [1, 1], levels, repeats, tolerance: self.tolerance };
        let layers = self.over == Over::Layers;
        Layering { layers, missing: self.missing, least_weight: self.least_weight, cells: self.cells as usize, fit }
    }

    /// The joint whose layer each joint is in: itself, or the nearest above it that it is the same place as, at rest and posed. Files part a body into such
    /// joints by its materials, and drawing one of the parts must not tear it off the others.
    fn layer_joints(&self) -> Vec<u32> {
        let rest = self.skeleton.parent_from_joint.data().chunks_exact(16).map(nalgebra::Matrix4::from_row_slice);
        let posed = self.pose.joints().unwrap_or_default().into_iter().map(|j| j.matrix());
        let still = |m: &nalgebra::Matrix4<f64>| (m - nalgebra::Matrix4::identity()).amax() < 1e-6;
        let same: Vec<bool> = rest.zip(posed).map(|(r, p)| still(&r) && still(&p)).collect();
        let parents = &self.skeleton.parents;
        let above = |joint: usize| {
            let mut at = joint;
            // As many steps as joints lead to a root, whatever the parents are.
            for _ in 0..parents.len() {
                match usize::try_from(parents[at]) {
                    Ok(parent) if parent < parents.len() && same.get(at) == Some(&true) => at = parent,
                    _ => break,
                }
            }
            at as u32
        };
        (0..parents.len()).map(above).collect()
    }

    /// The joints of a mesh by their layers.
    fn joints(&self, mesh: &SkinnedMesh) -> Vec<u32> {
        let layer = self.layer_joints();
        mesh.joints.data().iter().map(|j| layer.get(*j as usize).copied().unwrap_or(*j)).collect()
    }

    /// A mesh in the world with what moves it.
    fn bound<'a>(&'a self, mesh: &'a SkinnedMesh, positions: &'a [[f64; 3]], joints: &'a [u32]) -> Posed<'a> {
        Posed {
            positions,
            triangles: &mesh.triangles,
            influences: mesh.joints.shape()[1],
            joints,
            weights: mesh.weights.data(),
            parents: &self.skeleton.parents,
        }
    }

    /// The warp over the picture.
    fn over_picture(&self, mesh: &SkinnedMesh, pairs: &[Pair], camera: &Viewed) -> Result<Layered, NodeError> {
        layered(&self.bound(mesh, &self.posed(mesh)?, &self.joints(mesh)), pairs, camera, &self.how()).map_err(refused)
    }

    /// Makes the mesh denser where the warp asks for it.
    fn dense(&self, mut pairs: Vec<Pair>, camera: &Viewed, cx: &Context) -> Result<Dense, NodeError> {
        let (mut mesh, mut bend) = ((*self.mesh).clone(), 0.0);
        // Once: halving edges moves pairs by no more than what a bent joint takes off their middles. The denser mesh is fitted anew in the end.
        let layers =
            Layers::fit(&self.bound(&mesh, &self.posed(&mesh)?, &self.joints(&mesh)), &pairs, camera, &self.how()).map_err(refused)?;
        for round in 0..=self.tessellate_rounds {
            cx.check()?;
            let mut dense = Skinned::from(&mesh);
            let surface = dense.surface().map_err(|e| NodeError::input(format!("mesh: {e}")))?;
            let asked = bound_as(dense.with_middles(&surface), &mesh)?;
            let field = layers.field(&self.bound(&asked, &self.posed(&asked)?, &self.joints(&asked)), camera);
            let (wanted, most) = bent(&surface, &field, self.tessellate);
            bend = most;
            if round == self.tessellate_rounds || most <= self.tessellate || surface.triangles.len() > MOST {
                break;
            }
            let between = dense.split(surface.clone(), &wanted);
            let halves = halves(&surface, &between);
            for pair in &mut pairs {
                (pair.edge, pair.share) = moved_place((pair.edge, pair.share), &surface, &halves);
            }
            mesh = bound_as(dense, &mesh)?;
        }
        Ok((pairs, mesh, bend))
    }

    fn over_surface(&self, positions: &[[f64; 3]], pairs: &[Pair], camera: &Viewed, smooth: Smooth) -> Result<Layered, NodeError> {
        let from = places(pairs, positions, camera).map_err(refused)?;
        let by: Vec<_> = pairs.iter().zip(&from).map(|(p, f)| [p.point[0] - f[0], p.point[1] - f[1]]).collect();
        let field = spread(positions, &self.mesh.triangles, pairs, &by, smooth).map_err(refused)?;
        let residuals = residuals(pairs, &from, &field);
        let folds = folds(&projected(positions, camera), &field, &self.mesh.triangles);
        Ok(Layered { field, residuals, growth: 1.0, folds })
    }
}

impl PerFrame for WarpLayered {
    fn run(self, cx: &Context) -> Result<WarpLayeredOutputs, NodeError> {
        let camera = Viewed::try_from(&*self.camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let given = &self.correspondences;
        let pair = |k: usize| Pair { edge: given.edges[k], share: given.shares[k], point: given.points[k], weight: given.weight(k) };
        let pairs: Vec<Pair> = (0..given.len()).map(pair).collect();
        let over_picture = matches!(self.over, Over::Layers | Over::Picture);
        let (pairs, mesh, bend) = match self.tessellate > 0.0 {
            true if over_picture => self.dense(pairs, &camera, cx)?,
            true => {
                let message = "tessellate: expected a warp over layers or the picture, found one over the surface";
                return Err(NodeError::new(Fault::Parameters, message));
            }
            false => (pairs, (*self.mesh).clone(), 0.0),
        };
        let found = match self.over {
            Over::Harmonic => self.over_surface(&self.posed(&mesh)?, &pairs, &camera, Smooth::Harmonic)?,
            Over::Biharmonic => self.over_surface(&self.posed(&mesh)?, &pairs, &camera, Smooth::Biharmonic)?,
            Over::Layers | Over::Picture => self.over_picture(&mesh, &pairs, &camera)?,
        };
        Ok(WarpLayeredOutputs {
            field: Field2 { vectors: found.field },
            residual: Vector { values: found.residuals },
            least_growth: Curve { value: found.growth },
            folds: Vector { values: found.folds.iter().map(|t| *t as f64).collect() },
            mesh,
            bend: Curve { value: bend },
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector3};
    use pegbar_engine::node::Cancel;

    use super::*;
    use crate::algo::camera::{Orbit, orthographic};
    use crate::counted::clock;

    /// A square, its left edge and its right edge each bound to a joint of its own, as a body in two materials is. The second joint stands in the first one's
    /// place, or `apart` from it. The left edge is drawn 16 pixels higher, and of the right one nothing but its foot, where it stands.
    fn parted(apart: f64) -> Vec<[f64; 2]> {
        let moved = |x: f64| Matrix4::new_translation(&Vector3::new(x, 0.0, 0.0));
        let positions = vec![[-0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0]];
        let surface = Mesh { positions, triangles: Arc::new(vec![[0, 2, 1], [1, 2, 3]]), ..Mesh::default() };
        let inverse_bind = [Matrix4::identity(), moved(-apart)];
        let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 10.0 };
        let seen = Viewed::new(orbit.view(), orthographic(64.0, [256, 256], 0.1, 100.0), [256, 256]).unwrap();
        let node = WarpLayered {
            correspondences: In::new(Correspondences {
                edges: vec![[0, 0], [1, 1], [2, 2]],
                shares: vec![0.0; 3],
                points: vec![[96.0, 144.0], [96.0, 80.0], [160.0, 160.0]],
                weights: Vec::new(),
            }),
            mesh: In::new(SkinnedMesh::new(surface, 1, vec![0, 0, 1, 1], vec![1.0; 4], &inverse_bind).unwrap()),
            skeleton: In::new(Skeleton::new(vec![-1, 0], &[Matrix4::identity(), moved(apart)], Vec::new()).unwrap()),
            pose: In::new(Pose {
                translations: vec![[0.0; 3], [apart, 0.0, 0.0]],
                rotations: vec![[0.0, 0.0, 0.0, 1.0]; 2],
                scales: vec![[1.0; 3]; 2],
            }),
            camera: In::new(Camera::from(&seen)),
            over: Over::Layers,
            missing: Missing::Parent,
            least_weight: 0.05,
            cells: 4,
            levels: 10,
            repeats: 8,
            tolerance: 1e-6,
            combine: Combine::Composed,
            tessellate: 0.0,
            tessellate_rounds: 4,
        };
        let clock = clock(1);
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() }).unwrap().field.vectors
    }

    #[test]
    fn joints_in_one_place_are_one_bone() {
        let (one, two) = (parted(0.0), parted(0.1));
        for field in [&one, &two] {
            assert!(libm::hypot(field[0][0], field[0][1] + 16.0) < 1e-3 && libm::hypot(field[2][0], field[2][1]) < 1e-3, "{field:?}");
        }
        // Nothing was drawn of the upper right corner: it goes along with the body, or stays with a bone of its own.
        assert!(one[3][1].abs() > 0.5, "{one:?}");
        assert!(libm::hypot(two[3][0], two[3][1]) < 1e-9, "{two:?}");
    }
}
