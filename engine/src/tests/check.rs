//! Broken graphs, each with exactly what is said of it.
//!
//! `broken/graphs.txt` holds them: `=== name`, then the files of a graph as `--- file NAME`, what is given on the command line as `--- options`,
//! names of empty files that are there as `--- touch`, and what is said as `--- expect`. With `PEGBAR_BLESS=1` in the environment the test
//! writes what is said now into the file, and prints what changed.

use std::path::{Path, PathBuf};

use crate::check::{LoadOptions, Loaded, code, load};

use super::check_nodes::registry;

const CASES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tests/broken/graphs.txt");

struct Case {
    name: String,
    /// Header and body of each section, in order.
    sections: Vec<(String, String)>,
}

fn cases() -> Vec<Case> {
    let mut out: Vec<Case> = Vec::new();
    for line in std::fs::read_to_string(CASES).unwrap().lines() {
        if let Some(name) = line.strip_prefix("=== ") {
            out.push(Case { name: name.to_owned(), sections: Vec::new() });
        } else if let (Some(case), Some(header)) = (out.last_mut(), line.strip_prefix("--- ")) {
            case.sections.push((header.to_owned(), String::new()));
        } else if let Some((_, body)) = out.last_mut().and_then(|c| c.sections.last_mut()) {
            body.push_str(line);
            body.push('\n');
        }
    }
    out
}

impl Case {
    fn section(&self, header: &str) -> &str {
        self.sections.iter().find(|(h, _)| h == header).map_or("", |(_, b)| b.as_str())
    }

    /// Writes the files into `folder`.
    fn write(&self, folder: &Path) {
        let put = |name: &str, body: &str| {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, body).unwrap();
        };
        for (header, body) in &self.sections {
            if let Some(name) = header.strip_prefix("file ") {
                put(name, body);
            }
        }
        self.section("touch").split_whitespace().for_each(|name| put(name, ""));
    }

    fn options(&self, folder: &Path) -> LoadOptions {
        let pairs = |word: &str| {
            let lines = self.section("options").lines().filter_map(|l| l.strip_prefix(word));
            lines.map(|l| l.split_once('=').unwrap()).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
        };
        LoadOptions { out: folder.join("out"), variables: pairs("--var "), overrides: pairs("--set ") }
    }

    fn load(&self) -> (Loaded, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        self.write(folder.path());
        let loaded = load(&folder.path().join("main.ron"), &registry(), &self.options(folder.path()));
        assert_eq!(loaded.graph.is_some(), loaded.errors() == 0, "{}: a graph exactly where there is no error", self.name);
        (loaded, folder.path().to_owned())
    }

    /// What is said, with file names as seen from the folder.
    fn said(&self) -> String {
        let (loaded, folder) = self.load();
        let text = loaded.sources.render_all(&loaded.diagnostics, false);
        let text = text.replace(&format!("{}/", folder.display()), "").replace(&folder.display().to_string(), ".");
        // A line of nothing between two messages; none at the end.
        text.lines().map(|l| format!("{}\n", l.trim_end())).collect::<String>().trim_end().to_owned()
    }
}

fn differences(name: &str, before: &str, now: &str) -> String {
    let mut out = format!("{name}\n");
    before.lines().filter(|l| !now.lines().any(|n| n == *l)).for_each(|l| out.push_str(&format!("  - {l}\n")));
    now.lines().filter(|l| !before.lines().any(|b| b == *l)).for_each(|l| out.push_str(&format!("  + {l}\n")));
    out
}

#[test]
fn broken_graphs_are_told_exactly_what_is_wrong() {
    let bless = std::env::var("PEGBAR_BLESS").is_ok_and(|v| v == "1");
    let (mut wrong, mut file) = (String::new(), String::new());
    let cases = cases();
    for case in &cases {
        let (said, expected) = (case.said(), case.section("expect").trim_end());
        if said != expected {
            wrong.push_str(&differences(&case.name, expected, &said));
        }
        file.push_str(&format!("=== {}\n", case.name));
        for (header, body) in case.sections.iter().filter(|(h, _)| h != "expect") {
            file.push_str(&format!("--- {header}\n{body}"));
        }
        file.push_str(&format!("--- expect\n{said}\n\n"));
    }
    if bless {
        std::fs::write(CASES, file.trim_end().to_owned() + "\n").unwrap();
        eprintln!("{wrong}");
        return;
    }
    assert!(cases.len() >= 40, "{} cases", cases.len());
    assert!(wrong.is_empty(), "PEGBAR_BLESS=1 accepts this:\n{wrong}");
}

#[test]
fn every_code_has_a_broken_graph() {
    let cases = cases();
    let said: String = cases.iter().map(|c| c.section("expect")).collect();
    for code in code::ALL {
        assert!(said.contains(&format!("[{code}]")), "no broken graph for {code}");
    }
}
