//! What the executor itself costs, on one thread, in the shapes that other executors are measured in.
//!
//! - `tasks`: nodes that do next to nothing; the rate is in tasks. A chain of 1,000 nodes over 100 frames, one of 10 over 100,000, and the three
//!   graphs of 10,000 nodes that C++ task graphs are compared by: layers of 100 with 3 random predecessors each, one to many to one, and a chain.
//! - `filters`: a chain of five point filters over frames of three float planes; the rate is in frames. The filters are those of a usual chain in
//!   VapourSynth: `Invert`, `Levels(0, 1, 0.05, 0.95)`, `Expr("x 0.9 *")`, `Limiter(0, 1)`, `Invert`, over one still clip that is made once.
//! - `keys`: the keys of all tasks of a plan.
//!
//! Tasks and filters are planned and run each time; reading and checking the graph is not in it.

use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime};
use pegbar_engine::array::NdArray;
use pegbar_engine::cache::Cache;
use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{CacheUse, Options, Policy, execute};
use pegbar_engine::graph::Graph;
use pegbar_engine::key::Keys;
use pegbar_engine::node::{Context, In, List, NodeError, PerFrame};
use pegbar_engine::plan::{Known, Planned, Target, plan};
use pegbar_engine::registry::Registry;
use pegbar_engine::stamp::Files;
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Value};

/// How everything here is run: with what a show has on, a budget and a cache. The cache is empty, and nothing here is worth keeping.
fn options<'a>(files: &'a Files<'a>, cache: &Arc<Cache>) -> Options<'a> {
    let cache = CacheUse { cache: cache.clone(), files, policies: &[Policy::Auto] };
    Options { memory: Some(8 << 30), cache: Some(cache), ..Options::default() }
}

/// One number.
#[derive(Outputs)]
struct Number {
    /// It.
    value: Curve,
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "bench.frame", version = 1, outputs = Number, uses_frame)]
struct FrameNumber {}

impl PerFrame for FrameNumber {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: cx.frame as f64 } })
    }
}

/// One more than its input.
#[derive(Node)]
#[node(id = "bench.next", version = 1, outputs = Number)]
struct Next {
    /// A number.
    input: In<Curve>,
}

impl PerFrame for Next {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: self.input.value + 1.0 } })
    }
}

/// One more than the largest of its inputs: the length of the longest path to it.
#[derive(Node)]
#[node(id = "bench.depth", version = 1, outputs = Number)]
struct Depth {
    /// Numbers.
    inputs: List<In<Curve>>,
}

impl PerFrame for Depth {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: self.inputs.0.iter().map(|i| i.value).fold(0.0, f64::max) + 1.0 } })
    }
}

/// A frame of a clip.
#[derive(Clone, Debug, Value)]
struct Clip {
    /// Planes.
    #[value(shape = "[c, h, w]")]
    planes: NdArray<f32, 3>,
}

/// One frame.
#[derive(Outputs)]
struct Filtered {
    /// It.
    clip: Clip,
}

/// A still clip, black, made once.
#[derive(Node)]
#[node(id = "bench.blank", version = 1, outputs = Filtered)]
struct Blank {
    /// Columns.
    width: i64,
    /// Rows.
    height: i64,
    /// Planes.
    planes: i64,
}

impl PerFrame for Blank {
    fn run(self, _cx: &Context) -> Result<Filtered, NodeError> {
        let shape = [self.planes, self.height, self.width].map(|n| usize::try_from(n).unwrap_or(0));
        let planes = NdArray::new(shape, vec![0.0; shape.iter().product()]).ok_or_else(|| NodeError::internal("a clip of another size"))?;
        Ok(Filtered { clip: Clip { planes } })
    }
}

/// Each sample through `point`: in place where nobody else reads the frame, else into a new one without a copy before it.
fn each(clip: In<Clip>, point: impl Fn(f32) -> f32) -> Result<Filtered, NodeError> {
    let clip = match Arc::try_unwrap(clip.shared()?) {
        Ok(mut own) => {
            own.planes.data_mut().iter_mut().for_each(|v| *v = point(*v));
            own
        }
        Err(shared) => {
            let samples = shared.planes.data().iter().map(|v| point(*v)).collect();
            let planes = NdArray::new(shared.planes.shape(), samples).ok_or_else(|| NodeError::internal("a clip of another size"))?;
            Clip { planes }
        }
    };
    Ok(Filtered { clip })
}

macro_rules! filter {
    ($name:ident, $id:literal, $doc:literal, $point:expr $(, $more:ident)?) => {
        #[doc = $doc]
        #[derive(Node)]
        #[node(id = $id, version = 1, outputs = Filtered $(, $more)?)]
        struct $name {
            /// A frame.
            clip: In<Clip>,
        }

        impl PerFrame for $name {
            fn run(self, _cx: &Context) -> Result<Filtered, NodeError> {
                each(self.clip, $point)
            }
        }
    };
}

filter!(First, "bench.first", "One less the sample, of a still clip anew at each frame.", |v| 1.0 - v, uses_frame);
filter!(Invert, "bench.invert", "One less the sample.", |v| 1.0 - v);
filter!(Levels, "bench.levels", "Black and white brought closer.", |v: f32| v.clamp(0.0, 1.0) * 0.9 + 0.05);
filter!(Scale, "bench.scale", "Nine tenths of the sample.", |v| v * 0.9);
filter!(Limit, "bench.limit", "No less than nought, no more than one.", |v: f32| v.clamp(0.0, 1.0));

fn registry() -> Registry {
    let numbers = Registry::new().per_frame::<FrameNumber>().per_frame::<Next>().per_frame::<Depth>();
    numbers.per_frame::<Blank>().per_frame::<First>().per_frame::<Invert>().per_frame::<Levels>().per_frame::<Scale>().per_frame::<Limit>()
}

/// These nodes, called n0, n1 and so on, over so many frames.
fn graph_of(name: &str, nodes: &[String], frames: usize) -> Option<Graph> {
    let named: String = nodes.iter().enumerate().fold(String::new(), |mut text, (i, node)| {
        let _ = write!(text, "\"n{i}\": ({node}), ");
        text
    });
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 24), nodes: {{ {named} }})");
    let loaded = load_text(Path::new("bench.ron"), &text, &registry(), &LoadOptions::default());
    if loaded.graph.is_none() {
        eprintln!("{name}: expected a sound graph, found {} problems", loaded.diagnostics.len());
    }
    loaded.graph
}

/// Runs the last of `nodes` over so many frames.
fn measure(group: &mut BenchmarkGroup<WallTime>, name: &str, nodes: &[String], frames: usize, elements: usize) {
    let Some(graph) = graph_of(name, nodes, frames) else { return };
    let target = Target { node: nodes.len() - 1, frames: None };
    let folder = tempfile::tempdir()
        .and_then(|folder| Cache::open(folder.path(), 1 << 30).map(|cache| (Arc::new(cache), folder)).map_err(std::io::Error::other));
    let Ok((cache, _folder)) = folder else { return eprintln!("{name}: expected a folder for a cache, found none") };
    let run = || {
        let files = Files::new(None);
        execute(&graph, std::slice::from_ref(&target), &[], &options(&files, &cache)).is_ok_and(|r| r.is_complete())
    };
    assert!(run(), "{name}: expected a complete run");
    group.throughput(Throughput::Elements(elements as u64));
    group.bench_function(name, |b| b.iter(|| black_box(run())));
}

/// A chain of `n` nodes.
fn chain(n: usize) -> Vec<String> {
    let next = (1..n).map(|i| format!("type: \"bench.next\", input: \"@n{}\"", i - 1));
    std::iter::once("type: \"bench.frame\"".to_owned()).chain(next).collect()
}

/// A node with these predecessors.
fn depth(predecessors: &[usize]) -> String {
    let list: Vec<String> = predecessors.iter().map(|p| format!("\"@n{p}\"")).collect();
    format!("type: \"bench.depth\", inputs: [{}]", list.join(", "))
}

/// A hundred layers of a hundred nodes, each with three random predecessors in the layer before.
fn layered() -> Vec<String> {
    let mut seed = 1u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % 100
    };
    let mut nodes: Vec<String> = (0..10_000)
        .map(|i| if i < 100 { chain(1).remove(0) } else { depth(&[0; 3].map(|_: usize| (i / 100 - 1) * 100 + random())) })
        .collect();
    nodes.push(depth(&(9_900..10_000).collect::<Vec<_>>()));
    nodes
}

/// One node that 9,998 read, and one that reads them all.
fn fan() -> Vec<String> {
    let middle = (1..9_999).map(|_| depth(&[0]));
    chain(1).into_iter().chain(middle).chain(std::iter::once(depth(&(1..9_999).collect::<Vec<_>>()))).collect()
}

fn tasks(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("tasks");
    group.sample_size(10);
    measure(&mut group, "chain of 1,000 nodes, 100 frames", &chain(1_000), 100, 100_000);
    measure(&mut group, "chain of 10 nodes, 100,000 frames", &chain(10), 100_000, 1_000_000);
    measure(&mut group, "chain of 10,000 nodes, 1 frame", &chain(10_000), 1, 10_000);
    measure(&mut group, "layers of 100, 1 frame", &layered(), 1, 10_001);
    measure(&mut group, "one to 9,998 to one, 1 frame", &fan(), 1, 10_000);
    group.finish();
}

fn filters(criterion: &mut Criterion) {
    let clip = |width: i64, height: i64, planes: i64| {
        let blank = format!("type: \"bench.blank\", width: {width}, height: {height}, planes: {planes}");
        let filters = ["first", "levels", "scale", "limit", "invert"].iter().enumerate();
        let nodes = filters.map(|(i, f)| format!("type: \"bench.{f}\", clip: \"@n{i}\""));
        std::iter::once(blank).chain(nodes).collect::<Vec<_>>()
    };
    let mut group = criterion.benchmark_group("filters");
    group.sample_size(10).measurement_time(Duration::from_secs(10));
    measure(&mut group, "five over 1,000 frames of 16 x 16, one plane", &clip(16, 16, 1), 1_000, 1_000);
    measure(&mut group, "five over 100 frames of 1920 x 1080, three planes", &clip(1920, 1080, 3), 100, 100);
    group.finish();
}

fn keys(criterion: &mut Criterion) {
    let Some(graph) = graph_of("keys", &chain(1_000), 1_000) else { return };
    let Ok(Planned::Ready(plan)) = plan(&graph, &[Target { node: 999, frames: None }], &[], Known::new()) else { return };
    let mut group = criterion.benchmark_group("keys");
    group.throughput(Throughput::Elements(1_000_000));
    group.sample_size(10);
    group.bench_function("keys of 1,000,000 tasks", |b| {
        b.iter(|| Keys::of(&graph, &plan, &Files::new(None)).map(|k| k.task(999, 999).copied()))
    });
    group.finish();
}

criterion_group!(benches, tasks, filters, keys);
criterion_main!(benches);
