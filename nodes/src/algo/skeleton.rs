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

/// Joints such that each comes after its parent; those of one depth in the order of their numbers. Cost: O(joints · depth).
///
/// # Errors
/// Where a parent is no joint, or joints are each other's parents.
pub fn order(parents: &[i64]) -> Result<Vec<usize>, TreeError> {
    let n = parents.len();
    let mut depths = Vec::with_capacity(n);
    for joint in 0..n {
        let (mut depth, mut at) = (0, joint);
        while parents[at] != -1 {
            let parent = parents[at];
            at = usize::try_from(parent).ok().filter(|p| *p < n).ok_or(TreeError::NoParent { joint: at, n, found: parent })?;
            depth += 1;
            if depth > n {
                return Err(TreeError::Ring { joint });
            }
        }
        depths.push(depth);
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
