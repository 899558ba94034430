use super::*;
use crate::algo::raster::{Affine, apply};
use crate::algo::warp_affine::{Outside, WarpOptions};
use crate::counted::clock;
use pegbar_engine::node::Cancel;

/// A smooth picture in four channels.
fn photo() -> Image {
    let value = |i: usize| {
        let (x, y) = ((i / 4 % 64) as f64, (i / 256) as f64);
        if i % 4 == 3 { 1.0 } else { 0.5 + 0.3 * libm::sin(0.2 * x + i as f64 % 4.0) * libm::cos(0.17 * y) }
    };
    Image::new(64, 48, 4, (0..64 * 48 * 4).map(|i| value(i) as f32).collect()).unwrap()
}

fn circle() -> Vec<[f64; 2]> {
    let angle = |i: usize| i as f64 / 32.0 * std::f64::consts::TAU;
    (0..32).map(|i| [32.0 + 20.0 * libm::cos(angle(i)), 24.0 + 18.0 * libm::sin(angle(i))]).collect()
}

fn node(image: Image, from: Vec<[f64; 2]>, to: Vec<[f64; 2]>, closed: bool) -> ImageWarpMesh {
    ImageWarpMesh {
        image: In::new(image),
        from: In::new(Shape { points: from, closed }),
        to: In::new(Shape { points: to, closed }),
        from_points: None,
        to_points: None,
        edge: Edge::Auto,
        margin: 1.0,
        falloff: 2.0,
        volume: 0.0,
        filter: Filter::Bilinear,
        expand: false,
    }
}

fn run(node: ImageWarpMesh, state: Option<&Filled>) -> Result<(Image, Filled), NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    node.run(state, &Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel }).map(|(p, s)| (p.image, s))
}

fn samples(image: &Image) -> Vec<f32> {
    let whole = image.clone().with_windows(image.data_window(), image.display_window());
    whole.in_display().unwrap().samples().to_vec()
}

fn deep_inside(contour: &[[f64; 2]], x: usize, y: usize) -> bool {
    let [x, y] = [x as f64 + 0.5, y as f64 + 0.5];
    let n = contour.len();
    (0..n).all(|i| {
        let (a, b) = (contour[i], contour[(i + 1) % n]);
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
        u[0] * v[1] - u[1] * v[0] > 2.0 * libm::hypot(u[0], u[1])
    })
}

/// Under an affine contour the inside is what `image.warp_affine` makes, with every filter.
#[test]
fn an_affine_contour_moves_its_inside_as_an_affine_motion() {
    let map = Affine::new(1.1, -0.15, 3.0, 0.2, 1.05, -8.0);
    let to: Vec<[f64; 2]> = circle().iter().map(|p| apply(&map, (*p).into()).into()).collect();
    for filter in [Filter::Nearest, Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3] {
        let found = samples(&run(ImageWarpMesh { filter, ..node(photo(), circle(), to.clone(), true) }, None).unwrap().0);
        let options = WarpOptions { filter, outside: Outside::Clamp, antialias: true };
        let truth = super::super::warped(&photo(), &map, options, false).unwrap().image;
        let mut seen = 0;
        for (k, (a, b)) in found.iter().zip(truth.samples()).enumerate().filter(|(k, _)| deep_inside(&to, k / 4 % 64, k / 256)) {
            // A centre on the rounding edge between two samples may fall to either.
            let most = if filter == Filter::Nearest { 0.2 } else { 1e-5 };
            assert!((a - b).abs() < most, "{filter:?} {k}: {a} {b}");
            seen += 1;
        }
        assert!(seen > 2000);
    }
}

#[test]
fn a_picture_that_does_not_move_is_itself_and_is_cut_softly_where_it_has_no_alpha() {
    let still = |image: Image| samples(&run(node(image, circle(), circle(), true), None).unwrap().0);
    let (found, truth) = (still(photo()), photo());
    let inside = |k: &usize| deep_inside(&circle(), k / 4 % 64, k / 256);
    assert!((0..found.len()).filter(inside).all(|k| found[k] == truth.samples()[k]));
    let flat = still(Image::new(64, 48, 3, vec![1.0; 64 * 48 * 3]).unwrap());
    let area: f32 = flat.iter().skip(3).step_by(4).sum();
    let truth = 16.0 * 20.0 * 18.0 * libm::sin(std::f64::consts::TAU / 32.0);
    assert!((f64::from(area) - truth).abs() < 0.5, "{area} {truth}");
}

#[test]
fn control_points_take_the_inside_with_them() {
    let mut spot = vec![0.0; 64 * 48 * 4];
    spot[(24 * 64 + 32) * 4..][..4].fill(1.0);
    let shape = |p: [f64; 2]| Some(In::new(Shape { points: vec![p], closed: false }));
    let base = node(Image::new(64, 48, 4, spot).unwrap(), circle(), circle(), true);
    let moved = ImageWarpMesh { from_points: shape([32.5, 24.5]), to_points: shape([37.5, 22.5]), ..base };
    let found = samples(&run(moved, None).unwrap().0);
    let brightest = (0..64 * 48).max_by(|a, b| found[a * 4 + 3].total_cmp(&found[b * 4 + 3])).unwrap();
    assert_eq!((brightest % 64, brightest / 64), (37, 22));
}

/// What was filled for another contour is not used.
#[test]
fn other_contours_are_filled_anew() {
    let other: Vec<[f64; 2]> = circle().iter().map(|p| [p[0] + 2.0, p[1]]).collect();
    let (_, state) = run(node(photo(), circle(), circle(), true), None).unwrap();
    let (fresh, _) = run(node(photo(), other.clone(), circle(), true), None).unwrap();
    let (found, _) = run(node(photo(), other, circle(), true), Some(&state)).unwrap();
    assert_eq!(found, fresh);
    let (again, _) = run(node(photo(), circle(), circle(), true), Some(&state)).unwrap();
    assert_eq!(again, run(node(photo(), circle(), circle(), true), None).unwrap().0);
}

#[test]
fn an_open_curve_bends_the_picture() {
    let from: Vec<[f64; 2]> = (0..=20).map(|i| [32.0, 4.0 + 2.0 * f64::from(i)]).collect();
    let to: Vec<[f64; 2]> = from.iter().map(|p| [p[0] + 5.0, p[1]]).collect();
    let found = samples(&run(node(photo(), from, to, false), None).unwrap().0);
    let truth = photo();
    assert!((0..40).all(|y| (10..50).all(|x| (found[(y * 64 + x + 5) * 4] - truth.samples()[(y * 64 + x) * 4]).abs() < 1e-5)));
}

#[test]
fn contours_that_do_not_fit_are_refused() {
    let message = |node| run(node, None).err().unwrap().message;
    assert_eq!(
        message(node(photo(), circle(), circle()[1..].to_vec(), true)),
        "to: expected 32 contour points as there were before, found 31"
    );
    let mut mixed = node(photo(), circle(), circle(), true);
    mixed.to = In::new(Shape { points: circle(), closed: false });
    assert_eq!(message(mixed), "expected from and to both closed or both open, found closed and open");
    let line: Vec<[f64; 2]> = (0..5).map(|i| [f64::from(i), 2.0]).collect();
    assert_eq!(
        message(node(photo(), line.clone(), line.clone(), true)),
        "from: expected a contour with an inside, found that all points of contour 0 lie on one line"
    );
    assert_eq!(message(node(photo(), line.clone(), circle(), false)), "expected 5 points in key 1 as in key 0, found 32");
    let mut points = node(photo(), circle(), circle(), true);
    points.to_points = Some(In::new(Shape { points: vec![[1.0, 1.0]], closed: false }));
    assert_eq!(message(points), "expected from_points on a closed contour before to_points, found none");
    let far: Vec<[f64; 2]> = circle().iter().map(|p| [p[0] + 1e9, p[1]]).collect();
    assert_eq!(message(node(photo(), circle(), far, true)), "expected a shape within the range of pixels, found one beyond it");
    assert!(run(node(photo(), circle(), vec![[10.0, 10.0]; 32], true), None).is_ok());
}
