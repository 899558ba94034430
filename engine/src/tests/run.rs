//! What runs, in which numbers it ends, and what happens when it goes wrong.

use std::path::Path;
use std::sync::Mutex;

use crate::check::{LoadOptions, load_text};
use crate::exec::{Done, Observer, Options, Report, execute, run_plan};
use crate::graph::Graph;
use crate::plan::{Known, Planned, Target, plan};
use crate::value::downcast;

use super::nodes::{clock, registry};

fn graph(nodes: &str) -> Graph {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 8, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("test.ron"), &text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

/// The values of the first output of the node `name`, one a frame.
fn values(graph: &Graph, name: &str, threads: usize) -> Vec<f64> {
    let (node, output) = name.split_once('.').unwrap_or((name, ""));
    let node = graph.find(node).unwrap();
    let output = graph.nodes[node].ty.schema.output(output).map_or(0, |(i, _)| i);
    let port = crate::graph::Port { node, output };
    let mut report = execute(graph, &[], &[port], &Options { threads, ..Options::default() }).unwrap();
    assert!(report.is_complete(), "{:?}", report.failures);
    let kept = report.kept.remove(&port).unwrap();
    kept.into_iter().map(|v| downcast::<crate::value::Curve>(v.unwrap()).unwrap().value).collect()
}

#[test]
fn every_kind_of_node_gives_the_closed_form() {
    let graph = graph(
        r#""f": (type: "test.frame"),
           "one": (type: "test.add", a: 1.0),
           "sum": (type: "test.add", a: "@f", b: "@one"),
           "mean": (type: "test.window", stream: "@f", radius: 2),
           "total": (type: "test.total", stream: "@f", start: 3),
           "all": (type: "test.summary", stream: "@f"),
           "back": (type: "test.retime", stream: "@f", map: "@all.map"),
           "twice": (type: "test.retime", stream: "@back", map: "@all.map")"#,
    );
    for threads in [1, 4] {
        assert_eq!(values(&graph, "one", threads), [1.0], "a value that does not change is made once");
        assert_eq!(values(&graph, "sum", threads), [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        assert_eq!(values(&graph, "mean", threads), [1.6, 2.2, 3.0, 4.0, 5.0, 6.0, 6.8, 7.4]);
        assert_eq!(values(&graph, "total", threads), [6.0, 5.0, 3.0, 7.0, 12.0, 18.0, 25.0, 33.0]);
        assert_eq!(values(&graph, "all.sum", threads), [36.0]);
        assert_eq!(values(&graph, "all.centred", threads), [-3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5]);
        assert_eq!(values(&graph, "back", threads), [8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0]);
        assert_eq!(values(&graph, "twice", threads), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    }
}

#[derive(Default)]
struct Log(Mutex<Vec<(usize, Option<i64>)>>);

impl Observer for Log {
    fn done(&self, done: &Done) {
        self.0.lock().unwrap().push((done.node, done.frame));
    }
}

fn run(graph: &Graph, targets: &[Target], threads: usize) -> (Report, Vec<(String, Option<i64>)>) {
    let log = Log::default();
    let report = execute(graph, targets, &[], &Options { threads, observer: &log, ..Options::default() }).unwrap();
    let ran = log.0.into_inner().unwrap().into_iter().map(|(n, f)| (graph.nodes[n].name.clone(), f)).collect();
    (report, ran)
}

fn target(graph: &Graph, name: &str, frames: &[i64]) -> Target {
    Target { node: graph.find(name).unwrap(), frames: Some(frames.to_vec()) }
}

#[test]
fn only_what_a_sink_needs_runs_and_each_frame_is_finished_before_the_next() {
    let graph = graph(
        r#""f": (type: "test.frame"), "unused": (type: "test.add", a: "@f"),
           "a": (type: "test.add", a: "@f", b: 1.0), "out": (type: "test.sink", streams: ["@a", "@f"])"#,
    );
    let (report, ran) = run(&graph, &[target(&graph, "out", &[2, 5])], 1);
    assert!(report.is_complete());
    let expected = [("f", 2), ("a", 2), ("out", 2), ("f", 5), ("a", 5), ("out", 5)];
    assert_eq!(ran, expected.map(|(n, f)| (n.to_owned(), Some(f))));
}

#[test]
fn of_a_sequence_only_those_frames_are_made_that_are_asked_for() {
    let graph = graph(
        r#""f": (type: "test.frame"), "a": (type: "test.add", a: "@f", b: 1.0), "some": (type: "test.some", stream: "@a", frames: [7, 2]),
           "out": (type: "test.sink", streams: "@some")"#,
    );
    let (report, ran) = run(&graph, &[target(&graph, "out", &[1])], 1);
    assert!(report.is_complete());
    let of = |name: &str| ran.iter().filter(|(n, _)| n == name).filter_map(|(_, f)| *f).collect::<Vec<_>>();
    assert_eq!((of("f"), of("a")), (vec![7, 2], vec![7, 2]));
    let graph = self::graph(r#""f": (type: "test.frame"), "some": (type: "test.some", stream: "@f", frames: [3, 9])"#);
    let error = execute(&graph, &[target(&graph, "some", &[1])], &[], &Options::default()).unwrap_err().error;
    assert_eq!(error.message, "expected frames 1 to 8 of the clock `frames`, asked for frame 9");
}

#[test]
fn a_result_is_dropped_after_its_last_reader() {
    let graph = graph(
        r#""f": (type: "test.frame"), "a": (type: "test.add", a: "@f"), "b": (type: "test.add", a: "@a"), "out": (type: "test.sink", streams: "@b")"#,
    );
    let report =
        execute(&graph, &[target(&graph, "out", &[1, 2, 3, 4, 5, 6, 7, 8])], &[], &Options { in_flight: 1, ..Options::default() }).unwrap();
    assert_eq!(report.peak_bytes, 8 + 64, "one number of eight bytes is alive at a time");
}

#[test]
fn a_failure_stops_what_hangs_on_it_and_nothing_else() {
    for (panic, message) in [("false", "expected a good frame, found a bad one"), ("true", "panicked: it fell over")] {
        let graph = graph(&format!(
            r#""f": (type: "test.frame"), "bad": (type: "test.fail", a: "@f", panic: {panic}), "next": (type: "test.add", a: "@bad"),
               "fine": (type: "test.add", a: "@f"), "out": (type: "test.sink", streams: "@next"), "other": (type: "test.sink", streams: "@fine")"#
        ));
        let frames = [1, 2, 3, 4];
        let (report, ran) = run(&graph, &[target(&graph, "out", &frames), target(&graph, "other", &frames)], 2);
        assert_eq!(report.failures.len(), 1);
        let failure = &report.failures[0];
        assert_eq!((graph.nodes[failure.node].name.as_str(), failure.frame), ("bad", Some(3)));
        assert_eq!(failure.error.message, message);
        assert_eq!(failure.inputs, ["a: Curve []"]);
        assert_eq!(report.unreached, 1);
        assert_eq!(ran.iter().filter(|(n, _)| n == "other").count(), 4);
        assert_eq!(ran.iter().filter(|(n, _)| n == "out").count(), 3);
    }
}

#[test]
fn a_cancelled_run_ends_and_says_so() {
    let graph = graph(r#""f": (type: "test.frame"), "out": (type: "test.sink", streams: "@f")"#);
    let options = Options { threads: 2, ..Options::default() };
    options.cancel.cancel();
    let report = execute(&graph, &[target(&graph, "out", &[1, 2])], &[], &options).unwrap();
    assert!(report.cancelled && !report.is_complete());
}

#[test]
fn clocks_count_their_frames() {
    let clock = clock(-2, 3);
    assert_eq!((clock.len(), clock.index(-2), clock.index(3), clock.index(4)), (6, Some(0), Some(5), None));
    assert_eq!(clock.frames().collect::<Vec<_>>(), [-2, -1, 0, 1, 2, 3]);
}

#[test]
fn a_run_in_which_nothing_can_move_ends_and_says_who_waits_for_whom() {
    let graph = graph(r#""f": (type: "test.frame"), "g": (type: "test.add", a: "@f"), "h": (type: "test.add", a: "@g")"#);
    let f = graph.find("f").unwrap();
    let Ok(Planned::Ready(mut plan)) = plan(&graph, &[target(&graph, "h", &[1, 2])], &[], Known::new()) else { panic!("no plan") };
    // Nobody hears that `f` is done.
    plan.nodes[f].consumers.clear();
    for threads in [1, 3] {
        let report = run_plan(&graph, &plan, threads);
        let waits = "g@1 waits for nothing that is open; g@2 waits for nothing that is open; h@1 waits for g@1; h@2 waits for g@2";
        assert_eq!((report.stuck.as_deref(), report.is_complete()), (Some(waits), false), "{threads} threads");
    }
}
