//! The executor: runs a plan on a few threads, many frames in flight, each result kept just as long as somebody will read it.
//!
//! A task is one frame of one node, or the one run of a node that runs once. Each task counts what it still waits for: its reads, and its
//! admission. Targets are admitted in the order of frames while fewer than a bound are in flight, and with a target all that it reads; whoever
//! brings a task's count to nought puts it on its own stack, so that what was begun last is finished first and memory stays small. Idle threads
//! take what was admitted first, then steal. Nothing here knows what a node does.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Ordering, fence};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::deque::{Injector, Steal, Stealer, Worker};

use crate::array::describe_shape;
use crate::graph::{Binding, Graph, Port};
use crate::node::{Arg, Cancel, Computed, Context, NodeError, OutValue, SequenceRef};
use crate::plan::{Known, Plan, PlanError, Planned, Reads, Target, plan};
use crate::value::{AnyValue, ValueRef};

/// How to run.
pub struct Options<'a> {
    /// Threads, at least one.
    pub threads: usize,
    /// Targets in flight at most; 0 for a bound by the number of threads.
    pub in_flight: usize,
    /// Ends the run.
    pub cancel: Cancel,
    /// Is told what happens.
    pub observer: &'a dyn Observer,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { threads: 1, in_flight: 0, cancel: Cancel::default(), observer: &Silent }
    }
}

/// Is told what happens, on the thread where it happens.
pub trait Observer: Sync {
    /// A plan was made, and is about to run.
    fn planned(&self, _graph: &Graph, _plan: &Plan) {}
    /// A task starts on one of the threads, which are numbered from 0.
    fn started(&self, _node: usize, _frame: Option<i64>, _thread: usize) {}
    /// A task is done, or has failed.
    fn done(&self, _done: &Done) {}
    /// A node failed.
    fn failed(&self, _graph: &Graph, _failure: &Failure) {}
    /// True for one who wants [`Failure::given`]. It costs nodes the sole hold of their inputs, and so copies.
    fn keeps_inputs(&self) -> bool {
        false
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
    /// Tasks done.
    pub tasks: u64,
    /// Time in them, on all threads.
    pub time: Duration,
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
}

impl Report {
    /// True where everything that was asked for is there.
    pub fn is_complete(&self) -> bool {
        self.failures.is_empty() && !self.cancelled && self.unreached == 0
    }
}

/// Plans and runs, in as many stages as there are demands that hang on computed values.
///
/// # Errors
/// Where a node asks for a frame that there is not. A failing node is not an error of the run but an entry of its report.
pub fn execute(graph: &Graph, targets: &[Target], keep: &[Port], options: &Options) -> Result<Report, PlanError> {
    let mut known = Known::new();
    loop {
        match plan(graph, targets, keep, known.clone())? {
            Planned::Ready(plan) => {
                let mut report = run(graph, &plan, options);
                for port in keep {
                    if let Some(value) = known.get(port) {
                        report.kept.insert(*port, vec![Some(value.clone())]);
                    }
                }
                return Ok(report);
            }
            Planned::First(ports) => {
                let mut report = stage(graph, &ports, &known, options)?;
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
fn stage(graph: &Graph, ports: &[Port], known: &Known, options: &Options) -> Result<Report, PlanError> {
    match plan(graph, &[], ports, known.clone())? {
        Planned::Ready(plan) => Ok(run(graph, &plan, options)),
        // Each stage knows more than the one before, and a graph has no ring, so this ends.
        Planned::First(earlier) => {
            let mut report = stage(graph, &earlier, known, options)?;
            if !report.is_complete() {
                return Ok(report);
            }
            let mut more = known.clone();
            for port in earlier {
                let value = report.kept.remove(&port).and_then(|v| v.into_iter().next().flatten());
                more.insert(port, value.ok_or_else(|| lost(port))?);
            }
            stage(graph, ports, &more, options)
        }
    }
}

fn lost(port: Port) -> PlanError {
    PlanError { node: port.node, frame: None, error: NodeError::internal("a value that was computed is not there") }
}

/// Runs a plan to its end.
pub fn run(graph: &Graph, plan: &Plan, options: &Options) -> Report {
    options.observer.planned(graph, plan);
    let run = Run::new(graph, plan, options);
    let threads = options.threads.max(1);
    let workers: Vec<Worker<Task>> = (0..threads).map(|_| Worker::new_lifo()).collect();
    let stealers: Vec<Stealer<Task>> = workers.iter().map(Worker::stealer).collect();
    std::thread::scope(|scope| {
        let mut workers = workers.into_iter();
        let own = workers.next();
        for (thread, worker) in workers.enumerate() {
            let (run, stealers) = (&run, &stealers);
            scope.spawn(move || run.work(thread + 1, &worker, stealers));
        }
        if let Some(worker) = own {
            run.work(0, &worker, &stealers);
        }
    });
    run.report()
}

#[derive(Clone, Copy)]
struct Task {
    node: u32,
    /// Position in the node's clock; 0 for a node that runs once.
    index: u32,
}

/// One result, with the number of reads still to come.
#[derive(Default)]
struct Slot {
    readers: u32,
    value: Option<ValueRef>,
}

#[derive(Default)]
struct Meter {
    tasks: AtomicU64,
    nanos: AtomicU64,
    live: AtomicI64,
    peak: AtomicI64,
}

impl Meter {
    fn grow(&self, bytes: i64) {
        let now = self.live.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if now > self.peak.load(Ordering::Relaxed) {
            self.peak.fetch_max(now, Ordering::Relaxed);
        }
    }

    fn shrink(&self, bytes: i64) {
        self.live.fetch_sub(bytes, Ordering::Relaxed);
    }
}

const ADMITTED: u8 = 1;
const POISONED: u8 = 2;

struct Run<'a> {
    graph: &'a Graph,
    plan: &'a Plan,
    options: &'a Options<'a>,
    /// First task of each node in `pending` and `flags`.
    task_base: Vec<usize>,
    pending: Vec<AtomicU32>,
    flags: Vec<AtomicU8>,
    /// First slot of each port of each node, its state being the last port.
    slot_base: Vec<Vec<usize>>,
    slots: Vec<Mutex<Slot>>,
    is_target: Vec<bool>,
    meters: Vec<Meter>,
    total: Meter,
    roots: Injector<Task>,
    next_target: Mutex<usize>,
    /// Targets admitted less targets reached; below nought where one is reached as another's input before its turn.
    in_flight: AtomicI64,
    open_targets: AtomicUsize,
    unreached: AtomicUsize,
    failures: Mutex<Vec<Failure>>,
    /// Threads that wait, and the count of wake-ups that they wait on.
    sleepers: AtomicUsize,
    wakes: Mutex<u64>,
    wake: Condvar,
    stopped: AtomicBool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic in a node never happens under a lock of the executor, so what the lock guards is whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Extents of the inputs of the task that a thread is at, for the message if it fails.
type Brief = (usize, &'static str, crate::array::Shape);

impl<'a> Run<'a> {
    fn new(graph: &'a Graph, plan: &'a Plan, options: &'a Options<'a>) -> Self {
        let mut task_base = Vec::with_capacity(plan.nodes.len());
        let mut tasks = 0;
        let mut slot_base = Vec::with_capacity(plan.nodes.len());
        let mut slots = 0;
        for (node, planned) in graph.nodes.iter().zip(&plan.nodes) {
            task_base.push(tasks);
            tasks += planned.wanted.len();
            let needed = planned.wanted.contains(&true);
            let ports = (0..=node.ty.schema.outputs.len()).map(|p| {
                let base = slots;
                slots += match (needed, node.is_single(p)) {
                    (false, _) => 0,
                    (true, true) => 1,
                    (true, false) => node.clock.len(),
                };
                base
            });
            slot_base.push(ports.collect());
        }
        let run = Self {
            graph,
            plan,
            options,
            task_base,
            pending: (0..tasks).map(|_| AtomicU32::new(1)).collect(),
            flags: (0..tasks).map(|_| AtomicU8::new(0)).collect(),
            slot_base,
            slots: (0..slots).map(|_| Mutex::default()).collect(),
            is_target: vec![false; tasks],
            meters: graph.nodes.iter().map(|_| Meter::default()).collect(),
            total: Meter::default(),
            roots: Injector::new(),
            next_target: Mutex::new(0),
            in_flight: AtomicI64::new(0),
            open_targets: AtomicUsize::new(plan.targets.len()),
            unreached: AtomicUsize::new(0),
            failures: Mutex::default(),
            sleepers: AtomicUsize::new(0),
            wakes: Mutex::new(0),
            wake: Condvar::new(),
            stopped: AtomicBool::new(plan.targets.is_empty()),
        };
        run.count()
    }

    /// Counts what each task waits for, and how often each result will be read.
    fn count(mut self) -> Self {
        for (node, planned) in self.plan.nodes.iter().enumerate() {
            for task in (0..planned.wanted.len()).filter(|&k| planned.wanted[k]) {
                let mut waits = 0;
                for edge in &planned.edges {
                    let base = self.slot_base[edge.port.node][edge.port.output];
                    let read = |k: usize| lock(&self.slots[base + k]).readers += 1;
                    waits += match &edge.reads {
                        Reads::Same => {
                            read(task);
                            1
                        }
                        Reads::Held => {
                            read(0);
                            1
                        }
                        Reads::All => {
                            (0..self.values_of(edge.port)).for_each(read);
                            self.plan.nodes[edge.port.node].wanted.len() as u32
                        }
                        Reads::Lists(lists) => {
                            lists.forward[task].iter().for_each(|&k| read(k as usize));
                            lists.forward[task].len() as u32
                        }
                    };
                }
                self.pending[self.task_base[node] + task] = AtomicU32::new(waits + 1);
            }
        }
        for port in self.plan.keep.iter().filter(|p| !self.plan.known.contains_key(p)) {
            let base = self.slot_base[port.node][port.output];
            (0..self.values_of(*port)).for_each(|k| lock(&self.slots[base + k]).readers += 1);
        }
        for &(node, task) in &self.plan.targets {
            self.is_target[self.task_base[node as usize] + task as usize] = true;
        }
        self
    }

    fn values_of(&self, port: Port) -> usize {
        if self.graph.is_single(port) { 1 } else { self.graph.nodes[port.node].clock.len() }
    }

    fn id(&self, task: Task) -> usize {
        self.task_base[task.node as usize] + task.index as usize
    }

    fn work(&self, thread: usize, own: &Worker<Task>, others: &[Stealer<Task>]) {
        let mut briefs = Vec::new();
        loop {
            if self.stopped.load(Ordering::Acquire) {
                return;
            }
            if self.options.cancel.is_cancelled() {
                self.stop();
                return;
            }
            match self.find(own, others) {
                Some(task) => self.perform(task, thread, own, &mut briefs),
                None if self.admit() => {}
                None => self.sleep(others),
            }
        }
    }

    fn find(&self, own: &Worker<Task>, others: &[Stealer<Task>]) -> Option<Task> {
        if let Some(task) = own.pop() {
            return Some(task);
        }
        loop {
            let mut again = false;
            for stolen in std::iter::once(self.roots.steal()).chain(others.iter().map(Stealer::steal)) {
                match stolen {
                    Steal::Success(task) => return Some(task),
                    Steal::Retry => again = true,
                    Steal::Empty => {}
                }
            }
            if !again {
                return None;
            }
        }
    }

    /// Admits the next target, if there is one and the bound allows; true where it did.
    fn admit(&self) -> bool {
        let mut next = lock(&self.next_target);
        let Some(&(node, index)) = self.plan.targets.get(*next) else { return false };
        if self.in_flight.load(Ordering::Acquire) >= self.bound() {
            return false;
        }
        *next += 1;
        self.in_flight.fetch_add(1, Ordering::AcqRel);
        self.admit_all(Task { node, index });
        true
    }

    /// Admits a task and all that it reads, directly or not. What can run at once goes to the roots, first frames first.
    fn admit_all(&self, target: Task) {
        let mut stack = vec![target];
        let mut admitted = Vec::new();
        while let Some(task) = stack.pop() {
            if self.flags[self.id(task)].fetch_or(ADMITTED, Ordering::AcqRel) & ADMITTED != 0 {
                continue;
            }
            admitted.push(task);
            for edge in self.plan.nodes[task.node as usize].edges.iter().rev() {
                let node = edge.port.node as u32;
                let once = self.graph.nodes[edge.port.node].runs_once();
                match &edge.reads {
                    Reads::Same if !once => stack.push(Task { node, index: task.index }),
                    Reads::All if !once => {
                        stack.extend((0..self.plan.nodes[edge.port.node].wanted.len() as u32).rev().map(|index| Task { node, index }))
                    }
                    Reads::Lists(lists) if !once => {
                        stack.extend(lists.forward[task.index as usize].iter().rev().map(|&index| Task { node, index }))
                    }
                    _ => stack.push(Task { node, index: 0 }),
                }
            }
        }
        for task in admitted {
            if self.pending[self.id(task)].fetch_sub(1, Ordering::AcqRel) == 1 {
                self.roots.push(task);
            }
        }
        self.rouse();
    }

    fn sleep(&self, others: &[Stealer<Task>]) {
        self.sleepers.fetch_add(1, Ordering::SeqCst);
        let mut wakes = lock(&self.wakes);
        let seen = *wakes;
        fence(Ordering::SeqCst);
        let something = !self.roots.is_empty() || others.iter().any(|s| !s.is_empty()) || self.can_admit();
        while !something && *wakes == seen && !self.stopped.load(Ordering::Acquire) && !self.options.cancel.is_cancelled() {
            // A cancelled run has nobody to wake the sleepers, hence the bound.
            wakes = self.wake.wait_timeout(wakes, Duration::from_millis(20)).unwrap_or_else(PoisonError::into_inner).0;
        }
        drop(wakes);
        self.sleepers.fetch_sub(1, Ordering::SeqCst);
    }

    fn can_admit(&self) -> bool {
        *lock(&self.next_target) < self.plan.targets.len() && self.in_flight.load(Ordering::Acquire) < self.bound()
    }

    fn bound(&self) -> i64 {
        let bound = if self.options.in_flight > 0 { self.options.in_flight } else { self.options.threads.max(1) * 2 };
        i64::try_from(bound).unwrap_or(i64::MAX)
    }

    fn rouse(&self) {
        fence(Ordering::SeqCst);
        if self.sleepers.load(Ordering::SeqCst) > 0 {
            *lock(&self.wakes) += 1;
            self.wake.notify_all();
        }
    }

    fn stop(&self) {
        self.stopped.store(true, Ordering::Release);
        *lock(&self.wakes) += 1;
        self.wake.notify_all();
    }

    fn perform(&self, task: Task, thread: usize, own: &Worker<Task>, briefs: &mut Vec<Brief>) {
        let node = &self.graph.nodes[task.node as usize];
        let poisoned = self.flags[self.id(task)].load(Ordering::Acquire) & POISONED != 0;
        let fine = if poisoned {
            self.release(task);
            false
        } else {
            briefs.clear();
            let (args, state) = self.args(task, briefs);
            let frame = node.clock.first + i64::from(task.index);
            let cx = Context { frame, clock: &node.clock, input_clocks: &node.input_clocks, cancel: &self.options.cancel };
            let shown = (!node.runs_once()).then_some(frame);
            let given = self.options.observer.keeps_inputs().then(|| Given { args: args.clone(), state: state.clone() });
            self.options.observer.started(task.node as usize, shown, thread);
            let start = Instant::now();
            let result =
                catch_unwind(AssertUnwindSafe(|| node.ty.operator.compute(args, state, &cx))).unwrap_or_else(|p| Err(panicked(p.as_ref())));
            let time = start.elapsed();
            let meter = &self.meters[task.node as usize];
            meter.tasks.fetch_add(1, Ordering::Relaxed);
            meter.nanos.fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
            let stored = result.and_then(|computed| self.store(task, computed));
            let live_bytes = self.total.live.load(Ordering::Relaxed).max(0) as u64;
            let bytes = *stored.as_ref().unwrap_or(&0);
            self.options.observer.done(&Done { node: task.node as usize, frame: shown, thread, start, time, bytes, live_bytes });
            match stored {
                Ok(_) => true,
                Err(error) => {
                    self.fail(task, shown, error, briefs, given);
                    false
                }
            }
        };
        self.finish(task, fine, own);
    }

    fn fail(&self, task: Task, frame: Option<i64>, error: NodeError, briefs: &[Brief], given: Option<Given>) {
        if error.cancelled {
            return;
        }
        let schema = &self.graph.nodes[task.node as usize].ty.schema;
        let inputs = briefs.iter().map(|(i, ty, shape)| format!("{}: {ty} [{}]", schema.inputs[*i].name, describe_shape(shape))).collect();
        let failure = Failure { node: task.node as usize, frame, error, inputs, given };
        self.options.observer.failed(self.graph, &failure);
        lock(&self.failures).push(Failure { given: None, ..failure });
    }

    /// What stands at each input of a task; takes each result for the last time where nobody else will read it.
    fn args(&self, task: Task, briefs: &mut Vec<Brief>) -> (Vec<Arg>, Option<ValueRef>) {
        let node = &self.graph.nodes[task.node as usize];
        let mut edges = self.plan.nodes[task.node as usize].edges.iter();
        let mut wired = |port: &Port, input: usize, briefs: &mut Vec<Brief>| {
            let arg = match self.plan.known.get(port) {
                Some(value) => self.whole_or_one(value.clone(), node.ty.schema.inputs[input].access),
                None => edges.next().map_or(Arg::None, |edge| self.read(task, edge, node.ty.schema.inputs[input].access)),
            };
            if let Some(value) = first_value(&arg) {
                briefs.push((input, value.type_name(), value.first_shape()));
            }
            arg
        };
        let mut args = Vec::with_capacity(node.inputs.len());
        for (i, binding) in node.inputs.iter().enumerate() {
            args.push(match binding {
                Binding::None => Arg::None,
                Binding::Literal { value, .. } => Arg::Literal(value.clone()),
                Binding::Wire(port) => wired(port, i, briefs),
                Binding::List(ports) => Arg::List(ports.iter().map(|p| wired(p, i, briefs)).collect()),
            });
        }
        let state = edges.next().and_then(|edge| match self.read(task, edge, crate::node::Access::Frames) {
            Arg::Frames(list) => list.into_iter().next().map(|(_, v)| v),
            _ => None,
        });
        (args, state)
    }

    fn whole_or_one(&self, value: ValueRef, access: crate::node::Access) -> Arg {
        match access {
            crate::node::Access::Sequence => Arg::Sequence(SequenceRef::new(None, vec![value])),
            _ => Arg::Value(value),
        }
    }

    fn read(&self, task: Task, edge: &crate::plan::Edge, access: crate::node::Access) -> Arg {
        let base = self.slot_base[edge.port.node][edge.port.output];
        let clock = &self.graph.nodes[edge.port.node].clock;
        match &edge.reads {
            Reads::Same => self.take(edge.port.node, base + task.index as usize).map_or(Arg::None, Arg::Value),
            Reads::Held => self.take(edge.port.node, base).map_or(Arg::None, |v| self.whole_or_one(v, access)),
            Reads::All => {
                let values = (0..self.values_of(edge.port)).filter_map(|k| self.take(edge.port.node, base + k)).collect::<Vec<ValueRef>>();
                let clock = (!self.graph.is_single(edge.port)).then(|| clock.clone());
                Arg::Sequence(SequenceRef::new(clock, values))
            }
            Reads::Lists(lists) => {
                let at = |&k: &u32| self.take(edge.port.node, base + k as usize).map(|v| (clock.first + i64::from(k), v));
                Arg::Frames(lists.forward[task.index as usize].iter().filter_map(at).collect())
            }
        }
    }

    fn take(&self, node: usize, slot: usize) -> Option<ValueRef> {
        let mut slot = lock(&self.slots[slot]);
        slot.readers -= 1;
        if slot.readers > 0 {
            return slot.value.clone();
        }
        let value = slot.value.take();
        if let Some(v) = &value {
            let bytes = v.size() as i64;
            self.meters[node].shrink(bytes);
            self.total.shrink(bytes);
        }
        value
    }

    /// Gives up the reads of a task that will not run.
    fn release(&self, task: Task) {
        for edge in &self.plan.nodes[task.node as usize].edges {
            drop(self.read(task, edge, crate::node::Access::Frames));
        }
    }

    /// Puts the results where their readers find them; gives their bytes.
    fn store(&self, task: Task, computed: Computed) -> Result<u64, NodeError> {
        let mut bytes = 0;
        let node = &self.graph.nodes[task.node as usize];
        let bases = &self.slot_base[task.node as usize];
        if computed.outputs.len() != node.ty.schema.outputs.len() {
            return Err(NodeError::internal("a node gave another number of outputs than it declares"));
        }
        for (p, out) in computed.outputs.into_iter().enumerate() {
            match out {
                OutValue::One(value) => {
                    bytes += self.put(task.node, bases[p] + if node.is_single(p) { 0 } else { task.index as usize }, value)
                }
                OutValue::Stream(values) if !node.is_single(p) && values.len() == node.clock.len() => {
                    bytes += values.into_iter().enumerate().map(|(k, v)| self.put(task.node, bases[p] + k, v)).sum::<u64>();
                }
                OutValue::Stream(values) => {
                    let message =
                        format!("expected {} frames of `{}`, found {}", node.clock.len(), node.ty.schema.outputs[p].name, values.len());
                    return Err(NodeError::internal(message));
                }
            }
        }
        if let (Some(state), Some(&base)) = (computed.state, bases.last()) {
            bytes += self.put(task.node, base + task.index as usize, state);
        }
        Ok(bytes)
    }

    fn put(&self, node: u32, slot: usize, value: ValueRef) -> u64 {
        let mut slot = lock(&self.slots[slot]);
        if slot.readers == 0 {
            return 0;
        }
        let bytes = value.size();
        self.meters[node as usize].grow(bytes as i64);
        self.total.grow(bytes as i64);
        slot.value = Some(value);
        bytes as u64
    }

    /// Tells everyone who waits for a task that it is done, or that it never will be.
    fn finish(&self, task: Task, fine: bool, own: &Worker<Task>) {
        let node = task.node as usize;
        let once = self.graph.nodes[node].runs_once();
        for &(consumer, edge) in &self.plan.nodes[node].consumers {
            let planned = &self.plan.nodes[consumer as usize];
            let tell = |index: usize| {
                if planned.wanted[index] {
                    self.tell(Task { node: consumer, index: index as u32 }, fine, own);
                }
            };
            match &planned.edges[edge as usize].reads {
                Reads::Same if !once => tell(task.index as usize),
                Reads::Same | Reads::Held => (0..planned.wanted.len()).for_each(tell),
                Reads::All => tell(0),
                Reads::Lists(lists) if once => lists.backward.iter().flatten().for_each(|&k| tell(k as usize)),
                Reads::Lists(lists) => lists.backward[task.index as usize].iter().for_each(|&k| tell(k as usize)),
            }
        }
        if self.is_target[self.id(task)] {
            self.reach(fine);
        }
    }

    fn tell(&self, task: Task, fine: bool, own: &Worker<Task>) {
        let id = self.id(task);
        if !fine {
            self.flags[id].fetch_or(POISONED, Ordering::AcqRel);
        }
        if self.pending[id].fetch_sub(1, Ordering::AcqRel) == 1 {
            own.push(task);
            self.rouse();
        }
    }

    fn reach(&self, fine: bool) {
        if !fine {
            self.unreached.fetch_add(1, Ordering::Relaxed);
        }
        self.in_flight.fetch_sub(1, Ordering::AcqRel);
        if self.open_targets.fetch_sub(1, Ordering::AcqRel) == 1 {
            self.stop();
        } else {
            self.rouse();
        }
    }

    fn report(self) -> Report {
        let mut kept = BTreeMap::new();
        for port in self.plan.keep.iter().filter(|p| !self.plan.known.contains_key(p)) {
            let base = self.slot_base[port.node][port.output];
            let values = (0..self.values_of(*port)).map(|k| lock(&self.slots[base + k]).value.clone()).collect();
            kept.insert(*port, values);
        }
        let mut failures = std::mem::take(&mut *lock(&self.failures));
        failures.sort_by_key(|f| (f.node, f.frame));
        let stats = self.meters.iter().map(|m| NodeStats {
            tasks: m.tasks.load(Ordering::Relaxed),
            time: Duration::from_nanos(m.nanos.load(Ordering::Relaxed)),
            peak_bytes: m.peak.load(Ordering::Relaxed).max(0) as u64,
        });
        Report {
            cancelled: self.options.cancel.is_cancelled() && self.open_targets.load(Ordering::Acquire) > 0,
            unreached: self.unreached.load(Ordering::Relaxed),
            stats: stats.collect(),
            failures,
            kept,
            peak_bytes: self.total.peak.load(Ordering::Relaxed).max(0) as u64,
        }
    }
}

fn first_value(arg: &Arg) -> Option<&dyn AnyValue> {
    match arg {
        Arg::Value(v) => Some(v.as_ref()),
        Arg::Frames(list) => list.first().map(|(_, v)| v.as_ref()),
        _ => None,
    }
}

/// The failure of a node that panicked.
pub(crate) fn panicked(payload: &(dyn std::any::Any + Send)) -> NodeError {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned()).or_else(|| payload.downcast_ref::<String>().cloned());
    NodeError::internal(format!("panicked: {}", text.unwrap_or_else(|| "no message".to_owned())))
        .help("this is a fault of the node's code: please report it with the graph and the inputs")
}
