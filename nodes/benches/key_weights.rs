//! Time of the key weights of one frame, one thread: closed contours of 200 points out of Fourier descriptors, a shape near a mixture of
//! three keys under a motion. "frame" has the keys' products from before, as in a sequence; "keys and frame" forms them as well.

use criterion::{Criterion, criterion_group, criterion_main};
use pegbar_nodes::algo::capture_contour::{Capturer, Options};
use pegbar_nodes::algo::key_weights::{KeySpace, Limits, Problem, Solver};
use pegbar_nodes::algo::raster::{Affine, apply};
use std::hint::black_box;

const POINTS: usize = 200;
/// Frames that are solved by turns, so that no one of them is learnt by heart.
const FRAMES: usize = 20;

struct Rng(u64);

impl Rng {
    /// In -1..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Nearly normal.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() * 0.5
    }
}

/// A blob and its waves, which are the smaller the shorter they are.
fn contour(rng: &mut Rng) -> Vec<[f64; 2]> {
    let size = 100.0 + 30.0 * rng.normal();
    let waves: Vec<(f64, f64, f64)> = (-12i32..=12)
        .filter(|h| ![0, 1].contains(h))
        .map(|h| (f64::from(h), 22.0 / f64::from(h.abs()) * rng.normal(), 22.0 / f64::from(h.abs()) * rng.normal()))
        .collect();
    let point = |i: usize| {
        let t = i as f64 / POINTS as f64 * std::f64::consts::TAU;
        waves.iter().fold([size * t.cos(), size * t.sin()], |p, (h, a, b)| {
            let (s, c) = (h * t).sin_cos();
            [p[0] + a * c - b * s, p[1] + a * s + b * c]
        })
    };
    (0..POINTS).map(point).collect()
}

type Points = Vec<[f64; 2]>;

/// Keys, and a motion and a shape for each frame.
fn scene(n_keys: usize) -> (Points, Vec<(Affine, Points)>) {
    let mut rng = Rng(n_keys as u64);
    let keys: Vec<[f64; 2]> = (0..n_keys).flat_map(|_| contour(&mut rng)).collect();
    let frames = (0..FRAMES).map(|t| {
        let (s, c) = (0.6 * rng.next()).sin_cos();
        let m = Affine::new(c, -s, 40.0 * rng.normal(), s, c, 40.0 * rng.normal());
        let chosen = [t % n_keys, (t + 3) % n_keys, (t + 5) % n_keys];
        let (a, b) = (0.6 + 0.4 * rng.next(), 0.3 + 0.4 * rng.next());
        let weights = [a, b, 1.0 - a - b];
        let point = |i: usize| {
            let p = chosen.iter().zip(weights).fold([0.0; 2], |p, (k, w)| [0, 1].map(|c| p[c] + w * keys[k * POINTS + i][c]));
            apply(&m, p.into()).into()
        };
        let mut shape: Vec<[f64; 2]> = (0..POINTS).map(point).collect();
        shape.iter_mut().flatten().for_each(|v| *v += 3.0 * rng.normal());
        (m, shape)
    });
    let frames = frames.collect();
    (keys, frames)
}

fn weights(c: &mut Criterion) {
    for (n_keys, max_nonzero) in [(10, 3), (10, 10), (20, 4), (20, 20)] {
        let (keys, frames) = scene(n_keys);
        let limits = Limits { max_nonzero, ..Limits::default() };
        let (Ok(mut solver), Ok(space)) = (Solver::new(n_keys, limits), KeySpace::new(n_keys, &keys)) else { return };
        let (mut problem, mut weights, mut shared, mut at) = (Problem::default(), vec![0.0; n_keys], space, 0);
        c.bench_function(&format!("weights, {n_keys} keys, {max_nonzero} at a time: frame"), |b| {
            b.iter(|| {
                at = (at + 1) % FRAMES;
                shared.problem(&frames[at].0, black_box(&frames[at].1), &mut problem);
                solver.solve(&problem, &mut weights)
            });
        });
        c.bench_function(&format!("weights, {n_keys} keys, {max_nonzero} at a time: keys and frame"), |b| {
            b.iter(|| {
                at = (at + 1) % FRAMES;
                let Ok(mut own) = KeySpace::new(n_keys, black_box(&keys)) else { return };
                own.problem(&frames[at].0, &frames[at].1, &mut problem);
                solver.solve(&problem, &mut weights);
            });
        });
    }
}

fn captures(c: &mut Criterion) {
    for n_keys in [5, 10] {
        let (keys, frames) = scene(n_keys);
        let Ok(mut capturer) = Capturer::new(n_keys, &keys, Options::default()) else { return };
        let mut at = 0;
        c.bench_function(&format!("capture, {n_keys} keys"), |b| {
            b.iter(|| {
                at = (at + 1) % FRAMES;
                capturer.capture(black_box(&frames[at].1))
            });
        });
    }
}

criterion_group!(benches, weights, captures);
criterion_main!(benches);
