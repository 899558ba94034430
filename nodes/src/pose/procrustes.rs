//! `pose.procrustes`: the pelvis of a figure, from markers on it.
//!
//! **Method** the topmost marked joint is brought to its marker and turned so that those next below it come nearest to theirs: singular value
//! decomposition, determinant 1 ([`crate::algo::procrustes`]). Markers on one line leave the turn about it open, which is then the nearest to that of the
//! captured motion; so is all of it where fewer are seen.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.6; Gower and Dijksterhuis, *Procrustes Problems*, 2004, chapter 4.
//!
//! **Fails when** no joint has a marker, or markers hang on trees without a common top.
//!
//! **Cost** O(joints) a frame; frames run in parallel.
//!
//! ```ron
//! "pelvis": (type: "pose.procrustes", markers: "@lift.markers", skeleton: "@capture.skeleton", fit: ["hip.l", "hip.r", "spine"]),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use super::markers::Marked;
use crate::algo::procrustes::Told;
use crate::algo::skeleton::Joint;
use crate::data::{Markers3, Pose, Skeleton};
use crate::lift::Limbs;
use crate::markers::{JointNames, Names};

/// The pelvis of a figure, from markers on it.
#[derive(Node)]
#[node(
    id = "pose.procrustes",
    version = 1,
    outputs = PoseProcrustesOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.6; Gower and Dijksterhuis 2004",
    example = "\"pelvis\": (type: \"pose.procrustes\", markers: \"@lift.markers\", skeleton: \"@capture.skeleton\")"
)]
pub(crate) struct PoseProcrustes {
    /// Where the joints are: metres, by name.
    pub(super) markers: In<Markers3>,
    /// The joints.
    pub(super) skeleton: In<Skeleton>,
    /// The captured motion, retimed: what all other joints do, and what the markers leave open. The pose at rest where it is left out.
    pub(super) prior: Option<In<Pose>>,
    /// Which names the rig's joints have: those of the standard markers are known.
    #[input(default = auto)]
    pub(super) naming: Names,
    /// Joints by the names of markers, as for `markers.from_pose`. A marker that is in neither stands on the joint of its own name.
    #[input(default = {})]
    pub(super) joints: JointNames,
    /// Markers that the topmost joint is turned to: both hips and the lower back. All that come next below it where none is listed.
    #[input(default = [])]
    pub(super) fit: Vec<String>,
}

/// The figure.
#[derive(Outputs)]
pub(crate) struct PoseProcrustesOutputs {
    /// Its pose: the topmost marked joint by the markers, the others as before.
    pub(super) pose: Pose,
    /// How that joint is turned in its parent's space: x, y, z, w.
    pub(super) rotation: Vector,
    /// How far the markers are from where they would be, root of the mean square, metres.
    pub(super) error: Curve,
    /// 1 where the markers tell all of the turn, 0.5 where they leave open that about a line, 0 where they tell none.
    pub(super) told: Curve,
}

impl PerFrame for PoseProcrustes {
    fn run(self, _cx: &Context) -> Result<PoseProcrustesOutputs, NodeError> {
        let marked = Marked { skeleton: &self.skeleton, markers: &self.markers, naming: self.naming, joints: &self.joints };
        let (rig, places) = (marked.rig(&self.fit, &Limbs(Vec::new()))?, marked.places()?);
        let rest = || {
            let joints = self.skeleton.rest().iter().map(Joint::from_matrix).collect::<Option<Vec<_>>>();
            joints.ok_or_else(|| NodeError::input("skeleton: expected joints without shear, found one"))
        };
        let mut joints = self.prior.as_deref().map_or_else(rest, |pose| marked.prior(pose))?;
        let (joint, told, error) = rig.root(&places, &joints);
        joints[rig.top()] = joint;
        let told = match told {
            Told::Rotation => 1.0,
            Told::Direction => 0.5,
            Told::Nothing => 0.0,
        };
        let q = joint.rotation.coords;
        Ok(PoseProcrustesOutputs {
            pose: joints.into_iter().collect(),
            rotation: Vector { values: vec![q.x, q.y, q.z, q.w] },
            error: Curve { value: error },
            told: Curve { value: told },
        })
    }
}
