//! What a wedge remembers of each variant: a small picture of a few frames, and its numbers.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use pegbar_engine::exec::{Observer, Results};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::job::FrameSet;
use pegbar_engine::plan::Plan;
use pegbar_engine::value::{Curve, Value, ValueRef, downcast};

use crate::report::{Thumb, thumb};

/// Frames of a stream whose numbers are read back from the cache, at most.
const MOST_FRAMES: usize = 2000;
const MOST_BYTES: u64 = 256 << 20;

/// Watches the run of one variant.
pub(super) struct Probe<'a> {
    /// The picture, and its frames; that in the middle where none are named.
    port: Option<Port>,
    at: Option<&'a FrameSet>,
    size: [usize; 2],
    /// Outputs whose numbers are wanted.
    numbers: Vec<Port>,
    seen: Mutex<Seen>,
}

/// What was seen.
#[derive(Default)]
pub(super) struct Seen {
    frames: Vec<i64>,
    /// Frames that are needed of each output of numbers.
    needed: BTreeMap<Port, Vec<i64>>,
    pub(super) pictures: BTreeMap<Option<i64>, Thumb>,
    pub(super) numbers: BTreeMap<Port, BTreeMap<Option<i64>, f64>>,
}

impl<'a> Probe<'a> {
    pub(super) fn new(port: Option<Port>, at: Option<&'a FrameSet>, size: [usize; 2], numbers: Vec<Port>) -> Self {
        Self { port, at, size, numbers, seen: Mutex::default() }
    }

    pub(super) fn end(self) -> Seen {
        self.seen.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self, port: Port, frame: Option<i64>, value: &ValueRef) {
        if self.numbers.contains(&port)
            && let Some(curve) = downcast::<Curve>(value.clone())
        {
            self.seen().numbers.entry(port).or_default().insert(frame, curve.value);
        }
        let is_shown = self.port == Some(port) && frame.is_none_or(|f| self.seen().frames.contains(&f));
        if is_shown && let Some(picture) = thumb(value, self.size) {
            self.seen().pictures.insert(frame, picture);
        }
    }
}

/// True for an output whose numbers a table has.
pub(super) fn is_number(graph: &Graph, port: Port) -> bool {
    graph.nodes[port.node].output_types.get(port.output).is_some_and(|ty| ty == Curve::NAME)
}

impl Observer for Probe<'_> {
    fn wanted(&self, graph: &Graph, plan: &Plan) {
        let mut seen = self.seen();
        if let Some(port) = self.port {
            let made = plan.frames_of(graph, port.node);
            let asked = self.at.and_then(|set| set.on(&graph.nodes[port.node].clock).ok());
            let middle = made.get(made.len().saturating_sub(1) / 2).copied();
            seen.frames =
                asked.map_or_else(|| middle.into_iter().collect(), |asked| asked.into_iter().filter(|f| made.contains(f)).collect());
        }
        for port in &self.numbers {
            seen.needed.insert(*port, plan.frames_of(graph, port.node));
        }
    }

    fn made(&self, _graph: &Graph, port: Port, frame: Option<i64>, value: &ValueRef) {
        self.take(port, frame, value);
    }

    fn ended(&self, results: &Results) {
        let (frames, needed) = {
            let seen = self.seen();
            (seen.frames.clone(), seen.needed.clone())
        };
        let pictures = self.port.map(|port| (port, frames));
        for (port, frames) in pictures.into_iter().chain(needed) {
            let is_single = results.graph.is_single(port);
            let first = results.graph.nodes[port.node].clock.first;
            let all: Vec<Option<i64>> = if is_single { vec![None] } else { frames.into_iter().take(MOST_FRAMES).map(Some).collect() };
            for frame in all {
                let has = {
                    let seen = self.seen();
                    seen.pictures.contains_key(&frame) && self.port == Some(port)
                        || seen.numbers.get(&port).is_some_and(|n| n.contains_key(&frame))
                };
                if !has && let Some(value) = results.get(port, frame.unwrap_or(first), MOST_BYTES) {
                    self.take(port, frame, &value);
                }
            }
        }
    }
}
