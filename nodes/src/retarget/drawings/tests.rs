use pegbar_engine::node::Cancel;

use super::*;
use crate::counted::clock;

/// A bar that stands, and the same bar lying on its side, with a dot inside near its end and one outside.
fn keys() -> KeyDrawings {
    let bar: Vec<[f64; 2]> = (0..=8).map(|i| [0.0, f64::from(i)]).chain((0..=8).rev().map(|i| [2.0, f64::from(i)])).collect();
    let key = |turn: &dyn Fn([f64; 2]) -> [f64; 2]| {
        let points: Vec<[f64; 2]> = bar.iter().copied().chain([[1.0, 7.5], [1.0, 8.2]]).map(turn).collect();
        crate::data::Drawing {
            contours: vec![bar.len() as u32, 2],
            closed: vec![1, 0],
            paths: vec![1, 1],
            fill: vec![[1.0; 4]; 2],
            stroke: vec![[0.0; 4]; 2],
            width: vec![0.0; 2],
            rule: vec![0; 2],
            depth: vec![0.0, 1.0],
            size: [10.0, 10.0],
            names: vec!["bar".into(), "dots".into()],
            points,
            ..Default::default()
        }
    };
    KeyDrawings::new(vec![key(&|p| p), key(&|[x, y]| [-y, x])], vec!["up".into(), "side".into()]).unwrap()
}

fn run(keys: KeyDrawings, weights: &[f64], interpolation: Interpolation, outline: Option<&str>) -> Result<Drawing, String> {
    let node = RetargetDrawings {
        keys: In::new(keys),
        weights: In::new(Weights { weights: weights.to_vec() }),
        motion: None,
        place: None,
        interpolation,
        outline: outline.map(str::to_owned),
        inbetweens: 5,
        symmetric: true,
        anchor: None,
        align: AlignTo::None,
        align_model: Model::Affine,
    };
    let clock = clock(1);
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    node.run(None, &cx).map(|out| out.0.drawing).map_err(|e| e.message)
}

#[test]
fn keys_come_out_as_they_are() {
    for interpolation in [Interpolation::Linear, Interpolation::Extended, Interpolation::Arap] {
        for (k, weights) in [[1.0, 0.0], [0.0, 1.0]].iter().enumerate() {
            let found = run(keys(), weights, interpolation, Some("bar")).unwrap();
            let worst = found.points.iter().flatten().zip(keys().key(k).iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-12, "{interpolation:?} {k}: {worst}");
            assert_eq!((found.names, found.paths), (keys().names, keys().paths));
        }
    }
}

#[test]
fn linear_is_the_mean_and_arap_turns_what_is_inside_and_near() {
    let half = run(keys(), &[0.5, 0.5], Interpolation::Linear, None).unwrap();
    let keys = keys();
    for (i, p) in half.points.iter().enumerate() {
        assert_eq!(*p, [0, 1].map(|c| 0.5 * keys.key(0)[i][c] + 0.5 * keys.key(1)[i][c]));
    }
    // Half of a turn by 90 degrees is one by 45, about the centroid, for every point of every path.
    let turned = run(keys.clone(), &[0.5, 0.5], Interpolation::Arap, None).unwrap();
    let (n, root) = (turned.points.len() - 2, std::f64::consts::FRAC_1_SQRT_2);
    let centre = |points: &[[f64; 2]]| [0, 1].map(|c| points[..n].iter().map(|p| p[c]).sum::<f64>() / n as f64);
    let (from, to) = (centre(keys.key(0)), centre(&turned.points));
    for (p, q) in keys.key(0).iter().zip(&turned.points) {
        let d = [p[0] - from[0], p[1] - from[1]];
        let truth = [to[0] + root * (d[0] - d[1]), to[1] + root * (d[0] + d[1])];
        assert!((truth[0] - q[0]).abs() < 1e-6 && (truth[1] - q[1]).abs() < 1e-6, "{truth:?} {q:?}");
    }
}

#[test]
fn what_cannot_be_retargeted_is_said() {
    let error = |weights: &[f64], i, outline| run(keys(), weights, i, outline).unwrap_err();
    assert_eq!(error(&[1.0], Interpolation::Arap, None), "weights: expected 2, one for each key, found 1");
    assert!(error(&[1.0], Interpolation::Linear, None).starts_with("expected 2 weights"));
    assert_eq!(error(&[1.0, 0.0], Interpolation::Arap, Some("hat")), "expected a path `hat` for the outline, found none");
    assert_eq!(error(&[1.0, 0.0], Interpolation::Arap, Some("dots")), "path `dots`: expected a closed outline, found an open one");
    let mut nan = keys();
    nan.points.data_mut()[3] = f64::NAN;
    assert_eq!(run(nan, &[1.0, 0.0], Interpolation::Linear, None).unwrap_err(), "expected key drawings of finite points, found NaN");
}

/// A square of two triangles, of which the second is bent down by a quarter turn about its corner.
const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
const BENT: [[f64; 2]; 4] = [[0.0, 0.0], [4.0, 0.0], [5.0, 5.0], [-3.0, 6.0]];

/// Where the mesh, gone from the square to `to`, takes a point.
fn carry(to: &[[f64; 2]], p: [f64; 2]) -> [f64; 2] {
    let shares = super::hang(&TRIANGLES, &SQUARE, p);
    [0, 1].map(|c| shares.iter().map(|(i, s)| s * to[*i as usize][c]).sum())
}

#[test]
fn what_sticks_out_goes_with_an_affine_motion_of_the_mesh() {
    let by = |p: [f64; 2]| [1.0 + 0.5 * p[0] - 2.0 * p[1], 3.0 + p[0] + 0.25 * p[1]];
    for p in [[1.0, 0.5], [4.0, 2.0], [-3.0, 2.0], [9.0, 9.0], [2.0, -100.0]] {
        let (found, truth) = (carry(&SQUARE.map(by), p), by(p));
        assert!((0..2).all(|c| (found[c] - truth[c]).abs() < 1e-9), "{p:?}: {found:?}, expected {truth:?}");
    }
}

#[test]
fn what_sticks_out_does_not_tear() {
    // Once around the square, past the corners where the nearest triangle changes, and straight out of it over an edge.
    let around =
        (0..4000).map(|i| libm::sincos(f64::from(i) * core::f64::consts::TAU / 4000.0)).map(|(s, c)| [2.0 + 5.0 * c, 2.0 + 5.0 * s]);
    let out = (0..4000).map(|i| [3.0, 3.9 + f64::from(i) * 1e-3]);
    for line in [around.collect::<Vec<_>>(), out.collect()] {
        let at: Vec<[f64; 2]> = line.iter().map(|p| carry(&BENT, *p)).collect();
        let step = |w: &[[f64; 2]]| libm::hypot(w[1][0] - w[0][0], w[1][1] - w[0][1]);
        let most = at.windows(2).zip(line.windows(2)).map(|(a, p)| step(a) / step(p)).fold(0.0, f64::max);
        assert!(most < 6.0, "neighbours go {most} times as far apart");
    }
}
