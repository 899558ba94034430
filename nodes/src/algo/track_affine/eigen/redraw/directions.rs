//! Which ways a pose is moved: the motion's, and mixtures of the keys that no motion makes.

use nalgebra::DMatrix;

use super::super::super::Model;
use super::{Drawn, DrawnPose, placed};

/// The directions of a step: those of the motion, and mixtures of the keys that no motion makes.
pub(super) struct Directions {
    /// Of the motion: which of the six parameters each moves.
    pub(super) motion: Vec<[f64; 6]>,
    /// Of the pose, each on its own, and each moving the points by one sample, root mean square.
    pub(super) mixes: Vec<Mix>,
}

/// A change of pose.
pub(super) struct Mix {
    /// What each key gains; nothing in all.
    pub(super) weights: Vec<f64>,
    /// What the six parameters of the motion take back.
    pub(super) motion: [f64; 6],
    /// How far the point moves that goes farthest, samples.
    pub(super) farthest: f64,
}

impl Directions {
    /// `place` gives the centred and scaled coordinates of a point of the frame.
    ///
    /// Keys differ by what a motion does as well, and by what other keys do: pictures of such differences cancel in part, and what is left of
    /// them is mostly the error of the differences. So motion is taken out first, and the rest is turned to its principal axes.
    pub(super) fn new(
        drawn: &dyn Drawn,
        model: Model,
        pose: &DrawnPose,
        place: impl Fn([f64; 2]) -> [f64; 2],
        sample: f64,
        least: f64,
    ) -> Self {
        let (dx, dy) = ([0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let mut motion = vec![dx, dy];
        match model {
            Model::Translation => {}
            Model::Rigid => motion.push([0.0, -1.0, 1.0, 0.0, 0.0, 0.0]),
            Model::Similarity => motion.extend([[0.0, -1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]]),
            Model::Affine => motion.extend((0..4).map(|i| std::array::from_fn(|k| f64::from(u8::from(k == i))))),
        }
        let mixes = mixes(drawn, &motion, pose, place, sample, least);
        Self { motion, mixes }
    }

    pub(super) fn len(&self) -> usize {
        self.motion.len() + self.mixes.len()
    }
}

/// The principal axes of what the keys change by beyond `motion`.
fn mixes(
    drawn: &dyn Drawn,
    motion: &[[f64; 6]],
    pose: &DrawnPose,
    place: impl Fn([f64; 2]) -> [f64; 2],
    sample: f64,
    least: f64,
) -> Vec<Mix> {
    let points = placed(drawn, pose);
    let (n, k, m) = (points.len(), pose.weights.len(), motion.len());
    let mean = 1.0 / libm::sqrt(n.max(1) as f64);
    let mut fields = DMatrix::zeros(2 * n, m);
    for (i, p) in points.iter().enumerate() {
        let [u, v] = place(*p);
        for (j, d) in motion.iter().enumerate() {
            fields[(2 * i, j)] = mean * (d[0] * u + d[1] * v + d[4]);
            fields[(2 * i + 1, j)] = mean * (d[2] * u + d[3] * v + d[5]);
        }
    }
    // Differences from the pose: what all keys have in common is no change.
    let linear = pose.motion.fixed_view::<2, 2>(0, 0).into_owned();
    let changes = DMatrix::from_fn(2 * n, k, |r, j| {
        let (i, c) = (r / 2, r % 2);
        let d: [f64; 2] = std::array::from_fn(|c| drawn.key(j)[i][c] - (0..k).map(|l| pose.weights[l] * drawn.key(l)[i][c]).sum::<f64>());
        mean * (linear[(c, 0)] * d[0] + linear[(c, 1)] * d[1]) / sample
    });
    let mut own = fields.transpose() * &fields;
    let floor = 1e-9 * own.trace();
    (0..m).for_each(|j| own[(j, j)] += floor);
    let Some(factor) = nalgebra::Cholesky::new(own) else { return Vec::new() };
    let taken = factor.solve(&(fields.transpose() * &changes));
    let rest = &changes - &fields * &taken;
    // Keys gain what they gain at the cost of the pose as it is: with `pose + e (key - pose)` weights still add up to 1.
    let Some(axes) = nalgebra::SymmetricEigen::try_new(rest.transpose() * &rest, f64::EPSILON, 1000) else { return Vec::new() };
    let mut order: Vec<usize> = (0..k).filter(|&j| axes.eigenvalues[j] > (k as f64) * least * least).collect();
    order.sort_by(|&a, &b| axes.eigenvalues[b].total_cmp(&axes.eigenvalues[a]));
    let mix = |j: usize| {
        let gain = 1.0 / libm::sqrt(axes.eigenvalues[j]);
        let shares: Vec<f64> = (0..k).map(|l| gain * axes.eigenvectors[(l, j)]).collect();
        let total: f64 = shares.iter().sum();
        let weights = (0..k).map(|l| shares[l] - total * pose.weights[l]).collect();
        let mut back = [0.0; 6];
        for (i, d) in motion.iter().enumerate() {
            let by: f64 = (0..k).map(|l| shares[l] * taken[(i, l)]).sum();
            back.iter_mut().zip(d).for_each(|(b, d)| *b -= by * d);
        }
        let gone = &rest * axes.eigenvectors.column(j) * (gain / mean);
        let farthest = gone.as_slice().as_chunks::<2>().0.iter().map(|[x, y]| libm::hypot(*x, *y)).fold(0.0, f64::max);
        Mix { weights, motion: back, farthest }
    };
    order.into_iter().map(mix).collect()
}
