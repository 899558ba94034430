//! Edits against what they must and must not change.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::{Edit, EditError, apply};
use crate::diff::diff;
use crate::syntax::{Tree, format};

const GRAPH: &str = r#"// A header.
Graph(
    pegbar: 1,
    frames: (first: 1, last: "$last", fps: 24),
    params: { "last": (type: "whole", default: 4), "who": (type: "text", default: "costs $$last, $last") },
    nodes: {
        "plate": (type: "test.frame"), // the plate
        // Two lines
        // about the sum.
        "sum":   (type: "test.add",a: "@plate.value", b: 2),

        "mix": (
            type: "plugin.unknown",
            more: ["@sum", "@plate", "@sums.x"], // odd /* really */
            label: "$who",
            n: [1,2 ,  3]
        ),
        "sums": (type: "test.add", a: 1, b: 2)
    },
    outputs: { "o": "@mix" },
)
"#;

fn set(node: &str, input: &str, value: &str) -> Edit {
    Edit::Set { path: ["nodes", node, input].map(str::to_owned), value: value.to_owned() }
}

fn unset(node: &str, input: &str) -> Edit {
    Edit::Unset { path: ["nodes", node, input].map(str::to_owned) }
}

fn rename(from: &str, to: &str) -> Edit {
    Edit::RenameNode { from: from.to_owned(), to: to.to_owned() }
}

/// The lines that an edit changes: before and after.
fn changed(edit: &Edit) -> (Vec<&'static str>, Vec<String>) {
    let after = apply(GRAPH, edit).unwrap();
    let old: Vec<&str> = GRAPH.lines().collect();
    let new: Vec<&str> = after.lines().collect();
    let same = old.iter().zip(&new).take_while(|(a, b)| a == b).count();
    let tail = old[same..].iter().rev().zip(new[same..].iter().rev()).take_while(|(a, b)| a == b).count();
    (old[same..old.len() - tail].to_vec(), new[same..new.len() - tail].iter().map(|l| (*l).to_owned()).collect())
}

#[test]
fn a_value_is_set_where_it_stands_and_put_in_where_it_does_not() {
    let sum = "        \"sum\":   (type: \"test.add\",a: \"@plate.value\", b: 2),";
    assert_eq!(changed(&set("sum", "b", "7")), (vec![sum], vec![sum.replace("b: 2", "b: 7")]));
    assert_eq!(changed(&set("sum", "c", "7")), (vec![sum], vec![sum.replace("b: 2", "b: 2, c: 7")]));
    let plate = "        \"plate\": (type: \"test.frame\"), // the plate";
    assert_eq!(changed(&set("plate", "clock", "\"slow\"")), (vec![plate], vec![plate.replace("e\")", "e\", clock: \"slow\")")]));
    let last = "            n: [1,2 ,  3]";
    assert_eq!(changed(&set("mix", "m", "1")), (vec![last], vec![format!("{last},"), "            m: 1,".to_owned()]));
}

#[test]
fn what_is_taken_away_takes_its_comments_along() {
    assert_eq!(changed(&unset("mix", "more")).1, [""; 0]);
    let sum = "        \"sum\":   (type: \"test.add\",a: \"@plate.value\", b: 2),";
    assert_eq!(changed(&unset("sum", "b")), (vec![sum], vec![sum.replace(", b: 2", "")]));
    assert_eq!(changed(&unset("sum", "a")), (vec![sum], vec![sum.replace("a: \"@plate.value\", ", "")]));
    let refused = apply(GRAPH, &Edit::RemoveNode { name: "sums".to_owned() });
    assert_eq!(refused, Err(EditError::Read { node: "sums".to_owned(), reader: "mix".to_owned() }));
}

#[test]
fn names_change_wherever_they_are_read_and_nowhere_else() {
    let after = apply(GRAPH, &rename("sum", "total")).unwrap();
    assert_eq!(after, GRAPH.replace("\"sum\":", "\"total\":").replace("\"@sum\"", "\"@total\""));
    let edit = Edit::RenameParam { from: "last".to_owned(), to: "end".to_owned() };
    let expected = GRAPH.replace("\"last\": (", "\"end\": (").replace("last: \"$last\"", "last: \"$end\"").replace(", $last", ", $end");
    assert_eq!(apply(GRAPH, &edit).unwrap(), expected);
    assert_eq!(apply(GRAPH, &rename("sum", "mix")), Err(EditError::Taken("mix".to_owned())));
    assert_eq!(apply(GRAPH, &rename("sum", "a.b")), Err(EditError::BadName("a.b".to_owned())));
    assert_eq!(apply(GRAPH, &rename("nobody", "x")), Err(EditError::Missing("nodes.nobody".to_owned())));
}

#[test]
fn an_input_is_renamed_with_what_stands_there() {
    let edit = |to: &str| Edit::RenameInput { path: ["nodes", "sum", "b"].map(str::to_owned), to: to.to_owned() };
    assert_eq!(apply(GRAPH, &edit("second")).unwrap(), GRAPH.replace("value\", b: 2", "value\", second: 2"));
    assert_eq!(apply(GRAPH, &edit("a")), Err(EditError::Taken("a".to_owned())));
    assert_eq!(apply(GRAPH, &edit("a b")), Err(EditError::BadName("a b".to_owned())));
}

#[test]
fn nodes_come_and_go() {
    let add = Edit::AddNode { name: "new".to_owned(), record: "(type: \"x\")".to_owned() };
    let last = "        \"sums\": (type: \"test.add\", a: 1, b: 2)";
    assert_eq!(changed(&add), (vec![last], vec![format!("{last},"), "        \"new\": (type: \"x\"),".to_owned()]));
    let with = apply(GRAPH, &add).unwrap();
    let without = apply(&with, &Edit::RemoveNode { name: "new".to_owned() }).unwrap();
    assert!(diff(&Tree::parse(GRAPH), &Tree::parse(without)).changes.is_empty());
    assert!(matches!(apply(GRAPH, &set("sum", "b", "(")), Err(EditError::Syntax { .. })));
}

/// A graph of `n` nodes with odd layout, comments and unknown types, that changes with the seed.
fn graph(n: usize, seed: u64) -> String {
    let mut out = String::from("Graph(\n    pegbar: 1,\n    nodes: {\n");
    for i in 0..n {
        let h = (seed ^ (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40;
        let from = if i == 0 { "1".to_owned() } else { format!("\"@n{}\"", h as usize % i) };
        let node = match h % 4 {
            0 => format!("        \"n{i}\": (type: \"a.b\", x: {from}, y: {h}), // note {i}\n"),
            1 => format!("        // about {i}\n        \"n{i}\":(type:\"odd.{h}\",x:{from} ,y :{h} ,),\n"),
            2 => format!(
                "        \"n{i}\": (\n            type: \"a.b\",\n            x: {from}, /* {h} */\n            y: {h}\n        ),\n\n"
            ),
            _ => format!("        \"n{i}\": (type: \"unknown.type\", x: [{from}, {from}], y: \"$p{h}\"),\n"),
        };
        out.push_str(&node);
    }
    out + "    },\n    outputs: { \"o\": \"@n0\" },\n)\n"
}

/// One edit of many kinds, chosen by a number.
fn edit(n: usize, pick: u64) -> Edit {
    let node = format!("n{}", pick as usize / 8 % n);
    match pick % 8 {
        0 => set(&node, "y", &format!("{pick}")),
        1 => set(&node, &format!("z{}", pick % 3), "(1, 2)"),
        2 => unset(&node, "y"),
        3 => rename(&node, &format!("m{pick}")),
        4 => Edit::AddNode { name: format!("k{pick}"), record: "(type: \"c.d\")".to_owned() },
        5 => Edit::RemoveNode { name: node },
        _ => set(&node, "x", &format!("[{pick}]")),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    /// What a random edit changes by meaning is that edit and nothing else, what it changes in the text are the lines of that node, and in canonical
    /// layout it commutes with formatting.
    #[test]
    fn edits_change_what_they_must(seed in any::<u64>(), pick in any::<u64>()) {
        let text = graph(12, seed);
        let wanted = edit(12, pick >> 8);
        let Ok(after) = apply(&text, &wanted) else { return Ok(()) };
        let (old, new) = (Tree::parse(text.as_str()), Tree::parse(after.as_str()));
        let changes = diff(&old, &new).changes;
        let expected = match &wanted {
            Edit::RenameNode { from, .. } => format!("nodes.{from}"),
            Edit::AddNode { name, .. } | Edit::RemoveNode { name } => format!("nodes.{name}"),
            Edit::Set { path, .. } | Edit::Unset { path } => path.join("."),
            Edit::RenameParam { .. } | Edit::RenameInput { .. } => String::new(),
        };
        prop_assert!(changes.iter().all(|c| c.path == expected) && changes.len() <= 1, "{wanted:?} {changes:?}\n{after}");
        // Every line that is not of the node stands as it did, in the order in which it did.
        let lines: Vec<&str> = after.lines().collect();
        let gone = text.lines().filter(|l| !lines.contains(l)).count();
        let most = if matches!(wanted, Edit::RenameNode { .. }) { 14 } else { 6 };
        prop_assert!(gone <= most, "{gone} lines: {wanted:?}\n{after}");
        // The edit of the formatted text, formatted, is the formatted edit.
        let laid_out = |text: &str| format(&Tree::parse(text)).unwrap();
        let other = apply(&laid_out(&text), &wanted).unwrap();
        prop_assert!(diff(&Tree::parse(laid_out(&after)), &Tree::parse(laid_out(&other))).changes.is_empty());
    }
}

/// The lines of `before` that an edit changes, or between which it puts some.
fn touched(before: &str, after: &str) -> Vec<usize> {
    let (old, new): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    if old.len() == new.len() {
        return (0..old.len()).filter(|&i| old[i] != new[i]).collect();
    }
    let head = old.iter().zip(&new).take_while(|(a, b)| a == b).count();
    let tail = old[head..].iter().rev().zip(new[head..].iter().rev()).take_while(|(a, b)| a == b).count();
    (head.saturating_sub(1)..old.len() - tail + 1).collect()
}

/// A graph, two edits of it, and what each makes of it.
type Pair = (String, [Edit; 2], [String; 2]);

/// A graph with two edits of it that have at least one line between them.
fn disjoint(seed: u64) -> Option<Pair> {
    let text = format(&Tree::parse(graph(12, seed))).unwrap();
    let mixed = seed.wrapping_mul(0xD6E8_FEB8_6659_FD93);
    let edits = [edit(12, mixed >> 8), edit(12, mixed >> 32)];
    let texts = [apply(&text, &edits[0]).ok()?, apply(&text, &edits[1]).ok()?];
    let [a, b] = [touched(&text, &texts[0]), touched(&text, &texts[1])];
    let is_apart = !a.is_empty() && !b.is_empty() && a.iter().all(|i| b.iter().all(|j| i.abs_diff(*j) > 1));
    is_apart.then_some((text, edits, texts))
}

/// Runs git in a folder, without what whoever runs the tests has set for it; `None` where there is none.
fn git(folder: &std::path::Path, args: &[&str]) -> Option<std::process::Output> {
    let mut git = std::process::Command::new("git");
    git.current_dir(folder).args(["-c", "user.name=test", "-c", "user.email=test@example.com", "-c", "core.autocrlf=false"]).args(args);
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("GIT_")) {
        git.env_remove(name);
    }
    git.env("GIT_CONFIG_NOSYSTEM", "1").env("HOME", folder).env("XDG_CONFIG_HOME", folder).output().ok()
}

/// Pairs of random edits, a file each, on two branches that `git merge` puts together.
#[test]
fn edits_of_different_nodes_merge() {
    let folder = tempfile::tempdir().unwrap();
    if git(folder.path(), &["--version"]).is_none_or(|ran| !ran.status.success()) {
        println!("skipped: expected `git`, found none");
        return;
    }
    let pairs: Vec<_> = (0..600).filter_map(disjoint).collect();
    let kinds: BTreeSet<_> = pairs
        .iter()
        .map(|(_, [one, other], _)| (std::mem::discriminant(one), std::mem::discriminant(other)))
        .map(|kinds| format!("{kinds:?}"))
        .collect();
    assert!(pairs.len() >= 100 && kinds.len() >= 12, "{} pairs of {} kinds", pairs.len(), kinds.len());
    let run = |args: &[&str]| {
        let ran = git(folder.path(), args).unwrap();
        let said = [ran.stdout, ran.stderr].concat();
        assert!(ran.status.success(), "git {args:?}: {}", String::from_utf8_lossy(&said));
    };
    let path = |i: usize| folder.path().join(format!("{i}.ron"));
    let commit = |text: fn(&Pair) -> &str| {
        pairs.iter().enumerate().for_each(|(i, pair)| std::fs::write(path(i), text(pair)).unwrap());
        run(&["add", "."]);
        run(&["commit", "-q", "-m", "graphs"]);
    };
    run(&["init", "-q"]);
    commit(|(text, _, _)| text);
    run(&["branch", "other"]);
    commit(|(_, _, [one, _])| one);
    run(&["checkout", "-q", "other"]);
    commit(|(_, _, [_, other])| other);
    run(&["merge", "-q", "-m", "both", "-"]);
    for (i, (_, edits, [one, _])) in pairs.iter().enumerate() {
        let merged = std::fs::read_to_string(path(i)).unwrap();
        assert_eq!(merged, apply(one, &edits[1]).unwrap(), "{edits:?}");
    }
}
