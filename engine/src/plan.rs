//! Planning: which frames of which nodes are needed for what is asked, and how often each result will be read.
//!
//! A plan is static: every demand is known before the first task starts. Where a node's demand depends on a value that a node computes (a retime
//! by a computed map), planning stops at [`Planned::First`] and goes on when that value is known.

use std::collections::{BTreeMap, VecDeque};

use petgraph::Direction;
use petgraph::graph::{DiGraph, NodeIndex};

use crate::graph::{Binding, Graph, Port};
use crate::node::{Access, Arg, Cancel, Context, Kind, NodeError};
use crate::value::ValueRef;

/// What is to be made.
#[derive(Clone, Debug)]
pub struct Target {
    /// Index of the node.
    pub node: usize,
    /// Frames, for a node that has one value a frame; all of its clock where `None`.
    pub frames: Option<Vec<i64>>,
}

/// Values that are known already, by port: those of an earlier stage.
pub type Known = BTreeMap<Port, ValueRef>;

/// A plan, or what has to be known before there can be one.
pub enum Planned {
    /// Ready to be executed.
    Ready(Plan),
    /// These single values decide which frames are needed.
    First(Vec<Port>),
}

/// A node whose demand could not be found.
#[derive(Clone, Debug)]
pub struct PlanError {
    /// Index of the node.
    pub node: usize,
    /// Frame, where there is one.
    pub frame: Option<i64>,
    /// Why.
    pub error: NodeError,
}

/// Every task that is needed, and every read between them.
#[derive(Clone, Debug)]
pub struct Plan {
    /// One for each node of the graph.
    pub(crate) nodes: Vec<PlanNode>,
    /// What is to be made: node and task, in the order of frames.
    pub(crate) targets: VecDeque<(u32, u32)>,
    /// Ports whose values are handed to the caller.
    pub(crate) keep: Vec<Port>,
    pub(crate) known: Known,
}

#[derive(Clone, Debug)]
pub(crate) struct PlanNode {
    /// Which of its tasks are needed; one task for a node that runs once.
    pub(crate) wanted: Vec<bool>,
    /// Reads, in the order of the inputs; the read of its own state last.
    pub(crate) edges: Vec<Edge>,
    /// Edges of other nodes that read this one: node, edge.
    pub(crate) consumers: Vec<(u32, u32)>,
}

#[derive(Clone, Debug)]
pub(crate) struct Edge {
    pub(crate) port: Port,
    pub(crate) reads: Reads,
    /// True where the values are fetched one by one while the task runs.
    pub(crate) by_handle: bool,
}

/// Which of the producer's values each task of the consumer reads.
#[derive(Clone, Debug)]
pub(crate) enum Reads {
    /// The same frame.
    Same,
    /// The one value.
    Held,
    /// All of them.
    All,
    /// These, for each task; and the way back.
    Lists(Lists),
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Lists {
    pub(crate) forward: Vec<Vec<u32>>,
    pub(crate) backward: Vec<Vec<u32>>,
}

impl Lists {
    fn new(forward: Vec<Vec<u32>>, producer_tasks: usize) -> Self {
        let mut backward = vec![Vec::new(); producer_tasks];
        for (task, reads) in forward.iter().enumerate() {
            for &read in reads {
                backward[read as usize].push(task as u32);
            }
        }
        Self { forward, backward }
    }
}

impl Plan {
    /// Number of tasks.
    pub fn tasks(&self) -> usize {
        self.nodes.iter().map(|n| n.wanted.iter().filter(|w| **w).count()).sum()
    }

    /// Frames of one node that are needed; of a node that runs once all of its clock, if it is needed at all.
    pub fn frames_of(&self, graph: &Graph, node: usize) -> Vec<i64> {
        let (spec, wanted) = (&graph.nodes[node], &self.nodes[node].wanted);
        if spec.runs_once() {
            return if wanted.contains(&true) { spec.clock.frames().collect() } else { Vec::new() };
        }
        spec.clock.frames().zip(wanted).filter(|(_, wanted)| **wanted).map(|(frame, _)| frame).collect()
    }

    /// Number of tasks of one node.
    pub fn tasks_of(&self, node: usize) -> usize {
        self.nodes[node].wanted.iter().filter(|w| **w).count()
    }
}

/// Finds everything that `targets` and `keep` need.
///
/// Cost: O(reads), and one call of each windowed or recurrent node's first step a frame.
///
/// # Errors
/// Where a node asks for a frame that its input does not have.
pub fn plan(graph: &Graph, targets: &[Target], keep: &[Port], known: Known) -> Result<Planned, PlanError> {
    let order = consumers_first(graph);
    let mut planner = Planner { graph, known: &known, nodes: empty(graph), first: Vec::new() };
    let mut wanted_targets = Vec::new();
    for target in targets {
        for task in planner.want_target(target)? {
            wanted_targets.push((task, target.node as u32));
        }
    }
    for port in keep.iter().filter(|p| !known.contains_key(p)) {
        planner.nodes[port.node].wanted.fill(true);
        wanted_targets.extend((0..planner.nodes[port.node].wanted.len()).map(|k| (k as u32, port.node as u32)));
    }
    for node in order {
        planner.visit(node)?;
    }
    if !planner.first.is_empty() {
        let mut first = planner.first;
        first.sort_unstable();
        first.dedup();
        return Ok(Planned::First(first));
    }
    let mut nodes = planner.nodes;
    link(&mut nodes);
    wanted_targets.sort_unstable();
    wanted_targets.dedup();
    let targets = wanted_targets.into_iter().map(|(task, node)| (node, task)).collect();
    Ok(Planned::Ready(Plan { nodes, targets, keep: keep.to_vec(), known }))
}

/// Nodes such that whoever reads comes before what it reads.
pub(crate) fn consumers_first(graph: &Graph) -> Vec<usize> {
    let mut net = DiGraph::<(), ()>::with_capacity(graph.nodes.len(), graph.nodes.len() * 2);
    let indices: Vec<NodeIndex> = graph.nodes.iter().map(|_| net.add_node(())).collect();
    for (i, node) in graph.nodes.iter().enumerate() {
        for port in wires(&node.inputs) {
            net.add_edge(indices[port.node], indices[i], ());
        }
    }
    // A graph that passed its checks has no cycle; one that has plans nothing beyond it.
    let order = petgraph::algo::toposort(&net, None).unwrap_or_default();
    debug_assert!(order.is_empty() || net.externals(Direction::Incoming).next().is_some());
    order.into_iter().rev().map(NodeIndex::index).collect()
}

/// Every port that the bindings refer to.
pub(crate) fn wires(inputs: &[Binding]) -> impl Iterator<Item = Port> + '_ {
    inputs.iter().flat_map(|b| {
        match b {
            Binding::Wire(p) => std::slice::from_ref(p),
            Binding::List(l) => l.as_slice(),
            _ => &[],
        }
        .iter()
        .copied()
    })
}

fn empty(graph: &Graph) -> Vec<PlanNode> {
    let tasks = |n: &crate::graph::GraphNode| if n.runs_once() { 1 } else { n.clock.len() };
    graph.nodes.iter().map(|n| PlanNode { wanted: vec![false; tasks(n)], edges: Vec::new(), consumers: Vec::new() }).collect()
}

fn link(nodes: &mut [PlanNode]) {
    for consumer in 0..nodes.len() {
        for edge in 0..nodes[consumer].edges.len() {
            let producer = nodes[consumer].edges[edge].port.node;
            nodes[producer].consumers.push((consumer as u32, edge as u32));
        }
    }
}

struct Planner<'a> {
    graph: &'a Graph,
    known: &'a Known,
    nodes: Vec<PlanNode>,
    first: Vec<Port>,
}

impl Planner<'_> {
    fn want_target(&mut self, target: &Target) -> Result<Vec<u32>, PlanError> {
        let node = &self.graph.nodes[target.node];
        let wanted = &mut self.nodes[target.node].wanted;
        let tasks: Vec<u32> = match &target.frames {
            Some(frames) if !node.runs_once() => {
                let index = |&f: &i64| node.clock.index(f).map(|i| i as u32);
                frames
                    .iter()
                    .map(|f| index(f).ok_or_else(|| outside(target.node, *f, "asked for", &node.clock)))
                    .collect::<Result<_, _>>()?
            }
            _ => (0..wanted.len() as u32).collect(),
        };
        for &task in &tasks {
            wanted[task as usize] = true;
        }
        Ok(tasks)
    }

    /// Finds what the wanted tasks of `node` read, and wants that.
    fn visit(&mut self, node: usize) -> Result<(), PlanError> {
        if !self.nodes[node].wanted.contains(&true) {
            return Ok(());
        }
        let spec = &self.graph.nodes[node];
        let unknown: Vec<Port> = self.unknown_constants(node);
        let asks = spec.ty.schema.kind == Kind::Recurrent || spec.ty.schema.inputs.iter().any(|i| i.access.asks());
        if asks && !unknown.is_empty() {
            self.first.extend(unknown);
            return Ok(());
        }
        let lists = if asks { self.ask(node)? } else { Asked::default() };
        let mut edges = Vec::new();
        for (i, binding) in spec.inputs.iter().enumerate() {
            for port in wires(std::slice::from_ref(binding)) {
                if self.known.contains_key(&port) {
                    continue;
                }
                let reads = self.reads(node, i, port, &lists)?;
                self.want(node, port, &reads);
                edges.push(Edge { port, reads, by_handle: spec.ty.schema.inputs[i].access.by_handle() });
            }
        }
        if spec.ty.schema.kind == Kind::Recurrent && !spec.runs_once() {
            let tasks = self.nodes[node].wanted.len();
            let forward = lists.previous.into_iter().map(|p| p.into_iter().collect()).collect();
            let port = Port { node, output: spec.ty.schema.outputs.len() };
            edges.push(Edge { port, reads: Reads::Lists(Lists::new(forward, tasks)), by_handle: false });
        }
        self.nodes[node].edges = edges;
        Ok(())
    }

    /// Wired constants of `node` whose values are not known yet.
    fn unknown_constants(&self, node: usize) -> Vec<Port> {
        let spec = &self.graph.nodes[node];
        let constants = spec.inputs.iter().zip(&spec.ty.schema.inputs).filter(|(_, s)| s.access == Access::Constant);
        constants.flat_map(|(b, _)| wires(std::slice::from_ref(b))).filter(|p| !self.known.contains_key(p)).collect()
    }

    /// Calls the node's first step for every wanted frame; for a recurrent node, wants the frames whose state is needed.
    fn ask(&mut self, node: usize) -> Result<Asked, PlanError> {
        let spec = &self.graph.nodes[node];
        let tasks = self.nodes[node].wanted.len();
        let inputs: Vec<&'static str> = spec.ty.schema.inputs.iter().filter(|i| i.access.asks()).map(|i| i.name).collect();
        let args = self.settings(node);
        let mut asked = Asked { frames: vec![vec![Vec::new(); tasks]; inputs.len()], previous: vec![None; tasks] };
        let mut queue: Vec<usize> = (0..tasks).filter(|&k| self.nodes[node].wanted[k]).collect();
        let cancel = Cancel::default();
        while let Some(task) = queue.pop() {
            let frame = spec.clock.first + task as i64;
            let cx = Context { frame, clock: &spec.clock, input_clocks: &spec.input_clocks, cancel: &cancel };
            let needs =
                spec.ty.operator.needs(args.clone(), &inputs, &cx).map_err(|error| PlanError { node, frame: Some(frame), error })?;
            for (slot, frames) in asked.frames.iter_mut().zip(needs.frames) {
                slot[task] = frames;
            }
            // Over a value that does not change it runs once, and so has no frame before.
            if let Some(previous) = needs.previous.filter(|_| !spec.runs_once()) {
                let k = spec.clock.index(previous).ok_or_else(|| outside(node, previous, "asked for the state of", &spec.clock))?;
                asked.previous[task] = Some(k as u32);
                if !self.nodes[node].wanted[k] {
                    self.nodes[node].wanted[k] = true;
                    queue.push(k);
                }
            }
        }
        acyclic(&asked.previous).map_err(|k| PlanError {
            node,
            frame: Some(spec.clock.first + k as i64),
            error: NodeError::internal("expected a chain of states with a start, found a ring"),
        })?;
        Ok(asked)
    }

    /// Literals and known values, for the first step; inputs that change over time are not there yet.
    fn settings(&self, node: usize) -> Vec<Arg> {
        let spec = &self.graph.nodes[node];
        spec.inputs
            .iter()
            .zip(&spec.ty.schema.inputs)
            .map(|(binding, schema)| match binding {
                Binding::Literal { value, .. } => Arg::Literal(value.clone()),
                Binding::Wire(port) => match (self.known.get(port), &schema.ty) {
                    (Some(value), _) if !schema.access.asks() => Arg::Value(value.clone()),
                    (_, crate::node::InputType::Setting { .. }) => placeholder(schema),
                    _ => Arg::None,
                },
                _ => Arg::None,
            })
            .collect()
    }

    fn reads(&self, node: usize, input: usize, port: Port, asked: &Asked) -> Result<Reads, PlanError> {
        let spec = &self.graph.nodes[node];
        let schema = &spec.ty.schema.inputs[input];
        let single = self.graph.is_single(port);
        Ok(match schema.access {
            Access::Sequence => Reads::All,
            Access::Picked if single => Reads::All,
            Access::Frames if single => Reads::Held,
            Access::Frames | Access::Picked => {
                let slot = spec.ty.schema.inputs[..input].iter().filter(|i| i.access.asks()).count();
                self.lists(node, port, &asked.frames[slot])?
            }
            _ if single || spec.runs_once() => Reads::Held,
            _ => Reads::Same,
        })
    }

    fn lists(&self, node: usize, port: Port, frames: &[Vec<i64>]) -> Result<Reads, PlanError> {
        let clock = &self.graph.nodes[port.node].clock;
        let at = |f: &i64| clock.index(*f).map(|i| i as u32).ok_or_else(|| outside(node, *f, "asked for", clock));
        let forward = frames.iter().map(|list| list.iter().map(at).collect()).collect::<Result<Vec<Vec<u32>>, _>>()?;
        // The way back is by values of the producer, of which a node that runs once makes many with its one task.
        Ok(Reads::Lists(Lists::new(forward, clock.len())))
    }

    fn want(&mut self, node: usize, port: Port, reads: &Reads) {
        if node == port.node {
            return;
        }
        let once = self.graph.nodes[port.node].runs_once();
        let (consumer, producer) = if node < port.node {
            let (a, b) = self.nodes.split_at_mut(port.node);
            (&a[node], &mut b[0])
        } else {
            let (a, b) = self.nodes.split_at_mut(node);
            (&b[0], &mut a[port.node])
        };
        match reads {
            _ if once => producer.wanted.fill(true),
            Reads::All | Reads::Held => producer.wanted.fill(true),
            Reads::Same => producer.wanted.iter_mut().zip(&consumer.wanted).for_each(|(p, c)| *p |= *c),
            Reads::Lists(lists) => lists.forward.iter().flatten().for_each(|&k| producer.wanted[k as usize] = true),
        }
    }
}

#[derive(Default)]
struct Asked {
    /// For each input that asks, for each task, frames.
    frames: Vec<Vec<Vec<i64>>>,
    previous: Vec<Option<u32>>,
}

/// What stands in for a wired setting while frames are asked for: its default, or nought.
pub(crate) fn placeholder(schema: &crate::node::InputSchema) -> Arg {
    let text = schema.default.unwrap_or("0.0");
    (schema.parse)(text, &crate::setting::Place::default()).map_or(Arg::None, |(literal, _)| Arg::Literal(literal))
}

/// `Err(task)` where following `previous` from `task` never ends.
fn acyclic(previous: &[Option<u32>]) -> Result<(), usize> {
    // 0: not seen, 1: on the path that is being followed, 2: leads to a start.
    let mut state = vec![0u8; previous.len()];
    for start in 0..previous.len() {
        let mut path = Vec::new();
        let mut at = Some(start);
        while let Some(k) = at {
            match state[k] {
                0 => {
                    state[k] = 1;
                    path.push(k);
                    at = previous[k].map(|p| p as usize);
                }
                1 => return Err(k),
                _ => break,
            }
        }
        path.into_iter().for_each(|k| state[k] = 2);
    }
    Ok(())
}

fn outside(node: usize, frame: i64, verb: &str, clock: &crate::clock::Clock) -> PlanError {
    let message = format!("expected frames {} to {} of the clock `{}`, {verb} frame {frame}", clock.first, clock.last, clock.name);
    PlanError { node, frame: Some(frame), error: NodeError::input(message) }
}
