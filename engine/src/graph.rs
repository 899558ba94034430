//! A checked graph: nodes with their types, settings and wires, ready to be planned.

use std::sync::Arc;

use crate::clock::Clock;
use crate::diag::{FileId, Span};
use crate::node::{Kind, Literal};
use crate::registry::{NodeType, Types};
use crate::setting::{FileUse, OutputPath};

/// A graph in which every reference is resolved and every literal read.
#[derive(Clone, Default)]
pub struct Graph {
    /// Clocks; the first is the default.
    pub clocks: Vec<Arc<Clock>>,
    /// Nodes, in the order in which they are written.
    pub nodes: Vec<GraphNode>,
    /// What the graph declares as its outputs.
    pub outputs: Vec<(String, Port)>,
    /// Value types, so that what went to disk can come back.
    pub types: Types,
}

/// An output of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Port {
    /// Index of the node.
    pub node: usize,
    /// Index of its output.
    pub output: usize,
}

/// One node of a [`Graph`].
#[derive(Clone)]
pub struct GraphNode {
    /// Name in the graph file; a node inside a graph node `a` is `a/name`.
    pub name: String,
    /// Its type.
    pub ty: NodeType,
    /// What stands at each input, in the order of the schema.
    pub inputs: Vec<Binding>,
    /// One value a frame, or one for the whole graph.
    pub per_frame: bool,
    /// The clock of its outputs.
    pub clock: Arc<Clock>,
    /// The clock of each input that is wired to a stream.
    pub input_clocks: Vec<(&'static str, Arc<Clock>)>,
    /// Value type of each output.
    pub output_types: Vec<String>,
    /// File in which it is written.
    pub file: FileId,
    /// Its name there.
    pub span: Span,
    /// Where each input is written, in the order of the schema; the node's name for a default. Empty for a node that no file holds.
    pub places: Vec<(FileId, Span)>,
}

/// What stands at an input.
#[derive(Clone)]
pub enum Binding {
    /// Nothing.
    None,
    /// A literal: read, and as text in canonical form for keys.
    Literal {
        /// The value.
        value: Literal,
        /// Its text.
        text: String,
    },
    /// A reference.
    Wire(Port),
    /// References.
    List(Vec<Port>),
}

impl GraphNode {
    /// The paths that its settings say it writes.
    pub fn written_paths(&self) -> impl Iterator<Item = OutputPath> + '_ {
        let written = self.inputs.iter().zip(&self.ty.schema.inputs).filter(|(_, s)| s.files == FileUse::Write);
        let path = |value: &Literal| {
            value.downcast_ref::<OutputPath>().cloned().or_else(|| value.downcast_ref::<Option<OutputPath>>().cloned().flatten())
        };
        written.filter_map(move |(binding, _)| if let Binding::Literal { value, .. } = binding { path(value) } else { None })
    }

    /// True for a node that runs once: over whole sequences, or for a value that does not change.
    pub fn runs_once(&self) -> bool {
        self.ty.schema.kind == Kind::Whole || !self.per_frame
    }

    /// True where output `idx` has one value for the whole graph.
    pub fn is_single(&self, idx: usize) -> bool {
        match self.ty.schema.kind {
            Kind::Whole => !self.ty.schema.outputs.get(idx).is_some_and(|o| o.stream),
            _ => !self.per_frame,
        }
    }
}

impl Graph {
    /// The node called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|n| n.name == name)
    }

    /// True where `port` has one value for the whole graph.
    pub fn is_single(&self, port: Port) -> bool {
        self.nodes[port.node].is_single(port.output)
    }

    /// `node.output`, as a graph file says it.
    pub fn port_name(&self, port: Port) -> String {
        let node = &self.nodes[port.node];
        match node.ty.schema.outputs.get(port.output) {
            Some(output) => format!("{}.{}", node.name, output.name),
            None => node.name.clone(),
        }
    }
}
