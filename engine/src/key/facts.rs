//! The facts of a node that are the same for all its tasks: what its keys are made from, and what is told where they changed.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::clock::Clock;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Access, InputSchema, Kind, Literal, NodeError};
use crate::plan::wires;
use crate::setting::{ClockName, FileUse, InputPath, InputPaths, Missing, OutputPath};

use super::literal::canonical;

/// What a [`Fact`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FactKind {
    /// The node type's id.
    Type,
    /// The version of its behaviour.
    Version,
    /// Rate of a clock, in frames a second as a fraction.
    Rate,
    /// First frame of a clock.
    First,
    /// Last frame of a clock.
    Last,
    /// Nothing stands at an input.
    Nothing,
    /// A literal in canonical form.
    Literal,
    /// A clock's name stands there; its rate and frames count, and not its name.
    Clock,
    /// The content of a file that is read: how its name ends, and its digest.
    File,
    /// Files, one a frame, that are read: how their names end.
    Files,
    /// A file, or one a frame, that is written: its place below the output folder.
    Written,
    /// A reference: the output's name, and which of its values are read.
    Wire,
    /// The content of a value that is known before the plan: its digest.
    Constant,
}

impl FactKind {
    const fn tag(self) -> u8 {
        self as u8
    }
}

/// One fact of a key that is the same for all tasks of a node.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fact {
    /// What it is.
    pub kind: FactKind,
    /// The input that it is about; empty where it is about the node.
    pub input: String,
    /// What there is to say.
    pub text: String,
}

impl Fact {
    /// Adds the fact to a hash, such that no two rows of facts run together.
    pub(super) fn put(&self, hasher: &mut blake3::Hasher) {
        hasher.update(&[self.kind.tag()]);
        for field in [&self.input, &self.text] {
            hasher.update(&(field.len() as u64).to_le_bytes());
            hasher.update(field.as_bytes());
        }
    }
}

/// Which values of a wire a task reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The one of the same frame.
    Same,
    /// The one that there is.
    Held,
    /// All of them.
    All,
    /// Those of the frames that it asks for.
    Asked,
}

impl Mode {
    pub(crate) fn of(graph: &Graph, spec: &GraphNode, input: &InputSchema, port: Port) -> Self {
        let single = graph.is_single(port);
        match input.access {
            access if access.asks() && !single => Self::Asked,
            access if access.by_handle() => Self::All,
            _ if single || spec.runs_once() => Self::Held,
            _ => Self::Same,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Same => "the same frame",
            Self::Held => "held",
            Self::All => "all frames",
            Self::Asked => "frames asked for",
        }
    }
}

/// True where one task of the producer gives values of many frames, of which this reads the one of its own.
pub(super) fn is_part(graph: &Graph, port: Port) -> bool {
    graph.nodes[port.node].runs_once() && !graph.is_single(port)
}

/// The facts of a node, in a fixed order: its type, its clock, then its inputs as they are declared.
///
/// `constant` gives the digest of a port's value where that is known already, and `content` that of a file, in hexadecimal.
///
/// # Errors
/// Where a file cannot be read.
pub(crate) fn facts(
    graph: &Graph,
    node: usize,
    mut constant: impl FnMut(Port) -> Option<[u8; 32]>,
    mut content: impl FnMut(&Path) -> Result<String, NodeError>,
) -> Result<Vec<Fact>, NodeError> {
    let spec = &graph.nodes[node];
    let schema = &spec.ty.schema;
    let fact = |kind, text: String| Fact { kind, input: String::new(), text };
    let mut out = vec![fact(FactKind::Type, schema.id.to_owned()), fact(FactKind::Version, version(spec))];
    if spec.per_frame || sees_range(spec) {
        put_clock(&mut out, "", &spec.clock, sees_frame(spec), sees_range(spec));
    }
    for (binding, input) in spec.inputs.iter().zip(&schema.inputs) {
        let fact = |kind, text: String| Fact { kind, input: input.name.to_owned(), text };
        match binding {
            Binding::None => out.push(fact(FactKind::Nothing, String::new())),
            Binding::Literal { value, .. } if is_clock(value) => out.push(fact(FactKind::Clock, String::new())),
            Binding::Literal { value, text } => out.push(match named_file(input, value) {
                Some(File::Read(path)) if path.is_sequence() => fact(FactKind::Files, ending(Path::new(&path.pattern()))),
                Some(File::Read(path)) => {
                    let path = path.at(0);
                    fact(FactKind::File, format!("{} {}", ending(&path), content(&path)?))
                }
                Some(File::Several(paths)) => {
                    let one = |path: &InputPath| Ok(format!("{} {}", ending(&path.at(0)), content(&path.at(0))?));
                    fact(FactKind::File, paths.0.iter().map(one).collect::<Result<Vec<_>, NodeError>>()?.join(", "))
                }
                Some(File::Written(path)) => fact(FactKind::Written, below_root(&path)),
                None => fact(FactKind::Literal, canonical(text, !input.choices.is_empty())),
            }),
            Binding::Wire(_) | Binding::List(_) => {}
        }
        for path in beside(spec, input, binding) {
            out.push(fact(FactKind::File, format!("{} {}", ending(&path), content(&path)?)));
        }
        if let Binding::List(ports) = binding {
            out.push(fact(FactKind::Literal, ports.len().to_string()));
        }
        for port in wires(std::slice::from_ref(binding)) {
            match constant(port) {
                Some(digest) => out.push(fact(FactKind::Constant, hex(&digest))),
                None => put_wire(&mut out, graph, spec, input, port),
            }
        }
    }
    Ok(out)
}

/// The version of a node's behaviour; of one out of a plugin also the plugin's, and what its library is.
fn version(spec: &GraphNode) -> String {
    let own = spec.ty.schema.version;
    match spec.ty.operator.plugin() {
        Some(plugin) => format!("{own}, {} {} ({})", plugin.name, plugin.version, plugin.digest),
        None => own.to_string(),
    }
}

fn put_wire(out: &mut Vec<Fact>, graph: &Graph, spec: &GraphNode, input: &InputSchema, port: Port) {
    let producer = &graph.nodes[port.node];
    let mode = Mode::of(graph, spec, input, port);
    let name = producer.ty.schema.outputs.get(port.output).map_or("", |o| o.name);
    let part = if is_part(graph, port) { ", of one run" } else { "" };
    out.push(Fact { kind: FactKind::Wire, input: input.name.to_owned(), text: format!("{name}, {}{part}", mode.name()) });
    // A node that reads a sequence, or asks for frames, can look at the clock that they are on.
    if matches!(mode, Mode::All | Mode::Asked) && !graph.is_single(port) {
        put_clock(out, input.name, &producer.clock, true, mode == Mode::All || sees_range(spec));
    }
}

/// The rate of a clock; its first frame for whoever counts from there, and its last for whoever looks that far.
fn put_clock(out: &mut Vec<Fact>, input: &str, clock: &Clock, first: bool, last: bool) {
    let mut put = |kind, text: String| out.push(Fact { kind, input: input.to_owned(), text });
    put(FactKind::Rate, format!("{}/{}", clock.fps.0, clock.fps.1));
    if first || last {
        put(FactKind::First, clock.first.to_string());
    }
    if last {
        put(FactKind::Last, clock.last.to_string());
    }
}

pub(crate) fn hex(digest: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*digest).to_hex().to_string()
}

/// How a file's name ends, which tells readers what it is.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

fn below_root(path: &OutputPath) -> String {
    let whole = path.pattern();
    Path::new(&whole).strip_prefix(path.root()).map_or(whole.clone(), |p| p.to_string_lossy().into_owned())
}

/// A file that a setting names.
enum File {
    Read(InputPath),
    Several(InputPaths),
    Written(OutputPath),
}

fn named_file(input: &InputSchema, value: &Literal) -> Option<File> {
    match input.files {
        FileUse::None => None,
        FileUse::Read => of::<InputPath>(value).map(File::Read).or_else(|| of::<InputPaths>(value).map(File::Several)),
        FileUse::Write => of::<OutputPath>(value).map(File::Written),
    }
}

/// The files that are there of those that the file at an input names.
fn beside(spec: &GraphNode, input: &InputSchema, binding: &Binding) -> Vec<PathBuf> {
    match (spec.ty.schema.beside, binding) {
        (Some(beside), Binding::Literal { value, .. }) => match named_file(input, value) {
            Some(File::Read(path)) if !path.is_sequence() => beside(&path.at(0)).into_iter().filter(|p| p.is_file()).collect(),
            _ => Vec::new(),
        },
        _ => Vec::new(),
    }
}

/// The files that are there of those that the files which a node reads name, in the order of its inputs.
pub(super) fn beside_all(spec: &GraphNode) -> Vec<PathBuf> {
    spec.inputs.iter().zip(&spec.ty.schema.inputs).flat_map(|(binding, input)| beside(spec, input, binding)).collect()
}

/// The paths that a node reads, in the order of its inputs.
pub(super) fn read_paths<'a>(spec: &'a GraphNode) -> impl Iterator<Item = InputPath> + 'a {
    let literal = |binding: &'a Binding| if let Binding::Literal { value, .. } = binding { Some(value) } else { None };
    let read = spec.inputs.iter().zip(&spec.ty.schema.inputs).filter(|(_, input)| input.files == FileUse::Read);
    read.filter_map(move |(binding, _)| literal(binding)).flat_map(|value| {
        let one = of::<InputPath>(value).into_iter();
        one.chain(of::<InputPaths>(value).into_iter().flat_map(|paths| paths.0))
    })
}

/// A setting of type `T`, or one that may be left out and is not.
fn of<T: Clone + 'static>(value: &Literal) -> Option<T> {
    value.downcast_ref::<T>().cloned().or_else(|| value.downcast_ref::<Option<T>>().cloned().flatten())
}

fn is_clock(value: &Literal) -> bool {
    value.is::<ClockName>() || value.is::<Option<ClockName>>()
}

fn literals(spec: &GraphNode) -> impl Iterator<Item = &Literal> {
    spec.inputs.iter().filter_map(|b| if let Binding::Literal { value, .. } = b { Some(value) } else { None })
}

pub(super) fn missing(spec: &GraphNode) -> Missing {
    literals(spec).find_map(|v| v.downcast_ref::<Missing>().copied()).unwrap_or_default()
}

/// True for a node whose result may differ from frame to frame though its inputs do not.
pub(super) fn sees_frame(spec: &GraphNode) -> bool {
    let schema = &spec.ty.schema;
    let is_pattern =
        |v: &Literal| of::<InputPath>(v).is_some_and(|p| p.is_sequence()) || of::<OutputPath>(v).is_some_and(|p| p.is_sequence());
    schema.uses_frame
        || schema.kind == Kind::Recurrent
        || (schema.kind == Kind::Source && spec.per_frame)
        || schema.inputs.iter().any(|i| i.access == Access::Frames)
        || literals(spec).any(is_pattern)
}

/// True for a node whose result may differ with the first and last frame of its clock.
fn sees_range(spec: &GraphNode) -> bool {
    spec.ty.schema.uses_frame || spec.ty.schema.kind == Kind::Whole || literals(spec).any(is_clock)
}
