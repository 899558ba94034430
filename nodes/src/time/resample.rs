//! `time.resample`: plays a stream on a clock of another rate, the nearest frame at each time.
//!
//! **Method** both clocks start together; the frame of the stream nearest in time is shown, the earlier where two are as near; beyond its ends it is held.
//!
//! **Source** usual practice; frames are never blended, as a blend of two drawings is a double image.
//!
//! **Fails when** never.
//!
//! **Cost** O(1) a frame; values are shared, not copied.
//!
//! ```ron
//! "walk24": (type: "time.resample", stream: "@mocap.pose", clock: "frames"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnyFrames, Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;

use super::{Retimed, frame_on};

/// Plays a stream on a clock of another rate, the nearest frame at each time.
#[derive(Node)]
#[node(
    id = "time.resample",
    version = 1,
    outputs = Retimed,
    uses_frame,
    type_from = "stream",
    example = "\"walk24\": (type: \"time.resample\", stream: \"@mocap.pose\", clock: \"frames\")"
)]
pub(crate) struct TimeResample {
    /// The stream, on any clock.
    #[input(any_clock)]
    stream: AnyFrames,
    /// Speed: 2 plays the stream twice as fast, 0.5 half as fast.
    #[input(default = 1.0, range = 0.001..=1000.0, constant)]
    speed: f64,
    /// The clock of the result.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

impl TimeResample {
    fn source(&self, cx: &Context) -> i64 {
        let source = cx.input_clock("stream");
        if self.speed == 1.0 {
            let (frame, fraction) = frame_on(source, cx.clock, cx.frame);
            return source.clamp(frame + i64::from(fraction > 0.5));
        }
        let time = (cx.frame - cx.clock.first) as f64 / cx.clock.rate() * source.rate() * self.speed;
        // Ties go to the earlier frame, as above.
        source.clamp(source.first.saturating_add((time - 0.5).ceil() as i64))
    }
}

impl PerFrame for TimeResample {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.source(cx)]
    }

    fn run(self, cx: &Context) -> Result<Retimed, NodeError> {
        Ok(Retimed { stream: self.stream.at(self.source(cx))?.clone() })
    }
}
