//! Each sample belongs to one triangle; what is cut is what lies behind the eye.

use super::*;
use crate::algo::camera::{Orbit, orthographic, perspective};
use crate::algo::surface::{Part, Surface};
use nalgebra::Matrix4;

fn camera(projection: Matrix4<f64>, size: [i64; 2]) -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 5.0 };
    Camera::new(orbit.view(), projection, size).unwrap()
}

fn drawn(triangles: &[ScreenTriangle], origin: [usize; 2], width: usize, height: usize) -> (Vec<f32>, Vec<u32>) {
    let (mut near, mut id) = (vec![f32::NEG_INFINITY; width * height], vec![NONE; width * height]);
    let all: Vec<u32> = (0..triangles.len() as u32).collect();
    Rows { origin, width, near: &mut near, id: &mut id, reference: 0.0 }.draw(triangles, &all);
    (near, id)
}

fn flat(corners: [[f64; 2]; 3]) -> ScreenTriangle {
    ScreenTriangle { corners, near: [-1.0; 3], source: 0, piece: NONE }
}

/// Numbers that look random.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn triangles_around_a_point_share_all_samples_and_none_twice() {
    let mut random = numbers(7);
    for round in 0..20 {
        // Corners on a grid of 1/4 pixel put many of them, and of the edges, right on samples.
        let mut place = || [0.0; 2].map(|_: f64| if round % 2 == 0 { (random() * 200.0).floor() / 4.0 } else { random() * 50.0 });
        let middle = place();
        let rim = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]];
        let mut count = vec![0; 50 * 50];
        for i in 0..4 {
            let (_, id) = drawn(&[flat([middle, rim[i], rim[(i + 1) % 4]])], [0, 0], 50, 50);
            count.iter_mut().zip(id).for_each(|(n, id)| *n += u32::from(id != NONE));
        }
        assert!(count.iter().all(|&n| n == 1), "round {round}");
        let slot: Vec<u32> = (0..2500).collect();
        let mut samples = [[0; SAMPLES]; 2500];
        for i in 0..4 {
            let mut close = vec![Close::default(); 2500];
            let rows = Rows { origin: [0, 0], width: 50, near: &mut [0.0; 2500], id: &mut [0; 2500], reference: 0.0 };
            draw_close(&rows, &slot, &mut close, &[flat([middle, rim[i], rim[(i + 1) % 4]])], &[0]);
            samples.iter_mut().zip(close).for_each(|(n, c)| (0..SAMPLES).for_each(|s| n[s] += u32::from(c.id[s] != NONE)));
        }
        assert!(samples.iter().flatten().all(|&n| n == 1), "round {round}");
    }
}

#[test]
fn the_nearest_wins_and_the_first_of_equals() {
    let near = |near: f64| ScreenTriangle { near: [near; 3], ..flat([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]]) };
    let (depth, id) = drawn(&[near(-3.0), near(-2.0), near(-2.0), near(-4.0)], [0, 0], 4, 4);
    assert_eq!((depth[0], id[0]), (-2.0, 1));
}

#[test]
fn bands_of_rows_are_the_rows_of_the_whole() {
    let mut random = numbers(3);
    let mut triangle = || {
        let corners = [[0.0; 2]; 3].map(|c: [f64; 2]| c.map(|_| random() * 80.0 - 10.0));
        ScreenTriangle { near: [random(), random(), random()], ..flat(corners) }
    };
    let triangles: Vec<ScreenTriangle> = (0..200).map(|_| triangle()).collect();
    let (near, id) = drawn(&triangles, [3, 2], 50, 40);
    for (top, rows) in [(0, 7), (7, 20), (27, 13)] {
        let (n, i) = drawn(&triangles, [3, 2 + top], 50, rows);
        assert_eq!((&n[..], &i[..]), (&near[50 * top..][..50 * rows], &id[50 * top..][..50 * rows]));
    }
}

#[test]
fn what_lies_behind_the_eye_is_cut() {
    let lens = camera(perspective(1.0, [100, 100], 0.5, 50.0), [100, 100]);
    // A floor from before the eye to far behind it.
    let positions = [[-4.0, -1.0, 0.0], [4.0, -1.0, 0.0], [0.0, -1.0, 900.0]];
    let surface = Surface::new(&[Part { positions: &positions, triangles: &[[0, 1, 2]], normals: &[] }], 1.0).unwrap();
    let found = project(&surface, &lens);
    assert_eq!((found.triangles.len(), found.pieces.len()), (2, 2));
    for t in &found.triangles {
        assert!(t.near.iter().all(|&q| q > 0.0 && depth_of(q, false) >= 0.5 - 1e-9));
        for (corner, weights) in t.corners.iter().zip(&found.pieces[t.piece as usize]) {
            let world = [0, 1, 2].map(|k| (0..3).map(|i| weights[i] * positions[i][k]).sum());
            let [x, y, _] = lens.project(world);
            assert!((x - corner[0]).abs() < 1e-6 && (y - corner[1]).abs() < 1e-6);
        }
    }
    let behind = [[-4.0, -1.0, 6.0], [4.0, -1.0, 6.0], [0.0, 1.0, 900.0]];
    let surface = Surface::new(&[Part { positions: &behind, triangles: &[[0, 1, 2]], normals: &[] }], 1.0).unwrap();
    assert!(project(&surface, &lens).triangles.is_empty());
}

#[test]
fn triangles_that_reach_far_out_are_cut_at_the_guard() {
    let flat = camera(orthographic(10.0, [100, 100], 0.1, 100.0), [100, 100]);
    let positions = [[-1e7, -1e7, 0.0], [1e7, -1e7, 0.0], [0.0, 2e7, 0.0]];
    let surface = Surface::new(&[Part { positions: &positions, triangles: &[[0, 1, 2]], normals: &[] }], 1.0).unwrap();
    let found = project(&surface, &flat);
    assert!(found.triangles.iter().flat_map(|t| t.corners).flatten().all(|v| v.abs() <= GUARD + 1.0));
    let (_, id) = drawn(&found.triangles, [0, 0], 100, 100);
    assert!(id.iter().all(|&id| id != NONE));
}
