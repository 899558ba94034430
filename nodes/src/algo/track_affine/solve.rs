//! The normal equations of one step and the motion models.

use nalgebra::{Matrix2, Matrix6, SMatrix, SVector, Vector2, Vector6};

use super::Model;
use crate::algo::raster::{Affine, apply, compose, invert};

/// Weighted sums of products over the region; x and y are centred and scaled reference coordinates.
#[derive(Clone, Debug, Default)]
pub(super) struct Sums {
    /// For each of gx gx, gx gy, gy gy: the sums with 1, x, y, x x, x y, y y.
    pub(super) tensor: [[f64; 6]; 3],
    /// For each of gx, gy: the sums of the residual with 1, x, y.
    pub(super) right: [[f64; 3]; 2],
}

impl Sums {
    /// H^T W H of equation (12) of Bregler et al., in the order a1 a2 a3 a4 dx dy.
    pub(super) fn hessian(&self) -> Matrix6<f64> {
        // Powers of the six columns: which gradient, and which of 1, x, y multiplies it.
        const COLUMNS: [(usize, usize); 6] = [(0, 1), (0, 2), (1, 1), (1, 2), (0, 0), (1, 0)];
        const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        Matrix6::from_fn(|i, j| {
            let ((ga, pa), (gb, pb)) = (COLUMNS[i], COLUMNS[j]);
            self.tensor[ga + gb][PRODUCT[pa][pb]]
        })
    }

    /// H^T W r, in the same order.
    pub(super) fn gradient(&self) -> Vector6<f64> {
        let [x, y] = &self.right;
        Vector6::new(x[1], x[2], y[1], y[2], x[0], y[0])
    }
}

/// A solved step: the six increments, and what the Hessian says about them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) theta: Vector6<f64>,
    /// Largest over least eigenvalue of the model's Hessian; infinite where some parameter cannot be seen at all.
    pub(super) condition: f64,
}

/// Relative eigenvalue under which a direction counts as invisible; it is then left as predicted.
const INVISIBLE: f64 = 1e-7;

/// The parameters of each model as columns over the six affine ones.
fn solve_in<const K: usize>(h: &Matrix6<f64>, b: &Vector6<f64>, basis: &SMatrix<f64, 6, K>, exact: bool) -> Option<Step> {
    let (hk, bk): (SMatrix<f64, K, K>, SVector<f64, K>) = (basis.transpose() * h * basis, basis.transpose() * b);
    if !hk.iter().chain(bk.iter()).all(|v| v.is_finite()) {
        return None;
    }
    let largest = (0..K).fold(0.0f64, |m, i| m.max(hk[(i, i)]));
    if largest <= 0.0 {
        return None;
    }
    if !exact
        && let Some(factor) = (hk / largest).cholesky()
        && (0..K).all(|i| factor.l_dirty()[(i, i)] > 1e-3)
    {
        return Some(Step { theta: basis * factor.solve(&(bk / largest)), condition: f64::NAN });
    }
    let (values, vectors) = jacobi(hk / largest);
    let top = values.iter().fold(0.0f64, |m, v| m.max(*v));
    let mut p = SVector::<f64, K>::zeros();
    for i in 0..K {
        if values[i] > INVISIBLE * top {
            let v = vectors.column(i);
            p += v * (v.dot(&bk) / largest / values[i]);
        }
    }
    let least = values.iter().fold(f64::INFINITY, |m, v| m.min(*v));
    let condition = if least > 0.0 { top / least } else { f64::INFINITY };
    Some(Step { theta: basis * p, condition })
}

/// Eigenvalues and vectors of a small symmetric matrix by cyclic Jacobi rotations: a fixed count of sweeps, so it always ends.
fn jacobi<const K: usize>(mut a: SMatrix<f64, K, K>) -> (SVector<f64, K>, SMatrix<f64, K, K>) {
    let mut v = SMatrix::<f64, K, K>::identity();
    for _ in 0..12 {
        for p in 0..K {
            for q in p + 1..K {
                if a[(p, q)] == 0.0 {
                    continue;
                }
                let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
                let t = 1.0f64.copysign(theta) / (theta.abs() + libm::sqrt(theta * theta + 1.0));
                let c = 1.0 / libm::sqrt(t * t + 1.0);
                let s = t * c;
                for k in 0..K {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    (a[(k, p)], a[(k, q)]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (v[(k, p)], v[(k, q)]);
                    (v[(k, p)], v[(k, q)]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..K {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    (a.diagonal(), v)
}

/// Solves for the increment of `model`. `exact` also finds the condition number; else it may be not-a-number.
/// `None` where nothing can be seen (no gradient) or a sum is not finite.
pub(super) fn solve(sums: &Sums, model: Model, exact: bool) -> Option<Step> {
    let (h, b) = (sums.hessian(), sums.gradient());
    let dx = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let dy = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let turn = [0.0, -1.0, 1.0, 0.0, 0.0, 0.0];
    let grow = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    match model {
        Model::Translation => solve_in(&h, &b, &SMatrix::<f64, 6, 2>::from_columns(&[dx.into(), dy.into()]), exact),
        Model::Rigid => solve_in(&h, &b, &SMatrix::<f64, 6, 3>::from_columns(&[turn.into(), dx.into(), dy.into()]), exact),
        Model::Similarity => {
            solve_in(&h, &b, &SMatrix::<f64, 6, 4>::from_columns(&[turn.into(), grow.into(), dx.into(), dy.into()]), exact)
        }
        Model::Affine => solve_in(&h, &b, &Matrix6::identity(), exact),
    }
}

/// The map of the reference plane that an increment stands for, coordinates being (p - `centre`) / `scale`.
pub(super) fn increment(theta: &Vector6<f64>, model: Model, centre: [f64; 2], scale: f64) -> Affine {
    let mut linear = Matrix2::new(1.0 + theta[0] / scale, theta[1] / scale, theta[2] / scale, 1.0 + theta[3] / scale);
    if model == Model::Rigid {
        let (s, c) = libm::sincos(theta[2] / scale);
        linear = Matrix2::new(c, -s, s, c);
    }
    let c = Vector2::from(centre);
    let t = c + Vector2::new(theta[4], theta[5]) - linear * c;
    Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
}

/// The map of `model` next to `m` that moves `pivot` as `m` does.
pub(super) fn project(m: &Affine, model: Model, pivot: [f64; 2]) -> Affine {
    let pivot = Vector2::from(pivot);
    let (a, b) = (0.5 * (m[(0, 0)] + m[(1, 1)]), 0.5 * (m[(1, 0)] - m[(0, 1)]));
    let size = libm::hypot(a, b);
    let linear = match model {
        Model::Affine => return *m,
        Model::Rigid if size > 1e-12 => Matrix2::new(a / size, -b / size, b / size, a / size),
        Model::Similarity if size > 1e-12 => Matrix2::new(a, -b, b, a),
        _ => Matrix2::identity(),
    };
    let t = apply(m, pivot) - linear * pivot;
    Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])
}

/// `motion` after the inverse of the increment (Baker and Matthews 2004, the inverse compositional update); `None` where it is singular.
pub(super) fn update(motion: &Affine, step: &Affine) -> Option<Affine> {
    let next = compose(motion, &invert(step)?);
    is_sane(&next).then_some(next)
}

/// True for a finite map that keeps orientation and neither collapses nor explodes areas.
pub(super) fn is_sane(m: &Affine) -> bool {
    let det = m[(0, 0)] * m[(1, 1)] - m[(0, 1)] * m[(1, 0)];
    m.iter().all(|v| v.is_finite() && v.abs() < 1e9) && det > 1e-3 && det < 1e3
}

/// Largest displacement between two maps over the corners of a box (left, top, right, bottom).
pub(super) fn distance(a: &Affine, b: &Affine, bounds: [f64; 4]) -> f64 {
    let [x0, y0, x1, y1] = bounds;
    [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].iter().fold(0.0f64, |m, &(x, y)| {
        let p = Vector2::new(x, y);
        let d = apply(a, p) - apply(b, p);
        m.max(libm::hypot(d.x, d.y))
    })
}
