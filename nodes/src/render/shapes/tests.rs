//! The overlay by itself and in whole graphs.

use std::sync::Arc;

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Cancel, Context, In, Node, PerFrame};
use pegbar_engine::setting::Place;

use super::super::tests::{load, pictures};
use super::RenderShapes;
use crate::algo::window::Window;
use crate::data::{Affine2, Image, Shape};

fn picture(nodes: &str) -> Arc<Image> {
    pictures(nodes, 1).unwrap().remove(0)
}

fn alpha(image: &Image) -> f64 {
    image.samples().chunks_exact(4).map(|p| f64::from(p[3])).sum()
}

/// The node `render.shapes` by itself, with settings changed by hand.
fn shapes(change: impl FnOnce(&mut RenderShapes)) -> Result<Image, String> {
    let schema = RenderShapes::schema();
    let args = schema.inputs.iter().map(|i| match i.default {
        Some(text) => Arg::Literal((i.parse)(text, &Place::default()).unwrap().0),
        None => Arg::None,
    });
    let mut node = RenderShapes::build(args.collect()).unwrap();
    node.size = [20, 16];
    change(&mut node);
    let clock = Clock { name: "frames".into(), first: 1, last: 1, fps: (24, 1) };
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    node.run(&cx).map(|d| d.image).map_err(|e| e.message)
}

fn square(closed: bool) -> Option<In<Shape>> {
    Some(In::new(Shape { points: vec![[3.25, 2.5], [9.25, 2.5], [9.25, 8.5], [3.25, 8.5]], closed }))
}

#[test]
fn the_fill_of_a_square_adds_up_to_its_area() {
    let image = shapes(|n| {
        n.shapes.0 = vec![square(true)];
        (n.fill_opacity, n.stroke_width) = (0.5, 0.0);
        n.colors = vec![[1.0, 0.0, 1.0]];
    })
    .unwrap();
    assert!((alpha(&image) - 18.0).abs() < 1e-5);
    let red: f64 = image.samples().chunks_exact(4).map(|p| f64::from(p[0])).sum();
    assert!((red - 18.0).abs() < 1e-5, "the light of an opaque red channel is its coverage");
    assert_eq!(image.samples()[(5 * 20 + 5) * 4..][..4], [0.5, 0.0, 0.5, 0.5]);
}

#[test]
fn an_open_contour_is_not_filled_and_a_round_pen_covers_its_length() {
    let image = shapes(|n| {
        n.shapes.0 = vec![square(false)];
        n.fill_opacity = 1.0;
        n.stroke_width = 1.0;
    })
    .unwrap();
    // Three sides of six pixels, the half discs of both ends, and a quarter disc in place of a quarter square overlap at each corner.
    let quarter = std::f64::consts::PI / 16.0;
    let truth = 18.0 + std::f64::consts::FRAC_PI_4 + 2.0 * (quarter - 0.25);
    assert!((alpha(&image) - truth).abs() < 0.02, "expected {truth}, found {}", alpha(&image));
}

#[test]
fn motion_by_whole_pixels_moves_every_sample_and_no_width() {
    let drawn = |motion: Option<[[f64; 3]; 2]>| {
        shapes(|n| {
            n.shapes.0 = vec![square(true)];
            n.point_size = 2.0;
            n.grid = Some([3.0, 2.0, 9.0, 8.0]);
            n.axes = true;
            n.motion = motion.map(|matrix| In::new(Affine2 { matrix }));
        })
        .unwrap()
    };
    let (still, moved) = (drawn(None), drawn(Some([[1.0, 0.0, 5.0], [0.0, 1.0, 4.0]])));
    for y in 0..12 {
        for x in 0..15 {
            let (a, b) = (&still.samples()[(y * 20 + x) * 4..][..4], &moved.samples()[((y + 4) * 20 + x + 5) * 4..][..4]);
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{x}, {y}: {a:?} {b:?}");
        }
    }
    let stretched = drawn(Some([[1.5, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    assert!(stretched.samples() != still.samples());
}

#[test]
fn a_background_keeps_its_windows_and_its_pixels() {
    let ground = Image::new(4, 3, 3, vec![0.25; 36]).unwrap();
    let ground = ground.with_windows(Window::new(2, 1, 4, 3), Window::at_origin(8, 6));
    let image = shapes(|n| {
        n.background = Some(In::new(ground.clone()));
        let points = vec![[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]];
        n.shapes.0 = vec![Some(In::new(Shape { points, closed: true }))];
        (n.fill_opacity, n.stroke_width) = (1.0, 0.0);
        n.fill_color = Some([1.0, 1.0, 1.0]);
        n.opacity = 0.5;
    })
    .unwrap();
    assert_eq!((image.data_window(), image.display_window()), (Window::at_origin(8, 6), Window::at_origin(8, 6)));
    let pixel = |x: usize, y: usize| image.samples()[(y * 8 + x) * 4..][..4].to_vec();
    assert_eq!(pixel(0, 0), [0.5; 4], "the drawing alone");
    assert_eq!(pixel(2, 1), [0.625, 0.625, 0.625, 1.0], "half of white over a quarter");
    assert_eq!(pixel(5, 3), [0.25, 0.25, 0.25, 1.0], "the background alone");
    assert_eq!(pixel(7, 5), [0.0; 4], "neither");
}

#[test]
fn nothing_to_draw_is_the_ground() {
    assert!(shapes(|_| ()).unwrap().samples().iter().all(|v| *v == 0.0));
    let empty = shapes(|n| n.shapes.0 = vec![Some(In::new(Shape { points: Vec::new(), closed: true }))]);
    assert_eq!(alpha(&empty.unwrap()), 0.0);
    let ground = shapes(|n| n.background_color = [1.0, 0.0, 0.0, 0.5]).unwrap();
    assert_eq!(ground.samples()[..4], [0.5, 0.0, 0.0, 0.5]);
}

#[test]
fn what_is_not_finite_is_refused_by_name() {
    let error = shapes(|n| n.shapes.0 = vec![square(true), Some(In::new(Shape { points: vec![[f64::NAN, 1.0]], closed: false }))]);
    assert_eq!(error.unwrap_err(), "shape 1: expected finite points, found point 0 at (NaN, 1)");
    let motion = Affine2 { matrix: [[1.0, 0.0, f64::NAN], [0.0, 1.0, 0.0]] };
    let error = shapes(|n| n.motion = Some(In::new(motion))).unwrap_err();
    assert_eq!(error, "expected a finite motion, found [1, 0, 0, 1, NaN, 0]");
    assert_eq!(shapes(|n| n.opacity = f64::NAN).unwrap_err(), "expected `opacity` from 0 to 1, found NaN");
    assert_eq!(shapes(|n| n.stroke_width = -1.0).unwrap_err(), "expected `stroke_width` from 0 to 1000, found -1");
    let depth = Image::new(1, 1, 2, vec![0.0; 2]).unwrap().with_channels(vec!["Z".into(), "U".into()]);
    let error = shapes(|n| n.background = Some(In::new(depth))).unwrap_err();
    assert_eq!(error, "expected channels R, G, B or Y, found Z, U");
    assert!(shapes(|n| n.size = [65536, 65536]).unwrap_err().starts_with("expected a drawing of at most 4 GiB"));
}

#[test]
fn a_graph_may_leave_everything_out_and_is_refused_for_an_empty_grid() {
    assert_eq!(picture(r#""out": (type: "render.shapes", size: (8, 4))"#).width(), 8);
    let errors = load(r#""out": (type: "render.shapes", grid: (4.0, 0.0, 4.0, 9.0))"#).err().unwrap();
    assert!(errors.iter().any(|e| e.contains("expected left < right")), "{errors:?}");
    assert!(load(r#""out": (type: "render.shapes", fill_opacity: 2.0)"#).is_err());
}

#[test]
fn a_graph_draws_on_footage_the_same_with_any_number_of_threads() {
    let nodes = r#""plate": (type: "image.checkerboard", size: (32, 24)),
        "out": (type: "render.shapes", background: "@plate", motion: [1.2, 0.1, -0.1, 0.8, 2.0, 3.0], grid: (4.0, 4.0, 24.0, 20.0), axes: true)"#;
    let (one, two) = (pictures(nodes, 1).unwrap(), pictures(nodes, 2).unwrap());
    assert!(one[0].samples() == two[0].samples());
    assert_eq!((one[0].width(), one[0].height(), one[0].n_channels()), (32, 24, 4));
}
