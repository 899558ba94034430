//! Models and figures under captured weights and motions.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Cancel, Context, In, List, NodeError, PerFrame};

use super::*;
use crate::algo::rotation::{Mean, slerp};
use crate::algo::skeleton::Joint;
use crate::counted::clock;
use crate::data::{Mesh, MorphTargets, Pose, Skeleton, Weights};

fn run<N: PerFrame>(node: N) -> Result<N::Outputs, NodeError> {
    let clock = clock(1);
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

fn tent(height: f64) -> Mesh {
    Mesh {
        positions: vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, height, 0.5]],
        triangles: Arc::new(vec![[0, 1, 2]]),
        normals: vec![[0.0, 0.0, 1.0]; 3],
        ..Mesh::default()
    }
}

fn meshes(keys: Vec<Mesh>, weights: &[f64]) -> RetargetMeshes {
    RetargetMeshes {
        meshes: List(keys.into_iter().map(In::new).collect()),
        morphs: None,
        weights: In::new(Weights { weights: weights.to_vec() }),
        motion: None,
        plane: Plane::Xy,
        scale: 0.01,
        origin: [0.0, 0.0],
        flip: true,
        depth_scale: DepthScale::One,
    }
}

#[test]
fn vertices_are_the_weighted_sum_of_the_keys() {
    let blend = |weights: &[f64]| run(meshes(vec![tent(1.0), tent(2.0), tent(4.0)], weights)).unwrap().mesh;
    assert_eq!(blend(&[0.0, 1.0, 0.0]), tent(2.0));
    assert_eq!(blend(&[0.5, 0.25, 0.25]).positions[2], [0.0, 2.0, 0.5]);
    assert_eq!(blend(&[-0.5, 0.0, 1.5]).positions[2], [0.0, 5.5, 0.5]);
}

#[test]
fn morph_targets_are_keys_with_or_without_the_mesh_itself() {
    let rows = vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0];
    let morphs = MorphTargets { positions: NdArray::new([2, 3, 3], rows).unwrap(), ..MorphTargets::default() };
    let blend = |weights: &[f64]| {
        let node = RetargetMeshes { morphs: Some(In::new(morphs.clone())), ..meshes(vec![tent(1.0)], weights) };
        run(node).map(|o| o.mesh.positions[2][1]).map_err(|e| e.message)
    };
    // As keys of heights 2 and 4, and of heights 1, 2 and 4.
    assert_eq!(blend(&[0.5, 0.5]), Ok(3.0));
    assert_eq!(blend(&[0.5, 0.25, 0.25]), Ok(2.0));
    assert_eq!(blend(&[1.0]), Err("weights: expected 2, one for each key, found 1".to_owned()));
}

#[test]
fn the_motion_of_the_picture_moves_its_plane() {
    // Twice as wide, half as high, and 30 px to the right and 20 down about the pixel (100, 200) of the origin.
    let motion = Affine2 { matrix: [[2.0, 0.0, -70.0], [0.0, 0.5, 120.0]] };
    let node = |depth_scale| RetargetMeshes {
        motion: Some(In::new(motion.clone())),
        origin: [100.0, 200.0],
        depth_scale,
        ..meshes(vec![tent(2.0)], &[1.0])
    };
    let mesh = run(node(DepthScale::One)).unwrap().mesh;
    let near = |a: [f64; 3], b: [f64; 3]| assert!((Vector3::from(a) - Vector3::from(b)).norm() < 1e-12, "{a:?} {b:?}");
    near(mesh.positions[2], [0.3, 0.8, 0.5]);
    near(mesh.positions[1], [2.3, -0.2, 0.0]);
    let narrow = Affine2 { matrix: [[1.0, 0.0, 0.0], [0.0, 0.25, 0.0]] };
    let deep = RetargetMeshes { motion: Some(In::new(narrow)), ..node(DepthScale::SqrtDet) };
    near(run(deep).unwrap().mesh.positions[2], [0.0, 0.5 + 1.5, 0.25]);
}

#[test]
fn keys_that_do_not_go_together_are_refused() {
    let refused = |node| run::<RetargetMeshes>(node).map(|_| ()).unwrap_err().message;
    let other = Mesh { triangles: Arc::new(vec![[0, 2, 1]]), ..tent(1.0) };
    assert_eq!(refused(meshes(vec![], &[])), "meshes: expected one for each key, found none");
    assert_eq!(refused(meshes(vec![tent(1.0)], &[0.5, 0.5])), "weights: expected 1, one for each key, found 2");
    assert_eq!(refused(meshes(vec![tent(1.0)], &[f64::NAN])), "weights: expected finite numbers, found NaN at 0");
    let message = refused(meshes(vec![tent(1.0), other], &[0.5, 0.5]));
    assert_eq!(message, "key 1: expected the 3 vertices and the triangles of the first, found others");
    assert!(refused(meshes(vec![tent(f64::NAN)], &[1.0])).starts_with("vertex 2: expected finite positions"));
    let motion = Some(In::new(Affine2 { matrix: [[f64::NAN; 3]; 2] }));
    assert_eq!(
        refused(RetargetMeshes { motion, ..meshes(vec![tent(1.0)], &[1.0]) }),
        "motion: expected a finite affine map, found NaN or infinity"
    );
}

fn turned(angles: [f64; 2], scale: f64) -> Pose {
    let axes = [Vector3::z_axis(), Vector3::x_axis()];
    let joint = |(k, angle): (usize, f64)| Joint {
        translation: Vector3::new(0.0, 1.0 + angle, 0.0),
        rotation: UnitQuaternion::from_axis_angle(&axes[k], angle),
        scale: Vector3::repeat(scale),
    };
    angles.into_iter().enumerate().map(joint).collect()
}

fn figure(keys: Vec<Pose>, weights: &[f64]) -> RetargetJointAngles {
    RetargetJointAngles {
        poses: List(keys.into_iter().map(In::new).collect()),
        weights: In::new(Weights { weights: weights.to_vec() }),
        motion: None,
        skeleton: None,
        mean: Mean::Karcher,
        squash: false,
        plane: Plane::Xy,
        scale: 0.01,
        origin: [0.0, 0.0],
        flip: true,
        depth_scale: DepthScale::One,
    }
}

#[test]
fn all_joints_share_the_weights_in_joint_angle_space() {
    let keys = || vec![turned([0.0, 0.2], 1.0), turned([1.0, -0.4], 4.0), turned([0.4, 2.0], 1.0)];
    for (weights, angles) in [([0.2, 0.5, 0.3], [0.62, 0.44]), ([-0.5, 1.5, 0.0], [1.5, -0.7]), ([0.0, 0.0, 1.0], [0.4, 2.0])] {
        let pose = run(figure(keys(), &weights)).unwrap().pose.joints().unwrap();
        let truth = turned(angles, 1.0).joints().unwrap();
        for (a, b) in pose.iter().zip(&truth) {
            assert!(a.rotation.angle_to(&b.rotation) < 1e-12 && (a.translation - b.translation).norm() < 1e-12, "{a:?} {b:?}");
        }
    }
    // Scales are blended by their logarithms, so that none is turned inside out.
    let scale = |weights: &[f64]| run(figure(keys(), weights)).unwrap().pose.scales[0][0];
    assert!((scale(&[0.5, 0.5, 0.0]) - 2.0).abs() < 1e-12 && (scale(&[1.5, -0.5, 0.0]) - 0.5).abs() < 1e-12);
}

#[test]
fn two_keys_go_the_shortest_way() {
    let keys = [turned([0.3, 0.2], 1.0), turned([-0.9, 1.9], 1.0)];
    let [a, b] = keys.clone().map(|k| k.joints().unwrap());
    for t in [-0.5, 0.3, 1.5] {
        let pose = run(figure(keys.to_vec(), &[1.0 - t, t])).unwrap().pose.joints().unwrap();
        assert!((0..2).all(|j| pose[j].rotation.angle_to(&slerp(&a[j].rotation, &b[j].rotation, t)) < 1e-12));
    }
}

#[test]
fn the_root_takes_the_motion_turn_place_and_squash() {
    let (angle, wide, high) = (0.4f64, 1.5, 0.5);
    // Squashed along its own axes, then turned: clockwise in the picture, whose y points down, is clockwise in the world.
    let (c, s) = (angle.cos(), angle.sin());
    let motion = Affine2 { matrix: [[c * wide, -s * high, 10.0], [s * wide, c * high, 20.0]] };
    let node =
        |squash| RetargetJointAngles { motion: Some(In::new(motion.clone())), squash, ..figure(vec![turned([0.0, 0.3], 1.0)], &[1.0]) };
    let pose = run(node(true)).unwrap().pose;
    let root = pose.joint(0).unwrap();
    assert!((root.rotation.angle_to(&UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -angle))) < 1e-12);
    assert!((root.scale - Vector3::new(wide, high, 1.0)).norm() < 1e-12, "{}", root.scale);
    // The root stands at (0, 1): 100 px above the origin.
    let there = [(s * high * 100.0 + 10.0) / 100.0, (c * high * 100.0 - 20.0) / 100.0];
    assert!((root.translation - Vector3::new(there[0], there[1], 0.0)).norm() < 1e-12, "{}", root.translation);
    assert_eq!(pose.joint(1).unwrap(), turned([0.0, 0.3], 1.0).joint(1).unwrap(), "the other joints stay");
    assert!((run(node(false)).unwrap().pose.joint(0).unwrap().scale - Vector3::repeat(1.0)).norm() < 1e-15);
    // A skeleton says which joints are roots.
    let skeleton = Skeleton::new(vec![1, -1], &[Matrix4::identity(); 2], Vec::new()).unwrap();
    let other = run(RetargetJointAngles { skeleton: Some(In::new(skeleton)), ..node(false) }).unwrap().pose;
    assert_eq!(other.joint(0).unwrap(), turned([0.0, 0.3], 1.0).joint(0).unwrap());
}

#[test]
fn poses_that_do_not_go_together_are_refused() {
    let refused = |node| run::<RetargetJointAngles>(node).map(|_| ()).unwrap_err().message;
    assert_eq!(refused(figure(vec![], &[])), "poses: expected one for each key, found none");
    let short: Pose = turned([0.0, 0.0], 1.0).joints().unwrap().into_iter().take(1).collect();
    assert_eq!(
        refused(figure(vec![turned([0.0, 0.0], 1.0), short], &[0.5, 0.5])),
        "key 1: expected 2 joints as the first key has, found 1"
    );
    let message = refused(figure(vec![turned([0.0, 0.0], 1.0); 2], &[1.0, -1.0]));
    assert_eq!(message, "joint 0: expected keys whose rotations have a mean by [1.0, -1.0], found none");
    let mut broken = turned([0.0, 0.0], 1.0);
    broken.rotations[1] = [0.0; 4];
    assert!(refused(figure(vec![broken], &[1.0])).starts_with("key 0: joint 1: expected a rotation"));
}
