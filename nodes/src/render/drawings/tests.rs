use pegbar_engine::node::Cancel;

use super::*;
use crate::counted::clock;
fn node(drawing: Drawing) -> RenderDrawings {
    RenderDrawings {
        drawing: In::new(drawing),
        background: None,
        size: None,
        background_color: [0.0; 4],
        line_scale: 1.0,
        taper: 0.0,
        swell: 0.0,
        light_deg: 135.0,
        opacity: 1.0,
    }
}

fn path(points: &[[f64; 2]], closed: bool, fill: [f64; 4], stroke: [f64; 4], width: f64) -> Drawing {
    Drawing {
        points: points.to_vec(),
        contours: vec![points.len() as u32],
        closed: vec![u8::from(closed)],
        paths: vec![1],
        fill: vec![fill],
        stroke: vec![stroke],
        width: vec![width],
        rule: vec![0],
        depth: vec![0.0],
        size: [20.0, 10.0],
        ..Drawing::default()
    }
}

fn run(node: RenderDrawings) -> Result<Image, NodeError> {
    let clock = clock(1);
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    node.run(&cx).map(|out| out.image)
}

/// The sum of the picture's opacity: area for opaque paint.
fn area(image: &Image) -> f64 {
    image.samples().chunks_exact(4).map(|p| f64::from(p[3])).sum()
}

const SQUARE: [[f64; 2]; 4] = [[2.0, 2.0], [8.0, 2.0], [8.0, 8.0], [2.0, 8.0]];
const RED: [f64; 4] = [1.0, 0.0, 0.0, 1.0];
const NONE: [f64; 4] = [0.0; 4];

#[test]
fn fills_are_premultiplied_linear_light_of_exact_area() {
    let image = run(node(path(&SQUARE, true, [0.5, 0.5, 0.5, 0.5], NONE, 0.0))).unwrap();
    assert_eq!((image.width(), image.height()), (20, 10));
    let pixel = &image.samples()[(5 * 20 + 5) * 4..][..4];
    let linear = crate::algo::color::linear_from_srgb(0.5) as f32;
    assert_eq!(pixel, [linear * 0.5, linear * 0.5, linear * 0.5, 0.5]);
    assert!((area(&image) - 18.0).abs() < 1e-5);
}

#[test]
fn the_rule_decides_what_lies_within_two_contours() {
    let mut ring = path(&SQUARE, true, RED, NONE, 0.0);
    ring.points.extend([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]]);
    (ring.contours, ring.closed, ring.paths) = (vec![4, 4], vec![1, 1], vec![2]);
    assert!((area(&run(node(ring.clone())).unwrap()) - 36.0).abs() < 1e-5);
    ring.rule = vec![1];
    assert!((area(&run(node(ring)).unwrap()) - 32.0).abs() < 1e-5);
}

#[test]
fn lines_have_round_caps_and_joins_and_scale() {
    let pi = std::f64::consts::PI;
    let line = path(&[[5.0, 5.0], [15.0, 5.0]], false, NONE, RED, 2.0);
    assert!((area(&run(node(line.clone())).unwrap()) - (20.0 + pi)).abs() < 0.02);
    let wide = RenderDrawings { line_scale: 2.0, ..node(line.clone()) };
    assert!((area(&run(wide).unwrap()) - (40.0 + 4.0 * pi)).abs() < 0.05);
    assert_eq!(area(&run(RenderDrawings { line_scale: 0.0, ..node(line) }).unwrap()), 0.0);
    // Around a square: a band, and a quarter of a disc at each corner.
    let square = path(&SQUARE, true, NONE, RED, 2.0);
    let truth = 4.0 * 6.0 * 1.0 + pi + (36.0 - 16.0);
    assert!((area(&run(node(square)).unwrap()) - truth).abs() < 0.02);
    let dot = path(&[[5.0, 5.0], [5.0, 5.0]], false, NONE, RED, 4.0);
    assert!((area(&run(node(dot)).unwrap()) - 4.0 * pi).abs() < 0.02);
}

#[test]
fn tapered_ink_is_full_in_the_middle_and_nothing_at_the_ends() {
    let points: Vec<[f64; 2]> = (0..=200).map(|i| [5.0 + f64::from(i) * 0.05, 5.0]).collect();
    let line = RenderDrawings { taper: 0.5, ..node(path(&points, false, NONE, RED, 4.0)) };
    let image = run(line).unwrap();
    let column = |x: usize| (0..10).map(|y| f64::from(image.samples()[(y * 20 + x) * 4 + 3])).sum::<f64>();
    assert!(column(5) < 1.0 && column(14) < 1.0 && (column(10) - 4.0).abs() < 0.1, "{} {} {}", column(5), column(10), column(14));
    // The width is a quarter of a sine each way: 2 / pi of the whole on the mean.
    assert!((area(&image) - 40.0 * 2.0 / std::f64::consts::PI).abs() < 0.2);
}

#[test]
fn ink_swells_away_from_the_light_whichever_way_the_line_runs() {
    let circle: Vec<[f64; 2]> =
        (0..400).map(|i| libm::sincos(f64::from(i) * 0.005 * std::f64::consts::PI)).map(|(s, c)| [10.0 + 3.0 * c, 5.0 + 3.0 * s]).collect();
    let mut back = circle.clone();
    back.reverse();
    for points in [circle, back] {
        let lit = RenderDrawings { swell: 1.0, light_deg: 90.0, ..node(path(&points, true, NONE, RED, 1.0)) };
        let image = run(lit).unwrap();
        let column = |from: usize, to: usize| (from..to).map(|y| f64::from(image.samples()[(y * 20 + 10) * 4 + 3])).sum::<f64>();
        assert!(column(0, 5) < 0.1 && (column(5, 10) - 2.0).abs() < 0.1, "{} {}", column(0, 5), column(5, 10));
    }
}

#[test]
fn it_is_drawn_on_a_background_and_through_an_opacity() {
    let blue = Image::new(4, 4, 4, [0.0, 0.0, 1.0, 1.0].repeat(16)).unwrap();
    let on = RenderDrawings { background: Some(In::new(blue)), opacity: 0.25, ..node(path(&SQUARE, true, RED, NONE, 0.0)) };
    let image = run(on).unwrap();
    assert_eq!(&image.samples()[..4], [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(&image.samples()[(3 * 4 + 3) * 4..][..4], [0.25, 0.0, 0.75, 1.0]);
    let ground = RenderDrawings { background_color: [1.0, 1.0, 1.0, 0.5], size: Some([3, 2]), ..node(path(&[], false, NONE, NONE, 0.0)) };
    assert_eq!(run(ground).unwrap().samples(), [0.5; 24]);
}

#[test]
fn what_cannot_be_drawn_is_named() {
    let mut nan = path(&SQUARE, true, RED, NONE, 0.0);
    nan.points[1][0] = f64::NAN;
    nan.names = vec!["eye".to_owned()];
    let said = |node: RenderDrawings| run(node).unwrap_err().message;
    assert_eq!(said(node(nan)), "path `eye`: expected finite points, colours and widths, found NaN");
    assert_eq!(said(RenderDrawings { taper: f64::NAN, ..node(Drawing::default()) }), "expected `taper` from 0 to 0.5, found NaN");
    assert!(said(node(Drawing::default())).starts_with("expected `the drawing's width`"));
}
