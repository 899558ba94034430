//! Plots in whole graphs, and of values made by hand.

use std::sync::Arc;

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{AnySequence, Arg, Cancel, Context, Input, Node, NodeError, PerFrame, SequenceRef, Whole};
use pegbar_engine::setting::{Place, Setting};
use pegbar_engine::value::{Curve, TimeMap, ValueRef, Vector};

use super::curves::PlotCurves;
use super::gather::{Group, groups};
use super::playhead::PlotPlayhead;
use crate::counted::counted;
use crate::data::{Affine2, Image};
use crate::render::tests::{load, pictures};

fn clock(last: i64, fps: u32) -> Clock {
    Clock { name: format!("at{fps}"), first: 1, last, fps: (fps, 1) }
}

fn curve(fps: u32, values: &[f64]) -> SequenceRef {
    let values: Vec<ValueRef> = values.iter().map(|&value| Arc::new(Curve { value }) as ValueRef).collect();
    SequenceRef::new(Some(Arc::new(clock(values.len() as i64, fps))), values)
}

fn gathered(values: Vec<ValueRef>, name: Option<&str>) -> Result<Vec<Group>, NodeError> {
    groups(&AnySequence::from_arg(Arg::Sequence(SequenceRef::new(None, values)))?, name)
}

/// The arguments of a node: its defaults, but for those that are given.
fn arguments<N: Node>(given: Vec<(&str, Arg)>) -> Vec<Arg> {
    let mut args: Vec<Arg> = Vec::new();
    for input in N::schema().inputs {
        let given = given.iter().find(|(name, _)| *name == input.name).map(|(_, a)| a.clone());
        let default = || input.default.map_or(Arg::None, |text| Arg::Literal((input.parse)(text, &Place::default()).unwrap().0));
        args.push(given.unwrap_or_else(default));
    }
    args
}

fn setting<T: Setting>(value: T) -> Arg {
    Arg::Literal(Arc::new(value))
}

/// The plot of some sequences: the picture, and the numbers of its axes.
fn plot(sequences: Vec<SequenceRef>, more: Vec<(&str, Arg)>) -> Result<(Image, Vec<f64>), NodeError> {
    let mut given = vec![("curves", Arg::List(sequences.into_iter().map(Arg::Sequence).collect()))];
    given.extend(more);
    if !given.iter().any(|(n, _)| *n == "size") {
        given.push(("size", setting([400_i64, 300])));
    }
    let node = PlotCurves::build(arguments::<PlotCurves>(given))?;
    let clock = clock(8, 24);
    let mut values = pegbar_engine::node::Outputs::into_values(node.run(&context(&clock, 1, &Cancel::default()))?);
    let axes = one::<Vector>(values.pop()).values.clone();
    Ok((Arc::unwrap_or_clone(one::<Image>(values.pop())), axes))
}

fn one<T: pegbar_engine::value::Value>(value: Option<pegbar_engine::node::OutValue>) -> Arc<T> {
    match value {
        Some(pegbar_engine::node::OutValue::One(v)) => pegbar_engine::value::downcast(v).unwrap(),
        other => panic!("{other:?}"),
    }
}

fn context<'a>(clock: &'a Clock, frame: i64, cancel: &'a Cancel) -> Context<'a> {
    Context { frame, clock, input_clocks: &[], cancel }
}

#[test]
fn one_frame_is_gathered_at_a_time() {
    let (values, count) = counted::<_, AnySequence>(9, |k| Vector { values: vec![k as f64, 1.0] });
    let found = groups(&values, None).unwrap();
    assert_eq!(found[0].curves[0].1, (0..9).map(f64::from).collect::<Vec<_>>());
    assert_eq!(count.peak(), 1);
}

#[test]
fn a_motion_is_six_curves_in_two_units() {
    let motion = |k: f64| Arc::new(Affine2 { matrix: [[1.0 + k, 2.0, 5.0], [3.0, 4.0, 6.0 * k]] }) as ValueRef;
    let found = gathered(vec![motion(0.0), motion(1.0)], None).unwrap();
    let names: Vec<(&str, Vec<&str>)> = found.iter().map(|g| (g.label.as_str(), g.curves.iter().map(|c| c.0.as_str()).collect())).collect();
    assert_eq!(names, [("linear part", vec!["a1", "a2", "a3", "a4"]), ("translation, px", vec!["dx", "dy"])]);
    let values: Vec<Vec<f64>> = found.into_iter().flat_map(|g| g.curves.into_iter().map(|c| c.1)).collect();
    assert_eq!(values, [[1.0, 2.0], [2.0, 2.0], [3.0, 3.0], [4.0, 4.0], [5.0, 5.0], [0.0, 6.0]]);
    assert_eq!(gathered(vec![motion(0.0)], Some("hand")).unwrap()[1].curves[0].0, "hand dx");
}

#[test]
fn vectors_and_time_maps_are_curves_too() {
    let vector = |v: &[f64]| Arc::new(Vector { values: v.to_vec() }) as ValueRef;
    let found = gathered(vec![vector(&[1.0, 2.0]), vector(&[3.0, 4.0])], Some("key")).unwrap();
    assert_eq!(found[0].curves, [("key[0]".to_owned(), vec![1.0, 3.0]), ("key[1]".to_owned(), vec![2.0, 4.0])]);
    let map = Arc::new(TimeMap { source_frames: (0..200).map(f64::from).collect() }) as ValueRef;
    let found = gathered(vec![map], None).unwrap();
    assert!(found[0].spans && found[0].curves[0].1.len() == 200);
    let error = gathered(vec![vector(&[1.0, 2.0]), vector(&[3.0])], Some("key")).unwrap_err();
    assert_eq!(error.message, "key: expected 2 numbers at every frame, found 1 at position 1 of the sequence");
    let error = gathered(vec![vector(&[0.0; 65])], None).unwrap_err();
    assert_eq!(error.message, "expected values of 1 to 64 numbers, found Vector of 65");
    assert!(gathered(vec![vector(&[])], None).is_err());
}

#[test]
fn the_axis_runs_over_all_clocks_in_frames_or_in_seconds() {
    let (_, axes) = plot(vec![curve(24, &[1.0; 8]), curve(24, &[2.0; 20])], Vec::new()).unwrap();
    assert_eq!(axes[4..], [1.0, 20.0, 1.0]);
    let (_, axes) = plot(vec![curve(24, &[1.0; 24]), curve(120, &[2.0; 240])], Vec::new()).unwrap();
    assert_eq!(axes[4..], [1.0 / 120.0, 2.0, 1.0 / 24.0]);
    let (_, axes) = plot(vec![curve(24, &[1.0])], Vec::new()).unwrap();
    assert_eq!(axes[4..], [0.5, 1.5, 1.0]);
}

#[test]
fn what_cannot_be_plotted_is_refused_with_the_reason() {
    let fails = |sequences, more| plot(sequences, more).unwrap_err().message;
    assert_eq!(fails(Vec::new(), Vec::new()), "expected at least one curve, found none");
    let one = || vec![curve(24, &[1.0, 2.0])];
    let names = setting(vec!["a".to_owned(), "b".to_owned()]);
    assert_eq!(fails(one(), vec![("names", names)]), "expected at most one name for each of 1 curves, found 2");
    let small = fails(one(), vec![("size", setting([20_i64, 20]))]);
    assert!(small.starts_with("expected a plot of at least "), "{small}");
    assert_eq!(fails(one(), vec![("text_size", setting(f64::NAN))]), "expected `text_size` from 4 to 200, found NaN");
    let picture = r#""p": (type: "image.constant", size: (8, 4)), "out": (type: "plot.curves", curves: "@p", y_range: (2.0, 1.0))"#;
    let errors = load(picture).err().unwrap();
    assert!(errors.iter().any(|e| e.contains("expected the lower end first")), "{errors:?}");
}

#[test]
fn lines_of_nothing_but_gaps_and_long_lines_are_drawn() {
    let (blank, _) = plot(vec![curve(24, &[f64::NAN; 8])], vec![("legend", setting(false))]).unwrap();
    let (line, _) = plot(vec![curve(24, &[0.5; 8])], vec![("legend", setting(false))]).unwrap();
    assert!(blank.samples() != line.samples());
    let noise: Vec<f64> = (0..50_000).map(|i| libm::sin(f64::from(i) * 1.7) * libm::cos(f64::from(i) * 0.013)).collect();
    let (a, b) = (plot(vec![curve(24, &noise)], Vec::new()).unwrap(), plot(vec![curve(24, &noise)], Vec::new()).unwrap());
    assert!(a == b && a.0.samples().iter().all(|v| v.is_finite()));
}

#[test]
fn every_second_hold_is_shaded() {
    let holds = Arc::new(TimeMap { source_frames: vec![1.0, 1.0, 3.0, 3.0, 5.0, 5.0, 7.0, 7.0] }) as ValueRef;
    let more = vec![("holds", Arg::Value(holds)), ("y_range", setting(Some([0.0, 1.0])))];
    let (image, axes) = plot(vec![curve(24, &[0.5; 8])], more).unwrap();
    let shade = |frame: f64| {
        let x = axes[0] + (axes[2] - axes[0]) * (frame - axes[4]) / (axes[5] - axes[4]);
        image.samples()[((axes[1] as usize + 3) * image.width() + x as usize) * 4]
    };
    assert_eq!(shade(1.7), 1.0);
    assert!(shade(3.3) < 0.95);
    assert_eq!(shade(5.3), 1.0);
    assert!(shade(7.3) < 0.95);
}

fn playhead(image: &Image, axes: Vec<f64>, frame: i64) -> Result<Image, NodeError> {
    let given = vec![("image", Arg::Value(Arc::new(image.clone()))), ("axes", Arg::Value(Arc::new(Vector { values: axes })))];
    let node = PlotPlayhead::build(arguments::<PlotPlayhead>(given))?;
    let clock = clock(8, 24);
    node.run(&context(&clock, frame, &Cancel::default())).map(|d| d.image)
}

#[test]
fn the_playhead_stands_at_its_frame() {
    let white = Image::new(100, 40, 4, vec![1.0; 16_000]).unwrap();
    let axes = vec![10.0, 10.0, 90.0, 30.0, 1.0, 9.0, 1.0];
    for frame in [1, 4, 9] {
        let drawn = playhead(&white, axes.clone(), frame).unwrap();
        let row = &drawn.samples()[20 * 400..21 * 400];
        let dark: Vec<f64> = row.chunks_exact(4).map(|p| f64::from(1.0 - p[1])).collect();
        let total: f64 = dark.iter().sum();
        let centre = dark.iter().enumerate().map(|(x, d)| d * (x as f64 + 0.5)).sum::<f64>() / total;
        assert!((centre - 10.0 * frame as f64).abs() < 1e-4, "found {centre}");
    }
    assert_eq!(playhead(&white, axes, 12).unwrap().samples(), white.samples(), "off the plot there is none");
    let error = playhead(&white, vec![1.0], 1).unwrap_err();
    assert_eq!(error.message, "expected the seven numbers of plot.curves' output `axes`, found 1");
}

#[test]
fn a_graph_plots_its_curves_the_same_with_any_number_of_threads() {
    let nodes = r#""white": (type: "image.constant", size: (80, 20), color: (1.0, 1.0, 1.0, 1.0)),
        "now": (type: "plot.playhead", image: "@white", axes: [0.0, 0.0, 80.0, 20.0, 0.0, 8.0, 1.0], width: 2.0),
        "found": (type: "time.find_holds", image: "@now"),
        "plot": (type: "plot.curves", curves: ["@found.drawing", "@found"], holds: "@found", title: "drawings"),
        "out": (type: "plot.playhead", image: "@plot", axes: "@plot.axes")"#;
    let (one, two) = (pictures(nodes, 1).unwrap(), pictures(nodes, 2).unwrap());
    assert_eq!((one.len(), one[0].width(), one[0].height()), (4, 960, 540));
    assert!(one.iter().zip(&two).all(|(a, b)| a.samples() == b.samples()));
    assert!(one[0].samples() != one[1].samples(), "the playhead moves");
}
