//! Whole mattes against exact truth: a hat with an outline of ink on a painted ground, drawn with sixteen samples a pixel.

use super::*;

const WIDTH: usize = 144;
const HEIGHT: usize = 112;
const INK: [f64; 3] = [0.08, 0.07, 0.07];

/// A picture in linear RGB and the exact coverage of the layer.
struct Frame {
    data: Vec<f32>,
    truth: Vec<f32>,
}

impl Frame {
    fn raster(&self) -> Raster<'_> {
        Raster { data: &self.data, width: WIDTH, height: HEIGHT, channels: 3 }
    }
}

/// What a clip is painted with, sRGB values.
struct Scene {
    ground: [[f64; 3]; 3],
    fills: [[f64; 3]; 2],
    ink: bool,
    /// Standard deviation of the grain, in codes of eight bits.
    grain: f64,
    /// Factor on linear light, which may change over time.
    light: fn(f64) -> f64,
}

const GREEN: Scene = Scene {
    ground: [[0.24, 0.43, 0.27], [0.59, 0.67, 0.47], [0.47, 0.55, 0.7]],
    fills: [[0.1, 0.2, 0.8], [0.9, 0.8, 0.2]],
    ink: true,
    grain: 3.0,
    light: |_| 1.0,
};
/// The ground comes near the colours of the layer.
const BROWN: Scene = Scene {
    ground: [[0.5, 0.35, 0.2], [0.7, 0.55, 0.35], [0.35, 0.3, 0.25]],
    fills: [[0.55, 0.28, 0.13], [0.85, 0.75, 0.2]],
    ink: true,
    grain: 2.0,
    light: |_| 1.0,
};

/// Approximately normal numbers from a counter.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = 0.0;
        for _ in 0..4 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        }
        sum * 3.0f64.sqrt()
    }
}

impl Scene {
    /// The painted ground at a pixel, linear.
    fn ground_at(&self, x: f64, y: f64) -> [f64; 3] {
        let a = 0.5 + 0.5 * (0.06 * x + 0.03 * y).sin();
        let b = 0.5 + 0.5 * (0.05 * y - 0.04 * x + 1.0).cos();
        let texture = 0.02 * (0.9 * x + 0.4 * y).sin() + 0.015 * (1.3 * y - 0.7 * x).cos();
        let mix = |c: usize| (self.ground[0][c] * a + self.ground[1][c] * (1.0 - a)) * b + self.ground[2][c] * (1.0 - b) + texture;
        std::array::from_fn(|c| color::linear_from_srgb(mix(c).clamp(0.0, 1.0)))
    }

    /// The layer at (u, v), from its own origin; `None` outside of it.
    fn layer_at(&self, u: f64, v: f64) -> Option<[f64; 3]> {
        let k = (u / 44.0).hypot((v - 24.0) / 11.0);
        let brim = k * (k - 1.0) / (u / 44.0f64.powi(2)).hypot((v - 24.0) / 11.0f64.powi(2)).max(1e-6);
        let crown = (u.abs() - 22.0 + 0.18 * (24.0 - v)).max((-(v + 30.0)).max(v - 24.0));
        let distance = brim.min(crown);
        let line = distance > -2.5 || ((v - 6.0).abs() < 1.2 && crown < 0.0);
        let fill = if v > 6.0 && v < 18.0 && crown < 0.0 { self.fills[1] } else { self.fills[0] };
        (distance < 0.0).then(|| (if line && self.ink { INK } else { fill }).map(color::linear_from_srgb))
    }

    /// Frame `f` of the clip.
    fn frame(&self, f: usize) -> Frame {
        let t = f as f64 * 0.3;
        let (cx, cy, (sin, cos)) = (72.0 + 18.0 * t.sin(), 56.0 + 8.0 * (0.7 * t).cos(), (0.25 * t.sin()).sin_cos());
        let mut noise = Noise(f as u64 + 1);
        let (mut data, mut truth) = (Vec::new(), Vec::new());
        for i in 0..WIDTH * HEIGHT {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            let ground = self.ground_at(x, y);
            let (mut sum, mut inside) = ([0.0; 3], 0.0);
            for s in 0..16 {
                let (dx, dy) = (x + (f64::from(s % 4) + 0.5) / 4.0 - cx, y + (f64::from(s / 4) + 0.5) / 4.0 - cy);
                let layer = self.layer_at(cos * dx + sin * dy, cos * dy - sin * dx);
                inside += f64::from(layer.is_some()) / 16.0;
                let c = layer.unwrap_or(ground);
                sum = std::array::from_fn(|k| sum[k] + c[k] / 16.0);
            }
            truth.push(inside as f32);
            data.extend(sum.map(|v| {
                let code = (color::srgb_from_linear(v * (self.light)(t)) * 255.0 + self.grain * noise.next()).round().clamp(0.0, 255.0);
                color::linear_from_srgb(code / 255.0) as f32
            }));
        }
        Frame { data, truth }
    }
}

/// Intersection over union of what is more than half covered.
fn iou(a: &[f32], b: &[f32]) -> f64 {
    let count = |f: fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| f(**a > 0.5, **b > 0.5)).count() as f64;
    count(|a, b| a && b) / count(|a, b| a || b).max(1.0)
}

/// Root mean square difference over the pixels that are neither all layer nor all ground.
fn edge_rmse(a: &[f32], truth: &[f32]) -> f64 {
    let mixed: Vec<f64> = a.iter().zip(truth).filter(|(_, t)| **t > 0.0 && **t < 1.0).map(|(a, t)| f64::from((a - t) * (a - t))).collect();
    (mixed.iter().sum::<f64>() / mixed.len() as f64).sqrt()
}

/// The matte of each frame of a clip, the model adapted at `rate` after each.
fn run(scene: &Scene, frames: std::ops::Range<usize>, seed: Seed<'_>, rate: f64, options: &Options) -> Vec<(Frame, Vec<f32>, Status)> {
    let mut model = fit(scene.frame(frames.start).raster(), seed, options).unwrap();
    let mut step = |f: usize| {
        let frame = scene.frame(f);
        let mut out = vec![0.0; WIDTH * HEIGHT];
        let status = alpha(frame.raster(), &model, options, &mut out).unwrap();
        model = adapt(frame.raster(), &out, &model, rate, options).unwrap();
        (frame, out, status)
    };
    frames.map(&mut step).collect()
}

fn plain() -> Options {
    Options { smoothness: 0.0, min_area: 0.0, fill_holes: 0.0, edge: 0.0, ink: 0.0, clip: (0.0, 1.0), ..Options::default() }
}

#[test]
fn twenty_frames_are_cut_out() {
    for scene in [&GREEN, &BROWN] {
        let mattes = run(scene, 0..20, Seed::Colours(&scene.fills), 0.5, &Options::default());
        let scores: Vec<f64> = mattes.iter().map(|(f, a, _)| iou(a, &f.truth)).collect();
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        assert!(mean >= 0.985 && scores.iter().all(|s| *s >= 0.97), "mean {mean}, frames {scores:?}");
        let worst = mattes.iter().map(|(f, a, _)| edge_rmse(a, &f.truth)).fold(0.0, f64::max);
        assert!(worst < 0.2, "expected soft edges, found an error of {worst}");
    }
}

#[test]
fn a_rough_hint_and_a_box_do_as_well() {
    let first = GREEN.frame(0);
    // Sure only well inside and well outside.
    let mut sure: Vec<bool> = first.truth.iter().map(|t| *t > 0.0).collect();
    regions::dilate(&mut sure, WIDTH, 6);
    let mut outside: Vec<bool> = first.truth.iter().map(|t| *t < 1.0).collect();
    regions::dilate(&mut outside, WIDTH, 1);
    let rough: Vec<f32> = (0..sure.len()).map(|i| if !sure[i] { 0.0 } else { 0.5 + 0.5 * f32::from(!outside[i]) }).collect();
    let boxed: Vec<f32> =
        (0..sure.len()).map(|i| if (35..125).contains(&(i % WIDTH)) && (28..104).contains(&(i / WIDTH)) { 0.5 } else { 0.0 }).collect();
    for (hint, floor) in [(rough, 0.98), (boxed, 0.9)] {
        for (frame, out, _) in run(&GREEN, 0..3, Seed::Hint(&hint), 0.5, &Options::default()) {
            let score = iou(&out, &frame.truth);
            assert!(score >= floor, "expected at least {floor}, found {score}");
        }
    }
}

#[test]
fn two_runs_have_the_same_bits() {
    let bits = || -> Vec<u32> {
        let mattes = run(&BROWN, 0..3, Seed::Colours(&BROWN.fills), 1.0, &Options::default());
        mattes.iter().flat_map(|(_, a, _)| a.iter().map(|v| v.to_bits())).collect()
    };
    assert_eq!(bits(), bits());
}

#[test]
fn adapting_follows_the_light() {
    let dusk = Scene { ink: false, light: |t| 1.0 - 0.11 * t, ..GREEN };
    let last = |rate: f64| {
        let mattes = run(&dusk, 0..20, Seed::Colours(&dusk.fills), rate, &Options { ink: 0.0, ..Options::default() });
        mattes.last().map(|(f, a, s)| (iou(a, &f.truth), *s)).unwrap()
    };
    let ((kept, kept_status), (adapted, status)) = (last(0.0), last(1.0));
    assert!(adapted > 0.97 && adapted > kept + 0.1, "adapted {adapted}, kept {kept}");
    assert!(status.log_likelihood > kept_status.log_likelihood + 1.0);
}

#[test]
fn the_posterior_is_that_of_the_mixtures() {
    let frame = GREEN.frame(0);
    for space in [Space::Lab, Space::Oklab, Space::Display, Space::Linear] {
        let options = Options { space, ..plain() };
        let model = fit(frame.raster(), Seed::Colours(&GREEN.fills), &options).unwrap();
        let mut out = vec![0.0; WIDTH * HEIGHT];
        alpha(frame.raster(), &model, &options, &mut out).unwrap();
        let [layer, ground, _] = model.shares();
        let density = |side: &[Gaussian], x| side.iter().filter_map(|g| Some(g.weight * g.log_density(x)?.exp())).sum::<f64>();
        for i in (0..out.len()).step_by(37) {
            let rgb = [frame.data[3 * i], frame.data[3 * i + 1], frame.data[3 * i + 2]];
            let x = kernel::coordinates(space, rgb).map(f64::from);
            let (f, b) =
                (layer * density(&model.foreground, x) + model.floors()[0], ground * density(&model.background, x) + model.floors()[1]);
            let expected = f / (f + b);
            // The distance of a colour from a cluster squares the rounding of its `f32` coordinates.
            assert!((f64::from(out[i]) - expected).abs() < 2e-3, "{space:?}, pixel {i}: expected {expected}, found {}", out[i]);
        }
    }
}

#[test]
fn distances_between_clusters_have_their_closed_form() {
    let a = Gaussian::round(0.5, [0.0; 3], 2.0);
    let b = Gaussian::round(0.5, [4.0, 0.0, 0.0], 2.0);
    // Equal spreads: an eighth of the squared distance over the variance.
    assert!((a.bhattacharyya(&b).unwrap() - 0.5).abs() < 1e-12);
    assert!(a.bhattacharyya(&a).unwrap().abs() < 1e-12);
    // Equal centres, spreads 2 and 4: half of ln (10³ / √(4³ 16³)).
    let wide = Gaussian::round(0.5, [0.0; 3], 4.0);
    assert!((a.bhattacharyya(&wide).unwrap() - 1.5 * (10.0f64 / 8.0).ln()).abs() < 1e-12);
    let flat = Gaussian { covariance: [[0.0; 3]; 3], ..a };
    assert_eq!((flat.log_density([0.0; 3]), flat.bhattacharyya(&a)), (None, None));
    // A slanted covariance against its inverse worked by hand: [[4,2,0],[2,3,0],[0,0,1]], determinant 8.
    let slanted = Gaussian { covariance: [[4.0, 2.0, 0.0], [2.0, 3.0, 0.0], [0.0, 0.0, 1.0]], ..a };
    let expected = -0.5 * ((3.0 - 4.0 + 4.0) / 8.0 + 9.0) - 1.5 * std::f64::consts::TAU.ln() - 0.5 * 8.0f64.ln();
    assert!((slanted.log_density([1.0, 1.0, 3.0]).unwrap() - expected).abs() < 1e-12);
}

#[test]
fn like_colours_are_warned_of() {
    let separation = |scene: &Scene| {
        let options = Options { ink: 0.0, ..Options::default() };
        fit(scene.frame(0).raster(), Seed::Hint(&scene.frame(0).truth), &options).unwrap().separation()
    };
    let hidden = Scene { fills: [BROWN.ground[0], BROWN.ground[1]], ink: false, ..BROWN };
    let (near, far) = (separation(&hidden), separation(&Scene { ink: false, ..GREEN }));
    assert!(near < 1.0 && far > 3.0, "near {near}, far {far}");
}

#[test]
fn a_rate_of_nothing_keeps_the_model() {
    let frame = GREEN.frame(0);
    let options = Options::default();
    let model = fit(frame.raster(), Seed::Colours(&GREEN.fills), &options).unwrap();
    assert_eq!(adapt(frame.raster(), &frame.truth, &model, 0.0, &options), Ok(model.clone()));
    // Without a pixel of the layer the layer's clusters stay.
    let gone = adapt(frame.raster(), &vec![0.0; WIDTH * HEIGHT], &model, 1.0, &options).unwrap();
    assert_eq!(gone.foreground, model.foreground);
    assert!(
        adapt(frame.raster(), &frame.truth, &model, 1.5, &options)
            .unwrap_err()
            .to_string()
            .starts_with("expected adapt from 0 to 1, found 1.5")
    );
}

#[test]
fn bad_input_is_refused_with_its_reason() {
    let frame = GREEN.frame(0);
    let text = |seed: Seed<'_>, options: &Options| fit(frame.raster(), seed, options).unwrap_err().to_string();
    let options = Options::default();
    assert_eq!(text(Seed::Hint(&[1.0]), &options), "expected a matte of 16128 samples, found 1; it must have the size of the picture");
    assert_eq!(
        text(Seed::Colours(&[[0.1, 2.0, 0.0]]), &options),
        "expected foreground colours of three sRGB values from 0 to 1, found (0.1, 2, 0)"
    );
    let none = "expected pixels of the layer in the first frame, found 0; pick `foreground` colours from the picture";
    assert_eq!(text(Seed::Colours(&[]), &options), none);
    assert_eq!(text(Seed::Colours(&[[1.0, 0.0, 1.0]]), &options), none);
    let (white, black) = (vec![1.0; WIDTH * HEIGHT], vec![0.0; WIDTH * HEIGHT]);
    assert_eq!(
        text(Seed::Hint(&white), &options),
        "expected pixels of the ground in the first frame, found 0; paint the ground black in the hint"
    );
    assert_eq!(
        text(Seed::Hint(&black), &options),
        "expected pixels of the layer in the first frame, found 0; paint the layer white in the hint"
    );
    assert_eq!(text(Seed::Hint(&white), &Options { clusters: 0, ..options.clone() }), "expected clusters from 1 to 32, found 0");
    assert_eq!(
        text(Seed::Hint(&white), &Options { smoothness: f64::NAN, ..options.clone() }),
        "expected smoothness from 0 to 100, found NaN"
    );
    let empty = Raster { data: &[], width: 0, height: 4, channels: 3 };
    assert_eq!(
        fit(empty, Seed::Hint(&[]), &options).unwrap_err().to_string(),
        "expected a picture with pixels, found 0 by 4 with 3 channels"
    );
    let model = fit(frame.raster(), Seed::Colours(&GREEN.fills), &options).unwrap();
    assert!(matches!(alpha(frame.raster(), &model, &options, &mut [0.0]), Err(MatteError::Size { .. })));
}

#[test]
fn strange_pictures_survive() {
    let frame = GREEN.frame(0);
    for options in
        [Options::default(), plain(), Options { smoothness: 100.0, edge: 16.0, ink: 1e6, fill_holes: f64::INFINITY, ..Options::default() }]
    {
        let model = fit(frame.raster(), Seed::Colours(&GREEN.fills), &options).unwrap();
        for (width, height, channels) in [(1, 1, 3), (1, 9, 3), (9, 1, 4), (3, 2, 1), (2, 2, 2), (257, 3, 3)] {
            for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 0.5, 1e30] {
                let data = vec![value; width * height * channels];
                let mut out = vec![0.0; width * height];
                let image = Raster::new(&data, width, height, channels).unwrap();
                let status = alpha(image, &model, &options, &mut out).unwrap();
                assert!(out.iter().all(|a| (0.0..=1.0).contains(a)) && status.area.is_finite(), "{width}x{height}, {value}");
                let hint: Vec<f32> = (0..width * height).map(|i| (i % 2) as f32).collect();
                // One colour on both sides is no model worth having, and no reason to fail.
                if let Ok(model) = fit(image, Seed::Hint(&hint), &options) {
                    alpha(image, &model, &options, &mut out).unwrap();
                    assert!(out.iter().all(|a| (0.0..=1.0).contains(a)));
                }
            }
        }
    }
}
