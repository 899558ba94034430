//! How rigs of many makers call the joints where the standard markers sit.
//!
//! A marker has several names in a rig's order of preference. Rigs put joints of no length where others have one (LHipJoint, LowerBack, Neck in the takes of
//! Carnegie Mellon); a marker is taken from the first that stands apart from the marker it hangs on, since a limb of no length has no direction.

use nalgebra::Vector3;

use super::standard::{MARKERS, Marker};

/// Names of one maker. In a name `%` stands for the side as the table has it.
#[derive(Clone, Copy, Debug)]
pub struct Naming {
    /// What it is called.
    pub name: &'static str,
    /// Left and right in two spellings, for `%` and for `&`.
    sides: [[&'static str; 2]; 2],
    /// Names of the joints of each marker, best first; those of a side once for both.
    joints: &'static [(&'static str, &'static [&'static str])],
}

const LONG: [[&str; 2]; 2] = [["Left", "Right"], ["L", "R"]];

/// HumanIK and its heirs: Mixamo, Rokoko, MotionBuilder, and Carnegie Mellon's takes as converted for MotionBuilder.
pub const HUMAN_IK: Naming = Naming {
    name: "HumanIK",
    sides: LONG,
    joints: &[
        ("pelvis", &["Hips"]),
        ("lower_back", &["LowerBack", "Spine", "Spine1"]),
        ("upper_back", &["Spine4", "Spine3", "Spine2", "Spine1"]),
        ("neck", &["Neck", "Neck1"]),
        ("head", &["Head"]),
        ("head_top", &["HeadTop_End", "HeadEnd", "Head_end", "Head_end_end"]),
        ("clavicle", &["%Shoulder"]),
        ("shoulder", &["%Arm"]),
        ("elbow", &["%ForeArm"]),
        ("wrist", &["%Hand"]),
        (
            "hand_tip",
            &[
                "%HandMiddle4",
                "%HandMiddle3_end",
                "%HandMiddle3",
                "&Fingers_end",
                "%HandIndex3_end",
                "%HandEnd_end",
                "%HandEnd",
                "%Hand_End",
                "%Hand_end",
            ],
        ),
        ("hip", &["%UpLeg", "%Thigh"]),
        ("knee", &["%Leg", "%Shin"]),
        ("ankle", &["%Foot"]),
        ("toe", &["%ToeBase", "%Toe", "%ToeBase_end", "%Toe_end", "%Toe_End"]),
    ],
};

/// Character Studio, and Carnegie Mellon's takes as converted for it: collars, shoulders, elbows, wrists, hips, knees, ankles.
pub const COLLAR: Naming = Naming {
    name: "collar",
    sides: LONG,
    joints: &[
        ("pelvis", &["Hips", "Hip"]),
        ("lower_back", &["lowerback", "Chest"]),
        ("upper_back", &["Chest4", "Chest3", "Chest2", "CS_BVH"]),
        ("neck", &["lowerneck", "Neck"]),
        ("head", &["Head"]),
        ("head_top", &["Head_end"]),
        ("clavicle", &["%Collar"]),
        ("shoulder", &["%Shoulder"]),
        ("elbow", &["%Elbow"]),
        ("wrist", &["%Wrist"]),
        ("hand_tip", &["&Fingers_end", "&Fingers", "%Wrist_end"]),
        ("hip", &["%Hip"]),
        ("knee", &["%Knee"]),
        ("ankle", &["%Ankle"]),
        ("toe", &["%Toe"]),
    ],
};

/// Acclaim, as Carnegie Mellon's own takes have it. Joints stand where their bones begin.
pub const ACCLAIM: Naming = Naming {
    name: "Acclaim",
    sides: [["l", "r"], ["l", "r"]],
    joints: &[
        ("pelvis", &["root"]),
        ("lower_back", &["lowerback", "upperback"]),
        ("upper_back", &["thorax"]),
        ("neck", &["lowerneck", "upperneck"]),
        ("head", &["head"]),
        ("head_top", &["head_end"]),
        ("clavicle", &["%clavicle"]),
        ("shoulder", &["%humerus"]),
        ("elbow", &["%radius"]),
        ("wrist", &["%wrist", "%hand"]),
        ("hand_tip", &["%fingers_end", "%fingers"]),
        ("hip", &["%femur"]),
        ("knee", &["%tibia"]),
        ("ankle", &["%foot"]),
        ("toe", &["%toes"]),
    ],
};

/// The Unreal mannequin.
pub const UNREAL: Naming = Naming {
    name: "Unreal",
    sides: [["l", "r"], ["l", "r"]],
    joints: &[
        ("pelvis", &["pelvis"]),
        ("lower_back", &["spine_01"]),
        ("upper_back", &["spine_05", "spine_04", "spine_03", "spine_02"]),
        ("neck", &["neck_01", "neck"]),
        ("head", &["head"]),
        ("head_top", &["head_end", "head_leaf"]),
        ("clavicle", &["clavicle_%"]),
        ("shoulder", &["upperarm_%"]),
        ("elbow", &["lowerarm_%"]),
        ("wrist", &["hand_%"]),
        ("hand_tip", &["middle_03_%_end", "middle_03_%"]),
        ("hip", &["thigh_%"]),
        ("knee", &["calf_%"]),
        ("ankle", &["foot_%"]),
        ("toe", &["ball_%"]),
    ],
};

/// The Biped of 3ds Max.
pub const BIPED: Naming = Naming {
    name: "Biped",
    sides: [["L", "R"], ["L", "R"]],
    joints: &[
        ("pelvis", &["Bip01 Pelvis", "Bip01", "Bip001 Pelvis", "Bip001"]),
        ("lower_back", &["Bip01 Spine", "Bip001 Spine"]),
        ("upper_back", &["Bip01 Spine3", "Bip01 Spine2", "Bip01 Spine1", "Bip001 Spine3", "Bip001 Spine2", "Bip001 Spine1"]),
        ("neck", &["Bip01 Neck", "Bip001 Neck"]),
        ("head", &["Bip01 Head", "Bip001 Head"]),
        ("head_top", &["Bip01 HeadNub", "Bip001 HeadNub", "Bip01 Head_end", "Bip001 Head_end"]),
        ("clavicle", &["Bip01 % Clavicle", "Bip001 % Clavicle"]),
        ("shoulder", &["Bip01 % UpperArm", "Bip001 % UpperArm"]),
        ("elbow", &["Bip01 % Forearm", "Bip001 % Forearm"]),
        ("wrist", &["Bip01 % Hand", "Bip001 % Hand"]),
        (
            "hand_tip",
            &["Bip01 % Finger2Nub", "Bip001 % Finger2Nub", "Bip01 % Finger2", "Bip001 % Finger2", "Bip01 % Hand_end", "Bip001 % Hand_end"],
        ),
        ("hip", &["Bip01 % Thigh", "Bip001 % Thigh"]),
        ("knee", &["Bip01 % Calf", "Bip001 % Calf"]),
        ("ankle", &["Bip01 % Foot", "Bip001 % Foot"]),
        ("toe", &["Bip01 % Toe0", "Bip001 % Toe0"]),
    ],
};

impl Naming {
    /// Names of the joint of a standard marker, best first.
    fn names(&self, marker: &str) -> Vec<String> {
        let (side, stem) = match (marker.strip_prefix("left_"), marker.strip_prefix("right_")) {
            (Some(stem), _) => (0, stem),
            (_, Some(stem)) => (1, stem),
            _ => (0, marker),
        };
        let [long, short] = self.sides.map(|spelling| spelling[side]);
        let found = self.joints.iter().find(|(name, _)| *name == stem).map_or(&[][..], |(_, joints)| joints);
        found.iter().map(|joint| joint.replace('%', long).replace('&', short)).collect()
    }
}

/// A joint's name without the space that it is in, as `mixamorig:`, in small letters.
fn plain(name: &str) -> String {
    name.rsplit([':', '|']).next().unwrap_or(name).trim().to_lowercase()
}

/// The joints of a rig under the standard markers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Match {
    /// The naming that fits.
    pub naming: &'static str,
    /// Each marker that the rig has, and its joint.
    pub joints: Vec<(&'static str, usize)>,
    /// Required markers that it does not have, and the names that were looked for.
    pub missing: Vec<(&'static str, Vec<String>)>,
}

/// The joints of the standard markers in a rig, by whichever of the namings finds most of the required ones, then most; the first of those that find as many.
/// `rest` are the joints' places at rest. `None` without namings. O(namings · joints).
pub fn matched(namings: &[Naming], names: &[String], rest: &[Vector3<f64>]) -> Option<Match> {
    let plain: Vec<String> = names.iter().map(|n| plain(n)).collect();
    let mut best: Option<Match> = None;
    for naming in namings {
        let found = matched_by(naming, &plain, rest);
        let rank = |m: &Match| (std::cmp::Reverse(m.missing.len()), m.joints.len());
        if best.as_ref().is_none_or(|b| rank(&found) > rank(b)) {
            best = Some(found);
        }
    }
    best
}

fn matched_by(naming: &Naming, plain: &[String], rest: &[Vector3<f64>]) -> Match {
    let size = rest.iter().map(|p| p.amax()).fold(1e-12, f64::max);
    let place = |j: usize| rest.get(j).copied().unwrap_or_default();
    let mut found = Match { naming: naming.name, joints: Vec::new(), missing: Vec::new() };
    for marker in &MARKERS {
        let names = naming.names(marker.name);
        let small = names.iter().map(|n| n.to_lowercase());
        let joints: Vec<usize> = small.filter_map(|n| plain.iter().position(|p| *p == n)).collect();
        let above = nearest_above(marker, &found.joints);
        let is_apart = |j: &&usize| above.is_none_or(|a| (place(**j) - place(a)).norm() > 1e-6 * size);
        match (joints.iter().find(is_apart), joints.first()) {
            (Some(&joint), _) => found.joints.push((marker.name, joint)),
            (None, Some(&joint)) if marker.is_required => found.joints.push((marker.name, joint)),
            (None, None) if marker.is_required => found.missing.push((marker.name, names)),
            _ => {}
        }
    }
    found
}

/// The joint of the nearest marker above that was found.
fn nearest_above(marker: &Marker, found: &[(&'static str, usize)]) -> Option<usize> {
    let mut above = marker.parent;
    while let Some(name) = above {
        if let Some((_, joint)) = found.iter().find(|(n, _)| *n == name) {
            return Some(*joint);
        }
        above = super::standard::find(name).and_then(|m| m.parent);
    }
    None
}
