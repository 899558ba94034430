//! `pose.align_2d`: the limbs of capture turned in the picture as those of a drawing.
//!
//! **Method** see [`crate::algo::align_2d`]: chain by chain from the root, each limb in the drawing's direction and its own projected length, so that
//! the drawing's proportions and tremble stay out. Legs are left alone, for the feet's sake.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.4.
//!
//! **Fails when** the two have no marker in common, names repeat, or one of them is in another unit (`sizes`).
//!
//! **Cost** O(markers · chains) a frame.
//!
//! ```ron
//! "aligned": (type: "pose.align_2d", source: "@projected", target: "@drawn"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use crate::algo::align_2d::{Lengths, align_2d};
use crate::data::Markers2;
use crate::lift::{Chains, Sizes};

/// The limbs of capture turned in the picture as those of a drawing.
#[derive(Node)]
#[node(
    id = "pose.align_2d",
    version = 2,
    outputs = PoseAlign2dOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.4",
    example = "\"aligned\": (type: \"pose.align_2d\", source: \"@projected\", target: \"@drawn\")"
)]
pub(crate) struct PoseAlign2d {
    /// Capture, in time with the drawing, as the camera sees it.
    source: In<Markers2>,
    /// The drawing's markers. Those of them that are not seen leave the limbs on either side as they are.
    target: In<Markers2>,
    /// Chains of markers by name, each from its root. What the source or the target has no marker for is
    /// reached over. The upper body where nothing is said.
    #[input(default = [
        ["pelvis", "lower_back", "upper_back", "neck", "head", "head_top"],
        [
            "pelvis", "lower_back", "upper_back", "left_clavicle", "left_shoulder", "left_elbow", "left_wrist", "left_hand_tip",
        ],
        [
            "pelvis", "lower_back", "upper_back", "right_clavicle", "right_shoulder", "right_elbow", "right_wrist", "right_hand_tip",
        ],
    ])]
    chains: Chains,
    /// How long limbs are in the picture.
    #[input(default = source)]
    lengths: Lengths,
    /// What is made of limbs that are drawn more than three times longer or shorter than the camera sees the capture's.
    #[input(default = checked)]
    sizes: Sizes,
}

/// The markers.
#[derive(Outputs)]
pub(crate) struct PoseAlign2dOutputs {
    /// Of the source, in the drawing's pose: pixels.
    markers: Markers2,
}

impl PerFrame for PoseAlign2d {
    fn run(self, _cx: &Context) -> Result<PoseAlign2dOutputs, NodeError> {
        let (source, target) = (&*self.source, &*self.target);
        // The target's markers in the order of the source's; what the target does not have is not seen in it.
        let drawn = |name: &String| target.find(name).map_or([f64::NAN; 2], |k| target.points[k]);
        let drawn: Vec<[f64; 2]> = source.names.iter().map(drawn).collect();
        let there = |name: &String| source.find(name).filter(|_| target.find(name).is_some());
        let chains: Vec<Vec<usize>> = self.chains.0.iter().map(|c| c.iter().filter_map(there).collect()).collect();
        if chains.iter().all(|c| c.len() < 2) {
            let error = NodeError::input("chains: expected a limb whose markers are in source and target, found none");
            return Err(error.help("markers are found by name: `chains` says which"));
        }
        let limbs: Vec<[usize; 2]> = chains.iter().flat_map(|c| c.array_windows()).copied().collect();
        self.sizes.expect_alike(&drawn, &source.points, &limbs)?;
        Ok(PoseAlign2dOutputs {
            markers: Markers2 { points: align_2d(&source.points, &drawn, &chains, self.lengths), names: source.names.clone() },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::clock;
    use pegbar_engine::node::Cancel;
    use pegbar_engine::setting::Setting;

    fn markers(of: &[(&str, [f64; 2])]) -> Markers2 {
        Markers2 { points: of.iter().map(|m| m.1).collect(), names: of.iter().map(|m| m.0.to_owned()).collect() }
    }

    fn run(source: Markers2, target: Markers2, chains: &str) -> Result<Vec<[f64; 2]>, NodeError> {
        let node = PoseAlign2d {
            source: In::new(source),
            target: In::new(target),
            chains: Chains::parse(chains).unwrap(),
            lengths: Lengths::Source,
            sizes: Sizes::Any,
        };
        let clock = clock(1);
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() }).map(|o| o.markers.points)
    }

    #[test]
    fn markers_go_together_by_name_and_what_is_not_there_is_reached_over() {
        let source = markers(&[("pelvis", [0.0, 0.0]), ("neck", [0.0, -4.0]), ("head", [0.0, -6.0]), ("knee", [1.0, 3.0])]);
        let target = markers(&[("head", [60.0, 50.0]), ("spine", [30.0, 30.0]), ("knee", [70.0, 80.0]), ("pelvis", [50.0, 50.0])]);
        let found = run(source.clone(), target.clone(), r#"[["pelvis", "spine", "neck", "head"]]"#).unwrap();
        assert_eq!(found, [[0.0, 0.0], [0.0, -4.0], [6.0, 0.0], [1.0, 3.0]]);
        let error = run(source, target, r#"[["pelvis", "spine"]]"#).err().unwrap();
        assert_eq!(error.message, "chains: expected a limb whose markers are in source and target, found none");
    }

    #[test]
    fn a_drawing_in_another_unit_is_told() {
        let source = markers(&[("pelvis", [0.0, 0.0]), ("neck", [0.0, -4.0]), ("head", [0.0, -6.0])]);
        let target = markers(&[("pelvis", [0.0, 0.0]), ("neck", [0.0, -0.04]), ("head", [0.0, -0.06])]);
        let run = |sizes| {
            let node = PoseAlign2d {
                source: In::new(source.clone()),
                target: In::new(target.clone()),
                chains: Chains::parse(r#"[["pelvis", "neck", "head"]]"#).unwrap(),
                lengths: Lengths::Source,
                sizes,
            };
            let clock = clock(1);
            node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() }).map(|o| o.markers.points)
        };
        let error = run(Sizes::Checked).err().unwrap();
        assert!(error.message.contains("found them 0.010 times as long"), "{}", error.message);
        assert_eq!(run(Sizes::Any).unwrap(), source.points);
    }
}
