//! Which fact is named for which change, and that one is named just where keys differ.

use std::path::Path;
use std::sync::Arc;

use proptest::prelude::*;

use crate::check::{LoadOptions, load};
use crate::diag::SourceMap;
use crate::graph::Graph;
use crate::key::Keys;
use crate::node::NodeSchema;
use crate::plan::{Plan, Target};
use crate::record::{NodeCost, Record};
use crate::stamp::Files;
use crate::why::{Outcome, Verdict, difference, now, why};

use super::check_nodes::registry;
use super::keys::{FRAMES, NODES, found, plan_of, planned};

struct Shot {
    graph: Graph,
    sources: SourceMap,
    plan: Plan,
}

impl Shot {
    fn new(folder: &Path, head: &str, nodes: &str) -> Self {
        let path = folder.join("main.ron");
        std::fs::write(&path, format!("Graph(\npegbar: 1,\n{head},\nnodes: {{\n{}\n}})", nodes.trim_start())).unwrap();
        let loaded = load(&path, &registry(), &LoadOptions { out: folder.join("out"), ..LoadOptions::default() });
        assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
        let graph = loaded.graph.unwrap();
        Self { plan: planned(&graph), graph, sources: loaded.sources }
    }

    fn record(&self) -> Record {
        Record::of(&self.graph, &self.sources, Some(&self.plan), &Files::new(None)).unwrap_or_else(|e| panic!("{}", e.error))
    }

    fn keys(&self) -> Keys {
        found(&self.graph, &self.plan)
    }
}

/// How the digest of a file with this text is shown.
fn digits(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..12].to_owned()
}

/// The difference in words, with paths below the folder.
fn told(folder: &Path, old: &Record, new: &Record, node: &str, frame: Option<i64>) -> Option<String> {
    difference(old, new, node, frame).map(|c| c.to_string().replace(&format!("{}/", folder.display()), ""))
}

const HAT: &str = r#"
"plate": (type: "test.read", path: "p.#.txt"),
"hat": (type: "test.read", path: "hat.txt"),
"track": (type: "test.total", stream: "@plate", start: 1),
"swap": (type: "test.add", a: "@hat", b: "@track"),
"comp": (type: "test.add", a: "@swap", b: "@plate"),
"near": (type: "test.window", stream: "@comp"),
"all": (type: "test.summary", stream: "@plate"),
"back": (type: "test.retime", stream: "@comp", map: "@all.map"),
"out": (type: "test.write", value: "@comp", path: "$out/c.#.txt"),"#;

fn footage(folder: &Path) {
    (1..=6).for_each(|f| std::fs::write(folder.join(format!("p.{f}.txt")), vec![b'x'; f]).unwrap());
    std::fs::write(folder.join("hat.txt"), "hat").unwrap();
}

#[test]
fn each_change_is_told_by_its_first_fact() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let before = Shot::new(folder, FRAMES, HAT).record();
    let cases = [
        ("start: 1", "start: 3", "comp", "comp reads swap reads track: track.start was 1, is 3 at main.ron:7:56"),
        ("start: 1", "start: 3", "track", "track.start was 1, is 3 at main.ron:7:56"),
        ("\"@hat\", b", "2.5, b", "near", "near reads comp reads swap: swap.a was @hat.value, is 2.5 at main.ron:8:31"),
        ("\"@hat\", b", "\"@track\", b", "swap", "swap.a was @hat.value, is @track.value at main.ron:8:31"),
        (
            "\"test.window\"",
            "\"test.retime\", map: \"@all.map\"",
            "near",
            "near: its type was test.window, is test.retime at main.ron:10:1",
        ),
        (
            "hat.txt",
            "p.1.txt",
            "swap",
            "swap reads hat: hat.path was \"hat.txt\" (content HAT), is \"p.1.txt\" (content ONE) at main.ron:6:34",
        ),
        ("$out/c", "$out/d", "out", "out.path was \"OUT/c.#.txt\", is \"OUT/d.#.txt\" at main.ron:13:51"),
        ("\"@comp\")", "\"@comp\", radius: 2)", "near", "near.radius was 1, is 2 at main.ron:10:56"),
    ];
    for (from, to, node, expected) in cases {
        let after = Shot::new(folder, FRAMES, &HAT.replacen(from, to, 1)).record();
        let found = told(folder, &before, &after, node, Some(2))
            .map(|t| t.replace("\"out/", "\"OUT/").replace(&format!("{}/out", folder.display()), "OUT"));
        let expected = expected.replace("HAT", &digits("hat")).replace("ONE", &digits("x"));
        assert_eq!(found, Some(expected), "{from} -> {to}");
        assert_eq!(told(folder, &before, &after, "plate", Some(2)), None, "{from} -> {to}");
    }
}

#[test]
fn clocks_are_told_where_they_count() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let before = Shot::new(folder, FRAMES, HAT).record();
    let longer = Shot::new(folder, "frames: (first: 1, last: 6, fps: 24)", HAT).record();
    let told = |new: &Record, node: &str, frame| told(folder, &before, new, node, Some(frame));
    assert_eq!(told(&longer, "comp", 4), None);
    assert_eq!(told(&longer, "near", 3), None);
    assert_eq!(told(&longer, "near", 4).as_deref(), Some("near: last frame of the clock was 4, is 6"));
    assert_eq!(told(&longer, "all", 0).as_deref(), Some("all: last frame of the clock was 4, is 6"));
    assert_eq!(told(&longer, "back", 2).as_deref(), Some("back: last frame of the clock was 4, is 6"));
    let faster = Shot::new(folder, "frames: (first: 1, last: 4, fps: 25)", HAT).record();
    assert_eq!(told(&faster, "comp", 2).as_deref(), Some("comp: frames a second of the clock was 24/1, is 25/1"));
    assert_eq!(told(&faster, "hat", 0), None);
}

#[test]
fn files_are_told_by_their_content_at_the_frames_that_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let shot = Shot::new(folder, FRAMES, HAT);
    let before = shot.record();
    let told = |node: &str, frame| told(folder, &before, &shot.record(), node, frame);
    std::fs::write(folder.join("p.3.txt"), "xxx").unwrap();
    std::fs::write(folder.join("hat.txt"), "hat").unwrap();
    for node in ["comp", "near", "all", "out"] {
        assert_eq!(told(node, None), None, "files that are touched are not changed");
    }
    std::fs::write(folder.join("p.3.txt"), "xyx").unwrap();
    let (was, is) = (digits("xxx"), digits("xyx"));
    let plate = format!("plate.path at frame 3 was p.3.txt (content {was}), is p.3.txt (content {is}) at main.ron:5:36");
    assert_eq!(told("comp", Some(2)), None);
    assert_eq!(told("comp", Some(3)), Some(format!("comp reads plate: {plate}")));
    assert_eq!(told("near", Some(1)), None);
    assert_eq!(told("near", Some(2)), Some(format!("near reads comp reads plate: {plate}")));
    // The tracker comes to frame 4 over frame 3.
    assert_eq!(told("track", Some(4)), Some(format!("track reads plate: {plate}")));
    assert_eq!(told("track", None), Some(format!("track reads plate: {plate}")));
    // Played backwards, so that frame 2 shows frame 3.
    assert_eq!(told("back", Some(2)), Some(format!("back reads comp reads plate: {plate}")));
    assert_eq!(told("back", Some(3)), None);
}

#[test]
fn names_and_order_are_no_facts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let before = Shot::new(folder, FRAMES, HAT).record();
    let renamed = HAT.replace("swap", "swop").replace("test.total\", ", "test.total\", /* from the first */ ");
    let turned = renamed.lines().rev().collect::<Vec<_>>().join("\n");
    let after = Shot::new(folder, FRAMES, &turned).record();
    for node in ["comp", "near", "all", "back", "out", "plate", "track"] {
        assert_eq!(told(folder, &before, &after, node, None), None, "{node}");
    }
    let after = Shot::new(folder, FRAMES, &renamed.replace("start: 1", "start: 3")).record();
    let found = told(folder, &before, &after, "comp", None).unwrap();
    assert!(found.starts_with("comp reads swop reads track: track.start was 1, is 3"), "{found}");
    // Another node that gives the same is no change either; one that gives something else is.
    let twin = r#""twin": (type: "test.read", path: "p.#.txt", missing: error), "comp": (type: "test.add", a: "@swap", b: "@twin"),"#;
    let twin = HAT.replace("\"comp\": (type: \"test.add\", a: \"@swap\", b: \"@plate\"),", twin);
    assert_eq!(told(folder, &before, &Shot::new(folder, FRAMES, &twin).record(), "near", None), None);
    let other = Shot::new(folder, FRAMES, &twin.replacen("\"p.#.txt\", missing", "\"hat.txt\", missing", 1)).record();
    let found = told(folder, &before, &other, "near", None).unwrap();
    assert!(found.starts_with("near reads comp: comp.b was @plate.value, is @twin.value at main.ron:"), "{found}");
}

/// The graph as of a Pegbar in which a node type behaves in another way.
fn next_version(mut shot: Shot, id: &str) -> Shot {
    for node in shot.graph.nodes.iter_mut().filter(|n| n.ty.schema.id == id) {
        node.ty.schema = Arc::new(NodeSchema { version: 2, ..(*node.ty.schema).clone() });
    }
    shot
}

#[test]
fn a_new_version_of_a_node_type_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let shot = || Shot::new(folder, FRAMES, HAT);
    let (before, after) = (shot().record(), next_version(shot(), "test.total").record());
    let expected = "comp reads swap reads track: track: the version of test.total was 1, is 2 at main.ron:7:1";
    assert_eq!(told(folder, &before, &after, "comp", Some(1)).as_deref(), Some(expected));
    let other = Record { keys: "pegbar key 0".to_owned(), ..shot().record() };
    let expected = format!("plate: what keys are made of was pegbar key 0, is {}", crate::key::KEY_VERSION);
    assert_eq!(told(folder, &other, &after, "plate", Some(1)), Some(expected));
}

#[test]
fn the_answer_is_found_among_the_records() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let record = |nodes: &str, date: &str| Record { date: date.to_owned(), ..Shot::new(folder, FRAMES, nodes).record() };
    let with = |mut record: Record, cost: NodeCost| {
        record.costs.insert("comp".to_owned(), cost);
        record
    };
    let now = record(HAT, "now");
    let of = |records: &[Record], node: &str, frame| why(records, &now, node, Some(frame)).unwrap().verdict;
    assert_eq!(of(&[], "comp", 1), Verdict::NoRecord);
    assert_eq!(why(&[], &now, "cmop", None), None);
    let without = record(&HAT.replace("\"hat\"", "\"hut\"").replace("@hat", "@hut"), "a");
    assert_eq!(of(&[without], "hat", 1), Verdict::NewNode { place: format!("{}:6:1", folder.join("main.ron").display()) });
    assert_eq!(of(&[record(HAT, "a")], "comp", 5), Verdict::NotWanted { last: "a".to_owned() });

    let other = record(&HAT.replace("start: 1", "start: 3"), "a");
    let answer = why(std::slice::from_ref(&other), &now, "comp", Some(1)).unwrap();
    assert!(matches!(&answer.verdict, Verdict::Changed { last, change } if last == "a" && change.is == "1"));
    let text = answer.to_string();
    assert!(
        text.starts_with(
            "comp@1 will run again, for a change since the run of a:\n  comp reads swap reads track: track.start was 3, is 1 at "
        ),
        "{text}"
    );
    let verdict = of(&[record(HAT, "b"), other], "comp", 1);
    assert!(matches!(&verdict, Verdict::ChangedBefore { last, before, change } if last == "b" && before == "a" && change.was == "3"));

    let computed = |unkept| NodeCost { computed: 4, unkept, ..NodeCost::default() };
    let cached = NodeCost { cached: 4, ..NodeCost::default() };
    let outcome = |records: &[Record]| match of(records, "comp", 1) {
        Verdict::Unchanged { outcome, .. } => outcome,
        other => panic!("{other:?}"),
    };
    let same = || record(HAT, "a");
    assert_eq!(outcome(&[same()]), Outcome::Unknown);
    assert_eq!(outcome(&[with(same(), cached.clone())]), Outcome::Cached);
    assert_eq!(outcome(&[with(same(), computed(0))]), Outcome::First);
    assert_eq!(outcome(&[with(same(), computed(0)), with(same(), computed(4))]), Outcome::Unkept);
    assert_eq!(outcome(&[with(same(), computed(0)), with(same(), cached)]), Outcome::Lost);
}

#[test]
fn without_a_plan_the_facts_are_told_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let before = Shot::new(folder, FRAMES, HAT).record();
    let bare = |nodes: &str| {
        let shot = Shot::new(folder, FRAMES, nodes);
        Record::of(&shot.graph, &shot.sources, None, &Files::new(None)).unwrap_or_else(|e| panic!("{}", e.error))
    };
    let now = bare(HAT);
    for node in &now.nodes {
        assert_eq!(told(folder, &before, &now, &node.name, None), None, "{}", node.name);
    }
    let expected = "back reads comp reads swap reads track: track.start was 1, is 3 at main.ron:7:56";
    assert_eq!(told(folder, &before, &bare(&HAT.replace("start: 1", "start: 3")), "back", Some(1)).as_deref(), Some(expected));
}

#[test]
fn only_what_the_node_hangs_on_is_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let shot = Shot::new(folder, FRAMES, HAT);
    let before = [shot.record()];
    std::fs::remove_file(folder.join("p.4.txt")).unwrap();
    let verdict = |node: &str, frame| {
        let files = Files::new(None);
        let at = shot.graph.find(node).unwrap();
        now(&shot.graph, &shot.sources, at, Some(frame), &files)
            .map(|now| (why(&before, &now, node, Some(frame)).unwrap(), files.table().len()))
    };
    let (near, read) = verdict("near", 2).unwrap_or_else(|e| panic!("{}", e.error));
    assert_eq!((read, near.frame), (4, Some(2)), "the hat and the plate of three frames");
    assert!(matches!(near.verdict, Verdict::Unchanged { .. }), "{near}");
    let (hat, read) = verdict("hat", 2).unwrap_or_else(|e| panic!("{}", e.error));
    assert_eq!((read, hat.frame), (1, None), "a node that runs once has no frames");
    assert!(verdict("near", 3).is_err_and(|e| e.error.message.contains("p.4.txt")));
    assert!(verdict("near", 9).is_err_and(|e| e.error.message.contains("frame 9")));
}

#[test]
fn what_an_earlier_stage_read_is_looked_at_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    footage(folder);
    let nodes = r#""p": (type: "test.read", path: "p.#.txt"), "h": (type: "test.read", path: "hat.txt"), "s": (type: "test.add", a: "@p", b: "@h"),
        "map": (type: "test.summary", stream: "@s"), "f": (type: "test.frame"), "back": (type: "test.retime", stream: "@f", map: "@map.map")"#;
    let shot = Shot::new(folder, FRAMES, nodes);
    let back = shot.graph.find("back").unwrap();
    let plan = plan_of(&shot.graph, &[Target { node: back, frames: None }]);
    assert_eq!(plan.tasks_of(0), 0, "the plan knows the map");
    let record = || Record::of(&shot.graph, &shot.sources, Some(&plan), &Files::new(None)).unwrap_or_else(|e| panic!("{}", e.error));
    let before = record();
    let told = || {
        let now = now(&shot.graph, &shot.sources, back, Some(2), &Files::new(None)).unwrap_or_else(|e| panic!("{}", e.error));
        assert!(!now.is_planned);
        told(folder, &before, &now, "back", Some(2))
    };
    assert_eq!(told(), None);
    std::fs::write(folder.join("p.4.txt"), "other").unwrap();
    assert!(told().unwrap().starts_with("back reads map reads s reads p: p.path at frame 4 was p.4.txt"));
    std::fs::write(folder.join("hat.txt"), "cap").unwrap();
    assert!(told().unwrap().starts_with("back reads map reads s reads "), "{:?}", told());
    // The map came out the same, so that two records, which know it, do not differ.
    assert_eq!(difference(&before, &record(), "back", None), None);
}

/// Edits of the graph, some of which change nothing.
const EDITS: [(&str, &str); 16] = [
    ("start: 2", "start: 3"),
    ("a: 1.0", "a: 1.5"),
    ("a: 1.0", "a: 1.00"),
    ("mode: linear", "mode: \"linear\""),
    ("mode: linear", "mode: catmull_rom"),
    ("\"mean\": (type: \"test.window\", stream: \"@sum\"", "\"mean\": (type: \"test.window\", stream: \"@sum\", radius: 2"),
    ("stream: \"@sum\"", "stream: \"@f\""),
    ("\"one\"", "\"uno\": (type: \"test.add\", a: 1), \"one\""),
    ("b: \"@one\"", "b: 1"),
    ("knots: [(1, 2)]", "knots: []"),
    ("more: \"@all\"", "more: \"@all.sum\""),
    ("more: \"@all\"", "more: \"@one\""),
    ("streams: [\"@f\", \"@mean\"]", "streams: [\"@mean\", \"@f\"]"),
    ("streams: [\"@f\", \"@mean\"]", "streams: [\"@f\"]"),
    ("path: \"p.#.txt\"", "path: \"p.#.txt\", missing: hold"),
    ("b: \"@one\"", "b: \"@other\""),
];
const HEADS: [&str; 4] =
    [FRAMES, "frames: (first: 1, last: 5, fps: 24)", "frames: (first: 2, last: 4, fps: 24)", "frames: (first: 1, last: 4, fps: 30)"];

/// A graph with some edits, and footage of which one frame may be another.
fn edited(folder: &Path, head: usize, edits: &[usize], other: Option<usize>) -> Shot {
    footage(folder);
    if let Some(frame) = other {
        std::fs::write(folder.join(format!("p.{frame}.txt")), "y").unwrap();
    }
    let more = r#", "p": (type: "test.read", path: "p.#.txt"), "q": (type: "test.window", stream: "@p"), "other": (type: "test.add", a: 1.0),
        "h": (type: "test.read", path: "p.2.txt"), "r": (type: "test.total", stream: "@p", start: 3), "s": (type: "test.add", a: "@r", b: "@h")"#;
    let nodes = edits.iter().fold(format!("{NODES}{more}"), |nodes, &e| nodes.replacen(EDITS[e].0, EDITS[e].1, 1));
    Shot::new(folder, HEADS[head], &nodes)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn a_fact_is_named_just_where_keys_differ(
        heads in (0..HEADS.len(), 0..HEADS.len()),
        edits in proptest::sample::subsequence((0..EDITS.len()).collect::<Vec<_>>(), 0..3),
        more in proptest::collection::vec(0..EDITS.len(), 0..2),
        others in (proptest::option::of(1..5usize), proptest::option::of(1..5usize)),
        same_head in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let old = edited(folder.path(), heads.0, &edits, others.0);
        let (was, old_keys) = (old.record(), old.keys());
        let edits = [edits.clone(), more.into_iter().filter(|e| !edits.contains(e)).collect()].concat();
        let new = edited(folder.path(), if same_head { heads.0 } else { heads.1 }, &edits, others.1);
        let (is, new_keys) = (new.record(), new.keys());
        let (was, is): (Record, Record) = {
            let again = |r: &Record| serde_json::from_slice(&serde_json::to_vec(r).unwrap()).unwrap();
            (again(&was), again(&is))
        };
        for (b, node) in new.graph.nodes.iter().enumerate() {
            let Some(a) = old.graph.find(&node.name) else { continue };
            let before = &old.graph.nodes[a];
            let frames: Vec<i64> = if node.runs_once() { vec![node.clock.first] } else { node.clock.frames().collect() };
            for frame in frames {
                let task = |n: &crate::graph::GraphNode| if n.runs_once() { Some(0) } else { n.clock.index(frame) };
                let (Some(k), Some(l)) = (task(before), task(node)) else { continue };
                let is_same = old_keys.task(a, k) == new_keys.task(b, l);
                let found = difference(&was, &is, &node.name, Some(frame));
                prop_assert_eq!(found.is_none(), is_same, "{} at {}: {:?}", node.name, frame, found);
            }
        }
    }
}
