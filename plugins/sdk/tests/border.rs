//! A plugin of the SDK in a graph: every kind of node, input and setting, and what goes wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test ends with a panic where something is wrong")]

use std::path::PathBuf;
use std::sync::OnceLock;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, Report, execute};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::node::Fault;
use pegbar_engine::plan::Target;
use pegbar_engine::plugin::{ENDING, Found, LibraryFile, Manifest, PortType, describe, digest, find, platform};
use pegbar_engine::registry::Registry;

fn library() -> PathBuf {
    let name = format!("{}sums{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    // Cargo puts it beside this test, of which it is a dependency.
    std::env::current_exe().unwrap().with_file_name(name)
}

fn found() -> &'static Found {
    static FOUND: OnceLock<(tempfile::TempDir, Found)> = OnceLock::new();
    let (_, found) = FOUND.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("sums.library");
        std::fs::copy(library(), &copy).unwrap();
        let (digest, plugin) = (digest(&copy).unwrap(), describe(&copy).unwrap());
        let libraries = [(platform(), LibraryFile { file: "sums.library".to_owned(), digest })].into();
        let path = folder.path().join(format!("sums{ENDING}"));
        Manifest { libraries, plugin }.write(&path).unwrap();
        let found = find(&path).remove(0).unwrap();
        (folder, found)
    });
    found
}

fn registry() -> Registry {
    let mut registry = Registry::new();
    found().register(&mut registry).unwrap();
    registry
}

fn run(nodes: &str, port: &str) -> (Graph, Report, Port) {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 4, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(std::path::Path::new("g.ron"), &text, &registry(), &LoadOptions::default());
    let graph = loaded.graph.unwrap_or_else(|| panic!("{}", loaded.sources.render_all(&loaded.diagnostics, false)));
    let (node, output) = port.split_once('.').unwrap();
    let node = graph.find(node).unwrap();
    let port = Port { node, output: graph.nodes[node].ty.schema.output(output).unwrap().0 };
    let report = execute(&graph, &[Target { node, frames: None }], &[port], &Options { threads: 2, ..Options::default() }).unwrap();
    (graph, report, port)
}

/// The numbers of a port, frame by frame.
fn numbers(nodes: &str, port: &str) -> Vec<Vec<f64>> {
    let (_, report, port) = run(nodes, port);
    assert!(report.is_complete(), "{:?}", report.failures.iter().map(|f| &f.error.message).collect::<Vec<_>>());
    let values = report.kept[&port].iter().map(|v| v.as_ref().unwrap().parts().arrays[0].1.numbers());
    values.collect()
}

#[test]
fn inputs_and_settings_of_every_kind_arrive() {
    let plain = |more: &str| {
        let a = "\"a\": (type: \"sums.wrong\", way: \"\")";
        numbers(&format!("{a}, \"j\": (type: \"sums.join\", several: [\"@a\"], more: [(2.0, 5.0)], {more})"), "j.value")[0].clone()
    };
    assert_eq!(plain(""), [7.0, 4.0]);
    assert_eq!(plain("how: the_product"), [10.0, 4.0]);
    assert_eq!(plain("how: \"the_product\", limit: 6, factor: 0.5"), [3.0, 4.0]);
    assert_eq!(plain("maybe: [1.0, 2.0]"), [10.0, 4.0]);
    assert_eq!(plain("maybe: \"@a\", limit: None"), [7.0, 4.0]);
}

#[test]
fn values_of_six_inputs_are_blended_frame_by_frame() {
    let row = "\"a\": (type: \"sums.next\", value: [1.0, 2.0])";
    let blended = numbers(
        &format!("{row}, \"b\": (type: \"sums.blend\", one: \"@a\", other: [6.0, 7.0], amount: 0.25, offset: 1.0, skip: 1)"),
        "b.value",
    );
    assert_eq!(blended, [[5.0]]);
}

/// Large arrays go as they are, small ones as copies, and both come back with their numbers.
#[test]
fn arrays_of_any_size_arrive() {
    for count in [2, 127, 128, 129, 1000] {
        let rows =
            numbers(&format!("\"m\": (type: \"sums.make\", count: {count}), \"l\": (type: \"sums.look\", numbers: \"@m\")"), "l.value");
        let [at, made_at, more, remark] = rows[0][..] else { panic!("{rows:?}") };
        assert_eq!((at == made_at, more, remark), (count >= 128, 1.5, 11.0), "{count}");
    }
}

const FRAME: &str = "\"f\": (type: \"sums.frame\")";

#[test]
fn frames_states_and_sequences_arrive() {
    let window = |before: i64| numbers(&format!("{FRAME}, \"w\": (type: \"sums.window\", value: \"@f\", before: {before})"), "w.value");
    assert_eq!(window(0), [[1.0], [2.0], [3.0], [4.0]]);
    assert_eq!(window(2), [vec![1.0], vec![1.0, 2.0], vec![1.0, 2.0, 3.0], vec![2.0, 3.0, 4.0]]);
    let running = numbers(&format!("{FRAME}, \"r\": (type: \"sums.running\", value: \"@f\")"), "r.value");
    assert_eq!(running, [[1.0], [3.0], [6.0], [10.0]]);
    let leaping = numbers(&format!("{FRAME}, \"r\": (type: \"sums.leaping\", value: \"@f\")"), "r.value");
    assert_eq!(leaping, [[1.0], [2.0], [4.0], [6.0]]);
    let back = format!("{FRAME}, \"b\": (type: \"sums.back\", value: \"@f\")");
    assert_eq!((numbers(&back, "b.value"), numbers(&back, "b.count")), (vec![vec![4.0], vec![3.0], vec![2.0], vec![1.0]], vec![vec![4.0]]));
    let wired = format!(
        "{FRAME}, \"e\": (type: \"sums.wrong\", way: \"\"), \"j\": (type: \"sums.join\", several: [\"@e\"], more: [(1.0, 2.0)], factor: \"@f\")"
    );
    assert_eq!(numbers(&wired, "j.value"), [[3.0, 4.0], [6.0, 4.0], [9.0, 4.0], [12.0, 4.0]]);
}

#[test]
fn arrays_are_neither_copied_in_nor_out() {
    let rows = numbers("\"m\": (type: \"sums.make\", count: 500), \"l\": (type: \"sums.look\", numbers: \"@m\")", "l.value");
    let [at, made_at, more, remark] = rows[0][..] else { panic!("{rows:?}") };
    assert_eq!((at, more, remark), (made_at, 1.5, 11.0));
}

#[test]
fn a_panic_and_a_failure_are_errors_of_their_frames() {
    let (_, report, port) = run("\"w\": (type: \"sums.wrong\", way: \"panic\")", "w.value");
    let [failure] = &report.failures[..] else { panic!("{}", report.failures.len()) };
    assert_eq!(failure.frame, Some(2));
    assert_eq!(failure.error.message, "plugin `sums` 1.0.0: panicked: frame 2 is too much");
    assert_eq!(failure.error.fault, Fault::Plugin);
    assert_eq!(report.kept[&port].iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true, true]);

    let (_, report, _) = run("\"w\": (type: \"sums.wrong\", way: \"fail\")", "w.value");
    let [failure] = &report.failures[..] else { panic!("{}", report.failures.len()) };
    assert_eq!(
        (failure.frame, failure.error.message.as_str(), failure.error.fault),
        (Some(2), "expected another frame, found this", Fault::Input)
    );
    assert_eq!(failure.error.help.as_deref(), Some("leave it out"));
}

#[test]
fn the_manifest_says_what_the_declarations_say() {
    let plugin = &found().manifest.plugin;
    let ids: Vec<&str> = plugin.nodes.iter().map(|n| n.id.as_str()).collect();
    assert_eq!(
        ids,
        [
            "sums.back",
            "sums.blend",
            "sums.frame",
            "sums.join",
            "sums.leaping",
            "sums.look",
            "sums.make",
            "sums.next",
            "sums.running",
            "sums.window",
            "sums.wrong"
        ]
    );
    let join = &plugin.nodes[3];
    let input = |name: &str| join.inputs.iter().find(|i| i.name == name).unwrap();
    assert_eq!(input("limit").range, Some((0.0, f64::from(u32::MAX))));
    assert!(input("limit").optional && input("maybe").optional && input("several").list && input("factor").wire);
    assert_eq!(input("how").ty, PortType::Setting("sum | the_product".to_owned()));
    assert_eq!(input("how").choices[1], ("the_product".to_owned(), "Product.".to_owned()));
    assert!(plugin.nodes[4].asks && plugin.nodes[9].asks && !plugin.nodes[10].asks && !plugin.nodes[8].asks);
}
