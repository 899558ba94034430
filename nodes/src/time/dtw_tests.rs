use super::*;
use crate::counted::{clock, counted};
use pegbar_engine::node::Cancel;

/// A pose that swings as time goes on.
fn pose(t: f64) -> Vector {
    Vector { values: vec![libm::sin(0.4 * t), libm::cos(0.3 * t), 0.1 * t] }
}

fn node(target: Sequence<Vector>, source: Sequence<Vector>) -> RetimeDtw {
    RetimeDtw {
        target,
        source,
        metric: Metric::Angle,
        steps: Steps::Symmetric1,
        open_begin: false,
        open_end: false,
        band: None,
        band_shape: BandShape::Slanted,
        pins: Vec::new(),
        target_weights: None,
        source_weights: None,
        holds: None,
        smooth: 0.0,
    }
}

fn run(node: RetimeDtw, n: usize) -> Result<RetimeDtwOutputs, NodeError> {
    let clock = clock(n);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

/// Drawings on twos of every second pose from the fifth on.
fn twos() -> Sequence<Vector> {
    counted(12, |k| pose(5.0 + (k / 2 * 2) as f64)).0
}

#[test]
fn drawings_on_twos_find_their_frames() {
    let open = RetimeDtw { open_begin: true, open_end: true, ..node(twos(), counted(40, |k| pose(k as f64)).0) };
    let found = run(open, 12).unwrap();
    // Between drawings frames are passed over, and count for the drawing that is nearer or, halfway, either.
    assert!(found.map.source_frames.iter().enumerate().all(|(k, f)| (f - (6 + k / 2 * 2) as f64).abs() <= 1.0), "{:?}", found.map);
    assert!(found.map.source_frames.chunks(2).all(|h| h[0] == h[1]), "{:?}", found.map);
    assert_eq!(found.path.pairs.shape()[1], 2);
    assert_eq!(found.path.pairs.data()[0], 1);
}

#[test]
fn pins_stand_as_clocks_count_frames() {
    let pinned = RetimeDtw { pins: vec![[5.0, 20.0]], ..node(twos(), counted(40, |k| pose(k as f64)).0) };
    assert_eq!(run(pinned, 12).unwrap().map.source_frames[4], 20.0);
    let outside = RetimeDtw { pins: vec![[5.0, 41.0]], ..node(twos(), counted(40, |k| pose(k as f64)).0) };
    let error = run(outside, 12).err().unwrap();
    assert_eq!(error.message, "pins: expected whole source frames from 1 to 40, found 41");
}

#[test]
fn what_gets_nowhere_is_refused() {
    let fast = RetimeDtw { steps: Steps::Asymmetric, ..node(twos(), counted(40, |k| pose(k as f64)).0) };
    let error = run(fast, 12).err().unwrap();
    assert_eq!(
        error.message,
        "expected a path from the first to the last frame, found none: 12 target and 40 source frames, Asymmetric steps"
    );
    let other = node(twos(), counted(4, |_| Vector { values: vec![0.0] }).0);
    assert_eq!(run(other, 12).err().unwrap().message, "expected as many numbers in each frame of target and source, found 3 and 1");
    let infinite = node(twos(), counted(4, |_| Vector { values: vec![f64::INFINITY; 3] }).0);
    assert!(run(infinite, 12).err().unwrap().message.starts_with("source: expected numbers below 1e100"));
    let holds = Some(In::new(TimeMap { source_frames: vec![1.0; 3] }));
    let error = run(RetimeDtw { holds, ..node(twos(), twos()) }, 12).err().unwrap();
    assert_eq!(error.message, "holds: expected a map of 12 frames as the target has, found 3");
}
