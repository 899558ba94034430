use super::*;
use crate::counted::clock;
use pegbar_engine::node::Cancel;

fn node(shapes: &[Vec<[f64; 2]>]) -> KeysBasis {
    let keys = In::new(key_shapes(shapes, Vec::new(), true).unwrap());
    let (align, align_model) = (AlignTo::None, Model::Affine);
    KeysBasis { keys, images: None, max_error: None, components: None, align, align_model, tone: Tone::Linear }
}

fn run_node(node: KeysBasis) -> Result<KeysBasisOutputs, NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
}

fn run(shapes: &[Vec<[f64; 2]>], max_error: f64, components: Option<u32>) -> Result<KeysBasisOutputs, NodeError> {
    run_node(KeysBasis { max_error: Some(max_error), components, ..node(shapes) })
}

fn shapes() -> Vec<Vec<[f64; 2]>> {
    let shape = |a: f64, b: f64| vec![[a, 0.0], [10.0, b], [0.0, 10.0 + a]];
    vec![shape(0.0, 0.0), shape(4.0, 0.1), shape(-4.0, 0.1), shape(2.0, -0.2)]
}

#[test]
fn as_few_components_as_the_error_allows() {
    let found = run(&shapes(), 0.2, None).unwrap();
    assert_eq!((found.count.value, found.basis.components.shape()), (1.0, [1, 6]));
    assert!(found.errors.values[0] > 0.2 && found.errors.values[1] <= 0.2 && found.errors.values[2] < 1e-9);
    assert!(found.explained.values[1] > 0.99);
    assert_eq!(run(&shapes(), 0.0, None).unwrap().count.value, 2.0);
    assert_eq!(run(&shapes(), 0.0, Some(1)).unwrap().count.value, 1.0);
}

/// Equation 3: with weights that add up to 1 the shapes of the space make every example.
#[test]
fn the_shapes_of_the_space_make_the_examples() {
    let found = run(&shapes(), 0.0, None).unwrap();
    let span = contours(&found.keys);
    let mean = span.last().unwrap().as_flattened();
    let mut largest: f64 = 0.0;
    for example in shapes() {
        let mut made = mean.to_vec();
        for direction in &span[..2] {
            let step: Vec<f64> = direction.as_flattened().iter().zip(mean).map(|(a, b)| a - b).collect();
            let squared: f64 = step.iter().map(|v| v * v).sum();
            let weight = example.as_flattened().iter().zip(mean).zip(&step).map(|((e, m), s)| (e - m) * s).sum::<f64>() / squared;
            made.iter_mut().zip(&step).for_each(|(a, s)| *a += weight * s);
            largest = largest.max(weight.abs());
        }
        assert!(made.iter().zip(example.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-9));
    }
    assert!((largest - 1.0).abs() < 1e-9);
}

#[test]
fn shapes_that_are_no_numbers_are_refused() {
    let error = run(&[vec![[f64::NAN, 0.0]]], 0.1, None).err().unwrap();
    assert_eq!(error.message, "expected finite points, found NaN or infinity in key 0");
    assert_eq!(run(&[], 0.1, None).err().unwrap().message, "expected at least one example with coordinates, found none");
}

/// Three pictures of 5 by 4 in one channel and alpha: what is at column 2 and row 1 grows, what is at (3, 2) shrinks.
fn pictures(n: usize) -> KeyImages {
    let mut pixels = vec![0.0; n * 40];
    for k in 0..n {
        let t = k as f32 / 2.0;
        pixels[k * 40 + (5 + 2) * 2..][..2].copy_from_slice(&[0.25 + 0.5 * t, 1.0]);
        pixels[k * 40 + (2 * 5 + 3) * 2..][..2].copy_from_slice(&[0.75 - 0.5 * t, 1.0]);
    }
    KeyImages { pixels: NdArray::new([n, 4, 5, 2], pixels).unwrap(), names: Vec::new() }
}

#[test]
fn pictures_span_a_space_of_what_is_drawn() {
    let shapes: Vec<Vec<[f64; 2]>> = (0..3).map(|k| vec![[f64::from(k), 0.0], [10.0, 0.0], [0.0, 10.0]]).collect();
    let pictured = KeysBasis { images: Some(In::new(pictures(3))), ..node(&shapes) };
    let found = run_node(pictured).unwrap();
    let basis = &found.basis;
    assert_eq!(
        (basis.kind, basis.window, basis.display_window),
        (BasisKind::Images, Some(Window::new(2, 1, 2, 2)), Some(Window::at_origin(5, 4)))
    );
    assert_eq!((basis.channels.join(""), basis.components.shape()), ("YA".to_owned(), [1, 8]));
    assert_eq!(basis.mean, [0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0]);
    let half = 0.5_f64.sqrt();
    let truth = [half, 0.0, 0.0, 0.0, 0.0, 0.0, -half, 0.0];
    let sign = basis.components.data()[0].signum();
    assert!(basis.components.data().iter().zip(truth).all(|(a, b)| (a * sign - b).abs() < 1e-6), "{:?}", basis.components);
    assert!((basis.reach()[0] - 0.125_f64.sqrt()).abs() < 1e-6);
    // Weight 1 along the component is the last picture, so that its contour is what goes with it.
    let span = contours(&found.keys);
    assert!((span[0][0][0] - (1.0 + sign)).abs() < 1e-6 && (span[1][0][0] - 1.0).abs() < 1e-12, "{span:?}");
}

#[test]
fn the_tone_leaves_alpha_alone() {
    let pictured = KeysBasis { images: Some(In::new(pictures(3))), tone: Tone::Encoded, ..node(&shapes()[..3]) };
    let basis = run_node(pictured).unwrap().basis;
    let truth = [0.25, 0.5, 0.75].map(|v| f64::from(toned(v, Tone::Encoded))).iter().sum::<f64>() / 3.0;
    assert!((basis.mean[0] - truth).abs() < 1e-12 && basis.mean[1] == 1.0);
}

#[test]
fn pictures_that_do_not_fit_are_refused() {
    let message = |images, n| run_node(KeysBasis { images: Some(In::new(images)), ..node(&shapes()[..n]) }).err().unwrap().message;
    assert_eq!(message(pictures(2), 3), "expected 3 pictures, one for each key, found 2");
    let blank = KeyImages { pixels: NdArray::new([3, 4, 5, 2], vec![0.0; 120]).unwrap(), names: Vec::new() };
    assert_eq!(message(blank, 3), "expected pictures with something on them, found none that is not empty");
    let mut bad = pictures(3);
    bad.pixels.data_mut()[15] = f32::NAN;
    assert_eq!(message(bad, 3), "expected finite coordinates, found NaN, infinity or one beyond 1e100 in example 0");
    let mut empty = pictures(3);
    empty.pixels = NdArray::new([3, 0, 0, 0], Vec::new()).unwrap();
    assert_eq!(message(empty, 3), "expected pictures with something on them, found none that is not empty");
}

/// Keys and pictures that differ by a motion alone span nothing once they are aligned.
#[test]
fn what_a_motion_can_do_takes_no_component() {
    let triangle = |d: f64| vec![[1.0 + d, 1.0], [3.0 + d, 1.0], [1.0 + d, 3.0]];
    let shapes: Vec<Vec<[f64; 2]>> = (0..3).map(|k| triangle(f64::from(k))).collect();
    let mut pixels = vec![0.0; 3 * 6 * 8];
    (0..3).for_each(|k| pixels[k * 48 + 2 * 8 + 2 + k] = 1.0);
    let images = KeyImages { pixels: NdArray::new([3, 6, 8, 1], pixels).unwrap(), names: Vec::new() };
    for align in [AlignTo::None, AlignTo::First, AlignTo::Mean] {
        let shaped = KeysBasis { align, ..node(&shapes) };
        let pictured = KeysBasis { images: Some(In::new(images.clone())), align, align_model: Model::Translation, ..node(&shapes) };
        let counts = [shaped, pictured].map(|n| run_node(n).unwrap().count.value);
        assert_eq!(counts, if align == AlignTo::None { [1.0, 2.0] } else { [0.0, 0.0] }, "{align:?}");
    }
}
