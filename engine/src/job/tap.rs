//! A tap: a node that the job puts behind an output, and that keeps what comes out of it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Access, Arg, Computed, Context, InputSchema, InputType, Kind, Needs, NodeError, NodeSchema, Operator, Problem};
use crate::registry::NodeType;
use crate::setting::{FileUse, SettingError};
use crate::value::ValueRef;

/// An output that is taken, and the file that it is written to.
pub(super) struct Tap {
    pub(super) port: Port,
    pub(super) file: PathBuf,
    /// One value a frame, rather than one for the whole graph.
    per_frame: bool,
    values: Arc<Collector>,
}

#[derive(Default)]
struct Collector(Mutex<BTreeMap<i64, ValueRef>>);

impl Operator for Collector {
    fn needs(&self, _args: Vec<Arg>, _inputs: &[&'static str], _cx: &Context) -> Result<Needs, NodeError> {
        Ok(Needs::default())
    }

    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        match args.into_iter().next() {
            Some(Arg::Value(value)) => {
                self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(cx.frame, value);
                Ok(Computed { outputs: Vec::new(), state: None })
            }
            _ => Err(NodeError::internal("expected a value at a tap, found none")),
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
        list: false,
        optional: false,
        default: None,
        unit: None,
        range: None,
        choices: Vec::new(),
        literal: None,
        files: FileUse::None,
        any_clock: false,
        parse: |text, _| Err(SettingError::whole(text, "expected a reference, found a literal")),
    };
    NodeSchema {
        id: "job.tap",
        version: 1,
        kind: Kind::Sink,
        doc: "Keeps what comes out of a port.",
        source: None,
        example: None,
        uses_frame: false,
        type_from: None,
        inputs: vec![input],
        outputs: Vec::new(),
    }
}

impl Tap {
    /// A tap on `port`, and the node to be added to the graph.
    pub(super) fn new(graph: &Graph, port: Port, file: PathBuf) -> (Self, GraphNode) {
        let values = Arc::new(Collector::default());
        let tapped = &graph.nodes[port.node];
        let per_frame = !graph.is_single(port);
        let node = GraphNode {
            name: format!("{} to file", graph.port_name(port)),
            ty: NodeType { schema: Arc::new(schema()), operator: values.clone() },
            inputs: vec![Binding::Wire(port)],
            per_frame,
            clock: tapped.clock.clone(),
            input_clocks: if per_frame { vec![("value", tapped.clock.clone())] } else { Vec::new() },
            output_types: Vec::new(),
            file: tapped.file,
            span: tapped.span,
        };
        (Self { port, file, per_frame, values }, node)
    }

    /// Writes what was kept; a stream with the frame numbers.
    pub(super) fn write(&self) -> Result<(), NodeError> {
        let kept = std::mem::take(&mut *self.values.0.lock().unwrap_or_else(PoisonError::into_inner));
        if let Some(folder) = self.file.parent() {
            std::fs::create_dir_all(folder).map_err(|e| NodeError::io(folder, e))?;
        }
        let (frames, values): (Vec<i64>, Vec<ValueRef>) = kept.into_iter().unzip();
        write_npz(&self.file, self.per_frame.then_some(frames.as_slice()), &values)
    }
}

// NPZ CALL SITE: becomes `crate::npz::write` once that module is there.
fn write_npz(file: &std::path::Path, _frames: Option<&[i64]>, _values: &[ValueRef]) -> Result<(), NodeError> {
    Err(NodeError::internal(format!("{}: .npz files cannot be written yet", file.display())))
}
