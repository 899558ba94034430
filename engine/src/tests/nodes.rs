//! Nodes of numbers for the engine's own tests.

use std::sync::Arc;

use crate::clock::Clock;
use crate::node::{AnyFrames, Context, Frames, In, List, NodeError, PerFrame, Picked, Recurrent, Sequence, Stream, Whole};
use crate::registry::Registry;
use crate::setting::ClockName;
use crate::value::{Curve, TimeMap, ValueRef};
use crate::{Node, Outputs};

/// One number.
#[derive(Outputs)]
pub(super) struct Number {
    /// It.
    pub(super) value: Curve,
}

fn number(value: f64) -> Result<Number, NodeError> {
    Ok(Number { value: Curve { value } })
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "test.frame", version = 1, kind = source, outputs = Number, uses_frame)]
pub(super) struct FrameNumber {
    /// Clock.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "read by the checker")]
    clock: ClockName,
}

impl PerFrame for FrameNumber {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        number(cx.frame as f64)
    }
}

/// A sum of two.
#[derive(Node)]
#[node(id = "test.add", version = 1, outputs = Number)]
pub(super) struct Add {
    /// One.
    a: f64,
    /// The other.
    #[input(default = 0.0, range = -1000.0..=1000.0, unit = "px")]
    b: f64,
}

impl PerFrame for Add {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        number(self.a + self.b)
    }
}

/// The mean of a window of frames.
#[derive(Node)]
#[node(id = "test.window", version = 1, outputs = Number)]
pub(super) struct Window {
    /// The stream.
    stream: Frames<Curve>,
    /// Frames to each side.
    #[input(default = 1, range = 0..=10)]
    radius: u32,
}

impl PerFrame for Window {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        let r = i64::from(self.radius);
        (cx.frame - r..=cx.frame + r).map(|f| cx.clock.clamp(f)).collect()
    }
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        let frames = self.reads("stream", cx);
        let mut sum = 0.0;
        for &f in &frames {
            sum += self.stream.at(f)?.value;
        }
        number(sum / frames.len() as f64)
    }
}

/// The sum of a stream so far.
#[derive(Node)]
#[node(id = "test.total", version = 1, kind = recurrent, outputs = Number)]
pub(super) struct Total {
    /// The stream.
    stream: In<Curve>,
    /// The frame where it starts, in both directions.
    #[input(default = 1)]
    start: i64,
}

impl Recurrent for Total {
    type State = Curve;
    fn previous(&self, cx: &Context) -> Option<i64> {
        match cx.frame.cmp(&self.start) {
            std::cmp::Ordering::Less => Some(cx.frame + 1),
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(cx.frame - 1),
        }
    }
    fn run(self, state: Option<&Curve>, _cx: &Context) -> Result<(Number, Curve), NodeError> {
        let total = state.map_or(0.0, |s| s.value) + self.stream.value;
        Ok((number(total)?, Curve { value: total }))
    }
}

/// Length and values of a sequence, and a map that plays it backwards.
#[derive(Outputs)]
pub(super) struct Summary {
    /// Sum of all.
    sum: Curve,
    /// Backwards.
    map: TimeMap,
    /// Each less the mean.
    centred: Stream<Curve>,
}

/// Looks at a whole sequence.
#[derive(Node)]
#[node(id = "test.summary", version = 1, kind = whole, outputs = Summary)]
pub(super) struct Summarise {
    /// The sequence.
    stream: Sequence<Curve>,
}

impl Whole for Summarise {
    fn run(self, cx: &Context) -> Result<Summary, NodeError> {
        let values = (0..self.stream.len()).map(|i| Ok(self.stream.get(i)?.value)).collect::<Result<Vec<f64>, NodeError>>()?;
        let sum: f64 = values.iter().sum();
        let mean = sum / values.len() as f64;
        let map = TimeMap { source_frames: cx.clock.frames().map(|f| (cx.clock.last + cx.clock.first - f) as f64).collect() };
        let centred = Stream(values.iter().map(|v| Curve { value: v - mean }).collect());
        Ok(Summary { sum: Curve { value: sum }, map, centred })
    }
}

/// Adds up some frames of a sequence.
#[derive(Node)]
#[node(id = "test.some", version = 1, kind = whole, outputs = Number)]
pub(super) struct SumOfSome {
    /// The sequence.
    stream: Picked<Curve>,
    /// The frames.
    frames: Vec<i64>,
}

impl Whole for SumOfSome {
    fn reads(&self, _input: &str, _cx: &Context) -> Vec<i64> {
        self.frames.clone()
    }
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        let values = (0..self.frames.len()).map(|i| Ok(self.stream.get(i)?.value)).collect::<Result<Vec<f64>, NodeError>>()?;
        number(values.into_iter().sum())
    }
}

/// Any value.
#[derive(Outputs)]
pub(super) struct Same {
    /// It.
    pub(super) value: ValueRef,
}

/// Any stream at the frames that a map says.
#[derive(Node)]
#[node(id = "test.retime", version = 1, outputs = Same, type_from = "stream", uses_frame)]
pub(super) struct Retime {
    /// The stream.
    #[input(any_clock)]
    stream: AnyFrames,
    /// The map.
    #[input(constant)]
    map: In<TimeMap>,
    /// The clock of the map.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "read by the checker")]
    clock: ClockName,
}

impl Retime {
    fn source(&self, cx: &Context) -> i64 {
        let idx = cx.clock.index(cx.frame).unwrap_or(0);
        self.map.source_frames.get(idx).copied().unwrap_or(0.0) as i64
    }
}

impl PerFrame for Retime {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![self.source(cx)]
    }
    fn run(self, cx: &Context) -> Result<Same, NodeError> {
        Ok(Same { value: self.stream.at(self.source(cx))?.clone() })
    }
}

/// Fails at one frame.
#[derive(Node)]
#[node(id = "test.fail", version = 1, outputs = Number)]
pub(super) struct Fail {
    /// Handed on.
    a: f64,
    /// Where it fails.
    #[input(default = 3)]
    at: i64,
    /// True for a panic.
    #[input(default = false)]
    panic: bool,
}

impl PerFrame for Fail {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        assert!(!(self.panic && cx.frame == self.at), "it fell over");
        if cx.frame == self.at { Err(NodeError::input("expected a good frame, found a bad one")) } else { number(self.a) }
    }
}

/// Takes streams and does nothing with them.
#[derive(Node)]
#[node(id = "test.sink", version = 1, kind = sink)]
pub(super) struct Sink {
    /// What is taken.
    #[allow(dead_code, reason = "it does nothing with them")]
    streams: List<In<Curve>>,
}

impl PerFrame for Sink {
    fn run(self, _cx: &Context) -> Result<(), NodeError> {
        Ok(())
    }
}

pub(crate) fn registry() -> Registry {
    Registry::new()
        .per_frame::<FrameNumber>()
        .per_frame::<Add>()
        .per_frame::<Window>()
        .recurrent::<Total>()
        .whole::<Summarise>()
        .whole::<SumOfSome>()
        .per_frame::<Retime>()
        .per_frame::<Fail>()
        .per_frame::<Sink>()
}

pub(super) fn clock(first: i64, last: i64) -> Arc<Clock> {
    Arc::new(Clock { name: "frames".to_owned(), first, last, fps: (24, 1) })
}
