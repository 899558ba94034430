//! Time of the stages that lift drawings: time warps of 5,000 by 5,000 frames of eight angles, descriptors, the least squares of 200 frames of 24 markers,
//! and all of it from drawings to joint angles against a clip of 2,000 frames, one thread.
//!
//! Peers, on one thread in the same minutes: the warp fused in Numba, dtaidistance and dtw-python on the same series; the least squares as stacked 143 by 72
//! systems with Numba and LAPACK.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use pegbar_nodes::algo::align_2d::{Lengths, align_2d};
use pegbar_nodes::algo::camera::{Camera, Orbit, orthographic};
use pegbar_nodes::algo::dtw::{self, Drawings, Metric, Series, Steps, dtw, source_frames};
use pegbar_nodes::algo::joint_angles::{self, Aim, Reading, Rig};
use pegbar_nodes::algo::lift::{BasisMode, Frame, Lift, Options, Tree};
use pegbar_nodes::algo::pose_descriptor::{Reference, angles};
use pegbar_nodes::algo::rotation::exp;
use pegbar_nodes::algo::skeleton::{Joint, world_from_joint};
use std::hint::black_box;

const N: usize = 24;
/// Two legs, a spine with two arms, and their ends.
const PARENTS: [i64; N] = [-1, 0, 1, 2, 3, 3, 5, 6, 7, 3, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19, 4, 8, 12];
/// Upper and lower arms and legs.
const LIMBS: [[usize; 2]; 8] = [[6, 7], [7, 8], [10, 11], [11, 12], [13, 14], [14, 15], [17, 18], [18, 19]];
const CHAINS: [[usize; 7]; 2] = [[0, 1, 2, 3, 5, 6, 7], [0, 1, 2, 3, 9, 10, 11]];

struct Rng(u64);

impl Rng {
    /// In 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next() - 0.5)
    }
}

/// A figure that swings all its joints.
struct Figure {
    rest: Vec<Joint>,
    swings: Vec<(Vector3<f64>, f64)>,
}

impl Figure {
    fn new() -> Self {
        let mut rng = Rng(5);
        let still = Joint { translation: Vector3::zeros(), rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) };
        let rest = (0..N).map(|_| Joint { translation: rng.vector().normalize() * 0.3, ..still }).collect();
        Self { rest, swings: (0..N).map(|_| (rng.vector(), 6.0 * rng.next())).collect() }
    }

    fn pose(&self, t: f64) -> Vec<Joint> {
        let turn = |(joint, (axis, phase)): (&Joint, &(Vector3<f64>, f64))| {
            let swing = 0.5 * (0.05 * t + phase).sin() + 0.3 * (0.017 * t + 2.0 * phase).cos();
            Joint { rotation: exp(&(axis * swing)), ..*joint }
        };
        self.rest.iter().zip(&self.swings).map(turn).collect()
    }
}

fn places(joints: &[Joint]) -> Vec<Vector3<f64>> {
    let local: Vec<Matrix4<f64>> = joints.iter().map(Joint::matrix).collect();
    let world = world_from_joint(&PARENTS, &local).unwrap_or_default();
    world.iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
}

fn seen(camera: &Camera, markers: &[Vector3<f64>]) -> Vec<[f64; 2]> {
    let pixel = |p: &Vector3<f64>| {
        let [x, y, _] = camera.project((*p).into());
        [x, y]
    };
    markers.iter().map(pixel).collect()
}

fn camera() -> Option<Camera> {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.6, elevation: 0.1, roll: 0.0, distance: 10.0 };
    Camera::new(orbit.view(), orthographic(240.0, [1280, 720], 0.1, 100.0), [1280, 720]).ok()
}

fn series(rows: &[Vec<f64>]) -> Option<Series> {
    Series::new(&rows.iter().map(Vec::as_slice).collect::<Vec<_>>(), None).ok()
}

fn descriptors(frames: &[Vec<[f64; 2]>]) -> Vec<Vec<f64>> {
    frames.iter().map(|f| angles(f, &LIMBS, Reference::Absolute, 0.0)).collect()
}

fn warps(c: &mut Criterion) {
    // Steps of chance, as of limbs over time.
    let walk = |seed: u64| {
        let mut rng = Rng(seed);
        let mut at = [0.0; 8];
        let step = |v: f64, rng: &mut Rng| (v + 0.2 * (rng.next() - 0.5) + 3.0).rem_euclid(6.0) - 3.0;
        let row = |_| {
            at = at.map(|v| step(v, &mut rng));
            at.to_vec()
        };
        series(&(0..5000).map(row).collect::<Vec<_>>())
    };
    let (Some(target), Some(source)) = (walk(1), walk(2)) else { return };
    for (name, steps) in [("symmetric1", Steps::Symmetric1), ("asymmetric", Steps::Asymmetric), ("asymmetric_p05", Steps::AsymmetricP05)] {
        let options = dtw::Options { steps, ..dtw::Options::default() };
        c.bench_function(&format!("time warp, 5000 x 5000 frames of 8 angles, {name}"), |b| {
            b.iter(|| dtw(black_box(&target), &source, Metric::Angle, &options))
        });
    }
}

/// A clip of 2,000 frames, and 200 drawings of a part of it in another style.
struct Scene {
    camera: Camera,
    clip: Vec<Vec<Joint>>,
    markers: Vec<Vec<Vector3<f64>>>,
    drawn: Vec<Vec<[f64; 2]>>,
    tree: Tree,
    rig: Rig,
}

impl Scene {
    fn new() -> Option<Self> {
        let (figure, camera) = (Figure::new(), camera()?);
        let clip: Vec<Vec<Joint>> = (0..2000).map(|t| figure.pose(f64::from(t))).collect();
        let markers = clip.iter().map(|j| places(j)).collect();
        let styled = |t: i32| {
            let mut joints = figure.pose(600.0 + 2.5 * f64::from(t));
            joints[6..8].iter_mut().for_each(|j| j.rotation *= exp(&Vector3::new(0.0, 0.0, 0.1)));
            seen(&camera, &places(&joints))
        };
        let drawn = (0..200).map(styled).collect();
        let limbs: Vec<[usize; 2]> = (1..N).map(|j| [PARENTS[j] as usize, j]).collect();
        let rest: Vec<Matrix4<f64>> = figure.rest.iter().map(Joint::matrix).collect();
        let rig = Rig::new(&PARENTS, &rest, &[true; N], &[], &[]).ok()?;
        Some(Self { tree: Tree::new(N, &limbs)?, rig, camera, clip, markers, drawn })
    }

    fn frames(&self, map: &[f64]) -> Vec<Frame> {
        let chains = CHAINS.map(|c| c.to_vec());
        let frame = |(drawn, at): (&Vec<[f64; 2]>, &f64)| {
            let prior = self.markers[at.round() as usize].clone();
            let markers = align_2d(&seen(&self.camera, &prior), drawn, &chains, Lengths::Source);
            Frame { markers, prior, lengths: None, camera: self.camera.clone(), subspace: None }
        };
        self.drawn.iter().zip(map).map(frame).collect()
    }

    fn lift(&self) -> Option<Vec<Vec<Joint>>> {
        let projected: Vec<Vec<[f64; 2]>> = self.markers.iter().map(|m| seen(&self.camera, m)).collect();
        let (target, source) = (series(&descriptors(&self.drawn))?, series(&descriptors(&projected))?);
        let options = dtw::Options { steps: Steps::Symmetric1, open_begin: true, open_end: true, ..dtw::Options::default() };
        let path = dtw(&target, &source, Metric::Angle, &options).ok()?.path;
        let map = source_frames(&path, &Drawings::new(self.drawn.len(), |_| false), &[], 0.6);
        let lift = Lift { tree: &self.tree, options: Options::PAPER, basis_mode: BasisMode::Off };
        let lifted = lift.run(&self.frames(&map)).ok()?;
        let options = joint_angles::Options { reading: Reading::SwingTwist, aim: Aim::Marker, stretch: 0.0 };
        let pose = |(lifted, at): (&pegbar_nodes::algo::lift::Lifted, &f64)| {
            let markers: Vec<Option<Vector3<f64>>> = lifted.markers.iter().copied().map(Some).collect();
            self.rig.solve(&markers, &self.clip[at.round() as usize], options)
        };
        Some(lifted.iter().zip(&map).map(pose).collect())
    }
}

fn lifts(c: &mut Criterion) {
    let Some(scene) = Scene::new() else { return };
    c.bench_function("descriptors, 2000 frames of 8 limbs, projection included", |b| {
        b.iter(|| descriptors(&black_box(&scene.markers).iter().map(|m| seen(&scene.camera, m)).collect::<Vec<_>>()));
    });
    let map: Vec<f64> = (0..200).map(|t| 600.0 + 2.5 * f64::from(t)).collect();
    let frames = scene.frames(&map);
    for (name, options) in [
        ("the paper's", Options::PAPER),
        ("lengths exact", Options { length_weight: f64::INFINITY, relinearize: 8, ..Options::PAPER }),
        ("together in time", Options { smooth_weight: 1.0, ..Options::PAPER }),
    ] {
        let lift = Lift { tree: &scene.tree, options, basis_mode: BasisMode::Off };
        c.bench_function(&format!("least squares, 200 frames of 24 markers, {name}"), |b| b.iter(|| lift.run(black_box(&frames))));
    }
    c.bench_function("whole lift, 200 drawings against 2000 frames, to joint angles", |b| b.iter(|| black_box(&scene).lift()));
}

criterion_group!(benches, warps, lifts);
criterion_main!(benches);
