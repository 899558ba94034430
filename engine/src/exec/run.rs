//! One run of a plan: tasks that count what they wait for, and threads that perform them.

mod count;
mod report;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use super::cached::{Cached, Kept};
use super::crew::{Crew, Woken};
use super::gate::{Ask, Need, Pass};
use super::layout::Layout;
use super::memory::{Fetched, Make, Memory, Missed, SlotValues, bytes_of};
use super::sizes::Sizes;
use super::{Done, Failure, Given, Options, Report, lock};
use crate::array::{Shape, describe_shape};
use crate::graph::{Binding, Graph, Port};
use crate::node::{Access, Arg, Computed, Context, Fault, Meter, NodeError, OutValue, SequenceRef};
use crate::plan::{Edge, Plan, Reads};
use crate::sync::{AtomicBool, AtomicI64, AtomicU8, AtomicU32, AtomicUsize, Mutex, Ordering, Worker, scope};
use crate::value::{AnyValue, ValueRef};

pub(crate) use report::panicked;

/// One frame of one node, or the one run of a node that runs once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Task {
    pub(super) node: u32,
    /// Position in the node's clock; 0 for a node that runs once.
    pub(super) index: u32,
}

const ADMITTED: u8 = 1;
const POISONED: u8 = 2;
const DONE: u8 = 4;

pub(super) struct Run<'a> {
    graph: &'a Graph,
    plan: &'a Plan,
    options: &'a Options<'a>,
    layout: &'a Layout,
    sizes: &'a Sizes,
    cached: Option<&'a Cached<'a>>,
    /// Tasks of each node that turned out to have been run before, on the same contents.
    cut: Vec<AtomicUsize>,
    /// What each task still waits for.
    pending: Vec<AtomicU32>,
    flags: Vec<AtomicU8>,
    is_target: Vec<bool>,
    memory: Arc<Memory>,
    crew: Crew<Task>,
    next_target: Mutex<usize>,
    /// Targets admitted less targets reached; below nought where one is reached as another's input before its turn.
    in_flight: AtomicI64,
    open_targets: AtomicUsize,
    unreached: AtomicUsize,
    failures: Mutex<Vec<Failure>>,
    /// True where a value that the cache should have had was gone.
    lost: AtomicBool,
    stuck: Mutex<Option<String>>,
}

/// Extents of the inputs of the task that a thread is at, for the message if it fails.
type Brief = (usize, &'static str, Shape);

/// What a thread uses again and again.
#[derive(Default)]
struct Desk {
    fetched: Vec<Fetched>,
    borrowed: Vec<usize>,
    sequences: Vec<Arc<SlotValues>>,
    sequence_slots: Vec<usize>,
    briefs: Vec<Brief>,
}

/// A task at the gate.
struct Asking<'a, S> {
    memory: &'a Memory,
    /// What it reads.
    slots: S,
    /// What of that is held in memory.
    pins: &'a mut Vec<usize>,
    /// Bytes for itself, as far as they are known, and the least.
    own: u64,
    least: u64,
}

impl<S: Iterator<Item = usize>> Ask for Asking<'_, S> {
    fn need(&mut self) -> Need {
        let load = self.memory.pin(self.slots.by_ref(), self.pins);
        Need { bytes: self.own + load, least: self.least + load }
    }

    fn make_room(&mut self, is_alone: bool) -> bool {
        self.memory.make_room(is_alone)
    }

    fn withdraw(&mut self) {
        self.pins.drain(..).for_each(|slot| self.memory.unpin(slot));
    }
}

/// Has tasks of this thread say how much of them is done, for as long as it works for this run.
struct Metered;

impl Metered {
    fn new(meter: Option<std::sync::Arc<Meter>>) -> Self {
        Meter::install(meter);
        Self
    }
}

impl Drop for Metered {
    fn drop(&mut self) {
        Meter::install(None);
    }
}

/// Sends everybody home where a thread panics outside of a node, so that the panic is seen rather than waited for.
struct AllOrNone<'a>(&'a Crew<Task>);

impl Drop for AllOrNone<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

/// What came of an attempt to perform a task.
enum Attempt {
    Done(bool),
    /// It waits at the gate, or was handed back.
    Later,
}

/// Runs a plan to its end.
pub(super) fn run(graph: &Graph, plan: &Plan, layout: &Layout, sizes: &Sizes, cached: Option<&Cached>, options: &Options) -> Report {
    let threads = options.threads.max(1);
    let workers: Vec<Worker<Task>> = (0..threads).map(|_| Worker::new_lifo()).collect();
    let run = Run::new(graph, plan, layout, sizes, cached, options, &workers);
    scope(|scope| {
        let mut workers = workers.into_iter();
        let own = workers.next();
        for (thread, worker) in workers.enumerate() {
            let run = &run;
            scope.spawn(move || run.work(thread + 1, &worker));
        }
        if let Some(worker) = own {
            run.work(0, &worker);
        }
    });
    run.report()
}

impl<'a> Run<'a> {
    fn new(
        graph: &'a Graph,
        plan: &'a Plan,
        layout: &'a Layout,
        sizes: &'a Sizes,
        cached: Option<&'a Cached<'a>>,
        options: &'a Options<'a>,
        workers: &[Worker<Task>],
    ) -> Self {
        let counted = count::count(graph, plan, layout);
        let memory = Memory::new(Make {
            limit: options.memory,
            slots: counted.slots,
            states: graph.nodes.iter().map(|n| n.ty.operator.state_type()).collect(),
            types: graph.types.clone(),
            cache: cached.map(|c| c.cache().clone()),
            spill: options.spill.clone(),
        });
        if let Some(cached) = cached {
            cached.presets().iter().for_each(|(slot, stored, bytes)| memory.preset(*slot, *stored, *bytes));
        }
        let mut is_target = vec![false; layout.n_tasks()];
        for &(node, index) in &plan.targets {
            is_target[layout.task(node as usize, index as usize)] = true;
        }
        let crew = Crew::new(workers);
        if plan.targets.is_empty() {
            crew.stop();
        }
        Self {
            graph,
            plan,
            options,
            layout,
            sizes,
            cached,
            cut: graph.nodes.iter().map(|_| AtomicUsize::new(0)).collect(),
            pending: counted.pending,
            flags: (0..layout.n_tasks()).map(|_| AtomicU8::new(0)).collect(),
            is_target,
            memory: Arc::new(memory),
            crew,
            next_target: Mutex::new(0),
            in_flight: AtomicI64::new(0),
            open_targets: AtomicUsize::new(plan.targets.len()),
            unreached: AtomicUsize::new(0),
            failures: Mutex::default(),
            lost: AtomicBool::new(false),
            stuck: Mutex::default(),
        }
    }

    fn id(&self, task: Task) -> usize {
        self.layout.task(task.node as usize, task.index as usize)
    }

    fn work(&self, thread: usize, own: &Worker<Task>) {
        let mut desk = Desk::default();
        let _all = AllOrNone(&self.crew);
        let _metered = Metered::new(self.options.observer.meter(thread));
        let ends = || self.options.cancel.is_cancelled();
        loop {
            if self.crew.is_stopped() {
                return;
            }
            if ends() {
                self.crew.stop();
                return;
            }
            match self.crew.find(own) {
                Some(task) => self.perform(task, thread, own, &mut desk),
                None if self.admit() => {}
                None => {
                    if self.crew.sleep(|| self.may_admit(), ends) == Woken::Stuck {
                        self.give_up();
                    }
                }
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

    fn may_admit(&self) -> bool {
        *lock(&self.next_target) < self.plan.targets.len() && self.in_flight.load(Ordering::Acquire) < self.bound()
    }

    /// Targets in flight at most: so many that their paths fit into the budget together.
    fn bound(&self) -> i64 {
        let bound = if self.options.in_flight > 0 { self.options.in_flight } else { self.options.threads.max(1) * 2 };
        i64::try_from(bound.min(self.sizes.paths())).unwrap_or(i64::MAX)
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
                let wanted = &self.plan.nodes[edge.port.node].wanted;
                let mut want = |index: u32| {
                    if wanted[index as usize] {
                        stack.push(Task { node, index });
                    }
                };
                match &edge.reads {
                    _ if self.graph.nodes[edge.port.node].runs_once() => want(0),
                    Reads::Same => want(task.index),
                    Reads::Held => want(0),
                    Reads::All => (0..wanted.len() as u32).rev().for_each(want),
                    Reads::Lists(lists) => lists.forward[task.index as usize].iter().rev().for_each(|&index| want(index)),
                }
            }
        }
        // What runs once is waited for by many: until it is there, their inputs would pile up.
        admitted.sort_by_key(|task| !self.graph.nodes[task.node as usize].runs_once());
        for task in admitted {
            if self.pending[self.id(task)].fetch_sub(1, Ordering::AcqRel) == 1 {
                self.crew.push_root(task);
            }
        }
        self.crew.rouse();
    }

    fn perform(&self, task: Task, thread: usize, own: &Worker<Task>, desk: &mut Desk) {
        let poisoned = self.flags[self.id(task)].load(Ordering::Acquire) & POISONED != 0;
        let attempt = if poisoned {
            self.pass_over(task);
            Attempt::Done(false)
        } else {
            self.attempt(task, thread, desk)
        };
        if let Attempt::Done(fine) = attempt {
            self.finish(task, fine, own);
        }
    }

    /// Gives up the reads of a task that will not run.
    fn pass_over(&self, task: Task) {
        let edges = &self.plan.nodes[task.node as usize].edges;
        let slots = edges.iter().flat_map(|edge| self.layout.reads(edge, task.index as usize));
        self.memory.gate.step_in();
        let freed = slots.map(|slot| self.memory.release(slot)).sum();
        self.crew.hand_back(self.memory.gate.leave(freed));
    }

    fn attempt(&self, task: Task, thread: usize, desk: &mut Desk) -> Attempt {
        if self.cached.is_some_and(|c| c.cut(task, &self.memory, self.sizes)) {
            self.pass_over(task);
            self.cut[task.node as usize].fetch_add(1, Ordering::Relaxed);
            return Attempt::Done(true);
        }
        let window = self.window(task);
        let mut charge = match self.admitted(task, window, desk) {
            Ok(Some(charge)) => charge,
            Ok(None) => return Attempt::Later,
            Err(error) => {
                self.pass_over(task);
                if let Some(error) = error {
                    self.fail(task, error, &[], None);
                }
                return Attempt::Done(false);
            }
        };
        let result = self.compute(task, thread, &mut charge, desk);
        let fine = result.is_ok();
        if let Err((error, given)) = result {
            if desk.sequences.iter().any(|s| s.is_lost()) {
                // What the node says of a value that is gone is of no interest.
                self.lost.store(true, Ordering::Relaxed);
            } else {
                // Whoever is told may read what the node was given, so that this comes before it is let go of.
                self.fail(task, error, &desk.briefs, given);
            }
        }
        self.close(charge, desk);
        Attempt::Done(fine)
    }

    /// Bytes for what a node reads of its sequences: one value of each at a time, at the least.
    fn window(&self, task: Task) -> u64 {
        let edges = self.plan.nodes[task.node as usize].edges.iter().filter(|e| e.by_handle);
        edges.map(|edge| self.memory.largest(self.layout.reads(edge, task.index as usize))).sum()
    }

    /// Lets a task in and fetches what it reads; the bytes that are counted for it, or `None` where it waits. No error where a value is lost.
    fn admitted(&self, task: Task, window: u64, desk: &mut Desk) -> Result<Option<u64>, Option<NodeError>> {
        let mut pins = Vec::new();
        let mut is_sure = false;
        loop {
            let entered = self.enter(task, window, is_sure, &mut pins);
            let fetched = entered.map(|charge| charge.map(|mut charge| (self.fetch(task, window, &mut charge, desk), charge)));
            pins.drain(..).for_each(|slot| self.memory.unpin(slot));
            let Some((fetched, charge)) = fetched? else { return Ok(None) };
            match fetched {
                Ok(()) => return Ok(Some(charge)),
                Err(missed) => {
                    self.undo(charge, desk);
                    if matches!(missed, Missed::Lost) {
                        self.lost.store(true, Ordering::Relaxed);
                        return Err(None);
                    }
                    // Something was given up between the reckoning and the fetching.
                    is_sure = true;
                }
            }
        }
    }

    /// Lets a task in with the bytes that are counted for it; `None` where it waits. Only where it `is_sure` do its inputs stay as they are reckoned.
    fn enter(&self, task: Task, window: u64, is_sure: bool, pins: &mut Vec<usize>) -> Result<Option<u64>, Option<NodeError>> {
        let gate = &self.memory.gate;
        if !gate.is_limited() {
            return Ok(gate.enter(0).then_some(0));
        }
        let edges = || self.plan.nodes[task.node as usize].edges.iter().filter(|e| !e.by_handle);
        let slots = || edges().flat_map(|edge| self.layout.reads(edge, task.index as usize));
        let known = self.sizes.need(task.node as usize);
        let own = window + known.unwrap_or_else(|| self.sizes.guess(gate.limit()));
        if !is_sure {
            let need = own + self.memory.away_bytes(slots());
            if gate.enter(need) {
                return Ok(Some(need));
            }
        }
        // A guess is no reason to refuse it.
        let least = window + known.unwrap_or(0);
        match gate.enter_or_wait(task, &mut Asking { memory: &self.memory, slots: slots(), pins, own, least }) {
            Pass::Go(need) => Ok(Some(need)),
            Pass::Wait => Ok(None),
            Pass::Never(need) => Err(Some(self.too_large(need - known.unwrap_or(0), known.unwrap_or(0)))),
        }
    }

    fn too_large(&self, inputs: u64, own: u64) -> NodeError {
        let (limit, held) = (self.memory.gate.limit(), self.memory.gate.used());
        let message = format!(
            "expected to run in {limit} bytes of memory, found a need of {} ({inputs} to load, {own} for results and scratch, beside {held} that cannot leave memory)",
            inputs + own + held
        );
        let help = match self.memory.trouble() {
            Some(trouble) => format!("what lies idle could not go to disk: {trouble}"),
            None => format!("allow at least {} with --memory", (self.options.asked)(inputs + own + held)),
        };
        NodeError::new(Fault::Limit, message).help(help)
    }

    fn fetch(&self, task: Task, window: u64, charge: &mut u64, desk: &mut Desk) -> Result<(), Missed> {
        desk.fetched.clear();
        desk.borrowed.clear();
        let mut left = window;
        for edge in &self.plan.nodes[task.node as usize].edges {
            if edge.by_handle {
                let slots: Vec<usize> = self.layout.reads(edge, task.index as usize).collect();
                let room = self.memory.largest(slots.iter().copied()).min(left);
                left -= room;
                *charge -= room;
                desk.sequence_slots.extend_from_slice(&slots);
                desk.sequences.push(Arc::new(SlotValues::new(self.memory.clone(), slots, room)));
                continue;
            }
            for slot in self.layout.reads(edge, task.index as usize) {
                desk.fetched.push(self.memory.fetch(slot, charge)?);
            }
        }
        desk.borrowed.extend(desk.fetched.iter().filter(|f| !f.taken).map(|f| f.slot));
        Ok(())
    }

    /// Undoes a fetch that came to nothing.
    fn undo(&self, mut charge: u64, desk: &mut Desk) {
        for fetched in desk.fetched.drain(..) {
            self.memory.put_back(fetched, &mut charge);
        }
        for sequence in desk.sequences.drain(..) {
            charge += sequence.close();
        }
        desk.sequence_slots.clear();
        self.crew.hand_back(self.memory.gate.leave(charge));
    }

    fn compute(&self, task: Task, thread: usize, charge: &mut u64, desk: &mut Desk) -> Result<(), (NodeError, Option<Given>)> {
        let index = task.node as usize;
        let node = &self.graph.nodes[index];
        let (args, state) = self.args(task, desk);
        let cost = self.cached.map_or(0.0, |_| self.cost_of_inputs(task));
        let frame = node.clock.first + i64::from(task.index);
        let cx = Context { frame, clock: &node.clock, input_clocks: &node.input_clocks, cancel: &self.options.cancel };
        let shown = (!node.runs_once()).then_some(frame);
        let observer = self.options.observer;
        let given = observer.keeps_inputs().then(|| Given { args: args.clone(), state: state.clone() });
        let files = self.cached.map(|cached| cached.files(task)).unwrap_or_default();
        observer.started(index, shown, thread);
        let mut slots = Some((args, state));
        let mut result = Err(NodeError::internal("it did not run"));
        let start = Instant::now();
        let mut work = || {
            if let Some((args, state)) = slots.take() {
                result = catch_unwind(AssertUnwindSafe(|| node.ty.operator.compute(args, state, &cx)))
                    .unwrap_or_else(|p| Err(panicked(p.as_ref())));
            }
        };
        let allocated = match self.options.measure {
            Some(measure) => measure(&mut work),
            None => {
                work();
                0
            }
        };
        let time = start.elapsed();
        let stored = result.and_then(|computed| {
            if let Some(cached) = self.cached {
                cached.is_as_read(&files)?;
            }
            let bytes = weigh(&computed);
            self.sizes.measured(index, bytes, allocated.saturating_sub(bytes), time);
            self.store(task, computed, cost + time.as_secs_f32(), charge)?;
            Ok(bytes)
        });
        let live_bytes = self.memory.total().live();
        let bytes = *stored.as_ref().unwrap_or(&0);
        observer.done(&Done { node: index, frame: shown, thread, start, time, bytes, live_bytes });
        stored.map(drop).map_err(|error| (error, given))
    }

    /// Gives back what a task had.
    fn close(&self, charge: u64, desk: &mut Desk) {
        let mut freed = charge + desk.sequences.drain(..).map(|s| s.close()).sum::<u64>();
        freed += desk.borrowed.drain(..).map(|slot| self.memory.release_held(slot)).sum::<u64>();
        freed += desk.sequence_slots.drain(..).map(|slot| self.memory.release(slot)).sum::<u64>();
        self.crew.hand_back(self.memory.gate.leave(freed));
    }

    /// Seconds that it would take to have the inputs again.
    fn cost_of_inputs(&self, task: Task) -> f32 {
        let edges = &self.plan.nodes[task.node as usize].edges;
        let cost = |edge: &Edge| {
            let costs = self.layout.reads(edge, task.index as usize).map(|slot| self.memory.cost(slot));
            match edge.reads {
                _ if edge.by_handle => costs.sum(),
                _ => costs.fold(0.0, f32::max),
            }
        };
        edges.iter().map(cost).sum()
    }

    fn fail(&self, task: Task, error: NodeError, briefs: &[Brief], given: Option<Given>) {
        if error.cancelled {
            return;
        }
        let node = &self.graph.nodes[task.node as usize];
        let inputs = &node.ty.schema.inputs;
        let inputs = briefs.iter().map(|(i, ty, shape)| format!("{}: {ty} [{}]", inputs[*i].name, describe_shape(shape))).collect();
        let frame = (!node.runs_once()).then_some(node.clock.first + i64::from(task.index));
        let failure = Failure { node: task.node as usize, frame, error, inputs, given };
        self.options.observer.failed(self.graph, &failure);
        lock(&self.failures).push(Failure { given: None, ..failure });
    }

    /// What stands at each input of a task, out of what was fetched for it.
    fn args(&self, task: Task, desk: &mut Desk) -> (Vec<Arg>, Option<ValueRef>) {
        let node = &self.graph.nodes[task.node as usize];
        let mut edges = self.plan.nodes[task.node as usize].edges.iter();
        let mut fetched = desk.fetched.drain(..).map(|f| f.value);
        let mut sequences = desk.sequences.iter().cloned();
        let briefs = &mut desk.briefs;
        briefs.clear();
        let mut wired = |port: &Port, input: usize| {
            let access = node.ty.schema.inputs[input].access;
            let arg = match self.plan.known.get(port) {
                Some(value) => whole_or_one(value.clone(), access),
                None => edges.next().map_or(Arg::None, |edge| self.arg(task, edge, access, &mut fetched, &mut sequences)),
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
                Binding::Wire(port) => wired(port, i),
                Binding::List(ports) => Arg::List(ports.iter().map(|p| wired(p, i)).collect()),
            });
        }
        // What is left is the read of the node's own state, which the first frame of a chain does not have.
        let state = fetched.next();
        (args, state)
    }

    fn arg(
        &self,
        task: Task,
        edge: &Edge,
        access: Access,
        fetched: &mut impl Iterator<Item = ValueRef>,
        sequences: &mut impl Iterator<Item = Arc<SlotValues>>,
    ) -> Arg {
        let clock = &self.graph.nodes[edge.port.node].clock;
        match &edge.reads {
            _ if edge.by_handle => {
                let clock = (!self.graph.is_single(edge.port)).then(|| clock.clone());
                sequences.next().map_or(Arg::None, |s| Arg::Sequence(SequenceRef::shared(clock, s)))
            }
            Reads::Same | Reads::All => fetched.next().map_or(Arg::None, Arg::Value),
            Reads::Held => fetched.next().map_or(Arg::None, |v| whole_or_one(v, access)),
            Reads::Lists(lists) => {
                let frames = lists.forward[task.index as usize].iter().map(|&k| clock.first + i64::from(k));
                Arg::Frames(frames.zip(fetched).collect())
            }
        }
    }

    /// Puts the results where their readers find them, and into the cache where that is worth it.
    fn store(&self, task: Task, computed: Computed, cost: f32, charge: &mut u64) -> Result<(), NodeError> {
        let node = &self.graph.nodes[task.node as usize];
        let schema = &node.ty.schema;
        if computed.outputs.len() != schema.outputs.len() {
            return Err(NodeError::internal("a node gave another number of outputs than it declares"));
        }
        for (p, out) in computed.outputs.iter().enumerate() {
            let len = if let OutValue::Stream(values) = out { values.len() } else { continue };
            if node.is_single(p) || len != node.clock.len() {
                let message = format!("expected {} frames of `{}`, found {len}", node.clock.len(), schema.outputs[p].name);
                return Err(NodeError::internal(message));
            }
        }
        let kept: Kept = self.cached.map_or_else(Kept::default, |c| c.keep(task, &computed, cost));
        let cost = if kept.len() > 0 { 0.0 } else { cost };
        let mut stored = kept;
        let ports = computed.outputs.into_iter().map(Some).chain([computed.state.map(OutValue::One)]);
        for (p, out) in ports.enumerate() {
            let slots = self.layout.made(self.graph, task.node as usize, p, task.index as usize);
            let values = match out {
                None => continue,
                Some(OutValue::One(value)) => vec![value],
                Some(OutValue::Stream(values)) => values,
            };
            self.show(Port { node: task.node as usize, output: p }, task.index, &values);
            for (slot, value) in slots.zip(values) {
                self.memory.put(slot, value, stored.next().flatten(), cost, charge)?;
            }
        }
        Ok(())
    }

    /// Shows the observer what came out of a port; a state is nobody's business.
    fn show(&self, port: Port, index: u32, values: &[ValueRef]) {
        let node = &self.graph.nodes[port.node];
        if port.output >= node.ty.schema.outputs.len() {
            return;
        }
        let first = node.clock.first + i64::from(index);
        for (at, value) in values.iter().enumerate() {
            let frame = (!node.is_single(port.output)).then_some(first + at as i64);
            self.options.observer.made(self.graph, port, frame, value);
        }
    }

    /// Tells everyone who waits for a task that it is done, or that it never will be.
    fn finish(&self, task: Task, fine: bool, own: &Worker<Task>) {
        let node = task.node as usize;
        let once = self.graph.nodes[node].runs_once();
        self.flags[self.id(task)].fetch_or(DONE, Ordering::AcqRel);
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
            self.bound_paths();
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
            self.crew.rouse();
        }
    }

    /// Once every node of a path has run, its sizes say how many of them fit into the budget together.
    fn bound_paths(&self) {
        if let Some(limit) = self.options.memory.filter(|_| self.sizes.paths() == usize::MAX) {
            // What a few hundred need, the others need too.
            super::bound_paths(self.graph, self.plan, self.layout, self.sizes, limit, 256);
        }
    }

    fn reach(&self, fine: bool) {
        if !fine {
            self.unreached.fetch_add(1, Ordering::Relaxed);
        }
        self.in_flight.fetch_sub(1, Ordering::AcqRel);
        if self.open_targets.fetch_sub(1, Ordering::AcqRel) == 1 {
            self.crew.stop();
        } else {
            self.crew.rouse();
        }
    }
}

fn whole_or_one(value: ValueRef, access: Access) -> Arg {
    match access {
        access if access.by_handle() => Arg::Sequence(SequenceRef::new(None, vec![value])),
        _ => Arg::Value(value),
    }
}

/// Bytes of everything that a task made.
fn weigh(computed: &Computed) -> u64 {
    let bytes = |out: &OutValue| match out {
        OutValue::One(value) => bytes_of(value),
        OutValue::Stream(values) => values.iter().map(bytes_of).sum(),
    };
    computed.outputs.iter().map(bytes).sum::<u64>() + computed.state.as_ref().map_or(0, bytes_of)
}

fn first_value(arg: &Arg) -> Option<&dyn AnyValue> {
    match arg {
        Arg::Value(v) => Some(v.as_ref()),
        Arg::Frames(list) => list.first().map(|(_, v)| v.as_ref()),
        _ => None,
    }
}
