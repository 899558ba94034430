//! `pose.descriptor`: a pose in the picture as the directions of its limbs, blind to place and size.
//!
//! **Method** see [`crate::algo::pose_descriptor`]: θ = atan2 of each limb, from the x axis or from the limb above.
//!
//! **Source** Jain, Sheikh, Hodgins, *Leveraging the Talent of Hand Animators to Create Three-Dimensional Animation*, 2009, section 3.2, equation 2.
//!
//! **Fails when** a limb names a marker that there is not. A limb that points at the camera hardly has a direction: `world` and `camera`, or `lengths`,
//! give it a weight that says so.
//!
//! **Cost** O(limbs · markers) a frame.
//!
//! ```ron
//! "drawn": (type: "pose.descriptor", markers: "@markers"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Vector;
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::camera;
use crate::algo::pose_descriptor::{Reference, angles, length, true_lengths};
use crate::data::{Camera, Markers2, Markers3};
use crate::lift::Limbs;

/// What a limb without a direction is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Undefined {
    /// NaN, of weight 0: `retime.dtw` leaves it out.
    Skip,
    /// An error.
    Refuse,
}

/// A pose in the picture as the directions of its limbs.
#[derive(Node)]
#[node(
    id = "pose.descriptor",
    version = 1,
    outputs = PoseDescriptorOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.2, eq. 2",
    example = "\"drawn\": (type: \"pose.descriptor\", markers: \"@markers\")"
)]
pub(crate) struct PoseDescriptor {
    /// The joints of the drawing, or of capture as the camera sees it.
    markers: In<Markers2>,
    /// Limbs, each by the names of the markers where it begins and ends. The eight of the paper where nothing is said.
    #[input(default = [
        ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"),
        ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
    ])]
    limbs: Limbs,
    /// What directions are measured from.
    #[input(default = absolute)]
    reference: Reference,
    /// What a limb is of which an end is not seen, or which is too short.
    #[input(default = skip)]
    undefined: Undefined,
    /// Limbs no longer than this have no direction.
    #[input(default = 0.000001, range = 0.0..=1000000.0, unit = "px")]
    min_length: f64,
    /// The same markers in the world: weights are then projected over true length, as `camera` sees them.
    world: Option<In<Markers3>>,
    /// What makes the picture of `world`.
    camera: Option<In<Camera>>,
    /// True length of each limb in pixels, in place of `world`.
    lengths: Option<In<Vector>>,
}

/// The descriptor.
#[derive(Outputs)]
pub(crate) struct PoseDescriptorOutputs {
    /// Direction of each limb, radians from -π to π, anticlockwise as it is seen; NaN where it has none.
    angles: Vector,
    /// Of each limb: 0 without a direction, else projected over true length, no more than 1; 1 where nothing says how long it is.
    weights: Vector,
    /// Length of each limb in the picture, pixels; NaN where an end is not seen.
    lengths: Vector,
}

impl PoseDescriptor {
    fn true_lengths(&self, limbs: &[[usize; 2]]) -> Result<Option<Vec<f64>>, NodeError> {
        if let Some(lengths) = &self.lengths {
            if lengths.values.len() != limbs.len() {
                let message = format!("lengths: expected one for each of {} limbs, found {}", limbs.len(), lengths.values.len());
                return Err(NodeError::input(message));
            }
            return Ok(Some(lengths.values.clone()));
        }
        let Some(world) = &self.world else { return Ok(None) };
        let Some(camera) = &self.camera else {
            return Err(NodeError::input("expected `camera` where `world` is given, found none"));
        };
        let camera = camera::Camera::try_from(&**camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        Ok(Some(true_lengths(&world.points, &self.limbs.find(&world.names, "world")?, &camera)))
    }
}

impl PerFrame for PoseDescriptor {
    fn run(self, _cx: &Context) -> Result<PoseDescriptorOutputs, NodeError> {
        let points = &self.markers.points;
        let limbs = self.limbs.find(&self.markers.names, "markers")?;
        let angles = angles(points, &limbs, self.reference, self.min_length);
        let undefined = angles.iter().position(|a| a.is_nan());
        if let (Undefined::Refuse, Some(k)) = (self.undefined, undefined) {
            let (from, to) = &self.limbs.0[k];
            let message = format!("markers: expected a limb from {from:?} to {to:?} longer than {} px, found none", self.min_length);
            return Err(NodeError::input(message).help("`undefined: skip` leaves it out of the descriptor"));
        }
        let lengths: Vec<f64> = limbs.iter().map(|l| length(points, *l)).collect();
        let share = match self.true_lengths(&limbs)? {
            Some(whole) => lengths.iter().zip(&whole).map(|(l, w)| if *w > 0.0 { (l / w).min(1.0) } else { 0.0 }).collect(),
            None => vec![1.0; lengths.len()],
        };
        let weights = angles.iter().zip(share).map(|(a, s): (&f64, f64)| if a.is_nan() || s.is_nan() { 0.0 } else { s }).collect();
        Ok(PoseDescriptorOutputs {
            angles: Vector { values: angles },
            weights: Vector { values: weights },
            lengths: Vector { values: lengths },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::clock;
    use pegbar_engine::node::Cancel;
    use pegbar_engine::setting::Setting;

    fn named(points: &[[f64; 2]]) -> Markers2 {
        Markers2 { points: points.to_vec(), names: ["a", "b", "c"].map(str::to_owned).to_vec() }
    }

    fn node(points: &[[f64; 2]], limbs: &str) -> PoseDescriptor {
        PoseDescriptor {
            markers: In::new(named(points)),
            limbs: Limbs::parse(limbs).unwrap(),
            reference: Reference::Absolute,
            undefined: Undefined::Skip,
            min_length: 1e-6,
            world: None,
            camera: None,
            lengths: None,
        }
    }

    fn run(node: PoseDescriptor) -> Result<PoseDescriptorOutputs, NodeError> {
        let clock = clock(1);
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
    }

    const POINTS: [[f64; 2]; 3] = [[0.0, 0.0], [3.0, -4.0], [3.0, -4.0]];

    #[test]
    fn a_limb_of_no_length_counts_nothing_or_is_refused() {
        let found = run(node(&POINTS, r#"[("a", "b"), ("b", "c")]"#)).unwrap();
        assert_eq!((&found.weights.values[..], found.lengths.values[0]), (&[1.0, 0.0][..], 5.0));
        assert!(found.angles.values[0] > 0.0 && found.angles.values[1].is_nan());
        let error = run(PoseDescriptor { undefined: Undefined::Refuse, ..node(&POINTS, r#"[("a", "b"), ("b", "c")]"#) }).err().unwrap();
        assert_eq!(error.message, "markers: expected a limb from \"b\" to \"c\" longer than 0.000001 px, found none");
    }

    #[test]
    fn foreshortened_limbs_weigh_less() {
        let lengths = Some(In::new(Vector { values: vec![10.0] }));
        let found = run(PoseDescriptor { lengths, ..node(&POINTS, r#"[("a", "b")]"#) }).unwrap();
        assert_eq!(found.weights.values, [0.5]);
        let lengths = Some(In::new(Vector { values: vec![] }));
        assert!(run(PoseDescriptor { lengths, ..node(&POINTS, r#"[("a", "b")]"#) }).is_err());
    }

    #[test]
    fn limbs_are_found_by_name() {
        let error = run(node(&POINTS, r#"[("a", "tail")]"#)).err().unwrap();
        assert_eq!(error.message, "markers: expected a marker \"tail\", found none");
        let error = Limbs::parse("[(\"a\")]").unwrap_err();
        assert!(!error.message.is_empty());
    }
}
