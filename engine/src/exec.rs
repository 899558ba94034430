//! The executor: runs a plan on a few threads, many frames in flight, each result kept just as long as somebody will read it.
//!
//! A task is one frame of one node, or the one run of a node that runs once. Each task counts what it still waits for: its reads, and its
//! admission. Targets are admitted in the order of frames while fewer than a bound are in flight, and with a target all that it reads; whoever
//! brings a task's count to nought puts it on its own stack, so that what was begun last is finished first and memory stays small. Idle threads
//! take what was admitted first, then steal. Nothing here knows what a node does.

mod cached;
mod crew;
mod footprint;
mod gate;
mod layout;
mod memory;
mod run;
mod sizes;
mod spill;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::cache::Cache;
use crate::graph::{Graph, Port};
use crate::key::{Keys, files_of_plan};
use crate::node::{Arg, Cancel, Fault, Meter, NodeError};
use crate::plan::{Known, Plan, PlanError, Planned, Target, plan};
use crate::sync::{Mutex, MutexGuard, PoisonError};
use crate::value::ValueRef;

pub(crate) use run::panicked;

pub use cached::{CacheUse, Policy};
pub use footprint::Footprint;
pub use sizes::Expected;

use cached::{Cached, prune};
use layout::Layout;
use sizes::Sizes;

/// How to run.
pub struct Options<'a> {
    /// Threads, at least one.
    pub threads: usize,
    /// Targets in flight at most; 0 for a bound by the number of threads.
    pub in_flight: usize,
    /// The most bytes that results and the scratch of running nodes may have together; `None` for as many as there may be.
    pub memory: Option<u64>,
    /// What has to be asked for so that a run has so many bytes: errors name it.
    pub asked: fn(u64) -> u64,
    /// The folder for what does not fit.
    pub spill: PathBuf,
    /// The cache, and what of it is used.
    pub cache: Option<CacheUse<'a>>,
    /// What a task of each node is known to cost.
    pub expected: &'a [Option<Expected>],
    /// Runs a task and gives the most bytes that the thread had allocated meanwhile beyond what it had before; `None` where nobody counts them.
    pub measure: Option<Measure>,
    /// Ends the run.
    pub cancel: Cancel,
    /// Is told what happens.
    pub observer: &'a dyn Observer,
}

/// Runs what it is given, and tells the most bytes allocated meanwhile.
pub type Measure = fn(&mut dyn FnMut()) -> u64;

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            threads: 1,
            in_flight: 0,
            memory: None,
            asked: |bytes| bytes,
            spill: std::env::temp_dir(),
            cache: None,
            expected: &[],
            measure: None,
            cancel: Cancel::default(),
            observer: &Silent,
        }
    }
}

/// Is told what happens, on the thread where it happens.
pub trait Observer: Sync {
    /// A plan was made; what the cache has is still to be taken out of it.
    fn wanted(&self, _graph: &Graph, _plan: &Plan) {}
    /// A plan is about to run.
    fn planned(&self, _graph: &Graph, _plan: &Plan) {}
    /// A value came of a task. `frame` is that of the value, `None` for one that does not change over time. Whoever keeps it costs its readers the
    /// sole hold, and the run memory that it does not count.
    fn made(&self, _graph: &Graph, _port: Port, _frame: Option<i64>, _value: &ValueRef) {}
    /// A plan has run that the cache served: what came from there can be read back.
    fn ended(&self, _results: &Results) {}
    /// A task starts on one of the threads, which are numbered from 0.
    fn started(&self, _node: usize, _frame: Option<i64>, _thread: usize) {}
    /// Where tasks of a thread say how much of them is done, for one who shows it.
    fn meter(&self, _thread: usize) -> Option<Arc<Meter>> {
        None
    }
    /// A task is done, or has failed.
    fn done(&self, _done: &Done) {}
    /// A node failed.
    fn failed(&self, _graph: &Graph, _failure: &Failure) {}
    /// True for one who wants [`Failure::given`]. It costs nodes the sole hold of their inputs, and so copies.
    fn keeps_inputs(&self) -> bool {
        false
    }
}

/// What the cache has of a plan that ran.
pub struct Results<'a> {
    /// The graph.
    pub graph: &'a Graph,
    keys: &'a Keys,
    cache: &'a Cache,
}

impl Results<'_> {
    /// The value of a port at a frame, which is of no account where it does not change over time; `None` where the cache does not have it, or it has
    /// more than `most` bytes.
    pub fn get(&self, port: Port, frame: i64, most: u64) -> Option<ValueRef> {
        let node = self.graph.nodes.get(port.node)?;
        let index = if self.graph.is_single(port) { 0 } else { node.clock.index(frame)? };
        self.keys.task(port.node, if node.runs_once() { 0 } else { index })?;
        let key = self.keys.value(port.node, port.output, index);
        self.cache.find(&key).filter(|entry| entry.bytes <= most)?;
        self.cache.load(&key, None, &self.graph.types)
    }
}

/// A task that is done.
#[derive(Clone, Copy, Debug)]
pub struct Done {
    /// Index of the node.
    pub node: usize,
    /// Frame; `None` for a node that runs once.
    pub frame: Option<i64>,
    /// The thread that it ran on.
    pub thread: usize,
    /// When it started.
    pub start: Instant,
    /// How long it took.
    pub time: Duration,
    /// Bytes of its results.
    pub bytes: u64,
    /// Bytes of results of all nodes that are alive.
    pub live_bytes: u64,
}

/// What a task was given.
#[derive(Clone, Debug)]
pub struct Given {
    /// What stands at each input, in the order of the schema.
    pub args: Vec<Arg>,
    /// The state that it starts from.
    pub state: Option<ValueRef>,
}

/// Hears and says nothing.
pub struct Silent;

impl Observer for Silent {}

/// A task that failed.
#[derive(Clone, Debug)]
pub struct Failure {
    /// Index of the node.
    pub node: usize,
    /// Frame; `None` for a node that runs once.
    pub frame: Option<i64>,
    /// Why.
    pub error: NodeError,
    /// Each wired input: name, type, and extents of its first array.
    pub inputs: Vec<String>,
    /// What it was given, where an observer [keeps that](Observer::keeps_inputs). Dropped once it was told.
    pub given: Option<Given>,
}

/// What a node cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct NodeStats {
    /// Tasks that were run.
    pub tasks: u64,
    /// Tasks that were not, as the cache has what they make.
    pub skipped: u64,
    /// Time in those that were run, on all threads.
    pub time: Duration,
    /// Bytes of all results.
    pub bytes: u64,
    /// Most bytes of the results of one task.
    pub most_bytes: u64,
    /// Most bytes that a task needed besides.
    pub scratch_bytes: u64,
    /// Most bytes of its results alive at once.
    pub peak_bytes: u64,
}

/// What came of a run.
#[derive(Debug, Default)]
pub struct Report {
    /// Tasks that failed, by node and frame.
    pub failures: Vec<Failure>,
    /// True where the run was ended from outside.
    pub cancelled: bool,
    /// Targets that were not reached for the failures of others.
    pub unreached: usize,
    /// What each node cost.
    pub stats: Vec<NodeStats>,
    /// Values of the ports that were asked for: one a frame, or one; `None` where it was not made.
    pub kept: BTreeMap<Port, Vec<Option<ValueRef>>>,
    /// Most bytes of results alive at once.
    pub peak_bytes: u64,
    /// Most bytes that were counted against the budget at once: results, and what was set aside for running nodes.
    pub counted_bytes: u64,
    /// Values that went to disk for want of memory, and their bytes.
    pub spilled: (u64, u64),
    /// Who waits for whom, where nothing could move any more.
    pub stuck: Option<String>,
    /// The plan of the last stage, as it was before the cache was looked into.
    pub plan: Option<Plan>,
    /// True where a value that the cache should have had was gone, so that what hangs on it is still to be made.
    pub(crate) lost: bool,
}

impl Report {
    /// True where everything that was asked for is there.
    pub fn is_complete(&self) -> bool {
        self.failures.is_empty() && !self.cancelled && self.unreached == 0 && self.stuck.is_none()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic in a node never happens under a lock of the executor, so what the lock guards is whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Plans and runs, in as many stages as there are demands that hang on computed values.
///
/// # Errors
/// Where a node asks for a frame that there is not. A failing node is not an error of the run but an entry of its report.
pub fn execute(graph: &Graph, targets: &[Target], keep: &[Port], options: &Options) -> Result<Report, PlanError> {
    let mut known = Known::new();
    let sizes = Sizes::new(graph, options.expected);
    loop {
        match plan(graph, targets, keep, known.clone())? {
            Planned::Ready(plan) => {
                let mut report = run_again(graph, plan, &sizes, options)?;
                for port in keep {
                    if let Some(value) = known.get(port) {
                        report.kept.insert(*port, vec![Some(value.clone())]);
                    }
                }
                return Ok(report);
            }
            Planned::First(ports) => {
                let mut report = stage(graph, &ports, &known, &sizes, options)?;
                if !report.is_complete() {
                    return Ok(report);
                }
                for port in ports {
                    let value = report.kept.remove(&port).and_then(|v| v.into_iter().next().flatten());
                    known.insert(port, value.ok_or_else(|| lost(port))?);
                }
            }
        }
    }
}

/// Makes the values that decide what is needed further on.
fn stage(graph: &Graph, ports: &[Port], known: &Known, sizes: &Sizes, options: &Options) -> Result<Report, PlanError> {
    match plan(graph, &[], ports, known.clone())? {
        Planned::Ready(plan) => run_again(graph, plan, sizes, options),
        // Each stage knows more than the one before, and a graph has no ring, so this ends.
        Planned::First(earlier) => {
            let mut report = stage(graph, &earlier, known, sizes, options)?;
            if !report.is_complete() {
                return Ok(report);
            }
            let mut more = known.clone();
            for port in earlier {
                let value = report.kept.remove(&port).and_then(|v| v.into_iter().next().flatten());
                more.insert(port, value.ok_or_else(|| lost(port))?);
            }
            stage(graph, ports, &more, sizes, options)
        }
    }
}

fn lost(port: Port) -> PlanError {
    PlanError { node: port.node, frame: None, error: NodeError::internal("a value that was computed is not there") }
}

/// How often a run is taken up again after values that the cache should have had were gone, before it goes on without them.
const TRIES: usize = 4;

/// Runs a plan, and what hangs on values that turned out to be gone again.
fn run_again(graph: &Graph, plan: Plan, sizes: &Sizes, options: &Options) -> Result<Report, PlanError> {
    let mut tries = 0;
    loop {
        tries += 1;
        let report = run_once(graph, plan.clone(), sizes, options, tries)?;
        if !report.lost || tries == TRIES {
            return Ok(Report { plan: Some(plan), ..report });
        }
    }
}

fn run_once(graph: &Graph, mut plan: Plan, sizes: &Sizes, options: &Options, tries: usize) -> Result<Report, PlanError> {
    let layout = Layout::new(graph, &plan);
    options.observer.wanted(graph, &plan);
    let with = options.cache.as_ref().filter(|_| tries < TRIES);
    let Some(with) = with else {
        fits(graph, &plan, &layout, sizes, options)?;
        options.observer.planned(graph, &plan);
        return Ok(run::run(graph, &plan, &layout, sizes, None, options));
    };
    // A file that cannot be read is told by the keys, with the node that reads it.
    let _ = with.files.prefetch(&files_of_plan(graph, &plan), options.threads);
    let keys = Keys::of(graph, &plan, with.files)?;
    let pruned = prune(graph, &mut plan, &layout, &keys, with, tries > 1);
    let skipped = pruned.skipped.clone();
    fits(graph, &plan, &layout, sizes, options)?;
    options.observer.planned(graph, &plan);
    let cached = Cached::new(with, graph, &plan, &layout, &keys, pruned);
    let mut report = run::run(graph, &plan, &layout, sizes, Some(&cached), options);
    report.stats.iter_mut().zip(skipped).for_each(|(stats, skipped)| stats.skipped += skipped);
    options.observer.ended(&Results { graph, keys: &keys, cache: &with.cache });
    Ok(report)
}

/// What a run would do.
#[derive(Debug, Default)]
pub struct Preview {
    /// For each node, tasks that would run.
    pub runs: Vec<u64>,
    /// For each node, tasks that would not, as the cache has what they make, or nobody needs it any more.
    pub skipped: Vec<u64>,
    /// What each node is known to cost.
    pub sizes: Vec<Option<Expected>>,
    /// Bytes that would be read from the cache.
    pub cached_bytes: u64,
    /// What it needs of memory, as far as the sizes are known.
    pub footprint: Footprint,
    /// Nodes that would run and have never been measured.
    pub unknown: Vec<usize>,
    /// Values that have to be made before the rest can be planned; what stands here is then the plan of those.
    pub first: Vec<Port>,
}

/// Finds what a run would do, and runs nothing.
///
/// # Errors
/// As of [`execute`].
pub fn preview(graph: &Graph, targets: &[Target], options: &Options) -> Result<Preview, PlanError> {
    let mut first = Vec::new();
    let mut planned = plan(graph, targets, &[], Known::new())?;
    let mut plan = loop {
        match planned {
            Planned::Ready(plan) => break plan,
            Planned::First(ports) => {
                planned = self::plan(graph, &[], &ports, Known::new())?;
                first = ports;
            }
        }
    };
    let layout = Layout::new(graph, &plan);
    let mut preview = Preview { skipped: vec![0; graph.nodes.len()], first, ..Preview::default() };
    if let Some(with) = &options.cache {
        let _ = with.files.prefetch(&files_of_plan(graph, &plan), options.threads);
        let keys = Keys::of(graph, &plan, with.files)?;
        let pruned = prune(graph, &mut plan, &layout, &keys, with, false);
        preview.cached_bytes = pruned.bytes();
        preview.skipped = pruned.skipped;
    }
    preview.runs = (0..graph.nodes.len()).map(|node| plan.tasks_of(node) as u64).collect();
    let sizes = Sizes::new(graph, options.expected);
    preview.sizes = (0..graph.nodes.len()).map(|node| sizes.known(node)).collect();
    preview.unknown = (0..graph.nodes.len()).filter(|&n| preview.runs[n] > 0 && preview.sizes[n].is_none()).collect();
    let known: Vec<Expected> = preview.sizes.iter().map(|size| size.unwrap_or_default()).collect();
    preview.footprint = footprint::footprint(graph, &plan, &layout, &known, usize::MAX);
    Ok(preview)
}

/// Refuses a plan that the budget is too small for, as far as the sizes are known; bounds the targets in flight by it.
fn fits(graph: &Graph, plan: &Plan, layout: &Layout, sizes: &Sizes, options: &Options) -> Result<(), PlanError> {
    let Some(limit) = options.memory else { return Ok(()) };
    sizes.set_paths(usize::MAX);
    let Some(found) = bound_paths(graph, plan, layout, sizes, limit, usize::MAX) else { return Ok(()) };
    match found.least_at {
        Some((node, frame)) if found.least > limit => {
            let message = format!("expected to run in {limit} bytes of memory, found a need of {} bytes at least", found.least);
            let help = format!("allow at least {} with --memory, or make its frames smaller", (options.asked)(found.least));
            Err(PlanError { node, frame: Some(frame), error: NodeError::new(Fault::Limit, message).help(help) })
        }
        _ => Ok(()),
    }
}

/// Finds how many targets fit into the budget together, by the first `targets` of them; `None` where a node of the plan has never run.
fn bound_paths(graph: &Graph, plan: &Plan, layout: &Layout, sizes: &Sizes, limit: u64, targets: usize) -> Option<Footprint> {
    let size = |node: usize| if plan.nodes[node].wanted.contains(&true) { sizes.known(node) } else { Some(Expected::default()) };
    let known: Vec<Expected> = (0..graph.nodes.len()).map(size).collect::<Option<_>>()?;
    let found = footprint::footprint(graph, plan, layout, &known, targets);
    let more =
        limit.saturating_sub(found.peak).checked_div(found.path).map_or(usize::MAX - 1, |n| usize::try_from(n).unwrap_or(usize::MAX - 1));
    sizes.set_paths(more.saturating_add(1));
    Some(found)
}

/// Runs a plan as it is, however broken.
#[cfg(test)]
pub(crate) fn run_plan(graph: &Graph, plan: &Plan, threads: usize) -> Report {
    let layout = Layout::new(graph, plan);
    run::run(graph, plan, &layout, &Sizes::new(graph, &[]), None, &Options { threads, ..Options::default() })
}
