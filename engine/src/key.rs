//! Keys: a name for every result before it is computed. Same key, same bits.
//!
//! The key of a task says what its result is made from, and nothing else:
//!
//! - the node type and the version of its behaviour;
//! - its settings in canonical form, defaults as if they were written out: `1.0` and `1.00`, blanks, comments, and a word with or without its
//!   quotes make no difference;
//! - for each input the keys of the values that it reads, at the frames that the plan says, or the content of a value that is known already;
//! - the contents of the files that it reads, and how their names end, but not where they lie; for a reader of frames that is the file that its
//!   policy for missing frames picks;
//! - for a recurrent node the key of the state that it starts from, and so of the whole chain before it;
//! - the rate of its clock, in frames a second, where it has one value a frame or runs over sequences.
//!
//! The number of the frame is part of the key only of nodes that can tell: those that declare `uses_frame`, ask for frames of their inputs, are
//! recurrent, have a frame number in a path, or are sources of a stream. Any other node must not look at [`Context::frame`](crate::node::Context::frame) while it
//! computes, and its result is shared between frames with equal inputs. In the same way the first frame of the clock counts for those that see
//! their frame, and its last only for nodes that run over whole sequences, declare `uses_frame`, or name a clock: a shot made longer keeps the
//! frames that it had.
//!
//! Names of nodes, their order, the layout of the file, what no input leads to, and who reads the result do not matter. Nothing of this is written
//! by the author of a node: it all follows from the declaration and the plan.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use blake3::{Hash, Hasher};

use crate::clock::Clock;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Access, InputSchema, Kind, Literal, NodeError};
use crate::plan::{Edge, Plan, PlanError, Reads, wires};
use crate::setting::{ClockName, FileUse, InputPath, Missing, OutputPath};
use crate::syntax::{NodeKind, NodeRef, TokenKind, Tree};

/// Changes with what keys are made of, so that those of other versions of Pegbar are never met.
const SALT: &[u8] = b"pegbar key 1";

/// Keys of the values of a plan, found when they are asked for and then remembered.
///
/// Cost: one short hash for each task and each read of it; each file is read once.
pub struct Keys<'a> {
    graph: &'a Graph,
    plan: &'a Plan,
    /// For each node, what is the same for all its tasks.
    fixed: Vec<Option<Hash>>,
    tasks: Vec<Vec<Option<Hash>>>,
    files: BTreeMap<PathBuf, Hash>,
    known: BTreeMap<Port, Hash>,
}

impl<'a> Keys<'a> {
    /// Keys of what `plan` makes of `graph`.
    pub fn new(graph: &'a Graph, plan: &'a Plan) -> Self {
        let tasks = plan.nodes.iter().map(|n| vec![None; n.wanted.len()]).collect();
        Self { graph, plan, fixed: vec![None; graph.nodes.len()], tasks, files: BTreeMap::new(), known: BTreeMap::new() }
    }

    /// The key of the value of `port` at `frame`, which is not looked at where there is one value for the whole graph. For the port after the last
    /// of a recurrent node it is that of its state; a sink, which has no ports, has its key at port 0.
    ///
    /// # Errors
    /// Where the plan does not make that value, or a file that it hangs on cannot be read.
    pub fn key(&mut self, port: Port, frame: i64) -> Result<Hash, PlanError> {
        if let Some(hash) = self.known_key(port) {
            return Ok(hash);
        }
        let node = &self.graph.nodes[port.node];
        let index = if self.graph.is_single(port) { Some(0) } else { node.clock.index(frame) };
        let wanted = &self.plan.nodes[port.node].wanted;
        let task = index.map(|i| if node.runs_once() { 0 } else { i });
        match (index, task) {
            (Some(index), Some(task)) if wanted.get(task) == Some(&true) => {
                self.find(port.node, task)?;
                self.value_key(port, index)
            }
            _ => {
                let message = format!("expected a frame of the plan, found frame {frame} of `{}`", node.name);
                Err(PlanError { node: port.node, frame: Some(frame), error: NodeError::internal(message) })
            }
        }
    }

    fn known_key(&mut self, port: Port) -> Option<Hash> {
        let value = self.plan.known.get(&port)?;
        Some(*self.known.entry(port).or_insert_with(|| crate::value::digest(value.as_ref())))
    }

    /// Finds the key of a task, after those of all that it reads. Chains of states are long, so that this keeps its own stack.
    fn find(&mut self, node: usize, task: usize) -> Result<(), PlanError> {
        let mut stack = vec![(node, task)];
        while let Some(&(node, task)) = stack.last() {
            let before = stack.len();
            if self.tasks[node][task].is_none() {
                let plan = self.plan;
                for edge in &plan.nodes[node].edges {
                    let missing = self.reads(edge, task).into_iter().map(|i| (edge.port.node, self.task_of(edge.port, i)));
                    stack.extend(missing.filter(|&(n, t)| self.tasks[n][t].is_none()));
                }
            }
            if stack.len() == before {
                stack.pop();
                if self.tasks[node][task].is_none() {
                    self.tasks[node][task] = Some(self.task_key(node, task)?);
                }
            }
        }
        Ok(())
    }

    /// Positions of the values that an edge brings to a task.
    fn reads(&self, edge: &Edge, task: usize) -> Vec<usize> {
        match &edge.reads {
            Reads::Same => vec![task],
            Reads::Held => vec![0],
            Reads::All if self.graph.is_single(edge.port) => vec![0],
            Reads::All => (0..self.graph.nodes[edge.port.node].clock.len()).collect(),
            Reads::Lists(lists) => lists.forward.get(task).map_or_else(Vec::new, |l| l.iter().map(|&i| i as usize).collect()),
        }
    }

    fn task_of(&self, port: Port, index: usize) -> usize {
        if self.graph.nodes[port.node].runs_once() { 0 } else { index }
    }

    /// The key of one value of a task whose key is found.
    fn value_key(&self, port: Port, index: usize) -> Result<Hash, PlanError> {
        let node = &self.graph.nodes[port.node];
        let lost = || PlanError { node: port.node, frame: None, error: NodeError::internal("a key was used before it was found") };
        let task = self.tasks[port.node].get(self.task_of(port, index)).copied().flatten().ok_or_else(lost)?;
        let mut hasher = Hasher::new();
        hasher.update(task.as_bytes());
        put(&mut hasher, node.ty.schema.outputs.get(port.output).map_or("state", |o| o.name).as_bytes());
        // One task of a node that runs once gives the values of all frames.
        let part = if node.runs_once() { index as u64 } else { 0 };
        hasher.update(&part.to_le_bytes());
        Ok(hasher.finalize())
    }

    fn task_key(&mut self, node: usize, task: usize) -> Result<Hash, PlanError> {
        let (graph, plan) = (self.graph, self.plan);
        let spec = &graph.nodes[node];
        let mut hasher = Hasher::new();
        hasher.update(self.fixed(node).as_bytes());
        let frame = if spec.runs_once() { spec.clock.first } else { spec.clock.first + task as i64 };
        if sees_frame(spec) && !spec.runs_once() {
            put(&mut hasher, &frame.to_le_bytes());
        }
        let mut edges = plan.nodes[node].edges.iter();
        for (binding, input) in spec.inputs.iter().zip(&spec.ty.schema.inputs) {
            put(&mut hasher, input.name.as_bytes());
            let file = self.file(spec, binding, input, frame);
            if let Some(file) = file.map_err(|error| PlanError { node, frame: Some(frame), error })? {
                hasher.update(file.as_bytes());
            }
            for port in wires(std::slice::from_ref(binding)) {
                match self.known_key(port) {
                    Some(hash) => drop(hasher.update(hash.as_bytes())),
                    None => self.put_reads(&mut hasher, node, edges.next(), task)?,
                }
            }
        }
        // What is left is the read of the node's own state.
        self.put_reads(&mut hasher, node, edges.next(), task)?;
        Ok(hasher.finalize())
    }

    fn put_reads(&self, hasher: &mut Hasher, node: usize, edge: Option<&Edge>, task: usize) -> Result<(), PlanError> {
        let Some(edge) = edge else { return Ok(()) };
        let reads = self.reads(edge, task);
        let clock = &self.graph.nodes[edge.port.node].clock;
        hasher.update(&(reads.len() as u64).to_le_bytes());
        // A node that reads a sequence, or asks for frames, can look at the clock that they are on.
        if matches!(edge.reads, Reads::All | Reads::Lists(_)) && !self.graph.is_single(edge.port) && edge.port.node != node {
            put_clock(hasher, clock, true, matches!(edge.reads, Reads::All) || sees_range(&self.graph.nodes[node]));
        }
        for index in reads {
            if matches!(edge.reads, Reads::Lists(_)) {
                hasher.update(&(clock.first + index as i64).to_le_bytes());
            }
            hasher.update(self.value_key(edge.port, index)?.as_bytes());
        }
        Ok(())
    }

    /// What is the same for every task of a node.
    fn fixed(&mut self, node: usize) -> Hash {
        if let Some(hash) = self.fixed[node] {
            return hash;
        }
        let spec = &self.graph.nodes[node];
        let schema = &spec.ty.schema;
        let mut hasher = Hasher::new();
        put(&mut hasher, SALT);
        put(&mut hasher, schema.id.as_bytes());
        hasher.update(&schema.version.to_le_bytes());
        if spec.per_frame || sees_range(spec) {
            put_clock(&mut hasher, &spec.clock, sees_frame(spec), sees_range(spec));
        }
        for (binding, input) in spec.inputs.iter().zip(&schema.inputs) {
            put(&mut hasher, input.name.as_bytes());
            match binding {
                Binding::None => put(&mut hasher, b"none"),
                Binding::Literal { value, .. } if is_clock(value) => put(&mut hasher, b"clock"),
                Binding::Literal { text, .. } if input.files == FileUse::None => {
                    put(&mut hasher, b"literal");
                    put(&mut hasher, canonical(text, !input.choices.is_empty()).as_bytes());
                }
                Binding::Literal { .. } => put(&mut hasher, b"file"),
                Binding::Wire(_) => put(&mut hasher, b"wire"),
                Binding::List(ports) => put(&mut hasher, &[b"list", (ports.len() as u64).to_le_bytes().as_slice()].concat()),
            }
        }
        let hash = hasher.finalize();
        self.fixed[node] = Some(hash);
        hash
    }

    /// What a path stands for at a frame: the content of the file that is read, or the place below the output folder that is written.
    fn file(&mut self, spec: &GraphNode, binding: &Binding, input: &InputSchema, frame: i64) -> Result<Option<Hash>, NodeError> {
        let Binding::Literal { value, .. } = binding else { return Ok(None) };
        match input.files {
            FileUse::None => Ok(None),
            FileUse::Read => {
                let Some(path) = of::<InputPath>(value) else { return Ok(None) };
                let pick = path.resolve(frame, missing(spec));
                let pick =
                    pick.ok_or_else(|| NodeError::input(format!("expected a file for frame {frame} of {}, found none", path.pattern())))?;
                self.content(&pick).map(Some)
            }
            FileUse::Write => {
                let Some(path) = of::<OutputPath>(value) else { return Ok(None) };
                let file = path.at(frame);
                let below = file.strip_prefix(path.root()).unwrap_or(&file);
                Ok(Some(blake3::hash(below.to_string_lossy().as_bytes())))
            }
        }
    }

    /// The content of a file with how its name ends, which tells readers what it is.
    fn content(&mut self, path: &Path) -> Result<Hash, NodeError> {
        if let Some(hash) = self.files.get(path) {
            return Ok(*hash);
        }
        let file = std::fs::File::open(path).map_err(|e| NodeError::io(path, e))?;
        let mut hasher = Hasher::new();
        put(&mut hasher, path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_bytes());
        hasher.update_reader(file).map_err(|e| NodeError::io(path, e))?;
        let hash = hasher.finalize();
        self.files.insert(path.to_owned(), hash);
        Ok(hash)
    }
}

/// A field with its length before it, so that no two rows of fields run together.
fn put(hasher: &mut Hasher, field: &[u8]) {
    hasher.update(&(field.len() as u64).to_le_bytes());
    hasher.update(field);
}

/// The rate of a clock; its first frame for whoever counts from there, and its last for whoever looks that far.
fn put_clock(hasher: &mut Hasher, clock: &Clock, first: bool, last: bool) {
    put(hasher, b"clock");
    hasher.update(&clock.fps.0.to_le_bytes());
    hasher.update(&clock.fps.1.to_le_bytes());
    if first || last {
        hasher.update(&clock.first.to_le_bytes());
    }
    if last {
        hasher.update(&clock.last.to_le_bytes());
    }
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

fn missing(spec: &GraphNode) -> Missing {
    literals(spec).find_map(|v| v.downcast_ref::<Missing>().copied()).unwrap_or_default()
}

/// True for a node whose result may differ from frame to frame though its inputs do not.
fn sees_frame(spec: &GraphNode) -> bool {
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

/// A literal such that equal values read the same: no blanks or comments, no comma before a bracket that closes, numbers and texts by their
/// values, and a word of an enumeration without quotes.
fn canonical(text: &str, is_word: bool) -> String {
    let tree = Tree::parse(text.to_owned());
    if let Some(word) = tree.value().filter(|_| is_word).and_then(NodeRef::as_str) {
        return word.into_value().into_owned();
    }
    let mut out = String::new();
    let texts: BTreeMap<usize, String> = (tree.root().descendants().filter(|n| n.kind() == NodeKind::String))
        .filter_map(|n| Some((n.span().start, format!("{:?}", n.as_str()?.into_value()))))
        .collect();
    for token in tree.tokens().filter(|t| !t.kind().is_trivia()) {
        if matches!(token.kind(), TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace) && out.ends_with(',') {
            out.pop();
        }
        match (texts.get(&token.span().start), token.kind()) {
            (Some(text), _) => out.push_str(text),
            (None, TokenKind::Number) => out.push_str(&number(token.text())),
            (None, _) => out.push_str(token.text()),
        }
    }
    out
}

/// A number by its value: whole numbers as such, all others in the shortest form that reads back the same.
fn number(text: &str) -> String {
    let plain = text.replace('_', "");
    let whole = plain.strip_prefix('+').unwrap_or(&plain);
    if let Ok(n) = whole.parse::<i128>() {
        // Minus nought is another float than nought.
        return if n == 0 && whole.starts_with('-') { "-0".to_owned() } else { n.to_string() };
    }
    match plain.parse::<f64>() {
        // Above that not every whole number is a float, so that the two forms may differ.
        Ok(n) if n == n.trunc() && n.abs() < 9e15 => format!("{n:.0}"),
        Ok(n) => format!("{n:e}"),
        Err(_) => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_literals_read_the_same() {
        let same = [
            ("1.0", "1.00"),
            ("1", "1.0"),
            ("1e3", "1000"),
            ("1_000", "+1000"),
            ("[1, 2,]", "[ 1,2.0 ]"),
            ("(0.5,)", "(5e-1)"),
            ("\"a\\u{62}\"", "r\"ab\""),
            ("-0", "-0.0"),
            ("[/* no */ 1]", "[1]"),
        ];
        for (a, b) in same {
            assert_eq!(canonical(a, false), canonical(b, false), "{a} {b}");
        }
        let other = [
            ("0", "-0"),
            ("1", "1.0000000000000002"),
            ("\"1\"", "1"),
            ("[1,2]", "[12]"),
            ("\"a b\"", "\"ab\""),
            ("1e16", "1e17"),
            ("\",]\"", "\"]\""),
        ];
        for (a, b) in other {
            assert_ne!(canonical(a, false), canonical(b, false), "{a} {b}");
        }
        assert_eq!(canonical("\"cubic\"", true), canonical("cubic", true));
    }
}
