//! Graphs from mattes and contours to captures: on contours whose truth is known, and on drawn footage where it lies beside the project.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::npz;
use pegbar_engine::value::{Curve, Value, ValueRef, downcast};

use crate::data::{Shape, Weights};
use crate::footage_tests::folder;

/// Runs a graph of these nodes on so many frames and returns the first output of one, frame by frame; or the errors of the run.
fn run(folder: &Path, frames: usize, nodes: &str, wanted: (&str, usize)) -> Result<Vec<ValueRef>, Vec<String>> {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: {frames}, fps: 12), nodes: {{ {nodes} }})");
    let loaded = load_text(&folder.join("test.ron"), &text, &crate::registry(), &LoadOptions::default());
    let graph = loaded.graph.unwrap_or_else(|| panic!("{:#?}", loaded.diagnostics));
    let port = Port { node: graph.find(wanted.0).unwrap(), output: wanted.1 };
    let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
    if report.failures.is_empty() {
        return Ok(report.kept.remove(&port).unwrap().into_iter().map(Option::unwrap).collect());
    }
    Err(report.failures.iter().map(|f| format!("{f:?}")).collect())
}

fn all<T: Value>(values: Vec<ValueRef>) -> Vec<Arc<T>> {
    values.into_iter().map(|v| downcast(v).unwrap()).collect()
}

/// A blob with a nose that turns, grows and bends.
fn blob(n: usize, bend: f64, turn: f64, size: f64) -> Vec<[f64; 2]> {
    let (s, c) = libm::sincos(turn);
    (0..n)
        .map(|i| {
            let t = i as f64 / n as f64 * std::f64::consts::TAU;
            let r = 60.0 + 30.0 * libm::exp(-6.0 * (t - 1.0) * (t - 1.0)) + bend * libm::cos(2.0 * t) + 0.4 * bend * libm::sin(3.0 * t);
            let (x, y) = (size * r * libm::cos(t), size * r * libm::sin(t));
            [200.0 + c * x - s * y, 150.0 + s * x + c * y]
        })
        .collect()
}

fn written(folder: &Path, shapes: &[Vec<[f64; 2]>]) {
    let frames: Vec<i64> = (1..=shapes.len() as i64).collect();
    let value = |k: usize| -> ValueRef { Arc::new(Shape { points: shapes[k].clone(), closed: true }) };
    let file = std::fs::File::create(folder.join("shapes.npz")).unwrap();
    npz::write_stream(&frames, |k| Ok::<_, npz::NpzError>(value(k)), false, file).unwrap();
}

const READ: &str = "\"shapes\": (type: \"io.read_value\", path: \"shapes.npz\", as: \"Shape\"),";

#[test]
fn a_sequence_of_contours_is_captured_by_keys_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let bends: Vec<f64> = (0..9).map(|t| 20.0 * libm::sin(f64::from(t) * 0.7)).collect();
    let shapes: Vec<_> = bends.iter().enumerate().map(|(t, b)| blob(80, *b, 0.1 * t as f64, 1.0 + 0.05 * t as f64)).collect();
    written(folder.path(), &shapes);
    let nodes = format!(
        "{READ} \"keys\": (type: \"keys.pick\", shape: \"@shapes\", frames: [3, 8], align: similarity),
        \"capture\": (type: \"capture.contour\", shape: \"@shapes\", keys: \"@keys\", affine_model: similarity),
        \"weights\": (type: \"solve.key_weights\", shape: \"@shapes\", keys: \"@keys\", motion: \"@capture.motion\"),"
    );
    for error in all::<Curve>(run(folder.path(), 9, &nodes, ("capture", 2)).unwrap()) {
        assert!(error.value < 1e-6, "{}", error.value);
    }
    let captured = all::<Weights>(run(folder.path(), 9, &nodes, ("capture", 1)).unwrap());
    let solved = all::<Weights>(run(folder.path(), 9, &nodes, ("weights", 0)).unwrap());
    for (t, (a, b)) in captured.iter().zip(&solved).enumerate() {
        assert!(a.weights.iter().zip(&b.weights).all(|(a, b)| (a - b).abs() < 1e-6), "{t}: {a:?} {b:?}");
    }
    assert!((captured[2].weights[0] - 1.0).abs() < 1e-6 && (captured[7].weights[1] - 1.0).abs() < 1e-6);
}

#[test]
fn chosen_keys_capture_every_drawing() {
    let folder = tempfile::tempdir().unwrap();
    let shapes: Vec<_> = (0..9).map(|t| blob(80, 20.0 * libm::sin(f64::from(t) * 0.7), 0.1 * f64::from(t), 1.0)).collect();
    written(folder.path(), &shapes);
    let nodes = format!("{READ} \"keys\": (type: \"keys.choose\", shape: \"@shapes\", affine_model: rigid, enough: 0.01),");
    let errors = all::<Curve>(run(folder.path(), 9, &nodes, ("keys", 3)).unwrap());
    assert!(errors.iter().all(|e| e.value < 0.5), "{errors:?}");
}

#[test]
fn what_is_wrong_with_contours_is_said_with_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    let mut shapes: Vec<_> = (0..3).map(|t| blob(20, f64::from(t), 0.0, 1.0)).collect();
    shapes[1].iter_mut().for_each(|p| p[0] = f64::NAN);
    written(folder.path(), &shapes);
    let text = |nodes: &str, node: &str| run(folder.path(), 3, &format!("{READ} {nodes}"), (node, 0)).unwrap_err().join("\n");
    let keys = "\"keys\": (type: \"keys.pick\", shape: \"@shapes\", frames: [1, 3]),";
    let capture = text(&format!("{keys} \"it\": (type: \"capture.contour\", shape: \"@shapes\", keys: \"@keys\")"), "it");
    assert!(capture.contains("expected finite points, found (NaN, 150) at point 0"), "{capture}");
    let solve = text(&format!("{keys} \"it\": (type: \"solve.key_weights\", shape: \"@shapes\", keys: \"@keys\")"), "it");
    assert!(solve.contains("frame 2: expected finite points"), "{solve}");
    let few = "\"few\": (type: \"shape.resample\", shape: \"@first\", count: 5), \"first\": (type: \"time.pick\", stream: \"@shapes\"),";
    let counts = text(&format!("{keys} {few} \"it\": (type: \"shape.fit_affine\", from: \"@first\", to: \"@few\")"), "it");
    assert!(counts.contains("expected as many points as the first contour has, 20, found 5"), "{counts}");
    let bad = text("\"it\": (type: \"keys.pick\", shape: \"@shapes\", frames: [1, 2])", "it");
    assert!(bad.contains("frame 2: expected finite points, found (NaN, "), "{bad}");
    let chosen = text("\"it\": (type: \"keys.choose\", shape: \"@shapes\")", "it");
    assert!(chosen.contains("frame 2: expected finite points, found (NaN, "), "{chosen}");
}

#[test]
fn an_empty_matte_is_said_or_gives_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let matte =
        "\"black\": (type: \"image.constant\", size: (8, 6)), \"matte\": (type: \"matte.from_image\", image: \"@black\", channel: luma),";
    let error =
        run(folder.path(), 1, &format!("{matte} \"it\": (type: \"shape.trace\", alpha: \"@matte\")"), ("it", 0)).unwrap_err().join("\n");
    assert!(error.contains("expected at least 1 outlines at coverage 0.5, found 0; the largest coverage is 0"), "{error}");
    let nothing = format!("{matte} \"it\": (type: \"shape.trace\", alpha: \"@matte\", empty: nothing)");
    assert!(all::<Shape>(run(folder.path(), 1, &nothing, ("it", 0)).unwrap())[0].points.is_empty());
}

/// Captures a drawn clip by a few of its own drawings and asserts the worst error, in pixels.
fn captured(files: &str, frames: usize, key: &str, keys: &str, worst: f64) {
    let Some(folder) = folder() else {
        eprintln!("skipped: no folder of cartoons; PEGBAR_CARTOONS may name one");
        return;
    };
    let nodes = format!(
        "\"plate\": (type: \"io.read_images\", path: \"{files}\"),
        \"key\": ({key}, image: \"@plate\"),
        \"outline\": (type: \"shape.trace\", alpha: \"@key\"),
        \"points\": (type: \"shape.resample\", shape: \"@outline\"),
        \"keys\": (type: \"keys.choose\", shape: \"@points\", {keys}),
        \"capture\": (type: \"capture.contour\", shape: \"@points\", keys: \"@keys\"),"
    );
    let errors = all::<Curve>(run(&folder, frames, &nodes, ("capture", 2)).unwrap());
    assert!(errors.iter().all(|e| e.value < worst), "{:?}", errors.iter().map(|e| e.value).collect::<Vec<_>>());
}

#[test]
fn a_drawn_ball_needs_one_key() {
    let key = "type: \"matte.color_clusters\", foreground: [(0.93, 0.11, 0.14)], ink: 0, mix: display";
    captured("bouncing_ball/ball.####.png", 6, key, "count: 1", 2.0);
}
