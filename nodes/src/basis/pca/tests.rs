use pegbar_engine::node::{AnySequence, Cancel};

use super::*;
use crate::counted::{clock, counted};

fn run(values: AnySequence, components: Option<u32>, framing: Framing) -> Result<BasisPcaOutputs, NodeError> {
    let hips = vec!["left_hip".to_owned(), "right_hip".to_owned()];
    let clock = clock(6);
    let node = BasisPca { values, components, max_error: 0.0, framing, root: "pelvis".to_owned(), hips };
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

/// A figure that walks and turns, and does nothing else.
fn walker(k: usize) -> Markers3 {
    let (s, c) = libm::sincos(0.3 * k as f64);
    let at = |x: f64, y: f64, z: f64| [c * x + s * z + k as f64, y, c * z - s * x];
    let names = ["pelvis", "left_hip", "right_hip", "head"].map(str::to_owned).to_vec();
    Markers3 { points: vec![at(0.0, 1.0, 0.0), at(0.1, 1.0, 0.0), at(-0.1, 1.0, 0.0), at(0.0, 1.7, 0.1)], names }
}

#[test]
fn where_a_figure_walks_is_none_of_its_poses() {
    let found = run(counted(6, walker).0, None, Framing::Heading).unwrap();
    assert!(found.errors.values[0] < 1e-12, "{:?}", found.errors);
    let head = &found.basis.mean[9..];
    assert!(head.iter().zip([0.0, 0.7, 0.1]).all(|(a, b)| (a - b).abs() < 1e-12), "{head:?}");
    assert!(run(counted(6, walker).0, Some(2), Framing::World).unwrap().count.value == 2.0);
}

/// More examples than numbers, and fewer: the same space.
#[test]
fn many_examples_span_what_few_do() {
    let vector = |k: usize| Vector { values: (0..4).map(|d| libm::sin((k % 6 * (d + 1)) as f64)).collect() };
    let few = run(counted(6, vector).0, Some(2), Framing::World).unwrap().basis;
    let many = run(counted(12, vector).0, Some(2), Framing::World).unwrap().basis;
    let off = few.components.data().iter().zip(many.components.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off}");
}

#[test]
fn figures_without_hips_are_refused() {
    let bare = |_| Markers3 { points: vec![[0.0; 3]], names: vec!["pelvis".to_owned()] };
    let error = run(counted(6, bare).0, None, Framing::Heading).err().unwrap();
    assert_eq!(error.message, "values at frame 1: root and hips: expected a marker \"left_hip\", found none");
}
