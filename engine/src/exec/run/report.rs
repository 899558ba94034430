//! What came of a run, and who waits for whom where it cannot go on.

use std::collections::BTreeMap;

use super::{ADMITTED, DONE, Run};
use crate::exec::{NodeStats, Report, lock};
use crate::node::NodeError;
use crate::sync::Ordering;
use crate::value::ValueRef;

impl Run<'_> {
    /// Ends a run in which nothing can move, and says who waits for whom.
    pub(super) fn give_up(&self) {
        let mut lines = Vec::new();
        for node in 0..self.graph.nodes.len() {
            for index in (0..self.plan.nodes[node].wanted.len()).filter(|&k| self.plan.nodes[node].wanted[k]) {
                let flags = self.flags[self.layout.task(node, index)].load(Ordering::Acquire);
                if flags & (ADMITTED | DONE) == ADMITTED && lines.len() < 8 {
                    lines.push(self.waits(node, index));
                }
            }
        }
        *lock(&self.stuck) = Some(lines.join("; "));
        self.crew.stop();
    }

    fn waits(&self, node: usize, index: usize) -> String {
        let mut open = Vec::new();
        for edge in &self.plan.nodes[node].edges {
            let producer = edge.port.node;
            let base = self.layout.port(edge.port).start;
            for slot in self.layout.reads(edge, index) {
                let task = if self.graph.nodes[producer].runs_once() { 0 } else { slot - base };
                let is_open = self.plan.nodes[producer].wanted[task]
                    && self.flags[self.layout.task(producer, task)].load(Ordering::Acquire) & DONE == 0;
                if is_open && open.len() < 4 {
                    open.push(self.name(producer, task));
                }
            }
        }
        let whom = if open.is_empty() { "nothing that is open".to_owned() } else { open.join(", ") };
        format!("{} waits for {whom}", self.name(node, index))
    }

    pub(super) fn name(&self, node: usize, index: usize) -> String {
        let spec = &self.graph.nodes[node];
        if spec.runs_once() { spec.name.clone() } else { format!("{}@{}", spec.name, spec.clock.first + index as i64) }
    }

    pub(super) fn report(self) -> Report {
        let mut kept = BTreeMap::new();
        let mut lost = self.lost.load(Ordering::Relaxed);
        let failures = std::mem::take(&mut *lock(&self.failures));
        for port in self.plan.keep.iter().filter(|p| !self.plan.known.contains_key(p)) {
            let values: Vec<Option<ValueRef>> = self.layout.port(*port).map(|slot| self.memory.kept(slot)).collect();
            let is_whole = self.unreached.load(Ordering::Relaxed) == 0 && !self.options.cancel.is_cancelled();
            lost |= is_whole && values.iter().any(Option::is_none);
            kept.insert(*port, values);
        }
        let mut report = Report {
            // A node that stops when it is asked to takes what hangs on it along, and that may be all that was left.
            cancelled: self.options.cancel.is_cancelled()
                && (self.open_targets.load(Ordering::Acquire) > 0 || self.unreached.load(Ordering::Relaxed) > 0),
            unreached: self.unreached.load(Ordering::Relaxed),
            stats: (0..self.graph.nodes.len())
                .map(|node| {
                    let skipped = self.cut[node].load(Ordering::Relaxed) as u64;
                    NodeStats { skipped, peak_bytes: self.memory.meter(node).peak(), ..self.sizes.stats(node) }
                })
                .collect(),
            failures,
            kept,
            peak_bytes: self.memory.total().peak(),
            counted_bytes: self.memory.gate.peak(),
            spilled: self.memory.spilled(),
            stuck: lock(&self.stuck).take(),
            lost,
            ..Report::default()
        };
        report.failures.sort_by_key(|f| (f.node, f.frame));
        report
    }
}

/// What a panic of a node comes to.
pub(crate) fn panicked(payload: &(dyn std::any::Any + Send)) -> NodeError {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned()).or_else(|| payload.downcast_ref::<String>().cloned());
    NodeError::internal(format!("panicked: {}", text.unwrap_or_else(|| "no message".to_owned())))
        .help("this is a fault of the node's code: please report it with the graph and the inputs")
}
