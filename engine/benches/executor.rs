//! What the executor itself costs: a chain of 1,000 trivial nodes over 100 frames, on one thread. Divide by 100,000 for one task.

use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Graph;
use pegbar_engine::key::Keys;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::plan::{Known, Planned, Target, plan};
use pegbar_engine::registry::Registry;
use pegbar_engine::stamp::Files;
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

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

/// A chain of `nodes` trivial nodes over `frames` frames.
fn chain_of(nodes: usize, frames: usize) -> Option<Graph> {
    let chain: Vec<String> = (1..nodes).map(|i| format!("\"n{i}\": (type: \"bench.next\", input: \"@n{}\")", i - 1)).collect();
    let text = format!(
        "Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 24), nodes: {{ \"n0\": (type: \"bench.frame\"), {} }})",
        chain.join(", ")
    );
    let registry = Registry::new().per_frame::<FrameNumber>().per_frame::<Next>();
    load_text(Path::new("chain.ron"), &text, &registry, &LoadOptions::default()).graph
}

fn chain(criterion: &mut Criterion) {
    let Some(graph) = chain_of(1000, 100) else { return };
    let target = Target { node: 999, frames: None };
    let mut group = criterion.benchmark_group("executor");
    group.throughput(Throughput::Elements(100_000));
    group.sample_size(20);
    group.bench_function("chain of 1,000 nodes, 100 frames, one thread", |b| {
        b.iter(|| execute(&graph, std::slice::from_ref(&target), &[], &Options::default()).map(|r| r.is_complete()));
    });
    group.finish();
}

fn keys(criterion: &mut Criterion) {
    let Some(graph) = chain_of(1000, 1000) else { return };
    let Ok(Planned::Ready(plan)) = plan(&graph, &[Target { node: 999, frames: None }], &[], Known::new()) else { return };
    let mut group = criterion.benchmark_group("keys");
    group.throughput(Throughput::Elements(1_000_000));
    group.sample_size(10);
    group.bench_function("keys of 1,000,000 tasks", |b| {
        b.iter(|| Keys::of(&graph, &plan, &Files::new(None)).map(|k| k.task(999, 999).copied()))
    });
    group.finish();
}

criterion_group!(benches, chain, keys);
criterion_main!(benches);
