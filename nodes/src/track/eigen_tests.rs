//! A drawn worm that bends, tracked through a graph: keys, in-betweens, their space, footage, contour.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::array::NdArray;
use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::{Curve, Value, ValueRef, downcast};
use pegbar_engine::{Node, Outputs};

use crate::algo::arap::Options as ArapOptions;
use crate::algo::key_blend::{Interpolation, KeyBlend, Options as BlendOptions};
use crate::algo::paint::{FillRule, coverage, polygon};
use crate::algo::raster::{Affine, apply};
use crate::data::{Affine2, Image, KeyShapes, Matte, Shape, Weights};
use kurbo::Point;

const SIZE: (usize, usize) = (160, 140);

/// The contour of a worm that bends by an angle from its tail to its head.
fn worm(bend: f64) -> Vec<[f64; 2]> {
    let (length, width, n) = (90.0, 9.0, 18);
    let spine = |t: f64| {
        let radius = length / bend;
        let (s, c) = libm::sincos(bend * (t - 0.5));
        ([80.0 + radius * s, 70.0 + radius * (1.0 - c)], [-s, c])
    };
    let side = |t: f64, d: f64| {
        let (p, normal) = spine(t);
        [p[0] + d * normal[0], p[1] + d * normal[1]]
    };
    let along = |k: usize| k as f64 / n as f64;
    (0..=n).map(|k| side(along(k), -width)).chain((0..=n).rev().map(|k| side(along(k), width * (0.5 + 0.5 * along(k))))).collect()
}

const BENDS: [f64; 3] = [-1.2, 0.1, 1.4];

fn drawn(points: &[[f64; 2]]) -> Vec<[f32; 4]> {
    let path = |of: &[[f64; 2]]| polygon(&of.iter().map(|p| Point::new(p[0], p[1])).collect::<Vec<_>>());
    let n = points.len();
    let middle = |i: usize, share: f64| [0, 1].map(|d| points[i][d] + share * (points[n - 1 - i][d] - points[i][d]));
    let belly: Vec<[f64; 2]> = (1..n / 2 - 1).map(|i| middle(i, 0.3)).chain((1..n / 2 - 1).rev().map(|i| middle(i, 0.7))).collect();
    let body = coverage(&path(points), FillRule::NonZero, SIZE.0, SIZE.1);
    let inner = coverage(&path(&belly), FillRule::NonZero, SIZE.0, SIZE.1);
    let mix = |(b, i): (&f32, &f32)| {
        let i = i.min(*b);
        [0.05 * (b - i) + 0.7 * i, 0.04 * (b - i) + 0.5 * i, 0.1 * (b - i) + 0.1 * i, *b]
    };
    body.iter().zip(&inner).map(mix).collect()
}

/// Key pictures.
#[derive(Outputs)]
struct Keys {
    /// The contours.
    keys: KeyShapes,
    /// The first picture.
    first: Image,
    /// The second.
    second: Image,
    /// The third.
    third: Image,
}

/// Three drawings.
#[derive(Node)]
#[node(id = "test.keys", version = 1, outputs = Keys)]
struct TestKeys {}

impl PerFrame for TestKeys {
    fn run(self, _cx: &Context) -> Result<Keys, NodeError> {
        let shapes = BENDS.map(worm);
        let flat: Vec<f64> = shapes.iter().flatten().flatten().copied().collect();
        let points = NdArray::new([3, shapes[0].len(), 2], flat).unwrap();
        let [first, second, third] = shapes.map(|s| Image::new(SIZE.0, SIZE.1, 4, drawn(&s).concat()).unwrap());
        Ok(Keys { keys: KeyShapes { points, names: Vec::new(), closed: true }, first, second, third })
    }
}

/// Footage and truth.
#[derive(Outputs)]
struct Plate {
    /// The footage.
    image: Image,
    /// Its matte.
    matte: Matte,
}

/// The worm on its way.
#[derive(Node)]
#[node(id = "test.worm", version = 1, kind = source, outputs = Plate, uses_frame)]
struct TestWorm {
    /// Its clock.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

/// The true contour of a frame, in the frame.
fn truth(frame: i64) -> Vec<[f64; 2]> {
    let t = frame as f64;
    let keys = BENDS.map(worm);
    let views: Vec<&[[f64; 2]]> = keys.iter().map(Vec::as_slice).collect();
    let options = BlendOptions { interpolation: Interpolation::Arap, count: 0, closed: true, mesh: true, arap: ArapOptions::default() };
    let share = (0.23 * t) % 1.0;
    let weights = if frame % 2 == 0 { [1.0 - share, share, 0.0] } else { [0.0, 1.0 - share, share] };
    let blend = KeyBlend::new(&views, options).unwrap().blend(&weights).unwrap();
    let (s, c) = libm::sincos(0.15 * libm::sin(0.8 * t));
    let grow = 1.0 + 0.1 * libm::sin(0.5 * t);
    let m = Affine::new(c * grow, -s, 3.0 * libm::sin(0.9 * t), s, c / grow, 5.0 * libm::cos(0.7 * t));
    let about = Affine::new(1.0, 0.0, -80.0, 0.0, 1.0, -70.0);
    let back = Affine::new(1.0, 0.0, 80.0, 0.0, 1.0, 70.0);
    let m = crate::algo::raster::compose(&back, &crate::algo::raster::compose(&m, &about));
    blend[..keys[0].len()].iter().map(|p| apply(&m, (*p).into()).into()).collect()
}

impl PerFrame for TestWorm {
    fn run(self, cx: &Context) -> Result<Plate, NodeError> {
        let over = drawn(&truth(cx.frame));
        let ground = |i: usize| {
            let (x, y) = ((i % SIZE.0) as f32, (i / SIZE.0) as f32);
            [0.3 + 0.1 * (0.2 * x).sin(), 0.4 + 0.1 * (0.15 * y).sin(), 0.35]
        };
        let pixel = |(i, p): (usize, &[f32; 4])| [0, 1, 2].map(|c| p[c] + (1.0 - p[3]) * ground(i)[c]);
        let image: Vec<f32> = over.iter().enumerate().flat_map(pixel).collect();
        let matte = over.iter().map(|p| p[3]).collect();
        Ok(Plate { image: Image::new(SIZE.0, SIZE.1, 3, image).unwrap(), matte: Matte::new(SIZE.0, SIZE.1, matte).unwrap() })
    }
}

fn try_run(track: &str, outputs: &[usize]) -> Result<Vec<Vec<ValueRef>>, String> {
    let text = format!(
        r#"Graph(pegbar: 1, frames: (first: 1, last: 10, fps: 12), nodes: {{
            "keys": (type: "test.keys"), "plate": (type: "test.worm"),
            "all": (type: "keys.inbetween", keys: "@keys.keys", images: ["@keys.first", "@keys.second", "@keys.third"], count: 5),
            "space": (type: "keys.basis", keys: "@all.keys", images: "@all.images", components: 10),
            "shapes": (type: "keys.basis", keys: "@all.keys"),
            "track": (type: "track.eigen", image: "@plate.image", {track}) }})"#
    );
    let registry = crate::registry().per_frame::<TestKeys>().per_frame::<TestWorm>();
    let loaded = load_text(Path::new("eigen.ron"), &text, &registry, &LoadOptions::default());
    let graph = loaded.graph.ok_or_else(|| loaded.sources.render_all(&loaded.diagnostics, false))?;
    let ports: Vec<Port> = outputs.iter().map(|&output| Port { node: graph.find("track").unwrap(), output }).collect();
    let mut report = execute(&graph, &[], &ports, &Options::default()).unwrap();
    if let Some(failure) = report.failures.first() {
        return Err(format!("{failure:?}"));
    }
    Ok(ports.iter().map(|p| report.kept.remove(p).unwrap().into_iter().map(Option::unwrap).collect()).collect())
}

fn all<T: Value>(values: Vec<ValueRef>) -> Vec<Arc<T>> {
    values.into_iter().map(|v| downcast(v).unwrap()).collect()
}

#[test]
fn a_worm_is_followed_from_pose_to_pose() {
    let how = r#"matte: "@plate.matte", basis: "@space.basis", keys: "@all.keys""#;
    let mut found = try_run(how, &[0, 1, 3, 5]).unwrap_or_else(|e| panic!("{e}"));
    let converged = all::<Curve>(found.pop().unwrap());
    let shapes = all::<Shape>(found.pop().unwrap());
    let weights = all::<Weights>(found.pop().unwrap());
    let motions = all::<Affine2>(found.pop().unwrap());
    assert!(converged.iter().all(|c| c.value == 1.0), "{converged:?}");
    let mut worst = 0.0f64;
    for (k, shape) in shapes.iter().enumerate() {
        let truth = truth(k as i64 + 1);
        let square: f64 = shape.points.iter().zip(&truth).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sum();
        worst = worst.max((square / truth.len() as f64).sqrt());
        assert!(weights[k].weights.len() == 11 && (weights[k].weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(motions[k].matrix.as_flattened().iter().all(|v| v.is_finite()));
    }
    assert!(worst < 1.0, "the worst contour is off by {worst} px");
}

#[test]
fn what_cannot_be_tracked_is_told_in_words() {
    let told = |track: &str, text: &str| {
        let error = try_run(track, &[0]).expect_err(track);
        assert!(error.contains(text), "{error}");
    };
    told(r#"basis: "@shapes.basis""#, "expected a space of pictures");
    told(r#"basis: "@space.basis", keys: "@keys.keys""#, "expected 18 contours, one for each picture, or the 11 of the space, found 3");
}
