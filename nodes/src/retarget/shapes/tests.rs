use super::*;
use crate::counted::clock;
use crate::keys::contours;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::Cancel;

fn keys() -> KeyShapes {
    let points = vec![2.0, 2.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 2.0, 2.0];
    KeyShapes { points: NdArray::new([2, 4, 2], points).unwrap(), names: Vec::new(), closed: true }
}

fn node(weights: &[f64], interpolation: Interpolation) -> RetargetShapes {
    let weights = In::new(Weights { weights: weights.to_vec() });
    RetargetShapes {
        keys: In::new(keys()),
        weights,
        motion: None,
        place: None,
        interpolation,
        inbetweens: 3,
        symmetric: true,
        anchor: None,
        align: AlignTo::None,
        align_model: Model::Affine,
    }
}

fn run(node: RetargetShapes, state: Option<&Ready>) -> Result<(RetargetShapesOutputs, Ready), NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    node.run(state, &Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
}

/// Half a quarter turn of a square, by each interpolation: in a straight line its corners come nearer to the middle.
#[test]
fn one_word_says_what_lies_between() {
    let far = 32_f64.sqrt();
    for (interpolation, y) in [(Interpolation::Linear, 2.0), (Interpolation::Extended, 6.0 - far), (Interpolation::Arap, 6.0 - far)] {
        let shape = run(node(&[0.5, 0.5], interpolation), None).unwrap().0.shape;
        assert!((shape.points[0][0] - 6.0).abs() < 1e-9 && (shape.points[0][1] - y).abs() < 1e-9, "{interpolation:?} {shape:?}");
    }
}

#[test]
fn placed_first_then_moved() {
    let mut node = node(&[1.0, 0.0], Interpolation::Arap);
    node.place = Some(In::new(Affine2 { matrix: [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]] }));
    node.motion = Some(In::new(Affine2 { matrix: [[1.0, 0.0, 5.0], [0.0, 1.0, -1.0]] }));
    assert_eq!(run(node, None).unwrap().0.shape.points, [[9.0, 3.0], [25.0, 3.0], [25.0, 19.0], [9.0, 19.0]]);
}

/// What was made ready for other keys is not used.
#[test]
fn other_keys_are_made_ready_anew() {
    let (_, state) = run(node(&[1.0, 0.0], Interpolation::Arap), None).unwrap();
    let mut moved = keys();
    moved.points.data_mut().iter_mut().for_each(|v| *v += 1.0);
    let truth = contours(&moved).remove(0);
    let mut other = node(&[1.0, 0.0], Interpolation::Arap);
    other.keys = In::new(moved);
    assert_eq!(run(other, Some(&state)).unwrap().0.shape.points, truth);
}

#[test]
fn weights_and_motions_that_do_not_fit_are_refused() {
    let error = run(node(&[1.0], Interpolation::Linear), None).err().unwrap();
    assert_eq!(error.message, "expected 2 weights, one for each key, or 2, one more for each in-between, found 1");
    let mut node = node(&[1.0, 0.0], Interpolation::Linear);
    node.motion = Some(In::new(Affine2 { matrix: [[f64::NAN; 3]; 2] }));
    assert_eq!(run(node, None).err().unwrap().message, "motion: expected a finite affine map, found NaN or infinity");
}

/// Section 3.4: the affine motion between output keys is taken out, what is between them blended, and the captured motion put on.
#[test]
fn aligned_keys_leave_the_motion_to_the_capture() {
    let mut turned = node(&[0.25, 0.75], Interpolation::Linear);
    turned.align = AlignTo::First;
    let shape = run(turned, None).unwrap().0.shape;
    let first = contours(&keys()).remove(0);
    assert!(shape.points.iter().flatten().zip(first.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-9), "{shape:?}");
}

#[test]
fn degenerate_keys_are_refused_by_name() {
    let message = |value: f64, interpolation, align| {
        let mut bad = keys();
        bad.points.data_mut()[11] = value;
        let node = RetargetShapes { keys: In::new(bad), align, ..node(&[0.5, 0.5], interpolation) };
        run(node, None).err().map(|e| e.message)
    };
    let at = "expected finite points, found NaN";
    for interpolation in [Interpolation::Linear, Interpolation::Extended, Interpolation::Arap] {
        for align in [AlignTo::None, AlignTo::First, AlignTo::Mean] {
            let found = message(f64::NAN, interpolation, align).unwrap();
            assert!(found.contains("expected finite points, found") && found.contains("NaN") && found.contains('1'), "{found}");
        }
    }
    assert!(message(f64::NAN, Interpolation::Linear, AlignTo::None).unwrap().contains(at));
    // Keys on one line have no inside; their weighted sum is fine.
    let mut line = keys();
    line.points.data_mut()[8..].copy_from_slice(&[0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
    let lined = |interpolation| run(RetargetShapes { keys: In::new(line.clone()), ..node(&[0.5, 0.5], interpolation) }, None);
    assert!(lined(Interpolation::Linear).is_ok() && lined(Interpolation::Arap).err().unwrap().message.contains("lie on one line"));
}
