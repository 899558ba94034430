//! Keyframes in whole graphs: read from RON, played on clocks.

use std::path::Path;

use pegbar_engine::check::{LoadOptions, Loaded, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::value::{Value, downcast};

use crate::data::{Affine2, Weights};

fn load(node: &str) -> Loaded {
    let text = format!(
        "Graph(pegbar: 1, frames: (first: 1, last: 6, fps: 24), clocks: {{ \"late\": (first: 10, last: 12, fps: 24) }}, nodes: {{ \"n\": {node} }})"
    );
    load_text(Path::new("keys.ron"), &text, &crate::registry(), &LoadOptions::default())
}

fn played<T: Value + Clone>(node: &str) -> Vec<T> {
    let loaded = load(node);
    let graph = loaded.graph.unwrap_or_else(|| panic!("{}", loaded.sources.render_all(&loaded.diagnostics, false)));
    let port = Port { node: graph.find("n").unwrap(), output: 0 };
    let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
    assert!(report.is_complete(), "{:?}", report.failures);
    report.kept.remove(&port).unwrap().into_iter().map(|v| (*downcast::<T>(v.unwrap()).unwrap()).clone()).collect()
}

fn said(node: &str) -> String {
    let loaded = load(node);
    loaded.sources.render_all(&loaded.diagnostics, false)
}

#[test]
fn weights_play_on_twos_in_a_loop_on_any_clock() {
    let first = |node: &str| played::<Weights>(node).iter().map(|w| w.weights[0]).collect::<Vec<_>>();
    let cycle = r#"type: "weights.keys", poses: [1, 2, 1], easing: linear, beyond: loop"#;
    assert_eq!(first(&format!("({cycle}, frames: [1, 3, 5])")), [1.0, 0.5, 0.0, 0.5, 1.0, 0.5]);
    assert_eq!(first(&format!("({cycle}, frames: [1, 3, 5], hold: 2)")), [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
    assert_eq!(first(&format!("({cycle}, frames: [10, 12, 14], clock: \"late\")")), [1.0, 0.5, 0.0]);
    let rows = r#"(type: "weights.keys", frames: [1, 5, 6], weights: [[1, 0], [0.5, 0.5], [-0.5, 1.5]], easing: [slow_out, hold,])"#;
    assert_eq!(first(rows), [1.0, 0.96875, 0.875, 0.71875, 0.5, -0.5]);
}

#[test]
fn a_motion_plays_and_stops() {
    let node = r#"(type: "motion.keys", frames: [2, 4], translation: [(0, 0), (8, -4)], squash: [1, 2], easing: linear)"#;
    let motion: Vec<[f64; 4]> =
        played::<Affine2>(node).iter().map(|m| [m.matrix[0][2], m.matrix[1][2], m.matrix[0][0], m.matrix[1][1]]).collect();
    let root = 2f64.sqrt();
    let truth = [[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0], [4.0, -2.0, 1.0 / root, root], [8.0, -4.0, 0.5, 2.0]];
    for (found, truth) in motion.iter().flatten().zip(truth.iter().chain([&truth[3]; 2]).flatten()) {
        assert!((found - truth).abs() < 1e-12, "{motion:?}");
    }
}

#[test]
fn wrong_keys_are_shown_where_they_are_written() {
    let easing = said(r#"(type: "motion.keys", frames: [1, 2], easing: [smooth, bouncy])"#);
    assert!(easing.contains("expected one of hold, linear, smooth, slow_out, slow_in, spline, overshoot, found bouncy"), "{easing}");
    assert!(easing.contains("keys.ron:1:"), "{easing}");
    let order = said(r#"(type: "weights.keys", frames: [3, 2])"#);
    assert!(order.contains("expected each frame later than the one before, found 2 after 3 at position 2"), "{order}");
    let squash = said(r#"(type: "motion.keys", frames: [1], squash: [0.0])"#);
    assert!(squash.contains("squash"), "{squash}");
}
