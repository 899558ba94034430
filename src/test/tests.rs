//! `pegbar test` in one process, on nodes of numbers.

use std::fs;
use std::path::Path;

use crate::tests::{Ran, cli};

/// A folder with `g.ron`, a chain of three gains over eight frames, and its golden.
struct Show(tempfile::TempDir);

const GOLDEN: &str = "Golden(pegbar: 1)\n";

impl Show {
    fn new(golden: &str) -> Self {
        let show = Self(tempfile::tempdir().unwrap());
        show.put("g.ron", &graph("2.0", "3.0"));
        show.put("g.golden.ron", golden);
        show
    }

    /// A show whose reference is kept.
    fn blessed(golden: &str) -> Self {
        let show = Self::new(golden);
        let ran = show.test(&["--bless", "all"]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
        show
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_string_lossy().into_owned()
    }

    fn put(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn test(&self, more: &[&str]) -> Ran {
        self.test_at(".", more)
    }

    fn test_at(&self, path: &str, more: &[&str]) -> Ran {
        let (path, cache, out) = (self.path(path), self.path("cache"), self.path("out"));
        let ran = cli(&[&["test", &path, "--cache", &cache, "--out", &out, "--threads", "2"], more].concat());
        let plain = |text: &str| text.replace(&format!("{}/", self.0.path().display()), "").replace("./", "");
        Ran { code: ran.code, out: plain(&ran.out), err: plain(&ran.err) }
    }
}

fn graph(first: &str, second: &str) -> String {
    format!(
        r#"Graph(
    pegbar: 1,
    frames: (first: 1, last: 8, fps: 24),
    params: {{ "gain": (type: "number", default: 1.0) }},
    nodes: {{
        "f": (type: "test.frame"),
        "a": (type: "test.gain", a: "@f", gain: {first}),
        "b": (type: "test.gain", a: "@a", gain: {second}),
        "c": (type: "test.gain", a: "@b", gain: "$gain"),
        "out": (type: "test.write", value: "@c", path: "$out/n.##.txt"),
    }},
    outputs: {{ "number": "@c", "other": "@f" }},
)
"#
    )
}

/// What is said without the time that it took.
fn timeless(text: &str) -> String {
    text.lines().map(|l| l.rsplit_once(", ").map_or(l, |(l, _)| l)).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_reference_is_missed_blessed_and_met() {
    let show = Show::new(GOLDEN);
    let ran = show.test(&[]);
    assert_eq!(ran.code, 1);
    assert!(ran.err.contains("error[PB0601]: expected the reference g.golden/main.json, found none\n --> g.golden.ron:1:1"), "{}", ran.err);
    assert!(ran.err.contains("--bless main"), "{}", ran.err);
    assert!(!Path::new(&show.path("g.golden")).exists(), "nothing is kept unasked");
    let ran = show.test(&["--bless", "g"]);
    assert_eq!((ran.code, timeless(&ran.out).lines().last()), (0, Some("blessed   g.ron main  2 outputs, 6 values")), "{}", ran.err);
    let ran = show.test(&[]);
    assert_eq!(
        (ran.code, timeless(&ran.out).as_str(), ran.err.as_str()),
        (0, "pass      g.ron main  2 outputs, 6 values", "1 case: 1 pass\n")
    );
    assert!(!Path::new(&show.path("out")).exists(), "the graph's sinks did not run");
    let before = (show.read("g.golden/main.json"), show.read("g.golden/main.nodes.json"));
    let again = show.test(&["--bless", "all", "--no-cache"]);
    assert!(again.out.starts_with("pass "), "nothing changed: {}", again.out);
    assert_eq!((show.read("g.golden/main.json"), show.read("g.golden/main.nodes.json")), before);
}

#[test]
fn a_change_is_found_at_the_node_where_it_begins() {
    let show = Show::blessed(GOLDEN);
    show.put("g.ron", &graph("2.5", "3.0"));
    let ran = show.test(&[]);
    assert_eq!((ran.code, timeless(&ran.out).as_str()), (1, "FAILED    g.ron main  number at frames 1, 4, 8"), "{}", ran.err);
    let expected = "\
error[PB0600]: node `a` left its reference first, in output `value` at frame 1: array `value`: 1 of 1 numbers differ, most of all the number: \
expected 2, found 2.5, difference 0.5; allowed 0.000002 (1e-6 of the extent: a thousandth of what is seen, a million roundings of f64)
 --> g.ron:7:9
  |
7 |         \"a\": (type: \"test.gain\", a: \"@f\", gain: 2.5),
  |         ^^^ test.gain                           --- gain was 2.0, is 2.5
  |
  = help: output number at frames 1, 4, 8 left its reference: array `value`: 1 of 1 numbers differ, most of all the number: expected 6, \
found 7.5, difference 1.5; allowed 0.000006 (1e-6 of the extent: a thousandth of what is seen, a million roundings of f64)
";
    assert!(ran.err.starts_with(expected), "{}\n{expected}", ran.err);
    assert!(ran.err.contains("if this was meant: pegbar test g.ron --bless main"), "{}", ran.err);
}

#[test]
fn a_node_that_is_put_between_or_wired_otherwise_is_the_first() {
    let show = Show::blessed(GOLDEN);
    show.put(
        "g.ron",
        &graph("2.0", "3.0")
            .replace("\"c\":", "\"new\": (type: \"test.gain\", a: \"@b\", gain: 2.0),\n\"c\":")
            .replace("\"@b\", gain: \"$", "\"@new\", gain: \"$"),
    );
    let ran = show.test(&[]);
    assert!(
        ran.code == 1 && ran.err.contains("node `new` left its reference first") && ran.err.contains("node `new`: is new"),
        "{}",
        ran.err
    );
    show.put("g.ron", &graph("2.0", "3.0").replace("a: \"@b\"", "a: \"@a\""));
    let ran = show.test(&[]);
    assert!(ran.err.contains("node `c` left its reference first") && ran.err.contains("a was @b.value, is @a.value"), "{}", ran.err);
}

#[test]
fn a_cause_within_its_tolerance_is_the_first_all_the_same() {
    let tolerance = |at_most: &str| format!("Golden(pegbar: 1, tolerances: {{\"Curve\": (at_most: {at_most}, reason: \"eyes\")}})");
    let show = Show::blessed(&tolerance("0.9"));
    show.put("g.ron", &graph("2.05", "3.0"));
    let ran = show.test(&[]);
    // At frame 8 the output is off by 1.2, the node whose gain changed by 0.4.
    assert!(
        ran.code == 1 && ran.err.contains("node `a` left its reference first, in output `value` at frame 1: other bits"),
        "{}",
        ran.err
    );
    assert!(ran.out.contains("number at frame 8"), "{}", ran.out);
    show.put("g.golden.ron", &tolerance("1.3"));
    let ran = show.test(&[]);
    assert_eq!(
        (ran.code, timeless(&ran.out).lines().last()),
        (0, Some("pass      g.ron main  2 outputs, 6 values, 3 of other bits within their tolerance"))
    );
    show.put("g.golden.ron", "Golden(pegbar: 1, tolerances: {\"number\": (metric: bits, reason: \"a count\")})");
    assert!(show.test(&[]).err.contains("(a count)"));
}

#[test]
fn cases_set_what_they_say_and_are_blessed_by_name() {
    let golden = "Golden(pegbar: 1, outputs: [\"number\"], cases: {\n    \"one\": (frames: \"2\"),\n    \"two\": (frames: \"3-4\", params: {\"gain\": 2.0}, \
                  set: {\"b.gain\": 1.0}, outputs: [\"number\", \"a.value\"]),\n})";
    let show = Show::blessed(golden);
    assert!(show.read("g.golden/two.json").contains("\"3\": {\n      \"type\": \"Curve\""), "{}", show.read("g.golden/two.json"));
    let numbers = |case: &str| show.read(&format!("g.golden/{case}.json")).matches("\"values\": [12]").count();
    assert_eq!((numbers("one"), numbers("two")), (1, 1));
    show.put("g.ron", &graph("3.0", "3.0"));
    let ran = show.test(&["--bless", "g:two"]);
    assert!(
        ran.code == 0 && ran.out.contains("blessed g.ron two: output `number` at frame 3: array `value`") && !ran.out.contains("one"),
        "{}",
        ran.out
    );
    let ran = show.test(&[]);
    assert_eq!((ran.code, ran.err.lines().last()), (1, Some("2 cases: 1 pass, 1 failed")), "{}", ran.out);
    let ran = show.test(&["--bless", "tow"]);
    assert!(ran.code == 2 && ran.err.contains("found `tow`; there are g:one, g:two"), "{}", ran.err);
    show.put("g.golden.ron", "Golden(pegbar: 1, cases: {\"one\": ()})");
    assert!(show.test(&[]).err.contains("warning: expected a case `two` for g.golden/two.json, found none; remove it"));
}

#[test]
fn what_breaks_an_invariant_is_never_blessed() {
    let show = Show::new("Golden(pegbar: 1, same_on_threads: true, invariants: {\"*\": (finite: true), \"number\": (within: (0, 40))})");
    let ran = show.test(&["--bless", "all"]);
    assert_eq!(ran.code, 1);
    let expected =
        "error[PB0602]: output `number` at frame 8: array `value`: expected numbers from 0 to 40, found 48 to 48\n --> g.ron:9:9";
    assert!(ran.err.contains(expected) && ran.err.contains("not blessed: an invariant does not hold"), "{}", ran.err);
    assert!(!Path::new(&show.path("g.golden")).exists());
    show.put("g.ron", &graph("1.0", "3.0"));
    assert_eq!(show.test(&["--bless", "all"]).code, 0);
    show.put("g.ron", &graph("1.0", "30.0"));
    let ran = show.test(&["--bless", "all"]);
    assert!(ran.code == 2 && ran.err.contains("error[PB0131]") && ran.err.contains("as case `main` of g.golden.ron:1:1"), "{}", ran.err);
    assert!(show.read("g.golden/main.json").contains("24"), "the reference is as it was");
}

#[test]
fn a_node_that_fails_fails_the_case() {
    let show = Show::blessed(GOLDEN);
    show.put("g.ron", &graph("2.0, fails: 5", "3.0"));
    let ran = show.test(&["--bless", "all"]);
    assert!(ran.code == 1 && ran.err.contains("error[PB0500]: node `a` failed at frame 8"), "{}", ran.err);
    assert!(show.read("g.golden/main.json").contains("48"));
}

#[test]
fn junit_is_well_formed_and_counts() {
    let show = Show::blessed("Golden(pegbar: 1, cases: {\"a\": (), \"b\": (outputs: [\"other\"])})");
    show.put("g.ron", &graph("2.5", "3.0"));
    show.put("h.ron", "Graph(pegbar: 1, nodes: {\"x\": (type: \"<&\")})");
    show.put("h.golden.ron", GOLDEN);
    let (junit, html) = (show.path("r/junit.xml"), show.path("r/review.html"));
    assert_eq!(show.test(&["--junit", &junit, "--html", &html]).code, 2);
    let text = show.read("r/junit.xml");
    let xml = roxmltree::Document::parse(&text).unwrap();
    let root = xml.root_element();
    assert_eq!(["tests", "failures", "errors"].map(|n| root.attribute(n).unwrap()), ["4", "1", "1"]);
    let suites: Vec<_> = root.children().filter(|n| n.has_tag_name("testsuite")).collect();
    let counts: Vec<_> = suites.iter().map(|s| ["tests", "failures", "errors"].map(|n| s.attribute(n).unwrap())).collect();
    assert_eq!(counts, [["2", "1", "0"], ["1", "0", "0"], ["1", "0", "1"]]);
    let failure = xml.descendants().find(|n| n.has_tag_name("failure")).unwrap();
    assert_eq!(failure.parent().unwrap().attribute("name"), Some("a: number"));
    assert!(failure.attribute("message").unwrap().starts_with("frame 1: array `value`: 1 of 1 numbers differ"));
    assert!(failure.text().unwrap().contains("node `a` left its reference first"));
    let error = xml.descendants().find(|n| n.has_tag_name("error")).unwrap();
    assert!(error.attribute("message").unwrap().contains("`<&`"), "{text}");
    let page = show.read("r/review.html");
    assert!(page.contains("node `a` left its reference first") && page.contains("found `&lt;&amp;`") && !page.contains("{{"), "{page}");
}

#[test]
fn what_is_wrong_with_a_golden_is_said_at_its_place() {
    let show = Show::new("Golden(\n    pegbar: 1,\n    frame: \"1\",\n    tolerances: {\"Curve\": (at_most: 1)},\n)");
    let ran = show.test(&[]);
    assert_eq!((ran.code, ran.out.as_str()), (2, ""));
    for said in [
        "error[PB0101]: expected a field of a golden, found `frame`\n --> g.golden.ron:3:5",
        "did you mean `frames`?",
        "missing field `reason`",
    ] {
        assert!(ran.err.contains(said), "{said}: {}", ran.err);
    }
    for (golden, said) in [
        (
            "Golden(pegbar: 1, outputs: [\"nubmer\"])",
            "error[PB0603]: expected an output of the graph, found `nubmer`\n --> g.golden.ron:1:1",
        ),
        ("Golden(pegbar: 1, frames: \"9\")", "error[PB0603]: output `number`: expected frames from 1 to 8 on clock `frames`, found 9"),
        ("Golden(pegbar: 1, set: {\"a.gian\": 1})", "error[PB0121]"),
    ] {
        show.put("g.golden.ron", golden);
        let ran = show.test(&[]);
        assert!(ran.code == 2 && ran.err.contains(said), "{golden}: {}", ran.err);
    }
    show.put("g.golden.ron", GOLDEN);
    assert_eq!(show.test(&["--bless", "all"]).code, 0);
    show.put("g.golden/main.json", "{");
    let ran = show.test(&[]);
    assert!(ran.code == 2 && ran.err.contains("error: expected a reference as --bless writes it at g.golden/main.json"), "{}", ran.err);
}

#[test]
fn graphs_without_goldens_and_goldens_without_graphs_are_said() {
    let show = Show::new(GOLDEN);
    fs::remove_file(show.path("g.golden.ron")).unwrap();
    for path in [".", "g.ron"] {
        let ran = show.test_at(path, &[]);
        assert!(ran.code == 2 && ran.err.contains("Golden(pegbar: 1)"), "{}", ran.err);
    }
    show.put("gone.golden.ron", GOLDEN);
    let ran = show.test(&[]);
    assert!(ran.code == 2 && ran.err.contains("expected gone.ron beside gone.golden.ron, found none"), "{}", ran.err);
}

#[test]
fn a_graph_for_others_is_only_checked() {
    let show = Show::new("Golden(pegbar: 1, only_check: true)");
    show.put("g.ron", &graph("2.0", "3.0").replace(", default: 1.0", ""));
    let ran = show.test(&[]);
    assert_eq!((ran.code, ran.err.as_str()), (0, "1 case: 1 pass\n"), "{}", ran.out);
    show.put("g.ron", &graph("2.0", "30.0").replace(", default: 1.0", ""));
    assert_eq!(show.test(&[]).code, 2);
}
