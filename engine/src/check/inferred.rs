//! What checking finds out about nodes, for those who look at a graph that may be wrong: editors.

use std::sync::Arc;

use crate::clock::Clock;
use crate::diag::{FileId, Span};
use crate::graph::Port;

use super::Checker;
use super::typing::Typed;

/// What was found out about one node.
#[derive(Clone, Debug)]
pub struct Inferred {
    /// Name in the graph file; a node inside a graph node `a` is `a/name`.
    pub name: String,
    /// File in which it is written.
    pub file: FileId,
    /// Its name there.
    pub span: Span,
    /// Its outputs, in the order of the schema; empty for a node whose type is not known.
    pub outputs: Vec<InferredOutput>,
    /// The clock of its outputs.
    pub clock: Option<Arc<Clock>>,
    /// False where something that it hangs on is wrong, so that neither rate nor clock is sure.
    pub is_certain: bool,
}

/// What was found out about one output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InferredOutput {
    /// Name in graph files.
    pub name: &'static str,
    /// Value type; empty where it is not known.
    pub ty: String,
    /// One value a frame, or one for the whole graph.
    pub per_frame: bool,
}

impl Checker<'_> {
    /// What is known of each node once all are typed.
    pub(super) fn conclude(&self, typed: &[Typed]) -> Vec<Inferred> {
        self.nodes
            .iter()
            .enumerate()
            .map(|(node, source)| {
                let schema = source.ty.as_ref().map(|t| &t.schema);
                let outputs = schema.iter().flat_map(|s| s.outputs.iter().enumerate()).map(|(output, o)| InferredOutput {
                    name: o.name,
                    ty: typed[node].types.get(output).cloned().unwrap_or_else(|| o.ty.unwrap_or_default().to_owned()),
                    per_frame: !self.is_single(Port { node, output }, typed),
                });
                Inferred {
                    name: source.name.clone(),
                    file: source.at.file,
                    span: source.at.span,
                    outputs: outputs.collect(),
                    clock: typed[node].clock.clone(),
                    is_certain: !typed[node].doubtful,
                }
            })
            .collect()
    }
}
