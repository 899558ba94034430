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

    /// The diagonal of the Hessian if every gradient had no direction, in the same order.
    pub(super) fn even(&self) -> Vector6<f64> {
        let energy = |k: usize| 0.5 * (self.tensor[0][k] + self.tensor[2][k]);
        Vector6::new(energy(3), energy(5), energy(3), energy(5), energy(0), energy(0))
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

/// Visibility under which a direction is held to where it started, the more the less it is seen, for a residual of `misfit` (a share of the contrast);
/// 1 is what gradients of all directions would show.
///
/// The rotation of a drawn disc is seen by the raggedness of its outline alone, some twentieth; and what the raggedness says grows with the square of its size.
pub(super) fn hardly_seen(misfit: f64) -> f64 {
    (0.02 + 10.0 * misfit * misfit).min(0.12)
}

/// Visibility under which a direction counts as invisible; it is then left as it started.
const INVISIBLE: f64 = 1e-7;

/// The normal equations with what they are measured against.
pub(super) struct Equations<'a> {
    pub(super) h: Matrix6<f64>,
    pub(super) b: Vector6<f64>,
    /// The diagonal of the Hessian if the same gradients had all directions: a thin limb is small across, not unseen.
    pub(super) even: Vector6<f64>,
    pub(super) hold: &'a Hold,
}

/// What is done about directions that are hardly seen.
#[derive(Clone, Debug, Default)]
pub(super) struct Hold {
    /// How far the motion is from where they are held.
    pub(super) away: Vector6<f64>,
    /// Visibility under which they are.
    pub(super) hardly: f64,
}

/// Solves in the columns of `basis`, the parameters of a model over the six affine ones.
fn solve_in<const K: usize>(eq: &Equations, basis: &SMatrix<f64, 6, K>, exact: bool) -> Option<Step> {
    let (mut h, mut b): (SMatrix<f64, K, K>, SVector<f64, K>) = (basis.transpose() * eq.h * basis, basis.transpose() * eq.b);
    if !h.iter().chain(b.iter()).all(|v| v.is_finite()) || (0..K).all(|i| h[(i, i)] <= 0.0) {
        return None;
    }
    let condition = if exact { condition(&h) } else { f64::NAN };
    let even: SVector<f64, K> = basis.map(|v| v * v).transpose() * eq.even;
    let unit = even.map(|v| if v > 0.0 { 1.0 / libm::sqrt(v) } else { 0.0 });
    for i in 0..K {
        b[i] *= unit[i];
        for j in 0..K {
            h[(i, j)] *= unit[i] * unit[j];
        }
    }
    // The trace of the inverse bounds the least eigenvalue from below.
    let p = match h.cholesky().filter(|f| f.inverse().trace() * eq.hold.hardly < 1.0) {
        Some(factor) => factor.solve(&b),
        None => {
            let mut away: SVector<f64, K> = basis.transpose() * eq.hold.away;
            for i in 0..K {
                away[i] *= libm::sqrt(even[i]) / basis.column(i).norm_squared();
            }
            held(h, &b, &away, eq.hold.hardly)
        }
    };
    Some(Step { theta: basis * p.component_mul(&unit), condition })
}

/// The solution with the directions that are hardly seen drawn back by `away`.
fn held<const K: usize>(h: SMatrix<f64, K, K>, b: &SVector<f64, K>, away: &SVector<f64, K>, hardly: f64) -> SVector<f64, K> {
    let (values, vectors) = jacobi(h);
    let mut p = SVector::<f64, K>::zeros();
    for i in 0..K {
        let v = vectors.column(i);
        let hold = (hardly - values[i]).max(0.0);
        let seen = if values[i] > INVISIBLE { v.dot(b) } else { 0.0 };
        p += v * ((seen + hold * v.dot(away)) / (values[i].max(0.0) + hold));
    }
    p
}

/// Largest over least eigenvalue.
fn condition<const K: usize>(h: &SMatrix<f64, K, K>) -> f64 {
    let largest = (0..K).fold(0.0f64, |m, i| m.max(h[(i, i)]));
    let (values, _) = jacobi(h / largest);
    let top = values.iter().fold(0.0f64, |m, v| m.max(*v));
    let least = values.iter().fold(f64::INFINITY, |m, v| m.min(*v));
    if least > 0.0 { top / least } else { f64::INFINITY }
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

/// How far `motion` is from `start` as the increment that would lead from the one to the other, to first order, in the units of [`increment`].
pub(super) fn away(motion: &Affine, start: &Affine, centre: [f64; 2], scale: f64) -> Vector6<f64> {
    let Some(back) = invert(start) else { return Vector6::zeros() };
    let e = compose(&back, motion);
    let d = apply(&e, centre.into()) - Vector2::from(centre);
    Vector6::new((e[(0, 0)] - 1.0) * scale, e[(0, 1)] * scale, e[(1, 0)] * scale, (e[(1, 1)] - 1.0) * scale, d.x, d.y)
}

/// Solves for the increment of `model`; what is hardly seen is led back as `hold` says. `exact` also finds the condition number; else it may be not-a-number.
/// `None` where nothing can be seen (no gradient) or a sum is not finite.
pub(super) fn solve(sums: &Sums, hold: &Hold, model: Model, exact: bool) -> Option<Step> {
    solve_equations(&Equations { h: sums.hessian(), b: sums.gradient(), even: sums.even(), hold }, model, exact)
}

/// The same for given normal equations.
pub(super) fn solve_equations(eq: &Equations, model: Model, exact: bool) -> Option<Step> {
    let dx = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let dy = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let turn = [0.0, -1.0, 1.0, 0.0, 0.0, 0.0];
    let grow = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    match model {
        Model::Translation => solve_in(eq, &SMatrix::<f64, 6, 2>::from_columns(&[dx.into(), dy.into()]), exact),
        Model::Rigid => solve_in(eq, &SMatrix::<f64, 6, 3>::from_columns(&[turn.into(), dx.into(), dy.into()]), exact),
        Model::Similarity => solve_in(eq, &SMatrix::<f64, 6, 4>::from_columns(&[turn.into(), grow.into(), dx.into(), dy.into()]), exact),
        Model::Affine => solve_in(eq, &Matrix6::identity(), exact),
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
