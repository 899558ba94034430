//! Curves of known shape, drawn with pens of 1.5, 3 and 6 pixels, every fourth broken, half of them with grain.

use super::*;

const W: usize = 160;
const H: usize = 120;

/// Case `k`: 801 points of a wavy curve.
fn curve(k: usize) -> Vec<[f64; 2]> {
    use std::f64::consts::PI;
    let (a, f, p) = (10.0 + 6.0 * (k % 5) as f64, 1.0 + (k % 3) as f64, 0.7 * k as f64);
    let point = |i: usize| {
        let t = i as f64 / 800.0;
        let s = (PI * t).sin().max(0.0);
        let x = 14.0 + 132.0 * t + (4.0 + (k % 4) as f64) * (2.0 * PI * t * 2.0 + p).sin() * s;
        let y = 60.0 + a * (2.0 * PI * f * t + p).sin() * s.sqrt() + ((k % 7) as f64 - 3.0) * 4.0 * (t - 0.5);
        [x, y]
    };
    (0..=800).map(point).collect()
}

fn far(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// The curve in ink, and which point of it is nearest to each pixel.
fn drawn(k: usize) -> Ink {
    let curve = curve(k);
    let width = [1.5, 3.0, 6.0][k % 3];
    let mut state = k as u64 + 1;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let mut amount = Vec::with_capacity(W * H);
    for i in 0..W * H {
        let p = [(i % W) as f64 + 0.5, (i / W) as f64 + 0.5];
        let mut best = (f64::INFINITY, 0);
        for (at, q) in curve.iter().enumerate() {
            let d = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
            if d < best.0 {
                best = (d, at);
            }
        }
        let mut ink = (width / 2.0 + 0.5 - best.0.sqrt()).clamp(0.0, 1.0);
        if k % 4 == 1 && best.1 % 133 < 25 {
            ink = 0.0;
        }
        if k % 4 >= 2 {
            ink = (ink + (random() - 0.5) * 0.5).clamp(0.0, 1.0);
        }
        amount.push(ink as f32);
    }
    Ink::from_amount(amount, W, 0.5)
}

fn anchors(k: usize) -> Vec<[f64; 2]> {
    let n = if k % 2 == 1 { 4 } else { 6 };
    let curve = curve(k);
    (0..n).map(|j| curve[(j as f64 * 800.0 / (n - 1) as f64).round() as usize]).collect()
}

fn options() -> Options {
    Options {
        method: Method::Both,
        along: Along::Center,
        width: None,
        threshold: 0.5,
        snap: 8.0,
        margin: 64.0,
        snake: Snake::default(),
        closed: false,
        least_on_ink: 0.0,
    }
}

/// The mean distance between two curves, both ways.
fn apart(found: &[[f64; 2]], truth: &[[f64; 2]]) -> f64 {
    let way = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        a.iter().map(|p| b.iter().map(|q| far(*p, *q)).fold(f64::INFINITY, f64::min)).sum::<f64>() / a.len() as f64
    };
    let dense = snake::spread(found, 0.25);
    (way(&dense, truth) + way(truth, &dense)) / 2.0
}

#[test]
fn known_curves_are_found_to_a_fraction_of_a_pixel_and_snakes_of_others_beaten() {
    let mut found = Vec::new();
    for (k, peer) in PEER.iter().enumerate() {
        // The anchors are on the curve, and stay there, as they do for the others.
        // A stiff snake carries the bends of a broken line across its gaps.
        let snake = Snake { beta: if k % 4 == 1 { 4.0 } else { 1.0 }, ..Snake::default() };
        let traced = trace(&drawn(k), &anchors(k), &Options { snap: 0.0, snake, ..options() }).unwrap();
        let miss = apart(&traced.points, &curve(k));
        println!(
            "{k}: {miss:.3} px, width {:.1}, on ink {:.2}; skimage {:.3} from straight lines, {:.3} from a path",
            traced.width, traced.on_ink, peer[0], peer[1]
        );
        found.push((miss, peer));
    }
    let won = |which: usize| found.iter().filter(|(miss, peer)| *miss < peer[which]).count() as f64 / found.len() as f64;
    println!("beaten: {} from straight lines, {} from a path", won(0), won(1));
    assert!(found.iter().all(|(miss, _)| *miss <= 0.5), "{found:?}");
    assert!(won(0) >= 0.9);
}

#[test]
fn gaps_are_bridged_and_told() {
    let whole = trace(&drawn(0), &anchors(0), &options()).unwrap();
    assert!(whole.on_ink > 0.99, "{}", whole.on_ink);
    let broken = trace(&drawn(1), &anchors(1), &options()).unwrap();
    assert!(broken.on_ink < 0.95 && broken.on_ink > 0.7, "{}", broken.on_ink);
}

/// A ring in ink: radii of its rims about (60.3, 58.7).
fn ring(inner: f64, outer: f64) -> Ink {
    let amount = |i: usize| {
        let r = far([(i % W) as f64 + 0.5, (i / W) as f64 + 0.5], [60.3, 58.7]);
        ((outer + 0.5 - r).clamp(0.0, 1.0) * (r - inner + 0.5).clamp(0.0, 1.0)) as f32
    };
    Ink::from_amount((0..W * H).map(amount).collect(), W, 0.5)
}

#[test]
fn thick_lines_have_a_middle_and_two_rims_whichever_way_round() {
    let ink = ring(36.0, 44.0);
    let at = |angle: f64| [60.3 + 40.0 * angle.cos(), 58.7 + 40.0 * angle.sin()];
    for turn in [1.0, -1.0] {
        let anchors: Vec<[f64; 2]> = (0..4).map(|i| at(turn * 1.6 * f64::from(i))).collect();
        for (along, radius) in [(Along::Center, 40.0), (Along::Outside, 44.0), (Along::Inside, 36.0)] {
            let traced = trace(&ink, &anchors, &Options { along, closed: true, ..options() }).unwrap();
            let miss = traced.points.iter().map(|p| (far(*p, [60.3, 58.7]) - radius).abs()).fold(0.0, f64::max);
            assert!(miss < 0.35, "{along:?} {turn}: {miss}");
            assert!((traced.width - 8.0).abs() < 1.6, "{}", traced.width);
            let length: f64 = (0..traced.points.len()).map(|i| far(traced.points[i], traced.points[(i + 1) % traced.points.len()])).sum();
            assert!((length / (std::f64::consts::TAU * radius) - 1.0).abs() < 0.02, "goes round once: {length}");
        }
    }
}

#[test]
fn the_edge_of_a_painted_area_is_a_curve_too() {
    let ink = ring(-1.0, 40.0);
    let at = |angle: f64| [60.3 + 41.0 * angle.cos(), 58.7 + 41.0 * angle.sin()];
    let anchors: Vec<[f64; 2]> = (0..5).map(|i| at(1.25 * f64::from(i))).collect();
    let traced = trace(&ink, &anchors, &Options { along: Along::Edge, closed: true, ..options() }).unwrap();
    let miss = traced.points.iter().map(|p| (far(*p, [60.3, 58.7]) - 40.0).abs()).sum::<f64>() / traced.points.len() as f64;
    assert!(miss < 0.2, "{miss}");
}

#[test]
fn anchors_stay_fixed_and_those_off_the_ink_are_moved_to_it() {
    let (ink, curve) = (drawn(3), curve(3));
    let mut near = anchors(3);
    near[1][1] += 4.0;
    let traced = trace(&ink, &near, &options()).unwrap();
    assert_eq!(traced.anchors.len(), near.len());
    for (at, anchor) in traced.at.iter().zip(&traced.anchors) {
        assert_eq!(traced.points[*at], *anchor);
    }
    assert!(traced.anchors.iter().all(|a| curve.iter().any(|c| far(*a, *c) < 0.5)));
    let free = trace(&ink, &near, &Options { snap: 0.0, ..options() }).unwrap();
    assert_eq!(free.anchors, near);
    for method in [Method::Livewire, Method::Snake] {
        let traced = trace(&ink, &anchors(3), &Options { method, ..options() }).unwrap();
        assert!(traced.points.len() > 100 && traced.points.iter().flatten().all(|v| v.is_finite()));
    }
}

#[test]
fn anchors_that_are_nowhere_are_told_by_number() {
    let ink = drawn(3);
    let refused = |anchors: &[[f64; 2]], options: Options| trace(&ink, anchors, &options).unwrap_err().to_string();
    let [a, b, ..] = anchors(3)[..] else { panic!() };
    assert_eq!(refused(&[a], options()), "expected at least 2 anchors, found 1");
    assert_eq!(refused(&[a, b], Options { closed: true, ..options() }), "expected at least 3 anchors, found 2");
    assert_eq!(refused(&[a, [-3.0, 5.0]], options()), "anchor 2: expected a place within 160 x 120, found (-3, 5)");
    assert_eq!(refused(&[a, [f64::NAN, 5.0]], options()), "anchor 2: expected a place within 160 x 120, found (NaN, 5)");
    assert_eq!(refused(&[b, b], options()), "anchors 1 and 2: expected two places, found one");
    let far = refused(&[a, [80.0, 119.0]], options());
    assert!(far.starts_with("anchor 2 at (80, 119): expected ink within 8 px, found the nearest "), "{far}");
    let blank = Ink::from_amount(vec![0.0; W * H], W, 0.5);
    let none = trace(&blank, &[a, b], &options()).unwrap_err().to_string();
    assert!(none.ends_with("expected ink within 8 px, found none at all"), "{none}");
    let empty = Ink::from_amount(Vec::new(), 0, 0.5);
    assert!(trace(&empty, &[[0.0, 0.0], [0.0, 0.0]], &options()).is_err());
}

#[test]
fn crossing_lines_and_points_at_the_border_do_no_harm() {
    let mut amount = vec![0.0; W * H];
    (0..W).for_each(|x| amount[60 * W + x] = 1.0);
    (0..H).for_each(|y| amount[y * W + 80] = 1.0);
    let ink = Ink::from_amount(amount, W, 0.5);
    let traced = trace(&ink, &[[0.2, 60.4], [159.9, 60.6]], &options()).unwrap();
    let off = traced.points.iter().map(|p| (p[1] - 60.5).abs()).fold(0.0, f64::max);
    assert!(off < 0.3, "{off}");
}

/// Mean distance to the curve in pixels of scikit-image 0.26's `active_contour` (ends fixed at the anchors, ink blurred by sigma 1), the best of five settings
/// and of both conventions for the middle of a pixel each: from straight lines between the anchors, and from its `route_through_array` along the ink.
const PEER: [[f64; 2]; 24] = [
    [0.492, 0.386],
    [1.380, 0.361],
    [0.731, 0.579],
    [0.780, 0.483],
    [0.633, 0.467],
    [0.356, 0.276],
    [0.537, 0.358],
    [2.099, 0.280],
    [0.251, 0.181],
    [0.524, 0.522],
    [0.524, 0.460],
    [2.018, 0.472],
    [0.554, 0.498],
    [2.689, 0.586],
    [0.575, 0.469],
    [0.519, 0.405],
    [0.635, 0.441],
    [4.682, 0.381],
    [0.556, 0.429],
    [2.472, 0.496],
    [0.123, 0.093],
    [0.589, 0.473],
    [0.631, 0.513],
    [2.520, 0.548],
];

#[test]
fn a_section_over_paper_is_told_unless_it_is_let_be() {
    // Half a ring whose chord is much shorter than the ring is, and dearer only by the pixel.
    let half = ring(49.0, 51.0);
    let options = Options { snap: 0.0, margin: 0.0, least_on_ink: 0.2, ..options() };
    let at = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        [60.3 + 50.0 * c, 58.7 + 50.0 * s]
    };
    let error = trace(&half, &[at(0.0), at(20.0), [60.3, 58.7]], &options).unwrap_err().to_string();
    assert!(error.starts_with("anchors 2 and 3: expected 0.2 or more of the curve between them on ink, found 0.1"), "{error}");
    assert!(trace(&half, &[at(0.0), at(20.0)], &options).is_ok());
    assert!(trace(&half, &[at(0.0), at(20.0), [60.3, 58.7]], &Options { least_on_ink: 0.0, ..options }).is_ok());
}
