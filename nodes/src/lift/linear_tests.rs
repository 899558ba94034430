use pegbar_engine::node::{Cancel, Context, NodeError, Sequence, Whole};
use pegbar_engine::value::Value;

use super::{LengthMode, LiftLinear, LiftLinearOutputs, Sizes};
use crate::algo::camera::{Camera, Orbit, orthographic};
use crate::algo::lift::{BasisMode, Framing, LimbRows, Weighting};
use crate::counted::{clock, counted};
use crate::data::{self, Markers2, Markers3};

const NAMES: [&str; 4] = ["pelvis", "neck", "left_shoulder", "left_elbow"];
const FRAMES: usize = 3;

fn camera() -> Camera {
    let orbit = Orbit { target: [0.0, 1.0, 0.0], azimuth: 0.6, elevation: 0.1, roll: 0.0, distance: 5.0 };
    Camera::new(orbit.view(), orthographic(100.0, [640, 480], 0.1, 100.0), [640, 480]).unwrap()
}

fn pose(k: usize) -> Markers3 {
    let x = 0.1 * k as f64;
    let points = vec![[x, 1.0, 0.0], [x, 1.5, 0.1], [x + 0.2, 1.4, 0.0], [x + 0.3, 1.2, 0.2]];
    Markers3 { points, names: NAMES.map(str::to_owned).to_vec() }
}

/// The drawing of a pose, its markers in another order, one of them not there.
fn drawing(k: usize) -> Markers2 {
    let pixel = |p: [f64; 3]| {
        let [x, y, _] = camera().project(p);
        [x, y]
    };
    let world = pose(k).points;
    let order = [3, 0, 1];
    Markers2 { points: order.map(|m| pixel(world[m])).to_vec(), names: order.map(|m| NAMES[m].to_owned()).to_vec() }
}

fn stream<T: Value>(make: impl Fn(usize) -> T + Send + Sync + 'static) -> Sequence<T> {
    counted(FRAMES, make).0
}

fn node(markers: Sequence<Markers2>, prior: Sequence<Markers3>) -> LiftLinear {
    LiftLinear {
        markers,
        prior,
        camera: counted(1, |_| data::Camera::from(&camera())).0,
        limbs: None,
        lengths: None,
        length_weight: 0.001,
        prior_weight: 0.1,
        weighting: Weighting::Sqrt,
        limb_rows: LimbRows::Unscaled,
        length_mode: LengthMode::Soft,
        relinearize: 0,
        stretch: 0.0,
        depth_weight: 0.0,
        smooth_weight: 0.0,
        accents: 0.0,
        basis: None,
        basis_mode: BasisMode::Hard,
        basis_weight: 0.1,
        framing: Framing::Heading,
        root: "pelvis".to_owned(),
        hips: vec!["left_hip".to_owned(), "right_hip".to_owned()],
        sizes: Sizes::Checked,
    }
}

fn run(node: LiftLinear) -> Result<LiftLinearOutputs, NodeError> {
    let clock = clock(FRAMES);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

#[test]
fn markers_go_together_by_name_and_what_is_not_drawn_is_left_out() {
    let found = run(node(stream(drawing), stream(pose))).unwrap();
    assert_eq!(found.markers.0.len(), FRAMES);
    for (k, m) in found.markers.0.iter().enumerate() {
        let off = m.points.iter().flatten().zip(pose(k).points.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9 && m.names == NAMES, "{off}");
    }
    let unsure = &found.uncertainty.0[0].values;
    assert!(unsure[2] > unsure[0], "who is not drawn is less sure: {unsure:?}");
    assert!(found.residual.0[0].value < 1e-6 && found.length_error.0[0].value < 1e-9);
}

#[test]
fn what_cannot_be_lifted_is_told_by_frame() {
    let lost = |k: usize| {
        let mut pose = pose(k);
        pose.points[1][0] = if k == 2 { f64::NAN } else { pose.points[1][0] };
        pose
    };
    let error = run(node(stream(drawing), stream(lost))).err().unwrap();
    assert!(error.message.starts_with("frame 3: expected finite markers of the capture below 1e6 m, found [NaN"), "{}", error.message);
    let others = |_| Markers2 { points: vec![[0.0; 2]], names: vec!["tail".to_owned()] };
    let error = run(node(stream(others), stream(pose))).err().unwrap();
    assert_eq!(error.message, "frame 1: markers: expected some of those of `prior` by name, found none");
}

#[test]
fn other_units_are_told_by_frame() {
    let larger = |by: f64| move |k: usize| Markers2 { points: drawing(k).points.iter().map(|p| p.map(|c| by * c)).collect(), ..drawing(k) };
    let error = run(node(stream(larger(10.0)), stream(pose))).err().unwrap();
    let expected = "frame 1: expected limbs drawn about as long as the camera sees the capture's, found them 10.000 times as long";
    assert!(error.message.starts_with(expected) && error.help.is_some(), "{}", error.message);
    assert!(run(LiftLinear { sizes: Sizes::Any, ..node(stream(larger(10.0)), stream(pose)) }).is_ok());
    assert!(run(node(stream(larger(0.5)), stream(pose))).is_ok(), "a small figure is drawn on purpose");
    let centimetres = |k: usize| Markers3 { points: pose(k).points.iter().map(|p| p.map(|c| 100.0 * c)).collect(), ..pose(k) };
    let error = run(node(stream(drawing), stream(centimetres))).err().unwrap();
    assert_eq!(error.message, "frame 1: expected a figure in metres, its longest limb from 0.02 to 5, found 50.9902");
    assert!(error.help.unwrap().contains("0.01 for centimetres"));
}
