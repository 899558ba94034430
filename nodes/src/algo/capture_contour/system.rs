//! The linear system about a capture: steps of motion and weights together, and how sure they are.

use nalgebra::DMatrix;

use crate::algo::raster::Affine;
use crate::algo::track_affine::Model;

/// Parameters of a motion.
pub(super) fn n_motions(model: Model) -> usize {
    match model {
        Model::Translation => 2,
        Model::Rigid => 3,
        Model::Similarity => 4,
        Model::Affine => 6,
    }
}

/// Derivatives of coordinate `c` of a moved point: `s` before the linear part, `at` after it. The translation's come first.
pub(super) fn motion_row(model: Model, s: [f64; 2], at: [f64; 2], c: usize) -> [f64; 6] {
    let mut row = [0.0; 6];
    row[c] = 1.0;
    let turned = if c == 0 { -at[1] } else { at[0] };
    match model {
        Model::Translation => {}
        Model::Rigid => row[2] = turned,
        Model::Similarity => (row[2], row[3]) = (if c == 0 { s[0] } else { s[1] }, if c == 0 { -s[1] } else { s[0] }),
        Model::Affine => (row[2 + 2 * c], row[3 + 2 * c]) = (s[0], s[1]),
    }
    row
}

/// The normal equations of a Gauss-Newton step.
pub(super) struct System {
    pub(super) normal: DMatrix<f64>,
    /// What each parameter is counted in.
    pub(super) scale: Vec<f64>,
    /// The motion's parameters come first.
    pub(super) motions: usize,
}

impl System {
    pub(super) fn factor(&self) -> Option<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
        self.normal.clone().cholesky()
    }

    /// Condition, and standard deviations of a1 to a4, the centre and the weights, for a variance of the coordinates.
    pub(super) fn spread(&self, model: Model, motion: &Affine, free: &[usize], n_keys: usize, variance: f64) -> (f64, Vec<f64>) {
        let values = self.normal.clone().symmetric_eigenvalues();
        let (least, most) = (values.min(), values.max());
        let condition = if least > 1e-15 * most { most / least } else { f64::INFINITY };
        let inverse = if condition.is_finite() { self.factor().map(|f| f.inverse()) } else { None };
        let Some(inverse) = inverse else { return (f64::INFINITY, vec![f64::INFINITY; 6 + n_keys]) };
        let deviation = |row: &[(usize, f64)]| {
            let sum: f64 = row
                .iter()
                .flat_map(|a| row.iter().map(move |b| (a, b)))
                .map(|(a, b)| a.1 * self.scale[a.0] * inverse[(a.0, b.0)] * self.scale[b.0] * b.1)
                .sum();
            (variance * sum.max(0.0)).sqrt()
        };
        let mut out: Vec<f64> = linear_rows(model, motion).iter().map(|r| deviation(r)).collect();
        out.extend([deviation(&[(0, 1.0)]), deviation(&[(1, 1.0)])]);
        out.resize(6 + n_keys, 0.0);
        for (at, key) in free.iter().enumerate().skip(1) {
            out[6 + key] = deviation(&[(self.motions + at - 1, 1.0)]);
        }
        if let Some(first) = free.first() {
            // The first takes what the others leave of the sum.
            let all: Vec<(usize, f64)> = (1..free.len()).map(|at| (self.motions + at - 1, -1.0)).collect();
            out[6 + first] = deviation(&all);
        }
        (condition, out)
    }
}

/// How a1 to a4 depend on the parameters.
fn linear_rows(model: Model, m: &Affine) -> [Vec<(usize, f64)>; 4] {
    match model {
        Model::Translation => [(); 4].map(|()| Vec::new()),
        Model::Rigid => [-m[(1, 0)], -m[(1, 1)], m[(0, 0)], m[(0, 1)]].map(|d| vec![(2, d)]),
        Model::Similarity => [vec![(2, 1.0)], vec![(3, -1.0)], vec![(3, 1.0)], vec![(2, 1.0)]],
        Model::Affine => [2, 3, 4, 5].map(|j| vec![(j, 1.0)]),
    }
}
