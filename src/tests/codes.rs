//! Every diagnostic code has a page that explains it, and a real graph that brings it.

use std::collections::BTreeSet;

use super::{FINE, Shot, cli};
use crate::codes::CODES;

/// Broken graphs with what is said of them, as the checker's own tests hold them.
const BROKEN: &str = include_str!("../../engine/src/tests/broken/graphs.txt");

/// Brought by no graph that a test could hold: a file of more than a GiB, and a fault of Pegbar itself.
const UNHELD: [&str; 2] = ["PB0021", "PB0502"];

/// Brought by plugins that harm their processes, as the tests of the program have them (`tests/all/plugins/hostile.rs`).
const BY_PLUGINS: [&str; 4] = ["PB0503", "PB0504", "PB0505", "PB0506"];

#[test]
fn every_code_of_the_engine_is_explained_once() {
    let sources = [
        include_str!("../../engine/src/check/mod.rs"),
        include_str!("../../engine/src/syntax/mod.rs"),
        include_str!("../../engine/src/job.rs"),
        include_str!("../../engine/src/golden/mod.rs"),
    ];
    let used: BTreeSet<&str> = sources.iter().flat_map(|s| s.match_indices("= \"PB").filter_map(|(at, _)| s.get(at + 3..at + 9))).collect();
    let explained: Vec<&str> = CODES.iter().map(|c| c.code).collect();
    assert_eq!(explained, used.into_iter().collect::<Vec<_>>());
}

#[test]
fn every_code_has_a_page_and_a_graph_that_brings_it() {
    let (checked, ran) = (checked(), ran());
    let without: Vec<String> = CODES
        .iter()
        .filter_map(|code| {
            let page = cli(&["explain", code.code]);
            let is_explained =
                page.code == 0 && page.out.contains(code.title) && code.mended.lines().next().is_none_or(|line| page.out.contains(line));
            let is_brought =
                UNHELD.contains(&code.code) || BY_PLUGINS.contains(&code.code) || checked.contains(code.code) || ran.contains(code.code);
            (!is_explained || !is_brought).then(|| format!("{}: page {is_explained}, graph {is_brought}", code.code))
        })
        .collect();
    assert!(without.is_empty(), "{without:#?}");
}

/// Codes in text, as messages have them: `error[PB0123]`.
fn codes(text: &str) -> impl Iterator<Item = String> {
    text.match_indices("[PB").filter_map(|(at, _)| text.get(at + 1..at + 7)).map(str::to_owned)
}

/// What checking says of the broken graphs.
fn checked() -> BTreeSet<String> {
    BROKEN.split("\n=== ").filter_map(|case| case.split_once("--- expect\n")).flat_map(|(_, said)| codes(said)).collect()
}

/// What is said when graphs run, or are tested against a reference.
fn ran() -> BTreeSet<String> {
    let mut said = String::new();
    let fine = Shot::new(FINE);
    std::fs::write(fine.path("file"), "").unwrap();
    let (folder, cache) = (fine.path(""), fine.path("cache"));
    let runs: [&[&str]; 4] = [&["--set", "g.fails=4"], &["--set", "out.lies=true"], &["--frames", "9-12"], &["--only", "nobody"]];
    runs.iter().for_each(|args| said += &fine.run(args).err);
    said += &cli(&["run", &fine.path("g.ron"), "--out", &fine.path("file"), "--cache", &cache]).err;
    said += &Shot::new("\"f\": (type: \"test.frame\"),").run(&[]).err;
    let test = |golden: &str, more: &[&str]| {
        std::fs::write(fine.path("g.golden.ron"), golden).unwrap();
        let out = fine.path("tested");
        cli(&[&["test", &folder, "--cache", &cache, "--out", &out], more].concat()).err
    };
    let whole = "Golden(pegbar: 1, outputs: [\"g\"])";
    said += &test(whole, &[]);
    said += &test(whole, &["--bless", "all"]);
    said += &test("Golden(pegbar: 1, outputs: [\"g\"], set: { \"g.gain\": 9.0 })", &[]);
    said += &test("Golden(pegbar: 1, outputs: [\"g\"], invariants: { \"*\": (within: (0, 1)) })", &[]);
    said += &test("Golden(pegbar: 1, outputs: [\"nobody\"])", &[]);
    codes(&said).collect()
}
