use super::*;
use crate::counted::clock;
use pegbar_engine::node::Cancel;

const SQUARE: [[f64; 2]; 4] = [[2.0, 2.0], [10.0, 2.0], [10.0, 10.0], [2.0, 10.0]];

fn node(keys: &[Vec<[f64; 2]>], names: &[&str], method: Method) -> KeysInbetween {
    let keys = key_shapes(keys, names.iter().map(|n| (*n).to_owned()).collect(), true).unwrap();
    let images = List(Vec::new());
    KeysInbetween { keys: In::new(keys), images, count: 3, method, symmetric: true, area_weights: true, anchor: None }
}

fn run(node: KeysInbetween) -> Result<KeysInbetweenOutputs, NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
}

/// The square on its corner, a quarter turn less than it takes to be itself.
fn turned() -> Vec<[f64; 2]> {
    SQUARE.iter().map(|p| [6.0 - (p[1] - 6.0), 6.0 + (p[0] - 6.0)]).collect()
}

#[test]
fn a_square_turns_and_does_not_shrink() {
    let keys = [SQUARE.to_vec(), turned()];
    let found = run(node(&keys, &["a", "b"], Method::Arap)).unwrap().keys;
    assert_eq!(found.points.shape(), [5, 4, 2]);
    assert_eq!(found.names, ["a", "b", "a to b at 0.250", "a to b at 0.500", "a to b at 0.750"]);
    let half = &contours(&found)[3];
    let far = 32_f64.sqrt();
    assert!((half[0][0] - 6.0).abs() < 1e-9 && (half[0][1] - (6.0 - far)).abs() < 1e-9, "{half:?}");
    // In a straight line it is half as large.
    let straight = &contours(&run(node(&keys, &[], Method::Linear)).unwrap().keys)[3];
    assert_eq!(straight[0], [6.0, 2.0]);
}

#[test]
fn pictures_are_carried_and_named() {
    let picture = |v: f32| Image::new(12, 12, 3, vec![v; 12 * 12 * 3]).unwrap();
    let mut node = node(&[SQUARE.to_vec(), turned()], &["a", "b"], Method::Arap);
    node.images = List(vec![Some(In::new(picture(0.25))), Some(In::new(picture(0.75)))]);
    let found = run(node).unwrap().images;
    assert_eq!(found.pixels.shape(), [5, 12, 12, 4]);
    let middle = |k: usize| found.pixels.data()[(k * 144 + 6 * 12 + 6) * 4];
    assert!([(0, 0.25), (1, 0.75), (2, 0.375), (3, 0.5), (4, 0.625)].iter().all(|&(k, v)| (middle(k) - v).abs() < 1e-6));
}

#[test]
fn keys_that_have_no_inside_are_refused_and_a_way_out_is_named() {
    let bow = vec![SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]];
    let error = run(node(&[SQUARE.to_vec(), bow.clone()], &[], Method::Arap)).err().unwrap();
    assert_eq!(
        error.message,
        "key shapes: expected a contour that does not cross or touch itself, found that edges 0 and 2 of contour 1 do"
    );
    assert!(run(node(&[SQUARE.to_vec(), bow], &[], Method::Linear)).is_ok());
}

#[test]
fn repeated_keys_and_a_single_one_are_fine() {
    let same = run(node(&[SQUARE.to_vec(), SQUARE.to_vec()], &[], Method::Arap)).unwrap().keys;
    assert!(contours(&same).iter().all(|k| k.iter().zip(SQUARE).all(|(a, b)| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9)));
    assert_eq!(run(node(&[SQUARE.to_vec()], &[], Method::Arap)).unwrap().keys.points.shape(), [1, 4, 2]);
}

/// Each kind of key that cannot be blended is named with the key, and never passes.
#[test]
fn degenerate_keys_are_refused_by_name() {
    let message = |other: [[f64; 2]; 4], method| run(node(&[SQUARE.to_vec(), other.to_vec()], &[], method)).err().unwrap().message;
    let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]];
    let flat = "key shapes: expected a contour with an inside, found that all points of contour 1 lie on one line";
    assert_eq!(message(line, Method::Arap), flat);
    assert_eq!(message([[5.0, 5.0]; 4], Method::Arap), flat);
    let mut bad = SQUARE;
    bad[2][1] = f64::NAN;
    let at = "key shapes: expected finite points, found NaN, infinity or one beyond 1e100 at point 2 of contour 1";
    assert_eq!(message(bad, Method::Arap), at);
    assert_eq!(message(bad, Method::Linear), "key shapes: expected finite points, found NaN or infinity in key 1");
    let mut turned = SQUARE;
    turned.reverse();
    let way =
        "key shapes: expected contours that run the same way round, found contour 1 against contour 0; reverse the order of its points";
    assert_eq!(message(turned, Method::Arap), way);
    // The weighted sum asks for no inside.
    assert!(run(node(&[SQUARE.to_vec(), line.to_vec()], &[], Method::Linear)).is_ok());
    assert!(run(node(&[], &[], Method::Arap)).is_err() && run(node(&[], &[], Method::Linear)).is_err());
}

/// Open curves: the stroke that is drawn on a picture goes along, seen once.
#[test]
fn pictures_are_carried_by_open_curves() {
    let bar = |turn: f64| {
        (0..=10).map(|i| f64::from(i) - 5.0).map(|d| [12.0 + d * libm::cos(turn), 12.0 + d * libm::sin(turn)]).collect::<Vec<_>>()
    };
    let picture = |upright: bool| {
        let mut samples = vec![0.0; 24 * 24 * 4];
        for i in 7..17 {
            for j in 11..13 {
                let (x, y) = if upright { (j, i) } else { (i, j) };
                samples[(y * 24 + x) * 4..][..4].fill(1.0);
            }
        }
        Image::new(24, 24, 4, samples).unwrap()
    };
    let mut open = node(&[bar(0.0), bar(std::f64::consts::FRAC_PI_2)], &[], Method::Arap);
    open.keys = In::new(KeyShapes { closed: false, ..(*open.keys).clone() });
    open.images = List(vec![Some(In::new(picture(false))), Some(In::new(picture(true)))]);
    let found = run(open).unwrap().images;
    let at = |k: usize, x: usize, y: usize| found.pixels.data()[((k * 24 + y) * 24 + x) * 4 + 3];
    // Half way it stands on the diagonal; neither key's own place has paint.
    assert!(at(3, 9, 9) > 0.9 && at(3, 14, 14) > 0.9 && at(3, 16, 12) < 0.1 && at(3, 12, 7) < 0.1, "{}", at(3, 9, 9));
}
