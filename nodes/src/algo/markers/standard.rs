//! The 24 markers of a human figure, and the limbs between them.
//!
//! **Source**: Jain, Sheikh, Hodgins 2009, sections 3.1 and 3.2 (N = 24 markers; the hierarchy pelvis, back, clavicle, humerus, radius, hand). Names are those
//! of the joints where markers sit: the humerus is the limb from `left_shoulder` to `left_elbow`.

/// A marker and where it hangs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marker {
    /// Its name.
    pub name: &'static str,
    /// The marker at the other end of its limb; `None` for the pelvis.
    pub parent: Option<&'static str>,
    /// True for those that every human figure has: without them a rig is none.
    pub is_required: bool,
}

const fn marker(name: &'static str, parent: &'static str, is_required: bool) -> Marker {
    Marker { name, parent: Some(parent), is_required }
}

/// The standard markers, parents first: 16 of the upper body, then 8 of the legs.
pub const MARKERS: [Marker; 24] = [
    Marker { name: "pelvis", parent: None, is_required: true },
    marker("lower_back", "pelvis", false),
    marker("upper_back", "lower_back", false),
    marker("neck", "upper_back", false),
    marker("head", "neck", false),
    marker("head_top", "head", false),
    marker("left_clavicle", "upper_back", false),
    marker("left_shoulder", "left_clavicle", true),
    marker("left_elbow", "left_shoulder", true),
    marker("left_wrist", "left_elbow", true),
    marker("left_hand_tip", "left_wrist", false),
    marker("right_clavicle", "upper_back", false),
    marker("right_shoulder", "right_clavicle", true),
    marker("right_elbow", "right_shoulder", true),
    marker("right_wrist", "right_elbow", true),
    marker("right_hand_tip", "right_wrist", false),
    marker("left_hip", "pelvis", true),
    marker("left_knee", "left_hip", true),
    marker("left_ankle", "left_knee", true),
    marker("left_toe", "left_ankle", false),
    marker("right_hip", "pelvis", true),
    marker("right_knee", "right_hip", true),
    marker("right_ankle", "right_knee", true),
    marker("right_toe", "right_ankle", false),
];

/// How many of the first markers are of the upper body; the others are of the legs.
pub const N_UPPER: usize = 16;

/// The eight limbs of the pose descriptor, from and to: humerus, radius, femur and tibia, left and right (Jain et al. 2009, section 3.2, K = 8).
pub const DESCRIPTOR_LIMBS: [(&str, &str); 8] = [
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
];

/// The standard marker `name`.
pub fn find(name: &str) -> Option<&'static Marker> {
    MARKERS.iter().find(|m| m.name == name)
}

/// The limbs among markers of these names, as positions from and to, in the standard order: each standard marker with the nearest above it that is there. The
/// pelvis with both its ends' worth of markers missing gives none; names that are not standard are in no limb.
pub fn limbs<S: AsRef<str>>(names: &[S]) -> Vec<[usize; 2]> {
    let at = |name: &str| names.iter().position(|n| n.as_ref() == name);
    let limb = |marker: &Marker| {
        let to = at(marker.name)?;
        let mut above = marker.parent;
        while let Some(name) = above {
            if let Some(from) = at(name) {
                return Some([from, to]);
            }
            above = find(name).and_then(|m| m.parent);
        }
        None
    };
    MARKERS.iter().filter_map(limb).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markers_hang_on_one_pelvis() {
        let names: Vec<&str> = MARKERS.iter().map(|m| m.name).collect();
        let all = limbs(&names);
        assert_eq!(all.len(), 23);
        assert!(all.iter().all(|[from, to]| from < to));
        assert!(all.iter().filter(|[_, to]| *to >= N_UPPER).all(|[from, _]| *from == 0 || *from >= N_UPPER));
        assert!(DESCRIPTOR_LIMBS.iter().all(|(from, to)| find(to).is_some_and(|m| m.parent == Some(from))));
    }

    #[test]
    fn limbs_reach_over_markers_that_are_not_there() {
        let names = ["left_elbow", "tail", "left_shoulder", "pelvis", "neck"];
        assert_eq!(limbs(&names), [[3, 4], [3, 2], [2, 0]]);
        assert_eq!(limbs(&["left_elbow", "left_hip"]), Vec::<[usize; 2]>::new());
    }
}
