use crate::curve::CorrespondCurves;
use pegbar_engine::node::{Cancel, Context, In, List, NodeError, PerFrame};

use super::anchors::Anchors;
use super::correspond::CorrespondCurvesOutputs;
use crate::algo::correspond::{Missing, Pairing};
use crate::counted::clock;
use crate::data::{Curves, Markers2};
use pegbar_engine::setting::Setting;

/// A circle of 40 points on edges of a mesh: point i between vertices i and i + 1.
fn lines() -> Curves {
    let mut curves = Curves::default();
    let at = |i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / 40.0).sin_cos();
        [50.0 + 30.0 * c, 50.0 + 30.0 * s]
    };
    curves.push_drawn((0..40).map(at).collect(), true);
    curves.kinds[0] = 1;
    curves.edges = (0..40).map(|i| [i, i + 1]).collect();
    curves.shares = vec![0.5; 40];
    curves
}

fn drawn() -> Curves {
    let mut curves = Curves::default();
    let at = |i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / 200.0).sin_cos();
        [60.0 + 40.0 * c, 55.0 + 30.0 * s]
    };
    curves.push_drawn((0..200).map(at).collect(), true);
    curves
}

fn node(anchors: &str) -> CorrespondCurves {
    CorrespondCurves {
        silhouette: List(vec![In::new(lines())]),
        drawn: List(vec![In::new(drawn())]),
        anchors: <Anchors as Setting>::parse(anchors).unwrap(),
        render_markers: None,
        drawn_markers: None,
        pairing: Pairing::Length,
        spacing: 0.0,
        step: 4.0,
        snap: 12.0,
        bridge: 6.0,
        anchor_weight: 4.0,
        missing: Missing::Error,
    }
}

fn run(node: CorrespondCurves) -> Result<CorrespondCurvesOutputs, NodeError> {
    let clock = clock(1);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

const TWO: &str = "[(render: (80.0, 50.0), drawn: (100.0, 55.0)), (render: (20.0, 50.0), drawn: (20.0, 55.0))]";

#[test]
fn anchors_come_first_and_all_between_them_is_paired() {
    let out = run(node(TWO)).unwrap();
    let pairs = &out.correspondences;
    assert_eq!((out.count.value, out.sections.value), (40.0, 2.0));
    assert_eq!((pairs.edges[0], pairs.edges[1], pairs.weights[0], pairs.weights[2]), ([0, 1], [20, 21], 4.0, 1.0));
    for (edge, point) in pairs.edges.iter().zip(&pairs.points) {
        let (s, c) = (std::f64::consts::TAU * f64::from(edge[0]) / 40.0).sin_cos();
        let truth = [60.0 + 40.0 * c, 55.0 + 30.0 * s];
        assert!((point[0] - truth[0]).hypot(point[1] - truth[1]) < 3.5, "{edge:?} {point:?} {truth:?}");
    }
}

#[test]
fn an_anchor_may_stand_anywhere_and_markers_are_anchors() {
    // A vertex away from all lines, drawn away from all curves.
    let out = run(node(&TWO.replace(']', ", (vertex: 977, drawn: (150.0, 10.0))]"))).unwrap();
    assert_eq!(out.correspondences.edges[2], [977, 977]);
    assert_eq!((out.correspondences.points[2], out.count.value), ([150.0, 10.0], 41.0));
    // A vertex on a line makes sections as a pixel does.
    let out = run(node("[(vertex: 3, drawn: (100.0, 55.0)), (vertex: 20, drawn: (20.0, 55.0))]")).unwrap();
    assert_eq!(out.sections.value, 2.0);
    let markers =
        |points: [[f64; 2]; 2], names: [&str; 2]| In::new(Markers2 { points: points.to_vec(), names: names.map(str::to_owned).to_vec() });
    let both = CorrespondCurves {
        render_markers: Some(markers([[80.0, 50.0], [20.0, 50.0]], ["a", "b"])),
        drawn_markers: Some(markers([[20.0, 55.0], [100.0, 55.0]], ["b", "a"])),
        ..node("[]")
    };
    assert_eq!(run(both).unwrap().correspondences, run(node(TWO)).unwrap().correspondences);
    let other = CorrespondCurves {
        render_markers: Some(markers([[80.0, 50.0], [20.0, 50.0]], ["a", "c"])),
        drawn_markers: Some(markers([[20.0, 55.0], [100.0, 55.0]], ["b", "a"])),
        ..node("[]")
    };
    let message = run(other).map(|_| ()).unwrap_err().message;
    assert_eq!(message, "render_markers: expected `c` among the drawn markers, found b, a");
}

#[test]
fn what_is_wrong_is_told_with_its_number() {
    let refused = |node: CorrespondCurves| run(node).map(|_| ()).unwrap_err().message;
    let far = refused(node("[(render: (200.0, 50.0), drawn: (0.0, 0.0))]"));
    assert_eq!(far, "anchor 1 at (200, 50): expected a line of the mesh within 12 px, found the nearest 120.0 px away");
    let drawn_only = CorrespondCurves { silhouette: List(vec![In::new(drawn())]), ..node(TWO) };
    assert_eq!(refused(drawn_only), "silhouette: expected lines of a mesh, found drawn curves");
    let nan = refused(node("[(vertex: 3, drawn: (NaN, 0.0))]"));
    assert!(nan.starts_with("anchor 1: expected a finite place in the drawing"), "{nan}");
    assert_eq!(node("[(drawn: (0.0, 0.0))]").check().len(), 1);
    assert!(<Anchors as Setting>::parse("[(drawn: 3)]").is_err());
}

/// A square of four edges of 100 px, as a border runs: its points are vertices alone.
fn square() -> Curves {
    let mut curves = Curves::default();
    curves.push_drawn(vec![[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]], true);
    curves.kinds[0] = 2;
    curves.edges = (0..4).map(|i| [i, i]).collect();
    curves.shares = vec![0.0; 4];
    curves
}

#[test]
fn anchors_stand_on_edges_and_curves_are_followed_along_them() {
    let mut drawn = Curves::default();
    drawn.push_drawn(vec![[25.0, 0.0], [50.0, -20.0], [75.0, 0.0]], false);
    let on_square = |anchors: &str| CorrespondCurves {
        silhouette: List(vec![In::new(square())]),
        drawn: List(vec![In::new(drawn.clone())]),
        ..node(anchors)
    };
    let out = run(on_square("[(render: (25.0, 3.0), drawn: (25.0, 0.0)), (render: (75.0, 0.0), drawn: (75.0, 0.0))]")).unwrap();
    let pairs = &out.correspondences;
    assert_eq!((out.sections.value, out.skipped.value, pairs.edges[0], pairs.shares[0]), (1.0, 0.0, [0, 1], 0.25));
    // 50 px in steps of at most 4.
    assert_eq!(pairs.points.len(), 2 + 12);
    for (share, p) in pairs.shares.iter().zip(&pairs.points) {
        let x = share * 100.0;
        let truth = [x, -0.8 * (25.0 - (x - 50.0).abs())];
        assert!((p[0] - truth[0]).hypot(p[1] - truth[1]) < 1e-9, "{p:?} {truth:?}");
    }
}

#[test]
fn a_section_without_a_way_is_told_or_left_out() {
    let mut apart = square();
    apart.append(&square());
    apart.points[4..].iter_mut().for_each(|p| p[0] += 200.0);
    let mut drawn = Curves::default();
    drawn.push_drawn(vec![[50.0, 0.0], [250.0, 0.0]], false);
    let on = |missing| CorrespondCurves {
        silhouette: List(vec![In::new(apart.clone())]),
        drawn: List(vec![In::new(drawn.clone())]),
        missing,
        ..node("[(render: (50.0, 0.0), drawn: (50.0, 0.0)), (render: (250.0, 0.0), drawn: (250.0, 0.0))]")
    };
    let message = run(on(Missing::Error)).map(|_| ()).unwrap_err().message;
    assert_eq!(message, "anchors 1 and 2: expected a way between them along the lines of the mesh, found none within gaps of 6 px");
    let out = run(on(Missing::Skip)).unwrap();
    assert_eq!((out.sections.value, out.skipped.value, out.count.value), (0.0, 1.0, 2.0));
}
