//! `retime.apply`: shows at each frame the frame of a stream that a map says.
//!
//! **Method** the map's source frames, rounded to the nearest; a map of holds keeps drawings on twos, that of a time warp plays capture in an animator's timing.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.2; holds: Bregler, Loeb, Chuang, Deshpande 2002.
//!
//! **Fails when** the map has fewer frames than its clock.
//!
//! **Cost** O(1) a frame; values are shared, not copied.
//!
//! ```ron
//! "kept": (type: "retime.apply", stream: "@track.motion", map: "@holds"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnyFrames, Context, In, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::TimeMap;

use super::Retimed;

/// Shows at each frame the frame of a stream that a map says.
#[derive(Node)]
#[node(
    id = "retime.apply",
    version = 1,
    outputs = Retimed,
    uses_frame,
    type_from = "stream",
    source = "Jain, Sheikh, Hodgins 2009, section 3.2",
    example = "\"kept\": (type: \"retime.apply\", stream: \"@track.motion\", map: \"@holds\")"
)]
pub(crate) struct RetimeApply {
    /// The stream, on any clock.
    #[input(any_clock)]
    stream: AnyFrames,
    /// Source frame for each frame of the result's clock. Frames beyond the stream's ends are held; a map with too few frames is an error.
    #[input(constant)]
    map: In<TimeMap>,
    /// The clock of the result: the one that the map was made for.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

impl RetimeApply {
    fn source(&self, cx: &Context) -> i64 {
        let idx = cx.clock.index(cx.frame).unwrap_or(0);
        let frame = self.map.source_frames.get(idx).copied().unwrap_or(0.0);
        cx.input_clock("stream").clamp(frame.round() as i64)
    }
}

impl PerFrame for RetimeApply {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.source(cx)]
    }

    fn run(self, cx: &Context) -> Result<Retimed, NodeError> {
        if self.map.source_frames.len() != cx.clock.len() {
            let message = format!("expected a map of {} frames, found {}", cx.clock.len(), self.map.source_frames.len());
            return Err(NodeError::input(message).help("the map was made for another clock: name that one under `clock`"));
        }
        Ok(Retimed { stream: self.stream.at(self.source(cx))?.clone() })
    }
}
