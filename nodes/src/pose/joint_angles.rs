//! `pose.joint_angles`: the pose of a skeleton from markers on its joints, and a captured motion.
//!
//! **Method** the topmost marked joint is brought to its marker and turned by Procrustes to those next below ([`crate::algo::procrustes`]); every other bone
//! is turned to its marker and keeps the captured turn about itself ([`crate::algo::joint_angles`]). Bones have the rig's lengths, or are stretched to the
//! markers. Markers are found by name; others than the joints' are left out, and joints without one do what they do in the captured motion.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.6; Gower and Dijksterhuis 2004, chapter 4.
//!
//! **Fails when** no joint has a marker, markers hang on trees without a common top, the map names a joint that there is not, or the captured pose has other
//! joints. A marker that is not seen (NaN) leaves its bone as captured.
//!
//! **Cost** O(joints) a frame; frames run in parallel.
//!
//! ```ron
//! "lifted": (type: "pose.joint_angles", markers: "@lift.markers", prior: "@retimed", skeleton: "@capture.skeleton"),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::markers::Marked;
use crate::algo::joint_angles::{Aim, Options, Reading};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::data::{Markers3, Pose, Skeleton};
use crate::lift::Limbs;
use crate::markers::{JointNames, Names};

/// The pose of a skeleton from markers on its joints, and a captured motion.
#[derive(Node)]
#[node(
    id = "pose.joint_angles",
    version = 1,
    outputs = PoseJointAnglesOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.6",
    example = "\"lifted\": (type: \"pose.joint_angles\", markers: \"@lift.markers\", prior: \"@retimed\", skeleton: \"@capture.skeleton\")"
)]
pub(crate) struct PoseJointAngles {
    /// Where the joints are to be: metres, by name.
    pub(super) markers: In<Markers3>,
    /// The captured motion, retimed: turns about bones, and all that no marker tells.
    pub(super) prior: In<Pose>,
    /// The joints of both.
    pub(super) skeleton: In<Skeleton>,
    /// Which names the rig's joints have: those of the standard markers are known.
    #[input(default = auto)]
    pub(super) naming: Names,
    /// Joints by the names of markers, as for `markers.from_pose`. A marker that is in neither stands on the joint of its own name.
    #[input(default = {})]
    pub(super) joints: JointNames,
    /// Bones from marker to marker, for joints from which several go: the one that a joint points along. The one that goes straightest on where none is listed.
    #[input(default = [])]
    pub(super) limbs: Limbs,
    /// Markers that the topmost joint is turned to: both hips and the lower back. All that come next below it where none is listed.
    #[input(default = [])]
    pub(super) fit: Vec<String>,
    /// How a bone's direction and its captured turn become a rotation.
    #[input(default = swing_twist)]
    pub(super) reading: Reading,
    /// Where a bone begins that points at a marker: at its joint, or at its joint's marker. The same where bones are as long as between markers.
    #[input(default = marker)]
    pub(super) aim: Aim,
    /// How far bones are stretched from the rig's length to that between the markers, their volume kept: 0 not at all, 1 so that every joint is at its marker.
    #[input(default = 0.0, range = 0.0..=1.0)]
    pub(super) stretch: f64,
}

/// The figure.
#[derive(Outputs)]
pub(crate) struct PoseJointAnglesOutputs {
    /// Its pose.
    pub(super) pose: Pose,
    /// How far the worst joint is from its marker, metres.
    pub(super) error: Curve,
}

impl PerFrame for PoseJointAngles {
    fn run(self, _cx: &Context) -> Result<PoseJointAnglesOutputs, NodeError> {
        let marked = Marked { skeleton: &self.skeleton, markers: &self.markers, naming: self.naming, joints: &self.joints };
        let (rig, places) = (marked.rig(&self.fit, &self.limbs)?, marked.places()?);
        let options = Options { reading: self.reading, aim: self.aim, stretch: self.stretch.clamp(0.0, 1.0) };
        let joints = rig.solve(&places, &marked.prior(&self.prior)?, options);
        let local: Vec<_> = joints.iter().map(Joint::matrix).collect();
        let world = world_from_joint(&self.skeleton.parents, &local).map_err(|e| NodeError::input(e.to_string()))?;
        let miss = |(m, place): (&nalgebra::Matrix4<f64>, &Option<Vector3<f64>>)| place.map(|p| (m.fixed_view::<3, 1>(0, 3) - p).norm());
        let error = world.iter().zip(&places).filter_map(miss).fold(0.0, f64::max);
        Ok(PoseJointAnglesOutputs { pose: joints.into_iter().collect(), error: Curve { value: error } })
    }
}
