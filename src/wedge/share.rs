//! What the variants of a wedge have in common: such nodes' results are kept for the others, so that they are made once.

use std::collections::BTreeMap;

use pegbar_engine::exec::Policy;
use pegbar_engine::graph::{Binding, Graph, Port};
use pegbar_engine::node::Kind;

use crate::report::is_numbers;

/// What each node of several graphs is made from, as a number: the same for nodes that do the same on the same.
#[derive(Default)]
pub(super) struct Kinships {
    numbers: BTreeMap<String, usize>,
    /// In how many graphs each is met.
    met: Vec<usize>,
    /// For each graph, the number of each node.
    graphs: Vec<Vec<usize>>,
}

impl Kinships {
    /// Adds a graph.
    pub(super) fn add(&mut self, graph: &Graph) {
        let mut known: Vec<Option<usize>> = vec![None; graph.nodes.len()];
        // A graph that passed its checks has no ring, so that each node finds what it reads before it is looked at again.
        let mut open: Vec<usize> = (0..graph.nodes.len()).collect();
        while let Some(&node) = open.last() {
            let unknown = ports(&graph.nodes[node].inputs).find(|port| known[port.node].is_none());
            match (known[node], unknown) {
                (None, Some(port)) => open.push(port.node),
                (None, None) => known[node] = Some(self.number(graph, node, &known)),
                _ => drop(open.pop()),
            }
        }
        let own: Vec<usize> = known.into_iter().flatten().collect();
        let mut once = own.clone();
        once.sort_unstable();
        once.dedup();
        once.into_iter().for_each(|number| self.met[number] += 1);
        self.graphs.push(own);
    }

    fn number(&mut self, graph: &Graph, node: usize, known: &[Option<usize>]) -> usize {
        let spec = &graph.nodes[node];
        let schema = &spec.ty.schema;
        let port = |p: &Port| format!("@{:?}.{}", known[p.node], p.output);
        let bound = |binding: &Binding| match binding {
            Binding::None => String::new(),
            Binding::Literal { text, .. } => text.clone(),
            Binding::Wire(p) => port(p),
            Binding::List(ports) => ports.iter().map(port).collect(),
        };
        let bindings: Vec<String> = spec.inputs.iter().map(bound).collect();
        // What writes does so into the folder of its variant, whatever its settings.
        let own = if is_sink(graph, node) { self.graphs.len() + 1 } else { 0 };
        let all = format!("{own} {} {} {:?} {} {bindings:?}", schema.id, schema.version, spec.clock, spec.per_frame);
        let next = self.numbers.len();
        let number = *self.numbers.entry(all).or_insert(next);
        self.met.resize(self.numbers.len(), 0);
        number
    }

    /// How many of the graphs have the node of this one.
    pub(super) fn shared_by(&self, graph: usize, node: usize) -> usize {
        self.graphs[graph].get(node).map_or(0, |number| self.met[*number])
    }

    /// What of a graph is to be kept for the others, and what for the table: nodes that more graphs have than have who reads them; and what is
    /// numbers alone. What is read from files is cheaper to be read again.
    pub(super) fn policies(&self, index: usize, graph: &Graph, target: Option<&str>) -> Vec<(String, Policy)> {
        let mut readers = vec![usize::MAX; graph.nodes.len()];
        for (node, spec) in graph.nodes.iter().enumerate() {
            for port in ports(&spec.inputs) {
                readers[port.node] = readers[port.node].min(self.shared_by(index, node));
            }
        }
        let kept = graph.nodes.iter().enumerate().filter(|&(node, spec)| {
            let met = self.shared_by(index, node);
            let is_border = met > 1 && (readers[node] < met || target == Some(&spec.name)) && spec.ty.schema.kind != Kind::Source;
            let of_numbers = !spec.output_types.is_empty() && spec.output_types.iter().all(|ty| is_numbers(ty));
            !is_sink(graph, node) && (is_border || of_numbers)
        });
        kept.map(|(_, spec)| (spec.name.clone(), Policy::Always)).collect()
    }
}

fn is_sink(graph: &Graph, node: usize) -> bool {
    let schema = &graph.nodes[node].ty.schema;
    schema.kind == Kind::Sink || schema.outputs.is_empty()
}

fn ports(inputs: &[Binding]) -> impl Iterator<Item = Port> + '_ {
    let of = |binding: &Binding| match binding {
        Binding::Wire(port) => vec![*port],
        Binding::List(ports) => ports.clone(),
        _ => Vec::new(),
    };
    inputs.iter().flat_map(of)
}
