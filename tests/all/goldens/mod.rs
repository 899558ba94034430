//! Goldens: what each graph that comes with Pegbar gives, in a few numbers that a diff shows.
//!
//! Every `*.ron` below `graphs` and `examples` is run small and held against `tests/golden/<path>.json`. How it is run small says the sidecar
//! `tests/golden/<path>.ron`, a golden file as of `pegbar test`; without one the first, middle and last frame of each declared output count.
//! After a change that was meant, `PEGBAR_BLESS=examples/hat/hat.ron cargo test --test all goldens` writes one golden anew (`all` for all) and
//! prints what changed.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use pegbar_engine::check::Loaded;
use pegbar_engine::golden::{self, Case, Compared, GoldenFile, Reference, Seen, from_text, to_text};
use pegbar_engine::graph::Graph;
use pegbar_engine::job::How;
use pegbar_engine::npz;
use pegbar_engine::value::{ValueRef, downcast};
use pegbar_nodes::algo::codec::{self, EncodeOptions, Format, Picture};
use pegbar_nodes::data::{Image, Matte};

use crate::support::collect::{complaints, read};
use crate::support::shot::cli;
use crate::support::{files_below, root};

/// The most bytes of a golden: more is no longer read by anybody.
const LIMIT: usize = 20 * 1024;

/// Values by output and frame.
type Values = BTreeMap<(String, i64), ValueRef>;

fn graphs() -> Vec<String> {
    let all = ["graphs", "examples"].iter().flat_map(|folder| files_below(folder, ".ron"));
    // Layers of shows lie among them.
    let is_graph =
        |file: &String| !golden::is_golden(Path::new(file)) && !std::fs::read_to_string(root().join(file)).unwrap().contains("\nLayer(");
    all.filter(is_graph).collect()
}

fn is_picture(type_name: &str) -> bool {
    matches!(type_name, "Image" | "Matte")
}

/// Where the golden file of a graph is, below the root.
fn sidecar_of(graph: &str) -> String {
    format!("tests/golden/{graph}")
}

/// What is compared of a graph, and how it is run small.
fn case_of(graph: &str) -> Case {
    let path = root().join(sidecar_of(graph));
    if !path.exists() {
        return Case::default();
    }
    let golden = GoldenFile::read(&path);
    assert!(golden.diagnostics.is_empty(), "{}", golden.sources.render_all(&golden.diagnostics, false));
    golden.cases[0].clone()
}

fn load(name: &str, case: &Case, out: &Path) -> Loaded {
    let path = root().join(name);
    read(&path, &case.load_options(path.parent().unwrap(), out.to_owned()))
}

/// What the outputs give, the same bits on one thread and on three.
fn run(graph: &Graph, compared: &[Compared]) -> Result<(Reference, Values), String> {
    let values: Arc<Mutex<Values>> = Arc::default();
    let run_on = |threads| {
        let into = values.clone();
        let keep = move |output: &str, frame: i64, value: &ValueRef| {
            into.lock().unwrap().insert((output.to_owned(), frame), value.clone());
        };
        let how = How { threads, ..How::default() };
        let Seen { outputs, outcome } = golden::observe(graph, compared, is_picture, &how, Some(Arc::new(keep)));
        if outcome.is_complete() {
            return Ok(outputs);
        }
        let said: Vec<&str> = outcome.diagnostics.iter().map(|d| d.message.as_str()).collect();
        Err(format!("on {threads} threads:\n{}", said.join("\n")))
    };
    // At the same time, which is sooner done than one after the other.
    let [one, three] =
        std::thread::scope(|scope| [1, 3].map(|threads| scope.spawn(move || run_on(threads))).map(|run| run.join().unwrap()));
    let (mut found, three) = (one?, three?);
    if let Some((output, frame)) = golden::same_bits(&found, &three) {
        return Err(format!("output `{output}` at frame {frame}: expected the same bits on one thread and on three, found others"));
    }
    // A last bit may be another with the next release of a codec, which is not worth a line in a diff.
    found.values_mut().flat_map(BTreeMap::values_mut).for_each(|summary| summary.bits = None);
    let values = std::mem::take(&mut *values.lock().unwrap());
    Ok((found, values))
}

/// Each difference with its output and frame.
fn differences(golden: &Reference, found: &Reference, case: &Case) -> Vec<(String, i64, String)> {
    let wrong = golden::differences(golden, found, &case.tolerances(is_picture));
    wrong.into_iter().flat_map(|((output, frame), d)| d.into_iter().map(move |d| (output.clone(), frame, d.to_string()))).collect()
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
    let case = case_of(graph);
    let out = tempfile::tempdir().map_err(|e| e.to_string())?;
    let loaded = load(graph, &case, out.path());
    if case.only_check {
        let waits = loaded.diagnostics.iter().all(golden::waits_for_values);
        return if waits {
            Ok(())
        } else {
            Err(format!("expected nothing wrong but parameters without values, found\n{}", complaints(&loaded)))
        };
    }
    let Some(mut runnable) = loaded.graph.clone().filter(|_| loaded.diagnostics.is_empty()) else {
        return Err(format!("expected a graph without errors or warnings, found\n{}", complaints(&loaded)));
    };
    case.shorten(&mut runnable);
    let compared = golden::compared(&runnable, &case, pegbar_engine::diag::FileId::default()).map_err(|d| d.message)?;
    let (found, values) = run(&runnable, &compared)?;
    let text = to_text(graph, &found);
    if text.len() > LIMIT {
        let found = format!("expected a golden of at most {LIMIT} bytes, found {}", text.len());
        return Err(format!("{found}: compare fewer `outputs` or `frames` in {}", sidecar_of(graph)));
    }
    let path = root().join(golden_of(graph));
    let golden = std::fs::read_to_string(&path).ok();
    let wrong = match golden.as_deref().map(from_text) {
        Some(Some(golden)) => differences(&golden, &found, &case),
        Some(None) => vec![(String::new(), 0, format!("{} cannot be read", golden_of(graph)))],
        None => vec![(String::new(), 0, format!("expected the golden {}, found none", golden_of(graph)))],
    };
    if is_blessed(graph) {
        std::fs::create_dir_all(path.parent().unwrap()).map_err(|e| e.to_string())?;
        std::fs::write(&path, text).map_err(|e| e.to_string())?;
        wrong.iter().for_each(|(output, frame, line)| println!("blessed {graph}: output `{output}` frame {frame}: {line}"));
        return Ok(());
    }
    if wrong.is_empty() { Ok(()) } else { Err(report(graph, &values, &wrong)) }
}

/// Differences with what was saved of each value.
fn report(graph: &str, values: &Values, wrong: &[(String, i64, String)]) -> String {
    let mut text = String::new();
    for (i, (output, frame, line)) in wrong.iter().enumerate() {
        let _ = writeln!(text, "  output `{output}` frame {frame}: {line}");
        let is_last = wrong.get(i + 1).is_none_or(|next| (&next.0, next.1) != (output, *frame));
        if let Some(value) = values.get(&(output.clone(), *frame)).filter(|_| is_last) {
            let _ = writeln!(text, "{}", save(graph, output, *frame, value));
        }
    }
    let _ = write!(text, "  if this was meant: PEGBAR_BLESS={graph} cargo test --test all goldens");
    text
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
fn the_hat_is_as_the_golden_beside_it_says() {
    let out = tempfile::tempdir().unwrap();
    let hat = root().join("examples/hat");
    let ran = cli(&["test", hat.to_str().unwrap(), "--no-cache", "--out", out.path().to_str().unwrap()]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.starts_with("pass ") && !ran.out.contains("other bits"), "{}", ran.out);
}

#[test]
fn every_golden_has_its_graph() {
    let graphs = graphs();
    assert!(!graphs.is_empty(), "expected graphs below graphs/ and examples/, found none");
    let known = |file: &String| {
        let is_sidecar = graphs.iter().any(|g| sidecar_of(g) == *file);
        let is_golden = graphs.iter().any(|g| golden_of(g) == *file && !case_of(g).only_check);
        is_sidecar || is_golden
    };
    let stray: Vec<String> = files_below("tests/golden", "").into_iter().filter(|f| !known(f)).collect();
    assert!(stray.is_empty(), "expected a graph for each golden; remove these, or move them with their graphs: {}", stray.join(", "));
}

#[test]
fn a_golden_is_read_back_as_it_was_written() {
    let image = Image::new(40, 20, 4, (0..40 * 20 * 4).map(|i| (i % 97) as f32 / 97.0).collect()).unwrap();
    let weights = pegbar_engine::value::Vector { values: vec![0.1, f64::NAN, -2.5e7, f64::INFINITY] };
    let frames = |value: &dyn pegbar_engine::value::AnyValue| {
        let summary = golden::Summary::new(value, is_picture(value.type_name()));
        BTreeMap::from([(-3, summary.clone()), (4, summary)])
    };
    let found = Reference::from([("image".to_owned(), frames(&image)), ("w".to_owned(), frames(&weights))]);
    let golden = from_text(&to_text("test.ron", &found)).expect("a golden that can be read");
    assert_eq!(differences(&golden, &found, &Case::default()), []);
    assert_eq!(golden["image"][&4].arrays[0].1.numbers.len(), 256);
    assert_eq!(golden["image"].len(), 2);
}
