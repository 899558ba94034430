//! Keys: what changes them, and what does not.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::check::{LoadOptions, load};
use crate::exec::{Options, execute};
use crate::graph::{Graph, Port};
use crate::key::{Keys, files_of, files_of_plan};
use crate::node::{InputSchema, InputType, Kind};
use crate::plan::{Known, Plan, Planned, Target, plan};
use crate::stamp::Files;

use super::check_nodes::registry;

/// Keys of values by port and frame.
type Found = BTreeMap<(String, i64), [u8; 32]>;

pub(super) const FRAMES: &str = "frames: (first: 1, last: 4, fps: 24)";

/// A graph of these nodes in a folder.
fn graph_in(folder: &Path, head: &str, nodes: &str) -> Graph {
    let path = folder.join("main.ron");
    std::fs::write(&path, format!("Graph(pegbar: 1, {head}, nodes: {{ {nodes} }})")).unwrap();
    let loaded = load(&path, &registry(), &LoadOptions { out: folder.join("out"), ..LoadOptions::default() });
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

/// The plan of all nodes, where need be with values that decide what is read.
pub(super) fn planned(graph: &Graph) -> Plan {
    plan_of(graph, &(0..graph.nodes.len()).map(|node| Target { node, frames: None }).collect::<Vec<_>>())
}

/// The plan of some nodes.
pub(super) fn plan_of(graph: &Graph, targets: &[Target]) -> Plan {
    let mut known = Known::new();
    loop {
        match plan(graph, targets, &[], known.clone()).unwrap_or_else(|e| panic!("{}", e.error)) {
            Planned::Ready(plan) => return plan,
            Planned::First(ports) => {
                let mut report = execute(graph, &[], &ports, &Options::default()).unwrap_or_else(|e| panic!("{}", e.error));
                known.extend(ports.into_iter().map(|p| (p, report.kept.remove(&p).unwrap().remove(0).unwrap())));
            }
        }
    }
}

/// The keys of every output, by node, output and frame.
fn keys(graph: &Graph) -> Found {
    let keys = found(graph, &planned(graph));
    let mut out = BTreeMap::new();
    for (node, spec) in graph.nodes.iter().enumerate() {
        for output in 0..spec.ty.schema.outputs.len().max(1) {
            let port = Port { node, output };
            let values = if graph.is_single(port) { 1 } else { spec.clock.len() };
            for index in 0..values {
                let key = keys.value(node, output, index);
                out.insert((graph.port_name(port), spec.clock.first + index as i64), key);
            }
        }
    }
    out
}

pub(super) fn found(graph: &Graph, plan: &Plan) -> Keys {
    Keys::of(graph, plan, &Files::new(None)).unwrap_or_else(|e| panic!("{}", e.error))
}

fn keys_of(nodes: &str) -> Found {
    keys(&graph_in(tempfile::tempdir().unwrap().path(), FRAMES, nodes))
}

/// Frames of `port` whose keys differ.
fn changed(before: &Found, after: &Found, port: &str) -> Vec<i64> {
    before.iter().filter(|((p, _), _)| p == port).filter(|(k, h)| after.get(*k) != Some(*h)).map(|((_, f), _)| *f).collect()
}

pub(super) const NODES: &str = r#"
    "f": (type: "test.frame"), "one": (type: "test.add", a: 1.0), "sum": (type: "test.add", a: "@f", b: "@one"),
    "mean": (type: "test.window", stream: "@sum"), "total": (type: "test.total", stream: "@sum", start: 2),
    "all": (type: "test.summary", stream: "@sum"), "back": (type: "test.retime", stream: "@sum", map: "@all.map"),
    "mix": (type: "test.blend", mode: linear, knots: [(1, 2)], more: "@all"), "sink": (type: "test.sink", streams: ["@f", "@mean"])"#;

#[test]
fn every_value_has_a_key_of_its_own() {
    let keys = keys_of(NODES);
    let different: BTreeSet<&[u8]> = keys.values().map(<[u8; 32]>::as_slice).collect();
    // The state of a chain and its value are told apart by their names, and so is all else.
    assert_eq!(different.len(), keys.len());
    assert_eq!(keys, keys_of(NODES), "keys are the same every time");
}

/// The same graph written by somebody else: in another order, with other names, defaults written out, and comments.
const REWRITTEN: &str = r#"
    // Nothing reads this.
    "unrelated": (type: "test.add", a: 7),
    "sink": (type: "test.sink", streams: ["@number.value", "@mean.value",]),
    "mix": (type: "test.blend", more: "@all.sum", label: r"plain", mode: "linear", limit: None, knots: [(1.0, 2e0,), ], least: 0),
    "back": (type: "test.retime", map: "@all.map", clock: "frames", stream: "@both"),
    "all": (type: "test.summary", stream: "@both"),
    "total": (type: "test.total", start: /* the second */ 2, stream: "@both"),
    "mean": (type: "test.window", radius: 1, stream: "@both"),
    "both": (type: "test.add", a: "@number", b: "@one"),
    "one": (b: 0, type: "test.add", a: 1.00),
    "number": (type: "test.frame"),"#;

#[test]
fn layout_names_and_defaults_do_not_matter() {
    let rewritten = keys_of(REWRITTEN);
    for ((port, frame), key) in keys_of(NODES) {
        let port = if let Some(output) = port.strip_prefix("sum.") { format!("both.{output}") } else { port };
        let port = if let Some(output) = port.strip_prefix("f.") { format!("number.{output}") } else { port };
        assert_eq!(rewritten.get(&(port.clone(), frame)), Some(&key), "{port} at {frame}");
    }
}

#[test]
fn a_change_is_seen_by_what_hangs_on_it_alone() {
    let before = keys_of(NODES);
    let after = keys_of(&NODES.replace("start: 2", "start: 3"));
    assert_eq!(changed(&before, &after, "total.value"), [1, 2, 3, 4]);
    for port in ["f.value", "sum.value", "mean.value", "all.sum", "back.value", "mix.value"] {
        assert_eq!(changed(&before, &after, port), [0_i64; 0], "{port}");
    }
    let after = keys_of(&NODES.replace("a: 1.0", "a: 1.5"));
    for port in ["sum.value", "mean.value", "total.value", "back.value"] {
        assert_eq!(changed(&before, &after, port), [1, 2, 3, 4], "{port}");
    }
    assert_eq!(changed(&before, &after, "mix.value"), [1]);
    assert_eq!(changed(&before, &after, "f.value"), [0_i64; 0]);
}

#[test]
fn a_longer_shot_keeps_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let nodes = r#""k": (type: "test.add", a: 1), "s": (type: "test.add", a: "@k", b: "@p"), "t": (type: "test.total", stream: "@s"),
        "p": (type: "test.read", path: "p.#.txt"), "w": (type: "test.window", stream: "@p")"#;
    (1..=6).for_each(|f| std::fs::write(folder.path().join(format!("p.{f}.txt")), vec![0; f]).unwrap());
    let before = keys(&graph_in(folder.path(), FRAMES, nodes));
    let after = keys(&graph_in(folder.path(), "frames: (first: 1, last: 6, fps: 24)", nodes));
    for port in ["k.value", "s.value", "t.value", "p.value"] {
        assert_eq!(changed(&before, &after, port), [0_i64; 0], "{port}");
    }
    assert_eq!(changed(&before, &after, "w.value"), [4], "the window was cut short at the end");
    let faster = keys(&graph_in(folder.path(), "frames: (first: 1, last: 4, fps: 25)", nodes));
    assert_eq!(changed(&before, &faster, "s.value"), [1, 2, 3, 4]);
    assert_eq!(changed(&before, &faster, "k.value"), [0_i64; 0], "a value for the whole graph has no rate");
}

#[test]
fn frames_with_equal_inputs_share_a_key_unless_the_node_sees_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("p.1.txt"), "x").unwrap();
    let nodes = r#""p": (type: "test.read", path: "p.#.txt", missing: hold), "f": (type: "test.frame"), "a": (type: "test.add", a: "@p")"#;
    let keys = keys(&graph_in(folder.path(), FRAMES, nodes));
    let of = |port: &str| keys.iter().filter(|((p, _), _)| p == port).map(|(_, h)| *h).collect::<BTreeSet<_>>().len();
    assert_eq!((of("p.value"), of("f.value")), (4, 4));
}

#[test]
fn files_count_by_their_contents() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let nodes = r#""p": (type: "test.read", path: "p.#.txt"), "q": (type: "test.read", path: "q.txt"), "a": (type: "test.add", a: "@p", b: "@q"),
        "w": (type: "test.write", value: "@a", path: "$out/w.#.txt")"#;
    for (name, text) in
        [("p.1.txt", "a"), ("p.2.txt", "b"), ("p.3.txt", "c"), ("p.4.txt", "d"), ("q.txt", "e"), ("r.txt", "e"), ("q.dat", "e")]
    {
        put(name, text);
    }
    let read = |nodes: &str| keys(&graph_in(folder.path(), FRAMES, nodes));
    let before = read(nodes);
    put("p.3.txt", "c");
    assert_eq!(read(nodes), before, "a file that is written again with the same content");
    assert_eq!(read(&nodes.replace("q.txt", "r.txt")), before, "the same content elsewhere");
    assert_ne!(read(&nodes.replace("q.txt", "q.dat")), before, "the ending tells how a file is read");
    put("p.3.txt", "C");
    assert_eq!(changed(&before, &read(nodes), "a.value"), [3]);
    let elsewhere = read(&nodes.replace("$out/w", "$out/v"));
    assert_eq!(changed(&before, &elsewhere, "w"), [1, 2, 3, 4], "a file that is written elsewhere is another");
    std::fs::remove_file(folder.path().join("p.2.txt")).unwrap();
    let held = nodes.replace("p.#.txt\"", "p.#.txt\", missing: hold");
    let before = read(&held);
    put("p.1.txt", "A");
    assert_eq!(changed(&before, &read(&held), "p.value"), [1, 2], "frame 2 shows the file of frame 1");
}

#[test]
fn a_file_that_cannot_be_read_is_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("q.txt"), "x").unwrap();
    let graph = graph_in(folder.path(), FRAMES, r#""q": (type: "test.read", path: "q.txt"), "a": (type: "test.add", a: "@q")"#);
    std::fs::remove_file(folder.path().join("q.txt")).unwrap();
    let plan = planned(&graph);
    let error = Keys::of(&graph, &plan, &Files::new(None)).err().unwrap();
    assert_eq!(error.node, 0);
    assert!(error.error.message.contains("q.txt"), "{}", error.error.message);
}

#[test]
fn a_long_chain_overflows_no_stack() {
    let nodes = r#""f": (type: "test.frame"), "t": (type: "test.total", stream: "@f")"#;
    let graph = graph_in(tempfile::tempdir().unwrap().path(), "frames: (first: 1, last: 50000, fps: 24)", nodes);
    let plan = planned(&graph);
    let keys = found(&graph, &plan);
    let different: BTreeSet<_> = (0..50_000).map(|task| keys.task(1, task).copied()).collect();
    assert!(different.len() == 50_000 && !different.contains(&None));
    assert_eq!(keys.task(1, 50_000), None);
}

#[test]
fn only_what_is_wanted_has_a_key() {
    let nodes = r#""f": (type: "test.frame"), "t": (type: "test.total", stream: "@f", start: 3), "w": (type: "test.window", stream: "@f")"#;
    let graph = graph_in(tempfile::tempdir().unwrap().path(), FRAMES, nodes);
    let target = |name: &str, frame| Target { node: graph.find(name).unwrap(), frames: Some(vec![frame]) };
    let Ok(Planned::Ready(part)) = plan(&graph, &[target("t", 2), target("w", 1)], &[], Known::new()) else { panic!("no plan") };
    let (part, whole) = (found(&graph, &part), found(&graph, &planned(&graph)));
    let has = |name: &str| (0..5).map(|k| part.task(graph.find(name).unwrap(), k).is_some()).collect::<Vec<_>>();
    assert_eq!(has("f"), [true, true, true, false, false]);
    assert_eq!(has("t"), [false, true, true, false, false]);
    assert_eq!(has("w"), [true, false, false, false, false]);
    for (node, task) in [(0, 0), (0, 2), (1, 1), (1, 2), (2, 0)] {
        assert_eq!(part.task(node, task), whole.task(node, task), "a key does not hang on what else is wanted");
    }
}

#[test]
fn content_keys_tell_tasks_apart_by_what_they_read() {
    let graph = graph_in(tempfile::tempdir().unwrap().path(), FRAMES, NODES);
    let plan = planned(&graph);
    let keys = found(&graph, &plan);
    let digest = |salt: u8| move |edge: usize, index: usize| Some([edge as u8 + 1, index as u8, salt].repeat(11)[..32].try_into().unwrap());
    let mut all = BTreeSet::new();
    let mut tasks = 0;
    for (node, spec) in graph.nodes.iter().enumerate() {
        for task in 0..plan.nodes[node].wanted.len() {
            let of = |salt| keys.content(&graph, &plan, node, task, digest(salt));
            assert_eq!(of(0), of(0));
            assert_eq!(keys.content(&graph, &plan, node, task, |_, _| None), None);
            let reads = !plan.nodes[node].edges.is_empty();
            assert_eq!(of(0).is_some(), reads, "{}", spec.name);
            if reads {
                tasks += 1;
                assert_ne!(of(0), of(1), "{}", spec.name);
                assert_ne!(of(0).as_ref(), keys.task(node, task));
                all.insert(of(0));
            }
        }
    }
    assert_eq!(all.len(), tasks, "node, frame and position count as in a key");
    assert!(tasks > 20);
}

#[test]
fn equal_contents_give_equal_content_keys_whatever_led_to_them() {
    let graph = |b: &str| graph_in(tempfile::tempdir().unwrap().path(), FRAMES, &NODES.replace("b: \"@one\"", b));
    let (wired, other) = (graph("b: \"@one\""), graph("b: 1.0"));
    let content = |graph: &Graph, name: &str| {
        let (plan, node) = (planned(graph), graph.find(name).unwrap());
        found(graph, &plan).content(graph, &plan, node, 1, |_, index| Some([index as u8; 32]))
    };
    assert_eq!(content(&wired, "mean"), content(&other, "mean"));
    assert_eq!(content(&wired, "total"), content(&other, "total"));
    assert_ne!(content(&wired, "sum"), content(&other, "sum"));
}

#[test]
fn the_files_of_a_task_are_those_that_its_reader_opens() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["p.1.txt", "p.3.txt", "q.txt"] {
        std::fs::write(folder.path().join(name), name).unwrap();
    }
    let nodes = r#""p": (type: "test.read", path: "p.#.txt", missing: nearest), "q": (type: "test.read", path: "q.txt"), "a": (type: "test.add", a: "@p", b: "@q")"#;
    let graph = graph_in(folder.path(), FRAMES, nodes);
    let names = |files: Vec<std::path::PathBuf>| {
        files.into_iter().map(|f| f.file_name().unwrap().to_string_lossy().into_owned()).collect::<Vec<_>>()
    };
    let of = |node, task| names(files_of(&graph, node, task));
    assert_eq!([of(0, 0), of(0, 1), of(0, 2), of(0, 3)], [["p.1.txt"], ["p.1.txt"], ["p.3.txt"], ["p.3.txt"]]);
    assert_eq!((of(1, 0), of(2, 0).len()), (vec!["q.txt".to_owned()], 0));
    assert_eq!(names(files_of_plan(&graph, &planned(&graph))), ["p.1.txt", "p.3.txt", "q.txt"]);
}

/// Two literals of an input that differ, or two references.
fn variants(input: &InputSchema) -> [String; 2] {
    let quoted = |a: &str, b: &str| [format!("\"{a}\""), format!("\"{b}\"")];
    match &input.ty {
        InputType::Setting { .. } if input.choices.len() > 1 => [input.choices[0].name.to_owned(), input.choices[1].name.to_owned()],
        InputType::Setting { name, .. } => match name.as_str() {
            "number" if input.name == "greatest" => ["1".to_owned(), "2".to_owned()],
            "number" => ["0.25".to_owned(), "0.5".to_owned()],
            "whole number" => ["1".to_owned(), "2".to_owned()],
            "true or false" => ["true".to_owned(), "false".to_owned()],
            "list of whole numbers" => ["[1]".to_owned(), "[2]".to_owned()],
            "list of pairs of numbers" => ["[]".to_owned(), "[(0, 1)]".to_owned()],
            "text" if input.name == "of" => quoted("Curve", "Vector"),
            "text" => quoted("a", "b"),
            "clock" => quoted("frames", "other"),
            "path to read" => quoted("a.txt", "b.txt"),
            "path to write" => quoted("a.##.txt", "b.##.txt"),
            other => panic!("a pair of literals of the type {other}"),
        },
        InputType::Value("TimeMap") => quoted("@maps.map", "@maps2.map"),
        _ if input.access == crate::node::Access::Constant => quoted("@k1", "@k2"),
        _ => quoted("@s1", "@s2"),
    }
}

#[test]
fn whatever_is_changed_changes_the_key() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.txt"), "a").unwrap();
    std::fs::write(folder.path().join("b.txt"), "b").unwrap();
    let head = format!("{FRAMES}, clocks: {{ \"other\": (first: 1, last: 4, fps: 12) }}");
    let around = r#""k1": (type: "test.add", a: 1), "k2": (type: "test.add", a: 2), "s1": (type: "test.frame"), "s2": (type: "test.add", a: "@s1"),
        "maps": (type: "test.summary", stream: "@s1"), "maps2": (type: "test.summary", stream: "@s2")"#;
    let registry = registry();
    let mut tried = 0;
    for ty in registry.nodes() {
        let schema = &ty.schema;
        let with = |changed: Option<&str>| {
            let given = schema.inputs.iter().map(|i| format!(", {}: {}", i.name, variants(i)[usize::from(changed == Some(i.name))]));
            // Retimed to the same bits: the map of another stream may hold the same frames.
            let node = format!("{around}, \"x\": (type: \"{}\"{})", schema.id, given.collect::<String>());
            let keys = keys(&graph_in(folder.path(), &head, &node));
            keys.into_iter().filter(|((port, _), _)| port == "x" || port.starts_with("x.")).map(|(_, h)| h).collect::<Vec<_>>()
        };
        let before = with(None);
        for input in &schema.inputs {
            // A known value counts by its content, and both maps hold the same.
            let is_same = input.ty == InputType::Value("TimeMap");
            let after = with(Some(input.name));
            let n = before.iter().filter(|h| after.contains(h)).count();
            assert_eq!(n, if is_same { before.len() } else { 0 }, "{} {}", schema.id, input.name);
            tried += 1;
        }
    }
    assert!(tried > 25, "{tried} inputs");
    assert!(registry.nodes().any(|n| n.schema.kind == Kind::Recurrent) && registry.nodes().any(|n| n.schema.kind == Kind::Whole));
}
