//! Random graphs of values of many sizes under a memory budget, against a plain interpreter: the same bits, and never more than the budget.

use std::path::Path;

use proptest::prelude::*;

use crate::check::{LoadOptions, load_text};
use crate::exec::{Expected, Options, Report, execute};
use crate::graph::{Graph, Port};
use crate::node::{AnyFrames, Context, Frames, In, NodeError, PerFrame, Recurrent, Sequence, Stream, Whole};
use crate::plan::PlanError;
use crate::registry::Registry;
use crate::value::{TimeMap, ValueRef, Vector, downcast};
use crate::{Node, Outputs};

const FRAMES: usize = 8;

/// Some numbers.
#[derive(Outputs)]
struct Block {
    /// They.
    values: Vector,
}

fn block(values: Vec<f64>) -> Block {
    Block { values: Vector { values } }
}

/// Numbers that tell frame and place.
#[derive(Node)]
#[node(id = "block.make", version = 1, outputs = Block, uses_frame)]
struct Make {
    /// How many, and as many again at every third frame.
    len: u32,
}

fn made(len: usize, frame: i64) -> Vec<f64> {
    let len = if frame % 3 == 0 { 2 * len } else { len };
    (0..len).map(|k| (frame * 1000 + k as i64) as f64).collect()
}

impl PerFrame for Make {
    fn run(self, cx: &Context) -> Result<Block, NodeError> {
        Ok(block(made(self.len as usize, cx.frame)))
    }
}

/// Numbers that are the same at every frame.
#[derive(Node)]
#[node(id = "block.constant", version = 1, outputs = Block)]
struct Constant {
    /// How many.
    len: u32,
}

impl PerFrame for Constant {
    fn run(self, _cx: &Context) -> Result<Block, NodeError> {
        Ok(block(made(self.len as usize, 1)))
    }
}

/// A sum, changed in place where nobody else reads it.
#[derive(Node)]
#[node(id = "block.add", version = 1, outputs = Block)]
struct Add {
    /// One.
    a: In<Vector>,
    /// The other, as often as it takes.
    b: In<Vector>,
}

fn added(mut a: Vec<f64>, b: &[f64]) -> Vec<f64> {
    a.iter_mut().zip(b.iter().cycle()).for_each(|(a, b)| *a += b);
    a
}

impl PerFrame for Add {
    fn run(self, _cx: &Context) -> Result<Block, NodeError> {
        Ok(block(added(self.a.into_owned()?.values, &self.b.values)))
    }
}

/// The sum of a window of frames.
#[derive(Node)]
#[node(id = "block.window", version = 1, outputs = Block)]
struct Window {
    /// The stream.
    stream: Frames<Vector>,
    /// Frames to each side.
    radius: u32,
}

impl PerFrame for Window {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        let r = i64::from(self.radius);
        (cx.frame - r..=cx.frame + r).map(|f| cx.clock.clamp(f)).collect()
    }
    fn run(self, cx: &Context) -> Result<Block, NodeError> {
        let mut sum = vec![0.0; 4];
        for f in self.reads("stream", cx) {
            sum = added(sum, &self.stream.at(f)?.values);
        }
        Ok(block(sum))
    }
}

/// What came so far, end to end, but no longer than some length.
#[derive(Node)]
#[node(id = "block.total", version = 1, kind = recurrent, outputs = Block)]
struct Total {
    /// The stream.
    stream: In<Vector>,
}

fn so_far(before: Option<&[f64]>, now: &[f64]) -> Vec<f64> {
    let mut all: Vec<f64> = before.into_iter().flatten().chain(now).copied().collect();
    all.truncate(6000);
    all
}

impl Recurrent for Total {
    type State = Vector;
    fn run(self, state: Option<&Vector>, _cx: &Context) -> Result<(Block, Vector), NodeError> {
        let all = so_far(state.map(|s| s.values.as_slice()), &self.stream.values);
        Ok((block(all[..all.len() / 2].to_vec()), Vector { values: all }))
    }
}

/// What is found in a whole sequence.
#[derive(Outputs)]
struct Found {
    /// The sum over all frames.
    sum: Vector,
    /// Its first number added to each frame.
    streams: Stream<Vector>,
    /// A map that plays the sequence backwards.
    map: TimeMap,
}

/// Looks at a whole sequence twice, a frame at a time.
#[derive(Node)]
#[node(id = "block.gather", version = 1, kind = whole, outputs = Found)]
struct Gather {
    /// The sequence.
    stream: Sequence<Vector>,
}

fn gathered<'a>(frames: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    frames.fold(vec![0.0; 600], added)
}

impl Whole for Gather {
    fn run(self, cx: &Context) -> Result<Found, NodeError> {
        let mut sum = vec![0.0; 600];
        for k in 0..self.stream.len() {
            sum = added(sum, &self.stream.get(k)?.values);
        }
        let mut streams = Vec::new();
        for k in 0..cx.clock.len() {
            let value = self.stream.get(k.min(self.stream.len() - 1))?;
            streams.push(Vector { values: vec![sum[0] + value.values.first().copied().unwrap_or(0.0); 700] });
        }
        let map = TimeMap { source_frames: cx.clock.frames().map(|f| (cx.clock.last + cx.clock.first - f) as f64).collect() };
        Ok(Found { sum: Vector { values: sum }, streams: Stream(streams), map })
    }
}

/// Any value.
#[derive(Outputs)]
struct Same {
    /// It.
    value: ValueRef,
}

/// Any stream at the frames that a map says.
#[derive(Node)]
#[node(id = "block.retime", version = 1, outputs = Same, type_from = "stream", uses_frame)]
struct Retime {
    /// The stream.
    stream: AnyFrames,
    /// The map.
    #[input(constant)]
    map: In<TimeMap>,
}

impl PerFrame for Retime {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        let idx = cx.clock.index(cx.frame).unwrap_or(0);
        vec![self.map.source_frames.get(idx).copied().unwrap_or(0.0) as i64]
    }
    fn run(self, cx: &Context) -> Result<Same, NodeError> {
        let frame = self.reads("stream", cx)[0];
        Ok(Same { value: self.stream.at(frame)?.clone() })
    }
}

fn registry() -> Registry {
    Registry::new()
        .per_frame::<Make>()
        .per_frame::<Constant>()
        .per_frame::<Add>()
        .per_frame::<Window>()
        .recurrent::<Total>()
        .whole::<Gather>()
        .per_frame::<Retime>()
}

/// A node of a random graph; references are to earlier nodes.
#[derive(Clone, Debug)]
enum Kind {
    Make(usize),
    Constant(usize),
    Add(usize, usize),
    Window(usize, usize),
    Total(usize),
    Sum(usize),
    Streams(usize),
    Back(usize),
}

fn kinds() -> impl Strategy<Value = Vec<Kind>> {
    let node = (0..12u8, any::<proptest::sample::Index>(), any::<proptest::sample::Index>(), 0..4usize, 1..4000usize);
    proptest::collection::vec(node, 2..16).prop_map(|list| {
        let one =
            |(i, (kind, a, b, radius, len)): (usize, (u8, proptest::sample::Index, proptest::sample::Index, usize, usize))| match (i, kind)
            {
                (0, _) | (_, 0..=1) => Kind::Make(len),
                (_, 2) => Kind::Constant(len),
                (_, 3..=5) => Kind::Add(a.index(i), b.index(i)),
                (_, 6..=7) => Kind::Window(a.index(i), radius),
                (_, 8) => Kind::Total(a.index(i)),
                (_, 9) => Kind::Sum(a.index(i)),
                (_, 10) => Kind::Streams(a.index(i)),
                _ => Kind::Back(a.index(i)),
            };
        list.into_iter().enumerate().map(one).collect()
    })
}

/// What each node gives: at each frame, or once.
fn interpret(nodes: &[Kind]) -> Vec<Vec<Vec<f64>>> {
    let mut out: Vec<Vec<Vec<f64>>> = Vec::new();
    for node in nodes {
        let at = |n: usize, k: usize| &out[n][k.min(out[n].len() - 1)];
        let frames = |sources: &[usize]| if sources.iter().all(|&n| out[n].len() == 1) { 1 } else { FRAMES };
        let all = |n: usize| gathered(out[n].iter().map(Vec::as_slice));
        out.push(match *node {
            Kind::Make(len) => (1..=FRAMES).map(|f| made(len, f as i64)).collect(),
            Kind::Constant(len) => vec![made(len, 1)],
            Kind::Add(a, b) => (0..frames(&[a, b])).map(|k| added(at(a, k).clone(), at(b, k))).collect(),
            Kind::Window(a, radius) => {
                let sum = |k: usize| {
                    let window = (k as i64 - radius as i64..=(k + radius) as i64).map(|j| j.clamp(0, FRAMES as i64 - 1) as usize);
                    window.fold(vec![0.0; 4], |sum, j| added(sum, at(a, j)))
                };
                (0..frames(&[a])).map(sum).collect()
            }
            Kind::Total(a) => {
                let mut states: Vec<Vec<f64>> = Vec::new();
                (0..frames(&[a])).for_each(|k| states.push(so_far(states.last().map(Vec::as_slice), at(a, k))));
                states.into_iter().map(|s| s[..s.len() / 2].to_vec()).collect()
            }
            Kind::Sum(a) => vec![all(a)],
            Kind::Streams(a) => (0..FRAMES).map(|k| vec![all(a)[0] + at(a, k).first().copied().unwrap_or(0.0); 700]).collect(),
            Kind::Back(a) => (0..FRAMES).map(|k| at(a, FRAMES - 1 - k).clone()).collect(),
        });
    }
    out
}

fn graph(nodes: &[Kind]) -> Graph {
    let text = |(i, node): (usize, &Kind)| {
        let reference = |n: usize| if matches!(nodes[n], Kind::Streams(_)) { format!("\"@n{n}.streams\"") } else { format!("\"@n{n}\"") };
        let body = match *node {
            Kind::Make(len) => format!("type: \"block.make\", len: {len}"),
            Kind::Constant(len) => format!("type: \"block.constant\", len: {len}"),
            Kind::Add(a, b) => format!("type: \"block.add\", a: {}, b: {}", reference(a), reference(b)),
            Kind::Window(a, radius) => format!("type: \"block.window\", stream: {}, radius: {radius}", reference(a)),
            Kind::Total(a) => format!("type: \"block.total\", stream: {}", reference(a)),
            Kind::Sum(a) | Kind::Streams(a) => format!("type: \"block.gather\", stream: {}", reference(a)),
            Kind::Back(a) => format!("type: \"block.retime\", stream: {}, map: \"@map.map\"", reference(a)),
        };
        format!("\"n{i}\": ({body}), ")
    };
    let nodes: String = nodes.iter().enumerate().map(text).collect();
    let text = format!(
        "Graph(pegbar: 1, frames: (first: 1, last: {FRAMES}, fps: 24), nodes: {{ {nodes} \"map\": (type: \"block.gather\", stream: \"@n0\") }})"
    );
    let loaded = load_text(Path::new("budget.ron"), &text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

fn ports(nodes: &[Kind]) -> Vec<Port> {
    nodes.iter().enumerate().map(|(node, n)| Port { node, output: usize::from(matches!(n, Kind::Streams(_))) }).collect()
}

fn agrees(report: &Report, ports: &[Port], expected: &[Vec<Vec<f64>>]) -> Result<(), TestCaseError> {
    for (port, expected) in ports.iter().zip(expected) {
        let Some(kept) = report.kept.get(port) else { continue };
        let found: Vec<Vec<u64>> = kept.iter().map(|v| bits(&downcast::<Vector>(v.clone().unwrap()).unwrap().values)).collect();
        let expected: Vec<Vec<u64>> = expected.iter().map(|v| bits(v)).collect();
        prop_assert_eq!(found, expected);
    }
    Ok(())
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Graphs that a test looks at; more where the environment asks for them.
fn cases() -> ProptestConfig {
    let cases = std::env::var("PEGBAR_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(150);
    // Graphs that are passed over grow with those that are looked at, about a sixth of them.
    ProptestConfig { cases, max_global_rejects: cases.saturating_mul(4).max(1024), failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(cases())]
    #[test]
    fn a_budget_changes_no_bit_and_is_never_passed(nodes in kinds(), more in 0..3u64, in_flight in 0..4usize) {
        let expected = interpret(&nodes);
        // A node that runs once over a single value gives one frame of a stream: those graphs are other ones.
        prop_assume!(nodes.iter().all(|n| !matches!(n, Kind::Streams(a) | Kind::Back(a) if expected[*a].len() == 1)));
        let graph = graph(&nodes);
        // The last value alone, so that the others can leave.
        let ports = &ports(&nodes)[nodes.len() - 1..];
        let free = execute(&graph, &[], ports, &Options { threads: 2, ..Options::default() }).unwrap();
        agrees(&free, ports, &expected[nodes.len() - 1..])?;
        let known: Vec<Option<Expected>> = free.stats.iter().map(|s| Some(Expected { bytes: s.most_bytes, scratch: 0, seconds: 0.0 })).collect();
        let tight = |threads, memory, expected: &[Option<Expected>]| {
            execute(&graph, &[], ports, &Options { threads, in_flight, memory: Some(memory), expected, ..Options::default() })
        };
        // Below the least it is refused before anything runs, and says what it takes.
        let needed = |refused: &PlanError| refused.error.message.rsplit("need of ").next().unwrap().split(' ').next().unwrap().parse().unwrap();
        let mut least: u64 = needed(&tight(1, 1, &known).unwrap_err());
        // Where a map has to be made first, what hangs on it is planned after that.
        if let Err(refused) = tight(1, least + 64 * 200, &known) {
            least = needed(&refused);
        }
        // What is too small to leave memory comes on top.
        let budget = (least + 64 * 200) * (4 + more) / 4;
        for threads in [1, 2, 4] {
            for known in [&known[..], &[]] {
                let report = tight(threads, budget, known).unwrap();
                prop_assert!(report.is_complete(), "{:?} {:?}", report.failures, report.stuck);
                prop_assert!(report.counted_bytes <= budget, "{} of {budget}", report.counted_bytes);
                agrees(&report, ports, &expected[nodes.len() - 1..])?;
            }
        }
    }
}
