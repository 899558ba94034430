//! `pose.resample`: a motion on another clock, or as a time map says, with poses between its frames.
//!
//! **Method** the two frames about each time are blended: places and scales straight, rotations by the shorter way at constant speed. Whole frames stay as
//! they are, to the bit; beyond its ends the motion is held. `time.resample` and `retime.apply` show the nearest frame instead, as drawings want it.
//!
//! **Source** Shoemake, *Animating Rotation with Quaternion Curves*, 1985 (slerp).
//!
//! **Fails when** the map has not as many frames as its clock, or two frames have other joints.
//!
//! **Cost** O(joints) a frame.
//!
//! ```ron
//! "film": (type: "pose.resample", pose: "@capture.pose", map: "@time.map"),
//! ```

use pegbar_engine::node::{Context, Frames, In, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::TimeMap;
use pegbar_engine::{Node, Outputs};

use crate::algo::take::between;
use crate::data::Pose;

/// A motion on another clock, or as a time map says, with poses between its frames.
#[derive(Node)]
#[node(
    id = "pose.resample",
    version = 1,
    outputs = PoseResampleOutputs,
    uses_frame,
    source = "Shoemake 1985",
    example = "\"film\": (type: \"pose.resample\", pose: \"@capture.pose\", map: \"@time.map\")"
)]
pub(crate) struct PoseResample {
    /// The motion, on any clock.
    #[input(any_clock)]
    pub(super) pose: Frames<Pose>,
    /// Frame of the motion for each frame of the result's clock, between frames too, as `retime.dtw` with `smooth` makes it. Where it is left out both clocks
    /// start together and the motion plays in its own time.
    #[input(constant)]
    pub(super) map: Option<In<TimeMap>>,
    /// Speed without a map: 2 plays twice as fast, 0.5 half as fast.
    #[input(default = 1.0, range = 0.001..=1000.0, constant)]
    pub(super) speed: f64,
    /// The clock of the result: the one that the map was made for.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    pub(super) clock: ClockName,
}

/// The motion.
#[derive(Outputs)]
pub(crate) struct PoseResampleOutputs {
    /// The figure at this frame.
    pub(super) pose: Pose,
}

impl PoseResample {
    /// The frames before and after, and how far the time is from one to the other.
    fn source(&self, cx: &Context) -> (i64, i64, f64) {
        let source = cx.input_clock("pose");
        let at = match &self.map {
            Some(map) => map.source_frames.get(cx.clock.index(cx.frame).unwrap_or(0)).copied().unwrap_or(0.0),
            None => source.first as f64 + (cx.frame - cx.clock.first) as f64 / cx.clock.rate() * source.rate() * self.speed,
        };
        let at = if at.is_finite() { at.clamp(source.first as f64, source.last as f64) } else { source.first as f64 };
        // What rounding leaves of a whole frame is that frame.
        let whole = at.round();
        if (at - whole).abs() < 1e-6 {
            return (whole as i64, whole as i64, 0.0);
        }
        (at.floor() as i64, at.floor() as i64 + 1, at - at.floor())
    }
}

impl PerFrame for PoseResample {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        let (a, b, _) = self.source(cx);
        if a == b { vec![a] } else { vec![a, b] }
    }

    fn run(self, cx: &Context) -> Result<PoseResampleOutputs, NodeError> {
        if let Some(map) = self.map.as_ref().filter(|m| m.source_frames.len() != cx.clock.len()) {
            let message = format!("map: expected one of {} frames, found {}", cx.clock.len(), map.source_frames.len());
            return Err(NodeError::input(message).help("the map was made for another clock: name that one under `clock`"));
        }
        let (first, second, t) = self.source(cx);
        let a = self.pose.at(first)?;
        if t == 0.0 {
            return Ok(PoseResampleOutputs { pose: (**a).clone() });
        }
        let b = self.pose.at(second)?;
        if a.n_joints() != b.n_joints() {
            let message =
                format!("pose: expected as many joints at frames {first} and {second}, found {} and {}", a.n_joints(), b.n_joints());
            return Err(NodeError::input(message));
        }
        let joint = |k: usize| Ok(between(&a.joint(k)?, &b.joint(k)?, t));
        let joints = (0..a.n_joints()).map(joint).collect::<Result<Vec<_>, String>>();
        Ok(PoseResampleOutputs { pose: joints.map_err(|e| NodeError::input(format!("pose: {e}")))?.into_iter().collect() })
    }
}
