//! Broken graphs, each with exactly what is said of it.
//!
//! `broken/graphs.txt` holds them: `=== name`, then the files of a graph as `--- file NAME`, what is given on the command line as `--- options`,
//! names of empty files that are there as `--- touch`, and what is said as `--- expect`. With `PEGBAR_BLESS=1` in the environment the test
//! writes what is said now into the file, and prints what changed.

use std::path::{Path, PathBuf};

use crate::check::{LoadOptions, Loaded, code, load, load_text};
use crate::graph::Binding;
use crate::setting::InputPath;

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
        let folders =
            |word: &str| self.section("options").lines().filter_map(|l| l.strip_prefix(word)).map(|l| folder.join(l)).collect::<Vec<_>>();
        LoadOptions {
            out: folder.join("out"),
            variables: pairs("--var "),
            overrides: pairs("--set "),
            shot: folders("--shot ").pop(),
            site: folders("--site ").pop(),
            library: folders("--library "),
            ..LoadOptions::default()
        }
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

/// A graph in a folder of its own, with these files beside it.
fn loaded(main: &str, files: &[(&str, &str)], variables: &[(&str, &str)]) -> (Loaded, PathBuf) {
    let sections = files.iter().map(|(n, b)| (format!("file {n}"), (*b).to_owned())).chain([("file main.ron".to_owned(), main.to_owned())]);
    let options = variables.iter().map(|(k, v)| format!("--var {k}={v}\n")).collect();
    Case { name: main.to_owned(), sections: sections.chain([("options".to_owned(), options)]).collect() }.load()
}

/// The settings of a node that must be fine, as text.
fn settings(loaded: &Loaded, node: &str) -> Vec<String> {
    let said = loaded.sources.render_all(&loaded.diagnostics, false);
    let graph = loaded.graph.as_ref().unwrap_or_else(|| panic!("{said}"));
    let text = |b: &Binding| match b {
        Binding::None => "-".to_owned(),
        Binding::Literal { text, .. } => text.clone(),
        Binding::Wire(port) => format!("@{}", graph.port_name(*port)),
        Binding::List(ports) => ports.iter().map(|p| format!("@{} ", graph.port_name(*p))).collect(),
    };
    graph.nodes[graph.find(node).unwrap()].inputs.iter().map(text).collect()
}

#[test]
fn json_says_the_same() {
    let main = "Graph(pegbar: 1, nodes: {\n  \"a\": (type: \"test.add\", a: 1, b: -2000),\n  \"b\": (type: \"test.ad\"),\n})";
    let (loaded, folder) = loaded(main, &[], &[]);
    let json: Vec<_> = loaded.diagnostics.iter().map(|d| serde_json::to_value(loaded.sources.to_json(d)).unwrap()).collect();
    let file = folder.join("main.ron").display().to_string();
    assert_eq!(
        serde_json::Value::Array(json),
        serde_json::json!([
            {
                "code": "PB0131", "severity": "error", "message": "input `b`: expected from -1000 to 1000, found -2000",
                "file": file, "line": 2, "column": 36, "end_line": 2, "end_column": 41, "text": "-2000",
                "expected": "number, or a reference to a Curve, in px, from -1000 to 1000", "found": "-2000", "help": [],
            },
            {
                "code": "PB0120", "severity": "error", "message": "expected a node type, found `test.ad`",
                "file": file, "line": 3, "column": 15, "end_line": 3, "end_column": 24, "text": "\"test.ad\"",
                "expected": "a node type", "found": "`test.ad`",
                "help": ["did you mean `test.add`?", "`pegbar nodes` lists the node types"],
            },
        ])
    );
}

#[test]
fn variables_stand_for_literals_references_and_lists() {
    let main = r#"Graph(
        pegbar: 1,
        params: {
            "gain": (type: "number", default: 2.5), "mode": (type: "text", default: "linear"), "who": (type: "any", default: "@a"),
            "all": (type: "any", default: ["@a", "$who"]), "x": (type: "number", default: 3), "none": (type: "any", default: None),
            "show": (type: "text", default: "hat"), "shot": (type: "text", default: "$show-7"), "name": (type: "text", default: "cat"),
        },
        nodes: {
            "a": (type: "test.add", a: "$gain"),
            "b": (type: "test.blend", mode: "$mode", knots: [(1, "$x"), ("$gain", 2)], label: "$shot costs $$$x, $name", more: "$who"),
            "c": (type: "test.blend", mode: "catmull_rom", limit: None, more: "$none"),
            "d": (type: "test.sink", streams: ["@b", "$who", "$all"]),
            "e": (type: "test.sink", streams: "$all"),
        },
    )"#;
    let (loaded, _) = loaded(main, &[], &[("name", "7"), ("gain", "4")]);
    assert_eq!(settings(&loaded, "a"), ["4", "0.0"]);
    let label = r#""hat-7 costs $3, 7""#;
    assert_eq!(settings(&loaded, "b"), [r#""linear""#, "0.0", "1.0", "None", "[(1,3),(4,2)]", label, "@a.value"]);
    assert_eq!(settings(&loaded, "c"), [r#""catmull_rom""#, "0.0", "1.0", "None", "[]", r#""plain""#, "-"]);
    assert_eq!(settings(&loaded, "d"), ["@b.value @a.value @a.value @a.value "]);
    assert_eq!(settings(&loaded, "e"), ["@a.value @a.value "]);
}

#[test]
fn a_path_is_held_against_the_file_in_which_it_is_written() {
    let reader = r#"Graph(
        pegbar: 1,
        params: { "path": (type: "path", default: "own.txt") },
        nodes: { "r": (type: "test.read", path: "$path"), "beside": (type: "test.read", path: "own.txt") },
        outputs: { "value": "@r" },
    )"#;
    let middle = r#"Graph(
        pegbar: 1,
        params: { "path": (type: "path", default: "middle.txt"), "folder": (type: "path", default: "deep") },
        nodes: {
            "i": (type: "graph:inner/read.ron", path: "$path"), "j": (type: "graph:inner/read.ron"),
            "k": (type: "graph:inner/read.ron", path: "$folder/k.txt"),
        },
        outputs: { "value": "@i", "other": "@j" },
    )"#;
    let main = r#"Graph(
        pegbar: 1,
        params: { "plate": (type: "path", default: "main.txt"), "name": (type: "text", default: "main") },
        nodes: {
            "m": (type: "graph:sub/middle.ron", path: "$plate"), "n": (type: "graph:sub/middle.ron"),
            "o": (type: "graph:sub/middle.ron", path: "$name.txt"), "sum": (type: "test.add", a: "@m", b: "@n.other"),
        },
    )"#;
    let files = [
        ("sub/middle.ron", middle),
        ("sub/inner/read.ron", reader),
        ("main.txt", ""),
        ("sub/middle.txt", ""),
        ("sub/inner/own.txt", ""),
        ("sub/deep/k.txt", ""),
    ];
    let (loaded, folder) = loaded(main, &files, &[]);
    assert_eq!(settings(&loaded, "sum"), ["@m/i/r.value", "@n/j/r.value"]);
    let graph = loaded.graph.as_ref().unwrap();
    let path = |node: &str| {
        let Binding::Literal { value, .. } = &graph.nodes[graph.find(node).unwrap()].inputs[0] else { panic!("{node}") };
        let path = value.downcast_ref::<InputPath>().unwrap().at(0);
        path.strip_prefix(&folder).unwrap().to_string_lossy().into_owned()
    };
    let expected = [
        ("m/i/r", "main.txt"),
        ("n/i/r", "sub/middle.txt"),
        ("m/j/r", "sub/inner/own.txt"),
        ("m/k/r", "sub/deep/k.txt"),
        ("o/i/r", "main.txt"),
        ("o/i/beside", "sub/inner/own.txt"),
    ];
    for (node, file) in expected {
        assert_eq!(path(node), file, "{node}");
    }
}

#[test]
fn text_that_grows_without_end_is_refused() {
    let params: String = (0..40).map(|i| format!("\"p{i}\": (type: \"text\", default: \"$p{0}$p{0}\"), ", i + 1)).collect();
    let main = format!(
        "Graph(pegbar: 1, params: {{ {params} \"p40\": (type: \"text\", default: \"x\") }}, nodes: {{ \"a\": (type: \"test.blend\", mode: linear, label: \"$p0\") }})"
    );
    let (loaded, _) = loaded(&main, &[], &[]);
    let codes: Vec<&str> = loaded.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(codes, [code::CYCLE]);
}

fn good() -> Vec<String> {
    let case = cases().into_iter().find(|c| c.name == "several problems of one file are told at once").unwrap();
    vec![case.section("file main.ron").to_owned(), include_str!("broken/good.ron").to_owned()]
}

proptest::proptest! {
    #![proptest_config(proptest::test_runner::Config::with_cases(300))]
    /// Words of a graph cut out, doubled and put elsewhere: checking ends, panics never, and points into the files.
    #[test]
    fn whatever_is_written_is_checked(which in 0..2usize, edits in proptest::collection::vec((0..400usize, 0..400usize, 0..4u8), 1..6)) {
        let mut words = words(&good()[which]);
        for (from, to, edit) in edits {
            let (from, to) = (from % words.len(), to % words.len());
            match edit {
                0 => drop(words.remove(from)),
                1 => words.insert(to, words[from].clone()),
                2 => words.swap(from, to),
                _ => words[to] = words[from].clone(),
            }
            if words.is_empty() {
                words.push(String::new());
            }
        }
        let loaded = load_text(Path::new("no/where.ron"), &words.concat(), &registry(), &LoadOptions::default());
        proptest::prop_assert_eq!(loaded.graph.is_some(), loaded.errors() == 0);
        for diagnostic in &loaded.diagnostics {
            for label in &diagnostic.labels {
                let text = loaded.sources.text(label.file);
                proptest::prop_assert!(label.span.end <= text.len() && text.get(label.span.range()).is_some());
            }
            proptest::prop_assert!(!loaded.sources.render(diagnostic, false).is_empty());
        }
    }
}

/// A text cut where words, blanks and signs meet.
fn words(text: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for c in text.chars() {
        match out.last_mut() {
            Some(word) if c.is_alphanumeric() && word.chars().all(char::is_alphanumeric) => word.push(c),
            _ => out.push(c.to_string()),
        }
    }
    out
}

#[test]
fn texts_that_are_being_edited_count_instead_of_files() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().canonicalize().unwrap();
    let inner = |ty: &str| format!("Graph(pegbar: 1, nodes: {{ \"n\": (type: \"{ty}\") }}, outputs: {{ \"o\": \"@n\" }})");
    let main =
        r#"Graph(pegbar: 1, frames: (first: 1, last: 4, fps: 24), nodes: { "g": (type: "graph:a/../in.ron") }, outputs: { "o": "@g" })"#;
    let load = |texts: &[(&str, String)]| {
        let texts = texts.iter().map(|(name, text)| (folder.join(name), text.as_str().into())).collect();
        load_text(&folder.join("main.ron"), main, &registry(), &LoadOptions { texts, ..LoadOptions::default() })
    };
    assert_eq!(load(&[]).diagnostics[0].code, code::MISSING_FILE);
    // The file need not be there at all.
    assert_eq!(load(&[("in.ron", inner("test.frame"))]).diagnostics, []);
    std::fs::create_dir(folder.join("a")).unwrap();
    std::fs::write(folder.join("in.ron"), inner("test.frame")).unwrap();
    assert_eq!(load(&[]).diagnostics, []);
    assert_eq!(load(&[("in.ron", inner("test.none"))]).diagnostics[0].code, code::UNKNOWN_TYPE);
}

#[test]
fn what_is_known_of_nodes_is_known_of_a_broken_graph_too() {
    let text = r#"Graph(pegbar: 1, frames: (first: 1, last: 4, fps: 24), nodes: {
        "f": (type: "test.frame"), "x": (type: "test.none"), "s": (type: "test.add", a: "@f"), "lost": (type: "test.add", a: "@nowhere"),
        "of": (type: "test.load", of: "TimeMap"),
    })"#;
    let loaded = load_text(Path::new("main.ron"), text, &registry(), &LoadOptions::default());
    assert!(loaded.graph.is_none());
    let known = |name: &str| loaded.inferred.iter().find(|i| i.name == name).unwrap();
    let outputs = |name: &str| known(name).outputs.iter().map(|o| (o.ty.as_str(), o.per_frame)).collect::<Vec<_>>();
    assert_eq!((outputs("f"), known("f").is_certain), (vec![("Curve", true)], true));
    assert_eq!((outputs("s"), known("s").is_certain), (vec![("Curve", true)], true));
    assert_eq!((outputs("of"), known("of").is_certain), (vec![("TimeMap", false)], true));
    assert_eq!((outputs("x"), known("lost").is_certain), (vec![], false));
    assert_eq!(loaded.sources.slice(known("s").file, known("s").span), "\"s\"");
    assert_eq!(known("s").clock.as_ref().map(|c| c.last), Some(4));
}

#[test]
fn what_was_meant_stands_for_a_part_of_the_marked_text() {
    let mut count = 0;
    for case in cases() {
        let (loaded, _) = case.load();
        for (diagnostic, replacement) in loaded.diagnostics.iter().filter_map(|d| Some((d, d.replacement.as_ref()?))) {
            let Some(label) = diagnostic.primary() else { continue };
            let marked = loaded.sources.slice(label.file, label.span);
            assert!(marked.contains(&replacement.word), "{}: `{}` in {marked}", case.name, replacement.word);
            count += 1;
        }
    }
    assert!(count >= 10, "{count} suggestions");
}
