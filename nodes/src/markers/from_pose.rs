//! `markers.from_pose`: virtual markers on the joints of a figure.
//!
//! **Method** forward kinematics: each marker is where its joint is in the world. Of the 24 standard markers ([`crate::algo::markers::standard`]) those are
//! made that the rig has: pelvis, lower_back, upper_back, neck, head, head_top, and on either side (`left_`, `right_`) clavicle, shoulder, elbow, wrist,
//! hand_tip, hip, knee, ankle, toe. A joint that stands where the marker above stands is passed over for the next that has a limb of some length.
//!
//! **Source** Jain, Sheikh, Hodgins, *Leveraging the Talent of Hand Animators to Create Three-Dimensional Animation*, 2009, section 3.1.
//!
//! **Fails when** the rig has no joint for a marker: the error names the marker, what was looked for, and what is like it; or `missing: skip`.
//!
//! **Cost** O(joints · depth) a frame.
//!
//! ```ron
//! "markers": (type: "markers.from_pose", skeleton: "@jacks.skeleton", pose: "@jacks.pose"),
//! "own": (type: "markers.from_pose", skeleton: "@fox.skeleton", pose: "@fox.pose", joints: { "tail": "b_Tail03_014", "head": "b_Head_05" }),
//! ```

use nalgebra::Vector3;
use pegbar_engine::diag::did_you_mean;
use pegbar_engine::node::{Context, In, NodeError, PerFrame, Problem};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::{Node, Outputs, Setting};
use serde::Deserialize;
use serde::de::{MapAccess, SeqAccess, Visitor};

use crate::algo::markers::naming::{ACCLAIM, BIPED, COLLAR, HUMAN_IK, Naming, UNREAL, matched};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::data::{Markers3, Pose, Skeleton};

/// Which names the rig's joints have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Names {
    /// Whichever of the others fits best.
    Auto,
    /// Carnegie Mellon's, in its own files and in BVH: `LeftUpLeg`, `LeftHip` or `lfemur`.
    Cmu,
    /// Mixamo's: `mixamorig:LeftUpLeg`.
    Mixamo,
    /// Rokoko's and HumanIK's: `LeftUpLeg` or `LeftThigh`.
    Rokoko,
    /// Those of the Unreal mannequin: `thigh_l`.
    Unreal,
    /// Those of the Biped: `Bip01 L Thigh`.
    Biped,
    /// None but those in `joints`.
    Own,
    /// Every joint is a marker by its own name.
    Every,
}

impl Names {
    fn tables(self) -> &'static [Naming] {
        match self {
            Names::Auto => &[HUMAN_IK, COLLAR, ACCLAIM, UNREAL, BIPED],
            Names::Cmu => &[HUMAN_IK, COLLAR, ACCLAIM],
            Names::Mixamo | Names::Rokoko => &[HUMAN_IK],
            Names::Unreal => &[UNREAL],
            Names::Biped => &[BIPED],
            Names::Own | Names::Every => &[],
        }
    }
}

/// What becomes of a marker without a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Unmatched {
    /// An error that names it.
    Error,
    /// It is left out.
    Skip,
}

/// Joints by the names of markers: `{ "pelvis": "Hips" }`, or pairs `[("pelvis", "Hips")]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct JointNames(pub(crate) Vec<(String, String)>);

impl<'de> Deserialize<'de> for JointNames {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Pairs;
        impl<'de> Visitor<'de> for Pairs {
            type Value = Vec<(String, String)>;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("joints by the names of markers, as { \"pelvis\": \"Hips\" }")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = map.next_entry()? {
                    pairs.push(pair);
                }
                Ok(pairs)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = list.next_element()? {
                    pairs.push(pair);
                }
                Ok(pairs)
            }
        }
        deserializer.deserialize_any(Pairs).map(Self)
    }
}

impl Setting for JointNames {
    fn type_name() -> String {
        "joints by the names of markers { \"marker\": \"joint\" }".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let found = parse_slice(text, Extensions::empty());
        found.map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
}

/// Virtual markers on the joints of a figure.
#[derive(Node)]
#[node(
    id = "markers.from_pose",
    version = 1,
    outputs = MarkersFromPoseOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.1",
    example = "\"markers\": (type: \"markers.from_pose\", skeleton: \"@jacks.skeleton\", pose: \"@jacks.pose\")"
)]
pub(crate) struct MarkersFromPose {
    /// The figure's joints.
    skeleton: In<Skeleton>,
    /// What they do.
    pose: In<Pose>,
    /// Which names the rig's joints have.
    #[input(default = auto)]
    naming: Names,
    /// Joints by the names of markers, as `{ "pelvis": "Hips" }`. These alone, in this order, with the namings `auto` and `own`; with the others they stand in
    /// place of what the naming says, and after it where it says nothing.
    #[input(default = {})]
    joints: JointNames,
    /// What becomes of a marker of `joints`, or one that every human figure has, without a joint in the rig.
    #[input(default = error)]
    missing: Unmatched,
}

/// The markers.
#[derive(Outputs)]
pub(crate) struct MarkersFromPoseOutputs {
    /// Where the joints are: metres, world space.
    markers: Markers3,
}

/// Which joints the markers of a rig sit on.
pub(crate) struct Chosen<'a> {
    pub(crate) skeleton: &'a Skeleton,
    pub(crate) naming: Names,
    pub(crate) joints: &'a JointNames,
    pub(crate) missing: Unmatched,
}

impl Chosen<'_> {
    /// Each marker and its joint.
    pub(crate) fn joints(&self) -> Result<Vec<(String, usize)>, NodeError> {
        let skeleton = self.skeleton;
        let own = |found: &mut Vec<(String, usize)>| {
            for (marker, name) in &self.joints.0 {
                match (skeleton.find(name), found.iter_mut().find(|(m, _)| m == marker)) {
                    (Some(joint), Some((_, at))) => *at = joint,
                    (Some(joint), None) => found.push((marker.clone(), joint)),
                    (None, _) if self.missing == Unmatched::Skip => {}
                    (None, _) => return Err(self.unmatched(&[(marker, std::slice::from_ref(name))])),
                }
            }
            Ok(())
        };
        let mut found = Vec::new();
        match self.naming {
            Names::Every => {
                let name = |j: usize| skeleton.names.get(j).cloned().unwrap_or_else(|| format!("joint_{j}"));
                found = (0..skeleton.n_joints()).map(|j| (name(j), j)).collect();
            }
            Names::Own => {}
            Names::Auto if !self.joints.0.is_empty() => {}
            _ => found = self.standard()?,
        }
        own(&mut found)?;
        Ok(found)
    }

    fn standard(&self) -> Result<Vec<(String, usize)>, NodeError> {
        let skeleton = self.skeleton;
        let world = world_from_joint(&skeleton.parents, &skeleton.rest()).map_err(|e| NodeError::input(format!("skeleton: {e}")))?;
        let rest: Vec<Vector3<f64>> = world.iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect();
        let found = matched(self.naming.tables(), &skeleton.names, &rest).ok_or_else(|| NodeError::internal("no naming"))?;
        let set = |marker: &str| self.joints.0.iter().any(|(m, _)| m == marker);
        let missing: Vec<(&str, &[String])> = found.missing.iter().filter(|(m, _)| !set(m)).map(|(m, n)| (*m, &n[..])).collect();
        if !missing.is_empty() && self.missing == Unmatched::Error {
            return Err(self.unmatched(&missing));
        }
        Ok(found.joints.into_iter().map(|(marker, joint)| (marker.to_owned(), joint)).collect())
    }

    /// The error that markers have no joint, with what is like the names that were looked for.
    fn unmatched(&self, missing: &[(&str, &[String])]) -> NodeError {
        let joints = &self.skeleton.names;
        let one = |(marker, names): &(&str, &[String])| {
            let like = names.iter().find_map(|n| did_you_mean(n, joints.iter().map(String::as_str)));
            let like = like.map_or_else(String::new, |l| format!(", like it `{l}`"));
            format!("`{marker}` ({}{like})", names.join(" or "))
        };
        let listed: Vec<String> = missing.iter().map(one).collect();
        let some: Vec<&str> = joints.iter().take(60).map(String::as_str).collect();
        let more = if joints.len() > 60 { ", ..." } else { "" };
        let message = format!("expected a joint for {}, found {}{more}", listed.join(", "), some.join(", "));
        NodeError::input(message).help("give `joints: { \"marker\": \"joint\" }`, or `missing: skip`")
    }
}

impl PerFrame for MarkersFromPose {
    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        let names: Vec<&String> = self.joints.0.iter().map(|(m, _)| m).collect();
        if let Some((k, twice)) = names.iter().enumerate().find(|(k, n)| names[..*k].contains(n)) {
            problems.push(Problem {
                input: "joints",
                message: format!("expected each marker once, found `{twice}` again at position {}", k + 1),
            });
        }
        if self.naming == Names::Own && names.is_empty() {
            problems.push(Problem { input: "joints", message: "expected the joints of an own naming, found none".to_owned() });
        }
        problems
    }

    fn run(self, _cx: &Context) -> Result<MarkersFromPoseOutputs, NodeError> {
        let joints = self.pose.joints().map_err(|e| NodeError::input(format!("pose: {e}")))?;
        let n = self.skeleton.n_joints();
        if joints.len() != n {
            let message = format!("expected a pose of {n} joints as in the skeleton, found {}", joints.len());
            return Err(NodeError::input(message).help("take skeleton and pose from one file"));
        }
        let local: Vec<_> = joints.iter().map(Joint::matrix).collect();
        let world = world_from_joint(&self.skeleton.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))?;
        let chosen = Chosen { skeleton: &self.skeleton, naming: self.naming, joints: &self.joints, missing: self.missing }.joints()?;
        let (names, chosen): (Vec<String>, Vec<usize>) = chosen.into_iter().unzip();
        let points = chosen.into_iter().map(|j| [world[j].m14, world[j].m24, world[j].m34]).collect();
        Ok(MarkersFromPoseOutputs { markers: Markers3 { points, names } })
    }
}
