use nalgebra::{Quaternion, Unit};

use super::*;
use crate::algo::skeleton::world_from_joint;

const ELBOW: usize = 0;
const HIPS: usize = 1;
const SPINE: usize = 2;
const CHEST: usize = 3;
const SHOULDER: usize = 4;
const NECK: usize = 10;
const PARENTS: [i64; 13] = [4, 7, 1, 2, 3, 0, 1, -1, 1, 6, 3, 9, 11];
/// All but the reference above the hips, the spine between, the neck, and the joint without a length below the knee.
const MARKED: [usize; 9] = [0, 1, 3, 4, 5, 6, 8, 9, 12];

/// Numbers from -1 to 1 that look like chance.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next())
    }
    fn turn(&mut self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(Quaternion::new(self.next(), self.next(), self.next(), self.next()))
    }
}

/// Joints at rest in their parents' spaces: turned any way.
fn rest(dice: &mut Dice) -> Vec<Joint> {
    let one = |j: usize| Joint {
        translation: if j == 11 { Vector3::zeros() } else { dice.vector() + Vector3::repeat(0.3) },
        rotation: dice.turn(),
        scale: Vector3::repeat(1.0),
    };
    (0..PARENTS.len()).map(one).collect()
}

fn rig_of(rest: &[Joint], marked: &[usize]) -> Rig {
    let rest: Vec<_> = rest.iter().map(Joint::matrix).collect();
    let marked: Vec<bool> = (0..PARENTS.len()).map(|j| marked.contains(&j)).collect();
    Rig::new(&PARENTS, &rest, &marked, &[], &[]).unwrap()
}

fn places(joints: &[Joint]) -> Vec<Vector3<f64>> {
    let local: Vec<_> = joints.iter().map(Joint::matrix).collect();
    world_from_joint(&PARENTS, &local).unwrap().iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
}

/// A pose of the rig: the reference and the hips anywhere, all turned any way.
fn pose(rest: &[Joint], dice: &mut Dice) -> Vec<Joint> {
    let mut joints = rest.to_vec();
    joints.iter_mut().for_each(|j| j.rotation = dice.turn());
    joints[HIPS].translation = dice.vector();
    joints
}

fn known(places: &[Vector3<f64>]) -> Vec<Option<Vector3<f64>>> {
    places.iter().copied().map(Some).collect()
}

const EXACT: Options = Options { reading: Reading::SwingTwist, aim: Aim::Marker, stretch: 0.0 };
const ALL: [Options; 4] =
    [EXACT, Options { reading: Reading::Xyz, ..EXACT }, Options { aim: Aim::Bone, ..EXACT }, Options { stretch: 1.0, ..EXACT }];

#[test]
fn markers_of_a_pose_give_the_pose_back() {
    let dice = &mut Dice(1);
    for _ in 0..50 {
        let rest = rest(dice);
        let truth = pose(&rest, dice);
        let marked: Vec<usize> = MARKED.into_iter().chain([NECK]).collect();
        for options in ALL {
            let found = rig_of(&rest, &marked).solve(&known(&places(&truth)), &truth, options);
            for (a, b) in truth.iter().zip(&found) {
                assert!(a.rotation.angle_to(&b.rotation) < 1e-7, "{options:?}: {}", a.rotation.angle_to(&b.rotation));
                assert!((a.matrix() - b.matrix()).amax() < 1e-9, "{options:?}");
            }
        }
    }
}

#[test]
fn markers_are_hit_whatever_was_captured_and_the_turn_about_bones_is_the_captured_one() {
    let dice = &mut Dice(2);
    for _ in 0..50 {
        let rest = rest(dice);
        let (mut truth, prior) = (pose(&rest, dice), pose(&rest, dice));
        // No marker tells what the spine and the joint without a length do: there both are alike. The bone of the hip and the knee goes straight down.
        (truth[SPINE], truth[11]) = (prior[SPINE], prior[11]);
        let rig = rig_of(&rest, &MARKED);
        for options in &ALL[..3] {
            let found = rig.solve(&known(&places(&truth)), &prior, *options);
            let (to, at) = (places(&truth), places(&found));
            for j in MARKED {
                assert!((to[j] - at[j]).norm() < 1e-9, "{options:?}, joint {j}: {}", (to[j] - at[j]).norm());
            }
            if options.reading == Reading::SwingTwist {
                for (j, bone) in [(CHEST, SHOULDER), (SHOULDER, ELBOW), (ELBOW, 5), (6, 9)] {
                    let axis = (rest[j].rotation * rest[bone].translation).normalize();
                    let yaw = |joint: &Joint| twist(&(joint.rotation * rest[j].rotation.inverse()), &axis);
                    assert!(yaw(&prior[j]).angle_to(&yaw(&found[j])) < 1e-7, "joint {j}");
                    assert!((yaw(&prior[j]).to_rotation_matrix().matrix() - yaw(&found[j]).to_rotation_matrix().matrix()).amax() < 1e-9);
                }
            }
        }
    }
}

#[test]
fn markers_of_other_lengths_are_on_the_line_of_their_bone() {
    let dice = &mut Dice(3);
    for _ in 0..50 {
        let rest = rest(dice);
        let (prior, markers) = (pose(&rest, dice), (0..PARENTS.len()).map(|_| dice.vector() * 2.0).collect::<Vec<_>>());
        let rig = rig_of(&rest, &MARKED);
        let bones = [(CHEST, SHOULDER), (SHOULDER, ELBOW), (ELBOW, 5), (6, 9), (9, 12)];
        for options in [EXACT, ALL[1], ALL[2]] {
            let at = places(&rig.solve(&known(&markers), &prior, options));
            assert!((at[HIPS] - markers[HIPS]).norm() < 1e-12, "the root is at its marker");
            for (a, b) in bones {
                let along = (at[b] - at[a]).normalize();
                let wanted = if options.aim == Aim::Bone { markers[b] - markers[a] } else { markers[b] - at[a] };
                assert!(along.cross(&wanted).norm() < 1e-9 && along.dot(&wanted) > 0.0, "{options:?}, {a} to {b}");
                assert!(((at[b] - at[a]).norm() - rest_length(&rest, &prior, a, b)).abs() < 1e-9, "of the rig's length");
            }
        }
    }
}

/// From a joint to the next marked one, those between as in the captured pose.
fn rest_length(rest: &[Joint], prior: &[Joint], a: usize, b: usize) -> f64 {
    if b == 12 {
        (prior[11].rotation * rest[12].translation).norm()
    } else {
        let _ = a;
        rest[b].translation.norm()
    }
}

#[test]
fn stretched_bones_end_at_their_markers_and_keep_their_volume() {
    let dice = &mut Dice(4);
    let rest = rest(dice);
    let (prior, markers) = (pose(&rest, dice), (0..PARENTS.len()).map(|_| dice.vector()).collect::<Vec<_>>());
    let rig = rig_of(&rest, &MARKED);
    let at = |stretch: f64| places(&rig.solve(&known(&markers), &prior, Options { stretch, ..EXACT }));
    MARKED.iter().for_each(|&j| assert!((at(1.0)[j] - markers[j]).norm() < 1e-9, "joint {j}"));
    // Half of the way, in ratios.
    let length = |p: &[Vector3<f64>]| (p[ELBOW] - p[SHOULDER]).norm();
    let (none, half, all) = (length(&at(0.0)), at(0.5), (markers[ELBOW] - at(0.5)[SHOULDER]).norm());
    assert!((length(&half) - (none * all).sqrt()).abs() < 1e-9);

    // A straight arm along x: what it gains in length it loses across, and nothing below it is scaled.
    let joint =
        |x: f64| Joint { translation: Vector3::new(x, 0.0, 0.0), rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) };
    let arm = [joint(0.0), joint(0.5), joint(1.0), joint(1.0), joint(0.2)];
    let rest: Vec<_> = arm.iter().map(Joint::matrix).collect();
    let rig = Rig::new(&[-1, 0, 1, 2, 3], &rest, &[true, true, true, true, false], &[], &[]).unwrap();
    let markers = [0.0, 0.5, 2.5, 3.0].map(|x| Some(Vector3::new(x, 0.0, 0.0)));
    let found = rig.solve(&markers, &arm, Options { stretch: 1.0, ..EXACT });
    let local: Vec<_> = found.iter().map(Joint::matrix).collect();
    let world = world_from_joint(&[-1, 0, 1, 2, 3], &local).unwrap();
    let sizes: Vec<_> = world.iter().map(lengths).collect();
    assert!((sizes[1] - Vector3::new(2.0, 0.5_f64.sqrt(), 0.5_f64.sqrt())).norm() < 1e-12, "{}", sizes[1]);
    assert!((sizes[2] - Vector3::new(0.5, 2.0_f64.sqrt(), 2.0_f64.sqrt())).norm() < 1e-12);
    assert!((sizes[3] - Vector3::repeat(1.0)).norm() < 1e-12 && (sizes[4] - Vector3::repeat(1.0)).norm() < 1e-12);
    assert!((world[4][(0, 3)] - 3.2).abs() < 1e-12);
}

#[test]
fn the_papers_angles_are_those_of_scipy() {
    // `Rotation.from_euler("XYZ", [0.4, -0.7, 1.1])` of SciPy 1.17.1, and where it takes z.
    let truth =
        UnitQuaternion::new_normalize(Quaternion::new(0.8204819930494642, -0.01655366754010615, -0.38404794421162547, 0.42313408243649525));
    let to = Vector3::new(-0.644217687237691, -0.2978435767000479, 0.7044663052755916);
    let other = |x: f64, y: f64| {
        let about = |axis: Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(&axis, angle);
        about(Vector3::x_axis(), x) * about(Vector3::y_axis(), y) * about(Vector3::z_axis(), 1.1)
    };
    let rest = UnitQuaternion::identity();
    for prior in [truth, other(0.0, 0.0), other(-2.0, 1.2)] {
        let found = turned(Reading::Xyz, &rest, &Vector3::z(), &prior, &to);
        assert!((found.to_rotation_matrix().matrix() - truth.to_rotation_matrix().matrix()).amax() < 1e-12);
    }
}

#[test]
fn bones_that_are_turned_over_or_at_the_pole_still_point_at_their_marker() {
    let dice = &mut Dice(5);
    for k in 0..40 {
        let (rest, prior, bone) = (dice.turn(), dice.turn(), dice.vector());
        let along = (rest * bone).normalize();
        let away = [-along, along, along.cross(&Vector3::x()), Vector3::x(), -Vector3::x()][k % 5];
        for reading in [Reading::SwingTwist, Reading::Xyz] {
            for wobble in [0.0, 1e-15, 1e-10, 1e-7] {
                let to = (away.normalize() + dice.vector() * wobble) * 3.0;
                let found = turned(reading, &rest, &bone, &prior, &to);
                assert!((found * bone.normalize() - to.normalize()).norm() < 1e-9, "{reading:?} {k} {wobble}");
            }
        }
    }
}

#[test]
fn what_no_marker_tells_is_as_captured() {
    let dice = &mut Dice(6);
    let rest = rest(dice);
    let (truth, prior) = (pose(&rest, dice), pose(&rest, dice));
    let rig = rig_of(&rest, &MARKED);
    let mut markers = known(&places(&truth));
    for gone in [ELBOW, HIPS] {
        markers[gone] = Some(Vector3::repeat(f64::NAN));
        let found = rig.solve(&markers, &prior, EXACT);
        let above = if gone == HIPS { HIPS } else { SHOULDER };
        assert_eq!((found[above].rotation, found[SPINE].rotation), (prior[above].rotation, prior[SPINE].rotation));
        assert!(found.iter().all(|j| j.matrix().iter().all(|v| v.is_finite())));
    }
    assert_eq!(rig.solve(&markers, &prior, EXACT)[HIPS].translation, prior[HIPS].translation, "the root stays as captured");
    // All markers at one point: no bone has a direction but those that do not begin there.
    let found = rig.solve(&[Some(Vector3::x()); 13], &prior, Options { aim: Aim::Bone, ..EXACT });
    MARKED.iter().filter(|j| **j != HIPS).for_each(|&j| assert_eq!(found[j].rotation, prior[j].rotation, "joint {j}"));
    let (joint, told, _) = rig.root(&[Some(Vector3::x()); 13], &prior);
    assert_eq!((joint.rotation, told), (prior[HIPS].rotation, procrustes::Told::Nothing));
}

#[test]
fn rigs_that_cannot_be_followed_say_why() {
    let rest = rest(&mut Dice(7));
    let matrices: Vec<_> = rest.iter().map(Joint::matrix).collect();
    let made = |marked: &[usize]| {
        let marked: Vec<bool> = (0..PARENTS.len()).map(|j| marked.contains(&j)).collect();
        Rig::new(&PARENTS, &matrices, &marked, &[], &[]).map(|_| ()).unwrap_err().to_string()
    };
    assert_eq!(made(&[]), "expected a marker on at least one joint, found none");
    assert_eq!(made(&[ELBOW, 6]), "expected one topmost marked joint, found joints 6 and 0");
    let flat = vec![Matrix4::zeros(); 13];
    let message = Rig::new(&PARENTS, &flat, &[true; 13], &[], &[]).unwrap_err().to_string();
    assert_eq!(message, "joint 0: expected a rest pose of translation, rotation and scale, found a shear or no size");
}
