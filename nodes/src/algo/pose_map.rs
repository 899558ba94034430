//! What goes with a pose: values known at examples, read at any coordinates between them.
//!
//! The smoothest function that takes the given values at the examples: radial basis functions φ(r) = r, the biharmonic spline of space, and an affine
//! part (Duchon 1977; Wahba 1990, section 2.4). Pose spaces of pictures are curved, so that a linear map alone would cut the corners.

use nalgebra::{DMatrix, DVector};

/// Values over coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseMap {
    examples: Vec<Vec<f64>>,
    /// Weights of the examples, then of 1 and of each coordinate: [m + l + 1, d], or fewer rows without the affine part's slopes.
    weights: DMatrix<f64>,
    affine: usize,
}

/// Why there is no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PoseMapError {
    /// Nothing to go by.
    #[error("expected at least one example, found none")]
    Empty,
    /// Coordinates or values of different lengths.
    #[error("expected {examples} rows of coordinates and of values, each of one length, found others")]
    Counts {
        /// Examples.
        examples: usize,
    },
    /// NaN or infinity.
    #[error("expected finite coordinates and values, found NaN or infinity in example {example}")]
    NotFinite {
        /// The example, from 0.
        example: usize,
    },
}

impl PoseMap {
    /// The map through `values` at `examples`: of l + 1 of them that span l coordinates, the affine one. Examples in one place get their mean value. O(m³ + m² d) for m examples of d values.
    ///
    /// # Errors
    /// No examples, rows of different lengths, values that are not finite.
    pub fn new(examples: &[Vec<f64>], values: &[&[f64]]) -> Result<Self, PoseMapError> {
        let first = examples.first().ok_or(PoseMapError::Empty)?;
        let (m, l, d) = (examples.len(), first.len(), values.first().map_or(0, |v| v.len()));
        if values.len() != m || examples.iter().any(|e| e.len() != l) || values.iter().any(|v| v.len() != d) {
            return Err(PoseMapError::Counts { examples: m });
        }
        let fine = |i: &usize| examples[*i].iter().chain(values[*i]).all(|v| v.is_finite());
        if let Some(example) = (0..m).find(|i| !fine(i)) {
            return Err(PoseMapError::NotFinite { example });
        }
        let (apart, means) = merged(examples, values, d);
        let m = apart.len();
        let affine = if m > l { l + 1 } else { 1 };
        let weights = solved(&apart, &means, affine).or_else(|| solved(&apart, &means, 1));
        let weights = weights.unwrap_or_else(|| mean_alone(&means, m));
        let affine = weights.nrows() - m;
        Ok(Self { examples: apart, weights, affine })
    }

    /// The values at `coordinates`.
    pub fn at(&self, coordinates: &[f64]) -> Vec<f64> {
        let row = row(&self.examples, coordinates, self.affine);
        (0..self.weights.ncols()).map(|k| self.weights.column(k).dot(&row)).collect()
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    libm::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum())
}

/// Distances to the examples, then 1 and the coordinates.
fn row(examples: &[Vec<f64>], at: &[f64], affine: usize) -> DVector<f64> {
    let near = examples.iter().map(|e| distance(e, at));
    let rest = [1.0].into_iter().chain(at.iter().copied()).take(affine);
    DVector::from_iterator(examples.len() + affine, near.chain(rest))
}

/// Examples that are apart, with the mean of the values of those that are not.
fn merged(examples: &[Vec<f64>], values: &[&[f64]], d: usize) -> (Vec<Vec<f64>>, DMatrix<f64>) {
    let size = examples.iter().flatten().fold(0.0f64, |a, v| a.max(v.abs()));
    let mut apart: Vec<Vec<f64>> = Vec::new();
    let mut sums: Vec<(f64, Vec<f64>)> = Vec::new();
    for (e, v) in examples.iter().zip(values) {
        let known = apart.iter().position(|a| distance(a, e) <= 1e-9 * size);
        let at = known.unwrap_or_else(|| {
            apart.push(e.clone());
            sums.push((0.0, vec![0.0; d]));
            apart.len() - 1
        });
        sums[at].0 += 1.0;
        sums[at].1.iter_mut().zip(*v).for_each(|(s, v)| *s += v);
    }
    (apart, DMatrix::from_fn(sums.len(), d, |i, k| sums[i].1[k] / sums[i].0))
}

/// The weights of the spline with so many affine terms; `None` where they are not determined.
fn solved(examples: &[Vec<f64>], values: &DMatrix<f64>, affine: usize) -> Option<DMatrix<f64>> {
    let m = examples.len();
    let mut system = DMatrix::zeros(m + affine, m + affine);
    for (i, e) in examples.iter().enumerate() {
        let row = row(examples, e, affine);
        system.row_mut(i).copy_from(&row.transpose());
        (0..affine).for_each(|k| system[(m + k, i)] = row[m + k]);
    }
    let mut right = DMatrix::zeros(m + affine, values.ncols());
    right.rows_mut(0, m).copy_from(values);
    let found = system.lu().solve(&right)?;
    let size = values.amax().max(f64::MIN_POSITIVE);
    let rebuilt = |i: usize| (row(examples, &examples[i], affine).transpose() * &found - values.row(i)).amax();
    (found.iter().all(|v| v.is_finite()) && (0..m).all(|i| rebuilt(i) <= 1e-6 * size)).then_some(found)
}

fn mean_alone(values: &DMatrix<f64>, m: usize) -> DMatrix<f64> {
    let mut weights = DMatrix::zeros(m + 1, values.ncols());
    (0..values.ncols()).for_each(|k| weights[(m, k)] = values.column(k).mean());
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Vec<f64>> {
        (0..5).flat_map(|i| (0..4).map(move |j| vec![f64::from(i), f64::from(j) * 0.7])).collect()
    }

    #[test]
    fn examples_are_met_and_affine_maps_are_kept_everywhere() {
        let examples = grid();
        let value = |e: &[f64]| [1.0 + 2.0 * e[0] - 3.0 * e[1], e[0]];
        let values: Vec<[f64; 2]> = examples.iter().map(|e| value(e)).collect();
        let views: Vec<&[f64]> = values.iter().map(|v| v.as_slice()).collect();
        let map = PoseMap::new(&examples, &views).unwrap();
        for at in [[0.0, 0.0], [1.3, 0.9], [7.0, -4.0]] {
            let (found, truth) = (map.at(&at), value(&at));
            assert!((found[0] - truth[0]).abs() + (found[1] - truth[1]).abs() < 1e-9, "{found:?} {truth:?}");
        }
    }

    #[test]
    fn on_a_line_it_is_piecewise_linear() {
        let examples: Vec<Vec<f64>> = [0.0, 1.0, 3.0, 4.0].map(|x| vec![x]).to_vec();
        let values = [[0.0], [1.0], [-1.0], [5.0]];
        let views: Vec<&[f64]> = values.iter().map(|v| v.as_slice()).collect();
        let map = PoseMap::new(&examples, &views).unwrap();
        for (x, truth) in [(0.5, 0.5), (2.0, 0.0), (3.25, 0.5), (3.0, -1.0)] {
            assert!((map.at(&[x])[0] - truth).abs() < 1e-12, "{x}: {}", map.at(&[x])[0]);
        }
    }

    #[test]
    fn repeated_examples_one_example_and_none() {
        let twice = PoseMap::new(&[vec![1.0], vec![1.0]], &[&[2.0], &[4.0]]).unwrap();
        assert!((twice.at(&[1.0])[0] - 3.0).abs() < 1e-12);
        assert_eq!(PoseMap::new(&[vec![]], &[&[2.0]]).unwrap().at(&[]), [2.0]);
        assert_eq!(PoseMap::new(&[], &[]), Err(PoseMapError::Empty));
        assert_eq!(PoseMap::new(&[vec![f64::NAN]], &[&[2.0]]), Err(PoseMapError::NotFinite { example: 0 }));
        assert_eq!(PoseMap::new(&[vec![1.0]], &[]), Err(PoseMapError::Counts { examples: 1 }));
    }
}
