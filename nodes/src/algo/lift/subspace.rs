//! A linear space of poses in its place. Jain et al. 2009, equations 12 to 16.

use nalgebra::{DMatrix, DVector, Vector3};

use super::{Framing, Stand};

type Pose = Vec<Vector3<f64>>;

/// Poses μ + C y (eq. 13), in the world at one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Subspace {
    /// μ.
    pub mean: Pose,
    /// Columns of C, orthonormal.
    pub directions: Vec<Pose>,
}

pub(super) fn inner(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

impl Subspace {
    /// A space of poses where the figure stands. Unless its poses are those of the world, the figure may still move anywhere: three more directions.
    pub fn placed(mean: &[f64], components: &[&[f64]], framing: Framing, stand: &Stand) -> Self {
        let vectors = |v: &[f64]| v.as_chunks::<3>().0.iter().map(|p| Vector3::from(*p)).collect::<Pose>();
        let mean: Pose = vectors(mean).into_iter().map(|p| stand.world(p)).collect();
        let turned = |c: &&[f64]| vectors(c).into_iter().map(|v| stand.outward(v)).collect();
        let mut directions: Vec<Pose> = components.iter().map(turned).collect();
        if framing != Framing::World {
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                let mut moved: Pose = vec![axis; mean.len()];
                // Twice, so that what is left is orthogonal to the last digit.
                for d in directions.iter().chain(&directions) {
                    let along = inner(d, &moved);
                    moved.iter_mut().zip(d).for_each(|(m, d)| *m -= along * d);
                }
                let length = inner(&moved, &moved).sqrt();
                if length > 1e-6 {
                    moved.iter_mut().for_each(|m| *m /= length);
                    directions.push(moved);
                }
            }
        }
        Self { mean, directions }
    }

    /// The pose in the space with the least energy, from the product of the system's matrix with a pose, and its right-hand side. `None` where it has none.
    pub(super) fn least(&self, times: impl Fn(&[Vector3<f64>]) -> Pose, right: &[Vector3<f64>]) -> Option<Pose> {
        let products: Vec<Pose> = self.directions.iter().map(|d| times(d)).collect();
        let p = self.directions.len();
        let at_mean = times(&self.mean);
        let rest: Pose = right.iter().zip(&at_mean).map(|(r, m)| r - m).collect();
        let matrix = DMatrix::from_fn(p, p, |i, j| inner(&self.directions[i], &products[j]));
        let y = matrix.cholesky()?.solve(&DVector::from_fn(p, |i, _| inner(&self.directions[i], &rest)));
        let mut pose = self.mean.clone();
        for (d, y) in self.directions.iter().zip(y.iter()) {
            pose.iter_mut().zip(d).for_each(|(p, d)| *p += d * *y);
        }
        Some(pose)
    }
}
