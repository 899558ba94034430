//! The nodes in graphs, over motions that a test source makes.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::{Curve, TimeMap, Value, downcast};
use pegbar_engine::{Node, Outputs};

use crate::algo::raster::{Affine, apply};
use crate::data::{Affine2, Shape, Weights};

/// A hop of 24 frames in several types.
#[derive(Outputs)]
struct Hop {
    /// Frame from reference.
    motion: Affine2,
    /// Of three keys.
    weights: Weights,
    /// Its height.
    height: Curve,
    /// A triangle under the motion.
    shape: Shape,
    /// On twos.
    holds: TimeMap,
}

/// A hop.
#[derive(Node)]
#[node(id = "test.hop", version = 1, kind = source, outputs = Hop, uses_frame)]
struct TestHop {
    /// Its clock.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

fn hop(frame: i64) -> Hop {
    let t = frame as f64;
    let (s, c) = libm::sincos(0.1 * t);
    let squash = 1.0 + 0.2 * libm::sin(0.7 * t);
    let motion = Affine::new(c * squash, -s / squash, 3.0 * t, s * squash, c / squash, 50.0 - 0.5 * t * (24.0 - t));
    let bend = 0.5 + 0.5 * libm::sin(0.5 * t);
    let points = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]].map(|p: [f64; 2]| apply(&motion, p.into()).into());
    Hop {
        motion: motion.into(),
        weights: Weights { weights: vec![bend, 1.0 - bend, 0.0] },
        height: Curve { value: motion[(1, 2)] },
        shape: Shape { points: points.to_vec(), closed: true },
        holds: TimeMap { source_frames: (0..24).map(|k| f64::from(1 + k / 2 * 2)).collect() },
    }
}

impl PerFrame for TestHop {
    fn run(self, cx: &Context) -> Result<Hop, NodeError> {
        Ok(hop(cx.frame))
    }
}

fn try_run<T: Value>(node: &str) -> Result<Vec<Arc<T>>, String> {
    let text = format!(
        r#"Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {{ "hop": (type: "test.hop"),
            "holds": (type: "time.pick", stream: "@hop.holds"), "n": {node} }})"#
    );
    let registry = crate::registry().per_frame::<TestHop>();
    let loaded = load_text(Path::new("motion.ron"), &text, &registry, &LoadOptions::default());
    let graph = loaded.graph.ok_or_else(|| loaded.sources.render_all(&loaded.diagnostics, false))?;
    let port = Port { node: graph.find("n").unwrap(), output: 0 };
    let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
    if let Some(failure) = report.failures.first() {
        return Err(format!("{failure:?}"));
    }
    Ok(report.kept.remove(&port).unwrap().into_iter().map(|v| downcast::<T>(v.unwrap()).unwrap()).collect())
}

fn run<T: Value>(node: &str) -> Vec<Arc<T>> {
    try_run(node).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn no_amount_gives_back_every_bit() {
    for node in ["smooth", "exaggerate", "anticipate", "follow_through"] {
        let of = |port: &str| format!(r#"(type: "motion.{node}", motion: "@hop.{port}", amount: 0)"#);
        for (k, found) in run::<Affine2>(&of("motion")).iter().enumerate() {
            assert_eq!(**found, hop(k as i64 + 1).motion, "{node}");
        }
        for (k, found) in run::<Weights>(&of("weights")).iter().enumerate() {
            assert_eq!(**found, hop(k as i64 + 1).weights, "{node}");
        }
    }
}

#[test]
fn weights_still_add_up_to_one() {
    for node in ["smooth", "exaggerate", "anticipate", "follow_through"] {
        for found in run::<Weights>(&format!(r#"(type: "motion.{node}", motion: "@hop.weights", amount: 1)"#)) {
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{node}: {found:?}");
        }
    }
}

#[test]
fn held_drawings_stay_held() {
    for node in ["smooth", "anticipate", "follow_through"] {
        let found = run::<Affine2>(&format!(r#"(type: "motion.{node}", motion: "@hop.motion", holds: "@holds", amount: 1)"#));
        assert!(found.chunks(2).all(|pair| pair[0] == pair[1]), "{node}");
        assert!(found.windows(3).any(|w| w[0] != w[2]), "{node} still moves");
    }
}

#[test]
fn a_squash_keeps_the_area_of_each_frame() {
    for node in ["exaggerate", "anticipate", "follow_through"] {
        for found in run::<Affine2>(&format!(r#"(type: "motion.{node}", motion: "@hop.motion", amount: 1)"#)) {
            let [[a, b, _], [c, d, _]] = found.matrix;
            assert!((a * d - b * c - 1.0).abs() < 1e-9, "{node}: {found:?}");
        }
    }
}

#[test]
fn the_parabola_of_a_hop_is_not_smoothed() {
    for (k, found) in run::<Curve>(r#"(type: "motion.smooth", motion: "@hop.height")"#).iter().enumerate() {
        assert!((found.value - hop(k as i64 + 1).height.value).abs() < 1e-9);
    }
}

#[test]
fn pinned_points_stand_where_they_are_told() {
    let node = r#"(type: "motion.pin", motion: "@hop.motion", pins: [(frames: (4, 8), point: (10, 0)), (frames: (15, 15), point: (0, 10), at: (60, 70))])"#;
    let found = run::<Affine2>(node);
    let at = |k: usize, p: [f64; 2]| apply(&Affine::from(&*found[k - 1]), p.into());
    let stood = apply(&Affine::from(&hop(4).motion), [10.0, 0.0].into());
    for k in 4..=8 {
        assert!((at(k, [10.0, 0.0]) - stood).norm() < 1e-9);
    }
    assert!((at(15, [0.0, 10.0]) - nalgebra::Vector2::new(60.0, 70.0)).norm() < 1e-9);
    let shapes = run::<Shape>(r#"(type: "motion.pin", motion: "@hop.shape", pins: [(frames: (4, 8), index: 1)], ground: 40)"#);
    assert!(shapes.iter().all(|s| s.points[1][1] <= 40.0 + 1e-9));
}

#[test]
fn what_cannot_be_filtered_is_told_in_words() {
    let told = |node: &str, text: &str| {
        let error = try_run::<Affine2>(node).expect_err(node);
        assert!(error.contains(text), "{error}");
    };
    told(r#"(type: "motion.smooth", motion: "@hop.motion", pins: [99])"#, "expected frames of the motion, found 99");
    told(r#"(type: "motion.exaggerate", motion: "@hop.motion", about: frame, rest: 99)"#, "expected a frame of the motion, found 99");
    told(r#"(type: "motion.smooth", motion: "@holds")"#, "expected a motion of Affine2");
    told(r#"(type: "motion.pin", motion: "@hop.motion", pins: [(frames: (1, 2), index: 0)])"#, "expected a point for an affine motion");
    told(r#"(type: "motion.pin", motion: "@hop.shape", pins: [(frames: (1, 2), index: 3)])"#, "expected an index below");
    told(r#"(type: "motion.pin", motion: "@hop.motion", pins: [(frames: (2, 1), point: (0, 0))])"#, "expected frames in order");
    told(r#"(type: "motion.exaggerate", motion: "@hop.weights", weight_bounds: (0.2, 1))"#, "expected a least weight of at most 0");
}
