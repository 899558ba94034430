//! Values that nobody should have made, at every input of every node: a value or an error, never a panic.

use std::path::Path;

use pegbar_engine::exec::{Options, execute};
use pegbar_engine::node::{Fault, InputSchema, NodeError};
use pegbar_engine::plan::Target;
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_nodes::registry;

use super::standin::{Kind, check, fields, text, type_at, write_all};
use crate::support::collect::complaints;

/// Every error that the node `x` of a graph ends in; all frames are asked for.
fn errors(folder: &Path, registry: &Registry, text: &str) -> Result<Vec<NodeError>, String> {
    let loaded = check(folder, text, registry);
    let graph = loaded.graph.as_ref().ok_or_else(|| complaints(&loaded))?;
    let node = graph.find("x").unwrap();
    match execute(graph, &[Target { node, frames: None }], &[], &Options { threads: 2, ..Options::default() }) {
        // Only the node itself may fail: a stand-in that cannot be read is a fault of this test.
        Ok(report) => match report.failures.iter().find(|f| f.node != node) {
            Some(other) => Err(format!("{}: {}", graph.nodes[other.node].name, other.error.message)),
            None => Ok(report.failures.into_iter().map(|f| f.error).collect()),
        },
        Err(error) => Ok(vec![error.error]),
    }
}

/// The inputs of a node that take values, with those that may be left out.
fn values(node: &NodeType) -> Vec<&InputSchema> {
    node.schema.inputs.iter().filter(|i| type_at(i).is_some()).collect()
}

/// The node with values of `kind` at the input called `at`, or at all of them.
pub(super) fn graph(folder: &Path, node: &NodeType, kind: Kind, at: Option<&str>, optional: bool) -> Option<String> {
    let at_input = |i: &InputSchema| if at.is_none_or(|a| a == i.name) { kind } else { Kind::Ordinary };
    let mut given = fields(&node.schema, at_input);
    let missing = values(node).into_iter().filter(|i| optional && !given.iter().any(|(n, _)| n == i.name));
    let more: Vec<_> =
        missing.filter_map(|i| Some((i.name.to_owned(), super::standin::reference(&node.schema, i, at_input(i))?))).collect();
    given.extend(more);
    // A type that does not take such values has no file of them.
    let names = given.iter().filter_map(|(_, v)| v.trim_matches('"').strip_prefix('@'));
    let is_there = names.into_iter().all(|n| folder.join(format!("{}.npz", n.replace('-', "."))).exists());
    is_there.then(|| text(node.schema.id, &given))
}

#[test]
fn ordinary_values_are_taken_by_every_node() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    write_all(folder.path(), &registry, Kind::Ordinary);
    super::keys::pictures(folder.path());
    let mut wrong = Vec::new();
    for node in registry.nodes().filter(|n| !values(n).is_empty()) {
        for optional in [false, true] {
            let graph = graph(folder.path(), node, Kind::Ordinary, None, optional).expect("stand-ins for every type");
            match errors(folder.path(), &registry, &graph) {
                Ok(errors) => {
                    wrong.extend(errors.into_iter().filter(|e| e.fault == Fault::Internal).map(|e| format!("{}: {e}", node.schema.id)))
                }
                Err(why) => wrong.push(format!("{}: {why}", node.schema.id)),
            }
        }
    }
    super::none(&wrong);
}

#[test]
fn rough_values_are_errors_and_not_panics() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    write_all(folder.path(), &registry, Kind::Ordinary);
    super::keys::pictures(folder.path());
    Kind::WRONG.iter().for_each(|kind| write_all(folder.path(), &registry, *kind));
    let mut wrong = Vec::new();
    let mut tried = 0;
    for node in registry.nodes() {
        let inputs = values(node);
        let each = inputs.iter().map(|i| Some(i.name)).chain((!inputs.is_empty()).then_some(None));
        for (kind, at) in each.flat_map(|at| Kind::WRONG.map(|kind| (kind, at))) {
            let Some(graph) = graph(folder.path(), node, kind, at, true) else { continue };
            tried += 1;
            let at = format!("{} with {kind:?} at {}", node.schema.id, at.unwrap_or("every input"));
            match errors(folder.path(), &registry, &graph) {
                // A fault of Pegbar's own is one whatever came in; panics are told as such.
                Ok(errors) => {
                    let ours = errors.into_iter().find(|e| e.fault == Fault::Internal || e.message.contains("panicked"));
                    wrong.extend(ours.map(|e| format!("{at}: {e}")));
                }
                Err(why) => wrong.push(format!("{at}: {why}")),
            }
        }
    }
    assert!(tried > 200, "{tried} graphs");
    super::none(&wrong);
}
