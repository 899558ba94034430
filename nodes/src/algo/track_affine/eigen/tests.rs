//! A drawn character whose arms and ear move over a painted ground, with known motion and pose.

use std::sync::OnceLock;

use nalgebra::{Matrix2, Vector2};

use super::super::scene::Random;
use super::super::{Region, Start, Template};
use super::*;
use crate::algo::pca::{Keep, Space as Spanned, pca};
use crate::algo::pose_map::PoseMap;
use crate::algo::raster::{apply, compose, invert};

/// Where the character's belly is in its pictures.
const CENTRE: [f64; 2] = [100.0, 110.0];
/// Columns and rows of the pictures.
const PICTURE: (usize, usize) = (200, 200);
const INK: [f64; 3] = [0.06, 0.05, 0.08];
const FUR: [f64; 3] = [0.55, 0.34, 0.18];
const BELLY: [f64; 3] = [0.82, 0.66, 0.42];

/// Angles of the arms and the ear, radians.
type Pose = [f64; 2];

fn arm(side: f64, pose: &Pose) -> ([f64; 2], [f64; 2]) {
    let angle = if side < 0.0 { pose[0] } else { pose[1] };
    let shoulder = [side * 26.0, -18.0];
    let (s, c) = libm::sincos(angle);
    (shoulder, [shoulder[0] + side * 42.0 * c, shoulder[1] - 42.0 * s])
}

fn ellipse(p: [f64; 2], c: [f64; 2], r: [f64; 2]) -> f64 {
    let (u, v) = ((p[0] - c[0]) / r[0], (p[1] - c[1]) / r[1]);
    let k = libm::hypot(u, v);
    (k - 1.0) * k / libm::hypot(u / r[0], v / r[1]).max(1e-9)
}

fn capsule(p: [f64; 2], (a, b): ([f64; 2], [f64; 2]), r: f64) -> f64 {
    let (d, q) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let t = ((d[0] * q[0] + d[1] * q[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
    libm::hypot(q[0] - t * d[0], q[1] - t * d[1]) - r
}

/// The parts, the upper first: signed distance and colour.
fn parts(p: [f64; 2], pose: &Pose) -> [(f64, [f64; 3]); 8] {
    [
        (ellipse(p, [0.0, -18.0], [9.0, 6.0]).min(ellipse(p, [0.0, -52.0], [4.0, 3.0])), INK),
        (capsule(p, arm(-1.0, pose), 8.5), FUR),
        (capsule(p, arm(1.0, pose), 8.5), FUR),
        (ellipse(p, [0.0, 14.0], [17.0, 22.0]), BELLY),
        (ellipse(p, [0.0, -50.0], [23.0, 20.0]), FUR),
        (ellipse(p, [-17.0, -68.0], [8.0, 8.0]).min(ellipse(p, [17.0, -68.0], [8.0, 8.0])), FUR),
        (ellipse(p, [0.0, 6.0], [32.0, 40.0]), FUR),
        (capsule(p, ([-16.0, 40.0], [-20.0, 62.0]), 10.0).min(capsule(p, ([16.0, 40.0], [20.0, 62.0]), 10.0)), FUR),
    ]
}

/// Distance to the nearest outline.
fn nearest(p: [f64; 2], pose: &Pose) -> f64 {
    parts(p, pose).iter().map(|(d, _)| d.abs()).fold(f64::INFINITY, f64::min)
}

/// Display colour at a point about the belly, where the character is.
fn bear(p: [f64; 2], pose: &Pose) -> Option<[f64; 3]> {
    let line = 1.4;
    parts(p, pose).iter().find(|(d, _)| *d < line).map(|(d, c)| if *d > -line { INK } else { *c })
}

fn ground(x: f64, y: f64) -> [f64; 3] {
    let wave = |k: f64, l: f64, p: f64| libm::cos(k * x + l * y + p);
    let s = 0.5 + 0.12 * wave(0.11, 0.05, 0.3) + 0.1 * wave(-0.04, 0.16, 1.3) + 0.07 * wave(0.31, 0.22, 2.0);
    [s * 0.75, s * 0.9, s * 0.6 + 0.05 * wave(0.2, -0.1, 0.4)]
}

/// Coverage and covered display colour of a pixel, 4x4 places.
fn pixel(x: usize, y: usize, back: &Affine, pose: &Pose) -> (f64, [f64; 3]) {
    let (mut cover, mut sum) = (0.0, [0.0; 3]);
    // Far from every line, one place stands for all.
    let middle = apply(back, Vector2::new(x as f64 + 0.5, y as f64 + 0.5)) - Vector2::from(CENTRE);
    if middle.x.abs() > 90.0 || middle.y.abs() > 90.0 || nearest([middle.x, middle.y], pose) > 4.0 {
        return bear([middle.x, middle.y], pose).map_or((0.0, [0.0; 3]), |c| (1.0, c));
    }
    for k in 0..16 {
        let at = Vector2::new(x as f64 + ((k % 4) as f64 + 0.5) / 4.0, y as f64 + ((k / 4) as f64 + 0.5) / 4.0);
        let p = apply(back, at) - Vector2::from(CENTRE);
        if let Some(c) = bear([p.x, p.y], pose) {
            cover += 1.0 / 16.0;
            (0..3).for_each(|n| sum[n] += c[n] / 16.0);
        }
    }
    (cover, sum)
}

/// A frame in linear light and its matte.
fn frame(size: (usize, usize), motion: &Affine, pose: &Pose, grain: f64, seed: u64) -> (Vec<f32>, Vec<f32>) {
    let back = invert(motion).unwrap();
    let mut rng = Random(seed);
    let (mut rgb, mut matte) = (Vec::new(), Vec::new());
    for i in 0..size.0 * size.1 {
        let (cover, sum) = pixel(i % size.0, i / size.0, &back, pose);
        let behind = ground((i % size.0) as f64, (i / size.0) as f64);
        for c in 0..3 {
            let own = if cover > 0.0 { sum[c] * sum[c] / cover } else { 0.0 };
            let display = libm::sqrt(behind[c] * behind[c] * (1.0 - cover) + own) + grain * rng.normal();
            rgb.push((display.max(0.0) * display.max(0.0)) as f32);
        }
        matte.push(cover as f32);
    }
    (rgb, matte)
}

/// The character alone, premultiplied and toned.
fn picture(pose: &Pose) -> Vec<f64> {
    let tone = |display: f64| f64::from(super::super::planes::toned((display * display) as f32, Tone::Encoded));
    let all = (0..PICTURE.0 * PICTURE.1).flat_map(|i| {
        let (cover, sum) = pixel(i % PICTURE.0, i / PICTURE.0, &identity(), pose);
        let of = |c: usize| if cover > 0.0 { cover * libm::pow(sum[c] / cover, 2.0) } else { 0.0 };
        [tone(libm::sqrt(of(0))), tone(libm::sqrt(of(1))), tone(libm::sqrt(of(2))), cover]
    });
    all.collect()
}

/// Points that go with the pose: along the arms and around the body.
fn shape(pose: &Pose) -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for side in [-1.0, 1.0] {
        let (a, b) = arm(side, pose);
        for k in 0..=4 {
            let t = f64::from(k) / 4.0;
            out.push([0, 1].map(|n| CENTRE[n] + a[n] + t * (b[n] - a[n])));
        }
    }
    for k in 0..16 {
        let (s, c) = libm::sincos(f64::from(k) * std::f64::consts::FRAC_PI_8);
        out.push([CENTRE[0] + 32.0 * c, CENTRE[1] + 6.0 + 40.0 * s]);
    }
    out
}

/// Pictures of the character in many poses, and what they span.
struct Cast {
    space: Spanned,
    flat: Vec<f64>,
    map: PoseMap,
}

fn cast(components: usize) -> Cast {
    let poses: Vec<Pose> = (0..7).flat_map(|i| (0..6).map(move |j| [-0.7 + 0.25 * f64::from(i), -0.6 + 0.25 * f64::from(j)])).collect();
    let pictures: Vec<Vec<f64>> = poses.iter().map(picture).collect();
    let views: Vec<&[f64]> = pictures.iter().map(Vec::as_slice).collect();
    let space = pca(&views, PICTURE.0 * PICTURE.1, Keep::Components(components)).unwrap();
    let shapes: Vec<Vec<f64>> = poses.iter().map(|p| shape(p).concat()).collect();
    let map = PoseMap::new(&space.coordinates, &shapes.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
    Cast { flat: space.components.concat(), space, map }
}

impl Cast {
    fn pictures(&self) -> Pictures<'_> {
        Pictures {
            mean: &self.space.mean,
            components: &self.flat,
            variances: &self.space.variances,
            examples: &self.space.coordinates,
            window: Window::at_origin(PICTURE.0, PICTURE.1),
            channels: 4,
            alpha: Some(3),
            tone: Tone::Encoded,
        }
    }

    fn shape(&self, coefficients: &[f64]) -> Vec<[f64; 2]> {
        self.map.at(coefficients).as_chunks().0.to_vec()
    }
}

/// The dance: motion and pose of a frame.
fn dance(k: usize) -> (Affine, Pose) {
    let t = k as f64;
    let turn = 0.16 * libm::sin(0.55 * t);
    let stretch = 1.0 + 0.12 * libm::sin(0.9 * t);
    let (s, c) = libm::sincos(turn);
    let linear = Matrix2::new(c, -s, s, c) * Matrix2::new(1.0 / stretch, 0.05 * libm::sin(0.4 * t), 0.0, stretch);
    let to = Vector2::new(155.0 + 32.0 * libm::sin(0.35 * t), 125.0 - 16.0 * libm::fabs(libm::sin(0.5 * t)));
    let t0 = to - linear * Vector2::from(CENTRE);
    let pose = [0.05 + 0.68 * libm::sin(0.45 * t), 0.02 + 0.6 * libm::sin(0.6 * t + 1.0)];
    (Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t0]), pose)
}

const SIZE: (usize, usize) = (320, 240);

fn rms(found: &Affine, points: &[[f64; 2]], truth: &Affine, pose: &Pose) -> f64 {
    let square: f64 =
        points.iter().zip(shape(pose)).map(|(f, t)| (apply(found, (*f).into()) - apply(truth, t.into())).norm_squared()).sum();
    libm::sqrt(square / points.len() as f64)
}

/// The space of ten components, made once.
fn ten() -> &'static Cast {
    static CAST: OnceLock<Cast> = OnceLock::new();
    CAST.get_or_init(|| cast(10))
}

fn raster(rgb: &[f32]) -> Raster<'_> {
    Raster::new(rgb, SIZE.0, SIZE.1, 3).unwrap()
}

fn template() -> EigenTemplate {
    EigenTemplate::new(&ten().pictures(), &Options { cut: 2.0, ..Options::default() }, &EigenOptions::default()).unwrap()
}

/// Root mean square over frames.
fn together(v: &[f64]) -> f64 {
    libm::sqrt(v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64)
}

#[test]
fn a_dance_is_followed_in_place_and_pose() {
    let (cast, template, options) = (ten(), template(), Options::default());
    let (first, first_matte) = frame(SIZE, &dance(0).0, &dance(0).1, 0.008, 5);
    let affine = Template::new(raster(&first), Region::Matte(&first_matte), &options).unwrap();
    let (mut start, mut affine_start) = (EigenStart::default(), Start::default());
    let (mut own, mut other, mut converged) = (Vec::new(), Vec::new(), 0);
    let n = 20;
    for k in 0..n {
        let (motion, pose) = dance(k);
        let (rgb, matte) = frame(SIZE, &motion, &pose, 0.008, 100 + k as u64);
        let track = template.track(raster(&rgb), Some(&matte), &start).unwrap();
        own.push(rms(&track.motion, &cast.shape(&track.coefficients), &motion, &pose));
        converged += usize::from(track.is_converged() && track.iterations <= 40);
        let by_affine = affine.track(raster(&rgb), Some(&matte), &affine_start).unwrap();
        other.push(rms(&compose(&by_affine.motion, &dance(0).0), &shape(&dance(0).1), &motion, &pose));
        start = EigenStart { before: (k > 0).then_some(start.last), last: track.motion, coefficients: track.coefficients };
        affine_start = Start { before: (k > 0).then_some(affine_start.last), last: by_affine.motion };
    }
    assert!(together(&own) < 0.5 && together(&other) > 3.0 * together(&own), "{} {}: {own:?}", together(&own), together(&other));
    assert!(converged * 20 >= n * 19, "{converged} of {n} converged");
}

#[test]
fn a_pose_is_found_from_any_other_and_without_a_start() {
    let (cast, template) = (ten(), template());
    for (k, from) in [(3, 8), (8, 3), (12, 1), (5, 5)] {
        let (motion, pose) = dance(k);
        let (rgb, matte) = frame(SIZE, &motion, &pose, 0.008, k as u64);
        let before = frame(SIZE, &dance(from).0, &dance(from).1, 0.008, 50);
        let start = template.track(raster(&before.0), Some(&before.1), &EigenStart::default()).unwrap();
        let start = EigenStart { before: None, last: start.motion, coefficients: start.coefficients };
        for start in [start, EigenStart::default()] {
            let track = template.track(raster(&rgb), Some(&matte), &start).unwrap();
            let off = rms(&track.motion, &cast.shape(&track.coefficients), &motion, &pose);
            assert!(off < 1.0, "{from} to {k}: {off} px, {track:?}");
        }
    }
}

#[test]
fn without_a_matte_the_colours_do() {
    let (cast, template) = (ten(), template());
    let mut start = EigenStart { last: dance(0).0, ..EigenStart::default() };
    let mut own = Vec::new();
    for k in 0..6 {
        let (motion, pose) = dance(k);
        let (rgb, _) = frame(SIZE, &motion, &pose, 0.008, k as u64);
        let track = template.track(raster(&rgb), None, &start).unwrap();
        own.push(rms(&track.motion, &cast.shape(&track.coefficients), &motion, &pose));
        start = EigenStart { before: (k > 0).then_some(start.last), last: track.motion, coefficients: track.coefficients };
    }
    assert!(together(&own) < 1.5, "{own:?}");
}

#[test]
fn half_size_will_do() {
    let cast = ten();
    let errors = [0, 1].map(|finest| {
        let how = EigenOptions { finest, ..EigenOptions::default() };
        let template = EigenTemplate::new(&cast.pictures(), &Options { cut: 2.0, ..Options::default() }, &how).unwrap();
        let mut start = EigenStart::default();
        let error = |k: usize| {
            let (motion, pose) = dance(k);
            let (rgb, matte) = frame(SIZE, &motion, &pose, 0.008, 100 + k as u64);
            let track = template.track(raster(&rgb), Some(&matte), &start).unwrap();
            let off = rms(&track.motion, &cast.shape(&track.coefficients), &motion, &pose);
            start = EigenStart { before: (k > 0).then_some(start.last), last: track.motion, coefficients: track.coefficients };
            off
        };
        together(&(0..8).map(error).collect::<Vec<_>>())
    });
    assert!(errors.iter().all(|e| *e < 0.6), "{errors:?}");
}

#[test]
fn a_space_without_components_is_one_picture() {
    let picture = picture(&dance(2).1);
    let pictures = Pictures { mean: &picture, components: &[], variances: &[], examples: &[], ..ten().pictures() };
    let template = EigenTemplate::new(&pictures, &Options::default(), &EigenOptions::default()).unwrap();
    let (motion, pose) = dance(2);
    let (rgb, matte) = frame(SIZE, &motion, &pose, 0.008, 3);
    let track = template.track(raster(&rgb), Some(&matte), &EigenStart::default()).unwrap();
    let off = rms(&track.motion, &shape(&pose), &motion, &pose);
    assert!(track.is_converged() && track.coefficients.is_empty() && off < 0.25, "{off} px {track:?}");
}

#[test]
fn degenerate_frames_have_a_status() {
    let template = template();
    let go = |rgb: &[f32], matte: Option<&[f32]>, start: &EigenStart| template.track(raster(rgb), matte, start).unwrap();
    let pixels = SIZE.0 * SIZE.1;
    let start = EigenStart::default();
    assert_eq!(go(&vec![f32::NAN; pixels * 3], None, &start).status, Status::NotFinite);
    assert!(!go(&vec![0.4; pixels * 3], None, &start).is_converged());
    assert!(!go(&vec![0.4; pixels * 3], Some(&vec![0.0; pixels]), &start).is_converged());
    let gone = EigenStart { last: Affine::new(1.0, 0.0, 4000.0, 0.0, 1.0, 0.0), ..EigenStart::default() };
    assert_eq!(go(&vec![0.4; pixels * 3], None, &gone).status, Status::OffFrame);
    let wild = EigenStart { last: Affine::from_element(f64::NAN), before: Some(Affine::zeros()), coefficients: vec![f64::NAN; 10] };
    let (rgb, matte) = frame(SIZE, &dance(1).0, &dance(1).1, 0.0, 1);
    let track = go(&rgb, Some(&matte), &wild);
    assert!(track.motion.iter().chain(&track.coefficients).all(|v| v.is_finite()), "{track:?}");
}

#[test]
fn wrong_input_is_told_in_words() {
    let told = |p: &Pictures, how: &EigenOptions| EigenTemplate::new(p, &Options::default(), how).map(|_| ()).unwrap_err().to_string();
    let (all, how) = (ten().pictures(), EigenOptions::default());
    let d = all.mean.len();
    assert_eq!(
        told(&Pictures { components: &all.components[1..], ..all }, &how),
        format!("expected {d} samples in the mean and each of 10 components, found {} in all", 11 * d - 1)
    );
    let broken = vec![f64::NAN; d];
    assert!(told(&Pictures { mean: &broken, ..all }, &how).starts_with("expected finite samples"));
    let empty = vec![0.0; d];
    let none = Pictures { mean: &empty, components: &[], variances: &[], ..all };
    assert_eq!(told(&none, &how), TrackError::Empty.to_string());
    assert_eq!(told(&all, &EigenOptions { prior: -1.0, ..how }), "expected prior from 0 to 1000000, found -1");
    let flat = vec![0.5; d];
    let flat = Pictures { mean: &flat, components: &[], variances: &[], alpha: None, ..all };
    assert_eq!(told(&flat, &how), TrackError::Textureless.to_string());
    let template = template();
    let grey = vec![0.5; SIZE.0 * SIZE.1];
    let found = template.track(Raster::new(&grey, SIZE.0, SIZE.1, 1).unwrap(), None, &EigenStart::default());
    assert_eq!(found, Err(EigenError::Colours { expected: 3, found: 1 }));
    let opaque = EigenTemplate::new(&Pictures { alpha: None, ..all }, &Options::default(), &how).unwrap();
    let rgba = vec![0.5; SIZE.0 * SIZE.1 * 4];
    let found = opaque.track(Raster::new(&rgba, SIZE.0, SIZE.1, 4).unwrap(), Some(&grey), &EigenStart::default());
    assert_eq!(found, Err(EigenError::NoAlpha));
}
