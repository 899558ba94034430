//! Feet that stand.

use std::sync::Arc;

use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use pegbar_engine::node::{Arg, Cancel, Context, Frames, In, Input, NodeError, PerFrame, Sequence, SequenceRef, Whole};
use pegbar_engine::setting::{ClockName, Setting, SettingError};
use pegbar_engine::value::{TimeMap, Value, ValueRef};

use super::joint_angles::PoseJointAnglesOutputs;
use super::pin::Method;
use super::*;
use crate::algo::joint_angles::{Aim, Reading};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::counted::clock;
use crate::data::{Markers3, Mesh, Pose, Skeleton, SkinnedMesh};
use crate::lift::Limbs;
use crate::markers::{JointNames, Names};

const FRAMES: usize = 24;

fn sequence<T: Value>(values: Vec<T>) -> Sequence<T> {
    let clock = Arc::new(clock(values.len()));
    let values: Vec<ValueRef> = values.into_iter().map(|v| Arc::new(v) as ValueRef).collect();
    Sequence::from_arg(Arg::Sequence(SequenceRef::new(Some(clock), values))).unwrap()
}

fn run<N: Whole>(node: N) -> Result<N::Outputs, NodeError> {
    let clock = clock(FRAMES);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

/// A body with one leg: hip, knee, and foot, each half a metre below the one before; the body a metre up.
fn leg() -> Skeleton {
    let up = |y: f64| Matrix4::new_translation(&Vector3::new(0.0, y, 0.0));
    let names = ["body", "hip", "knee", "foot"].map(str::to_owned).to_vec();
    Skeleton::new(vec![-1, 0, 1, 2], &[up(1.2), up(-0.2), up(-0.5), up(-0.5)], names).unwrap()
}

/// It glides to the right and sinks, its knee bent.
fn glide() -> Vec<Pose> {
    let joint = |y: f64, angle: f64| Joint {
        translation: Vector3::new(0.0, y, 0.0),
        rotation: UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle),
        scale: Vector3::repeat(1.0),
    };
    let frame = |k: usize| {
        let mut joints = [joint(1.2, 0.0), joint(-0.2, -0.4), joint(-0.5, 0.8), joint(-0.5, -0.2)];
        joints[0].translation += Vector3::new(0.02 * k as f64, -0.01 * k as f64, 0.0);
        joints.into_iter().collect()
    };
    (0..FRAMES).map(frame).collect()
}

fn places(pose: &Pose) -> Vec<Vector3<f64>> {
    let local: Vec<_> = pose.joints().unwrap().iter().map(Joint::matrix).collect();
    world_from_joint(&leg().parents, &local).unwrap().iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
}

fn parsed(pins: &str) -> Result<Pins, SettingError> {
    <Pins as Setting>::parse(pins)
}

fn pin(pins: &str, method: Method) -> PosePin {
    PosePin {
        skeleton: In::new(leg()),
        pose: sequence(glide()),
        mesh: None,
        pins: parsed(pins).unwrap(),
        method,
        contacts: Vec::new(),
        contact_pose: None,
        contact_speed: 0.2,
        contact_height: 0.05,
        contact_frames: 2,
        ground: None,
        soften: 0,
        blend: None,
    }
}

const FOOT: usize = 3;

#[test]
fn a_foot_stands_while_it_is_pinned_and_the_figure_goes_with_it() {
    let out =
        run(pin(r#"[(frames: (5, 12), joint: "foot"), (frames: (18, 20), joint: "foot", at: (0.5, 0.0, 0.1))]"#, Method::Shift)).unwrap();
    let before: Vec<_> = glide().iter().map(places).collect();
    let after: Vec<_> = out.pose.0.iter().map(places).collect();
    (4..12).for_each(|k| assert!((after[k][FOOT] - before[4][FOOT]).norm() < 1e-12));
    (17..20).for_each(|k| assert!((after[k][FOOT] - Vector3::new(0.5, 0.0, 0.1)).norm() < 1e-12));
    assert!(out.error.0.iter().all(|e| e.value < 1e-12));
    // All joints are shifted alike, and no frame jumps.
    for k in 0..FRAMES {
        let by = after[k][0] - before[k][0];
        assert!((0..4).all(|j| (after[k][j] - before[k][j] - by).norm() < 1e-12));
    }
    // Half a metre in six frames, at most twice as fast in the middle as on the mean.
    let fastest = after.windows(2).map(|w| (w[1][0] - w[0][0]).norm()).fold(0.0, f64::max);
    assert!(fastest < 0.2, "{fastest}");
}

#[test]
fn a_leg_bends_to_where_its_foot_is_pinned_and_the_body_goes_on() {
    let out = run(pin(r#"[(frames: (8, 14), joint: "foot", at: (0.15, 0.3, 0.05))]"#, Method::TwoBone)).unwrap();
    let before: Vec<_> = glide().iter().map(places).collect();
    for (k, pose) in out.pose.0.iter().enumerate() {
        let (now, was) = (places(pose), &before[k]);
        assert!((now[1] - was[1]).norm() < 1e-12, "the hip goes on");
        let lengths = [(now[2] - now[1]).norm(), (now[3] - now[2]).norm()];
        assert!(lengths.iter().all(|l| (l - 0.5).abs() < 1e-12), "{lengths:?}");
        if (7..14).contains(&k) {
            assert!((now[FOOT] - Vector3::new(0.15, 0.3, 0.05)).norm() < 1e-9, "{k}: {}", now[FOOT]);
        }
        // The foot keeps its own direction.
        let own = |p: &Pose| (0..4).map(|j| p.joint(j).unwrap().rotation).fold(UnitQuaternion::identity(), |a, b| a * b);
        assert!(own(pose).angle_to(&own(&glide()[k])) < 1e-9);
    }
    // It comes and goes over four frames, and leaves the rest as it was, bit by bit.
    assert_eq!((&out.pose.0[2], &out.pose.0[18]), (&glide()[2], &glide()[18]));
    assert!(out.error.0.iter().all(|e| e.value < 1e-9));
    let far = run(pin(r#"[(frames: (8, 8), joint: "foot", at: (5, 0, 0))]"#, Method::TwoBone)).unwrap();
    assert!(far.error.0[7].value > 3.0, "out of reach is told");
}

#[test]
fn no_joint_and_no_vertex_goes_below_the_ground() {
    let lowest = |out: &pin::PosePinOutputs| out.pose.0.iter().flat_map(places).map(|p| p.y).fold(f64::INFINITY, f64::min);
    for soften in [0, 3] {
        let out = run(PosePin { ground: Some(0.0), soften, ..pin("[]", Method::Shift) }).unwrap();
        assert!(lowest(&out) > -1e-12 && lowest(&out) < 1e-9, "{}", lowest(&out));
        assert_eq!(out.pose.0[0], glide()[0], "what is above stays");
    }
    // A sole 0.1 below the foot's joint.
    let sole = Mesh { positions: vec![[0.0, -0.1, 0.0]], ..Mesh::default() };
    let inverse: Vec<Matrix4<f64>> = [1.2, 1.0, 0.5, 0.0].map(|y: f64| Matrix4::new_translation(&Vector3::new(0.0, -y, 0.0))).to_vec();
    let mesh = || SkinnedMesh::new(sole.clone(), 1, vec![3], vec![1.0], &inverse).unwrap();
    let out = run(PosePin { ground: Some(0.0), mesh: Some(In::new(mesh())), ..pin("[]", Method::Shift) }).unwrap();
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.2) * Vector3::new(0.0, -0.1, 0.0);
    let heel = out.pose.0.iter().map(|p| places(p)[FOOT].y + down.y).fold(f64::INFINITY, f64::min);
    assert!(heel.abs() < 1e-9, "{heel}");
    let out = run(PosePin { mesh: Some(In::new(mesh())), ..pin("[(frames: (1, 24), vertex: 0, at: (0, 0, 0))]", Method::Shift) }).unwrap();
    assert!(out.pose.0.iter().all(|p| (places(p)[FOOT] + down).norm() < 1e-9));
}

#[test]
fn pins_that_name_what_there_is_not_are_refused() {
    let refused = |pins: &str, method| run(pin(pins, method)).map(|_| ()).unwrap_err().message;
    assert_eq!(refused(r#"[(frames: (1, 2), joint: "toe")]"#, Method::Shift), "pins: expected a joint of the skeleton, found \"toe\"");
    assert_eq!(refused(r#"[(frames: (1, 99), joint: "foot")]"#, Method::Shift), "pins: expected frames of the motion, 1 to 24, found 99");
    assert_eq!(refused("[(frames: (1, 2), vertex: 0)]", Method::Shift), "pins: expected `mesh` where a vertex is pinned, found none");
    let message = refused(r#"[(frames: (1, 2), joint: "hip", at: (0, 0, 0))]"#, Method::TwoBone);
    assert_eq!(message, "pins: expected a joint with two above it for `two_bone`, found \"hip\"");
    let problems = parsed(r#"[(frames: (2, 1), joint: "a"), (frames: (1, 2)), (frames: (1, 2), joint: "a")]"#).unwrap().problems();
    assert_eq!(problems.len(), 2);
    assert!(parsed("[(frame: (1, 2))]").is_err());
}

#[test]
fn a_mesh_stands_on_its_vertex_and_on_the_ground() {
    let mesh =
        |k: usize| Mesh { positions: vec![[0.02 * k as f64, 0.1 - 0.01 * k as f64, 0.0], [0.02 * k as f64, 1.0, 0.0]], ..Mesh::default() };
    let node = |pins: &str, ground| MeshPin {
        mesh: sequence((0..FRAMES).map(mesh).collect()),
        pins: parsed(pins).unwrap(),
        ground,
        soften: 0,
        blend: Some(2.0),
    };
    let out = run(node("[(frames: (10, 14), vertex: 0)]", None)).unwrap();
    let at = |k: usize| Vector3::from(out.mesh.0[k].positions[0]);
    (9..14).for_each(|k| assert!((at(k) - Vector3::from(mesh(9).positions[0])).norm() < 1e-12));
    assert_eq!((&out.mesh.0[5], &out.mesh.0[18]), (&mesh(5), &mesh(18)));
    let out = run(node("[]", Some(0.0))).unwrap();
    let lowest = out.mesh.0.iter().flat_map(|m| &m.positions).map(|p| p[1]).fold(f64::INFINITY, f64::min);
    assert!(lowest.abs() < 1e-12 && out.mesh.0[3] == mesh(3));
    let error = run(node("[(frames: (1, 2), vertex: 7)]", None)).map(|_| ()).unwrap_err().message;
    assert_eq!(error, "frame 0 from the first: expected a vertex 7 at a finite place, found none of 2");
}

#[test]
fn a_foot_that_stands_in_the_captured_motion_is_pinned_where_it_touches_down() {
    // Captured, the foot stands for frames 4 to 9 of the clock; lifted, it slides on.
    let captured: Vec<Pose> = glide()
        .into_iter()
        .enumerate()
        .map(|(k, mut pose)| {
            let still = [3.0, k as f64][usize::from(!(3..=8).contains(&k))];
            pose.translations[0] = [0.1 * still, 1.2, 0.0];
            pose
        })
        .collect();
    let node =
        PosePin { contacts: vec!["foot".to_owned()], contact_pose: Some(sequence(captured)), blend: Some(0.0), ..pin("[]", Method::Shift) };
    let out = run(node).unwrap();
    let (before, after): (Vec<_>, Vec<_>) = glide().iter().zip(&out.pose.0).map(|(a, b)| (places(a)[FOOT], places(b)[FOOT])).unzip();
    (3..=8).for_each(|k| assert!((after[k] - before[3]).norm() < 1e-12, "{k}"));
    assert!((after[12] - before[12]).norm() < 1e-12 && (before[8] - before[3]).norm() > 0.05);
    let wrong = PosePin { contacts: vec!["paw".to_owned()], ..pin("[]", Method::Shift) };
    assert_eq!(run(wrong).err().unwrap().message, "pins: expected a joint of the skeleton, found \"paw\"");
}

/// Markers on the leg's joints.
fn on_leg(pose: &Pose) -> Markers3 {
    Markers3 { points: places(pose).into_iter().map(Into::into).collect(), names: leg().names }
}

fn solved(markers: Markers3, joints: &str) -> Result<PoseJointAnglesOutputs, NodeError> {
    let node = PoseJointAngles {
        markers: In::new(markers),
        prior: In::new(glide()[0].clone()),
        skeleton: In::new(leg()),
        naming: Names::Auto,
        joints: <JointNames as Setting>::parse(joints).unwrap(),
        limbs: Limbs(Vec::new()),
        fit: Vec::new(),
        reading: Reading::SwingTwist,
        aim: Aim::Marker,
        stretch: 0.0,
    };
    let clock = clock(1);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

#[test]
fn joints_come_to_their_markers_by_name() {
    let truth = glide()[9].clone();
    let out = solved(on_leg(&truth), "{}").unwrap();
    assert!(out.error.value < 1e-12);
    assert!(places(&out.pose).iter().zip(places(&truth)).all(|(a, b)| (a - b).norm() < 1e-12));
    // Others are called otherwise, in another order, or are not of the leg at all.
    let mut named = on_leg(&truth);
    named.names[3] = "ankle".to_owned();
    named.points.reverse();
    named.names.reverse();
    named.points.push([9.0; 3]);
    named.names.push("hat".to_owned());
    let out = solved(named.clone(), r#"{ "body": "body", "hip": "hip", "knee": "knee", "ankle": "foot" }"#).unwrap();
    assert!(places(&out.pose).iter().zip(places(&truth)).all(|(a, b)| (a - b).norm() < 1e-12));
    let refused = |markers: Markers3, joints: &str| solved(markers, joints).map(|_| ()).unwrap_err().message;
    assert_eq!(refused(named.clone(), r#"{ "ankle": "feet" }"#), r#"joints: expected a joint of the skeleton for "ankle", found "feet""#);
    let twice = r#"{ "ankle": "foot", "hat": "foot" }"#;
    assert_eq!(refused(named.clone(), twice), r#"markers: expected one for a joint, found "ankle" and "hat" for "foot""#);
    named.names = vec!["a".to_owned(), "b".to_owned(), "c".to_owned(), "d".to_owned(), "e".to_owned()];
    assert_eq!(refused(named.clone(), "{}"), "markers: expected a marker on at least one joint, found none");
    named.names.clear();
    assert_eq!(refused(named, "{}"), "markers: expected names, found none");
}

#[test]
fn the_pelvis_alone_is_turned_to_its_markers() {
    let node = |prior: Option<Pose>, markers: Markers3, fit: &[&str]| PoseProcrustes {
        markers: In::new(markers),
        skeleton: In::new(leg()),
        prior: prior.map(In::new),
        naming: Names::Auto,
        joints: JointNames::default(),
        fit: fit.iter().map(|f| (*f).to_owned()).collect(),
    };
    let run = |node: PoseProcrustes| {
        let clock = clock(1);
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
    };
    // One bone tells a direction; the rest is as captured.
    let mut markers = on_leg(&glide()[0]);
    markers.points[1] = [0.2, markers.points[0][1], 0.0];
    let out = run(node(Some(glide()[3].clone()), markers.clone(), &[])).unwrap();
    assert_eq!(out.told.value, 0.5);
    assert!((places(&out.pose)[1] - Vector3::new(0.2, 1.2, 0.0)).norm() < 1e-12 && out.error.value < 1e-12);
    assert_eq!(out.pose.rotations[1..], glide()[3].rotations[1..]);
    assert_eq!(out.rotation.values, out.pose.rotations[0]);
    let still = run(node(None, Markers3 { points: vec![[1.0, 2.0, 3.0]], names: vec!["body".to_owned()] }, &[])).unwrap();
    assert_eq!((still.told.value, still.pose.translations[0]), (0.0, [1.0, 2.0, 3.0]));
    let error = run(node(None, markers, &["hop"])).map(|_| ()).unwrap_err().message;
    assert_eq!(error, r#"fit: expected a marker that has a joint, found "hop""#);
}
fn seen_from() -> crate::data::Camera {
    use crate::algo::camera::{Camera, Orbit, orthographic};
    let orbit = Orbit { target: [0.0, 0.6, 0.0], azimuth: 1.2, elevation: 0.1, roll: 0.0, distance: 5.0 };
    crate::data::Camera::from(&Camera::new(orbit.view(), orthographic(150.0, [320, 240], 0.1, 100.0), [320, 240]).unwrap())
}

fn fit(markers: crate::data::Markers2) -> fit::PoseFit {
    fit::PoseFit {
        mesh: None,
        skeleton: In::new(leg()),
        pose: In::new(glide().remove(0)),
        camera: In::new(seen_from()),
        drawing: None,
        markers: Some(In::new(markers)),
        marker_joints: Vec::new(),
        root: true,
        turns: vec!["*".to_owned()],
        lengths: Vec::new(),
        scales: Vec::new(),
        marker_weight: 1.0,
        outline_weight: 1.0,
        turn_prior: 0.1,
        length_prior: 1.0,
        scale_prior: 1.0,
        reach: 48.0,
        threshold: 0.4,
        rounds: 20,
    }
}

#[test]
fn a_figure_comes_to_its_markers_and_a_drawn_bone_gets_longer() {
    let camera = crate::algo::camera::Camera::try_from(&seen_from()).unwrap();
    let mut wanted = glide().remove(18);
    let mark = |pose: &Pose| crate::data::Markers2 {
        points: places(pose).iter().map(|p| camera.project((*p).into())).map(|[x, y, _]| [x, y]).collect(),
        names: leg().names,
    };
    let out = run_one(fit(mark(&wanted))).unwrap();
    assert!(out.marker_error.value < 0.1, "{}", out.marker_error.value);
    // The shin half as long again: out of reach for turns alone, met by its length.
    wanted.translations[3] = wanted.translations[3].map(|v| v * 1.5);
    let stiff = run_one(fit(mark(&wanted))).unwrap();
    let long = run_one(fit::PoseFit { lengths: vec!["foot".to_owned()], ..fit(mark(&wanted)) }).unwrap();
    assert!(stiff.marker_error.value > 1.0 && long.marker_error.value < 0.2, "{} {}", stiff.marker_error.value, long.marker_error.value);
    let length = Vector3::from(long.pose.translations[3]).norm();
    assert!((length / 0.75 - 1.0).abs() < 0.06, "{length}");
    // What is not seen says nothing.
    let mut unseen = mark(&glide()[0]);
    unseen.points[2] = [f64::NAN; 2];
    assert!(run_one(fit(unseen)).unwrap().marker_error.value < 1e-3);
}

#[test]
fn a_fit_without_goals_or_with_wrong_names_is_refused() {
    let empty = crate::data::Markers2::default();
    let refused = |node: fit::PoseFit| run_one(node).map(|_| ()).unwrap_err().message;
    assert_eq!(refused(fit::PoseFit { markers: None, ..fit(empty.clone()) }), "expected a drawing or markers, found neither");
    let named = crate::data::Markers2 { points: vec![[1.0, 2.0]], names: vec!["toe".to_owned()] };
    assert_eq!(refused(fit(named)), "markers: expected a joint of the skeleton, found \"toe\"");
    assert_eq!(
        refused(fit::PoseFit { scales: vec!["toe".to_owned()], ..fit(empty) }),
        "scales: expected a joint of the skeleton, found \"toe\""
    );
}

/// A board a metre high, bound to the body: flat, or a box as deep as it is wide.
fn board(depth: f64) -> SkinnedMesh {
    let corner =
        |i: u32| [if i & 1 == 0 { -0.2 } else { 0.2 }, if i & 2 == 0 { 0.2 } else { 1.2 }, if i & 4 == 0 { depth } else { -depth }];
    let quads: &[[u32; 4]] =
        if depth > 0.0 { &[[0, 1, 3, 2], [5, 4, 6, 7], [4, 0, 2, 6], [1, 5, 7, 3], [2, 3, 7, 6], [4, 5, 1, 0]] } else { &[[0, 1, 3, 2]] };
    let n: u32 = if depth > 0.0 { 8 } else { 4 };
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mesh = Mesh { positions: (0..n).map(corner).collect(), triangles: Arc::new(triangles), ..Mesh::default() };
    let bind = Matrix4::new_translation(&Vector3::new(0.0, -1.2, 0.0));
    SkinnedMesh::new(mesh, 1, vec![0; n as usize], vec![1.0; n as usize], &[bind; 4]).unwrap()
}

/// Fitted to a black rectangle on white by outlines alone.
fn outlined(mesh: SkinnedMesh, [left, top, right, bottom]: [usize; 4], reach: f64) -> Result<fit::PoseFitOutputs, NodeError> {
    use crate::algo::camera::{Camera, Orbit, orthographic};
    let ink = |i: usize| (left..right).contains(&(i % 320)) && (top..bottom).contains(&(i / 320));
    let samples = (0..320 * 240).flat_map(|i| [if ink(i) { 0.0 } else { 1.0 }; 3]).collect();
    let orbit = Orbit { target: [0.0, 0.6, 0.0], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 5.0 };
    let seen = Camera::new(orbit.view(), orthographic(150.0, [320, 240], 0.1, 100.0), [320, 240]).unwrap();
    run_one(fit::PoseFit {
        mesh: Some(In::new(mesh)),
        camera: In::new(crate::data::Camera::from(&seen)),
        drawing: Some(In::new(crate::data::Image::new(320, 240, 3, samples).unwrap())),
        markers: None,
        reach,
        ..fit(crate::data::Markers2::default())
    })
}

#[test]
fn a_fit_by_outlines_comes_to_its_drawing_and_is_no_worse_than_where_it_began() {
    // The box is seen from 130 to 190 across and from 30 to 180 down; it is drawn 24 pixels, .16 metres, to the right.
    let out = outlined(board(0.2), [154, 30, 214, 180], 48.0).unwrap();
    assert!((out.pose.translations[0][0] - 0.16).abs() < 0.03, "{:?}", out.pose.translations[0]);
    // What no pose of it looks like. Within two pixels there is nothing to go by, and it stays as it was.
    let odd = |reach: f64| outlined(board(0.2), [10, 10, 40, 230], reach).unwrap().outline_error.value;
    let (still, best) = (odd(2.0), odd(48.0));
    assert!(still > 10.0 && best <= still, "{still} {best}");
}

#[test]
fn a_mesh_out_of_the_picture_is_refused_and_a_flat_one_is_fitted() {
    let mut away = board(0.2);
    away.positions.iter_mut().for_each(|p| p[0] += 50.0);
    let error = outlined(away, [154, 30, 214, 180], 48.0).map(|_| ()).unwrap_err();
    assert_eq!(error.message, "mesh: expected an outline in the picture, found none");
    let out = outlined(board(0.0), [154, 30, 214, 180], 48.0).unwrap();
    assert!((out.pose.translations[0][0] - 0.16).abs() < 0.03, "{:?}", out.pose.translations[0]);
}

/// A trunk with one leg of three boxes.
fn boxes() -> SkinnedMesh {
    const QUADS: [[u32; 4]; 6] = [[0, 1, 3, 2], [5, 4, 6, 7], [4, 0, 2, 6], [1, 5, 7, 3], [2, 3, 7, 6], [4, 5, 1, 0]];
    // Half the depth, from where to where along the bone, and half the width: of trunk, thigh, shin and foot, each in its joint's place at rest.
    let parts: [([f64; 2], [f64; 2], f64); 4] = [
        ([0.1, 0.16], [0.85, 1.9], 0.0),
        ([0.07, 0.07], [0.5, 1.05], 0.0),
        ([0.05, 0.05], [0.02, 0.5], 0.0),
        ([0.05, 0.09], [-0.06, 0.03], 0.1),
    ];
    let corner = |(half, up, forward): &([f64; 2], [f64; 2], f64), i: usize| {
        let sign = |k: usize| if i >> k & 1 == 0 { -1.0 } else { 1.0 };
        [half[0] * sign(0), up[usize::from(i & 2 != 0)], half[1] * sign(2) + forward]
    };
    let positions = parts.iter().flat_map(|p| (0..8).map(move |i| corner(p, i))).collect();
    let quads = (0..4).flat_map(|b| QUADS.map(|q| q.map(|v| v + 8 * b)));
    let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let bind: Vec<Matrix4<f64>> = [1.2, 1.0, 0.5, 0.0].map(|y: f64| Matrix4::new_translation(&Vector3::new(0.0, -y, 0.0))).to_vec();
    let joints = (0..32).map(|v| v / 8).collect();
    SkinnedMesh::new(Mesh { positions, triangles: Arc::new(triangles), ..Mesh::default() }, 1, joints, vec![1.0; 32], &bind).unwrap()
}

/// The leg drawn in one pose and fitted from another by the outline alone.
fn leg_drawn(drawn: &Pose, start: &Pose, reach: f64) -> fit::PoseFitOutputs {
    use crate::algo::camera::{Camera, Orbit, orthographic};
    use crate::algo::skin::Skin;
    use crate::algo::surface::{Part, Surface};
    let orbit = Orbit { target: [0.0, 0.9, 0.0], azimuth: std::f64::consts::FRAC_PI_2, elevation: 0.0, roll: 0.0, distance: 5.0 };
    let seen = Camera::new(orbit.view(), orthographic(100.0, [320, 240], 0.1, 100.0), [320, 240]).unwrap();
    let mesh = boxes();
    let local: Vec<_> = drawn.joints().unwrap().iter().map(Joint::matrix).collect();
    let world = world_from_joint(&leg().parents, &local).unwrap();
    let motions: Vec<_> = world.iter().zip(mesh.inverse_bind()).map(|(w, b)| w * b).collect();
    let skin = Skin::new(&mesh.positions, &[], 1, mesh.joints.data(), mesh.weights.data(), 4).unwrap();
    let (positions, _) = skin.pose(&motions, false).unwrap();
    let surface = Surface::new(&[Part { positions: &positions, triangles: &mesh.triangles, normals: &[] }], 1.0).unwrap();
    let samples = crate::algo::toon::coverage(&surface, &seen).into_iter().flat_map(|a| [a; 4]).collect();
    run_one(fit::PoseFit {
        mesh: Some(In::new(mesh)),
        pose: In::new(start.clone()),
        camera: In::new(crate::data::Camera::from(&seen)),
        drawing: Some(In::new(crate::data::Image::new(320, 240, 4, samples).unwrap())),
        markers: None,
        root: false,
        turns: vec!["hip".to_owned(), "knee".to_owned()],
        turn_prior: 1.0,
        reach,
        ..fit(crate::data::Markers2::default())
    })
    .unwrap()
}

#[test]
fn the_outline_of_coarse_boxes_is_that_of_their_drawing() {
    // Of twelve edges of each box a few are outline: what lies between their ends counts.
    let pose = glide().remove(4);
    let out = leg_drawn(&pose, &pose, 48.0);
    assert!(out.outline_error.value < 0.1, "{}", out.outline_error.value);
    let off = places(&out.pose).iter().zip(places(&pose)).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < 0.003, "{off}");
}

#[test]
fn a_limb_that_was_drawn_elsewhere_is_found_by_the_outline_alone() {
    let start = glide().remove(4);
    let mut drawn = start.clone();
    let turned = |q: [f64; 4], angle: f64| {
        let [x, y, z, w] = q;
        let q = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
        [q.i, q.j, q.k, q.w]
    };
    drawn.rotations[1] = turned(drawn.rotations[1], -1.1);
    drawn.rotations[2] = turned(drawn.rotations[2], 0.5);
    let far = (places(&drawn)[FOOT] - places(&start)[FOOT]).norm();
    let out = leg_drawn(&drawn, &start, 120.0);
    let off = (places(&out.pose)[FOOT] - places(&drawn)[FOOT]).norm();
    assert!(far > 0.6 && off < 0.02 && out.outline_error.value < 0.3, "{far} {off} {}", out.outline_error.value);
    // Within two pixels there is nothing to go by.
    let still = leg_drawn(&drawn, &start, 2.0);
    assert!((places(&still.pose)[FOOT] - places(&start)[FOOT]).norm() < 0.2);
}

#[test]
fn a_limb_that_was_drawn_towards_the_eye_is_found_as_far_as_its_picture_goes() {
    let start = glide().remove(4);
    let mut drawn = start.clone();
    let [x, y, z, w] = drawn.rotations[1];
    let q = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.8) * UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
    drawn.rotations[1] = [q.i, q.j, q.k, q.w];
    let out = leg_drawn(&drawn, &start, 120.0);
    // Seen along x in parallel lines: to us or away is the same picture, and the mirrored pose as good as the true one.
    let seen = |pose: &Pose| places(pose)[FOOT].yz();
    let (far, off) = ((seen(&start) - seen(&drawn)).norm(), (seen(&out.pose) - seen(&drawn)).norm());
    assert!(far > 0.2 && off < 0.03 && out.outline_error.value < 0.3, "{far} {off} {}", out.outline_error.value);
}

fn run_one(node: fit::PoseFit) -> Result<fit::PoseFitOutputs, NodeError> {
    use pegbar_engine::node::PerFrame;
    let clock = clock(1);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

#[test]
fn a_map_asks_for_poses_between_frames() {
    let film = clock(3);
    let source = Arc::new(pegbar_engine::clock::Clock { name: "capture".to_owned(), first: 10, last: 13, fps: (120, 1) });
    let pose = |k: i64| Arc::new(Pose::from_iter([joint((k - 10) as f64)]));
    let node = |frames: Vec<f64>, at: &[i64]| PoseResample {
        pose: Frames::Each(at.iter().map(|k| (*k, pose(*k))).collect()),
        map: Some(In::new(TimeMap { source_frames: frames })),
        speed: 1.0,
        clock: ClockName("frames".to_owned()),
    };
    let input_clocks = [("pose", source)];
    let cancel = Cancel::default();
    let at = |frame: i64| Context { frame, clock: &film, input_clocks: &input_clocks, cancel: &cancel };
    let map = || vec![10.25, 12.0000001, 99.0];
    let found = |k: i64| {
        let cx = at(k);
        let asked = node(map(), &[]).reads("pose", &cx);
        (asked.clone(), node(map(), &asked).run(&cx).unwrap().pose.joint(0).unwrap())
    };
    let near = |a: Joint, b: Joint| (a.translation - b.translation).amax() < 1e-12 && a.rotation.angle_to(&b.rotation) < 1e-12;
    assert!(found(1).0 == [10, 11] && near(found(1).1, joint(0.25)));
    assert!(found(2).0 == [12] && found(2).1 == joint(2.0), "a whole frame, bit by bit");
    assert!(found(3).0 == [13] && found(3).1 == joint(3.0), "the end is held");
    let error = node(vec![10.0; 2], &[10, 11]).run(&at(1)).err().unwrap();
    assert!(error.message.starts_with("map: expected one of 3 frames, found 2"), "{}", error.message);
}

/// A joint that has gone `t` metres and turned by `t` fifths of a radian.
fn joint(t: f64) -> Joint {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2 * t);
    Joint { translation: Vector3::new(t, 0.0, 0.0), rotation, scale: Vector3::repeat(1.0) }
}
