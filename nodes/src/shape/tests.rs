//! Graphs from mattes and contours to captures: on contours whose truth is known, and on drawn footage where it lies beside the project.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::npz;
use pegbar_engine::value::{Curve, Value, ValueRef, downcast};

use crate::data::{Affine2, KeyShapes, Shape, Weights};
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

/// One file a frame, from frame 1.
fn written(folder: &Path, shapes: &[Vec<[f64; 2]>]) {
    for (k, points) in shapes.iter().enumerate() {
        put(&folder.join(format!("shape.{:04}.npz", k + 1)), &Shape { points: points.clone(), closed: true });
    }
}

fn put(path: &Path, value: &impl Value) {
    npz::write(value, false, std::fs::File::create(path).unwrap()).unwrap();
}

const READ: &str = "\"shapes\": (type: \"io.read_value\", path: \"shape.####.npz\", as: \"Shape\"),";

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
    assert!(capture.contains("frame 2: expected finite points, found (NaN, "), "{capture}");
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

/// Contours that no motion is determined by, or that nothing tells apart: what stands in for the answer is said by an output.
#[test]
fn contours_that_say_too_little_get_less_of_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let line = |t: f64| (0..20).map(|i| [10.0 + (3.0 + t) * f64::from(i), 20.0 + 2.0 * t * f64::from(i)]).collect();
    written(folder.path(), &[line(0.0), line(0.5), line(1.0)]);
    let number = |nodes: &str, output: (&str, usize)| -> Vec<f64> {
        all::<Curve>(run(folder.path(), 3, &format!("{READ} {nodes}"), output).unwrap()).iter().map(|c| c.value).collect()
    };
    // On a line: a similarity in place of an affine motion, and nobody knows what is across.
    let fit =
        "\"first\": (type: \"time.pick\", stream: \"@shapes\"), \"fit\": (type: \"shape.fit_affine\", from: \"@first\", to: \"@shapes\"),";
    assert_eq!(number(fit, ("fit", 2)), [4.0; 3]);
    assert_eq!(number(fit, ("fit", 3)), [f64::INFINITY; 3]);
    assert!(number(fit, ("fit", 1)).iter().all(|e| *e < 1e-9));
    // Keys that are one key, on a line: all weight on the first, and a condition that says that nothing else is known.
    let keys = "\"keys\": (type: \"keys.pick\", shape: \"@shapes\", frames: [1, 1, 1]),";
    let capture = format!("{keys} \"capture\": (type: \"capture.contour\", shape: \"@shapes\", keys: \"@keys\", smoothness: 1),");
    assert!(number(&capture, ("capture", 2)).iter().all(|e| *e < 0.5));
    let weights = all::<Weights>(run(folder.path(), 3, &format!("{READ} {capture}"), ("capture", 1)).unwrap());
    assert!(weights.iter().all(|w| w.weights == [1.0, 0.0, 0.0]), "{weights:?}");
    let solve = format!("{keys} \"solve\": (type: \"solve.key_weights\", shape: \"@shapes\", keys: \"@keys\", smoothness: 1),");
    let weights = all::<Weights>(run(folder.path(), 3, &format!("{READ} {solve}"), ("solve", 0)).unwrap());
    assert!(weights.iter().all(|w| w.weights == [1.0, 0.0, 0.0]), "{weights:?}");
}

#[test]
fn smoothness_takes_the_tremble_out_of_captures_and_weights() {
    let folder = tempfile::tempdir().unwrap();
    let shaken = |t: i32| f64::from(t * 7 % 5 - 2);
    let shapes: Vec<_> = (0..30)
        .map(|t| {
            let bend = 10.0 + 8.0 * libm::sin(0.2 * f64::from(t)) + 0.5 * shaken(t);
            let mut points = blob(60, bend, 0.0, 1.0);
            points.iter_mut().for_each(|p| p[0] += 6.0 * f64::from(t) + shaken(t + 2));
            points
        })
        .collect();
    written(folder.path(), &shapes);
    let bends = |nodes: &str, of: &dyn Fn(Vec<ValueRef>) -> Vec<f64>, output| -> f64 {
        let values = of(run(folder.path(), 30, &format!("{READ} {nodes}"), output).unwrap());
        values.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)).sum()
    };
    let first = |values: Vec<ValueRef>| all::<Weights>(values).iter().map(|w| w.weights[0]).collect();
    let across = |values: Vec<ValueRef>| all::<Affine2>(values).iter().map(|m| m.matrix[0][2]).collect();
    let nodes = |smoothness: u32| {
        format!(
            "\"keys\": (type: \"keys.pick\", shape: \"@shapes\", frames: [1, 9, 24]),
            \"it\": (type: \"capture.contour\", shape: \"@shapes\", keys: \"@keys\", affine_model: rigid, smoothness: {smoothness}),
            \"still\": (type: \"capture.contour\", shape: \"@shapes\", keys: \"@keys\", affine_model: rigid),
            \"solve\": (type: \"solve.key_weights\", shape: \"@shapes\", keys: \"@keys\", motion: \"@still\", smoothness: {smoothness}),"
        )
    };
    for output in [("it", 1), ("solve", 0)] {
        let (rough, smooth) = (bends(&nodes(0), &first, output), bends(&nodes(2), &first, output));
        assert!(rough > 5.0 * smooth, "{output:?}: {smooth} of {rough}");
    }
    let (rough, smooth) = (bends(&nodes(0), &across, ("it", 0)), bends(&nodes(2), &across, ("it", 0)));
    assert!(rough > 5.0 * smooth, "{smooth} of {rough}");
}

#[test]
fn keys_that_do_not_match_are_said_with_their_frame() {
    let folder = tempfile::tempdir().unwrap();
    let mut broken = blob(20, 1.0, 0.0, 1.0);
    broken[3][1] = f64::NAN;
    written(folder.path(), &[blob(20, 0.0, 0.0, 1.0), blob(20, 1.0, 0.0, 1.0)]);
    let points = [&blob(20, 0.0, 0.0, 1.0)[..], &broken].concat();
    let points = pegbar_engine::array::NdArray::new([2, 20, 2], points.into_flattened()).unwrap();
    put(&folder.path().join("keys.npz"), &KeyShapes { points, names: Vec::new(), closed: true });
    let text = |nodes: &str| run(folder.path(), 2, &format!("{READ} {nodes}"), ("it", 0)).unwrap_err().join("\n");
    let read = "\"keys\": (type: \"io.read_value\", path: \"keys.npz\", as: \"KeyShapes\"),";
    for node in ["capture.contour", "solve.key_weights"] {
        let error = text(&format!("{read} \"it\": (type: \"{node}\", shape: \"@shapes\", keys: \"@keys\")"));
        assert!(error.contains("expected finite keys, found (") && error.contains(", NaN) at point 3 of key 1"), "{error}");
        let few = "\"few\": (type: \"shape.resample\", shape: \"@shapes\", count: 7), \"own\": (type: \"keys.pick\", shape: \"@shapes\", frames: [1, 2]),";
        let error = text(&format!("{few} \"it\": (type: \"{node}\", shape: \"@few\", keys: \"@own\")"));
        assert!(error.contains("frame 1: expected 20 points, as the keys have, found 7; `shape.resample` brings"), "{error}");
    }
    // Keys of other numbers of points than one another.
    written(folder.path(), &[blob(20, 0.0, 0.0, 1.0), blob(21, 1.0, 0.0, 1.0)]);
    for node in ["\"keys.pick\", frames: [1, 2]", "\"keys.choose\""] {
        let error = text(&format!("\"it\": (type: {node}, shape: \"@shapes\")"));
        assert!(error.contains("expected contours that are all closed with 20 points, found closed with 21 at frame 2"), "{error}");
    }
}

#[test]
fn a_contour_that_leaves_the_picture_follows_its_border_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    // A disc of 12 pixels, half of it out.
    let nodes = "\"disc\": (type: \"render.shapes\", shapes: [\"@shapes\"], size: (64, 48), fill_opacity: 1, stroke_width: 0),
        \"matte\": (type: \"matte.from_image\", image: \"@disc\", channel: alpha),
        \"outline\": (type: \"shape.trace\", alpha: \"@matte\"),
        \"points\": (type: \"shape.resample\", shape: \"@outline\", count: 60),
        \"first\": (type: \"time.pick\", stream: \"@points\"),
        \"fit\": (type: \"shape.fit_affine\", from: \"@first\", to: \"@points\"),";
    let disc =
        |x: f64| (0..90).map(|i| libm::sincos(f64::from(i) * 0.069_813_170_08)).map(|(s, c)| [x + 12.0 * c, 24.0 + 12.0 * s]).collect();
    written(folder.path(), &[disc(30.0), disc(20.0), disc(0.0)]);
    let number = |output| -> Vec<f64> {
        all::<Curve>(run(folder.path(), 3, &format!("{READ} {nodes}"), output).unwrap()).iter().map(|c| c.value).collect()
    };
    let border = number(("outline", 3));
    assert!(border[0] == 0.0 && border[1] == 0.0 && (border[2] - 24.0 / (24.0 + 12.0 * std::f64::consts::PI)).abs() < 0.05, "{border:?}");
    let error = number(("fit", 1));
    assert!(error[1] < 0.2 && error[2].is_finite() && error[2] > 0.5, "{error:?}");
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

#[test]
fn a_drawn_walk_needs_a_few_keys() {
    captured("dog_walk/dog.####.png", 10, "type: \"matte.from_image\", channel: alpha", "count: 5", 1.5);
    captured("supertux_walk/tux.####.png", 8, "type: \"matte.from_image\", channel: alpha", "count: 5", 1.5);
}
