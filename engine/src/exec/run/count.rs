//! Counts that a run begins with.

use crate::exec::layout::Layout;
use crate::graph::{Graph, Port};
use crate::plan::{Plan, Reads};
use crate::sync::AtomicU32;

/// What each task waits for, and how often each result will be read.
pub(super) struct Counted {
    pub(super) pending: Vec<AtomicU32>,
    /// Readers, node, and how late it is read, of each slot.
    pub(super) slots: Vec<(u32, u32, u32)>,
}

/// Added to how late a value is read where a node that runs once reads it, or the caller keeps it.
const LATE: u32 = 1 << 31;

pub(super) fn count(graph: &Graph, plan: &Plan, layout: &Layout) -> Counted {
    let mut slots = Vec::with_capacity(layout.n_slots());
    for node in 0..graph.nodes.len() {
        for output in 0..layout.ports(node) {
            slots.extend(layout.port(Port { node, output }).enumerate().map(|(k, _)| (0, node as u32, k as u32)));
        }
    }
    let mut pending: Vec<u32> = vec![1; layout.n_tasks()];
    for (node, planned) in plan.nodes.iter().enumerate() {
        for edge in &planned.edges {
            let producer = &plan.nodes[edge.port.node].wanted;
            let once = graph.nodes[edge.port.node].runs_once();
            let base = layout.port(edge.port).start;
            for task in (0..planned.wanted.len()).filter(|&k| planned.wanted[k]) {
                let mut waits = 0;
                for slot in layout.reads(edge, task) {
                    slots[slot].0 += 1;
                    waits += u32::from(producer[if once { 0 } else { slot - base }]);
                    if edge.by_handle {
                        slots[slot].2 |= LATE;
                    }
                }
                // A node that runs once tells a reader of its whole sequence once.
                pending[layout.task(node, task)] += if once && matches!(edge.reads, Reads::All) { waits.min(1) } else { waits };
            }
        }
    }
    for port in plan.keep.iter().filter(|p| !plan.known.contains_key(p)) {
        for slot in layout.port(*port) {
            slots[slot].0 += 1;
            slots[slot].2 |= LATE;
        }
    }
    Counted { pending: pending.into_iter().map(AtomicU32::new).collect(), slots }
}
