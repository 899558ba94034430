use super::*;
use crate::counted::{clock, counted};
use pegbar_engine::array::NdArray;
use pegbar_engine::node::Cancel;

/// Three drawings and four captured frames of one angle each.
const TARGET: [f64; 3] = [0.0, 1.0, 3.0];
const SOURCE: [f64; 4] = [0.0, 0.5, 1.5, -3.0];

fn stream(values: &'static [f64]) -> Sequence<Vector> {
    counted(values.len(), |k| Vector { values: vec![values[k]] }).0
}

fn path(pairs: &[[i64; 2]]) -> Option<In<WarpPath>> {
    Some(In::new(WarpPath { pairs: NdArray::new([pairs.len(), 2], pairs.concat()).unwrap() }))
}

fn node() -> PlotCostMatrix {
    PlotCostMatrix {
        target: stream(&TARGET),
        source: stream(&SOURCE),
        metric: Metric::Angle,
        target_weights: None,
        source_weights: None,
        path: None,
        map: None,
        band: None,
        band_shape: BandShape::Slanted,
        pins: Vec::new(),
        title: String::new(),
        x_label: "drawing".to_owned(),
        y_label: "captured".to_owned(),
        size: [300, 240],
        ramp: Ramp::Gray,
        range: Some([0.0, 4.0]),
        line_width: 2.0,
        text_size: 8.0,
    }
}

fn run(node: PlotCostMatrix) -> Result<PlotCostMatrixOutputs, NodeError> {
    let clock = clock(3);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

/// Red at a place of the matrix, frames as the clocks count them.
fn at(found: &PlotCostMatrixOutputs, frame: f64, source: f64) -> f32 {
    let [left, top, right, bottom, first, last, unit] = found.axes.values[..] else { panic!("{:?}", found.axes) };
    let x = (left + (right - left) * (frame * unit - first) / (last - first)) as usize;
    let y = (bottom - (bottom - top) * (source - 0.5) / SOURCE.len() as f64) as usize;
    found.image.samples()[(y * found.image.width() + x) * 4]
}

/// The inner angle.
fn distance(a: f64, b: f64) -> f64 {
    (a - b).abs().min(std::f64::consts::TAU - (a - b).abs())
}

#[test]
fn cells_are_the_distances_that_the_warp_sums() {
    let found = run(node()).unwrap();
    for (i, a) in TARGET.iter().enumerate() {
        for (j, b) in SOURCE.iter().enumerate() {
            let truth = Ramp::Gray.at(distance(*a, *b) / 4.0)[0];
            let found = at(&found, i as f64 + 1.2, j as f64 + 1.2);
            assert!((found - truth).abs() < 1e-6, "({i}, {j}): expected {truth}, found {found}");
        }
    }
    assert!(found.distance.0.iter().all(|d| d.value.is_nan()) && found.distance.0.len() == 3);
    let plain = run(PlotCostMatrix { metric: Metric::Euclidean, range: Some([0.0, 6.0]), ..node() }).unwrap();
    assert!((at(&plain, 3.0, 4.0) - Ramp::Gray.at(1.0)[0]).abs() < 1e-6, "six radians apart, and not wrapped");
}

#[test]
fn the_path_is_drawn_and_measured() {
    let found = run(PlotCostMatrix { path: path(&[[1, 1], [2, 2], [2, 3], [3, 4]]), ..node() }).unwrap();
    for (i, j) in [(1.0, 1.0), (1.5, 1.5), (2.0, 2.5), (3.0, 4.0)] {
        // Its ends cover pixels by half.
        assert!(at(&found, i, j) > 0.45, "({i}, {j}): found {}", at(&found, i, j));
    }
    let distances: Vec<f64> = found.distance.0.iter().map(|d| d.value).collect();
    let truth = [0.0, 0.5, distance(3.0, -3.0)];
    assert!(distances.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-12), "{distances:?}");
    let along = Along { rows: vec![(1.0, 2), (2.0, 1)], largest: Some((2.0, [1, 5])) };
    assert_eq!(along.caption(" rad", [1, 10]), "path: mean 1.000 rad, largest 2.000 rad at (2, 15)");
}

#[test]
fn a_path_of_nothing_is_drawn_as_nothing() {
    let found = run(PlotCostMatrix { path: path(&[]), ..node() }).unwrap();
    assert!(found.distance.0.iter().all(|d| d.value.is_nan()));
    assert!((at(&found, 1.2, 2.2) - Ramp::Gray.at(distance(0.0, 0.5) / 4.0)[0]).abs() < 1e-6);
    assert_eq!(Along::default().caption("", [1, 1]), "path: no distance known");
}

#[test]
fn what_a_band_shuts_is_veiled() {
    let found = run(PlotCostMatrix { pins: vec![[2.0, 3.0]], ..node() }).unwrap();
    // Before the pin nothing comes behind its frame, and after it nothing before.
    let plain = run(node()).unwrap();
    let is_veiled = |i: f64, j: f64| (at(&found, i + 0.2, j + 0.2) - at(&plain, i + 0.2, j + 0.2)).abs() > 0.02;
    assert_eq!([is_veiled(1.0, 4.0), is_veiled(1.0, 2.0), is_veiled(3.0, 1.0), is_veiled(3.0, 4.0)], [true, false, true, false]);
}

#[test]
fn many_frames_shrink_to_the_picture() {
    let long = |n: usize| counted(n, |k| Vector { values: vec![k as f64 % 2.0 * 4.0] }).0;
    let node = PlotCostMatrix { target: long(2000), source: long(3000), metric: Metric::Euclidean, ..node() };
    let found = run(node).unwrap();
    let [left, top, right, bottom] = found.axes.values[..4] else { panic!() };
    // Nought and four in turn: two everywhere, but for what is left over at a pixel's edges.
    for (x, y) in [(left, top), (right - 1.0, bottom - 1.0), ((left + right) / 2.0, (top + bottom) / 2.0)] {
        let pixel = found.image.samples()[(y as usize * found.image.width() + x as usize) * 4];
        let truth = Ramp::Gray.at(0.5)[0];
        assert!((pixel - truth).abs() < 0.02, "expected {truth}, found {pixel}");
    }
}

#[test]
fn what_is_not_comparable_has_a_colour_of_its_own() {
    static GAPS: [f64; 3] = [0.0, f64::NAN, 3.0];
    let found = run(PlotCostMatrix {
        target: counted(3, |k| Vector { values: vec![GAPS[k], GAPS[2 - k]] }).0,
        source: counted(4, |k| Vector { values: vec![f64::NAN, SOURCE[k]] }).0,
        ..node()
    })
    .unwrap();
    // The second drawing is not seen at all, and is as near to one frame as to the other; the first shares its second number alone.
    assert!(at(&found, 2.0, 2.0) == Ramp::Gray.at(0.0)[0]);
    static HALF: [[f64; 2]; 2] = [[f64::NAN, 1.0], [1.0, f64::NAN]];
    let both = PlotCostMatrix {
        target: counted(3, |_| Vector { values: HALF[0].to_vec() }).0,
        source: counted(4, |_| Vector { values: HALF[1].to_vec() }).0,
        ..node()
    };
    assert_eq!(at(&run(both).unwrap(), 2.0, 2.0), Ramp::Gray.nothing()[0]);
}

#[test]
fn what_lies_outside_the_clocks_is_refused() {
    let fails = |node: PlotCostMatrix| run(node).err().unwrap().message;
    let outside = fails(PlotCostMatrix { path: path(&[[1, 1], [2, 5]]), ..node() });
    assert_eq!(outside, "path: expected pairs of target frames 1 to 3 and source frames 1 to 4, found (2, 5)");
    let map = |frames: &[f64]| Some(In::new(TimeMap { source_frames: frames.to_vec() }));
    assert_eq!(fails(PlotCostMatrix { map: map(&[1.0]), ..node() }), "map: expected a source frame for each of 3 target frames, found 1");
    assert_eq!(fails(PlotCostMatrix { map: map(&[1.0, f64::NAN, 2.0]), ..node() }), "map: expected source frames, found NaN at position 1");
    assert_eq!(fails(PlotCostMatrix { pins: vec![[0.0, 1.0]], ..node() }), "pins: expected whole target frames from 1 to 3, found 0");
    let other = PlotCostMatrix { source: counted(2, |_| Vector { values: vec![0.0; 2] }).0, ..node() };
    assert_eq!(fails(other), "expected as many numbers in each frame of target and source, found 1 and 2");
    let none = PlotCostMatrix { source: counted(0, |_| Vector { values: Vec::new() }).0, ..node() };
    assert!(fails(none).starts_with("expected series of at least one frame"));
    assert!(fails(PlotCostMatrix { size: [20, 20], ..node() }).starts_with("expected a plot of at least "));
}
