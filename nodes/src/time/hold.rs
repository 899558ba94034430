//! `time.hold`: shows each drawing of a stream for several frames, or plays it on another clock by holding.
//!
//! **Method** the frame shown is the last at or before the time, counted in steps from the first frame; beyond its ends a stream is held.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002: film at 24 frames a second with images held for two.
//!
//! **Fails when** never.
//!
//! **Cost** O(1) a frame; values are shared, not copied.
//!
//! ```ron
//! "twos": (type: "time.hold", stream: "@track.motion", step: 2),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnyFrames, Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;

use super::{Retimed, frame_on};

/// Shows each drawing of a stream for several frames, or plays it on another clock by holding.
#[derive(Node)]
#[node(
    id = "time.hold",
    version = 1,
    outputs = Retimed,
    uses_frame,
    type_from = "stream",
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 1.1",
    example = "\"twos\": (type: \"time.hold\", stream: \"@track.motion\", step: 2)"
)]
pub(crate) struct TimeHold {
    /// The stream, on any clock.
    #[input(any_clock)]
    stream: AnyFrames,
    /// Frames of the stream that each drawing stands for: 1 on ones, 2 on twos.
    #[input(default = 1, range = 1..=1000, unit = "frames")]
    step: u32,
    /// The frame of the stream that is held throughout. Without it the stream plays.
    #[input(default = None)]
    frame: Option<i64>,
    /// The clock of the result.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

impl TimeHold {
    fn source(&self, cx: &Context) -> i64 {
        let source = cx.input_clock("stream");
        if let Some(frame) = self.frame {
            return source.clamp(frame);
        }
        let (frame, _) = frame_on(source, cx.clock, cx.frame);
        let step = i64::from(self.step.max(1));
        source.clamp(source.first + (frame - source.first).div_euclid(step) * step)
    }
}

impl PerFrame for TimeHold {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.source(cx)]
    }

    fn run(self, cx: &Context) -> Result<Retimed, NodeError> {
        Ok(Retimed { stream: self.stream.at(self.source(cx))?.clone() })
    }
}
