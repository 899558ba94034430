//! `time.pick`: one frame of a stream, as a value for the whole graph.
//!
//! **Method** the value at `frame`; no other frame is made.
//!
//! **Source** usual practice.
//!
//! **Fails when** the stream does not have that frame.
//!
//! **Cost** O(1); the value is shared, not copied.
//!
//! ```ron
//! "first": (type: "time.pick", stream: "@track.motion", frame: 1),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnyFrames, Context, NodeError, Whole};

use super::Retimed;

/// One frame of a stream, as a value for the whole graph.
#[derive(Node)]
#[node(
    id = "time.pick",
    version = 1,
    kind = whole,
    outputs = Retimed,
    type_from = "stream",
    example = "\"first\": (type: \"time.pick\", stream: \"@track.motion\", frame: 1)"
)]
pub(crate) struct TimePick {
    /// The stream.
    stream: AnyFrames,
    /// Which frame of it. The first where it is left out.
    #[input(default = None)]
    frame: Option<i64>,
}

impl Whole for TimePick {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.frame.unwrap_or(cx.input_clock("stream").first)]
    }

    fn run(self, cx: &Context) -> Result<Retimed, NodeError> {
        let frame = self.reads("stream", cx)[0];
        Ok(Retimed { stream: self.stream.at(frame)?.clone() })
    }
}
