//! A tap: a node that the job puts behind an output, and that keeps what comes out of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::atomic;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Access, Arg, Computed, Context, Fault, InputSchema, InputType, Kind, Needs, NodeError, NodeSchema, Operator, Problem};
use crate::npz::{self, NpzError};
use crate::registry::NodeType;
use crate::setting::{FileUse, SettingError};
use crate::value::ValueRef;

/// Is given each value of a port with its frame, on the thread where it was made; frames come in any order.
pub type Each = Arc<dyn Fn(i64, &ValueRef) + Send + Sync>;

/// An output that somebody wants to look at while a job runs.
#[derive(Clone)]
pub struct Listener {
    /// The output.
    pub port: Port,
    /// Frames of its clock; all of them where `None`, and where it has one value for the whole graph.
    pub frames: Option<Vec<i64>>,
    /// Who looks.
    pub each: Each,
}

/// An output that is taken, and the file that it is written to.
pub(super) struct Tap {
    pub(super) port: Port,
    pub(super) file: PathBuf,
    /// One value a frame, rather than one for the whole graph.
    per_frame: bool,
    values: Arc<Mutex<BTreeMap<i64, ValueRef>>>,
    written: Mutex<Vec<PathBuf>>,
}

struct Ear(Each);

impl Operator for Ear {
    fn needs(&self, _args: Vec<Arg>, _inputs: &[&'static str], _cx: &Context) -> Result<Needs, NodeError> {
        Ok(Needs::default())
    }

    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        match args.into_iter().next() {
            Some(Arg::Value(value)) => {
                (self.0)(cx.frame, &value);
                Ok(Computed { outputs: Vec::new(), state: None })
            }
            _ => Err(NodeError::internal("expected a value at a tap, found none")),
        }
    }

    fn check(&self, _args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(Vec::new())
    }
}

/// The node that gives the values of `port` to `each`.
pub(super) fn ear(graph: &Graph, port: Port, each: Each) -> GraphNode {
    let tapped = &graph.nodes[port.node];
    let per_frame = !graph.is_single(port);
    GraphNode {
        name: format!("{} to file", graph.port_name(port)),
        ty: NodeType { schema: Arc::new(schema()), operator: Arc::new(Ear(each)) },
        inputs: vec![Binding::Wire(port)],
        per_frame,
        clock: tapped.clock.clone(),
        input_clocks: if per_frame { vec![("value", tapped.clock.clone())] } else { Vec::new() },
        output_types: Vec::new(),
        file: tapped.file,
        span: tapped.span,
        places: Vec::new(),
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
        id: "job.tap",
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

impl Tap {
    /// A tap on `port`, and the node to be added to the graph.
    pub(super) fn new(graph: &Graph, port: Port, file: PathBuf) -> (Self, GraphNode) {
        let values = Arc::new(Mutex::new(BTreeMap::new()));
        let into = values.clone();
        let node = ear(graph, port, Arc::new(move |frame, value: &ValueRef| drop(lock(&into).insert(frame, value.clone()))));
        (Self { port, file, per_frame: node.per_frame, values, written: Mutex::default() }, node)
    }

    /// Writes what was kept; a stream into one file with its frame numbers, or a file a frame where the arrays differ in extents.
    pub(super) fn write(&self) -> Result<(), NodeError> {
        let kept = std::mem::take(&mut *lock(&self.values));
        let (frames, values): (Vec<i64>, Vec<ValueRef>) = kept.into_iter().unzip();
        let Some(first) = values.first() else {
            return Err(NodeError::internal("expected values at a tap, found none"));
        };
        if !self.per_frame {
            return self.file(self.file.clone(), |out| npz::write(first.as_ref(), false, out));
        }
        if is_even(&values) {
            return self.file(self.file.clone(), |out| npz::write_stream(&frames, |k| Ok(values[k].clone()), false, out));
        }
        for (frame, value) in frames.iter().zip(&values) {
            let sign = if *frame < 0 { "-" } else { "" };
            let path = self.file.with_extension(format!("{sign}{:04}.npz", frame.unsigned_abs()));
            self.file(path, |out| npz::write(value.as_ref(), false, out))?;
        }
        Ok(())
    }

    fn file(&self, path: PathBuf, contents: impl FnOnce(&mut BufWriter<&File>) -> Result<(), NpzError>) -> Result<(), NodeError> {
        atomic::write(&path, contents).map_err(|error| NodeError::new(Fault::Io, error.to_string()))?;
        lock(&self.written).push(path);
        Ok(())
    }

    /// The files that were written; before that, the one that most likely will be.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let written = lock(&self.written).clone();
        if written.is_empty() { vec![self.file.clone()] } else { written }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// True where the arrays of all values have the same extents, so that they can be stacked.
fn is_even(values: &[ValueRef]) -> bool {
    let extents = |v: &ValueRef| v.parts().arrays.iter().map(|(name, a)| (*name, a.dtype, a.shape.to_vec())).collect::<Vec<_>>();
    values.first().is_none_or(|first| {
        let first = extents(first);
        values.iter().all(|v| extents(v) == first)
    })
}
