use super::*;
use crate::algo::compatible::dot;

/// A bar of 4 by 0.8 in 20 by 4 cells, bent into an arc of `angle`.
fn bar(angle: f64) -> Vec<Point> {
    let place = |i: usize, j: usize| {
        let (x, y) = (4.0 * i as f64 / 20.0, 0.2 * j as f64 - 0.4);
        if angle == 0.0 {
            return [x, y];
        }
        let (radius, (sin, cos)) = (4.0 / angle, libm::sincos(x * angle / 4.0));
        [(radius - y) * sin, radius - (radius - y) * cos]
    };
    (0..5).flat_map(|j| (0..21).map(move |i| place(i, j))).collect()
}

fn cells() -> Vec<[u32; 3]> {
    (0..4).flat_map(|j| (0..20).map(move |i| j * 21 + i)).flat_map(|a| [[a, a + 1, a + 22], [a, a + 22, a + 21]]).collect()
}

fn farthest(a: &[Point], b: &[Point]) -> f64 {
    a.iter().zip(b).map(|(p, q)| sub(*p, *q)).map(|d| dot(d, d).sqrt()).fold(0.0, f64::max)
}

fn turned(points: &[Point], angle: f64, about: Point) -> Vec<Point> {
    let (sin, cos) = libm::sincos(angle);
    let turn = |p: &Point| {
        let d = sub(*p, about);
        [about[0] + cos * d[0] - sin * d[1], about[1] + sin * d[0] + cos * d[1]]
    };
    points.iter().map(turn).collect()
}

const PAPER: Options = Options { symmetric: false, area_weights: true, gauge: Gauge::Vertex(0) };

/// The half bend is known: every cell turns and shears half as far, to second order in the size of a cell.
#[test]
fn a_bent_bar_goes_through_its_half_bend() {
    for (degrees, limit) in [(90.0_f64, 0.002), (180.0, 0.005), (270.0, 0.010), (340.0, 0.015)] {
        let (straight, bent) = (bar(0.0), bar(degrees.to_radians()));
        for symmetric in [false, true] {
            let arap = Arap::new(&cells(), &[&straight, &bent], Options { symmetric, ..PAPER }).unwrap();
            let half = &arap.between(&[0.5]).unwrap()[0];
            let (truth, at) = (bar(degrees.to_radians() / 2.0), half[0]);
            let moved: Vec<Point> = half.iter().map(|p| [p[0] - at[0] + truth[0][0], p[1] - at[1] + truth[0][1]]).collect();
            let off = farthest(&moved, &truth);
            assert!(off <= limit, "{degrees} {symmetric}: {off}");
            assert!(cells().iter().all(|t| double_area(corners(t, half)) > 0.0), "{degrees}");
        }
    }
}

#[test]
fn keys_come_back_as_they_are() {
    let keys = [bar(0.0), bar(2.0), bar(-1.0)];
    let arap = Arap::new(&cells(), &[&keys[0], &keys[1], &keys[2]], Options::default()).unwrap();
    let found = arap.blend(&[&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0], &[0.0, 0.0, 1.0]]).unwrap();
    assert_eq!(found, keys);
    // Next to a key the solve itself must be there too: nothing jumps.
    let near = arap.blend(&[&[1e-12, 1.0 - 1e-12, 0.0]]).unwrap();
    assert!(farthest(&near[0], &keys[1]) < 1e-9);
}

#[test]
fn a_turned_shape_turns() {
    let from = bar(1.0);
    for options in [Options::default(), PAPER] {
        for angle in [0.5, 3.0, -3.1] {
            let arap = Arap::new(&cells(), &[&from, &turned(&from, angle, [0.3, -2.0])], options).unwrap();
            let found = &arap.between(&[0.3]).unwrap()[0];
            let truth = turned(&from, 0.3 * angle, [0.0; 2]);
            let shift = sub(found[0], truth[0]);
            let moved: Vec<Point> = truth.iter().map(|p| [p[0] + shift[0], p[1] + shift[1]]).collect();
            assert!(farthest(found, &moved) < 1e-9, "{angle}");
        }
    }
}

#[test]
fn either_key_may_come_first() {
    let (a, b) = (bar(0.3), bar(2.5));
    let there = Arap::new(&cells(), &[&a, &b], Options::default()).unwrap().between(&[0.3]).unwrap();
    let back = Arap::new(&cells(), &[&b, &a], Options::default()).unwrap().between(&[0.7]).unwrap();
    assert!(farthest(&there[0], &back[0]) < 1e-12);
}

/// Moving, turning, scaling and mirroring both keys does the same to what lies between them.
#[test]
fn the_same_under_similarities() {
    let (a, b) = (bar(0.3), bar(2.5));
    let between = |triangles: &[[u32; 3]], a: &[Point], b: &[Point]| {
        Arap::new(triangles, &[a, b], Options::default()).unwrap().between(&[0.4]).unwrap().remove(0)
    };
    let base = between(&cells(), &a, &b);
    for scale in [1e-8, 1.0, 1e8] {
        let change = |p: &[Point]| turned(p, 1.1, [5.0, 1.0]).iter().map(|p| p.map(|v| v * scale)).collect::<Vec<_>>();
        let found = between(&cells(), &change(&a), &change(&b));
        assert!(farthest(&found, &change(&base)) < 1e-9 * scale, "{scale}");
    }
    let mirrored = |p: &[Point]| p.iter().map(|p| [-p[0], p[1]]).collect::<Vec<_>>();
    let upright: Vec<[u32; 3]> = cells().iter().map(|&[a, b, c]| [a, c, b]).collect();
    assert!(farthest(&between(&upright, &mirrored(&a), &mirrored(&b)), &mirrored(&base)) < 1e-9);
}

/// Dense least squares on the Jacobian rows, the four corners of a square with a middle: `numpy.linalg.lstsq`, unweighted, point 0 held.
#[test]
fn as_dense_least_squares_has_it() {
    let from = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.2, 0.9]];
    let to = [[0.5, 0.0], [1.0, 2.0], [-1.5, 2.5], [-1.0, 0.5], [0.0, 1.5]];
    let triangles = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    let arap = Arap::new(&triangles, &[&from, &to], Options { area_weights: false, ..PAPER }).unwrap();
    let found = &arap.between(&[0.4]).unwrap()[0];
    assert!(farthest(found, &LSTSQ) < 1e-12, "{found:?}");
}

#[test]
fn the_vectorised_sine_is_as_libm_has_it() {
    for i in -4000..4000 {
        let x = f64::from(i) * 0.0071;
        let ((s, c), (sin, cos)) = (angles::sin_cos(x), libm::sincos(x));
        assert!((s - sin).abs() < 3e-16 && (c - cos).abs() < 3e-16, "{x}");
    }
}

#[test]
fn keys_that_cannot_be_blended_are_refused() {
    let (a, triangles) = (bar(0.0), cells());
    let fails = |triangles: &[[u32; 3]], keys: &[&[Point]]| Arap::new(triangles, keys, Options::default()).unwrap_err();
    assert_eq!(fails(&triangles, &[]), ArapError::Empty { keys: 0, triangles: 160 });
    assert_eq!(fails(&triangles, &[&a, &a[1..]]), ArapError::Count { key: 1, expected: 105, found: 104 });
    let mut other = a.clone();
    other[7][0] = f64::INFINITY;
    assert_eq!(fails(&triangles, &[&a, &other]), ArapError::NotFinite { key: 1 });
    assert_eq!(fails(&triangles, &[&a, &[[0.0; 2]; 105]]), ArapError::Flat { key: 1, triangle: 0 });
    assert_eq!(fails(&[[0, 1, 22], [40, 41, 62]], &[&a, &a]), ArapError::Apart { last: 104 });
    let arap = Arap::new(&triangles, &[&a, &a], Options::default()).unwrap();
    let far = Options { gauge: Gauge::Vertex(105), ..PAPER };
    assert_eq!(Arap::new(&triangles, &[&a, &a], far).unwrap_err(), ArapError::Anchor { last: 104, found: 105 });
    assert_eq!(arap.blend(&[&[1.0]]), Err(ArapError::Weights { expected: 2, found: 1 }));
}

/// An arc of so many edges of length 1 that turns by `angle` on the whole.
fn arc(n: usize, angle: f64) -> Vec<Point> {
    let mut points = vec![[0.0; 2]];
    for i in 0..n {
        let (sin, cos) = libm::sincos(angle * (i as f64 / n as f64));
        points.push([points[i][0] + cos, points[i][1] + sin]);
    }
    points
}

#[test]
fn an_open_curve_unrolls() {
    let (straight, rolled) = (arc(40, 0.0), arc(40, 9.0));
    let found = OpenBlend::new(&[&straight, &rolled], Gauge::Centroid).unwrap().blend(&[0.5, 0.5]).unwrap();
    // Half of 9 radians, or half of what is a whole turn less at each edge: the mean turn is half a turn at the most.
    let turns = 9.0_f64 * 39.0 / 80.0 - wrapped_mean();
    let truth = turned(&arc(40, 4.5), -turns / 2.0, [0.0; 2]);
    let shift = sub(found[0], truth[0]);
    let moved: Vec<Point> = truth.iter().map(|p| [p[0] + shift[0], p[1] + shift[1]]).collect();
    assert!(farthest(&found, &moved) < 1e-9);
}

fn wrapped_mean() -> f64 {
    angles::wrapped(9.0 * 39.0 / 80.0)
}

#[test]
fn open_curves_with_points_that_fall_together_stay_finite() {
    let (a, b) = ([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 2.0]]);
    let open = OpenBlend::new(&[&a, &b], Gauge::Vertex(1)).unwrap();
    let half = open.blend(&[0.5, 0.5]).unwrap();
    assert!(half.iter().flatten().all(|v| v.is_finite()));
    assert!(farthest(&half[1..2], &[[0.5, 0.5]]) < 1e-12);
    assert_eq!(OpenBlend::new(&[&a, &b], Gauge::Vertex(4)).unwrap_err(), ArapError::Anchor { last: 3, found: 4 });
    assert_eq!(open.blend(&[0.0, 1.0]).unwrap(), b);
    assert_eq!(OpenBlend::new(&[&a, &b[1..]], Gauge::Centroid).unwrap_err(), ArapError::Count { key: 1, expected: 4, found: 3 });
}

const LSTSQ: [Point; 5] = [
    [0.2, 0.0],
    [1.943_338_544_846_534_8, 1.027_326_711_012_864_3],
    [0.806_942_365_582_059_6, 2.930_531_911_911_461],
    [-0.689_552_812_323_931, 1.597_029_541_430_258_4],
    [0.836_420_164_026_730_9, 1.393_596_833_702_985_8],
];
