//! A plugin that harms its process, in a graph with healthy branches.

use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Observer, Options, Report, execute};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::node::{Cancel, Meter};
use pegbar_engine::plan::Target;
use pegbar_engine::plugin::{Isolation, Workers, find};

use crate::support::plugins::{compile, examples, library_name, write_manifest};
use crate::support::root;
use crate::support::shot::{Shot, cli_in, workers};

/// Each of these tests as two: with workers reached over memory that is shared, and over sockets.
macro_rules! both_transports {
    ($($name:ident),* $(,)?) => {
        mod shared {
            $(#[test]
            fn $name() {
                super::$name(false);
            })*
        }
        mod piped {
            $(#[test]
            fn $name() {
                super::$name(true);
            })*
        }
    };
}

both_transports!(
    what_harms_its_process_fails_in_its_frames_and_nothing_else_does,
    a_worker_may_neither_use_the_network_nor_write_where_it_was_not_told,
    a_write_to_what_was_put_out_is_told_with_its_frame,
    failures_have_codes_of_their_own,
    what_closes_files_or_ends_a_later_task_harms_none,
    a_run_that_is_cancelled_ends_its_workers,
    progress_is_told_while_the_task_runs,
    workers_end_with_their_host,
    bits_are_the_same_in_this_process_and_in_others,
);

/// What the plugin does, at every frame that is a multiple of a number, and how that is told.
const WAYS: [(&str, i64, &str); 16] = [
    ("null", 7, "its process was ended by SIGSEGV"),
    ("abort", 5, "its process was ended by SIGABRT"),
    ("exit", 6, "its process ended itself with exit code 0"),
    ("throw", 9, "its process was ended by SIGABRT"),
    ("stack", 11, "its process was ended by SIGSEGV"),
    ("killed", 8, "its process was ended by SIGKILL"),
    ("garbage", 13, "expected an answer of its process, found what is none"),
    ("scribble", 4, "expected input `vector` to be left as it is, found it written to"),
    ("loop", 10, "expected a sign of life within 1 s, found none"),
    ("huge", 3, "array `values`: expected memory for it, found none"),
    (
        "malloc",
        12,
        "expected its process to take at most 128 MiB of memory, found it asking for more, and going on without: it was ended by SIGSEGV",
    ),
    ("leak", 10, "expected its process to take at most 128 MiB of memory, found more"),
    ("shape", 2, "output `vector`: array `values`: expected f64 [n], found f64 [3, 1]"),
    ("overrun", 7, "output `vector`: array `values`: expected 24 bytes to be written, found more: it wrote behind the end"),
    ("nan", 3, "output `vector`: array `values`: expected finite numbers, found NaN as number 0"),
    ("poison", 4, ""),
];

/// Frames of the graph with all of them; more where somebody asks for it.
fn frames() -> i64 {
    std::env::var("PEGBAR_HOSTILE_FRAMES").ok().and_then(|n| n.parse().ok()).unwrap_or(26)
}

struct Hostile {
    shot: Shot,
    manifest: PathBuf,
    /// Whether its workers are reached over sockets.
    pipes: bool,
}

impl Hostile {
    fn new(pipes: bool) -> Self {
        let shot = Shot::new(1, "");
        let library = shot.path(&library_name("hostile"));
        compile(&root().join("tests/all/plugins/hostile.cpp"), "plugins/include", &[], &library);
        let manifest = write_manifest(&library);
        Self { shot, manifest, pipes }
    }

    /// Runs nodes, and keeps the first output of each.
    fn run(&self, workers: Workers, frames: i64, nodes: &str, options: &Options) -> (Graph, Report) {
        let workers = Workers { pipes: self.pipes, ..workers };
        let mut registry = pegbar_nodes::registry().with_isolation(Isolation::Workers(Box::new(workers)));
        find(&self.manifest).remove(0).unwrap().register(&mut registry).unwrap();
        let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 24), nodes: {{ {nodes} }})");
        let loaded = load_text(Path::new("g.ron"), &text, &registry, &LoadOptions::default());
        let graph = loaded.graph.unwrap_or_else(|| panic!("{}", loaded.sources.render_all(&loaded.diagnostics, false)));
        let targets: Vec<Target> = (0..graph.nodes.len()).map(|node| Target { node, frames: None }).collect();
        let ports: Vec<Port> = (0..graph.nodes.len()).map(|node| Port { node, output: 0 }).collect();
        let report = execute(&graph, &targets, &ports, options).unwrap();
        (graph, report)
    }

    /// What goes wrong in the one way, in the frames 1 to 4 of which the second and the fourth are harmed.
    fn errors(&self, way: &str, path: &str) -> Vec<String> {
        let nodes = format!("{FRAME}, \"h\": (type: \"hostile.vector\", vector: \"@f\", way: {way:?}, every: 2, path: {path:?})");
        let (_, report) = self.run(strict(), 4, &nodes, &options(2));
        report.failures.iter().map(|f| f.error.message.clone()).collect()
    }
}

const FRAME: &str = "\"f\": (type: \"hostile.frame\")";

fn options(threads: usize) -> Options<'static> {
    Options { threads, ..Options::default() }
}

/// Workers with little patience, and little memory each.
fn strict() -> Workers {
    Workers { timeout: Some(Duration::from_secs(1)), memory: 128 << 20, ..workers() }
}

fn vector(report: &Report, graph: &Graph, node: &str, frame: i64) -> Option<Vec<f64>> {
    let port = Port { node: graph.find(node).unwrap(), output: 0 };
    let value = report.kept[&port][usize::try_from(frame - 1).unwrap()].as_ref()?;
    Some(value.parts().arrays[0].1.numbers())
}

fn what_harms_its_process_fails_in_its_frames_and_nothing_else_does(pipes: bool) {
    let hostile = Hostile::new(pipes);
    let node = |(way, every, _): &(&str, i64, &str)| {
        let name = way.replace(' ', "_");
        format!(
            "\"{name}\": (type: \"hostile.vector\", vector: \"@f\", way: {way:?}, every: {every}), \"after_{name}\": (type: \"hostile.vector\", vector: \"@{name}\")"
        )
    };
    let hostiles: Vec<String> = WAYS.iter().map(node).collect();
    let healthy = "\"a\": (type: \"hostile.vector\", vector: \"@f\"), \"b\": (type: \"hostile.vector\", vector: \"@a\")";
    let last = frames();
    let (graph, report) = hostile.run(strict(), last, &format!("{FRAME}, {healthy}, {}", hostiles.join(", ")), &options(4));

    let mut said: BTreeMap<(String, i64), String> = BTreeMap::new();
    for failure in &report.failures {
        let before = said.insert((graph.nodes[failure.node].name.to_string(), failure.frame.unwrap()), failure.error.message.clone());
        assert!(before.is_none(), "{before:?}");
    }
    for frame in 1..=last {
        let numbers = |times: f64| [0.0, 1.0, 2.0].map(|i| times * (frame as f64 + i / 8.0)).to_vec();
        assert_eq!(vector(&report, &graph, "b", frame), Some(numbers(4.0)), "frame {frame}");
        for (way, every, expected) in WAYS {
            let fails = frame % every == 0 && !expected.is_empty();
            let wanted = (!fails).then(|| numbers(4.0));
            assert_eq!(vector(&report, &graph, &format!("after_{way}"), frame), wanted, "{way} at frame {frame}");
            let found = said.remove(&(way.to_owned(), frame));
            assert_eq!(found.is_some(), fails, "{way} at frame {frame}: {found:?}");
            if let Some(found) = found {
                assert!(found.starts_with(&format!("plugin `hostile` 1.0.0: {expected}")), "{way} at frame {frame}: {found}");
            }
        }
    }
    assert!(said.is_empty(), "{said:?}");
    drop((graph, report));
    let folder = hostile.shot.path("");
    assert_eq!(left_over(folder.to_str().unwrap()), 0, "workers are left over");
}

/// Processes that this one started and that have something of a folder mapped.
fn left_over(folder: &str) -> usize {
    let is_one = |pid: &str| {
        let read = |name: &str| std::fs::read_to_string(format!("/proc/{pid}/{name}")).unwrap_or_default();
        let parent = read("stat").rsplit(") ").next().and_then(|rest| rest.split(' ').nth(1).map(str::to_owned));
        parent.as_deref() == Some(&std::process::id().to_string()) && read("maps").contains(folder)
    };
    std::fs::read_dir("/proc").unwrap().flatten().filter(|entry| is_one(&entry.file_name().to_string_lossy())).count()
}

fn a_worker_may_neither_use_the_network_nor_write_where_it_was_not_told(pipes: bool) {
    let hostile = Hostile::new(pipes);
    assert_eq!(hostile.errors("network", ""), ["refused"; 2]);
    let (inside, outside) = (hostile.shot.path("out/a"), hostile.shot.path("b"));
    std::fs::create_dir(hostile.shot.path("out")).unwrap();
    assert_eq!(hostile.errors("write", outside.to_str().unwrap()), ["refused"; 2]);
    let nodes = format!("{FRAME}, \"h\": (type: \"hostile.vector\", vector: \"@f\", way: \"write\", path: {:?})", inside.to_str().unwrap());
    let workers = Workers { writable: vec![hostile.shot.path("out")], ..strict() };
    let (_, report) = hostile.run(workers, 1, &nodes, &options(1));
    assert_eq!((report.failures[0].error.message.as_str(), inside.is_file(), outside.exists()), ("a file", true, false));
}

/// Of small arrays and of such as lie in memory of their own.
fn a_write_to_what_was_put_out_is_told_with_its_frame(pipes: bool) {
    let hostile = Hostile::new(pipes);
    for count in [3, 20_000] {
        let nodes = format!(
            "\"f\": (type: \"hostile.frame\", count: {count}), \"h\": (type: \"hostile.vector\", vector: \"@f\", way: \"late\", every: 4)"
        );
        let (_, report) = hostile.run(strict(), 6, &nodes, &options(1));
        let said: Vec<_> = report.failures.iter().map(|f| (f.frame, f.error.message.as_str())).collect();
        let [(Some(5), message)] = said[..] else { panic!("{count}: {said:?}") };
        // Large memory may have become the output of another node by then.
        let owner = if count > 3 { "hostile." } else { "hostile.vector` made at frame 4" };
        let found = "to be left as it was put out, found it written to later (SIGSEGV";
        assert!(
            message.starts_with(&format!("plugin `hostile` 1.0.0: expected what `{owner}")) && message.contains(found),
            "{count}: {message}"
        );
    }
    // What is written behind a large array reaches what is not there, or is seen.
    let nodes =
        "\"f\": (type: \"hostile.frame\", count: 20001), \"h\": (type: \"hostile.vector\", vector: \"@f\", way: \"overrun\", every: 2)";
    let (_, report) = hostile.run(strict(), 2, nodes, &options(1));
    assert_eq!(report.failures.len(), 1);
    assert!(
        report.failures[0].error.message.contains("expected 160008 bytes to be written, found more"),
        "{}",
        report.failures[0].error.message
    );
}

/// Each kind of failure has a code.
fn failures_have_codes_of_their_own(pipes: bool) {
    let hostile = Hostile::new(pipes);
    let isolation = Isolation::Workers(Box::new(Workers { pipes, ..strict() }));
    let ways = [
        ("shape", "PB0503"),
        ("scribble", "PB0503"),
        ("null", "PB0504"),
        ("exit", "PB0504"),
        ("loop", "PB0505"),
        ("leak", "PB0506"),
        ("malloc", "PB0506"),
    ];
    for (way, code) in ways {
        let node = format!("{FRAME}, \"h\": (type: \"hostile.vector\", vector: \"@f\", way: {way:?})");
        hostile.shot.graph(1, &format!("{node}, \"out\": (type: \"io.write_value\", value: \"@h\", path: \"$out/f.npz\"),"));
        let (graph, out) = (hostile.shot.path("g.ron"), hostile.shot.path("out"));
        let args = ["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-cache", "--progress", "none", "--plugins"];
        let more = ["--plugin-timeout", "1", "--plugin-memory", "128MB"];
        let ran = cli_in(&isolation, &[&args[..], &[hostile.manifest.to_str().unwrap()], &more].concat());
        assert!(ran.code == 1 && ran.err.starts_with(&format!("error[{code}]: node `h` failed")), "{way}: {}", ran.err);
    }
}

fn what_closes_files_or_ends_a_later_task_harms_none(pipes: bool) {
    let hostile = Hostile::new(pipes);
    for way in ["close", "poison", "log"] {
        assert_eq!(hostile.errors(way, ""), [""; 0], "{way}");
    }
}

fn a_run_that_is_cancelled_ends_its_workers(pipes: bool) {
    let hostile = Hostile::new(pipes);
    // One asks whether it is to stop, the other never does.
    for way in ["cancel", "loop"] {
        let nodes = format!("{FRAME}, \"h\": (type: \"hostile.vector\", vector: \"@f\", way: {way:?})");
        let asked = AtomicUsize::new(0);
        // Cancelled once it was asked for often enough for the task to have begun.
        let cancel = Cancel::asking(move || asked.fetch_add(1, Ordering::Relaxed) > 40);
        let workers = Workers { timeout: None, ..workers() };
        let (graph, report) = hostile.run(workers, 2, &nodes, &Options { cancel, ..options(2) });
        assert!(report.failures.iter().all(|f| f.error.cancelled) && vector(&report, &graph, "h", 1).is_none(), "{way}");
    }
}

/// One who looks how much is done.
struct Looks(Arc<Meter>);

impl Observer for Looks {
    fn meter(&self, _thread: usize) -> Option<Arc<Meter>> {
        Some(self.0.clone())
    }
}

/// In workers and in the host: the run is cancelled as soon as it is told.
fn progress_is_told_while_the_task_runs(pipes: bool) {
    let hostile = Hostile::new(pipes);
    for trusted in [Vec::new(), vec!["hostile".to_owned()]] {
        let nodes = format!("{FRAME}, \"h\": (type: \"hostile.vector\", vector: \"@f\", way: \"progress\")");
        let looks = Looks(Arc::default());
        let meter = looks.0.clone();
        let cancel = Cancel::asking(move || meter.done().is_some());
        let workers = Workers { trusted, ..strict() };
        let (_, report) = hostile.run(workers, 1, &nodes, &Options { cancel, observer: &looks, ..options(1) });
        assert!(report.cancelled && report.failures.iter().all(|f| f.error.cancelled));
        assert_eq!(looks.0.done(), Some(0.25));
    }
}

/// Workers end with their host, even where that is killed: only then is there nobody who could write to its standard error.
fn workers_end_with_their_host(pipes: bool) {
    let hostile = Hostile::new(pipes);
    hostile.shot.graph(1, "\"f\": (type: \"hostile.frame\"), \"h\": (type: \"hostile.vector\", vector: \"@f\", way: \"wait\"), \"out\": (type: \"io.write_value\", value: \"@h\", path: \"$out/f.npz\"),");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pegbar"));
    command.env("PEGBAR_PLUGIN_PIPES", if pipes { "1" } else { "" });
    command.arg("run").arg(hostile.shot.path("g.ron")).arg("--out").arg(hostile.shot.path("out")).arg("--plugins").arg(&hostile.manifest);
    let mut host = command.args(["--no-cache", "--progress", "none"]).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let mut said = std::io::BufReader::new(host.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert_eq!(line, "plugin `hostile` 1.0.0 at frame 1: something may be wrong\n");
    host.kill().unwrap();
    host.wait().unwrap();
    said.read_to_string(&mut line).unwrap();
}

#[test]
fn a_plugin_that_is_trusted_runs_in_the_host() {
    let hostile = Hostile::new(false);
    let manifest = hostile.manifest.to_str().unwrap().to_owned();
    hostile.shot.graph(2, "\"f\": (type: \"hostile.frame\"), \"out\": (type: \"io.write_value\", value: \"@f\", path: \"$out/f.npz\"),");
    let (graph, out) = (hostile.shot.path("g.ron"), hostile.shot.path("out"));
    // Of a program that is none there are no workers.
    let nowhere = Isolation::Workers(Box::new(Workers::new("/nowhere/pegbar")));
    let run = |more: &[&str]| {
        let mut args = vec![
            "run",
            graph.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--no-cache",
            "--progress",
            "none",
            "--plugins",
            &manifest,
        ];
        args.extend(more);
        cli_in(&nowhere, &args)
    };
    let ran = run(&[]);
    assert!(ran.code == 1 && ran.err.contains("expected to start a process for it, of /nowhere/pegbar: "), "{}", ran.err);
    assert_eq!(run(&["--trust", "hostile"]).code, 0);
    let lock = cli_in(&nowhere, &["plugin", "lock", graph.to_str().unwrap(), "--plugins", &manifest, "--trust", "hostile"]);
    assert_eq!(lock.code, 0, "{}", lock.err);
    assert_eq!(run(&[]).code, 0, "{}", run(&[]).err);
}

/// Nodes of every kind, pictures that are large enough to lie in shared memory, and more threads than one.
fn bits_are_the_same_in_this_process_and_in_others(pipes: bool) {
    let shot = Shot::new(
        4,
        r#""a": (type: "image.constant", size: (320, 200), color: (0.5, 0.25, 0.125, 1.0)),
        "g": (type: "paper.grain", image: "@a"), "t": (type: "paper.trail", image: "@g"), "d": (type: "print.halftone", image: "@t", pitch: 4.0),
        "e": (type: "paper.exposure", image: "@d"),
        "out": (type: "io.write_images", image: "@d", path: "$out/d.####.exr"),"#,
    );
    let made = |isolation: &Isolation, threads: &str, out: &str| {
        let (graph, out) = (shot.path("g.ron"), shot.path(out));
        let args = ["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-cache", "--progress", "none", "-j", threads];
        let ran = cli_in(isolation, &[&args[..], &["--plugins", examples().to_str().unwrap()]].concat());
        assert_eq!(ran.code, 0, "{}", ran.err);
        (1..=4).map(|f| std::fs::read(out.join(format!("d.{f:04}.exr"))).unwrap()).collect::<Vec<_>>()
    };
    let isolated = Isolation::Workers(Box::new(Workers { pipes, ..workers() }));
    let expected = made(&Isolation::Off, "1", "a");
    for (isolation, threads) in [(&Isolation::Off, "3"), (&isolated, "1"), (&isolated, "3")] {
        assert!(made(isolation, threads, "b") == expected, "{isolation:?} with {threads} threads");
    }
}
