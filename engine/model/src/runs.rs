//! Whole runs of small graphs on a few threads, under a budget in which every one of their tasks just fits.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec as plain;
use pegbar_engine::node::{Cancel, Context, Fault, Frames, In, NodeError, PerFrame, Recurrent, Sequence, Stream, Whole};
use pegbar_engine::registry::Registry;
use pegbar_engine::value::{Curve, Value, Vector, downcast};
use pegbar_engine::{Node, Outputs};
use shuttle::rand::Rng;

use crate::exec::{Done, Observer, Options, Report, execute};
use crate::graph::{Graph, Port};
use crate::orders::orders;
use crate::sync;

/// Numbers of a value: so many that it may leave memory.
const LEN: usize = 160;

/// Some numbers.
#[derive(Outputs)]
struct Block {
    /// They.
    values: Vector,
}

fn block(value: f64) -> Block {
    Block { values: Vector { values: vec![value; LEN] } }
}

fn number(value: &Vector) -> f64 {
    value.values[0]
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "model.make", version = 1, outputs = Block, uses_frame)]
struct Make {
    /// Added to it.
    more: f64,
    /// The frame at which it fails.
    fails: i64,
}

impl PerFrame for Make {
    fn run(self, cx: &Context) -> Result<Block, NodeError> {
        if cx.frame == self.fails {
            return Err(NodeError::new(Fault::Input, "expected another frame, found this"));
        }
        Ok(block(cx.frame as f64 + self.more))
    }
}

/// A sum.
#[derive(Node)]
#[node(id = "model.add", version = 1, outputs = Block)]
struct Add {
    /// One.
    a: In<Vector>,
    /// The other.
    b: In<Vector>,
}

impl PerFrame for Add {
    fn run(self, _cx: &Context) -> Result<Block, NodeError> {
        Ok(block(number(&self.a) + 2.0 * number(&self.b)))
    }
}

/// A sum over neighbouring frames.
#[derive(Node)]
#[node(id = "model.window", version = 1, outputs = Block)]
struct Window {
    /// The stream.
    stream: Frames<Vector>,
}

impl PerFrame for Window {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame, cx.clock.clamp(cx.frame + 1)]
    }
    fn run(self, cx: &Context) -> Result<Block, NodeError> {
        let frames = self.reads("stream", cx);
        Ok(block(number(self.stream.at(frames[0])?) + 3.0 * number(self.stream.at(frames[1])?)))
    }
}

/// A sum over the frames so far.
#[derive(Node)]
#[node(id = "model.total", version = 1, kind = recurrent, outputs = Block)]
struct Total {
    /// The stream.
    stream: In<Vector>,
}

impl Recurrent for Total {
    type State = Vector;
    fn run(self, state: Option<&Vector>, _cx: &Context) -> Result<(Block, Vector), NodeError> {
        let all = state.map_or(0.0, number) + number(&self.stream);
        Ok((block(all), block(all).values))
    }
}

/// What comes of a whole sequence.
#[derive(Outputs)]
struct Each {
    /// Each frame, and the sum of all.
    values: Stream<Vector>,
}

/// Looks at a whole sequence, frame by frame.
#[derive(Node)]
#[node(id = "model.gather", version = 1, kind = whole, outputs = Each)]
struct Gather {
    /// The sequence.
    stream: Sequence<Vector>,
}

impl Whole for Gather {
    fn run(self, _cx: &Context) -> Result<Each, NodeError> {
        let mut frames = Vec::new();
        for k in 0..self.stream.len() {
            frames.push(number(self.stream.get(k)?.as_ref()));
        }
        let sum: f64 = frames.iter().sum();
        Ok(Each { values: Stream(frames.into_iter().map(|frame| block(frame + sum).values).collect()) })
    }
}

/// A number.
#[derive(Outputs)]
struct Number {
    /// It.
    number: Curve,
}

/// A number that is made once.
#[derive(Node)]
#[node(id = "model.once", version = 1, outputs = Number)]
struct Once {}

impl PerFrame for Once {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { number: Curve { value: 1.0 } })
    }
}

shuttle::lazy_static! {
    static ref MET: (sync::Mutex<usize>, sync::Condvar) = (sync::Mutex::new(0), sync::Condvar::new());
}

/// Ends only when two frames of it run at once, on two threads.
#[derive(Node)]
#[node(id = "model.meet", version = 1, outputs = Block, uses_frame)]
struct Meet {
    /// Made before.
    after: f64,
}

impl PerFrame for Meet {
    fn run(self, _cx: &Context) -> Result<Block, NodeError> {
        let (met, all) = &*MET;
        let mut met = met.lock().unwrap();
        *met += 1;
        all.notify_all();
        drop(all.wait_while(met, |met| *met < 2).unwrap());
        Ok(block(self.after))
    }
}

fn registry() -> Registry {
    Registry::new()
        .per_frame::<Once>()
        .per_frame::<Meet>()
        .per_frame::<Make>()
        .per_frame::<Add>()
        .per_frame::<Window>()
        .recurrent::<Total>()
        .whole::<Gather>()
}

fn load(nodes: &str, frames: usize) -> Graph {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("model.ron"), &text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

/// A graph, what it gives, and the least budget that it runs in.
struct Case {
    graph: Graph,
    frames: usize,
    keep: Vec<Port>,
    values: Vec<Option<f64>>,
    tasks: BTreeMap<(usize, Option<i64>), usize>,
    failures: usize,
    unreached: usize,
    limit: u64,
}

#[derive(Default)]
struct Counts(Mutex<BTreeMap<(usize, Option<i64>), usize>>);

impl plain::Observer for Counts {
    fn done(&self, done: &plain::Done) {
        *self.0.lock().unwrap().entry((done.node, done.frame)).or_default() += 1;
    }
}

impl Observer for Counts {
    fn done(&self, done: &Done) {
        *self.0.lock().unwrap().entry((done.node, done.frame)).or_default() += 1;
    }
}

fn numbers(kept: &BTreeMap<Port, Vec<Option<crate::value::ValueRef>>>) -> Vec<Option<f64>> {
    kept.values().flatten().map(|v| v.clone().map(|v| number(&downcast::<Vector>(v).unwrap()))).collect()
}

impl Case {
    /// What one thread makes of it without a budget, by the engine itself.
    fn new(nodes: &str, frames: usize, most_values: usize) -> Self {
        let graph = load(nodes, frames);
        let keep = vec![Port { node: graph.nodes.len() - 1, output: 0 }];
        let counts = Counts::default();
        let report = plain::execute(&graph, &[], &keep, &plain::Options { observer: &counts, ..plain::Options::default() }).unwrap();
        let bytes = block(0.0).values.size() as u64 + 64;
        Self {
            frames,
            values: numbers(&report.kept),
            tasks: counts.0.into_inner().unwrap(),
            failures: report.failures.len(),
            unreached: report.unreached,
            limit: bytes * most_values as u64,
            graph,
            keep,
        }
    }

    fn run(&self, threads: usize, options: Options) -> Report {
        execute(&self.graph, &[], &self.keep, &Options { threads, ..options }).unwrap()
    }

    /// Runs it as chance has it, and holds it against what is known.
    fn check(&self) {
        let mut rng = shuttle::rand::thread_rng();
        let threads = rng.gen_range(2..4);
        let memory = rng.gen_ratio(7, 8).then(|| self.limit + self.limit / 4 * rng.gen_range(0..3u64));
        let counts = Counts::default();
        let options = Options { memory, in_flight: rng.gen_range(0..self.frames + 1), observer: &counts, ..Options::default() };
        let report = self.run(threads, options);
        assert_eq!(report.stuck, None);
        assert_eq!(report.failures.len(), self.failures, "{:?}", report.failures);
        assert_eq!(report.unreached, self.unreached);
        assert!(!report.cancelled);
        assert!(memory.is_none_or(|memory| report.peak_bytes <= memory), "{} of {memory:?}", report.peak_bytes);
        assert_eq!(numbers(&report.kept), self.values);
        assert_eq!(counts.0.into_inner().unwrap(), self.tasks, "each task once");
    }
}

/// The graphs, each with the most values that one of its tasks has at once.
fn cases() -> Arc<Vec<Case>> {
    static CASES: OnceLock<Arc<Vec<Case>>> = OnceLock::new();
    let make = "\"n0\": (type: \"model.make\", more: 1, fails: 0), ";
    let case = |nodes: &str, frames, most| Case::new(&format!("{make}{nodes}"), frames, most);
    let all = || {
        vec![
            case(r#""n1": (type: "model.add", a: "@n0", b: "@n0"), "n2": (type: "model.add", a: "@n1", b: "@n0")"#, 3, 3),
            case(r#""n1": (type: "model.window", stream: "@n0"), "n2": (type: "model.add", a: "@n1", b: "@n0")"#, 3, 3),
            case(r#""n1": (type: "model.total", stream: "@n0"), "n2": (type: "model.window", stream: "@n1")"#, 3, 4),
            case(
                r#""n1": (type: "model.total", stream: "@n0"), "n2": (type: "model.total", stream: "@n0"), "n3": (type: "model.add", a: "@n1", b: "@n2")"#,
                2,
                4,
            ),
            case(r#""n1": (type: "model.gather", stream: "@n0"), "n2": (type: "model.add", a: "@n1", b: "@n0")"#, 2, 3),
            case(
                r#""n1": (type: "model.make", more: 2, fails: 0), "n2": (type: "model.add", a: "@n0", b: "@n1"), "n3": (type: "model.add", a: "@n0", b: "@n2")"#,
                2,
                3,
            ),
            case(
                r#""n1": (type: "model.make", more: 2, fails: 2), "n2": (type: "model.window", stream: "@n1"), "n3": (type: "model.add", a: "@n0", b: "@n2")"#,
                3,
                3,
            ),
            case(
                r#""n1": (type: "model.make", more: 2, fails: 2), "n2": (type: "model.add", a: "@n0", b: "@n1"), "n3": (type: "model.window", stream: "@n0"), "n4": (type: "model.window", stream: "@n2"), "n5": (type: "model.add", a: "@n3", b: "@n4")"#,
                4,
                3,
            ),
        ]
    };
    CASES.get_or_init(|| Arc::new(all())).clone()
}

fn check_case(i: usize, n: usize) {
    let cases = cases();
    orders(n, move || cases[i].check());
}

#[test]
fn sums() {
    check_case(0, 100);
}

#[test]
fn windows() {
    check_case(1, 100);
}

#[test]
fn chains_of_states() {
    check_case(2, 100);
}

#[test]
fn two_chains() {
    check_case(3, 100);
}

#[test]
fn whole_sequences() {
    check_case(4, 100);
}

#[test]
fn diamonds() {
    check_case(5, 100);
}

#[test]
fn failures() {
    check_case(6, 100);
    // What is passed over, beside what is let in, takes many orders to be seen going wrong.
    check_case(7, 700);
}

#[test]
fn what_can_run_is_not_left_lying() {
    // One target in flight reads both frames: what is admitted, or told, is for both threads.
    for nodes in [
        r#""n0": (type: "model.meet", after: 1), "n1": (type: "model.window", stream: "@n0")"#,
        r#""once": (type: "model.once"), "n0": (type: "model.meet", after: "@once"), "n1": (type: "model.window", stream: "@n0")"#,
    ] {
        let graph = Arc::new(load(nodes, 2));
        let keep = [Port { node: graph.nodes.len() - 1, output: 0 }];
        orders(100, move || {
            let report = execute(&graph, &[], &keep, &Options { threads: 2, in_flight: 1, ..Options::default() }).unwrap();
            assert!(report.is_complete(), "{:?}", report.failures);
        });
    }
}

#[test]
fn a_run_that_is_cancelled_ends() {
    let cases = cases();
    orders(100, move || {
        let case = &cases[shuttle::rand::thread_rng().gen_range(0..cases.len())];
        let cancel = Cancel::default();
        let later = cancel.clone();
        let other = shuttle::thread::spawn(move || {
            for _ in 0..shuttle::rand::thread_rng().gen_range(0..40) {
                shuttle::thread::yield_now();
            }
            later.cancel();
        });
        let report = case.run(2, Options { memory: Some(case.limit), cancel, ..Options::default() });
        assert_eq!(report.stuck, None);
        other.join().unwrap();
    });
}
