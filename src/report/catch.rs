//! What a report shows of values: caught as they are made, as small as they are shown, so that no value is held for it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pegbar_engine::exec::{Observer, Results};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::plan::Plan;
use pegbar_engine::value::ValueRef;

use super::numbers::{is_numbers, numbers};
use super::show::{Shown, show};

/// Frames of a port whose numbers are remembered, at most.
const MOST_FRAMES: usize = 20_000;
/// Bytes of a value that is read back from the cache, at most, and of all of them.
const MOST_BYTES: u64 = 128 << 20;
const MOST_NUMBERS: usize = 1000;

/// What was seen of one output.
#[derive(Default)]
pub(super) struct Caught {
    /// What is shown of single frames; of a value that does not change over time under `None`.
    pub(super) shown: BTreeMap<Option<i64>, Shown>,
    /// The numbers of each frame.
    pub(super) numbers: BTreeMap<Option<i64>, Vec<f64>>,
}

/// What is planned of one node, before the cache is looked into.
#[derive(Clone, Default)]
pub(super) struct Wanted {
    pub(super) tasks: usize,
    /// The frames that are shown: the first, the middle one, the last.
    pub(super) frames: BTreeSet<i64>,
    /// First and last.
    pub(super) span: Option<[i64; 2]>,
}

/// Watches a run for its report.
pub(crate) struct Catcher {
    wanted: Mutex<Vec<Wanted>>,
    caught: Mutex<BTreeMap<Port, Caught>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Catcher {
    /// A catcher for a graph of so many nodes; what a job adds to it is not shown.
    pub(crate) fn new(nodes: usize) -> Self {
        Self { wanted: Mutex::new(vec![Wanted::default(); nodes]), caught: Mutex::default() }
    }

    /// What was planned, and what was seen.
    pub(super) fn end(self) -> (Vec<Wanted>, BTreeMap<Port, Caught>) {
        let wanted = self.wanted.into_inner().unwrap_or_else(PoisonError::into_inner);
        (wanted, self.caught.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// True for a value of which a picture is wanted: of a chosen frame, or the first of its port, in case that none of those is ever made.
    fn takes(&self, port: Port, frame: Option<i64>) -> bool {
        let is_chosen = lock(&self.wanted).get(port.node).is_some_and(|w| frame.is_none_or(|f| w.frames.contains(&f)));
        let mut caught = lock(&self.caught);
        let caught = caught.entry(port).or_default();
        let takes = !caught.shown.contains_key(&frame) && (is_chosen || caught.shown.is_empty());
        if takes {
            // Its place is taken, so that no other thread does the same.
            caught.shown.insert(frame, Shown::Nothing);
        }
        takes
    }

    fn take(&self, port: Port, frame: Option<i64>, value: &ValueRef) {
        if port.node >= lock(&self.wanted).len() {
            return;
        }
        if let Some(numbers) = numbers(value) {
            let mut caught = lock(&self.caught);
            let caught = &mut caught.entry(port).or_default().numbers;
            if caught.len() < MOST_FRAMES {
                caught.insert(frame, numbers);
            }
        } else if self.takes(port, frame) {
            let shown = show(value, frame.is_none());
            lock(&self.caught).entry(port).or_default().shown.insert(frame, shown);
        }
    }

    /// The values of a port that are worth reading back.
    fn missing(&self, graph: &Graph, port: Port) -> Vec<Option<i64>> {
        let node = &graph.nodes[port.node];
        let Some(wanted) = lock(&self.wanted).get(port.node).cloned() else { return Vec::new() };
        let caught = lock(&self.caught);
        let has = |frame: &Option<i64>| caught.get(&port).is_some_and(|c| c.shown.contains_key(frame) || c.numbers.contains_key(frame));
        let of_numbers = node.output_types.get(port.output).is_some_and(|ty| is_numbers(ty));
        let frames: Vec<Option<i64>> = match wanted.span {
            _ if wanted.tasks == 0 => Vec::new(),
            _ if graph.is_single(port) => vec![None],
            Some([first, last]) if of_numbers => {
                let step = (last - first + 1).unsigned_abs().div_ceil(MOST_NUMBERS as u64).max(1);
                (first..=last).step_by(step as usize).map(Some).collect()
            }
            _ => wanted.frames.iter().copied().map(Some).collect(),
        };
        frames.into_iter().filter(|frame| !has(frame)).collect()
    }
}

impl Observer for Catcher {
    fn wanted(&self, graph: &Graph, plan: &Plan) {
        let mut all = lock(&self.wanted);
        for (node, wanted) in all.iter_mut().enumerate() {
            let frames = plan.frames_of(graph, node);
            let (Some(first), Some(last)) = (frames.first(), frames.last()) else { continue };
            *wanted = Wanted {
                tasks: plan.tasks_of(node),
                frames: [*first, frames[(frames.len() - 1) / 2], *last].into(),
                span: Some([*first, *last]),
            };
        }
    }

    fn made(&self, _graph: &Graph, port: Port, frame: Option<i64>, value: &ValueRef) {
        self.take(port, frame, value);
    }

    fn ended(&self, results: &Results) {
        let nodes = lock(&self.wanted).len();
        for node in 0..nodes {
            let spec = &results.graph.nodes[node];
            for output in 0..spec.ty.schema.outputs.len() {
                let port = Port { node, output };
                for frame in self.missing(results.graph, port) {
                    if let Some(value) = results.get(port, frame.unwrap_or(spec.clock.first), MOST_BYTES) {
                        self.take(port, frame, &value);
                    }
                }
            }
        }
    }
}

/// A skeleton that was caught, for the poses of it.
pub(super) fn held(caught: &BTreeMap<Port, Caught>, port: Port) -> Option<Arc<pegbar_nodes::data::Skeleton>> {
    match caught.get(&port)?.shown.values().next()? {
        Shown::Skeleton(skeleton) => Some(skeleton.clone()),
        _ => None,
    }
}
