//! The cache in a run: what need not run at all, what is worth keeping, and where the wave of a change stops.
//!
//! Before a run the plan is walked from its targets upwards. What the cache has is taken from there, and what led to it is not looked at; a sink whose
//! files stand as it left them is done. While it runs, a task whose inputs turn out to have the contents that they had in an earlier run takes that
//! run's results, whatever led to them.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::layout::Layout;
use super::lock;
use super::memory::{Known, Memory};
use super::run::Task;
use super::sizes::Sizes;
use crate::cache::{Cache, Digest, Key};
use crate::graph::{Graph, GraphNode, Port};
use crate::key::{Keys, files_of};
use crate::node::{Computed, Kind, NodeError, OutValue};
use crate::plan::{Plan, consumers_first};
use crate::setting::FileUse;
use crate::stamp::{Files, Stamp};
use crate::sync::{AtomicUsize, Mutex, Ordering};
use crate::value::{ValueRef, digest};

/// Which results are kept in the cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// Those that cost more to make, with all that leads to them and is not kept, than to keep.
    #[default]
    Auto,
    /// All.
    Always,
    /// None.
    Never,
}

/// The cache that a run uses.
#[derive(Clone)]
pub struct CacheUse<'a> {
    /// The cache.
    pub cache: Arc<Cache>,
    /// Contents of the files that are read.
    pub files: &'a Files<'a>,
    /// For each node; the last goes for all that follow.
    pub policies: &'a [Policy],
}

impl CacheUse<'_> {
    fn policy(&self, node: usize) -> Policy {
        self.policies.get(node).or(self.policies.last()).copied().unwrap_or_default()
    }
}

/// Seconds that it takes to keep so many bytes and to have them again, by measurement on a modest disk.
fn keeping(bytes: u64) -> f64 {
    60e-6 + bytes as f64 / 0.4e9
}

/// Bytes a second that a digest takes, with room to spare.
const DIGEST_RATE: f64 = 0.5e9;

pub(super) struct Cached<'a> {
    with: &'a CacheUse<'a>,
    graph: &'a Graph,
    plan: &'a Plan,
    layout: &'a Layout,
    keys: &'a Keys,
    presets: Vec<(usize, Known, u64)>,
    /// For each node, whether it reads files, and whether it writes some.
    with_files: Vec<(bool, bool)>,
    /// Content keys of the tasks that run, and how many they are.
    contents: Mutex<HashMap<(u32, u32), Key>>,
    n_contents: AtomicUsize,
}

/// Where the results of a task lie in the cache, in the order of its ports and frames.
pub(super) type Kept = std::vec::IntoIter<Option<Known>>;

/// What need not run.
pub(super) struct Pruned {
    presets: Vec<(usize, Known, u64)>,
    /// Tasks of each node that are taken from the cache or are done.
    pub(super) skipped: Vec<u64>,
}

impl Pruned {
    /// Bytes that are to be read from the cache.
    pub(super) fn bytes(&self) -> u64 {
        self.presets.iter().map(|(_, _, bytes)| bytes).sum()
    }
}

/// Takes out of a plan what the cache has: what it says it has, or, where it `is_doubted`, what can be read from it.
pub(super) fn prune(graph: &Graph, plan: &mut Plan, layout: &Layout, keys: &Keys, with: &CacheUse, is_doubted: bool) -> Pruned {
    let mut pruner = Pruner {
        graph,
        is_doubted,
        layout,
        keys,
        with,
        needed: vec![false; layout.n_slots()],
        found: HashMap::new(),
        runs: plan.nodes.iter().map(|n| vec![false; n.wanted.len()]).collect(),
    };
    for port in plan.keep.iter().filter(|p| !plan.known.contains_key(p)) {
        pruner.needed[layout.port(*port)].fill(true);
    }
    let mut is_target = vec![false; layout.n_tasks()];
    for &(node, task) in &plan.targets {
        let is_kept = plan.keep.iter().any(|p| p.node == node as usize);
        is_target[layout.task(node as usize, task as usize)] = !is_kept && !pruner.is_done(node as usize, task as usize);
    }
    let mut skipped = vec![0; graph.nodes.len()];
    for node in consumers_first(graph) {
        let wanted: Vec<usize> = (0..plan.nodes[node].wanted.len()).filter(|&k| plan.nodes[node].wanted[k]).collect();
        for &task in &wanted {
            if is_target[layout.task(node, task)] {
                pruner.run(plan, node, task);
            } else {
                pruner.judge(plan, node, task);
            }
        }
        let taken = wanted.iter().filter(|&&k| !pruner.runs[node][k]).count();
        skipped[node] = taken as u64;
    }
    let Pruner { runs, found, needed, .. } = pruner;
    for (planned, runs) in plan.nodes.iter_mut().zip(runs) {
        planned.wanted = runs;
    }
    plan.targets.retain(|&(node, task)| plan.nodes[node as usize].wanted[task as usize]);
    let mut presets: Vec<_> =
        found.into_iter().filter(|(slot, _)| needed[*slot]).map(|(slot, (known, bytes))| (slot, known, bytes)).collect();
    presets.sort_unstable_by_key(|(slot, _, _)| *slot);
    Pruned { presets, skipped }
}

struct Pruner<'a> {
    graph: &'a Graph,
    is_doubted: bool,
    layout: &'a Layout,
    keys: &'a Keys,
    with: &'a CacheUse<'a>,
    /// Values that somebody who runs reads.
    needed: Vec<bool>,
    found: HashMap<usize, (Known, u64)>,
    runs: Vec<Vec<bool>>,
}

impl Pruner<'_> {
    /// True for a sink whose files stand as it left them.
    fn is_done(&self, node: usize, task: usize) -> bool {
        let files = written(self.graph, node, task);
        !files.is_empty() && stands(self.with, &self.keys.value(node, 0, task), &files)
    }

    /// Runs a task, and needs what it reads.
    fn run(&mut self, plan: &Plan, node: usize, task: usize) {
        let mut open = vec![task];
        while let Some(task) = open.pop() {
            if std::mem::replace(&mut self.runs[node][task], true) {
                continue;
            }
            for edge in &plan.nodes[node].edges {
                for slot in self.layout.reads(edge, task) {
                    self.needed[slot] = true;
                }
                // A state hangs on tasks of the node itself, which have been judged already, or will be.
                if edge.port.node == node {
                    let base = self.layout.port(edge.port).start;
                    open.extend(self.layout.reads(edge, task).map(|slot| slot - base).filter(|&k| !self.has(node, k)));
                }
            }
        }
    }

    /// Runs a task whose values are needed and not to be had.
    fn judge(&mut self, plan: &Plan, node: usize, task: usize) {
        if !self.runs[node][task] && !self.has(node, task) {
            self.run(plan, node, task);
        }
    }

    /// True where every value of a task that is needed is in the cache.
    fn has(&mut self, node: usize, task: usize) -> bool {
        for output in 0..self.layout.ports(node) {
            let base = self.layout.port(Port { node, output }).start;
            for slot in self.layout.made(self.graph, node, output, task).filter(|slot| self.needed[*slot]) {
                if self.found.contains_key(&slot) {
                    continue;
                }
                let key = self.keys.value(node, output, slot - base);
                let Some(entry) = self.with.cache.find(&key) else { return false };
                let state = self.graph.nodes[node].ty.operator.state_type();
                if self.is_doubted && self.with.cache.load(&key, state.as_ref(), &self.graph.types).is_none() {
                    return false;
                }
                self.found.insert(slot, (Known { digest: entry.digest, key: Some(key) }, entry.bytes));
            }
        }
        true
    }
}

/// The files that a task of a sink leaves behind.
pub(crate) fn written(graph: &Graph, node: usize, task: usize) -> Vec<PathBuf> {
    let spec = &graph.nodes[node];
    let mut files = Vec::new();
    for path in spec.written_paths() {
        match (path.is_sequence(), spec.ty.schema.kind == Kind::Whole) {
            (false, _) => files.push(path.at(0)),
            // A node that runs once over a stream writes a file for each of its frames.
            (true, true) => files.extend(spec.clock.frames().map(|f| path.at(f))),
            (true, false) => files.push(path.at(spec.clock.first + task as i64)),
        }
    }
    files
}

/// Where the files of a sink are noted, which say nothing of other output folders.
fn place(key: &Key, files: &[PathBuf]) -> Key {
    let mut hasher = blake3::Hasher::new_keyed(key);
    for file in files {
        let path = std::path::absolute(file).unwrap_or_else(|_| file.clone());
        hasher.update(path.as_os_str().as_encoded_bytes());
        hasher.update(&[0]);
    }
    *hasher.finalize().as_bytes()
}

/// True where the files have the contents that were noted.
fn stands(with: &CacheUse, key: &Key, files: &[PathBuf]) -> bool {
    let Some(noted) = with.cache.recall(&place(key, files)) else { return false };
    let digests = noted.as_chunks::<32>().0;
    digests.len() == files.len()
        && files.iter().zip(digests).all(|(file, digest)| file.is_file() && with.files.content(file).is_ok_and(|d| d == *digest))
}

impl<'a> Cached<'a> {
    pub(super) fn new(
        with: &'a CacheUse<'a>,
        graph: &'a Graph,
        plan: &'a Plan,
        layout: &'a Layout,
        keys: &'a Keys,
        pruned: Pruned,
    ) -> Self {
        let uses = |node: &GraphNode| {
            let uses = |use_: FileUse| node.ty.schema.inputs.iter().any(|input| input.files == use_);
            (uses(FileUse::Read), uses(FileUse::Write))
        };
        let with_files = graph.nodes.iter().map(uses).collect();
        let (contents, n_contents) = (Mutex::default(), AtomicUsize::new(0));
        Self { with, graph, plan, layout, keys, presets: pruned.presets, with_files, contents, n_contents }
    }

    pub(super) fn cache(&self) -> &Arc<Cache> {
        &self.with.cache
    }

    /// Values that are there from the start: slot, key and bytes.
    pub(super) fn presets(&self) -> &[(usize, Known, u64)] {
        &self.presets
    }

    /// Takes the results of a task from the cache where its inputs have the contents that they had when those were made; true where that could be
    /// done. Asked only for what costs more than to find out.
    pub(super) fn cut(&self, task: Task, memory: &Memory, sizes: &Sizes) -> bool {
        let (node, index) = (task.node as usize, task.index as usize);
        let always = match self.with.policy(node) {
            Policy::Never => return false,
            Policy::Always => true,
            Policy::Auto => false,
        };
        let seconds = sizes.known(node).map_or(0.0, |e| e.seconds);
        if !always && seconds < 100e-6 {
            return false;
        }
        // Digests may take a fourth of what they might save.
        let mut most = if always { u64::MAX } else { (seconds / 4.0 * DIGEST_RATE) as u64 };
        let edges = &self.plan.nodes[node].edges;
        let of = |edge: usize, at: usize| memory.digest(self.layout.port(edges[edge].port).start + at, &mut most);
        let Some(content) = self.keys.content(self.graph, self.plan, node, index, of) else { return false };
        let found = self.take(task, &content, memory);
        if !found {
            self.n_contents.fetch_add(1, Ordering::Relaxed);
            lock(&self.contents).insert((task.node, task.index), content);
        }
        found
    }

    fn take(&self, task: Task, content: &Key, memory: &Memory) -> bool {
        let (node, index) = (task.node as usize, task.index as usize);
        let files = self.written(node, index);
        if !files.is_empty() {
            if !stands(self.with, content, &files) {
                return false;
            }
            self.note_files(&self.keys.value(node, 0, index), &files);
            return true;
        }
        let mut found = Vec::new();
        for output in 0..self.layout.ports(node) {
            let base = self.layout.port(Port { node, output }).start;
            for slot in self.layout.made(self.graph, node, output, index).filter(|slot| memory.is_read(*slot)) {
                let at = slot - base;
                let Some(entry) = self.cache().find(&self.keys.value_of(content, node, output, at)) else { return false };
                found.push((slot, self.keys.value(node, output, at), entry));
            }
        }
        // A task that nobody reads is run for what it does.
        if found.is_empty() {
            return false;
        }
        for (slot, key, entry) in found {
            self.cache().link(&key, &entry.digest);
            memory.preset(slot, Known { digest: entry.digest, key: Some(key) }, entry.bytes);
        }
        true
    }

    /// To be asked before a node runs: the files that it will read, as they are.
    pub(super) fn files(&self, task: Task) -> Vec<(PathBuf, Option<Stamp>)> {
        if !self.with_files[task.node as usize].0 {
            return Vec::new();
        }
        let files = files_of(self.graph, task.node as usize, task.index as usize).into_iter();
        files.map(|file| (self.with.files.stamp(&file), file)).map(|(stamp, file)| (file, stamp)).collect()
    }

    /// To be asked after a node has run: were the files that it read those whose contents are in its key?
    ///
    /// # Errors
    /// Where one of them was not.
    pub(super) fn is_as_read(&self, files: &[(PathBuf, Option<Stamp>)]) -> Result<(), NodeError> {
        files.iter().try_for_each(|(file, stamp)| self.with.files.unchanged(file, *stamp))
    }

    /// Keeps the results of a task where that is worth it, and what files it wrote. `cost` is in seconds.
    pub(super) fn keep(&self, task: Task, computed: &Computed, cost: f32) -> Kept {
        let (node, index) = (task.node as usize, task.index as usize);
        let content = self.content_of(task);
        let files = self.written(node, index);
        if !files.is_empty() {
            self.note_files(&self.keys.value(node, 0, index), &files);
            content.iter().for_each(|key| self.note_files(key, &files));
            return Kept::default();
        }
        let bytes = values(computed).map(|(_, _, v)| v.size() as u64).sum();
        let is_worth_it = match self.with.policy(node) {
            Policy::Always => true,
            Policy::Never => false,
            Policy::Auto => f64::from(cost) > 2.0 * keeping(bytes),
        };
        if !is_worth_it {
            return Kept::default();
        }
        let keep = |(output, at, value): (usize, usize, &ValueRef)| {
            // One task of a node that runs once makes the values of all frames.
            let at = if self.graph.nodes[node].runs_once() { at } else { index };
            let key = self.keys.value(node, output, at);
            let digest: Digest = *digest(value.as_ref()).as_bytes();
            self.cache().store(&key, &digest, value.as_ref());
            if let Some(content) = &content {
                self.cache().link(&self.keys.value_of(content, node, output, at), &digest);
            }
            let is_there = self.cache().find(&key).is_some();
            Some(Known { digest, key: is_there.then_some(key) })
        };
        values(computed).map(keep).collect::<Vec<_>>().into_iter()
    }

    fn written(&self, node: usize, index: usize) -> Vec<PathBuf> {
        if self.with_files[node].1 { written(self.graph, node, index) } else { Vec::new() }
    }

    /// The content key of a task, if it was found before it ran.
    fn content_of(&self, task: Task) -> Option<Key> {
        if self.n_contents.load(Ordering::Relaxed) == 0 {
            return None;
        }
        let content = lock(&self.contents).remove(&(task.node, task.index))?;
        self.n_contents.fetch_sub(1, Ordering::Relaxed);
        Some(content)
    }

    fn note_files(&self, key: &Key, files: &[PathBuf]) {
        let digests: Result<Vec<Digest>, NodeError> = files.iter().map(|file| self.with.files.content(file)).collect();
        if let Ok(digests) = digests {
            self.cache().note(&place(key, files), digests.as_flattened());
        }
    }
}

/// The values of a task: port, position, value; its state after the last port.
fn values(computed: &Computed) -> impl Iterator<Item = (usize, usize, &ValueRef)> {
    let outputs = computed.outputs.iter().enumerate().flat_map(|(output, out)| {
        let values = match out {
            OutValue::One(value) => std::slice::from_ref(value),
            OutValue::Stream(values) => values.as_slice(),
        };
        values.iter().enumerate().map(move |(at, value)| (output, at, value))
    });
    outputs.chain(computed.state.iter().map(|state| (computed.outputs.len(), 0, state)))
}
