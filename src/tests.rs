//! The command line in one process, on nodes of numbers.

mod author;
mod codes;
mod why;

use std::path::Path;

use clap::CommandFactory;
use pegbar_engine::cache::Cache;
use pegbar_engine::node::{Cancel, Context, In, NodeError, PerFrame};
use pegbar_engine::registry::Registry;
use pegbar_engine::setting::{ClockName, OutputPath};
use pegbar_engine::value::{Curve, digest};
use pegbar_engine::{Node, Outputs};

use crate::{Console, run_cli};

/// One number.
#[derive(Outputs)]
struct Number {
    /// The number.
    value: Curve,
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "test.frame", version = 1, kind = source, outputs = Number, uses_frame)]
struct FrameNumber {
    /// The clock that is counted.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "read by the checker")]
    clock: ClockName,
}

impl PerFrame for FrameNumber {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: cx.frame as f64 } })
    }
}

/// A number times a gain. Fails from a frame on.
///
/// The gain is held where it is one value.
#[derive(Node)]
#[node(id = "test.gain", version = 3, outputs = Number, source = "Euclid, Elements VII, definition 15", example = "\"g\": (type: \"test.gain\", a: \"@f\", gain: 2.0)")]
struct Gain {
    /// What is multiplied.
    a: In<Curve>,
    /// The factor. 0 gives nought, 10 the most.
    #[input(default = 1.0, range = 0.0..=10.0, unit = "px")]
    gain: f64,
    /// First frame at which it fails.
    #[input(default = 100)]
    fails: i64,
}

impl PerFrame for Gain {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        if cx.frame >= self.fails {
            return Err(NodeError::input("expected an early frame, found a late one").help("ask for fewer frames"));
        }
        Ok(Number { value: Curve { value: self.a.value * self.gain } })
    }
}

/// Writes a number to a file.
#[derive(Node)]
#[node(id = "test.write", version = 1, kind = sink)]
struct Write {
    /// The number.
    value: In<Curve>,
    /// The file.
    path: OutputPath,
    /// True for a node that says that it wrote and did not.
    #[input(default = false)]
    lies: bool,
}

impl PerFrame for Write {
    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let path = self.path.at(cx.frame);
        if self.lies {
            return Ok(());
        }
        std::fs::write(&path, format!("{}\n", self.value.value)).map_err(|e| NodeError::io(&path, e))
    }
}

pub(crate) fn registry() -> Registry {
    Registry::new().per_frame::<FrameNumber>().per_frame::<Gain>().per_frame::<Write>()
}

pub(crate) struct Ran {
    pub(crate) code: u8,
    pub(crate) out: String,
    pub(crate) err: String,
}

fn cli_with(args: &[&str], cancel: Cancel) -> Ran {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let mut console = Console { stdout: &mut out, stderr: &mut err, is_terminal: false, colour: false, cancel };
    let code = run_cli(std::iter::once("pegbar").chain(args.iter().copied()), &registry(), &mut console);
    Ran { code, out: String::from_utf8(out).unwrap(), err: String::from_utf8(err).unwrap() }
}

pub(crate) fn cli(args: &[&str]) -> Ran {
    cli_with(args, Cancel::default())
}

/// A folder with the graph `g.ron` of eight frames.
struct Shot(tempfile::TempDir);

impl Shot {
    fn new(nodes: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let text =
            format!("Graph(\n    pegbar: 1,\n    frames: (first: 1, last: 8, fps: 24),\n    nodes: {{\n        {nodes}\n    }},\n)\n");
        std::fs::write(folder.path().join("g.ron"), text).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_string_lossy().into_owned()
    }

    fn run(&self, more: &[&str]) -> Ran {
        let (graph, out) = (self.path("g.ron"), self.path("out"));
        let cache = self.path("cache");
        let mut args = vec!["run", &graph, "--out", &out];
        // A cache of its own: what other tests leave, or whoever runs them, is not for this one.
        if !more.contains(&"--cache") && !more.contains(&"--no-cache") {
            args.extend(["--cache", &cache]);
        }
        args.extend(more);
        let ran = cli(&args);
        Ran { code: ran.code, out: self.plain(&ran.out), err: self.plain(&ran.err) }
    }

    /// Text without the name of the temporary folder.
    fn plain(&self, text: &str) -> String {
        text.replace(&format!("{}/", self.0.path().display()), "")
    }

    fn read(&self, name: &str) -> Option<String> {
        std::fs::read_to_string(self.path(name)).ok()
    }
}

const FINE: &str = r#""f": (type: "test.frame"),
        "g": (type: "test.gain", a: "@f", gain: 2.0),
        "out": (type: "test.write", value: "@g", path: "$out/n.##.txt"),"#;

#[test]
fn the_arguments_are_well_defined() {
    crate::args::Cli::command().debug_assert();
}

#[test]
fn a_run_writes_what_was_asked_for_and_nothing_else() {
    let shot = Shot::new(FINE);
    let ran = shot.run(&["--frames", "2-6x2", "--set", "g.gain=3.0"]);
    assert_eq!((ran.code, ran.out.as_str()), (0, ""), "{}", ran.err);
    let read: Vec<Option<String>> = (1..=8).map(|f| shot.read(&format!("out/n.{f:02}.txt"))).collect();
    let expected = [None, Some("6\n"), None, Some("12\n"), None, Some("18\n"), None, None];
    assert_eq!(read, expected.map(|e| e.map(str::to_owned)));
    assert!(ran.err.contains("3 files: out/n.02.txt ... out/n.06.txt"), "{}", ran.err);
    assert!(ran.err.contains("planned: 3 nodes, 3 frames, 9 tasks"), "{}", ran.err);
    let done: Vec<&str> = ran.err.lines().filter(|l| l.starts_with("done:")).filter_map(|l| l.split_whitespace().nth(1)).collect();
    assert_eq!(done, ["f", "g", "out"]);
    let row = ran.err.lines().find(|l| l.starts_with("  g ")).unwrap();
    assert_eq!(row.split_whitespace().take(3).collect::<Vec<_>>(), ["g", "test.gain", "3"]);
}

#[test]
fn the_values_of_a_node_are_taken_without_a_sink() {
    let shot = Shot::new(FINE);
    let ran = shot.run(&["--only", "g", "--frames", "2,5"]);
    assert_eq!((ran.code, ran.out.as_str()), (0, ""), "{}", ran.err);
    assert!(ran.err.ends_with("1 file: out/g.value.npz\n"), "{}", ran.err);
    assert!(shot.read("out/n.02.txt").is_none(), "the sink did not run");
    let file = std::fs::File::open(shot.path("out/g.value.npz")).unwrap();
    let mut archive = pegbar_engine::npz::Archive::open(file, 1 << 20).unwrap();
    assert_eq!(archive.frames().unwrap(), Some(vec![2, 5]));
    let value = archive.frame(registry().get_type("Curve").unwrap(), 1, 2).unwrap();
    assert_eq!(pegbar_engine::value::downcast::<Curve>(value).unwrap().value, 10.0);
}

#[test]
fn no_progress_is_silence() {
    let ran = Shot::new(FINE).run(&["--progress", "none"]);
    assert_eq!((ran.code, ran.out.as_str(), ran.err.as_str()), (0, "", ""));
}

#[test]
fn progress_as_json_is_one_object_a_line() {
    let ran = Shot::new(FINE).run(&["--progress", "json", "--set", "g.fails=7"]);
    assert_eq!(ran.code, 1);
    let events: Vec<serde_json::Value> = ran.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(events[0], serde_json::json!({"event": "planned", "nodes": 3, "frames": 8, "tasks": 24}));
    let last = events.last().unwrap();
    assert_eq!((&last["event"], &last["status"], &last["failed_tasks"]), (&"finished".into(), &"failed".into(), &2.into()));
    assert_eq!(last["files"].as_array().map(Vec::len), Some(6));
    assert_eq!(last["diagnostics"][0]["line"], 6);
    assert!(events.iter().any(|e| e["event"] == "failed" && e["node"] == "g" && e["frame"] == 8));
}

#[test]
fn a_failure_points_at_the_node_and_folds_its_frames() {
    let shot = Shot::new(FINE);
    let ran = shot.run(&["--set", "g.fails=4", "--progress", "none"]);
    assert_eq!(ran.code, 1);
    let expected = "\
error[PB0500]: node `g` failed at frames 4-8: expected an early frame, found a late one
 --> g.ron:6:9
  |
6 |         \"g\": (type: \"test.gain\", a: \"@f\", gain: 2.0),
  |         ^^^ test.gain with a: Curve []
  |
  = help: ask for fewer frames

failed: 5 tasks; 5 frames of the outputs not made
";
    assert_eq!(ran.err, expected);
    assert_eq!(shot.read("out/n.03.txt").as_deref(), Some("6\n"));
}

#[test]
fn a_file_that_was_not_written_is_missed() {
    let shot = Shot::new(FINE);
    let ran = shot.run(&["--set", "out.lies=true", "--progress", "none"]);
    assert_eq!(ran.code, 1);
    assert!(ran.err.contains("error[PB0501]: expected a file at out/n.01.txt and 7 more from node `out`, found none"), "{}", ran.err);
}

/// The events of a trace.
fn events(trace: &str) -> Vec<serde_json::Value> {
    let trace: serde_json::Value = serde_json::from_str(trace).unwrap();
    trace["traceEvents"].as_array().unwrap().clone()
}

#[test]
fn a_trace_shows_every_task_once_and_one_at_a_time_on_each_thread() {
    let name = r#"g \"quoted\" \\ ä"#;
    let nodes = FINE.replace("\"g\":", &format!("\"{name}\":")).replace("@g", &format!("@{name}"));
    let shot = Shot::new(&nodes);
    let trace = shot.path("traces/t.json");
    let before = std::time::Instant::now();
    let ran = shot.run(&["--trace", &trace, "--threads", "3"]);
    let wall = before.elapsed().as_micros() as f64;
    assert_eq!(ran.code, 0, "{}", ran.err);
    let events = events(&shot.read("traces/t.json").unwrap());
    let tasks: Vec<_> = events.iter().filter(|e| e["ph"] == "X").collect();
    let mut names: Vec<&str> = tasks.iter().map(|e| e["name"].as_str().unwrap()).collect();
    names.sort_unstable();
    let mut expected: Vec<String> =
        ["f", "g \"quoted\" \\ ä", "out"].iter().flat_map(|n| (1..=8).map(move |f| format!("{n}@{f}"))).collect();
    expected.sort_unstable();
    assert_eq!(names, expected);
    for task in &tasks {
        let frame = task["args"]["frame"].as_i64().unwrap();
        assert!(task["name"].as_str().unwrap().ends_with(&format!("@{frame}")));
    }
    let of_gain: Vec<_> = tasks.iter().filter(|e| e["cat"] == "test.gain").map(|e| e["args"]["bytes"].as_u64()).collect();
    // A number, and what a value costs besides.
    assert_eq!(of_gain, [Some(8 + 64); 8]);
    let nanos = |v: &serde_json::Value| (v.as_f64().unwrap() * 1000.0).round() as u64;
    for thread in 0..3 {
        let mut spans: Vec<(u64, u64)> =
            tasks.iter().filter(|e| e["tid"] == thread).map(|e| (nanos(&e["ts"]), nanos(&e["ts"]) + nanos(&e["dur"]))).collect();
        spans.sort_unstable();
        assert!(spans.windows(2).all(|w| w[0].1 <= w[1].0), "{spans:?}");
        assert!(spans.iter().all(|s| s.1 as f64 <= wall * 1000.0), "{spans:?} within {wall} us");
        let is_named =
            |e: &serde_json::Value| e["name"] == "thread_name" && e["tid"] == thread && e["args"]["name"] == format!("thread {thread}");
        assert!(events.iter().any(|e| e["ph"] == "M" && is_named(e)));
    }
    let live: Vec<u64> = events.iter().filter(|e| e["ph"] == "C").map(|e| e["args"]["bytes"].as_u64().unwrap()).collect();
    assert_eq!((live.len(), live.contains(&(8 + 64))), (24, true), "{live:?}");
}

#[test]
fn a_trace_is_there_after_a_run_that_fails_or_is_cancelled() {
    let shot = Shot::new(FINE);
    let trace = shot.path("t.json");
    assert_eq!(shot.run(&["--trace", &trace, "--set", "g.fails=4"]).code, 1);
    let found = events(&shot.read("t.json").unwrap());
    assert_eq!(found.iter().filter(|e| e["ph"] == "X").count(), 8 + 8 + 3);
    let cancel = Cancel::default();
    cancel.cancel();
    let ran = cli_with(&["run", &shot.path("g.ron"), "--out", &shot.path("out"), "--trace", &trace], cancel);
    assert_eq!((ran.code, events(&shot.read("t.json").unwrap()).iter().filter(|e| e["ph"] == "X").count()), (130, 0));
    std::fs::write(shot.path("file"), "").unwrap();
    let ran = shot.run(&["--trace", &shot.path("file/t.json")]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.starts_with("error: the trace cannot be written: file/t.json: making its folder failed:"), "{}", ran.err);
}

#[test]
fn a_failure_is_saved_and_replayed_where_nothing_of_the_run_is_left() {
    let shot = Shot::new(FINE);
    let ran = shot.run(&["--set", "g.fails=4", "--progress", "none", "--threads", "1", "--save-failure", &shot.path("failed")]);
    assert_eq!(ran.code, 1);
    assert!(ran.err.ends_with("saved: `pegbar replay failed/g@4` runs it alone\n"), "{}", ran.err);
    assert_eq!(std::fs::read_dir(shot.path("failed")).unwrap().count(), 1, "one of a node, and the first");
    let elsewhere = tempfile::tempdir().unwrap();
    let bundle = elsewhere.path().join("b").to_string_lossy().into_owned();
    std::fs::rename(shot.path("failed/g@4"), &bundle).unwrap();
    std::fs::remove_dir_all(shot.0.path()).unwrap();
    let ran = cli(&["replay", &bundle]);
    let expected = "\
error: node `g` failed at frame 4: expected an early frame, found a late one
  = help: ask for fewer frames
  = note: test.gain with a: Curve []

the failure is reproduced
";
    assert_eq!((ran.code, ran.out.as_str(), ran.err.as_str()), (1, "", expected));
    let record = format!("{bundle}/failure.json");
    let text = std::fs::read_to_string(&record).unwrap();
    std::fs::write(&record, text.replace("\"literal\": \"4\"", "\"literal\": \"5\"")).unwrap();
    let out = format!("{bundle}/../out");
    let ran = cli(&["replay", &bundle, "--out", &out]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.err.starts_with("node `g` at frame 4 no longer fails; in the run it failed: expected an early frame"), "{}", ran.err);
    let mut archive = pegbar_engine::npz::Archive::open(std::fs::File::open(format!("{out}/value.npz")).unwrap(), 1 << 20).unwrap();
    let value = archive.value(registry().get_type("Curve").unwrap()).unwrap();
    assert_eq!(pegbar_engine::value::downcast::<Curve>(value).unwrap().value, 8.0);
    std::fs::write(&record, text.replace("a late one", "a latecomer")).unwrap();
    let ran = cli(&["replay", &bundle]);
    assert_eq!(ran.code, 1);
    assert!(
        ran.err.contains("found a late one")
            && ran.err.contains("fails otherwise; in the run it failed: expected an early frame, found a latecomer")
    );
    std::fs::write(&record, text.replace("\"version\": 3", "\"version\": 2")).unwrap();
    let ran = cli(&["replay", &bundle]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.starts_with("error: expected version 2 of `test.gain`, as saved by Pegbar"), "{}", ran.err);
    assert_eq!(cli(&["replay", "/nowhere"]).code, 2);
}

#[test]
fn each_node_that_fails_is_saved_and_trouble_with_that_hides_nothing() {
    let nodes: String = (0..10).map(|i| format!("\"g{i}\": (type: \"test.gain\", a: \"@f\", fails: 2), \"o{i}\": (type: \"test.write\", value: \"@g{i}\", path: \"$out/{i}.#.txt\"),\n")).collect();
    let shot = Shot::new(&format!("\"f\": (type: \"test.frame\"),\n{nodes}"));
    let ran = shot.run(&["--progress", "none", "--save-failure", &shot.path("failed")]);
    assert_eq!((ran.code, ran.err.matches("saved: ").count()), (1, 8), "{}", ran.err);
    assert_eq!(std::fs::read_dir(shot.path("failed")).unwrap().count(), 8);
    std::fs::write(shot.path("file"), "").unwrap();
    let ran = shot.run(&["--progress", "none", "--frames", "2", "--save-failure", &shot.path("file")]);
    assert_eq!((ran.code, ran.err.matches("error[PB0500]").count()), (1, 10));
    let warning = "warning: the failure of node `g0` is not saved: file: making the folder failed:";
    assert!(ran.err.contains(warning) || ran.err.matches("is not saved: file: making the folder failed:").count() == 8, "{}", ran.err);
}

#[test]
fn a_sink_that_fails_is_replayed_with_the_file_in_a_folder_of_its_own() {
    let shot = Shot::new(&FINE.replace("$out/n", "$out/no/n"));
    let ran = shot.run(&["--progress", "none", "--threads", "1", "--save-failure", &shot.path("failed")]);
    assert_eq!(ran.code, 1);
    std::fs::remove_dir_all(shot.path("out")).unwrap();
    let ran = cli(&["replay", &shot.path("failed/out@1")]);
    assert!(ran.code == 1 && ran.err.ends_with("the failure is reproduced\n"), "{}", ran.err);
    assert!(!Path::new(&shot.path("out")).exists());
    std::fs::create_dir_all(shot.path("elsewhere/no")).unwrap();
    let ran = cli(&["replay", &shot.path("failed/out@1"), "--out", &shot.path("elsewhere")]);
    assert_eq!((ran.code, shot.read("elsewhere/no/n.01.txt").as_deref()), (0, Some("2\n")), "{}", ran.err);
}

#[test]
fn what_is_wrong_with_the_command_line_is_said_before_anything_runs() {
    let shot = Shot::new(FINE);
    let cases: [(&[&str], &str); 8] = [
        (&["--frames", "3-12"], "error[PB0510]: expected frames from 1 to 8 on clock `frames`, found 3-12"),
        (&["--frames", "8-1"], "expected a range that goes up, found `8-1`"),
        (&["--only", "ouf"], "did you mean `out`?"),
        (&["--only", "elsewhere"], "the nodes are f, g, out"),
        (&["--set", "g.gian=1"], "did you mean `gain`?"),
        (&["--set", "g"], "expected NAME=VALUE, found `g`"),
        (&["--set", "g.gain=11"], "PB0131"),
        (&["--threads", "0"], "0 is not in 1..=1024"),
    ];
    for (args, message) in cases {
        let ran = shot.run(args);
        assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{args:?}");
        assert!(ran.err.contains(message), "{args:?}: {}", ran.err);
    }
    assert!(!Path::new(&shot.path("out")).exists(), "nothing was made");
}

#[test]
fn a_graph_without_sinks_says_what_to_do() {
    let ran = Shot::new(r#""f": (type: "test.frame"),"#).run(&[]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("PB0512") && ran.err.contains("such as --only f"), "{}", ran.err);
}

#[test]
fn an_output_folder_that_cannot_be_made_is_one_error() {
    let shot = Shot::new(FINE);
    std::fs::write(shot.path("out"), "a file").unwrap();
    let ran = shot.run(&[]);
    assert_eq!((ran.code, ran.err.matches("error[").count()), (2, 1), "{}", ran.err);
    assert!(ran.err.contains("error[PB0513]: expected an output folder that can be written at out, found:"), "{}", ran.err);
}

#[test]
fn a_cancelled_run_has_its_own_code() {
    let shot = Shot::new(FINE);
    let cancel = Cancel::default();
    cancel.cancel();
    let ran = cli_with(&["run", &shot.path("g.ron"), "--out", &shot.path("out")], cancel);
    assert_eq!(ran.code, 130);
    assert!(ran.err.ends_with("cancelled: files that are there are whole\n"), "{}", ran.err);
}

#[test]
fn a_check_tells_all_that_is_wrong_and_runs_nothing() {
    let shot = Shot::new(r#""f": (type: "test.fram"), "g": (type: "test.gain", a: "@nobody", gian: 1.0),"#);
    let ran = cli(&["check", &shot.path("g.ron")]);
    assert_eq!((ran.code, ran.out.as_str()), (2, ""));
    for code in ["PB0120", "PB0121", "PB0140", "g.ron: 3 errors; `pegbar explain PB0120` says more"] {
        assert!(ran.err.contains(code), "{code}: {}", ran.err);
    }
    let json = cli(&["check", &shot.path("g.ron"), "--format", "json"]);
    let report: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!((json.code, json.err.as_str(), &report["errors"], &report["ok"]), (2, "", &3.into(), &false.into()));
    assert_eq!((&report["diagnostics"][0]["line"], &report["diagnostics"][0]["text"]), (&5.into(), &"\"test.fram\"".into()));
    let fine = Shot::new(FINE);
    let ran = cli(&["check", &fine.path("g.ron")]);
    assert_eq!((ran.code, fine.plain(&ran.out).as_str(), ran.err.as_str()), (0, "g.ron: fine, 3 nodes, frames 1-8 at 24 fps\n", ""));
    assert!(!Path::new(&fine.path("out")).exists());
}

#[test]
fn a_file_that_is_not_there_is_an_error_of_the_graph() {
    for command in ["run", "check", "graph"] {
        let ran = cli(&[command, "/nowhere/g.ron"]);
        assert_eq!(ran.code, 2, "{command}");
        assert!(ran.err.contains("PB0100"), "{command}: {}", ran.err);
    }
}

#[test]
fn nodes_and_types_are_listed() {
    let ran = cli(&["nodes"]);
    assert_eq!(
        ran.out,
        "test\n  test.frame  The number of the frame.\n  test.gain   A number times a gain.\n  test.write  Writes a number to a file.\n"
    );
    let json: serde_json::Value = serde_json::from_str(&cli(&["nodes", "--format", "json"]).out).unwrap();
    assert_eq!((json.as_array().map(Vec::len), &json[1]["inputs"][1]["unit"]), (Some(3), &"px".into()));
    let types = cli(&["types"]).out;
    assert!(types.lines().any(|l| l.starts_with("Curve ")), "{types}");
}

#[test]
fn a_node_is_explained_from_its_struct() {
    let expected = "\
test.gain  (version 3; per frame: any frame by itself)

A number times a gain. Fails from a frame on.

The gain is held where it is one value.

Inputs
  a: Curve; must be given
      What is multiplied.
      takes: a stream, read at the same frame, or one value, held
      or a literal: a number

  gain: number, or a Curve; in px; 0 to 10; default 1.0
      The factor. 0 gives nought, 10 the most.
      takes: a stream, read at the same frame, or one value, held

  fails: whole number; default 100
      First frame at which it fails.

Outputs
  value: Curve; one value a frame if any of its inputs is a stream
      The number.

Source
  Euclid, Elements VII, definition 15

Example
  \"g\": (type: \"test.gain\", a: \"@f\", gain: 2.0)
";
    assert_eq!(cli(&["explain", "test.gain"]).out, expected);
}

#[test]
fn types_and_codes_are_explained_and_near_misses_are_named() {
    let curve = cli(&["explain", "Curve"]).out;
    assert!(curve.contains("value: f64 []") && curve.contains("Made by\n  test.frame, test.gain"), "{curve}");
    let code = cli(&["explain", "pb0142"]).out;
    assert!(code.starts_with("PB0142: a wire between two types\n") && code.contains("\nMended\n"), "{code}");
    let wrong = cli(&["explain", "test.gian"]);
    assert_eq!((wrong.code, wrong.out.as_str()), (2, ""));
    assert!(wrong.err.contains("did you mean `test.gain`?"), "{}", wrong.err);
}

#[test]
fn a_graph_is_drawn() {
    let shot = Shot::new(FINE);
    let svg = cli(&["graph", &shot.path("g.ron"), "--format", "svg"]);
    assert_eq!((svg.code, svg.out.starts_with("<svg "), svg.out.contains("test.gain")), (0, true, true));
    assert!(cli(&["graph", &shot.path("g.ron"), "--format", "dot"]).out.starts_with("digraph pegbar {"));
}

#[test]
fn a_cache_is_described_checked_cut_down_and_removed() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("cache");
    let path = dir.to_string_lossy().into_owned();
    let on = |args: &[&str]| cli(&[&["cache"], args, &["--cache", &path]].concat());
    for args in [&["stats"][..], &["verify"], &["gc", "--to", "0"], &["clear"]] {
        let ran = on(args);
        assert_eq!((ran.code, ran.err.as_str(), dir.exists()), (0, "", false), "a folder that there is not: {args:?}");
    }
    let value = |n: u64| pegbar_engine::value::Vector { values: vec![n as f64; 9000] };
    for n in 0..3 {
        let cache = Cache::open(&dir, 1 << 30).unwrap();
        cache.store(&[n; 32], digest(&value(n.into())).as_bytes(), &value(n.into()));
    }
    let stats = on(&["stats"]);
    assert!(stats.out.contains("3 values, 3 keys, 0 notes\n217 kB of at most 21.5 GB\nlast used in generations 1 to 3"), "{}", stats.out);
    assert!(stats.out.lines().any(|l| l.split_whitespace().eq(["Vector", "3", "217", "kB"])), "{}", stats.out);
    let json: serde_json::Value = serde_json::from_str(&on(&["stats", "--format", "json"]).out).unwrap();
    assert_eq!((&json["values"], &json["types"]["Vector"]["values"]), (&3.into(), &3.into()));
    assert_eq!(on(&["verify"]).out, "3 values sound, 0 removed\n");
    let hex = digest(&value(2)).to_hex();
    std::fs::write(dir.join(format!("v1/blobs/{}/{hex}.npz", &hex[..2])), "torn").unwrap();
    let ran = on(&["verify"]);
    assert_eq!((ran.code, ran.out.as_str()), (1, "2 values sound, 1 removed\n"));
    assert!(ran.err.contains(&format!("warning: {path}/v1: expected the Vector {hex}, found")), "{}", ran.err);
    let ran = on(&["gc", "--to", "100kB"]);
    assert_eq!((ran.code, ran.err.as_str()), (0, ""));
    assert!(ran.out.starts_with("removed 1 value, 72.") && ran.out.ends_with(" kB left\n"), "{}", ran.out);
    let left = Cache::open(&dir, 1 << 30).unwrap();
    assert_eq!([0, 1, 2].map(|n| left.find(&[n; 32]).is_some()), [false, true, false]);
    drop(left);
    assert!(on(&["clear"]).out.starts_with("removed 1 value, 72."));
    assert!(!dir.join("v1").exists());
    std::fs::remove_dir(&dir).unwrap();
    std::fs::write(&dir, "precious").unwrap();
    for args in [&["stats"][..], &["verify"], &["gc", "--to", "0"], &["clear"]] {
        let ran = on(args);
        assert_eq!(ran.code, 1, "{args:?}");
        assert!(ran.err.starts_with(&format!("error: {path}: opening failed: expected a folder, found a file")), "{}", ran.err);
    }
}

#[test]
fn sizes_are_read_with_their_units() {
    let read = ["0", "12", "1.5kB", "2GiB", "3 mib", "500MB"].map(|t| crate::args::size(t).unwrap());
    assert_eq!(read, [0, 12, 1500, 2 << 30, 3 << 20, 500_000_000]);
    for text in ["", "GiB", "-1", "1.2.3", "1 parsec", "99999999TB", "nan"] {
        let error = crate::args::size(text).unwrap_err();
        assert_eq!(error, format!("expected a size as 500MB, 1.5GiB or 1000000, found `{text}`"));
    }
}

#[test]
fn help_and_completions_are_results() {
    for args in [&["--help"][..], &["run", "--help"], &["completions", "bash"], &["--version"]] {
        let ran = cli(args);
        assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{args:?}");
        assert!(ran.out.contains("pegbar"), "{args:?}");
    }
    let wrong = cli(&["rum"]);
    assert_eq!((wrong.code, wrong.out.as_str()), (2, ""));
    assert!(wrong.err.contains("run"), "{}", wrong.err);
}

#[test]
fn units_are_for_people() {
    use crate::summary::{bytes, duration};
    use std::time::Duration;
    let shown = [12, 1_234, 12_345, 999_600, 12_345_678, 59_960_000, 3_600_000_000].map(|us| duration(Duration::from_micros(us)));
    assert_eq!(shown, ["12 us", "1.23 ms", "12.3 ms", "1.00 s", "12.3 s", "1 min 00 s", "1 h 00 min"]);
    assert_eq!([0, 999, 1_000, 1_500_000, 123_456_789_000].map(bytes), ["0 B", "999 B", "1.0 kB", "1.5 MB", "123 GB"]);
}
