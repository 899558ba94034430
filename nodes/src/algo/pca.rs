//! Principal components: the extended linear space of Bregler et al. 2002, section 3.1.3, equation 3.

use nalgebra::{DMatrix, SymmetricEigen};

/// A linear space around a mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Mean of the examples, [d].
    pub mean: Vec<f64>,
    /// Orthonormal rows, the widest first, [l, d]; the largest entry of each is positive.
    pub components: Vec<Vec<f64>>,
    /// Variance of the examples along each, over their number, [l].
    pub variances: Vec<f64>,
    /// Of each example, along each, [m, l].
    pub coordinates: Vec<Vec<f64>>,
    /// For 0, 1, 2, ... components the error of the worst example, as all components are added up to the rank of the examples.
    pub errors: Vec<f64>,
}

/// How many components are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// So many; fewer where the examples do not span them.
    Components(usize),
    /// The fewest with which no example is off by more.
    MaxError(f64),
}

/// Why examples span no space.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PcaError {
    /// None, or without coordinates.
    #[error("expected at least one example with coordinates, found none")]
    Empty,
    /// Examples of different lengths.
    #[error("expected {expected} coordinates in example {example} as in example 0, found {found}")]
    Count {
        /// The example, from 0.
        example: usize,
        /// Coordinates of example 0.
        expected: usize,
        /// Coordinates found.
        found: usize,
    },
    /// NaN, infinity, or so large that squares are.
    #[error("expected finite coordinates, found NaN, infinity or one beyond 1e100 in example {example}")]
    NotFinite {
        /// The example, from 0.
        example: usize,
    },
}

/// Directions with less than this share of the widest one's spread are rounding.
const RANK: f64 = 1e-7;

/// Principal components of `examples` about their mean; an example's error is the root of its squared distance over `points`, in the unit of
/// the coordinates.
///
/// Errors: no example, examples of different lengths or with coordinates that are not finite.
/// Cost: O(m d n + n³) for m examples of d coordinates and n the smaller of the two.
pub fn pca(examples: &[&[f64]], points: usize, keep: Keep) -> Result<Space, PcaError> {
    let d = validate(examples)?;
    let m = examples.len();
    let mean: Vec<f64> = (0..d).map(|i| examples.iter().map(|e| e[i]).sum::<f64>() / m as f64).collect();
    let mut rest: Vec<Vec<f64>> = examples.iter().map(|e| e.iter().zip(&mean).map(|(a, b)| a - b).collect()).collect();
    let directions = directions(&rest);
    let mut space = Space { mean, components: Vec::new(), variances: Vec::new(), coordinates: vec![Vec::new(); m], errors: Vec::new() };
    let worst = |rest: &[Vec<f64>]| rest.iter().map(|r| (inner(r, r) / points.max(1) as f64).sqrt()).fold(0.0, f64::max);
    space.errors.push(worst(&rest));
    for mut direction in directions {
        // Taken from what is left, a direction is orthogonal to those before it to the last digit.
        for earlier in &space.components {
            let along = inner(earlier, &direction);
            direction.iter_mut().zip(earlier).for_each(|(a, b)| *a -= along * b);
        }
        let length = inner(&direction, &direction).sqrt();
        // It was of length 1: what lay mostly along others is no direction of its own but what rounding left of one.
        if length < 0.5 {
            continue;
        }
        let largest = direction.iter().fold(0.0_f64, |a, b| if b.abs() > a.abs() { *b } else { a });
        direction.iter_mut().for_each(|v| *v /= length * largest.signum());
        let along: Vec<f64> = rest.iter().map(|r| inner(&direction, r)).collect();
        for (r, a) in rest.iter_mut().zip(&along) {
            r.iter_mut().zip(&direction).for_each(|(v, c)| *v -= a * c);
        }
        space.variances.push(inner(&along, &along) / m as f64);
        space.coordinates.iter_mut().zip(&along).for_each(|(c, a)| c.push(*a));
        space.components.push(direction);
        space.errors.push(worst(&rest));
    }
    let kept = match keep {
        Keep::Components(n) => n,
        Keep::MaxError(limit) => space.errors.iter().position(|e| *e <= limit).unwrap_or(space.components.len()),
    };
    space.components.truncate(kept);
    space.variances.truncate(kept);
    space.coordinates.iter_mut().for_each(|c| c.truncate(kept));
    Ok(space)
}

fn validate(examples: &[&[f64]]) -> Result<usize, PcaError> {
    let expected = examples.first().map_or(0, |e| e.len());
    if expected == 0 {
        return Err(PcaError::Empty);
    }
    for (example, e) in examples.iter().enumerate() {
        if e.len() != expected {
            return Err(PcaError::Count { example, expected, found: e.len() });
        }
        if !e.iter().all(|v| v.abs() <= 1e100) {
            return Err(PcaError::NotFinite { example });
        }
    }
    Ok(expected)
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The directions in which centred examples spread, the widest first, not quite orthonormal.
fn directions(rest: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let (m, d) = (rest.len(), rest[0].len());
    if m > d {
        return directions_of_many(rest, d);
    }
    let gram = DMatrix::from_fn(m, m, |i, j| inner(&rest[i], &rest[j]));
    let eigen = SymmetricEigen::new(gram);
    let mut order: Vec<usize> = (0..m).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let widest = order.first().map_or(0.0, |&i| eigen.eigenvalues[i]);
    let spread = |&i: &usize| eigen.eigenvalues[i] > widest * RANK * RANK && eigen.eigenvalues[i] > 0.0;
    let direction = |i: usize| {
        let mut sum = vec![0.0; rest[0].len()];
        for (r, w) in rest.iter().zip(eigen.eigenvectors.column(i).iter()) {
            sum.iter_mut().zip(r).for_each(|(a, b)| *a += w * b);
        }
        let length = inner(&sum, &sum).sqrt();
        sum.iter_mut().for_each(|v| *v /= length);
        sum
    };
    // One example less than there are spans what is centred.
    order.into_iter().take(m - 1).filter(spread).map(direction).collect()
}

/// The same by the matrix of the coordinates' products, where there are more examples than coordinates.
fn directions_of_many(rest: &[Vec<f64>], d: usize) -> Vec<Vec<f64>> {
    let mut products = DMatrix::<f64>::zeros(d, d);
    for r in rest {
        for (j, b) in r.iter().enumerate() {
            products.column_mut(j).iter_mut().zip(r).for_each(|(p, a)| *p += a * b);
        }
    }
    let eigen = SymmetricEigen::new(products);
    let mut order: Vec<usize> = (0..d).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let widest = eigen.eigenvalues[order[0]];
    let spread = |&i: &usize| eigen.eigenvalues[i] > widest * RANK * RANK && eigen.eigenvalues[i] > 0.0;
    order.into_iter().filter(spread).map(|i| eigen.eigenvectors.column(i).iter().copied().collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NUMPY_VARIANCES: [f64; 3] = [2.502_581_845_525_815_8, 1.741_817_366_320_784_8, 0.005_600_788_153_401_99];
    const NUMPY_ROWS: [[f64; 3]; 3] = [
        [0.904_602_645_905_036_9, 0.423_753_330_149_247_4, -0.046_121_233_819_458_48],
        [-0.282_544_675_872_492_2, 0.677_113_011_527_882_1, 0.679_475_147_268_647_8],
        [0.319_159_143_935_615_1, -0.601_623_706_985_574_9, 0.732_247_469_121_758_2],
    ];
    const EXAMPLES: [[f64; 3]; 4] = [[1.0, 2.0, 0.5], [2.0, 1.0, -0.5], [4.0, 4.0, 1.0], [0.0, 3.0, 2.0]];

    fn views() -> Vec<&'static [f64]> {
        EXAMPLES.iter().map(|e| e.as_slice()).collect()
    }

    /// `numpy.linalg.svd(X - X.mean(0))`, NumPy 2.3: squared singular values over 4, rows of Vᵀ with the largest entry positive.
    #[test]
    fn as_numpy_has_it() {
        let space = pca(&views(), 1, Keep::Components(3)).unwrap();
        for (found, truth) in space.variances.iter().zip(NUMPY_VARIANCES) {
            assert!((found - truth).abs() < 1e-12, "{found} {truth}");
        }
        for (row, truth) in space.components.iter().zip(NUMPY_ROWS) {
            assert!(row.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-12), "{row:?} {truth:?}");
        }
    }

    #[test]
    fn with_all_components_every_example_comes_back() {
        let space = pca(&views(), 1, Keep::MaxError(1e-9)).unwrap();
        assert_eq!(space.components.len(), 3);
        assert!(space.errors.windows(2).all(|e| e[1] <= e[0]) && space.errors[3] < 1e-12, "{:?}", space.errors);
    }

    #[test]
    fn the_fewest_that_do_are_kept() {
        let all = pca(&views(), 1, Keep::Components(3)).unwrap();
        let some = pca(&views(), 1, Keep::MaxError(all.errors[1])).unwrap();
        assert_eq!(some.components.len(), 1);
        assert_eq!(some.errors, all.errors);
    }

    #[test]
    fn no_more_components_come_out_than_the_examples_span() {
        // Fourteen mixes of three directions, one of them ten thousand times as wide as the last.
        let wide = |i: usize, k: usize| libm::sin((i * (k + 2)) as f64) * [1e4, 1.0, 1.0][k];
        let example =
            |e: usize| (0..40).map(|i| 5.0 + (0..3).map(|k| wide(i, k) * libm::cos((e * e * (k + 1)) as f64)).sum::<f64>()).collect();
        let examples: Vec<Vec<f64>> = (0..14).map(example).collect();
        let space = pca(&examples.iter().map(Vec::as_slice).collect::<Vec<_>>(), 1, Keep::Components(13)).unwrap();
        assert_eq!(space.components.len(), 3);
        for (i, a) in space.components.iter().enumerate() {
            for (j, b) in space.components.iter().enumerate() {
                assert!((inner(a, b) - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j}");
            }
        }
    }

    #[test]
    fn examples_that_are_all_the_same_span_nothing() {
        let same = [1.0, 2.0];
        let space = pca(&[&same, &same, &same], 1, Keep::Components(5)).unwrap();
        assert_eq!((space.components.len(), space.mean), (0, vec![1.0, 2.0]));
    }

    #[test]
    fn what_spans_no_space_is_refused() {
        assert_eq!(pca(&[], 1, Keep::Components(1)), Err(PcaError::Empty));
        let other = PcaError::Count { example: 1, expected: 2, found: 1 };
        assert_eq!(pca(&[&[1.0, 2.0], &[1.0]], 1, Keep::Components(1)), Err(other));
        assert_eq!(pca(&[&[f64::NAN]], 1, Keep::Components(1)), Err(PcaError::NotFinite { example: 0 }));
    }
}
