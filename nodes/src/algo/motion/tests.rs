//! Filters against closed forms.

use super::cartoon::{anticipate, spring};
use super::exaggerate::{Amounts, Rest, exaggerate};
use super::pin::{Pinned, Pinning, misses, shifts};
use super::smooth::Smooth;
use super::*;
use crate::algo::raster::{Affine, apply, identity};
use nalgebra::{Matrix2, Vector2};

const SMOOTH: Smooth = Smooth { window: 6.0, keep: 3.0 };

fn times(n: usize) -> Vec<f64> {
    (0..n).map(|k| k as f64).collect()
}

/// Nearly normal noise of deviation 1, from a fixed seed.
fn noise(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    (0..n).map(|_| (0..12).map(|_| next()).sum()).collect()
}

/// Height of a ball that bounces every 16 frames, 100 high.
fn bounce(n: usize) -> Vec<f64> {
    (0..n).map(|k| k as f64 % 16.0 / 8.0 - 1.0).map(|t| 100.0 * (1.0 - t * t)).collect()
}

fn second_energy(x: &[f64]) -> f64 {
    x.windows(3).map(|w| w[2] - 2.0 * w[1] + w[0]).map(|d| d * d).sum()
}

fn gap(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

#[test]
fn lines_and_parabolas_are_not_smoothed() {
    let parabola: Vec<f64> = (0..40).map(|k| 3.0 + 0.5 * k as f64 - 0.25 * (k * k) as f64).collect();
    let found = SMOOTH.apply(std::slice::from_ref(&parabola), &times(40), &[false; 40]);
    assert!(gap(&found[0], &parabola).iter().all(|d| d.abs() < 1e-9), "{found:?}");
    let uneven = [0.0, 1.0, 3.5, 4.0, 6.0, 9.0, 9.5, 12.0];
    let curve: Vec<f64> = uneven.iter().map(|t| 2.0 - 3.0 * t + t * t).collect();
    let found = SMOOTH.apply(std::slice::from_ref(&curve), &uneven, &[false; 8]);
    assert!(gap(&found[0], &curve).iter().all(|d| d.abs() < 1e-9));
}

#[test]
fn jitter_goes_and_a_bounce_keeps_its_height_and_its_contacts() {
    let n = 97;
    let truth = bounce(n);
    for seed in 1..6 {
        let rough: Vec<f64> = truth.iter().zip(noise(n, seed)).map(|(x, e)| x + e).collect();
        let found = SMOOTH.apply(std::slice::from_ref(&rough), &times(n), &vec![false; n]).remove(0);
        let (before, after) = (second_energy(&gap(&rough, &truth)), second_energy(&gap(&found, &truth)));
        assert!(before > 5.0 * after, "seed {seed}: {before} to {after}");
        for k in (8..n).step_by(16) {
            assert!(found[k] > 95.0, "seed {seed}: apex {k} at {}", found[k]);
        }
        for k in (16..n - 1).step_by(16) {
            assert!(found[k] < 5.0, "seed {seed}: contact {k} at {}", found[k]);
        }
    }
}

#[test]
fn pinned_frames_stay_and_what_is_shared_is_weighed_together() {
    let rough = noise(50, 9);
    let mut pinned = [false; 50];
    pinned[20] = true;
    let found = SMOOTH.apply(&[rough.clone(), rough.iter().map(|v| 1.0 - v).collect()], &times(50), &pinned);
    assert_eq!(found[0][20], rough[20]);
    assert!((0..50).all(|k| (found[0][k] + found[1][k] - 1.0).abs() < 1e-9), "sums stay");
}

#[test]
fn a_still_curve_with_one_move_is_left_alone() {
    let mut step = vec![0.0; 40];
    step[20..].fill(7.0);
    let found = SMOOTH.apply(&[step.clone()], &times(40), &[false; 40]).remove(0);
    assert!(gap(&found, &step).iter().all(|d| d.abs() < 1e-9), "{found:?}");
}

#[test]
fn a_move_is_anticipated_and_overshot_as_the_filter_says() {
    let n = 81;
    let step: Vec<f64> = (0..n).map(|k| if k < 40 { 0.0 } else { 1.0 }).collect();
    let found = anticipate(&step, &times(n), 1.0, 3.0);
    // The step lies at 39.5; G' there is the closed form.
    for (k, x) in found.iter().enumerate() {
        let t = k as f64 - 39.5;
        let slope = -t * libm::exp(-t * t / 18.0) / (libm::sqrt(std::f64::consts::TAU) * 3.0);
        assert!((x - (step[k] - slope)).abs() < 1e-9, "{k}: {x}");
    }
    assert!(found[36] < -0.2 && found[43] > 1.2, "{} {}", found[36], found[43]);
    let line: Vec<f64> = (0..n).map(|k| 2.0 * k as f64).collect();
    let kept = anticipate(&line, &times(n), 1.0, 3.0);
    assert!((24..57).all(|k| (kept[k] - line[k]).abs() < 1e-9), "a steady pace stays");
    assert_eq!(anticipate(&step, &times(n), 0.0, 3.0), step);
}

#[test]
fn a_spring_swings_as_its_closed_form() {
    let n = 60;
    let mut step = vec![1.0; n];
    step[0] = 0.0;
    // From frame 1 on a free swing; its start is solved for from two frames, the rest is held against it.
    let (period, damping) = (9.0, 0.25);
    let found = spring(&step, &times(n), period, damping);
    let omega = std::f64::consts::TAU / period;
    let rate = omega * libm::sqrt(1.0 - damping * damping);
    let basis = |k: usize| {
        let e = libm::exp(-damping * omega * (k - 1) as f64);
        (e * libm::cos(rate * (k - 1) as f64), e * libm::sin(rate * (k - 1) as f64))
    };
    let a = found[1] - 1.0;
    let b = (found[2] - 1.0 - a * basis(2).0) / basis(2).1;
    for (k, x) in found.iter().enumerate().skip(1) {
        let (c, s) = basis(k);
        assert!((x - 1.0 - a * c - b * s).abs() < 1e-9, "{k}: {x}");
    }
    assert!(found.iter().fold(0.0f64, |m, v| m.max(*v)) > 1.2, "it overshoots");
    let still = vec![4.0; 10];
    assert_eq!(spring(&still, &times(10), 9.0, 0.3), still);
    let calm = spring(&step, &times(n), period, 1.0);
    assert!(calm.iter().all(|v| *v <= 1.0 + 1e-12), "critical damping does not overshoot");
    assert!(spring(&step, &times(n), period, 3.0).windows(2).all(|w| w[1] >= w[0] - 1e-12));
}

#[test]
fn exaggeration_keeps_areas_and_sums() {
    let map = |turn: f64, stretch: f64, x: f64| {
        let (s, c) = libm::sincos(turn);
        let linear = Matrix2::new(c, -s, s, c) * Matrix2::new(stretch, 0.0, 0.0, 1.0 / stretch);
        let t = Vector2::new(x, 50.0) - linear * Vector2::new(10.0, 20.0);
        Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
    };
    let maps = [map(0.1, 1.1, 0.0), map(-0.1, 0.8, 30.0), map(0.3, 1.3, 60.0), map(-0.3, 1.0, 10.0)];
    let (split, mut groups) = Split::new(&maps, [10.0, 20.0]).unwrap();
    let amounts = Amounts { translation: 1.0, rotation: 1.0, squash: 1.0, size: 0.0, values: 1.0 };
    exaggerate(&mut groups, &amounts, Rest::Mean, [-0.5, 1.5]);
    let found = split.join(&groups);
    for (k, m) in found.iter().enumerate() {
        let area = m[(0, 0)] * m[(1, 1)] - m[(0, 1)] * m[(1, 0)];
        assert!((area - 1.0).abs() < 1e-12, "frame {k}: area {area}");
        let from = apply(&maps[k], Vector2::new(10.0, 20.0)).x;
        assert!((apply(m, Vector2::new(10.0, 20.0)).x - (2.0 * from - 25.0)).abs() < 1e-9);
    }
    assert!((libm::atan2(found[2][(1, 0)] - found[2][(0, 1)], found[2][(0, 0)] + found[2][(1, 1)]) - 0.6).abs() < 1e-9);
    let mut weights = vec![Group { kind: Kind::Weights, curves: vec![vec![1.0, 0.0, 0.2], vec![0.0, 1.0, 0.3], vec![0.0, 0.0, 0.5]] }];
    exaggerate(&mut weights, &amounts, Rest::Mean, [-0.5, 1.5]);
    for k in 0..3 {
        let all: Vec<f64> = weights[0].curves.iter().map(|c| c[k]).collect();
        assert!((all.iter().sum::<f64>() - 1.0).abs() < 1e-12 && all.iter().all(|w| (-0.5..=1.5).contains(w)), "{all:?}");
    }
}

#[test]
fn a_trend_is_not_exaggerated() {
    let walk: Vec<f64> = (0..20).map(|k| 5.0 * k as f64).collect();
    let mut groups = vec![Group { kind: Kind::Values, curves: vec![walk.clone()] }];
    let amounts = Amounts { translation: 1.0, rotation: 1.0, squash: 1.0, size: 1.0, values: 1.0 };
    exaggerate(&mut groups, &amounts, Rest::Trend, [-0.5, 1.5]);
    assert!(gap(&groups[0].curves[0], &walk).iter().all(|d| d.abs() < 1e-9));
}

#[test]
fn maps_come_back_from_their_parts_and_turns_do_not_jump() {
    let maps: Vec<Affine> = (0..40)
        .map(|k| {
            let t = f64::from(k);
            let (s, c) = libm::sincos(0.4 * t);
            let linear = Matrix2::new(c, -s, s, c) * Matrix2::new(1.0 + 0.3 * libm::sin(t), 0.2, 0.1, 1.0);
            Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), Vector2::new(t, -t)])
        })
        .collect();
    for mirror in [false, true] {
        let flip = Affine::new(-1.0, 0.0, 7.0, 0.0, 1.0, 0.0);
        let maps: Vec<Affine> = maps.iter().map(|m| if mirror { crate::algo::raster::compose(m, &flip) } else { *m }).collect();
        let (split, groups) = Split::new(&maps, [30.0, -12.0]).unwrap();
        let off = split.join(&groups).iter().zip(&maps).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        assert!(off < 1e-11, "{off}");
        assert!(groups[1].curves[0].windows(2).all(|w| (w[1] - w[0]).abs() < 1.0));
    }
}

#[test]
fn the_hinge_of_a_swing_is_found() {
    let swing = |angle: f64| {
        let (s, c) = libm::sincos(angle);
        let linear = Matrix2::new(c, -s, s, c);
        let t = Vector2::new(40.0, 90.0) - linear * Vector2::new(40.0, 90.0);
        Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
    };
    let found = still_point(&[swing(0.0), swing(0.2), swing(-0.3), swing(0.1)]);
    assert!((found[0] - 40.0).abs() < 1e-6 && (found[1] - 90.0).abs() < 1e-6, "{found:?}");
    assert_eq!(still_point(&[identity(), Affine::new(1.0, 0.0, 9.0, 0.0, 1.0, 2.0)]), [0.0, 0.0]);
}

#[test]
fn maps_that_cannot_be_taken_apart_are_named() {
    let flat = Affine::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    assert_eq!(Split::new(&[identity(), flat], [0.0; 2]), Err(SplitError::Flat { at: 1 }));
    assert_eq!(Split::new(&[identity(), Affine::new(-1.0, 0.0, 0.0, 0.0, 1.0, 0.0)], [0.0; 2]), Err(SplitError::Flat { at: 1 }));
    assert_eq!(Split::new(&[Affine::from_element(f64::NAN)], [0.0; 2]), Err(SplitError::NotFinite { at: 0 }));
    assert_eq!(Split::new(&[], [0.0; 2]).map(|s| s.1.len()), Ok(4));
}

#[test]
fn pinned_points_stand_and_shifts_between_are_smooth() {
    let path: Vec<[f64; 2]> = (0..30).map(|k| [4.0 * k as f64, 100.0]).collect();
    let pin = |first, last, target| Pinned { first, last, path: path.clone(), target };
    let pins = [pin(5, 9, None), pin(16, 20, Some([70.0, 98.0]))];
    let found = shifts(&pins, 30, &Pinning { blend: Some(4.0), ground: None });
    for k in 5..=9 {
        assert_eq!([path[k][0] + found[k][0], path[k][1] + found[k][1]], [20.0, 100.0]);
    }
    for k in 16..=20 {
        assert!((path[k][0] + found[k][0] - 70.0).abs() < 1e-12 && (found[k][1] + 2.0).abs() < 1e-12);
    }
    assert_eq!((found[0], found[29]), ([0.0, 0.0], [0.0, 0.0]));
    let (low, high) = (found[9][0].min(found[16][0]), found[9][0].max(found[16][0]));
    assert!((9..16).all(|k| (low..=high).contains(&found[k][0])), "nothing swings past the pins");
    assert!(misses(&pins, &found).iter().all(|m| *m < 1e-12));
}

#[test]
fn no_pinned_point_goes_below_the_ground() {
    let path: Vec<[f64; 2]> = (0..20).map(|k| [0.0, 100.0 + 12.0 * libm::sin(k as f64 * 0.7)]).collect();
    let pins = [Pinned { first: 3, last: 4, path: path.clone(), target: Some([0.0, 100.0]) }];
    let found = shifts(&pins, 20, &Pinning { blend: None, ground: Some(104.0) });
    assert!((0..20).all(|k| path[k][1] + found[k][1] <= 104.0 + 1e-12));
    assert!(misses(&pins, &found)[3] < 1e-12);
    assert!(shifts(&[], 3, &Pinning { blend: None, ground: None }).iter().all(|s| *s == [0.0, 0.0]));
}

#[test]
fn holds_are_one_drawing_each() {
    let holds = Holds::of(&[1.0, 1.0, 3.0, 3.0, 3.0, 6.0]);
    assert_eq!((holds.times.clone(), holds.first.clone()), (vec![0.5, 3.0, 5.0], vec![0, 2, 5]));
    assert_eq!(holds.frames(&holds.drawings(&[7.0, 7.5, 8.0, 8.0, 8.0, 9.0])), [7.0, 7.0, 8.0, 8.0, 8.0, 9.0]);
}

#[test]
fn weights_are_brought_back_with_the_least_change() {
    let mut w = [2.0, -0.2, -0.8];
    bounded(&mut w, -0.5, 1.5);
    assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12 && w[0] == 1.5 && w[2] == -0.5, "{w:?}");
    let mut fine = [0.5, 0.3, 0.2];
    bounded(&mut fine, -0.5, 1.5);
    assert!(gap(&fine, &[0.5, 0.3, 0.2]).iter().all(|d| d.abs() < 1e-15));
}
