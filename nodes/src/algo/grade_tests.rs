//! Tests of the point operations.

use super::super::raster::Raster;
use super::*;
use proptest::prelude::*;

#[test]
fn grade_in_its_order() {
    let settings = Grade {
        black_point: [0.1; 4],
        white_point: [0.9; 4],
        lift: [0.05; 4],
        gain: [1.2; 4],
        multiply: [2.0; 4],
        offset: [0.01; 4],
        gamma: [2.0; 4],
        ..Grade::default()
    };
    let mut pixels = [0.1_f32, 0.9, 0.5, 0.5];
    grade(&mut pixels, 4, 3, &settings).unwrap();
    // Black point to lift, white point to gain, times 2, plus 0.01, square root.
    let expected = [0.11_f64.sqrt(), 2.41_f64.sqrt(), 1.26_f64.sqrt(), 0.5];
    for (v, e) in pixels.iter().zip(expected) {
        assert!((f64::from(*v) - e).abs() < 1e-6, "{v} for {e}");
    }
}

#[test]
fn grade_clamps_and_defaults() {
    let data = [-0.5_f32, 0.3, 1.5, 0.2];
    let mut pixels = data;
    grade(&mut pixels, 4, 4, &Grade { clamp_black: false, ..Grade::default() }).unwrap();
    assert_eq!(pixels, data);
    grade(&mut pixels, 4, 4, &Grade { clamp_white: true, ..Grade::default() }).unwrap();
    assert_eq!(pixels, [0.0, 0.3, 1.0, 0.2]);
    let mut nothing: [f32; 0] = [];
    grade(&mut nothing, 0, 3, &Grade::default()).unwrap();
}

#[test]
fn grade_refuses() {
    let run = |g: Grade| grade(&mut [0.0; 4], 4, 3, &g).unwrap_err().to_string();
    assert_eq!(run(Grade { gamma: [0.0; 4], ..Grade::default() }), "expected a gamma above 0, found 0");
    assert_eq!(
        run(Grade { white_point: [0.0; 4], ..Grade::default() }),
        "expected a white point apart from the black point, found both at 0"
    );
    assert_eq!(run(Grade { lift: [f32::NAN; 4], ..Grade::default() }), "expected finite values, found NaN or infinity");
}

#[test]
fn shuffles_and_crops() {
    let mut out = [0.0; 6];
    shuffle(&[1.0, 2.0, 3.0, 4.0], 2, &[Channel::From(1), Channel::Value(9.0), Channel::From(0)], &mut out).unwrap();
    assert_eq!(out, [2.0, 9.0, 1.0, 4.0, 9.0, 3.0]);
    assert_eq!(shuffle(&[1.0], 1, &[Channel::From(1)], &mut [0.0]), Err(GradeError::Channel { channels: 1, found: 1 }));
    let data = [1.0, 2.0, 3.0, 4.0];
    let from = Source::new(Raster::new(&data, 2, 2, 1).unwrap(), [0, 0]);
    let mut out = [7.0; 4];
    crop(from, &mut out, Window::new(1, 1, 2, 2)).unwrap();
    assert_eq!(out, [4.0, 0.0, 0.0, 0.0]);
    crop(from, &mut out, Window::new(-9, 1, 2, 2)).unwrap();
    assert_eq!(out, [0.0; 4]);
    assert!(crop(from, &mut out, Window::new(0, 0, 1, 1)).is_err());
}

#[test]
fn alpha_of_zero_is_left_alone() {
    let mut pixels = [0.3, 0.2, 0.1, 0.0];
    unpremultiply(&mut pixels, 4, 3);
    assert_eq!(pixels, [0.3, 0.2, 0.1, 0.0]);
    premultiply(&mut pixels, 4, 9);
    assert_eq!(pixels, [0.3, 0.2, 0.1, 0.0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Every picture that is a product of colour and alpha comes back exactly.
    #[test]
    fn premultiplied_round_trip_is_exact(color in proptest::array::uniform3(0.0_f32..4.0), alpha in 1e-6_f32..=1.0) {
        let mut pixel = [color[0], color[1], color[2], alpha];
        premultiply(&mut pixel, 4, 3);
        let kept = pixel;
        unpremultiply(&mut pixel, 4, 3);
        premultiply(&mut pixel, 4, 3);
        prop_assert_eq!(pixel, kept);
    }
}
