//! The joints of a glTF file: its nodes, as far as anything that is seen hangs on them.

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};

use super::accessor::FLOAT;
use super::error::{GltfError, item, malformed};
use super::{Document, json};
use crate::algo::skeleton::{Joint, order};

/// The skeleton of a file: joints of all skins, rigid parts, and whatever these hang on, parents first.
///
/// It is the same whichever of the file's meshes are read, so that poses fit all of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// Parent of each joint, -1 for a root.
    pub parents: Vec<i64>,
    /// Each joint at rest.
    pub rest: Vec<Joint>,
    /// Name of each joint; `node 7` for a node without one.
    pub names: Vec<String>,
    /// For each joint, joint at rest from mesh at rest; the identity where no mesh is bound.
    pub inverse_bind: Vec<Matrix4<f64>>,
    /// The joint of each node that has one.
    pub(super) joints: Vec<Option<usize>>,
    /// Joints that stand for the columns of each skin.
    pub(super) skins: Vec<Vec<u32>>,
    /// The joint that carries the mesh of each node that is not skinned.
    pub(super) rigid: Vec<Option<u32>>,
}

/// A node at rest.
fn rest(node: &json::Node, at: &str) -> Result<Joint, GltfError> {
    let joint = match &node.matrix {
        Some(columns) => Joint::from_matrix(&Matrix4::from_column_slice(columns))
            .ok_or_else(|| malformed(format!("{at}.matrix"), "expected a translation, rotation and scale, found another matrix"))?,
        None => {
            let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
            let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6)
                .ok_or_else(|| malformed(format!("{at}.rotation"), "expected a unit quaternion, found one without length"))?;
            let scale = node.scale.unwrap_or([1.0; 3]).into();
            Joint { translation: node.translation.unwrap_or_default().into(), rotation, scale }
        }
    };
    let numbers = joint.translation.iter().chain(joint.rotation.coords.iter()).chain(joint.scale.iter());
    // Larger ones would overflow where joints hang on each other.
    match numbers.into_iter().find(|v| v.is_nan() || v.abs() > f64::from(f32::MAX)) {
        Some(v) => Err(malformed(at, format!("expected finite numbers of 32 bits in its place, found {v:e}"))),
        None => Ok(joint),
    }
}

impl Document {
    /// Parent of each node, -1 for a root.
    fn parents(&self) -> Result<Vec<i64>, GltfError> {
        let nodes = &self.root.nodes;
        let mut parents = vec![-1; nodes.len()];
        for (i, node) in nodes.iter().enumerate() {
            for &child in &node.children {
                let at = format!("nodes[{i}].children");
                item(nodes, "nodes", child, &at)?;
                if parents[child] != -1 {
                    return Err(malformed(at, format!("expected one parent for each node, found two for node {child}")));
                }
                parents[child] = i as i64;
            }
        }
        order(&parents).map_err(|e| malformed("nodes", e.to_string()))?;
        Ok(parents)
    }

    /// The nodes of the scene that is shown, in the order of their numbers; all where there is no scene.
    pub(super) fn shown(&self) -> Result<Vec<usize>, GltfError> {
        let (nodes, scenes) = (&self.root.nodes, &self.root.scenes);
        if scenes.is_empty() {
            return Ok((0..nodes.len()).collect());
        }
        let scene = item(scenes, "scenes", self.root.scene.unwrap_or(0), "scene")?;
        let mut shown = vec![false; nodes.len()];
        let mut open = scene.nodes.clone();
        while let Some(node) = open.pop() {
            let children = &item(nodes, "nodes", node, "scenes")?.children;
            if !std::mem::replace(&mut shown[node], true) {
                open.extend(children);
            }
        }
        Ok((0..nodes.len()).filter(|n| shown[*n]).collect())
    }

    /// The skeleton of the file.
    ///
    /// # Errors
    /// Where nodes or skins name what there is not, are each other's parents, or are not a translation, rotation and scale each.
    pub fn rig(&self) -> Result<Rig, GltfError> {
        let nodes = &self.root.nodes;
        let parents = self.parents()?;
        let mut is_joint = vec![false; nodes.len()];
        for (i, skin) in self.root.skins.iter().enumerate() {
            let at = format!("skins[{i}].joints");
            let mut own = vec![false; nodes.len()];
            for &j in &skin.joints {
                item(nodes, "nodes", j, &at)?;
                if std::mem::replace(&mut own[j], true) {
                    return Err(malformed(at, format!("expected each joint once, found node {j} twice")));
                }
                is_joint[j] = true;
            }
            skin.skeleton.map(|s| item(nodes, "nodes", s, &format!("skins[{i}].skeleton"))).transpose()?;
        }
        (0..nodes.len()).filter(|n| nodes[*n].mesh.is_some() && nodes[*n].skin.is_none()).for_each(|n| is_joint[n] = true);
        // Children come after their parents in this order, so the other way round each hands on what hangs on it.
        let order = order(&parents).map_err(|e| malformed("nodes", e.to_string()))?;
        for &n in order.iter().rev().filter(|n| parents[**n] >= 0) {
            is_joint[parents[n] as usize] |= is_joint[n];
        }
        let mut rig = Rig { joints: vec![None; nodes.len()], rigid: vec![None; nodes.len()], ..Rig::default() };
        for n in self.depth_first(&parents).into_iter().filter(|n| is_joint[*n]) {
            rig.joints[n] = Some(rig.parents.len());
            let parent = usize::try_from(parents[n]).ok().and_then(|p| rig.joints[p]);
            rig.parents.push(parent.map_or(-1, |p| p as i64));
            rig.rest.push(rest(&nodes[n], &format!("nodes[{n}]"))?);
            rig.names.push(nodes[n].name.clone().unwrap_or_else(|| format!("node {n}")));
        }
        self.bind(&mut rig)?;
        Ok(rig)
    }

    fn depth_first(&self, parents: &[i64]) -> Vec<usize> {
        let mut open: Vec<usize> = (0..parents.len()).rev().filter(|n| parents[*n] == -1).collect();
        let mut order = Vec::with_capacity(parents.len());
        while let Some(n) = open.pop() {
            order.push(n);
            open.extend(self.root.nodes[n].children.iter().rev());
        }
        order
    }

    /// Gives every joint its inverse bind matrix, and another joint to each that skins bind in different ways.
    fn bind(&self, rig: &mut Rig) -> Result<(), GltfError> {
        let mut bound: Vec<Option<Matrix4<f64>>> = vec![None; rig.parents.len()];
        let mut places: Vec<Vec<u32>> = (0..rig.parents.len()).map(|j| vec![j as u32]).collect();
        let mut put = |rig: &mut Rig, joint: usize, matrix: Matrix4<f64>| -> u32 {
            let same = places[joint].iter().copied().find(|p| bound[*p as usize].is_none_or(|b| b == matrix));
            let place = same.unwrap_or_else(|| {
                let place = rig.parents.len() as u32;
                rig.parents.push(joint as i64);
                rig.rest.push(Joint { translation: Vector3::zeros(), rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) });
                rig.names.push(format!("{} ({})", rig.names[joint], places[joint].len() + 1));
                places[joint].push(place);
                bound.push(None);
                place
            });
            bound[place as usize] = Some(matrix);
            place
        };
        for (i, skin) in self.root.skins.iter().enumerate() {
            let at = format!("skins[{i}]");
            let matrices = match skin.inverse_bind_matrices {
                Some(accessor) => self.vectors::<16>(accessor, &["MAT4"], FLOAT, &at)?,
                None => vec![*Matrix4::identity().as_slice().as_chunks::<16>().0.first().unwrap_or(&[0.0; 16]); skin.joints.len()],
            };
            if matrices.len() < skin.joints.len() {
                let message = format!("expected an inverse bind matrix for each of {} joints, found {}", skin.joints.len(), matrices.len());
                return Err(malformed(at, message));
            }
            let last_row = |m: &[f64; 16]| [m[3], m[7], m[11], m[15]];
            let is_affine = |m: &[f64; 16]| last_row(m).iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-3);
            if let Some((j, m)) = matrices.iter().enumerate().find(|(_, m)| !is_affine(m)) {
                let message = format!("expected inverse bind matrix {j} to end in the row 0, 0, 0, 1, found {:?}", last_row(m));
                return Err(malformed(at, message));
            }
            let joints = skin.joints.iter().zip(&matrices);
            let joints = joints.map(|(n, m)| put(rig, rig.joints[*n].unwrap_or(0), Matrix4::from_column_slice(m))).collect();
            rig.skins.push(joints);
        }
        for (n, node) in self.root.nodes.iter().enumerate() {
            if let (Some(joint), true) = (rig.joints[n], node.mesh.is_some()) {
                rig.rigid[n] = Some(put(rig, joint, Matrix4::identity()));
            }
        }
        rig.inverse_bind = bound.into_iter().map(|m| m.unwrap_or_else(Matrix4::identity)).collect();
        Ok(())
    }
}
