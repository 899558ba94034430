//! What each node's tasks cost: what earlier runs say, and what this one measures.

use std::time::Duration;

use super::NodeStats;
use crate::graph::Graph;
use crate::sync::{AtomicU64, AtomicUsize, Ordering};

/// What a task of a node costs at most, as known from an earlier run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expected {
    /// Bytes of its results.
    pub bytes: u64,
    /// Bytes that it needs besides while it runs.
    pub scratch: u64,
    /// Seconds, on the average.
    pub seconds: f64,
}

#[derive(Default)]
struct Size {
    expected: Option<Expected>,
    tasks: AtomicU64,
    nanos: AtomicU64,
    bytes: AtomicU64,
    total_bytes: AtomicU64,
    scratch: AtomicU64,
}

pub(super) struct Sizes {
    nodes: Vec<Size>,
    paths: AtomicUsize,
}

impl Sizes {
    pub(super) fn new(graph: &Graph, expected: &[Option<Expected>]) -> Self {
        let size = |node| Size { expected: expected.get(node).copied().flatten(), ..Size::default() };
        Self { nodes: (0..graph.nodes.len()).map(size).collect(), paths: AtomicUsize::new(usize::MAX) }
    }

    /// A task of `node` is done.
    pub(super) fn measured(&self, node: usize, bytes: u64, scratch: u64, time: Duration) {
        let size = &self.nodes[node];
        size.nanos.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
        size.total_bytes.fetch_add(bytes, Ordering::Relaxed);
        raise(&size.bytes, bytes);
        raise(&size.scratch, scratch);
        size.tasks.fetch_add(1, Ordering::Release);
    }

    /// The most that a task of `node` is known to cost; `None` where none has run.
    pub(super) fn known(&self, node: usize) -> Option<Expected> {
        let size = &self.nodes[node];
        let tasks = size.tasks.load(Ordering::Acquire);
        if tasks == 0 {
            return size.expected;
        }
        let before = size.expected.unwrap_or_default();
        let seconds = size.nanos.load(Ordering::Relaxed) as f64 / tasks as f64 / 1e9;
        let (bytes, scratch) = (size.bytes.load(Ordering::Relaxed), size.scratch.load(Ordering::Relaxed));
        Some(Expected { bytes: bytes.max(before.bytes), scratch: scratch.max(before.scratch), seconds })
    }

    /// Bytes that a task of `node` will need for itself.
    pub(super) fn need(&self, node: usize) -> Option<u64> {
        self.known(node).map(|e| e.bytes + e.scratch)
    }

    /// Bytes for a task of which nothing is known, until it is.
    pub(super) fn guess(&self, limit: u64) -> u64 {
        (limit / 2).min(512 << 20)
    }

    /// Targets whose paths fit into the budget together.
    pub(super) fn paths(&self) -> usize {
        self.paths.load(Ordering::Relaxed)
    }

    pub(super) fn set_paths(&self, paths: usize) {
        self.paths.store(paths, Ordering::Relaxed);
    }

    pub(super) fn stats(&self, node: usize) -> NodeStats {
        let size = &self.nodes[node];
        NodeStats {
            tasks: size.tasks.load(Ordering::Relaxed),
            time: Duration::from_nanos(size.nanos.load(Ordering::Relaxed)),
            bytes: size.total_bytes.load(Ordering::Relaxed),
            most_bytes: size.bytes.load(Ordering::Relaxed),
            scratch_bytes: size.scratch.load(Ordering::Relaxed),
            ..NodeStats::default()
        }
    }
}

fn raise(most: &AtomicU64, value: u64) {
    if value > most.load(Ordering::Relaxed) {
        most.fetch_max(value, Ordering::Relaxed);
    }
}
