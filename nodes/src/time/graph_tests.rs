//! Which frame each time node shows, read off a stream of frame numbers.

use std::path::Path;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::{Curve, downcast};
use pegbar_engine::{Node, Outputs};

/// One number.
#[derive(Outputs)]
struct Number {
    /// It.
    value: Curve,
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "test.frame", version = 1, kind = source, outputs = Number, uses_frame)]
struct FrameNumber {
    /// Its clock.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

impl PerFrame for FrameNumber {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: cx.frame as f64 } })
    }
}

/// The values of the node `n` over a stream of 6 frames at 24 fps, and one of 30 frames at 120.
fn shown(node: &str) -> Vec<f64> {
    let text = format!(
        r#"Graph(pegbar: 1, frames: (first: 1, last: 6, fps: 24), clocks: {{ "fast": (first: 0, last: 29, fps: 120) }}, nodes: {{
            "f": (type: "test.frame"), "fast": (type: "test.frame", clock: "fast"), "n": {node} }})"#
    );
    let registry = crate::registry().per_frame::<FrameNumber>();
    let loaded = load_text(Path::new("time.ron"), &text, &registry, &LoadOptions::default());
    let graph = loaded.graph.unwrap_or_else(|| panic!("{}", loaded.sources.render_all(&loaded.diagnostics, false)));
    let port = Port { node: graph.find("n").unwrap(), output: 0 };
    let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
    assert!(report.is_complete(), "{:?}", report.failures);
    let kept = report.kept.remove(&port).unwrap();
    kept.into_iter().map(|v| downcast::<Curve>(v.unwrap()).unwrap().value).collect()
}

#[test]
fn each_node_shows_the_frames_that_it_says() {
    let cases: [(&str, &[f64]); 12] = [
        (r#"(type: "time.hold", stream: "@f", step: 2)"#, &[1.0, 1.0, 3.0, 3.0, 5.0, 5.0]),
        (r#"(type: "time.hold", stream: "@f", step: 4)"#, &[1.0, 1.0, 1.0, 1.0, 5.0, 5.0]),
        (r#"(type: "time.hold", stream: "@f", frame: 4)"#, &[4.0; 6]),
        (r#"(type: "time.hold", stream: "@fast")"#, &[0.0, 5.0, 10.0, 15.0, 20.0, 25.0]),
        (r#"(type: "time.resample", stream: "@fast")"#, &[0.0, 5.0, 10.0, 15.0, 20.0, 25.0]),
        (r#"(type: "time.resample", stream: "@fast", speed: 2.0)"#, &[0.0, 10.0, 20.0, 29.0, 29.0, 29.0]),
        (r#"(type: "time.resample", stream: "@f", speed: 0.5)"#, &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]),
        (r#"(type: "time.offset", stream: "@f", frames: 2)"#, &[1.0, 1.0, 1.0, 2.0, 3.0, 4.0]),
        (r#"(type: "time.offset", stream: "@f", frames: -2, outside: loop)"#, &[3.0, 4.0, 5.0, 6.0, 1.0, 2.0]),
        (r#"(type: "time.offset", stream: "@f", frames: -2, outside: bounce)"#, &[3.0, 4.0, 5.0, 6.0, 5.0, 4.0]),
        (r#"(type: "time.pick", stream: "@f", frame: 3)"#, &[3.0]),
        (r#"(type: "time.pick", stream: "@fast")"#, &[0.0]),
    ];
    for (node, expected) in cases {
        assert_eq!(shown(node), expected, "{node}");
    }
}

#[test]
fn a_slow_stream_is_held_on_a_fast_clock() {
    let held = shown(r#"(type: "time.hold", stream: "@f", clock: "fast")"#);
    let truth: Vec<f64> = (0..30).map(|k| f64::from(k / 5 + 1)).collect();
    assert_eq!(held, truth);
}
