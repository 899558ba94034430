//! A figure of a head, a body and two arms that swing far, in mixtures of its keys over a striped ground.

use super::*;
use crate::algo::paint::{Canvas, FillRule, polygon};
use crate::algo::pca::{Keep, pca};
use crate::algo::raster::Raster;
use crate::algo::track_affine::eigen::{EigenOptions, EigenStart, EigenTemplate, Pictures};
use crate::algo::track_affine::{Model, Tone};
use crate::algo::window::Window as Area;
use kurbo::Point;

const SIZE: (usize, usize) = (200, 180);
const PARTS: [[f32; 4]; 4] = [[0.35, 0.12, 0.03, 1.0], [0.35, 0.12, 0.03, 1.0], [0.25, 0.08, 0.02, 1.0], [0.7, 0.5, 0.2, 1.0]];
const POINTS: usize = 24;

/// Keys of ellipses, a part behind the other, each in an outline of ink.
struct Figure {
    keys: Vec<Vec<[f64; 2]>>,
}

fn ellipse(centre: [f64; 2], [long, wide]: [f64; 2], turn: f64) -> impl Iterator<Item = [f64; 2]> {
    let (sin, cos) = libm::sincos(turn);
    (0..POINTS).map(move |i| {
        let (s, c) = libm::sincos(std::f64::consts::TAU * i as f64 / POINTS as f64);
        [centre[0] + cos * long * c - sin * wide * s, centre[1] + sin * long * c + cos * wide * s]
    })
}

/// The figure with its arms at these angles, squashed.
fn posed(left: f64, right: f64, squash: f64) -> Vec<[f64; 2]> {
    let arm = |side: f64, angle: f64| {
        let (s, c) = libm::sincos(angle);
        ellipse([100.0 + side * (22.0 + 20.0 * c), 88.0 - 20.0 * s], [24.0, 7.0], -side * angle)
    };
    let body = ellipse([100.0, 105.0], [24.0 / squash, 32.0 * squash], 0.0);
    arm(-1.0, left).chain(arm(1.0, right)).chain(body).chain(ellipse([100.0, 105.0 - 46.0 * squash], [17.0, 15.0], 0.1)).collect()
}

impl Drawn for Figure {
    fn n_keys(&self) -> usize {
        self.keys.len()
    }

    fn key(&self, k: usize) -> &[[f64; 2]] {
        &self.keys[k]
    }

    fn draw(&self, weights: &[f64], place: &Affine, line: f64, [width, height]: [usize; 2]) -> Option<Vec<f32>> {
        let points = placed(self, &DrawnPose { motion: *place, weights: weights.to_vec() });
        let mut data = vec![0.0; width * height * 4];
        let mut canvas = Canvas::new(&mut data, width, height).ok()?;
        for (part, colour) in points.chunks(POINTS).zip(PARTS) {
            let path = polygon(&part.iter().map(|p| Point::new(p[0], p[1])).collect::<Vec<_>>());
            canvas.fill(&path, FillRule::NonZero, colour);
            canvas.line(&path, 2.0 * line, [0.01, 0.01, 0.01, 1.0]);
        }
        Some(data)
    }
}

fn figure() -> Figure {
    Figure { keys: vec![posed(1.2, -0.7, 1.0), posed(-0.7, 1.2, 1.0), posed(0.4, 0.4, 0.75)] }
}

fn template(figure: &Figure) -> EigenTemplate {
    let mixes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]];
    let place = Affine::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let row = |w: &[f64; 3]| -> Vec<f64> {
        let picture = figure.draw(w, &place, 1.0, [SIZE.0, SIZE.1]).unwrap();
        picture.iter().enumerate().map(|(i, v)| f64::from(if i % 4 == 3 { *v } else { toned(*v, Tone::Encoded) })).collect()
    };
    let rows: Vec<Vec<f64>> = mixes.iter().map(row).collect();
    let views: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
    let space = pca(&views, SIZE.0 * SIZE.1, Keep::Components(4)).unwrap();
    let pictures = Pictures {
        mean: &space.mean,
        components: &space.components.concat(),
        variances: &space.variances,
        examples: &space.coordinates,
        window: Area::at_origin(SIZE.0, SIZE.1),
        channels: 4,
        alpha: Some(3),
        tone: Tone::Encoded,
    };
    EigenTemplate::new(&pictures, &Options { iterations: 40, ..Options::default() }, &EigenOptions::default()).unwrap()
}

/// A frame in linear light over stripes, and a matte with a hole in the belly and a rim that is half a pixel short.
fn frame(figure: &Figure, pose: &DrawnPose) -> (Vec<f32>, Vec<f32>) {
    let drawing = figure.draw(&pose.weights, &pose.motion, 1.0, [SIZE.0, SIZE.1]).unwrap();
    let ground = |i: usize| if (i % SIZE.0 / 12).is_multiple_of(2) { [0.1, 0.2, 0.5] } else { [0.2, 0.35, 0.6] };
    let over = |(i, p): (usize, &[f32])| [0, 1, 2].map(|c| p[c] + (1.0 - p[3]) * ground(i)[c]);
    let image = drawing.chunks_exact(4).enumerate().flat_map(over).collect();
    let is_hole = |i: usize| (i % SIZE.0).abs_diff(100) < 6 && (i / SIZE.0).abs_diff(105) < 6;
    let matte = |(i, p): (usize, &[f32])| if is_hole(i) || p[3] < 0.9 { 0.0 } else { 1.0 };
    (image, drawing.chunks_exact(4).enumerate().map(matte).collect())
}

fn off(figure: &Figure, a: &DrawnPose, b: &DrawnPose) -> f64 {
    let (a, b) = (placed(figure, a), placed(figure, b));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sum();
    libm::sqrt(sum / a.len() as f64)
}

#[test]
fn poses_of_three_keys_and_beyond_a_key_are_found_to_a_tenth_of_a_pixel() {
    let figure = figure();
    let template = template(&figure);
    let poses = [
        ([1.0, 0.0, 0.0], Affine::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)),
        ([1.1, 0.0, -0.1], Affine::new(0.97, 0.02, 2.0, -0.02, 1.0, 3.0)),
        ([0.3, 0.3, 0.4], Affine::new(0.98, 0.0, 5.0, 0.01, 0.98, 2.0)),
        ([-0.1, 0.9, 0.2], Affine::new(1.0, -0.03, 6.0, 0.03, 1.02, -4.0)),
    ];
    let (mut start, mut last) = (EigenStart::default(), None);
    for (weights, motion) in poses {
        let truth = DrawnPose { motion, weights: weights.to_vec() };
        let (image, matte) = frame(&figure, &truth);
        let raster = Raster::new(&image, SIZE.0, SIZE.1, 3).unwrap();
        let (track, found) = template.track_drawn(raster, Some(&matte), &start, &figure, last.as_ref(), |_| None).unwrap();
        let found = found.unwrap();
        let error = off(&figure, &found, &truth);
        assert!(error < 0.1, "{weights:?}: off by {error} px, {found:?}");
        assert!(track.is_converged() && track.iterations <= 40, "{weights:?}: {:?} after {}", track.status, track.iterations);
        start = EigenStart { last: track.motion, before: None, coefficients: track.coefficients };
        last = Some(found);
    }
}

#[test]
fn unknown_ground_is_what_lies_around_it() {
    // A ramp with a gap: what is filled in lies between the two sides.
    let (w, h) = (16, 8);
    let mut planes = vec![(0..w * h).map(|i| (i % w) as f32).collect::<Vec<f32>>()];
    let known: Vec<bool> = (0..w * h).map(|i| !(6..10).contains(&(i % w))).collect();
    planes[0].iter_mut().zip(&known).filter(|(_, k)| !**k).for_each(|(v, _)| *v = f32::NAN);
    fill(&mut planes, &known, w, h);
    assert!(planes[0].iter().all(|v| (0.0..=15.0).contains(v)), "{planes:?}");
    assert!((0..w * h).filter(|i| !known[*i]).all(|i| (3.0..=12.0).contains(&planes[0][i])), "{planes:?}");
}

#[test]
fn keys_that_a_motion_makes_of_each_other_are_no_direction_of_the_pose() {
    let mut figure = figure();
    let turned = |p: &[f64; 2]| [0.9 * p[0] - 0.2 * p[1] + 30.0, 0.3 * p[0] + 1.1 * p[1] - 20.0];
    figure.keys[1] = figure.keys[0].iter().map(turned).collect();
    let pose = DrawnPose { motion: Affine::new(1.0, 0.1, 2.0, -0.1, 0.9, 3.0), weights: vec![0.6, 0.4, 0.0] };
    let place = |p: [f64; 2]| [(p[0] - 100.0) / 40.0, (p[1] - 90.0) / 40.0];
    let of = |model| Directions::new(&figure, model, &pose, place, 2.0, LEAST_FINE);
    assert_eq!((of(Model::Affine).mixes.len(), of(Model::Translation).mixes.len()), (1, 2));
    for model in [Model::Affine, Model::Translation] {
        for mix in of(model).mixes {
            assert!(mix.weights.iter().sum::<f64>().abs() < 1e-9, "weights no longer add up to 1");
            // To first order, what is left of the change once the motion has taken its part moves the points by one sample.
            let h = 1e-4;
            let weights = pose.weights.iter().zip(&mix.weights).map(|(w, d)| w + h * d).collect();
            let with = DrawnPose { motion: pose.motion, weights };
            let [a, b, c, d, x, y] = mix.motion;
            let taken = |p: &[f64; 2]| {
                let [u, v] = place(*p);
                [p[0] + h * 2.0 * (a * u + b * v + x), p[1] + h * 2.0 * (c * u + d * v + y)]
            };
            let moved: Vec<[f64; 2]> = placed(&figure, &with).iter().map(taken).collect();
            let gone = apart(&moved, &placed(&figure, &pose)) / h;
            assert!((gone - 2.0).abs() < 1e-3, "{model:?}: {gone} px for a sample of 2 px");
        }
    }
}
