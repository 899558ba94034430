use super::*;
use crate::counted::clock;
use pegbar_engine::node::Cancel;

fn run(shapes: &[Vec<[f64; 2]>], max_error: f64, components: Option<u32>) -> Result<KeysBasisOutputs, NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    let keys = In::new(key_shapes(shapes, Vec::new(), true).unwrap());
    KeysBasis { keys, max_error, components }.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
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
    assert_eq!(error.message, "expected finite coordinates, found NaN, infinity or one beyond 1e100 in example 0");
    assert_eq!(run(&[], 0.1, None).err().unwrap().message, "expected at least one example with coordinates, found none");
}
