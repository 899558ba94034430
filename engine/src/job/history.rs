//! What runs leave behind for the next: results in the cache, and a record of what they were made from and what they cost.

use std::path::Path;
use std::sync::Arc;

use crate::cache::Cache;
use crate::diag::SourceMap;
use crate::exec::{Expected, Policy, Report};
use crate::graph::{Binding, Graph};
use crate::key::files_of;
use crate::plan::{consumers_first, wires};
use crate::record::{Bytes, NodeCost, Record, Records};
use crate::stamp::Files;

/// What is kept from run to run, and where.
pub struct Keep<'a> {
    /// The cache.
    pub cache: Arc<Cache>,
    /// Its folder.
    pub folder: &'a Path,
    /// The graph file, by which its records are found.
    pub graph_file: &'a Path,
    /// The texts that the graph was read from.
    pub sources: &'a SourceMap,
    /// Which results are kept.
    pub policy: Policy,
    /// Nodes, by name, for which that is another.
    pub policies: &'a [(String, Policy)],
}

impl Keep<'_> {
    /// The policy for each node of a graph.
    pub(super) fn policies(&self, graph: &Graph) -> Vec<Policy> {
        let named = |name: &str| self.policies.iter().rev().find(|(n, _)| n == name).map(|(_, policy)| *policy);
        graph.nodes.iter().map(|node| named(&node.name).unwrap_or(self.policy)).collect()
    }
}

/// The records of one graph, and the files of this run.
pub(super) struct History<'a> {
    records: Records,
    keep: &'a Keep<'a>,
    files: &'a Files<'a>,
}

impl<'a> History<'a> {
    pub(super) fn new(keep: &'a Keep<'a>, files: &'a Files<'a>) -> Self {
        Self { records: Records::of(keep.folder, keep.graph_file), keep, files }
    }

    /// What earlier runs say of each node's tasks.
    pub(super) fn expected(&self, graph: &Graph) -> Vec<Option<Expected>> {
        let costs = self.records.costs();
        let kinds = kinds(graph);
        let known = |cost: &NodeCost| {
            Some(Expected { bytes: cost.results.values().map(|b| b.max).sum(), scratch: cost.scratch, seconds: cost.seconds_a_task()? })
        };
        graph.nodes.iter().zip(&kinds).map(|(node, kind)| costs.get(&node.name).filter(|c| c.of == *kind).and_then(known)).collect()
    }

    /// Keeps the record of a run. One that cannot be kept is missed by `pegbar why` alone, so that it is no error of the run.
    pub(super) fn save(&self, graph: &Graph, report: &Report) {
        let Ok(mut record) = Record::of(graph, self.keep.sources, report.plan.as_ref(), self.files) else { return };
        for ((node, stats), of) in graph.nodes.iter().zip(&report.stats).zip(kinds(graph)) {
            let (computed, cached, seconds) = (stats.tasks, stats.skipped, stats.time.as_secs_f64());
            let mut cost = NodeCost { of, computed, cached, seconds, scratch: stats.scratch_bytes, ..NodeCost::default() };
            if stats.tasks > 0 {
                cost.results.insert("all".to_owned(), Bytes { count: stats.tasks, total: stats.bytes, max: stats.most_bytes });
            }
            record.costs.insert(node.name.clone(), cost);
        }
        let _ = self.records.save(&record);
    }
}

/// What the cost of each node hangs on, near enough: its type, its settings, the length of the first file that it reads, and the same of all that it
/// reads. Costs of another kind say nothing.
fn kinds(graph: &Graph) -> Vec<String> {
    let mut kinds = vec![String::new(); graph.nodes.len()];
    for node in consumers_first(graph).into_iter().rev() {
        let spec = &graph.nodes[node];
        let mut hasher = blake3::Hasher::new();
        for (binding, input) in spec.inputs.iter().zip(&spec.ty.schema.inputs) {
            if let Binding::Literal { text, .. } = binding {
                hasher.update(format!("{}: {text}\n", input.name).as_bytes());
            }
        }
        for port in wires(&spec.inputs) {
            hasher.update(kinds[port.node].as_bytes());
        }
        let length = files_of(graph, node, 0).first().and_then(|file| std::fs::metadata(file).ok()).map_or(0, |m| m.len());
        hasher.update(&length.to_le_bytes());
        kinds[node] = format!("{} {}", NodeCost::new(spec).of, &hasher.finalize().to_hex()[..16]);
    }
    kinds
}
