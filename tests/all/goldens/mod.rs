//! Goldens: what each graph that comes with Pegbar gives, in a few numbers that a diff shows.
//!
//! Every `*.ron` below `graphs` and `examples` is run small and held against `tests/golden/<path>.json`. How it is run small says the sidecar
//! `tests/golden/<path>.ron`, whose fields are those of `Sidecar`; without one the first, middle and last frame of each declared output count.
//! After a change that was meant, `PEGBAR_BLESS=examples/hat/hat.ron cargo test --test all goldens` writes one golden anew (`all` for all) and
//! prints what changed.

mod compare;
mod sidecar;
mod summary;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use pegbar_engine::check::{LoadOptions, code};
use pegbar_engine::diag::Diagnostic;
use pegbar_engine::graph::Graph;
use pegbar_engine::npz;
use pegbar_engine::value::{ValueRef, digest, downcast};
use pegbar_nodes::algo::codec::{self, EncodeOptions, Format, Picture};
use pegbar_nodes::data::{Image, Matte};
use serde_json::Value as Json;

use crate::support::collect::{Values, Wanted, collect, complaints, failures, read};
use crate::support::{files_below, root};
use compare::compare;
use sidecar::Sidecar;
use summary::Summary;

/// The most bytes of a golden: more is no longer read by anybody.
const LIMIT: usize = 20 * 1024;

/// Outputs of a graph, in the order in which it declares them.
type Outputs = Vec<(String, Values)>;
/// Summaries by output and frame.
type Summaries = BTreeMap<String, BTreeMap<i64, Summary>>;

fn graphs() -> Vec<String> {
    ["graphs", "examples"].iter().flat_map(|folder| files_below(folder, ".ron")).collect()
}

fn options(sidecar: &Sidecar, out: PathBuf) -> LoadOptions {
    let pairs = |map: &BTreeMap<String, String>| map.iter().map(|(k, v)| (k.clone(), v.clone())).collect();
    LoadOptions { out, variables: pairs(&sidecar.variables), overrides: pairs(&sidecar.set), ..LoadOptions::default() }
}

/// The graph, free of errors and warnings.
fn checked(name: &str, sidecar: &Sidecar, out: PathBuf) -> Result<Graph, String> {
    let loaded = read(&root().join(name), &options(sidecar, out));
    match loaded.graph {
        Some(ref graph) if loaded.diagnostics.is_empty() => Ok(graph.clone()),
        _ => Err(format!("expected a graph without errors or warnings, found\n{}", complaints(&loaded))),
    }
}

/// What the outputs give, the same bits on one thread and on three.
fn run(graph: &Graph, sidecar: &Sidecar) -> Result<Outputs, String> {
    let outputs: Vec<_> = graph.outputs.iter().filter(|(n, _)| sidecar.outputs.is_empty() || sidecar.outputs.contains(n)).collect();
    if outputs.is_empty() || sidecar.outputs.iter().any(|n| !graph.outputs.iter().any(|(o, _)| o == n)) {
        return Err("expected declared `outputs` to compare, and in the sidecar only such; declare what the graph is for".to_owned());
    }
    let wanted = || {
        let one = |(_, port): &&(String, _)| {
            let port: pegbar_engine::graph::Port = *port;
            Wanted { port, frames: Some(sidecar.frames(&graph.nodes[port.node].clock)) }
        };
        outputs.iter().map(one).collect::<Vec<_>>()
    };
    let mut runs = Vec::new();
    for threads in [1, 3] {
        let (report, values) = collect(graph, &wanted(), threads);
        if !report.is_complete() {
            return Err(format!("on {threads} threads:\n{}", failures(graph, &report)));
        }
        runs.push(values);
    }
    let (three, one) = (runs.pop().unwrap_or_default(), runs.pop().unwrap_or_default());
    for (((name, _), one), three) in outputs.iter().zip(&one).zip(&three) {
        let bits = |values: &Values| values.iter().map(|(f, v)| (*f, digest(v.as_ref()))).collect::<Vec<_>>();
        if let Some(((frame, _), _)) = bits(one).iter().zip(bits(three)).find(|(a, b)| **a != *b) {
            return Err(format!("output `{name}` at frame {frame}: expected the same bits on one thread and on three, found others"));
        }
    }
    Ok(outputs.into_iter().map(|(n, _)| n.clone()).zip(one).collect())
}

fn summaries(outputs: &Outputs) -> Summaries {
    let of = |values: &Values| values.iter().map(|(frame, value)| (*frame, Summary::new(value.as_ref()))).collect();
    outputs.iter().map(|(name, values)| (name.clone(), of(values))).collect()
}

fn to_text(graph: &str, summaries: &Summaries) -> String {
    let mut text = format!("{{\n  \"graph\": \"{graph}\"");
    for (output, frames) in summaries {
        let _ = write!(text, ",\n  \"{output}\": {{");
        for (i, (frame, summary)) in frames.iter().enumerate() {
            let _ = write!(text, "{}\n    \"{frame}\": ", if i > 0 { "," } else { "" });
            summary.write("    ", &mut text);
        }
        text.push_str("\n  }");
    }
    text.push_str("\n}\n");
    text
}

fn from_text(text: &str) -> Option<Summaries> {
    let json: Json = serde_json::from_str(text).ok()?;
    let outputs = json.as_object()?.iter().filter(|(name, _)| *name != "graph");
    let frames = |json: &Json| json.as_object()?.iter().map(|(f, s)| Some((f.parse().ok()?, Summary::read(s)?))).collect::<Option<_>>();
    outputs.map(|(name, json)| Some((name.clone(), frames(json)?))).collect()
}

/// Each difference with its output and frame.
fn differences(golden: &Summaries, found: &Summaries) -> Vec<(String, i64, String)> {
    let mut wrong = Vec::new();
    let none = BTreeMap::new();
    for output in golden.keys().chain(found.keys().filter(|k| !golden.contains_key(*k))) {
        let (golden, found) = (golden.get(output).unwrap_or(&none), found.get(output).unwrap_or(&none));
        for frame in golden.keys().chain(found.keys().filter(|k| !golden.contains_key(*k))) {
            let lines = match (golden.get(frame), found.get(frame)) {
                (Some(golden), Some(found)) => compare(golden, found),
                (golden, _) => vec![format!("expected {} value, found the other", if golden.is_some() { "a" } else { "no" })],
            };
            wrong.extend(lines.into_iter().map(|line| (output.clone(), *frame, line)));
        }
    }
    wrong
}

/// Keeps a value for whoever looks into a difference: `.npz`, and a picture where it is one.
fn save(graph: &str, output: &str, frame: i64, value: &ValueRef) -> String {
    let stem = root().join("target/golden-actual").join(graph.trim_end_matches(".ron")).join(format!("{output}.{frame:04}"));
    std::fs::create_dir_all(stem.parent().unwrap()).unwrap();
    let file = PathBuf::from(format!("{}.npz", stem.display()));
    npz::write(value.as_ref(), false, std::fs::File::create(&file).unwrap()).unwrap();
    let picture = downcast::<Image>(value.clone()).map(|image| {
        let names = image.channels();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Picture::new(image.samples().to_vec(), image.width(), image.height(), &names)
    });
    let matte = || downcast::<Matte>(value.clone()).map(|m| Picture::new(m.alpha().to_vec(), m.width(), m.height(), &["Y"]));
    let bytes = picture.or_else(matte).flatten().and_then(|p| codec::encode_to_vec(&p, &EncodeOptions::new(Format::Png)).ok());
    let mut said = format!("    saved: {}", file.display());
    if let Some(bytes) = bytes {
        let file = PathBuf::from(format!("{}.png", stem.display()));
        std::fs::write(&file, bytes).unwrap();
        let _ = write!(said, "\n    saved: {}", file.display());
    }
    said
}

/// True where `PEGBAR_BLESS` names the graph.
fn is_blessed(graph: &str) -> bool {
    std::env::var("PEGBAR_BLESS").is_ok_and(|names| names.split(',').any(|n| n == "all" || n == graph))
}

/// Runs a graph and holds it against its golden; what is wrong, as text.
fn examine(graph: &str) -> Result<(), String> {
    let sidecar = Sidecar::of(graph);
    let out = tempfile::tempdir().map_err(|e| e.to_string())?;
    if sidecar.only_check {
        return only_check(graph, &sidecar, out.path().to_owned());
    }
    let mut loaded = checked(graph, &sidecar, out.path().to_owned())?;
    sidecar.shorten(&mut loaded);
    let outputs = run(&loaded, &sidecar)?;
    let found = summaries(&outputs);
    let text = to_text(graph, &found);
    if text.len() > LIMIT {
        return Err(format!(
            "expected a golden of at most {LIMIT} bytes, found {}: compare fewer `outputs` or `frames` in {}",
            text.len(),
            sidecar::path_of(graph)
        ));
    }
    let path = root().join(golden_of(graph));
    let golden = std::fs::read_to_string(&path).ok();
    let wrong = match golden.as_deref().map(from_text) {
        Some(Some(golden)) => differences(&golden, &found),
        Some(None) => vec![(String::new(), 0, format!("{} cannot be read", golden_of(graph)))],
        None => vec![(String::new(), 0, format!("expected the golden {}, found none", golden_of(graph)))],
    };
    if is_blessed(graph) {
        std::fs::create_dir_all(path.parent().unwrap()).map_err(|e| e.to_string())?;
        std::fs::write(&path, text).map_err(|e| e.to_string())?;
        wrong.iter().for_each(|(output, frame, line)| println!("blessed {graph}: output `{output}` frame {frame}: {line}"));
        return Ok(());
    }
    if wrong.is_empty() { Ok(()) } else { Err(report(graph, &outputs, &wrong)) }
}

/// Differences with what was saved of each value.
fn report(graph: &str, outputs: &Outputs, wrong: &[(String, i64, String)]) -> String {
    let mut text = String::new();
    for (i, (output, frame, line)) in wrong.iter().enumerate() {
        let _ = writeln!(text, "  output `{output}` frame {frame}: {line}");
        let is_last = wrong.get(i + 1).is_none_or(|next| (&next.0, next.1) != (output, *frame));
        let value = outputs.iter().find(|(n, _)| n == output).and_then(|(_, values)| values.get(frame));
        if let Some(value) = value.filter(|_| is_last) {
            let _ = writeln!(text, "{}", save(graph, output, *frame, value));
        }
    }
    let _ = write!(text, "  if this was meant: PEGBAR_BLESS={graph} cargo test --test all goldens");
    text
}

/// A graph for others: nothing may be wrong with it but parameters that wait for their values.
fn only_check(name: &str, sidecar: &Sidecar, out: PathBuf) -> Result<(), String> {
    let loaded = read(&root().join(name), &options(sidecar, out));
    let waits = |d: &Diagnostic| match d.code {
        code::MISSING_INPUT => d.message.starts_with("expected a value for parameter"),
        // The frames are those of the graph that uses it.
        code::FRAMES => d.message.starts_with("expected `frames` in the graph"),
        _ => false,
    };
    if loaded.diagnostics.iter().all(waits) {
        return Ok(());
    }
    Err(format!("expected nothing wrong but parameters without values, found\n{}", complaints(&loaded)))
}

fn golden_of(graph: &str) -> String {
    format!("tests/golden/{}.json", graph.trim_end_matches(".ron"))
}

#[test]
fn graphs_give_what_their_goldens_say() {
    let mut failed = Vec::new();
    for graph in graphs() {
        if let Err(wrong) = examine(&graph) {
            failed.push(format!("{graph}:\n{wrong}"));
        }
    }
    assert!(failed.is_empty(), "\n{}\n", failed.join("\n"));
}

#[test]
fn every_golden_has_its_graph() {
    let graphs = graphs();
    assert!(!graphs.is_empty(), "expected graphs below graphs/ and examples/, found none");
    let known = |file: &String| {
        let is_sidecar = graphs.iter().any(|g| sidecar::path_of(g) == *file);
        let is_golden = graphs.iter().any(|g| golden_of(g) == *file && !Sidecar::of(g).only_check);
        is_sidecar || is_golden
    };
    let stray: Vec<String> = files_below("tests/golden", "").into_iter().filter(|f| !known(f)).collect();
    assert!(stray.is_empty(), "expected a graph for each golden; remove these, or move them with their graphs: {}", stray.join(", "));
}

#[test]
fn a_golden_is_read_back_as_it_was_written() {
    let image = Image::new(40, 20, 4, (0..40 * 20 * 4).map(|i| (i % 97) as f32 / 97.0).collect()).unwrap();
    let weights = pegbar_engine::value::Vector { values: vec![0.1, f64::NAN, -2.5e7, f64::INFINITY] };
    let values = |value: ValueRef| Values::from([(-3, value.clone()), (4, value)]);
    let outputs = vec![("image".to_owned(), values(std::sync::Arc::new(image))), ("w".to_owned(), values(std::sync::Arc::new(weights)))];
    let found = summaries(&outputs);
    let golden = from_text(&to_text("test.ron", &found)).expect("a golden that can be read");
    assert_eq!(differences(&golden, &found), []);
    assert_eq!(golden["image"][&4].arrays[0].1.numbers.len(), 256);
    assert_eq!(golden["image"].len(), 2);
}
