//! Which marker follows which joint.

use nalgebra::Vector3;
use pegbar_engine::node::NodeError;

use crate::algo::joint_angles::Rig;
use crate::algo::skeleton::Joint;
use crate::data::{Markers3, Pose, Skeleton};
use crate::lift::Limbs;
use crate::markers::{Chosen, JointNames, Names, Unmatched};

/// Markers of a frame on the joints of a skeleton.
pub(super) struct Marked<'a> {
    pub(super) skeleton: &'a Skeleton,
    pub(super) markers: &'a Markers3,
    pub(super) naming: Names,
    pub(super) joints: &'a JointNames,
}

impl Marked<'_> {
    /// The joint of each marker: by the map and the naming, else the one of the same name; `None` where there is none of that name.
    fn of(&self) -> Result<Vec<Option<usize>>, NodeError> {
        if self.markers.names.is_empty() && !self.markers.points.is_empty() {
            return Err(NodeError::input("markers: expected names, found none").help("markers find their joints by name"));
        }
        if let Some((marker, joint)) = self.joints.0.iter().find(|(_, joint)| self.skeleton.find(joint).is_none()) {
            return Err(self.no_joint(marker, joint));
        }
        // A rig that is no human figure has few of the standard markers, or none.
        let chosen = Chosen { skeleton: self.skeleton, naming: self.naming, joints: self.joints, missing: Unmatched::Skip }.joints()?;
        let joint =
            |name: &String| chosen.iter().find(|(marker, _)| marker == name).map(|(_, joint)| *joint).or_else(|| self.skeleton.find(name));
        let found: Vec<_> = self.markers.names.iter().map(joint).collect();
        let mut used = vec![None; self.skeleton.n_joints()];
        for (marker, joint) in found.iter().enumerate().filter_map(|(m, j)| j.map(|j| (m, j))) {
            if let Some(other) = used[joint].replace(marker) {
                let [a, b] = [other, marker].map(|m: usize| self.markers.names.get(m).cloned().unwrap_or_default());
                let joint = self.skeleton.names.get(joint).cloned().unwrap_or_default();
                return Err(NodeError::input(format!("markers: expected one for a joint, found {a:?} and {b:?} for {joint:?}")));
            }
        }
        Ok(found)
    }

    fn no_joint(&self, marker: &str, joint: &str) -> NodeError {
        let names = self.skeleton.names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
        NodeError::input(format!("joints: expected a joint of the skeleton for {marker:?}, found {joint:?}"))
            .help(format!("the joints are {names}"))
    }

    /// Where each joint's marker is.
    pub(super) fn places(&self) -> Result<Vec<Option<Vector3<f64>>>, NodeError> {
        let mut places = vec![None; self.skeleton.n_joints()];
        for (point, joint) in self.markers.points.iter().zip(self.of()?) {
            if let Some(joint) = joint.filter(|_| point.iter().all(|v| v.is_finite())) {
                places[joint] = Some(Vector3::from(*point));
            }
        }
        Ok(places)
    }

    /// The joint of a marker that a setting names.
    fn named(&self, setting: &str, marker: &str) -> Result<usize, NodeError> {
        let at = self.markers.find(marker).and_then(|m| self.of().ok()?.get(m).copied().flatten());
        at.ok_or_else(|| {
            let names = self.markers.names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
            NodeError::input(format!("{setting}: expected a marker that has a joint, found {marker:?}"))
                .help(format!("the markers are {names}"))
        })
    }

    /// The rig that the markers follow. A marker that is not seen at this frame still is one.
    pub(super) fn rig(&self, fit: &[String], limbs: &Limbs) -> Result<Rig, NodeError> {
        let mut marked = vec![false; self.skeleton.n_joints()];
        self.of()?.into_iter().flatten().for_each(|j| marked[j] = true);
        let fit = fit.iter().map(|m| self.named("fit", m)).collect::<Result<Vec<_>, _>>()?;
        let bone = |(from, to): &(String, String)| Ok((self.named("limbs", from)?, self.named("limbs", to)?));
        let bones = limbs.0.iter().map(bone).collect::<Result<Vec<_>, NodeError>>()?;
        let rig = Rig::new(&self.skeleton.parents, &self.skeleton.rest(), &marked, &fit, &bones);
        rig.map_err(|e| NodeError::input(format!("markers: {e}")).help("`joints` says which joint a marker stands on"))
    }

    /// What the joints do in a captured motion.
    pub(super) fn prior(&self, pose: &Pose) -> Result<Vec<Joint>, NodeError> {
        let joints = pose.joints().map_err(|e| NodeError::input(format!("prior: {e}")))?;
        let n = self.skeleton.n_joints();
        let message = || format!("prior: expected {n} joints as in the skeleton, found {}", joints.len());
        if joints.len() == n { Ok(joints) } else { Err(NodeError::input(message())) }
    }
}
