//! Surfaces of triangles: plain ones, skinned ones, and the targets that they are morphed to.

use std::sync::Arc;

use nalgebra::Matrix4;
use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

use super::skeleton::{expect_stack, stacked, unstacked};

/// A surface of triangles.
///
/// What does not change over time is shared by the frames of a stream.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Mesh {
    /// Vertices, metres, Y up.
    #[value(shape = "[v, 3]")]
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle, anticlockwise as seen from outside.
    #[value(shape = "[t, 3]")]
    pub triangles: Arc<Vec<[u32; 3]>>,
    /// Where each vertex lies on the texture: 0, 0 its top left corner, 1, 1 its bottom right; beyond that the texture repeats. None at all without a texture.
    #[value(shape = "[v, 2]", optional)]
    pub uvs: Arc<Vec<[f64; 2]>>,
    /// Unit vector that points out of the surface at each vertex, or none at all.
    #[value(shape = "[v, 3]", optional)]
    pub normals: Vec<[f64; 3]>,
    /// Colour of each vertex, red, green, blue, alpha: linear light, premultiplied; it multiplies the texture. None at all stands for white.
    #[value(shape = "[v, 4]", optional)]
    pub colors: Arc<Vec<[f64; 4]>>,
}

impl Mesh {
    /// What keeps the parts from being a mesh.
    ///
    /// # Errors
    /// Where a triangle names a vertex that there is not, or an array has another number of vertices.
    pub fn validate(&self) -> Result<(), String> {
        expect_mesh(self.positions.len(), &self.triangles, self.uvs.len(), self.normals.len(), self.colors.len())
    }

    /// The mesh with other positions and normals.
    pub fn moved(&self, positions: Vec<[f64; 3]>, normals: Vec<[f64; 3]>) -> Self {
        Self { positions, normals, triangles: self.triangles.clone(), uvs: self.uvs.clone(), colors: self.colors.clone() }
    }
}

/// A surface of triangles that joints move.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct SkinnedMesh {
    /// Vertices at rest, metres, Y up.
    #[value(shape = "[v, 3]")]
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle, anticlockwise as seen from outside.
    #[value(shape = "[t, 3]")]
    pub triangles: Arc<Vec<[u32; 3]>>,
    /// As of `Mesh`.
    #[value(shape = "[v, 2]", optional)]
    pub uvs: Arc<Vec<[f64; 2]>>,
    /// As of `Mesh`, at rest.
    #[value(shape = "[v, 3]", optional)]
    pub normals: Vec<[f64; 3]>,
    /// As of `Mesh`.
    #[value(shape = "[v, 4]", optional)]
    pub colors: Arc<Vec<[f64; 4]>>,
    /// Joints that move each vertex, by their numbers in the skeleton; four columns, or as many as are needed.
    #[value(shape = "[v, n]")]
    pub joints: NdArray<u32, 2>,
    /// How much each of them moves it. They need not add up to 1.
    #[value(shape = "[v, n]")]
    pub weights: NdArray<f64, 2>,
    /// For each joint of the skeleton, joint at rest from mesh at rest.
    #[value(shape = "[j, 4, 4]")]
    pub inverse_bind: NdArray<f64, 3>,
}

impl SkinnedMesh {
    /// A mesh bound to joints. `joints` and `weights` hold `influences` numbers a vertex.
    ///
    /// # Errors
    /// Where the parts do not go together.
    pub fn new(mesh: Mesh, influences: usize, joints: Vec<u32>, weights: Vec<f64>, inverse_bind: &[Matrix4<f64>]) -> Result<Self, String> {
        let v = mesh.positions.len();
        let (n_joints, n_weights) = (joints.len(), weights.len());
        let (Some(joints), Some(weights)) = (NdArray::new([v, influences], joints), NdArray::new([v, influences], weights)) else {
            return Err(format!("expected {influences} joints and weights for each of {v} vertices, found {n_joints} and {n_weights}"));
        };
        let inverse_bind = stacked(inverse_bind);
        let Mesh { positions, triangles, uvs, normals, colors } = mesh;
        let skinned = Self { positions, triangles, uvs, normals, colors, joints, weights, inverse_bind };
        skinned.validate().map(|()| skinned)
    }

    /// The surface at rest.
    pub fn rest(&self) -> Mesh {
        Mesh {
            positions: self.positions.clone(),
            triangles: self.triangles.clone(),
            uvs: self.uvs.clone(),
            normals: self.normals.clone(),
            colors: self.colors.clone(),
        }
    }

    /// Number of joints that it is bound to.
    pub fn n_joints(&self) -> usize {
        self.inverse_bind.shape()[0]
    }

    /// For each joint, joint at rest from mesh at rest.
    pub fn inverse_bind(&self) -> Vec<Matrix4<f64>> {
        unstacked(&self.inverse_bind)
    }

    /// What keeps the parts from being a skinned mesh.
    ///
    /// # Errors
    /// As of [`Mesh::validate`], or where joints, weights and matrices do not go together.
    pub fn validate(&self) -> Result<(), String> {
        let v = self.positions.len();
        expect_mesh(v, &self.triangles, self.uvs.len(), self.normals.len(), self.colors.len())?;
        let (joints, weights, j) = (self.joints.shape(), self.weights.shape(), self.n_joints());
        if joints[0] != v || joints != weights {
            return Err(format!("expected joints and weights of [{v}, n], found {joints:?} and {weights:?}"));
        }
        expect_stack(&self.inverse_bind, j, "inverse_bind")?;
        match self.joints.data().iter().position(|&i| i as usize >= j) {
            Some(at) => Err(format!("vertex {}: expected joints below {j}, found {}", at / joints[1].max(1), self.joints.data()[at])),
            None => Ok(()),
        }
    }
}

/// Displacements that are added to a mesh, each by a weight: blend shapes.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct MorphTargets {
    /// For each target, how far it moves each vertex from where it is at rest, metres.
    #[value(shape = "[m, v, 3]")]
    pub positions: NdArray<f64, 3>,
    /// For each target, what it adds to each vertex's normal, or none at all.
    #[value(shape = "[m, v, 3]", optional)]
    pub normals: NdArray<f64, 3>,
    /// Name of each target, or none at all.
    #[value(text)]
    pub names: Vec<String>,
}

impl MorphTargets {
    /// Number of targets.
    pub fn n_targets(&self) -> usize {
        self.positions.shape()[0]
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.positions.shape()[1]
    }

    /// How far a target moves each vertex.
    pub fn target(&self, idx: usize) -> &[[f64; 3]] {
        rows(&self.positions, idx)
    }

    /// What a target adds to each normal; nothing where normals do not change.
    pub fn target_normals(&self, idx: usize) -> &[[f64; 3]] {
        rows(&self.normals, idx)
    }

    /// What keeps the parts from being targets.
    ///
    /// # Errors
    /// Where their numbers differ.
    pub fn validate(&self) -> Result<(), String> {
        let ([m, v, d], normals) = (self.positions.shape(), self.normals.shape());
        if d != 3 && !self.positions.data().is_empty() {
            return Err(format!("expected positions of [m, v, 3], found [{m}, {v}, {d}]"));
        }
        if !self.normals.data().is_empty() && normals != [m, v, d] {
            return Err(format!("expected normals of [{m}, {v}, 3] or none, found {normals:?}"));
        }
        if !self.names.is_empty() && self.names.len() != m {
            return Err(format!("expected a name for each of {m} targets or none, found {}", self.names.len()));
        }
        Ok(())
    }
}

fn rows(stack: &NdArray<f64, 3>, idx: usize) -> &[[f64; 3]] {
    let v = stack.shape()[1];
    stack.data().as_chunks::<3>().0.get(idx * v..(idx + 1) * v).unwrap_or_default()
}

fn expect_mesh(v: usize, triangles: &[[u32; 3]], uvs: usize, normals: usize, colors: usize) -> Result<(), String> {
    for (name, n) in [("uvs", uvs), ("normals", normals), ("colors", colors)] {
        if n != 0 && n != v {
            return Err(format!("expected {name} for each of {v} vertices or none, found {n}"));
        }
    }
    match triangles.iter().enumerate().find(|(_, t)| t.iter().any(|&i| i as usize >= v)) {
        Some((at, t)) => Err(format!("triangle {at}: expected vertices below {v}, found {t:?}")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pegbar_engine::array::{Array, Data};
    use pegbar_engine::value::{OwnedParts, Value};

    fn triangle() -> Mesh {
        Mesh { positions: vec![[0.0; 3]; 3], triangles: Arc::new(vec![[0, 1, 2]]), ..Mesh::default() }
    }

    #[test]
    fn a_mesh_says_what_is_wrong_with_it() {
        assert_eq!(triangle().validate(), Ok(()));
        let far = Mesh { triangles: Arc::new(vec![[0, 1, 3]]), ..triangle() };
        assert_eq!(far.validate(), Err("triangle 0: expected vertices below 3, found [0, 1, 3]".to_owned()));
        let few = Mesh { uvs: Arc::new(vec![[0.0; 2]; 2]), ..triangle() };
        assert_eq!(few.validate(), Err("expected uvs for each of 3 vertices or none, found 2".to_owned()));
    }

    #[test]
    fn a_skinned_mesh_says_what_is_wrong_with_it() {
        let eye = [Matrix4::identity(); 2];
        let made =
            |n, joints: &[u32], weights: &[f64]| SkinnedMesh::new(triangle(), n, joints.to_vec(), weights.to_vec(), &eye).map(|_| ());
        assert_eq!(made(1, &[0, 1, 0], &[1.0; 3]), Ok(()));
        assert_eq!(made(0, &[], &[]), Ok(()), "vertices that nothing moves");
        assert_eq!(made(2, &[0, 0, 0, 0, 0, 2], &[1.0; 6]), Err("vertex 2: expected joints below 2, found 2".to_owned()));
        let error = "expected 2 joints and weights for each of 3 vertices, found 3 and 6";
        assert_eq!(made(2, &[0; 3], &[1.0; 6]), Err(error.to_owned()));
    }

    #[test]
    fn what_may_be_left_out_of_files_may() {
        let arrays = vec![
            ("positions".into(), Array { shape: vec![3, 3], data: Data::F64(vec![0.0; 9]) }),
            ("triangles".into(), Array { shape: vec![1, 3], data: Data::U32(vec![0, 1, 2]) }),
        ];
        assert_eq!(Mesh::from_parts(OwnedParts { arrays, ..OwnedParts::default() }), Ok(triangle()));
    }

    #[test]
    fn targets_come_by_number() {
        let positions = NdArray::new([2, 1, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        let targets = MorphTargets { positions, ..MorphTargets::default() };
        assert_eq!(targets.validate(), Ok(()));
        assert_eq!((targets.target(1), targets.target_normals(1)), (&[[4.0, 5.0, 6.0]][..], &[][..]));
    }
}
