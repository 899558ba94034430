//! Keys: a name for every result before it is computed. Same key, same bits.
//!
//! The key of a task says what its result is made from, and nothing else:
//!
//! - the node type and the version of its behaviour;
//! - its settings in canonical form, defaults as if they were written out: `1.0` and `1.00`, blanks, comments, and a word with or without its
//!   quotes make no difference;
//! - for each input the keys of the values that it reads, at the frames that the plan says, or the content of a value that is known already;
//! - the contents of the files that it reads, and how their names end, but not where they lie; for a reader of frames that is the file that its
//!   policy for missing frames picks, and for a node that runs once all of them;
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

mod facts;
mod literal;

use std::path::PathBuf;

use blake3::Hasher;

use crate::graph::{Graph, GraphNode};
use crate::node::NodeError;
use crate::plan::{Edge, Plan, PlanError, Reads, consumers_first};
use crate::setting::InputPath;
use crate::stamp::Files;

pub use facts::{Fact, FactKind, Mode};
use facts::{beside_all, is_part, missing, read_paths, sees_frame};
pub(crate) use facts::{facts, hex};

/// Changes with what keys are made of, so that those of other versions of Pegbar are never met.
pub const KEY_VERSION: &str = "pegbar key 2";

/// What a content key begins with; a task's key never has it there, as its length is another.
const CONTENT: &[u8] = b"content";

/// Stands for the key of a task that nobody wants; no hash is nought.
const UNWANTED: [u8; 32] = [0; 32];

/// Keys of all tasks of a plan.
///
/// Cost: for each task one short hash, of one block of 64 bytes where it reads up to two values. Each file is read once, or not at all where its
/// stamp is known.
#[derive(Clone)]
pub struct Keys {
    nodes: Vec<NodeKeys>,
    tasks: Vec<[u8; 32]>,
}

#[derive(Clone)]
struct NodeKeys {
    runs_once: bool,
    /// What stands for each output, its state being the last.
    tags: Vec<u64>,
    /// Its tasks in the row of all.
    first: usize,
    len: usize,
    /// Hash of what is the same for all its tasks.
    facts: [u8; 32],
    /// The first frame of its clock, where its tasks see which frame they make.
    first_frame: Option<i64>,
    /// Digests of the files that each task reads, where they have frame numbers.
    files: Vec<Vec<[u8; 32]>>,
}

impl Keys {
    /// Keys of what `plan` makes of `graph`.
    ///
    /// # Errors
    /// Where a file that a task hangs on cannot be read.
    pub fn of(graph: &Graph, plan: &Plan, files: &Files) -> Result<Self, PlanError> {
        let mut nodes = Vec::with_capacity(graph.nodes.len());
        let mut first = 0;
        for (node, spec) in graph.nodes.iter().enumerate() {
            let len = plan.nodes[node].wanted.len();
            nodes.push(NodeKeys::of(graph, plan, node, first, files)?);
            first += len;
            debug_assert_eq!(len, if spec.runs_once() { 1 } else { spec.clock.len() });
        }
        let mut keys = Self { nodes, tasks: vec![UNWANTED; first] };
        for node in consumers_first(graph).into_iter().rev() {
            keys.fill(graph, plan, node);
        }
        Ok(keys)
    }

    /// The key of a task; `None` where the plan does not want it.
    pub fn task(&self, node: usize, task: usize) -> Option<&[u8; 32]> {
        let node = self.nodes.get(node)?;
        self.tasks[node.first..node.first + node.len].get(task).filter(|key| **key != UNWANTED)
    }

    /// The key of the value at position `index` of an output; the output after the last is the state of a recurrent node, and a sink has its one
    /// key at output 0. Derived from the task's key, so that it says nothing where [`Keys::task`] has none.
    pub fn value(&self, node: usize, output: usize, index: usize) -> [u8; 32] {
        let task = if self.nodes[node].runs_once { 0 } else { index };
        self.value_of(self.task(node, task).unwrap_or(&UNWANTED), node, output, index)
    }

    /// As [`Keys::value`], from a key of the task that is given: its content key, or its own.
    pub fn value_of(&self, task: &[u8; 32], node: usize, output: usize, index: usize) -> [u8; 32] {
        let keys = &self.nodes[node];
        // One task of a node that runs once gives the values of all frames.
        let part = if keys.runs_once { index as u64 } else { 0 };
        // A task's key is as good as random, so that what tells its values apart need not be hashed again.
        let mut value = *task;
        let tag = keys.tags.get(output).copied().unwrap_or_default();
        value.iter_mut().zip(tag.to_le_bytes().into_iter().chain(part.to_le_bytes())).for_each(|(byte, more)| *byte ^= more);
        value
    }

    /// The content key of a task: the facts of its key, with the digests of the values that it reads in place of their keys. Tasks with one content
    /// key give the same bits, whatever led to what they read. `digests` gives the digest of the value at a position of what an edge brings.
    ///
    /// `None` where a digest is not known, the plan does not want the task, or it reads no value, so that its own key says as much.
    pub fn content(
        &self,
        graph: &Graph,
        plan: &Plan,
        node: usize,
        task: usize,
        mut digests: impl FnMut(usize, usize) -> Option<[u8; 32]>,
    ) -> Option<[u8; 32]> {
        self.task(node, task)?;
        let keys = &self.nodes[node];
        let mut message = CONTENT.to_vec();
        keys.put_own(&mut message, task);
        let mut count = 0_usize;
        for (e, edge) in plan.nodes[node].edges.iter().enumerate() {
            put_reads(&mut message, graph, edge, task, |message, index| {
                count += 1;
                message.extend(digests(e, index)?);
                Some(())
            })?;
        }
        (count > 0).then(|| *blake3::keyed_hash(&keys.facts, &message).as_bytes())
    }

    /// Finds the keys of a node's tasks; those of all that it reads are there.
    fn fill(&mut self, graph: &Graph, plan: &Plan, node: usize) {
        let edges: Vec<(&Edge, Option<[u8; 32]>)> = plan.nodes[node].edges.iter().map(|e| (e, self.whole(e))).collect();
        let is_part: Vec<bool> = edges.iter().map(|(e, _)| is_part(graph, e.port)).collect();
        let mut message = Vec::new();
        for task in chain_order(plan, node) {
            message.clear();
            self.nodes[node].put_own(&mut message, task);
            for ((edge, whole), is_part) in edges.iter().zip(&is_part) {
                match whole {
                    Some(whole) => message.extend(whole),
                    None => self.put_keys(&mut message, graph, edge, task, *is_part),
                }
            }
            let keys = &self.nodes[node];
            self.tasks[keys.first + task] = *blake3::keyed_hash(&keys.facts, &message).as_bytes();
        }
    }

    fn put_keys(&self, message: &mut Vec<u8>, graph: &Graph, edge: &Edge, task: usize, is_part: bool) {
        let producer = &self.nodes[edge.port.node];
        // It never gives up, as every key is there.
        let _ = put_reads(message, graph, edge, task, |message, index| {
            message.extend(self.tasks[producer.first + if producer.runs_once { 0 } else { index }]);
            if is_part {
                message.extend((index as u64).to_le_bytes());
            }
            Some(())
        });
    }

    /// What stands for a whole sequence in the key of each task that reads it.
    fn whole(&self, edge: &Edge) -> Option<[u8; 32]> {
        let producer = &self.nodes[edge.port.node];
        let keys = self.tasks[producer.first..producer.first + producer.len].as_flattened();
        matches!(edge.reads, Reads::All).then(|| *blake3::hash(keys).as_bytes())
    }
}

/// What the state of a recurrent node is called among its outputs.
const STATE: &str = "state";

fn tag(output: &str) -> u64 {
    let hash = blake3::hash(output.as_bytes());
    hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

impl NodeKeys {
    fn of(graph: &Graph, plan: &Plan, node: usize, first: usize, files: &Files) -> Result<Self, PlanError> {
        let spec = &graph.nodes[node];
        let wanted = &plan.nodes[node].wanted;
        let mut keys = Self {
            runs_once: spec.runs_once(),
            tags: spec.ty.schema.outputs.iter().map(|o| o.name).chain([STATE]).map(tag).collect(),
            first,
            len: wanted.len(),
            facts: UNWANTED,
            first_frame: (sees_frame(spec) && !spec.runs_once()).then_some(spec.clock.first),
            files: Vec::new(),
        };
        if !wanted.contains(&true) {
            return Ok(keys);
        }
        let failed = |frame: Option<i64>| move |error| PlanError { node, frame, error };
        let constant = |port| plan.known.get(&port).map(|value| *crate::value::digest(value.as_ref()).as_bytes());
        let mut hasher = Hasher::new();
        hasher.update(KEY_VERSION.as_bytes());
        for fact in facts(graph, node, constant, |path| files.digest(path).map(|d| hex(&d))).map_err(failed(None))? {
            fact.put(&mut hasher);
        }
        keys.facts = *hasher.finalize().as_bytes();
        if reads_numbered(spec) {
            keys.files = vec![Vec::new(); wanted.len()];
            for task in (0..wanted.len()).filter(|&k| wanted[k]) {
                let frame = (!spec.runs_once()).then(|| spec.clock.first + task as i64);
                let digests = paths(spec, task, true).into_iter().map(|path| files.digest(&path?));
                keys.files[task] = digests.collect::<Result<_, _>>().map_err(failed(frame))?;
            }
        }
        Ok(keys)
    }

    /// The frame, for a node that sees it, and the files of a task.
    fn put_own(&self, message: &mut Vec<u8>, task: usize) {
        if let Some(first) = self.first_frame {
            message.extend((first + task as i64).to_le_bytes());
        }
        self.files.get(task).into_iter().flatten().for_each(|digest| message.extend(digest));
    }
}

/// Adds what a task reads by an edge. How many values that are follows from the facts of the node, or is written before them.
fn put_reads(
    message: &mut Vec<u8>,
    graph: &Graph,
    edge: &Edge,
    task: usize,
    mut put: impl FnMut(&mut Vec<u8>, usize) -> Option<()>,
) -> Option<()> {
    match &edge.reads {
        Reads::Same => put(message, task),
        Reads::Held => put(message, 0),
        Reads::All if graph.is_single(edge.port) => put(message, 0),
        Reads::All => (0..graph.nodes[edge.port.node].clock.len()).try_for_each(|index| put(message, index)),
        Reads::Lists(lists) => {
            let list = lists.forward.get(task).map_or(&[][..], Vec::as_slice);
            message.extend((list.len() as u64).to_le_bytes());
            let first = graph.nodes[edge.port.node].clock.first;
            list.iter().try_for_each(|&index| {
                message.extend((first + i64::from(index)).to_le_bytes());
                put(message, index as usize)
            })
        }
    }
}

/// The tasks of a node that are wanted, such that a state comes before the task that starts from it.
fn chain_order(plan: &Plan, node: usize) -> Vec<usize> {
    let node_plan = &plan.nodes[node];
    let wanted = (0..node_plan.wanted.len()).filter(|&k| node_plan.wanted[k]);
    let previous = node_plan.edges.last().filter(|e| e.port.node == node).map(|e| &e.reads);
    let Some(Reads::Lists(previous)) = previous else { return wanted.collect() };
    let mut is_placed = vec![false; node_plan.wanted.len()];
    let (mut order, mut chain) = (Vec::new(), Vec::new());
    for task in wanted {
        let mut at = Some(task);
        while let Some(task) = at.filter(|&k| !is_placed[k]) {
            is_placed[task] = true;
            chain.push(task);
            at = previous.forward[task].first().map(|&k| k as usize);
        }
        order.extend(chain.drain(..).rev());
    }
    order
}

/// True for a node that reads files with frame numbers.
pub(crate) fn reads_numbered(spec: &GraphNode) -> bool {
    read_paths(spec).any(|p| p.is_sequence())
}

/// The files that a task reads, as its settings say, in the order of its inputs; only those with frame numbers for `numbered`.
pub(crate) fn paths(spec: &GraphNode, task: usize, numbered: bool) -> Vec<Result<PathBuf, NodeError>> {
    let policy = missing(spec);
    let pick = |path: &InputPath, frame: i64| {
        let nothing = || NodeError::input(format!("expected a file for frame {frame} of {}, found none", path.pattern()));
        path.resolve(frame, policy).ok_or_else(nothing)
    };
    let mut out = Vec::new();
    for path in read_paths(spec).filter(|p| p.is_sequence() || !numbered) {
        if path.is_sequence() && spec.runs_once() {
            // A node that runs once may look at any of them.
            out.extend(spec.clock.frames().map(|frame| pick(&path, frame)));
        } else {
            out.push(pick(&path, spec.clock.first + task as i64));
        }
    }
    if !numbered {
        out.extend(beside_all(spec).into_iter().map(Ok));
    }
    out
}

/// The files that a task reads, as its settings and its policy for missing frames say. A file that is to be read and is not there is left out.
pub fn files_of(graph: &Graph, node: usize, task: usize) -> Vec<PathBuf> {
    paths(&graph.nodes[node], task, false).into_iter().flatten().collect()
}

/// Every file that the tasks of a plan read, each once, in order.
pub fn files_of_plan(graph: &Graph, plan: &Plan) -> Vec<PathBuf> {
    let tasks = plan.nodes.iter().enumerate().flat_map(|(n, p)| (0..p.wanted.len()).filter(|&k| p.wanted[k]).map(move |k| (n, k)));
    let reads = |n: &usize| read_paths(&graph.nodes[*n]).next().is_some();
    let mut files: Vec<PathBuf> = tasks.filter(|(n, _)| reads(n)).flat_map(|(n, k)| files_of(graph, n, k)).collect();
    files.sort_unstable();
    files.dedup();
    files
}
