//! Known warps of a drawn scene, equivalences, invariances, degenerate input.

use nalgebra::Matrix2;
use proptest::prelude::*;

use super::scene::{Random, SIZE, corner_error, render, warp};
use super::solve::distance;
use super::start::shifted;
use super::*;
use crate::algo::raster::{apply, compose, invert};

/// Display noise of the test scenes: two levels of an 8-bit picture.
const GRAIN: f64 = 0.008;

fn rgb(data: &[f32]) -> Raster<'_> {
    Raster::new(data, SIZE.0, SIZE.1, 3).unwrap()
}

/// A smooth texture of `w` by `h` pixels, seen through `motion` (frame from reference), one channel.
fn texture(w: usize, h: usize, motion: &Affine) -> Vec<f32> {
    let inverse = invert(motion).unwrap();
    let mut rng = Random(3);
    let waves: Vec<[f64; 4]> =
        (0..24).map(|_| [rng.normal() * 0.22, rng.normal() * 0.22, rng.range(0.0, 6.3), rng.range(0.2, 1.0)]).collect();
    let mut out = Vec::with_capacity(w * h);
    for j in 0..h {
        for i in 0..w {
            let p = apply(&inverse, nalgebra::Vector2::new(i as f64 + 0.5, j as f64 + 0.5));
            let s: f64 = waves.iter().map(|[k, l, q, a]| a * libm::cos(k * p.x + l * p.y + q)).sum();
            out.push((0.5 + 0.03 * s) as f32);
        }
    }
    out
}

fn grey(data: &[f32], w: usize) -> Raster<'_> {
    Raster::new(data, w, data.len() / w, 1).unwrap()
}

/// The texture tracked from no motion to `motion` in the middle of a 160x140 picture.
fn texture_track(motion: &Affine, options: &Options) -> Track {
    let (a, b) = (texture(160, 140, &identity()), texture(160, 140, motion));
    let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), options).unwrap();
    t.track(grey(&b, 160), None, &Start::default()).unwrap()
}

fn texture_error(a: &Affine, b: &Affine) -> f64 {
    distance(a, b, [40.0, 35.0, 120.0, 105.0])
}

fn around(linear: Matrix2<f64>, dx: f64, dy: f64) -> Affine {
    let c = nalgebra::Vector2::new(80.0, 70.0);
    let t = c + nalgebra::Vector2::new(dx, dy) - linear * c;
    Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
}

/// C9: every known warp is found, to the median accuracy asked of each level.
fn known_warps(level: usize, median: f64, with_matte: bool) {
    let (reference, matte) = render(&identity(), GRAIN, 1);
    let t = Template::new(rgb(&reference), Region::Matte(&matte), &Options::default()).unwrap();
    let mut rng = Random(40 + level as u64);
    let mut errors = Vec::new();
    for k in 0..7 {
        let truth = warp(level, &mut rng);
        let (frame, matte) = render(&truth, GRAIN, 100 + k);
        let track = t.track(rgb(&frame), with_matte.then_some(&matte), &Start::default()).unwrap();
        let error = corner_error(&track.motion, &truth);
        assert!(error < 1.0, "warp {k} of level {level}: corner error {error} px, {track:?}");
        assert!(track.is_converged(), "{track:?}");
        errors.push(error);
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[3] <= median, "median corner error {} px of {errors:?}", errors[3]);
}

#[test]
fn small_warps_of_the_hat_are_found() {
    known_warps(0, 0.12, true);
}

#[test]
fn middling_warps_of_the_hat_are_found() {
    known_warps(1, 0.15, true);
}

#[test]
fn large_warps_of_the_hat_are_found() {
    known_warps(2, 0.35, true);
}

#[test]
fn small_warps_are_found_without_a_matte_of_the_frame() {
    known_warps(0, 0.12, false);
}

#[test]
fn an_unmoved_frame_gives_the_identity() {
    let t = texture_track(&identity(), &Options::default());
    assert!(t.is_converged() && texture_error(&t.motion, &identity()) < 1e-6 && t.dissimilarity < 1e-6, "{t:?}");
}

#[test]
fn models_recover_their_own_motions_exactly() {
    let (s, c) = libm::sincos(0.1);
    let turn = Matrix2::new(c, -s, s, c);
    let cases = [
        (Model::Translation, around(Matrix2::identity(), 3.4, -2.6)),
        (Model::Rigid, around(turn, 3.4, -2.6)),
        (Model::Similarity, around(turn * 1.08, 3.4, -2.6)),
        (Model::Affine, around(Matrix2::new(1.07, 0.05, -0.03, 0.94), 3.4, -2.6)),
    ];
    for (i, (_, motion)) in cases.iter().enumerate() {
        for (model, _) in &cases[i..] {
            let t = texture_track(motion, &Options { model: *model, tone: Tone::Linear, ..Options::default() });
            let error = texture_error(&t.motion, motion);
            assert!(error < 0.03, "motion {i} by {model:?}: {error} px, {t:?}");
            let own = project(&t.motion, *model, [80.0, 70.0]);
            assert!(texture_error(&t.motion, &own) < 1e-9, "{model:?} left its own set");
        }
    }
}

#[test]
fn a_long_jump_is_found_by_the_search_alone() {
    let motion = around(Matrix2::identity(), 27.0, -22.0);
    let track = |search| texture_track(&motion, &Options { search, ..Options::default() });
    assert!(texture_error(&track(Search::Radius(32.0)).motion, &motion) < 0.03);
    assert!(texture_error(&track(Search::Auto).motion, &motion) < 0.03);
    assert!(texture_error(&track(Search::Whole).motion, &motion) < 0.03);
}

#[test]
fn constant_velocity_reaches_where_no_search_looks() {
    let at = |k: f64| around(Matrix2::identity(), 13.0 * k, 9.0 * k);
    let (a, b) = (texture(160, 140, &identity()), texture(160, 140, &at(2.0)));
    let options = Options { search: Search::None, levels: 2, ..Options::default() };
    let start = Start { last: at(1.0), before: Some(identity()) };
    let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &options).unwrap();
    assert!(texture_error(&t.track(grey(&b, 160), None, &start).unwrap().motion, &at(2.0)) < 0.03);
    let still = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &Options { velocity: false, ..options }).unwrap();
    assert!(texture_error(&still.track(grey(&b, 160), None, &start).unwrap().motion, &at(2.0)) > 1.0);
}

#[test]
fn frames_of_other_offsets_give_the_shifted_motion() {
    let motion = around(Matrix2::new(1.03, 0.02, 0.01, 0.98), 2.3, 1.7);
    let moved = compose(&Affine::new(1.0, 0.0, 8.0, 0.0, 1.0, 4.0), &motion);
    let (a, b) = (texture_track(&motion, &Options::default()), texture_track(&moved, &Options::default()));
    let back = shifted(&b.motion, -8.0, -4.0);
    assert!(texture_error(&a.motion, &back) < 0.02, "{a:?} {b:?}");
}

#[test]
fn linear_tone_does_not_depend_on_the_scale_of_the_samples() {
    let motion = around(Matrix2::new(1.03, 0.02, 0.01, 0.98), 2.3, 1.7);
    let (a, b) = (texture(160, 140, &identity()), texture(160, 140, &motion));
    let options = Options { tone: Tone::Linear, ..Options::default() };
    let track = |k: f32| {
        let (a, b): (Vec<f32>, Vec<f32>) = (a.iter().map(|v| v * k).collect(), b.iter().map(|v| v * k).collect());
        let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &options).unwrap();
        t.track(grey(&b, 160), None, &Start::default()).unwrap()
    };
    let one = track(1.0);
    for k in [1.0 / 1024.0, 255.0, 0.001] {
        assert!(texture_error(&track(k).motion, &one.motion) < 1e-3, "scale {k}");
    }
}

#[test]
fn a_fade_is_followed_with_gain_and_without_it_is_unlike() {
    let motion = around(Matrix2::new(1.03, 0.02, 0.01, 0.98), 2.3, 1.7);
    let a = texture(160, 140, &identity());
    let b: Vec<f32> = texture(160, 140, &motion).iter().map(|v| 0.5 * v + 0.3).collect();
    let run = |gain| {
        let options = Options { gain, tone: Tone::Linear, ..Options::default() };
        let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &options).unwrap();
        t.track(grey(&b, 160), None, &Start::default()).unwrap()
    };
    let with = run(true);
    assert!(with.is_converged() && texture_error(&with.motion, &motion) < 0.03, "{with:?}");
    let without = run(false);
    assert!(without.dissimilarity > 5.0 * with.dissimilarity, "{without:?} {with:?}");
}

#[test]
fn robust_weights_ignore_an_occluder() {
    let motion = around(Matrix2::new(1.02, 0.01, 0.0, 0.99), 1.3, 0.7);
    let (a, mut b) = (texture(160, 140, &identity()), texture(160, 140, &motion));
    for y in 60..100 {
        b[y * 160 + 50..y * 160 + 85].fill(0.95);
    }
    let error = |robust| {
        let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &Options { robust, ..Options::default() }).unwrap();
        texture_error(&t.track(grey(&b, 160), None, &Start::default()).unwrap().motion, &motion)
    };
    assert!(error(Robust::GemanMcclure) < 0.05, "{}", error(Robust::GemanMcclure));
    assert!(error(Robust::Huber) < 0.5 * error(Robust::None));
}

#[test]
fn copies_of_a_channel_change_nothing() {
    let motion = around(Matrix2::new(1.03, 0.02, 0.01, 0.98), 2.3, 1.7);
    let (a, b) = (texture(160, 140, &identity()), texture(160, 140, &motion));
    let four = |d: &[f32]| -> Vec<f32> { d.iter().flat_map(|&v| [v, v, v, 1.0]).collect() };
    let (a4, b4) = (four(&a), four(&b));
    let t = Template::new(Raster::new(&a4, 160, 140, 4).unwrap(), Region::Box([40.0, 35.0, 120.0, 105.0]), &Options::default()).unwrap();
    let track = t.track(Raster::new(&b4, 160, 140, 4).unwrap(), None, &Start::default()).unwrap();
    assert_eq!(track, texture_track(&motion, &Options::default()));
}

#[test]
fn degenerate_input_has_a_status_and_never_panics() {
    let a = texture(160, 140, &identity());
    let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &Options::default()).unwrap();
    let go = |d: &[f32], w: usize, s: &Start| t.track(grey(d, w), None, s).unwrap();
    let start = Start::default();
    assert_eq!(go(&vec![f32::NAN; 160 * 140], 160, &start).status, Status::NotFinite);
    assert_eq!(go(&vec![0.5; 160 * 140], 160, &start).status, Status::Unlike);
    let gone = Start { last: around(Matrix2::identity(), 4000.0, 0.0), before: None };
    let off = go(&a, 160, &gone);
    assert_eq!((off.status, off.motion), (Status::OffFrame, gone.last));
    for last in [Affine::zeros(), Affine::from_element(f64::NAN), Affine::from_element(1e300)] {
        assert!(go(&a, 160, &Start { last, before: Some(last) }).is_converged());
    }
    for (w, h) in [(2, 2), (3, 2), (2, 5), (17, 1000)] {
        let status = go(&vec![0.5; w * h], w, &start).status;
        assert!(status != Status::Converged, "{w}x{h} {status:?}");
    }
}

#[test]
fn not_a_number_samples_are_outliers() {
    let motion = around(Matrix2::identity(), 2.3, 1.7);
    let (a, mut b) = (texture(160, 140, &identity()), texture(160, 140, &motion));
    for i in (0..b.len()).step_by(97) {
        b[i] = if i % 2 == 0 { f32::NAN } else { f32::INFINITY };
    }
    let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &Options::default()).unwrap();
    let track = t.track(grey(&b, 160), None, &Start::default()).unwrap();
    assert!(texture_error(&track.motion, &motion) < 0.1, "{track:?}");
}

#[test]
fn a_stripe_pattern_leaves_the_unseen_direction_alone() {
    let stripes = |dx: f64| -> Vec<f32> {
        (0..160 * 140)
            .map(|i| (0.5 + 0.3 * libm::sin((((i % 160) as f64) - dx) * 0.2 + (((i % 160) as f64) - dx) * 0.003)) as f32)
            .collect()
    };
    let (a, b) = (stripes(0.0), stripes(2.0));
    let options = Options { tone: Tone::Linear, search: Search::None, ..Options::default() };
    let t = Template::new(grey(&a, 160), Region::Box([40.0, 35.0, 120.0, 105.0]), &options).unwrap();
    let track = t.track(grey(&b, 160), None, &Start::default()).unwrap();
    assert_eq!(track.status, Status::Underdetermined);
    assert!((track.motion[(0, 2)] - 2.0).abs() < 0.2 && track.motion[(1, 2)].abs() < 1e-3, "{track:?}");
}

#[test]
fn wrong_input_is_told_in_words() {
    let a = texture(16, 16, &identity());
    let new = |region, o: &Options| Template::new(grey(&a, 16), region, o).map(|_| ()).unwrap_err().to_string();
    let d = Options::default();
    assert_eq!(new(Region::Matte(&a[1..]), &d), "expected a matte of 256 samples, one a pixel, found 255");
    let empty = "expected a region with at least one pixel inside the reference, found none: check the matte or the box";
    assert_eq!(new(Region::Matte(&[0.0; 256]), &d), empty);
    assert_eq!(new(Region::Matte(&[f32::NAN; 256]), &d), empty);
    assert_eq!(new(Region::Box([20.0, 20.0, 30.0, 30.0]), &d), empty);
    assert_eq!(new(Region::Box([f64::NAN; 4]), &d), empty);
    assert_eq!(new(Region::Whole, &Options { sigma: f64::NAN, ..d.clone() }), "expected sigma from 0 to 8, found NaN");
    assert_eq!(new(Region::Whole, &Options { levels: 0, ..d.clone() }), "expected levels from 1 to 10, found 0");
    let flat = vec![0.5; 256];
    let flat = Template::new(grey(&flat, 16), Region::Whole, &d).map(|_| ()).unwrap_err();
    assert_eq!(flat, TrackError::Textureless);
    let t = Template::new(grey(&a, 16), Region::Whole, &d).unwrap();
    let other = t.track(Raster::new(&a, 16, 8, 2).unwrap(), None, &Start::default()).unwrap_err();
    assert_eq!(other.to_string(), "expected 1 channels as in the reference, found 2");
    let short = t.track(grey(&a, 16), Some(&a[1..]), &Start::default()).unwrap_err();
    assert_eq!(short, TrackError::Matte { expected: 256, found: 255 });
}

#[test]
fn moments_carry_an_ellipse_onto_its_image() {
    let motion = around(Matrix2::new(1.2, 0.3, -0.2, 0.8), 5.0, -3.0);
    let ellipse = |m: &Affine| -> Vec<f32> {
        let inverse = invert(m).unwrap();
        (0..160 * 140)
            .map(|i| {
                let p = apply(&inverse, nalgebra::Vector2::new((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5));
                f32::from(((p.x - 80.0) / 30.0).powi(2) + ((p.y - 70.0) / 18.0).powi(2) < 1.0)
            })
            .collect()
    };
    let (a, mut b) = (moments(&ellipse(&identity()), 160).unwrap(), ellipse(&motion));
    b[0..40].fill(1.0);
    let b = moments(&b, 160).unwrap();
    let closest = carrying(&a, &b, 360).iter().map(|m| texture_error(m, &motion)).fold(f64::INFINITY, f64::min);
    assert!(closest < 0.7, "{closest} px");
    assert!(moments(&[0.0; 64], 8).is_none() && moments(&[], 8).is_none() && moments(&[1.0], 0).is_none());
}

/// A flat red drawing without grey edges on white, and its matte: an ellipse of semi-axes `r` about `c`.
fn drawn_ball(c: [f64; 2], r: [f64; 2]) -> (Vec<f32>, Vec<f32>) {
    let inside = |i: usize| {
        let (x, y) = ((i % 82) as f64 + 0.5 - c[0], (i / 82) as f64 + 0.5 - c[1]);
        (x / r[0]).powi(2) + (y / r[1]).powi(2) < 1.0
    };
    let matte: Vec<f32> = (0..82 * 82).map(|i| f32::from(u8::from(inside(i)))).collect();
    (matte.iter().flat_map(|&m| [1.0 - 0.15 * m, 1.0 - 0.99 * m, 1.0 - 0.98 * m]).collect(), matte)
}

#[test]
fn a_ball_without_features_squashes_and_does_not_turn() {
    let drawings = [
        ([36.2, 58.7], [9.4, 9.4]),
        ([35.1, 50.3], [9.2, 9.7]),
        ([37.9, 44.6], [9.6, 9.3]),
        ([36.8, 52.2], [8.4, 10.6]),
        ([36.4, 58.3], [9.5, 9.4]),
        ([36.5, 60.9], [12.0, 7.4]),
        ([40.5, 54.1], [9.4, 9.4]),
    ];
    let (reference, matte) = drawn_ball(drawings[0].0, drawings[0].1);
    fn ball(data: &[f32]) -> Raster<'_> {
        Raster::new(data, 82, 82, 3).unwrap()
    }
    let t = Template::new(ball(&reference), Region::Matte(&matte), &Options::default()).unwrap();
    let mut start = Start::default();
    for (k, (centre, radii)) in drawings.into_iter().enumerate() {
        let (frame, matte) = drawn_ball(centre, radii);
        let m = t.track(ball(&frame), Some(&matte), &start).unwrap();
        let turned = libm::atan2(m.motion[(1, 0)] - m.motion[(0, 1)], m.motion[(0, 0)] + m.motion[(1, 1)]).to_degrees();
        assert!(turned.abs() < 6.0, "drawing {k} turned by {turned} degrees: {m:?}");
        let (sx, sy) = (m.motion[(0, 0)] * 9.4 / radii[0], m.motion[(1, 1)] * 9.4 / radii[1]);
        assert!((sx - 1.0).abs() < 0.06 && (sy - 1.0).abs() < 0.06, "drawing {k} is {sx} by {sy} of what is drawn: {m:?}");
        let at = apply(&m.motion, Vector2::from(drawings[0].0)) - Vector2::from(centre);
        assert!(at.norm() < 0.5, "drawing {k} is off by {at}: {m:?}");
        start = Start { last: m.motion, before: (k > 0).then_some(start.last) };
    }
}

#[test]
fn the_calmest_map_between_moments_keeps_the_turn_and_nothing_else() {
    let disc = Moments { mass: 100.0, centre: Vector2::new(10.0, 20.0), spread: Matrix2::identity() * 25.0 };
    let (s, c) = libm::sincos(0.4);
    let turn = Matrix2::new(c, -s, s, c);
    let squashed = Moments { mass: 100.0, centre: Vector2::new(14.0, 18.0), spread: Matrix2::new(36.0, 5.0, 5.0, 16.0) };
    let last = Affine::from_columns(&[turn.column(0).into(), turn.column(1).into(), Vector2::zeros()]);
    let m = transport(&disc, &squashed, &last).unwrap();
    let linear = m.fixed_view::<2, 2>(0, 0).into_owned();
    let stretch = linear * turn.transpose();
    assert!((stretch - stretch.transpose()).norm() < 1e-12, "{stretch}");
    assert!((linear * disc.spread * linear.transpose() - squashed.spread).norm() < 1e-9);
    assert!((apply(&m, disc.centre) - squashed.centre).norm() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn any_frame_and_start_are_survived(
        w in 2usize..40, h in 2usize..40, seed in any::<u64>(), scale in -3.0f64..3.0, shift in -50.0f64..50.0,
        levels in 1usize..10, sigma in 0.0f64..3.0, channels in 1usize..5,
    ) {
        let mut rng = Random(seed);
        let mut picture = |n: usize| -> Vec<f32> { (0..n).map(|_| rng.normal() as f32).collect() };
        let (a, b, m) = (picture(w * h * channels), picture(h * w * channels), picture(w * h));
        let options = Options { levels, sigma, gain: seed % 2 == 0, ..Options::default() };
        let last = Affine::new(scale, 0.2, shift, 0.1, 1.0, -shift);
        if let Ok(t) = Template::new(Raster::new(&a, w, h, channels).unwrap(), Region::Matte(&m), &options) {
            let frame = Raster::new(&b, h, w, channels).unwrap();
            let track = t.track(frame, Some(&m), &Start { last, before: Some(identity()) }).unwrap();
            prop_assert!(track.motion.iter().all(|v| v.is_finite()));
        }
    }
}
