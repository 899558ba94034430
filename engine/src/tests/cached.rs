//! Runs with a cache: what is taken from it, what is computed again, and that the bits are those of a run without one.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use proptest::prelude::*;

use super::nodes::registry;
use super::random::{Log, Made, graph as random_graph, interpret, made};
use crate::cache::Cache;
use crate::check::{LoadOptions, load_text};
use crate::exec::{CacheUse, Done, Observer, Options, Policy, Report, execute};
use crate::graph::{Graph, Port};
use crate::node::Cancel;
use crate::stamp::Files;
use crate::value::{Curve, downcast};

fn graph(nodes: &str) -> Graph {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 6, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("cached.ron"), &text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

/// Runs with the cache of a folder; what ran, as `node@frame`.
fn run(graph: &Graph, keep: &[Port], folder: &Path, policy: Policy, threads: usize) -> (Report, Vec<String>) {
    let cache = Arc::new(Cache::open(folder, 1 << 30).unwrap());
    let files = Files::new(None);
    let log = Log::default();
    let with = CacheUse { cache, files: &files, policies: &[policy] };
    let report = execute(graph, &[], keep, &Options { threads, cache: Some(with), observer: &log, ..Options::default() }).unwrap();
    assert!(report.is_complete(), "{:?}", report.failures);
    let name =
        |(node, frame): (usize, Option<i64>)| format!("{}@{}", graph.nodes[node].name, frame.map_or("-".to_owned(), |f| f.to_string()));
    let mut ran: Vec<String> = log.0.into_inner().unwrap().into_iter().map(name).collect();
    ran.sort_unstable();
    (report, ran)
}

fn values(report: &Report, port: Port) -> Vec<f64> {
    report.kept[&port].iter().map(|v| downcast::<Curve>(v.clone().unwrap()).unwrap().value).collect()
}

fn port(graph: &Graph, name: &str) -> Port {
    Port { node: graph.find(name).unwrap(), output: 0 }
}

/// Runs `nodes` and gives the values of `last`, and what ran.
fn values_of(nodes: &str, folder: &Path, policy: Policy) -> (Vec<f64>, Vec<String>) {
    let graph = graph(nodes);
    let last = port(&graph, "last");
    let (report, ran) = run(&graph, &[last], folder, policy, 2);
    (values(&report, last), ran)
}

const CHAIN: &str = r#""f": (type: "test.frame"), "a": (type: "test.add", a: "@f", b: 1), "t": (type: "test.total", stream: "@a"),
    "w": (type: "test.window", stream: "@t"), "last": (type: "test.add", a: "@w", b: 5)"#;

#[test]
fn nothing_runs_twice_and_a_change_runs_what_hangs_on_it_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (first, ran) = values_of(CHAIN, folder.path(), Policy::Always);
    assert_eq!(ran.len(), 5 * 6);
    let (again, ran) = values_of(CHAIN, folder.path(), Policy::Always);
    assert_eq!((again, ran), (first.clone(), Vec::new()));
    // The last node's parameter: that node alone.
    let (other, ran) = values_of(&CHAIN.replace("b: 5", "b: 6"), folder.path(), Policy::Always);
    assert!(ran.iter().all(|r| r.starts_with("last@")) && ran.len() == 6, "{ran:?}");
    assert_eq!(other, first.iter().map(|v| v + 1.0).collect::<Vec<_>>());
    // One in the middle: what hangs on it, and nothing before it.
    let (_, ran) = values_of(&CHAIN.replace("stream: \"@t\"", "stream: \"@t\", radius: 2"), folder.path(), Policy::Always);
    assert!(ran.iter().all(|r| r.starts_with("last@") || r.starts_with("w@")) && ran.len() == 12, "{ran:?}");
}

#[test]
fn a_result_whose_bytes_did_not_change_stops_the_wave() {
    let folder = tempfile::tempdir().unwrap();
    values_of(CHAIN, folder.path(), Policy::Always);
    // One and nought is nought and one: `a` runs again, and what hangs on it does not.
    let nodes = CHAIN.replace(r#""a": (type: "test.add", a: "@f", b: 1)"#, r#""a": (type: "test.add", a: 1, b: "@f")"#);
    let (_, ran) = values_of(&nodes, folder.path(), Policy::Always);
    assert!(ran.iter().all(|r| r.starts_with("a@")) && ran.len() == 6, "{ran:?}");
    // And the next run finds it all under the new keys.
    assert_eq!(values_of(&nodes, folder.path(), Policy::Always).1, Vec::<String>::new());
}

#[test]
fn what_costs_less_to_make_than_to_keep_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _) = values_of(CHAIN, folder.path(), Policy::Never);
    let (again, ran) = values_of(CHAIN, folder.path(), Policy::Never);
    assert_eq!((again, ran.len()), (first, 30));
}

#[test]
fn a_damaged_entry_is_made_again_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _) = values_of(CHAIN, folder.path(), Policy::Always);
    let data = |e: std::fs::DirEntry| Some(e.path()).filter(|p| p.extension().is_some_and(|e| e == "data"));
    for file in std::fs::read_dir(folder.path().join("v1").join("index")).unwrap().flatten().filter_map(data) {
        let mut bytes = std::fs::read(&file).unwrap();
        bytes.iter_mut().for_each(|b| *b ^= 0x55);
        std::fs::write(&file, bytes).unwrap();
    }
    let (again, ran) = values_of(CHAIN, folder.path(), Policy::Always);
    assert_eq!(again, first);
    assert!(!ran.is_empty());
    assert_eq!(values_of(CHAIN, folder.path(), Policy::Always), (first, Vec::new()), "it is mended");
}

/// Ends the run after so many tasks.
struct StopAfter(usize, Log, Cancel);

impl Observer for StopAfter {
    fn done(&self, done: &Done) {
        let mut log = self.1.0.lock().unwrap();
        log.push((done.node, done.frame));
        if log.len() == self.0 {
            self.2.cancel();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_run_that_was_ended_is_taken_up_where_it_stood(nodes in made(), after in 1..40usize, threads in 1..3usize) {
        let expected = interpret(&nodes);
        prop_assume!(nodes.iter().all(|n| !matches!(n, Made::Centred(a) if expected[*a].len() == 1)));
        let graph = random_graph(&nodes);
        let ports: Vec<Port> = nodes.iter().enumerate().map(|(node, n)| Port { node, output: if matches!(n, Made::Centred(_)) { 2 } else { 0 } }).collect();
        let folder = tempfile::tempdir().unwrap();
        let stop = StopAfter(after, Log::default(), Cancel::default());
        {
            let cache = Arc::new(Cache::open(folder.path(), 1 << 30).unwrap());
            let files = Files::new(None);
            let with = CacheUse { cache, files: &files, policies: &[Policy::Always] };
            let options = Options { threads, cache: Some(with), observer: &stop, cancel: stop.2.clone(), ..Options::default() };
            execute(&graph, &[], &ports, &options).unwrap();
        }
        let (report, ran) = run(&graph, &ports, folder.path(), Policy::Always, threads);
        for (port, expected) in ports.iter().zip(&expected) {
            let found: Vec<u64> = values(&report, *port).iter().map(|v| v.to_bits()).collect();
            prop_assert_eq!(found, expected.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
        }
        let name = |(node, frame): &(usize, Option<i64>)| format!("{}@{}", graph.nodes[*node].name, frame.map_or("-".to_owned(), |f| f.to_string()));
        let before: BTreeSet<String> = stop.1.0.lock().unwrap().iter().map(name).collect();
        let twice: Vec<&String> = ran.iter().filter(|r| before.contains(*r)).collect();
        prop_assert!(twice.is_empty(), "{:?}", twice);
        prop_assert_eq!(run(&graph, &ports, folder.path(), Policy::Always, threads).1, Vec::<String>::new());
    }
}
