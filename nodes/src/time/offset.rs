//! `time.offset`: plays a stream earlier or later.
//!
//! **Method** frame f shows frame f - `frames` of the stream; beyond its ends it is held, looped, or played to and fro.
//!
//! **Source** usual practice.
//!
//! **Fails when** never.
//!
//! **Cost** O(1) a frame; values are shared, not copied.
//!
//! ```ron
//! "later": (type: "time.offset", stream: "@walk", frames: 6, outside: loop),
//! ```

use pegbar_engine::node::{AnyFrames, Context, NodeError, PerFrame};
use pegbar_engine::{Node, Setting};

use super::Retimed;

/// What is shown before the first frame of a stream and after its last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Outside {
    /// The nearest frame, held.
    Hold,
    /// The stream over again.
    Loop,
    /// The stream to and fro, its ends shown once.
    Bounce,
}

/// Plays a stream earlier or later.
#[derive(Node)]
#[node(
    id = "time.offset",
    version = 1,
    outputs = Retimed,
    uses_frame,
    type_from = "stream",
    example = "\"later\": (type: \"time.offset\", stream: \"@walk\", frames: 6, outside: loop)"
)]
pub(crate) struct TimeOffset {
    /// The stream.
    stream: AnyFrames,
    /// How many frames later it plays; negative plays it earlier.
    #[input(default = 0, range = -1000000..=1000000, unit = "frames")]
    frames: i64,
    /// What is shown beyond its ends.
    #[input(default = hold)]
    outside: Outside,
}

impl TimeOffset {
    fn source(&self, cx: &Context) -> i64 {
        let clock = cx.input_clock("stream");
        let (n, k) = (clock.len() as i64, cx.frame - self.frames - clock.first);
        let k = match self.outside {
            Outside::Hold => k.clamp(0, n - 1),
            Outside::Loop => k.rem_euclid(n.max(1)),
            Outside::Bounce => {
                let period = (2 * (n - 1)).max(1);
                let k = k.rem_euclid(period);
                k.min(period - k).min(n - 1)
            }
        };
        clock.first + k
    }
}

impl PerFrame for TimeOffset {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.source(cx)]
    }

    fn run(self, cx: &Context) -> Result<Retimed, NodeError> {
        Ok(Retimed { stream: self.stream.at(self.source(cx))?.clone() })
    }
}
