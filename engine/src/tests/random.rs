//! Random graphs, run by the executor and by a plain interpreter that makes one frame after the other: bits equal, each task once.

use std::path::Path;
use std::sync::Mutex;

use proptest::prelude::*;

use crate::check::{LoadOptions, load_text};
use crate::exec::{Done, Observer, Options, execute};
use crate::graph::{Graph, Port};
use crate::value::{Curve, downcast};

use super::nodes::registry;

pub(super) const FRAMES: usize = 6;

/// A node of a random graph; references are to earlier nodes.
#[derive(Clone, Debug)]
pub(super) enum Made {
    Frame,
    Constant(f64),
    Add(usize, usize),
    Window(usize, usize),
    Total(usize, i64),
    /// Each value less the mean of all.
    Centred(usize),
    /// The sum of some frames.
    Some(usize, Vec<i64>),
    /// Played backwards, by a map that another node computes.
    Back(usize),
}

pub(super) fn made() -> impl Strategy<Value = Vec<Made>> {
    let node = (0..8u8, any::<proptest::sample::Index>(), any::<proptest::sample::Index>(), 0..4usize, 1..=FRAMES as i64, -8..8i32);
    proptest::collection::vec(node, 1..14).prop_map(|list| {
        let one = |(i, (kind, a, b, radius, start, value)): (usize, _)| {
            let (a, b): (proptest::sample::Index, proptest::sample::Index) = (a, b);
            match (i, kind) {
                (0, _) | (_, 0) => Made::Frame,
                (_, 1) => Made::Constant(f64::from(value) / 8.0),
                (_, 2) => Made::Add(a.index(i), b.index(i)),
                (_, 3) => Made::Window(a.index(i), radius),
                (_, 4) => Made::Total(a.index(i), start),
                (_, 5) => Made::Centred(a.index(i)),
                (_, 6) => Made::Some(a.index(i), (start..=FRAMES as i64).step_by(radius + 1).collect()),
                _ => Made::Back(a.index(i)),
            }
        };
        list.into_iter().enumerate().map(one).collect()
    })
}

/// What a node gives at each frame; one value where it is the same for the whole graph.
pub(super) fn interpret(nodes: &[Made]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for node in nodes {
        let at = |n: usize, k: usize| out[n][k.min(out[n].len() - 1)];
        let frames = |sources: &[usize]| if sources.iter().all(|&n| out[n].len() == 1) { 1 } else { FRAMES };
        out.push(match node.clone() {
            Made::Frame => (0..FRAMES).map(|k| (k + 1) as f64).collect(),
            Made::Constant(value) => vec![value],
            Made::Add(a, b) => (0..frames(&[a, b])).map(|k| at(a, k) + at(b, k)).collect(),
            Made::Window(a, radius) => {
                let mean = |k: usize| {
                    let (k, r) = (k as i64, radius as i64);
                    let sum = (k - r..=k + r).fold(0.0, |sum, j| sum + at(a, j.clamp(0, FRAMES as i64 - 1) as usize));
                    sum / (2 * radius + 1) as f64
                };
                (0..frames(&[a])).map(mean).collect()
            }
            Made::Total(a, start) => totals(frames(&[a]), start as usize - 1, |k| at(a, k)),
            Made::Centred(a) => {
                let mean = out[a].iter().sum::<f64>() / out[a].len() as f64;
                out[a].iter().map(|v| v - mean).collect()
            }
            Made::Some(a, frames) => vec![frames.iter().fold(0.0, |sum, &f| sum + at(a, f as usize - 1))],
            Made::Back(a) => (0..FRAMES).map(|k| at(a, FRAMES - 1 - k)).collect(),
        });
    }
    out
}

/// Sums from a frame on, in both directions.
fn totals(frames: usize, start: usize, at: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut out = vec![0.0; frames];
    if frames == 1 {
        return vec![0.0 + at(0)];
    }
    out[start] = 0.0 + at(start);
    (start + 1..frames).for_each(|k| out[k] = out[k - 1] + at(k));
    (0..start).rev().for_each(|k| out[k] = out[k + 1] + at(k));
    out
}

pub(super) fn graph(nodes: &[Made]) -> Graph {
    let reference = |n: usize| match nodes[n] {
        Made::Centred(_) => format!("\"@n{n}.centred\""),
        _ => format!("\"@n{n}\""),
    };
    let text = nodes.iter().enumerate().map(|(i, node)| {
        let body = match node.clone() {
            Made::Frame => "type: \"test.frame\"".to_owned(),
            Made::Constant(value) => format!("type: \"test.add\", a: {value:?}"),
            Made::Add(a, b) => format!("type: \"test.add\", a: {}, b: {}", reference(a), reference(b)),
            Made::Window(a, radius) => format!("type: \"test.window\", stream: {}, radius: {radius}", reference(a)),
            Made::Total(a, start) => format!("type: \"test.total\", stream: {}, start: {start}", reference(a)),
            Made::Centred(a) => format!("type: \"test.summary\", stream: {}", reference(a)),
            Made::Some(a, frames) => format!("type: \"test.some\", stream: {}, frames: {frames:?}", reference(a)),
            Made::Back(a) => format!("type: \"test.retime\", stream: {}, map: \"@n0s.map\"", reference(a)),
        };
        format!("\"n{i}\": ({body}), ")
    });
    let nodes = text.collect::<String>() + "\"n0s\": (type: \"test.summary\", stream: \"@n0\")";
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {FRAMES}, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("random.ron"), &text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

#[derive(Default)]
pub(super) struct Log(pub(super) Mutex<Vec<(usize, Option<i64>)>>);

impl Observer for Log {
    fn done(&self, done: &Done) {
        self.0.lock().unwrap().push((done.node, done.frame));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn the_executor_agrees_with_a_plain_interpreter(nodes in made(), in_flight in 0..4usize) {
        // A whole node of a single value gives one centred value for it, though its port is a stream: those graphs are other ones.
        let expected = interpret(&nodes);
        let is_fine = nodes.iter().all(|n| !matches!(n, Made::Centred(a) if expected[*a].len() == 1));
        prop_assume!(is_fine);
        let graph = graph(&nodes);
        let ports: Vec<Port> = nodes.iter().enumerate().map(|(node, n)| Port { node, output: if matches!(n, Made::Centred(_)) { 2 } else { 0 } }).collect();
        for threads in [1, 3] {
            let log = Log::default();
            let report = execute(&graph, &[], &ports, &Options { threads, in_flight, observer: &log, ..Options::default() }).unwrap();
            prop_assert!(report.is_complete(), "{:?}", report.failures);
            for (port, expected) in ports.iter().zip(&expected) {
                let kept = &report.kept[port];
                let found: Vec<u64> = kept.iter().map(|v| downcast::<Curve>(v.clone().unwrap()).unwrap().value.to_bits()).collect();
                let expected: Vec<u64> = expected.iter().map(|v| v.to_bits()).collect();
                prop_assert_eq!(found, expected, "{}", graph.port_name(*port));
            }
            let mut ran = log.0.into_inner().unwrap();
            // The map that decides what is read is made in a stage of its own, and what it hangs on is made there too.
            let is_staged = nodes.iter().any(|n| matches!(n, Made::Back(_)));
            if !is_staged {
                let count = ran.len();
                ran.sort_unstable();
                ran.dedup();
                prop_assert_eq!(ran.len(), count, "no task twice");
                let tasks: usize = (0..nodes.len()).map(|n| if graph.nodes[n].runs_once() { 1 } else { FRAMES }).sum();
                prop_assert_eq!(count, tasks, "each needed task");
            }
        }
    }
}
