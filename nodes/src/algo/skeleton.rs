//! Trees of joints: their order, and where each stands.

use nalgebra::{Matrix3, Matrix4, Rotation3, RowVector4, UnitQuaternion, Vector3};
use thiserror::Error;

/// A joint in its parent's space: parent from joint = translation · rotation · scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Where it stands, metres.
    pub translation: Vector3<f64>,
    /// How it is turned.
    pub rotation: UnitQuaternion<f64>,
    /// How it is scaled along its own axes, before it is turned.
    pub scale: Vector3<f64>,
}

impl Joint {
    /// Parent from joint.
    pub fn matrix(&self) -> Matrix4<f64> {
        let mut m = self.rotation.to_homogeneous();
        for c in 0..3 {
            let column = m.column(c) * self.scale[c];
            m.set_column(c, &column);
        }
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }

    /// Translation, rotation and scale of a matrix; `None` where it has a shear of more than 1e-4, a perspective, or no inverse.
    pub fn from_matrix(m: &Matrix4<f64>) -> Option<Self> {
        let linear: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
        let mut scale = Vector3::new(linear.column(0).norm(), linear.column(1).norm(), linear.column(2).norm());
        if linear.determinant() < 0.0 {
            scale.x = -scale.x;
        }
        if scale.iter().any(|s| *s == 0.0 || !s.is_finite()) {
            return None;
        }
        let turned = Matrix3::from_columns(&[linear.column(0) / scale.x, linear.column(1) / scale.y, linear.column(2) / scale.z]);
        let is_rotation = (turned.transpose() * turned - Matrix3::identity()).amax() < 1e-4;
        let has_last_row = (m.row(3) - RowVector4::new(0.0, 0.0, 0.0, 1.0)).amax() < 1e-6;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned));
        (is_rotation && has_last_row).then_some(Joint { translation: m.fixed_view::<3, 1>(0, 3).into_owned(), rotation, scale })
    }
}

/// Why parents do not make a tree.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TreeError {
    /// A parent is no joint.
    #[error("joint {joint}: expected a parent from -1 to {}, found {found}", *.n as i64 - 1)]
    NoParent {
        /// The joint.
        joint: usize,
        /// Number of joints.
        n: usize,
        /// Its parent.
        found: i64,
    },
    /// Joints are each other's parents.
    #[error("joint {joint}: expected parents that lead to a root, found a ring")]
    Ring {
        /// A joint of the ring, or below it.
        joint: usize,
    },
}

/// Joints such that each comes after its parent; those of one depth in the order of their numbers. Cost: O(n log n).
///
/// # Errors
/// Where a parent is no joint, or joints are each other's parents.
pub fn order(parents: &[i64]) -> Result<Vec<usize>, TreeError> {
    const UNKNOWN: usize = usize::MAX;
    let n = parents.len();
    let mut depths = vec![UNKNOWN; n];
    let mut way = Vec::new();
    for joint in 0..n {
        let mut at = joint;
        while depths[at] == UNKNOWN && parents[at] != -1 {
            way.push(at);
            let parent = parents[at];
            at = usize::try_from(parent).ok().filter(|p| *p < n).ok_or(TreeError::NoParent { joint: at, n, found: parent })?;
            if way.len() > n {
                return Err(TreeError::Ring { joint });
            }
        }
        if depths[at] == UNKNOWN {
            depths[at] = 0;
        }
        let mut depth = depths[at];
        for joint in way.drain(..).rev() {
            depth += 1;
            depths[joint] = depth;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&j| depths[j]);
    Ok(order)
}

/// World from joint, from each joint's parent from joint.
///
/// # Errors
/// As of [`order`].
pub fn world_from_joint(parents: &[i64], parent_from_joint: &[Matrix4<f64>]) -> Result<Vec<Matrix4<f64>>, TreeError> {
    let mut world = parent_from_joint.to_vec();
    for joint in order(parents)? {
        if let (Ok(parent), Some(own)) = (usize::try_from(parents[joint]), parent_from_joint.get(joint)) {
            world[joint] = world[parent] * own;
        }
    }
    Ok(world)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_follow_their_parents_by_depth() {
        assert_eq!(order(&[2, 0, -1, 2, 1, -1]).unwrap(), [2, 5, 0, 3, 1, 4]);
        assert_eq!(order(&[]).unwrap(), [0_usize; 0]);
        // A chain whose root comes last, too long for a walk from each of its joints.
        let n = 200_000;
        let chain: Vec<i64> = (0..n).map(|i| if i + 1 < n { i + 1 } else { -1 }).collect();
        assert!(order(&chain).unwrap().into_iter().eq((0..n as usize).rev()));
    }

    #[test]
    fn rings_and_parents_that_are_none_are_told() {
        assert_eq!(order(&[-1, 2, 3, 1]), Err(TreeError::Ring { joint: 1 }));
        assert_eq!(order(&[-1, 0, 7]), Err(TreeError::NoParent { joint: 2, n: 3, found: 7 }));
        assert_eq!(order(&[-2]), Err(TreeError::NoParent { joint: 0, n: 1, found: -2 }));
    }
}
