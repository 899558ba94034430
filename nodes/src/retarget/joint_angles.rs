//! `retarget.joint_angles`: captured weights and motion put on an articulated figure.
//!
//! **Method** key poses are blended in joint-angle space, every joint by the same captured weights, any number of keys at once: rotations by their
//! weighted mean ([`crate::algo::rotation::mean`]), so that weights below 0 and above 1 turn beyond a key; translations linearly; scales by their
//! logarithms, as long as they are above nought. The captured motion of the picture then moves the roots in a plane of the world.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (articulated figures); Karcher 1977; Markley, Cheng, Crassidis, Oshman 2007.
//!
//! **Fails when** the keys have different joints, there is not one weight for each, or keys turn a joint so far apart that no mean is near them.
//!
//! **Cost** O(joints · keys) a frame; frames run in parallel.
//!
//! ```ron
//! "otter": (type: "retarget.joint_angles", poses: ["@contact", "@down", "@pass", "@up"], weights: "@capture.weights", motion: "@capture.motion"),
//! ```

use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion, Vector3};
use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::{expect_weights, in_world};
use crate::algo::in_plane::{DepthScale, Plane};
use crate::algo::rotation::{Mean, mean};
use crate::algo::skeleton::Joint;
use crate::data::{Affine2, Pose, Skeleton, Weights};

/// Captured weights and motion put on an articulated figure.
///
/// Each pose corresponds to the captured key at the same position: where one is more extreme, the other must be more so in the same way.
#[derive(Node)]
#[node(
    id = "retarget.joint_angles",
    version = 1,
    outputs = RetargetJointAnglesOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4; Karcher 1977",
    example = "\"otter\": (type: \"retarget.joint_angles\", poses: [\"@a\", \"@b\", \"@c\"], weights: \"@capture.weights\", motion: \"@capture.motion\")"
)]
pub(crate) struct RetargetJointAngles {
    /// The key poses, one for each captured key.
    pub(super) poses: List<In<Pose>>,
    /// How much of each key, for all joints alike; taken relative to their sum.
    pub(super) weights: In<Weights>,
    /// The captured motion: frame from reference, pixels. None where it is left out.
    pub(super) motion: Option<In<Affine2>>,
    /// The figure's joints, which tell its roots. The first joint is the root where it is left out.
    pub(super) skeleton: Option<In<Skeleton>>,
    /// Which mean of the keys' rotations.
    #[input(default = karcher)]
    pub(super) mean: Mean,
    /// True squashes and stretches the roots along their own axes, as far as the motion does; false leaves their size.
    #[input(default = false)]
    pub(super) squash: bool,
    /// The plane of the world that stands for the picture.
    #[input(default = xy)]
    pub(super) plane: Plane,
    /// Metres a pixel: the height of the figure over that of the drawing.
    #[input(default = 0.01, range = 0.0..=1000000.0, unit = "m/px")]
    pub(super) scale: f64,
    /// The pixel of the reference frame that stands for the world's origin: between the feet, say.
    #[input(default = (0.0, 0.0), unit = "px")]
    pub(super) origin: [f64; 2],
    /// True where down in the picture is down in the world; false takes the picture's y as it is.
    #[input(default = true)]
    pub(super) flip: bool,
    /// What the motion does to depth, where it squashes.
    #[input(default = one)]
    pub(super) depth_scale: DepthScale,
}

/// The figure.
#[derive(Outputs)]
pub(crate) struct RetargetJointAnglesOutputs {
    /// Its pose.
    pub(super) pose: Pose,
}

/// The weighted mean of a joint; `None` where its rotations have none.
fn blend(keys: &[Joint], weights: &[f64], kind: Mean) -> Option<Joint> {
    // A key by itself is that key, to the bit.
    if let [only] = weights.iter().enumerate().filter(|(_, w)| **w != 0.0).map(|(k, _)| k).collect::<Vec<_>>()[..] {
        return keys.get(only).copied();
    }
    let sum: f64 = weights.iter().sum();
    let rotations: Vec<_> = keys.iter().map(|k| k.rotation).collect();
    let rotation = mean(&rotations, weights, kind)?;
    let over = |f: &dyn Fn(&Joint) -> f64| keys.iter().zip(weights).map(|(k, w)| w / sum * f(k)).sum::<f64>();
    let scale = |i: usize| {
        // Straight lines through scales end below nought, turned inside out.
        if keys.iter().all(|k| k.scale[i] > 0.0) { libm::exp(over(&|k| libm::log(k.scale[i]))) } else { over(&|k| k.scale[i]) }
    };
    let translation = Vector3::from_fn(|i, _| over(&|k| k.translation[i]));
    Some(Joint { translation, rotation, scale: Vector3::from_fn(|i, _| scale(i)) })
}

/// Rotation and stretch of a linear map, the stretch first (polar decomposition).
fn polar(linear: &Matrix3<f64>) -> Option<(UnitQuaternion<f64>, Matrix3<f64>)> {
    let svd = linear.try_svd(true, true, f64::EPSILON, 1000)?;
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    if (u * v_t).determinant() < 0.0 {
        // The least stretched direction is the one that is mirrored.
        let least = u.column(2) * -1.0;
        u.set_column(2, &least);
    }
    let turned = u * v_t;
    Some((UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned)), turned.transpose() * linear))
}

/// A root under a motion of the world.
fn moved(joint: &Joint, world: &Matrix4<f64>, squash: bool) -> Option<Joint> {
    let linear = world.fixed_view::<3, 3>(0, 0).into_owned();
    let (rotation, stretch) = polar(&linear)?;
    let own = joint.rotation.to_rotation_matrix().into_inner();
    // Seen along the joint's own axes; what lies between them would be a shear, which a joint does not have.
    let along = (own.transpose() * stretch * own).diagonal();
    Some(Joint {
        translation: linear * joint.translation + world.fixed_view::<3, 1>(0, 3),
        rotation: rotation * joint.rotation,
        scale: if squash { joint.scale.component_mul(&along) } else { joint.scale },
    })
}

impl RetargetJointAngles {
    /// The joints of each key.
    fn keys(&self) -> Result<Vec<Vec<Joint>>, NodeError> {
        let poses = &self.poses.0;
        let first = poses.first().ok_or_else(|| NodeError::input("poses: expected one for each key, found none"))?.n_joints();
        let joints = |(k, pose): (usize, &In<Pose>)| {
            let joints = pose.joints().map_err(|e| NodeError::input(format!("key {k}: {e}")))?;
            let message = || format!("key {k}: expected {first} joints as the first key has, found {}", joints.len());
            if joints.len() == first { Ok(joints) } else { Err(NodeError::input(message())) }
        };
        poses.iter().enumerate().map(joints).collect()
    }

    fn name(&self, joint: usize) -> String {
        let name = self.skeleton.as_ref().and_then(|s| s.names.get(joint));
        name.map_or_else(|| format!("joint {joint}"), |n| format!("joint {joint}, {n:?}"))
    }

    fn roots(&self, joints: usize) -> Result<Vec<usize>, NodeError> {
        match &self.skeleton {
            Some(s) if s.n_joints() != joints => {
                Err(NodeError::input(format!("skeleton: expected {joints} joints as the poses have, found {}", s.n_joints())))
            }
            Some(s) => Ok((0..joints).filter(|j| s.parents[*j] == -1).collect()),
            None => Ok((0..joints.min(1)).collect()),
        }
    }
}

impl PerFrame for RetargetJointAngles {
    fn run(self, _cx: &Context) -> Result<RetargetJointAnglesOutputs, NodeError> {
        let (keys, weights) = (self.keys()?, &self.weights.weights);
        expect_weights(weights, keys.len())?;
        let n = keys.first().map_or(0, Vec::len);
        let mut joints = Vec::with_capacity(n);
        for j in 0..n {
            let own: Vec<Joint> = keys.iter().map(|k| k[j]).collect();
            joints.push(blend(&own, weights, self.mean).ok_or_else(|| {
                let message = format!("{}: expected keys whose rotations have a mean by {weights:?}, found none", self.name(j));
                NodeError::new(Fault::Numeric, message)
                    .help("weights add up to 1; keys turn a joint by less than half a turn from each other")
            })?);
        }
        let world = in_world(self.motion.as_deref(), (self.plane, self.scale, self.origin), self.flip, self.depth_scale)?;
        for j in self.roots(n)? {
            joints[j] = moved(&joints[j], &world, self.squash)
                .ok_or_else(|| NodeError::new(Fault::Numeric, "motion: expected an affine map with a rotation, found none"))?;
        }
        Ok(RetargetJointAnglesOutputs { pose: joints.into_iter().collect() })
    }
}
