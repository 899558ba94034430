use super::*;
use crate::algo::raster::apply;
use crate::algo::smoothness::{Smoothing, bends};

struct Rng(u64);
impl Rng {
    /// In -1..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Nearly normal.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() * 0.5
    }
}

/// Blobs with bumps of their own.
fn keys(k: usize, n: usize, seed: u64) -> Vec<[f64; 2]> {
    let mut rng = Rng(seed);
    let mut out = Vec::new();
    for key in 0..k {
        let bumps: Vec<(f64, f64, f64)> = (2..7).map(|h| (f64::from(h), 25.0 * rng.next() / f64::from(h), 3.0 * rng.next())).collect();
        for i in 0..n {
            let t = i as f64 / n as f64 * std::f64::consts::TAU;
            let r = 90.0 + bumps.iter().map(|(h, a, p)| 2.0 * a * libm::cos(h * t + p)).sum::<f64>();
            out.push([30.0 * key as f64 + r * libm::cos(t), 50.0 + r * libm::sin(t)]);
        }
    }
    out
}

fn mixed(keys: &[[f64; 2]], n: usize, weights: &[f64], m: &Affine) -> Vec<[f64; 2]> {
    let at =
        |i: usize| weights.iter().enumerate().fold([0.0; 2], |s, (k, w)| [s[0] + w * keys[k * n + i][0], s[1] + w * keys[k * n + i][1]]);
    (0..n).map(|i| apply(m, at(i).into()).into()).collect()
}

/// A motion of the model and weights on three of `k` keys.
fn truth(rng: &mut Rng, k: usize, model: Model) -> (Affine, Vec<f64>) {
    let mut weights = vec![0.0; k];
    let at = ((rng.next() + 1.0) * 0.5 * k as f64) as usize % k;
    let (a, b) = (0.5 + 0.3 * rng.next(), 0.3 + 0.2 * rng.next());
    (weights[at], weights[(at + 1) % k], weights[(at + 3) % k]) = (a, b, 1.0 - a - b);
    let (s, c) = libm::sincos(2.5 * rng.next());
    let scale = if model == Model::Rigid { 1.0 } else { 1.0 + 0.4 * rng.next() };
    let (shear, stretch) = if model == Model::Affine { (0.3 * rng.next(), 1.0 + 0.3 * rng.next()) } else { (0.0, 1.0) };
    let (d, e) = (40.0 * rng.next(), 40.0 * rng.next());
    (Affine::new(scale * c, -scale * s * stretch + shear, d, scale * s, scale * c * stretch, e), weights)
}

#[test]
fn the_motion_and_the_weights_are_found_again() {
    for model in [Model::Affine, Model::Similarity, Model::Rigid] {
        let mut rng = Rng(7);
        for trial in 0..20 {
            let keys = keys(6, 120, 100 + trial);
            let (m, w) = truth(&mut rng, 6, model);
            let shape = mixed(&keys, 120, &w, &m);
            let found = Capturer::new(6, &keys, Options { model, ..Options::default() }).unwrap().capture(&shape).unwrap();
            assert!(found.errors.windows(2).all(|e| e[1] <= e[0]), "{:?}", found.errors);
            let off = found.weights.iter().zip(&w).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let linear = (found.motion.fixed_view::<2, 2>(0, 0) - m.fixed_view::<2, 2>(0, 0)).amax();
            assert!(
                off < 1e-6 && linear < 1e-6 && (found.motion - m).amax() < 1e-6 && found.rms < 1e-6,
                "{model:?} {trial}: {off} {linear} {found:?}"
            );
            assert!(found.converged && found.errors.len() < 40);
        }
    }
}

#[test]
fn noise_moves_the_weights_as_much_as_the_deviations_say() {
    let (mut rng, mut off, mut told, mut count) = (Rng(3), 0.0, 0.0, 0.0);
    for trial in 0..30 {
        // Drawings some 500 px across.
        let keys: Vec<_> = keys(5, 200, 500 + trial).into_iter().map(|[x, y]| [2.5 * x, 2.5 * y]).collect();
        let (m, w) = truth(&mut rng, 5, Model::Affine);
        let mut shape = mixed(&keys, 200, &w, &m);
        shape.iter_mut().flatten().for_each(|v| *v += rng.normal());
        let found = Capturer::new(5, &keys, Options::default()).unwrap().capture(&shape).unwrap();
        assert!(found.errors.windows(2).all(|e| e[1] <= e[0]));
        for (k, (a, b)) in found.weights.iter().zip(&w).enumerate() {
            assert!((a - b).abs() < 0.02, "trial {trial}: {:?} for {w:?}, deviations {:?}", found.weights, &found.deviations[6..]);
            off += (a - b) * (a - b);
            told += found.deviations[6 + k] * found.deviations[6 + k];
            count += 1.0;
        }
    }
    // Thirty trials of three weights: their mean square is known to about a fifth.
    let ratio: f64 = off / told;
    assert!((0.5..2.0).contains(&ratio), "{ratio} over {count}");
}

#[test]
fn a_key_is_itself() {
    let keys = keys(4, 50, 1);
    let mut capturer = Capturer::new(4, &keys, Options::default()).unwrap();
    for k in 0..4 {
        let found = capturer.capture(&keys[k * 50..(k + 1) * 50]).unwrap();
        assert!((found.weights[k] - 1.0).abs() < 1e-9 && found.rms < 1e-9, "{found:?}");
        assert!((found.motion - super::super::raster::identity()).amax() < 1e-7);
    }
}

#[test]
fn degenerate_keys_and_shapes_are_answered() {
    let one = keys(1, 40, 9);
    let repeated = [&one[..], &one[..], &one[..]].concat();
    let line: Vec<_> = (0..40).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
    let point = vec![[5.0, 5.0]; 40];
    for model in [Model::Affine, Model::Similarity, Model::Rigid, Model::Translation] {
        let options = Options { model, ..Options::default() };
        for keys in [&one[..], &repeated, &line, &point, &[&one[..], &line, &point].concat()] {
            let mut capturer = Capturer::new(keys.len() / 40, keys, options).unwrap();
            for shape in [&one, &line, &point] {
                let found = capturer.capture(shape).unwrap();
                assert!(found.rms.is_finite() && (found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{found:?}");
                assert!(found.errors.windows(2).all(|e| e[1] <= e[0]));
            }
        }
    }
    let found = Capturer::new(3, &repeated, Options::default()).unwrap().capture(&one).unwrap();
    assert_eq!(found.weights, [1.0, 0.0, 0.0]);
}

type Points = Vec<[f64; 2]>;
type Truth = (Affine, Vec<f64>);

/// A ball that bounces twice, squashed at the contacts and stretched between, its drawings trembling: truth, and what was drawn.
fn bounce(seed: u64) -> (Points, Vec<Truth>, Vec<Points>) {
    let (n, mut rng) = (80, Rng(seed));
    let base = keys(1, n, 3);
    let bumped = |bump: f64, waves: f64| {
        base.iter().enumerate().map(move |(i, p)| {
            let t = i as f64 / n as f64 * std::f64::consts::TAU;
            [p[0] + bump * libm::cos(waves * t), p[1] + bump * libm::sin((waves - 1.0) * t)]
        })
    };
    let keys: Vec<[f64; 2]> = bumped(0.0, 1.0).chain(bumped(30.0, 3.0)).chain(bumped(25.0, 5.0)).collect();
    let (mut truth, mut drawn) = (Vec::new(), Vec::new());
    for t in 0..49 {
        let phase = (f64::from(t % 24) - 12.0) / 12.0;
        let height = 150.0 * (1.0 - phase * phase);
        let squash = 0.7 * libm::exp(-8.0 * (1.0 - phase.abs()));
        let weights = vec![1.0 - squash - 0.3 * phase.abs(), squash, 0.3 * phase.abs()];
        let m = Affine::new(1.0, 0.0, 8.0 * f64::from(t), 0.0, 1.0, 400.0 - height);
        let shaken = Affine::new(
            1.0 + 0.01 * rng.normal(),
            0.01 * rng.normal(),
            8.0 * f64::from(t) + 1.5 * rng.normal(),
            0.01 * rng.normal(),
            1.0 + 0.01 * rng.normal(),
            400.0 - height + 1.5 * rng.normal(),
        );
        let a = 0.03 * rng.normal();
        let mixed_up: Vec<f64> = weights.iter().zip([a, -a, 0.0]).map(|(w, e)| w + e).collect();
        drawn.push(mixed(&keys, n, &mixed_up, &shaken));
        truth.push((m, weights));
    }
    (keys, truth, drawn)
}

#[test]
fn smoothness_takes_the_tremble_out_and_leaves_the_extremes() {
    for seed in [1, 2, 3] {
        let (keys, truth, drawn) = bounce(seed);
        let shapes: Vec<&[[f64; 2]]> = drawn.iter().map(Vec::as_slice).collect();
        let real: Vec<Vec<f64>> = truth.iter().map(|(m, w)| mixed(&keys, 80, w, m).as_flattened().to_vec()).collect();
        let flat = |captures: &[Capture]| -> Vec<Vec<f64>> { captures.iter().map(|c| c.shape.as_flattened().to_vec()).collect() };
        let off = |captures: &[Capture]| -> Vec<Vec<f64>> {
            flat(captures).iter().zip(&real).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
        };
        let tremble = |captures: &[Capture]| bends(&off(captures)).iter().sum::<f64>();
        let energy = |captures: &[Capture]| off(captures).iter().flatten().map(|v| v * v).sum::<f64>();
        let height = |shape: &[f64]| -shape.iter().skip(1).step_by(2).sum::<f64>() / 80.0;
        let smoothed = |accents: f64| {
            let mut capturer = Capturer::new(3, &keys, Options::default()).unwrap();
            let mut captures: Vec<Capture> = shapes.iter().map(|s| capturer.capture(s).unwrap()).collect();
            let raw = captures.clone();
            let smoothing = Smoothing { strength: 1.0, accents };
            let done = smooth(&mut capturer, &shapes, &mut captures, smoothing, || Ok::<_, ()>(())).unwrap();
            assert!(done.converged && done.totals.windows(2).all(|t| t[1] <= t[0]), "{:?}", done.totals);
            let whole = height(&real[12]) - height(&real[24]);
            let loss = [12, 24].map(|t| (height(captures[t].shape.as_flattened()) - height(&real[t])).abs() / whole);
            (raw, captures, loss)
        };
        let (raw, captures, [top, contact]) = smoothed(3.0);
        assert!(
            tremble(&raw) > 8.0 * tremble(&captures) && energy(&captures) < 0.6 * energy(&raw),
            "{} of {}",
            tremble(&captures),
            tremble(&raw)
        );
        assert!(top < 0.02 && contact < 0.02, "{top} {contact}");
        for (capture, was) in captures.iter().zip(&raw) {
            assert!((capture.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && capture.rms >= was.rms && capture.certificate.kkt < 1e-10);
            assert!(capture.certificate.lower_bound <= capture.certificate.cost + 1e-9);
        }
        // Without accents the contact is rounded off, as any plain smoothing does.
        let (raw, captures, [top, contact]) = smoothed(0.0);
        let all = |captures: &[Capture]| bends(&flat(captures)).iter().sum::<f64>();
        assert!(all(&raw) > 5.0 * all(&captures) && top < 0.02 && contact > 0.05, "{} {top} {contact}", all(&raw) / all(&captures));
    }
}

#[test]
fn short_sequences_and_single_keys_are_smoothed_to_what_they_are() {
    let all = keys(4, 50, 1);
    for (k, frames) in [(1, 5), (4, 1), (4, 2), (4, 3)] {
        let mut capturer = Capturer::new(k, &all[..50 * k], Options::default()).unwrap();
        let shapes: Vec<&[[f64; 2]]> = vec![&all[..50]; frames];
        let mut captures: Vec<Capture> = shapes.iter().map(|s| capturer.capture(s).unwrap()).collect();
        let before = captures.clone();
        let smoothing = Smoothing { strength: 5.0, accents: 3.0 };
        assert!(smooth(&mut capturer, &shapes, &mut captures, smoothing, || Ok::<_, ()>(())).unwrap().converged);
        for (a, b) in captures.iter().zip(&before) {
            assert!((a.motion - b.motion).amax() < 1e-6 && (a.weights[0] - 1.0).abs() < 1e-6, "{a:?}");
        }
    }
    let mut capturer = Capturer::new(4, &all, Options::default()).unwrap();
    assert_eq!(
        smooth(&mut capturer, &[], &mut [], Smoothing::default(), || Err("stopped")),
        Ok(Smoothed { totals: vec![0.0, 0.0], converged: true })
    );
    let (one, mut captures) = ([&all[..50]], vec![capturer.capture(&all[..50]).unwrap()]);
    assert_eq!(smooth(&mut capturer, &one, &mut captures, Smoothing::default(), || Err("stopped")), Err("stopped"));
}
