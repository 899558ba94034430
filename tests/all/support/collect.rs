//! The values of a graph's outputs at some frames: a sink of the tests' own behind each output.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use pegbar_engine::check::{LoadOptions, Loaded, load, load_text};
use pegbar_engine::exec::{Options, Report, execute};
use pegbar_engine::graph::{Binding, Graph, GraphNode, Port};
use pegbar_engine::node::{Access, Arg, Computed, Context, InputSchema, InputType, Kind, Needs, NodeError, NodeSchema, Operator, Problem};
use pegbar_engine::plan::Target;
use pegbar_engine::registry::NodeType;
use pegbar_engine::setting::{FileUse, SettingError};
use pegbar_engine::value::{Value, ValueRef, downcast};

/// Values by frame; one at the clock's first frame for an output that does not change over time.
pub(crate) type Values = BTreeMap<i64, ValueRef>;

#[derive(Default)]
struct Collector(Mutex<Values>);

impl Operator for Collector {
    fn needs(&self, _args: Vec<Arg>, _inputs: &[&'static str], _cx: &Context) -> Result<Needs, NodeError> {
        Ok(Needs::default())
    }

    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        match args.into_iter().next() {
            Some(Arg::Value(value)) => {
                self.0.lock().unwrap().insert(cx.frame, value);
                Ok(Computed { outputs: Vec::new(), state: None })
            }
            _ => Err(NodeError::internal("expected a value, found none")),
        }
    }

    fn check(&self, _args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(Vec::new())
    }
}

fn schema() -> NodeSchema {
    let input = InputSchema {
        name: "value",
        doc: "What is kept.",
        ty: InputType::Any,
        access: Access::Frame,
        window: None,
        list: false,
        optional: false,
        default: None,
        unit: None,
        range: None,
        choices: Vec::new(),
        literal: None,
        files: FileUse::None,
        any_clock: false,
        parse: Arc::new(|text, _| Err(SettingError::whole(text, "expected a reference, found a literal"))),
    };
    NodeSchema {
        id: "test.collect",
        version: 1,
        kind: Kind::Sink,
        doc: "Keeps what comes out of a port.",
        source: None,
        example: None,
        uses_frame: false,
        beside: None,
        type_from: None,
        inputs: vec![input],
        outputs: Vec::new(),
    }
}

fn collector(graph: &Graph, port: Port, into: &Arc<Collector>) -> GraphNode {
    let made_by = &graph.nodes[port.node];
    let per_frame = !graph.is_single(port);
    GraphNode {
        name: format!("{} kept", graph.port_name(port)),
        ty: NodeType { schema: Arc::new(schema()), operator: into.clone() },
        inputs: vec![Binding::Wire(port)],
        per_frame,
        clock: made_by.clock.clone(),
        input_clocks: if per_frame { vec![("value", made_by.clock.clone())] } else { Vec::new() },
        output_types: Vec::new(),
        file: made_by.file,
        span: made_by.span,
        places: Vec::new(),
    }
}

/// A port whose values are wanted, and the frames; all of them where `None`.
pub(crate) struct Wanted {
    pub(crate) port: Port,
    pub(crate) frames: Option<Vec<i64>>,
}

/// Runs what `wanted` needs, and no more.
pub(crate) fn collect(graph: &Graph, wanted: &[Wanted], threads: usize) -> (Report, Vec<Values>) {
    let mut graph = graph.clone();
    let mut kept = Vec::new();
    let mut targets = Vec::new();
    for wanted in wanted {
        let into = Arc::new(Collector::default());
        let node = collector(&graph, wanted.port, &into);
        let frames = if node.per_frame { wanted.frames.clone() } else { None };
        graph.nodes.push(node);
        targets.push(Target { node: graph.nodes.len() - 1, frames });
        kept.push(into);
    }
    let report = match execute(&graph, &targets, &[], &Options { threads, ..Options::default() }) {
        Ok(report) => report,
        Err(error) => panic!("node `{}` at frame {:?}: {}", graph.nodes[error.node].name, error.frame, error.error.message),
    };
    let values = kept.iter().map(|k| std::mem::take(&mut *k.0.lock().unwrap())).collect();
    (report, values)
}

/// Every failure of a run with the name of its node, a line each.
pub(crate) fn failures(graph: &Graph, report: &Report) -> String {
    let name = |node: usize| graph.nodes.get(node).map_or("?", |n| n.name.as_str());
    report.failures.iter().map(|f| format!("node `{}` at frame {:?}: {}\n", name(f.node), f.frame, f.error.message)).collect()
}

/// What was found wrong with a graph file, as the command line shows it.
pub(crate) fn complaints(loaded: &Loaded) -> String {
    loaded.sources.render_all(&loaded.diagnostics, false)
}

/// The graph in a file, with everything that is wrong with it.
pub(crate) fn read(path: &Path, options: &LoadOptions) -> Loaded {
    load(path, &super::plugins::registry(), options)
}

/// A graph of `frames` frames from its nodes, as they stand in a file in `folder`.
pub(crate) fn graph_in(folder: &Path, frames: i64, nodes: &str) -> Graph {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 24), nodes: {{ {nodes} }})");
    let options = LoadOptions { out: folder.join("out"), ..LoadOptions::default() };
    let loaded = load_text(&folder.join("test.ron"), &text, &pegbar_nodes::registry(), &options);
    assert!(loaded.errors() == 0, "{}", complaints(&loaded));
    loaded.graph.unwrap()
}

/// The port `node` or `node.output`.
pub(crate) fn port(graph: &Graph, name: &str) -> Port {
    let (node, output) = name.split_once('.').unwrap_or((name, ""));
    let node = graph.find(node).unwrap();
    let output = graph.nodes[node].ty.schema.output(output).map_or(0, |(i, _)| i);
    Port { node, output }
}

/// The values of each named port at all its frames, in one run on two threads.
pub(crate) fn values(graph: &Graph, ports: &[&str]) -> Vec<Values> {
    let wanted: Vec<Wanted> = ports.iter().map(|name| Wanted { port: port(graph, name), frames: None }).collect();
    let (report, values) = collect(graph, &wanted, 2);
    assert!(report.is_complete(), "{}", failures(graph, &report));
    values
}

/// Values as the type that they have.
pub(crate) fn typed<T: Value>(values: &Values) -> Vec<Arc<T>> {
    values.values().map(|v| downcast::<T>(v.clone()).unwrap()).collect()
}
