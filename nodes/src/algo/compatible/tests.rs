use super::*;
use std::f64::consts::TAU;

/// A small generator, so that cases are the same everywhere.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1_u64 << 31) as f64
    }
}

/// Points at random distances from a middle: spikes of any length next to each other.
fn star(random: &mut Random, n: usize) -> Vec<Point> {
    let place = |i: usize, random: &mut Random| {
        let (angle, far) = ((i as f64 + 0.8 * random.unit()) * TAU / n as f64, 20.0 + 80.0 * random.unit());
        [far * libm::cos(angle), far * libm::sin(angle)]
    };
    (0..n).map(|i| place(i, random)).collect()
}

/// A ribbon that winds up to twice around.
fn spiral(random: &mut Random, n: usize) -> Vec<Point> {
    let (turn, half) = ((random.unit() - 0.5) * 14.0, n / 2);
    let mut at = [0.0; 2];
    let mut sides = (Vec::new(), Vec::new());
    for i in 0..half {
        let t = i as f64 / half as f64;
        let (sin, cos) = libm::sincos(turn * t * (0.3 + t));
        at = [at[0] + 10.0 * (1.2 - t) * cos, at[1] + 10.0 * (1.2 - t) * sin];
        let width = 3.0 * (1.1 - t);
        sides.0.push([at[0] + width * sin, at[1] - width * cos]);
        sides.1.push([at[0] - width * sin, at[1] + width * cos]);
    }
    sides.0.extend(sides.1.into_iter().rev());
    sides.0
}

fn assert_fills(mesh: &Compatible, contours: &[&[Point]]) {
    let n = contours[0].len();
    for (points, contour) in mesh.points.iter().zip(contours) {
        assert_eq!(&points[..n], *contour);
        assert!(mesh.triangles.iter().all(|t| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            orient(a, b, c) > 0.0
        }));
        let area = |p: &[Point], i: usize, j: usize| cross(p[i], p[j]) / 2.0;
        let whole: f64 = (0..n).map(|i| area(contour, i, (i + 1) % n)).sum();
        let parts: f64 =
            mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(|(i, j)| area(points, i as usize, j as usize)).sum();
        assert!((whole.abs() - parts).abs() < 1e-9 * parts, "{whole} {parts}");
    }
    // Euler's formula for a disc: nothing is left out and nothing covered twice.
    assert_eq!(mesh.triangles.len(), 2 * mesh.points[0].len() - 2 - n);
}

#[test]
fn five_hundred_random_pairs_are_filled_upright() {
    let mut random = Random(7);
    let mut angles = Vec::new();
    while angles.len() < 500 {
        let k = angles.len();
        let n = [8, 12, 16, 24, 30][k % 5];
        let (a, b) = match k % 3 {
            0 => (star(&mut random, n), star(&mut random, n)),
            1 => (spiral(&mut random, n), spiral(&mut random, n)),
            _ => (star(&mut random, n), spiral(&mut random, n)),
        };
        match triangulate(&[&a, &b], Options::default()) {
            Ok(mesh) => {
                assert_fills(&mesh, &[&a, &b]);
                angles.push(mesh.min_angle(0).min(mesh.min_angle(1)));
            }
            // A ribbon that winds tightly runs into itself.
            Err(error) => assert!(matches!(error, CompatibleError::Crossing { .. }), "{k}: {error}"),
        }
    }
    angles.sort_by(f64::total_cmp);
    assert!(angles[0] > 0.0 && angles[250].to_degrees() > 2.0, "{} {}", angles[0], angles[250].to_degrees());
}

#[test]
fn many_contours_at_once_are_filled() {
    let mut random = Random(3);
    let all: Vec<Vec<Point>> = (0..5).map(|_| star(&mut random, 14)).collect();
    let views: Vec<&[Point]> = all.iter().map(Vec::as_slice).collect();
    assert_fills(&triangulate(&views, Options::default()).unwrap(), &views);
}

fn circle(n: usize, radius: f64) -> Vec<Point> {
    (0..n).map(|i| i as f64 * TAU / n as f64).map(|a| [radius * libm::cos(a), radius * libm::sin(a)]).collect()
}

#[test]
fn round_shapes_get_good_angles() {
    let (a, mut b) = (circle(48, 50.0), circle(48, 50.0));
    b.iter_mut().for_each(|p| *p = [1.5 * p[0], 0.8 * p[1] + 0.004 * p[0] * p[0]]);
    let mesh = triangulate(&[&a, &b], Options::default()).unwrap();
    assert_fills(&mesh, &[&a, &b]);
    assert!(mesh.min_angle(0).to_degrees() > 20.0 && mesh.min_angle(1).to_degrees() > 20.0, "{} {}", mesh.min_angle(0), mesh.min_angle(1));
}

#[test]
fn straight_runs_and_contours_the_other_way_round_are_filled() {
    let mut square: Vec<Point> = Vec::new();
    for [a, b] in [[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 4.0]], [[4.0, 4.0], [0.0, 4.0]], [[0.0, 4.0], [0.0, 0.0]]] {
        square.extend((0..4).map(|i| lerp(a, b, i as f64 / 4.0)));
    }
    let turned: Vec<Point> = square.iter().rev().copied().collect();
    assert_fills(&triangulate(&[&square, &square], Options::default()).unwrap(), &[&square, &square]);
    assert_fills(&triangulate(&[&turned], Options::default()).unwrap(), &[&turned]);
}

#[test]
fn size_does_not_matter() {
    let mut random = Random(11);
    let (a, b) = (star(&mut random, 20), star(&mut random, 20));
    let base = triangulate(&[&a, &b], Options::default()).unwrap();
    // Powers of two scale without rounding.
    for scale in [(-30_f64).exp2(), 30_f64.exp2()] {
        let scaled = |p: &[Point]| p.iter().map(|p| p.map(|v| v * scale)).collect::<Vec<_>>();
        let found = triangulate(&[&scaled(&a), &scaled(&b)], Options::default()).unwrap();
        assert_eq!(found.triangles, base.triangles);
    }
}

#[test]
fn what_has_no_inside_is_refused() {
    let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
    let fails = |contours: &[&[Point]]| triangulate(contours, Options::default()).unwrap_err();
    assert_eq!(fails(&[]), CompatibleError::Empty);
    assert_eq!(fails(&[&square[..2]]), CompatibleError::Points { found: 2 });
    assert_eq!(fails(&[&square, &square[..3]]), CompatibleError::Count { contour: 1, expected: 4, found: 3 });
    let bad = [[0.0, 0.0], [4.0, f64::NAN], [4.0, 4.0], [0.0, 4.0]];
    assert_eq!(fails(&[&square, &bad]), CompatibleError::NotFinite { contour: 1, point: 1 });
    let bow = [[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]];
    assert_eq!(fails(&[&bow]), CompatibleError::Crossing { contour: 0, first: 0, second: 2 });
    let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]];
    assert_eq!(fails(&[&line]), CompatibleError::Flat { contour: 0 });
    let mut turned = square;
    turned.reverse();
    assert_eq!(fails(&[&square, &turned]), CompatibleError::Mirrored { contour: 1 });
    let twice = [[0.0, 0.0], [4.0, 0.0], [4.0, 0.0], [0.0, 4.0]];
    assert_eq!(fails(&[&twice]), CompatibleError::Crossing { contour: 0, first: 1, second: 2 });
}
