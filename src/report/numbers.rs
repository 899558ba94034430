//! Values that are a few numbers, which are shown as lines over frames.

use std::sync::Arc;

use pegbar_engine::value::{Curve, Value, ValueRef, Vector, downcast};
use pegbar_nodes::data::{Affine2, Weights};

/// Lines of a port at most.
const MOST: usize = 24;

/// One of the numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    /// What stands above the axes that it shares with others.
    pub(crate) panel: &'static str,
    pub(crate) name: String,
}

/// True for a type that [`numbers`] takes apart.
pub(crate) fn is_numbers(ty: &str) -> bool {
    [Curve::NAME, Vector::NAME, Weights::NAME, Affine2::NAME].contains(&ty)
}

/// The numbers of a value, in the order of [`lines`]; `None` for one of another type.
pub(crate) fn numbers(value: &ValueRef) -> Option<Vec<f64>> {
    fn of<T: Value>(value: &ValueRef) -> Option<Arc<T>> {
        downcast(value.clone())
    }
    Some(match value.type_name() {
        Curve::NAME => vec![of::<Curve>(value)?.value],
        Vector::NAME => of::<Vector>(value)?.values.iter().copied().take(MOST).collect(),
        Weights::NAME => of::<Weights>(value)?.weights.iter().copied().take(MOST).collect(),
        Affine2::NAME => {
            let [[a1, a2, dx], [a3, a4, dy]] = of::<Affine2>(value)?.matrix;
            let determinant = a1 * a4 - a2 * a3;
            // How far the linear part turns, and by how much it widens areas: what a rotation and an even scale have of these is all there is of them.
            let turn = (a3 - a2).atan2(a1 + a4).to_degrees();
            vec![dx, dy, turn, determinant.abs().sqrt() * determinant.signum(), a1.hypot(a3), a2.hypot(a4)]
        }
        _ => return None,
    })
}

/// What the numbers of a type are called, `n` of them.
pub(crate) fn lines(ty: &str, n: usize) -> Vec<Line> {
    let line = |panel, name: &str| Line { panel, name: name.to_owned() };
    if ty == Affine2::NAME {
        let scales = ["of areas", "along x", "along y"].map(|name| line("scale", name));
        return [line("translation, pixels", "x"), line("translation, pixels", "y"), line("rotation, degrees", "")]
            .into_iter()
            .chain(scales)
            .collect();
    }
    let panel = if ty == Weights::NAME {
        "weights"
    } else if ty == Vector::NAME {
        "numbers"
    } else {
        "value"
    };
    let name = |i: usize| if n == 1 { String::new() } else { format!("{}", i + 1) };
    (0..n).map(|i| Line { panel, name: name(i) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_and_a_scale_are_read_off_a_matrix() {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let value: ValueRef = Arc::new(Affine2 { matrix: [[2.0 * cos, -2.0 * sin, 5.0], [2.0 * sin, 2.0 * cos, -7.0]] });
        let found = numbers(&value).unwrap();
        let expected = [5.0, -7.0, 30.0, 2.0, 2.0, 2.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert_eq!(lines("Affine2", 6).len(), found.len());
    }

    #[test]
    fn only_types_of_numbers_are_taken_apart() {
        let curve: ValueRef = Arc::new(Curve { value: 3.0 });
        assert_eq!((numbers(&curve), is_numbers("Curve"), is_numbers("Image")), (Some(vec![3.0]), true, false));
        let long: ValueRef = Arc::new(Vector { values: vec![1.0; 1000] });
        assert_eq!(numbers(&long).map(|n| n.len()), Some(MOST));
    }
}
