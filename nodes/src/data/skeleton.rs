//! Characters: skeletons and their poses.

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};
use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

use crate::algo::skeleton::{Joint, order};

/// A tree of joints at rest.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Skeleton {
    /// Parent of each joint, -1 for a root.
    #[value(shape = "[j]")]
    pub parents: Vec<i64>,
    /// Each joint at rest in its parent's space (a root's in the world's), rows of a matrix for columns: metres, Y up.
    #[value(shape = "[j, 4, 4]")]
    pub parent_from_joint: NdArray<f64, 3>,
    /// Name of each joint, or none at all.
    #[value(text)]
    pub names: Vec<String>,
}

impl Skeleton {
    /// A skeleton of as many parents, rest matrices and names.
    ///
    /// # Errors
    /// Where their numbers differ, a parent is no joint, or joints are each other's parents.
    pub fn new(parents: Vec<i64>, parent_from_joint: &[Matrix4<f64>], names: Vec<String>) -> Result<Self, String> {
        let skeleton = Self { parents, parent_from_joint: stacked(parent_from_joint), names };
        skeleton.validate().map(|()| skeleton)
    }

    /// Number of joints.
    pub fn n_joints(&self) -> usize {
        self.parents.len()
    }

    /// Every joint at rest in its parent's space.
    pub fn rest(&self) -> Vec<Matrix4<f64>> {
        unstacked(&self.parent_from_joint)
    }

    /// Position of the joint `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// What keeps the parts from being a skeleton.
    ///
    /// # Errors
    /// As of [`Skeleton::new`].
    pub fn validate(&self) -> Result<(), String> {
        let j = self.parents.len();
        expect_stack(&self.parent_from_joint, j, "parent_from_joint")?;
        if !self.names.is_empty() && self.names.len() != j {
            return Err(format!("expected a name for each of {j} joints or none, found {}", self.names.len()));
        }
        order(&self.parents).map(|_| ()).map_err(|e| e.to_string())
    }
}

/// What each joint of a skeleton does: parent from joint = translation · rotation · scale.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Pose {
    /// Where each joint stands in its parent's space, metres.
    #[value(shape = "[j, 3]")]
    pub translations: Vec<[f64; 3]>,
    /// How each joint is turned: unit quaternions x, y, z, w.
    #[value(shape = "[j, 4]")]
    pub rotations: Vec<[f64; 4]>,
    /// How each joint is scaled along its own axes, before it is turned.
    #[value(shape = "[j, 3]")]
    pub scales: Vec<[f64; 3]>,
}

impl Pose {
    /// Number of joints.
    pub fn n_joints(&self) -> usize {
        self.translations.len()
    }

    /// A joint's part.
    ///
    /// # Errors
    /// Where a number of it is not finite, or its rotation has no length: joint and field by name.
    pub fn joint(&self, idx: usize) -> Result<Joint, String> {
        let (Some(t), Some(r), Some(s)) = (self.translations.get(idx), self.rotations.get(idx), self.scales.get(idx)) else {
            return Err(format!("expected a pose of more than {idx} joints, found {}", self.n_joints()));
        };
        if t.iter().chain(r).chain(s).any(|v| !v.is_finite()) {
            return Err(format!("joint {idx}: expected finite numbers, found {t:?}, {r:?}, {s:?}"));
        }
        let [x, y, z, w] = *r;
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12)
            .ok_or_else(|| format!("joint {idx}: expected a rotation as a quaternion of some length, found {r:?}"))?;
        Ok(Joint { translation: Vector3::from(*t), rotation, scale: Vector3::from(*s) })
    }

    /// All joints' parts.
    ///
    /// # Errors
    /// As of [`Pose::joint`].
    pub fn joints(&self) -> Result<Vec<Joint>, String> {
        (0..self.n_joints()).map(|j| self.joint(j)).collect()
    }

    /// What keeps the parts from being a pose.
    ///
    /// # Errors
    /// Where their numbers differ.
    pub fn validate(&self) -> Result<(), String> {
        let (t, r, s) = (self.translations.len(), self.rotations.len(), self.scales.len());
        if t == r && r == s { Ok(()) } else { Err(format!("expected as many translations, rotations and scales, found {t}, {r} and {s}")) }
    }
}

impl FromIterator<Joint> for Pose {
    fn from_iter<I: IntoIterator<Item = Joint>>(joints: I) -> Self {
        let mut pose = Self::default();
        for joint in joints {
            let q = joint.rotation.coords;
            pose.translations.push(joint.translation.into());
            pose.rotations.push([q.x, q.y, q.z, q.w]);
            pose.scales.push(joint.scale.into());
        }
        pose
    }
}

/// Matrices as `[n, 4, 4]`, rows for columns.
pub(super) fn stacked(matrices: &[Matrix4<f64>]) -> NdArray<f64, 3> {
    let rows = matrices.iter().flat_map(|m| m.transpose().as_slice().to_vec()).collect();
    NdArray::new([matrices.len(), 4, 4], rows).unwrap_or_default()
}

/// The matrices of `[n, 4, 4]`.
pub(super) fn unstacked(stack: &NdArray<f64, 3>) -> Vec<Matrix4<f64>> {
    stack.data().as_chunks::<16>().0.iter().map(|rows| Matrix4::from_row_slice(rows)).collect()
}

pub(super) fn expect_stack(stack: &NdArray<f64, 3>, n: usize, name: &str) -> Result<(), String> {
    if stack.shape() == [n, 4, 4] || n == 0 && stack.data().is_empty() {
        Ok(())
    } else {
        Err(format!("expected {name} of [{n}, 4, 4], found {:?}", stack.shape()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skeleton_says_what_is_wrong_with_it() {
        let eye = vec![Matrix4::identity(); 3];
        let made = |parents: &[i64], names: &[&str]| {
            Skeleton::new(parents.to_vec(), &eye, names.iter().map(|n| (*n).to_owned()).collect()).map(|_| ())
        };
        assert_eq!(made(&[-1, 0, 1], &["a", "b", "c"]), Ok(()));
        assert_eq!(made(&[1, -1, 1], &[]), Ok(()), "parents may come later");
        assert_eq!(made(&[-1, 0], &[]), Err("expected parent_from_joint of [2, 4, 4], found [3, 4, 4]".to_owned()));
        assert_eq!(made(&[-1, 0, 1], &["a"]), Err("expected a name for each of 3 joints or none, found 1".to_owned()));
        assert_eq!(made(&[-1, 3, 0], &[]), Err("joint 1: expected a parent from -1 to 2, found 3".to_owned()));
        assert_eq!(made(&[-1, 2, 1], &[]), Err("joint 1: expected parents that lead to a root, found a ring".to_owned()));
    }

    #[test]
    fn rows_are_written_for_columns() {
        let skeleton = Skeleton::new(vec![-1], &[Matrix4::new_translation(&Vector3::new(1.0, 2.0, 3.0))], Vec::new()).unwrap();
        assert_eq!(skeleton.parent_from_joint.data()[..4], [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(skeleton.rest()[0][(2, 3)], 3.0);
    }

    #[test]
    fn a_joint_that_is_none_is_told_by_number() {
        let mut pose = Pose { translations: vec![[0.0; 3]; 2], rotations: vec![[0.0, 0.0, 0.0, 2.0]; 2], scales: vec![[1.0; 3]; 2] };
        assert_eq!(pose.joint(1).unwrap().rotation, UnitQuaternion::identity());
        pose.rotations[1] = [0.0; 4];
        assert!(pose.joints().unwrap_err().starts_with("joint 1: expected a rotation"));
        pose.scales[0][2] = f64::NAN;
        assert!(pose.joints().unwrap_err().starts_with("joint 0: expected finite numbers"));
        pose.scales.pop();
        assert_eq!(pose.validate(), Err("expected as many translations, rotations and scales, found 2, 2 and 1".to_owned()));
    }
}
