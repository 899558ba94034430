//! The motion between two contours of the same points, in closed form.
//!
//! Bregler, Loeb, Chuang, Deshpande 2002, equations (5) and (6): A = V Sᵀ (S Sᵀ)⁻¹. Here both contours are centred, which takes the
//! translation out exactly, and the two columns of S are made orthogonal one after the other, twice, in place of (S Sᵀ)⁻¹: the same answer
//! without the squared condition number.

use super::raster::Affine;
use super::track_affine::Model;

/// What a fit found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// `to` from `from`.
    pub motion: Affine,
    /// Root mean square distance of the points from where the motion takes them, pixels.
    pub rms: f64,
    /// The model that was fitted: a smaller one than was asked for where the points do not determine it.
    pub model: Model,
    /// Largest over least spread of `from` about its centre, from 1; infinite where its points lie on a line.
    pub condition: f64,
}

/// Why there is no fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The contours have another number of points.
    #[error("expected as many points as the first contour has, {from}, found {to}")]
    Counts {
        /// Points of the first.
        from: usize,
        /// Points of the second.
        to: usize,
    },
    /// There are no points.
    #[error("expected a contour with points, found none")]
    Empty,
    /// A coordinate is infinite or not a number.
    #[error("expected finite points, found ({x}, {y}) at point {at}")]
    NotFinite {
        /// Position of the point, from 0.
        at: usize,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
    },
}

/// Spread across the line over spread along it, below which points count as lying on it: rounding of ordinary coordinates, squared
/// conditioning left over.
const FLAT: f64 = 1e-9;

/// The first point that is not finite.
///
/// # Errors
/// Where there is one.
pub fn finite(points: &[[f64; 2]]) -> Result<(), FitError> {
    match points.iter().position(|p| !(p[0].is_finite() && p[1].is_finite())) {
        Some(at) => Err(FitError::NotFinite { at, x: points[at][0], y: points[at][1] }),
        None => Ok(()),
    }
}

/// Mean of the points; the origin where there are none.
pub fn centroid(points: &[[f64; 2]]) -> [f64; 2] {
    let n = points.len().max(1) as f64;
    // About the first point, so that a contour far from the origin loses nothing.
    let o = points.first().copied().unwrap_or_default();
    let sum = points.iter().fold([0.0; 2], |s, p| [s[0] + (p[0] - o[0]), s[1] + (p[1] - o[1])]);
    [o[0] + sum[0] / n, o[1] + sum[1] / n]
}

/// Area that a closed contour encloses, in square pixels: positive where it runs clockwise on screen (y down).
pub fn area(points: &[[f64; 2]]) -> f64 {
    let Some(o) = points.first() else { return 0.0 };
    let cross = |a: &[f64; 2], b: &[f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (b[0] - o[0]) * (a[1] - o[1]);
    0.5 * points.windows(2).map(|p| cross(&p[0], &p[1])).sum::<f64>()
}

/// The motion of `model` that takes `from` nearest to `to` in the sense of least squares.
///
/// Two different points, or points on a line, do not determine an affine motion: a similarity is fitted then. Points that all coincide
/// determine a translation alone. `model` of the answer says so.
///
/// # Errors
/// Contours with another number of points, without any, or with one that is not finite.
pub fn fit(from: &[[f64; 2]], to: &[[f64; 2]], model: Model) -> Result<Fit, FitError> {
    if from.len() != to.len() {
        return Err(FitError::Counts { from: from.len(), to: to.len() });
    }
    if from.is_empty() {
        return Err(FitError::Empty);
    }
    finite(from)?;
    finite(to)?;
    Ok(fit_finite(from, to, model))
}

/// As [`fit`], of contours that are known to be in order: as many points each, at least one, all finite.
pub(crate) fn fit_finite(from: &[[f64; 2]], to: &[[f64; 2]], model: Model) -> Fit {
    let (s, v) = (centroid(from), centroid(to));
    let moments = Moments::of(from, to, s, v);
    let (least, most) = moments.spread();
    // A spread that is all rounding of the coordinates is none.
    let coincide = most <= 1e-24 * from.len() as f64 * (s[0] * s[0] + s[1] * s[1]) || most == 0.0;
    let flat = least <= FLAT * FLAT * most;
    let model = match model {
        Model::Affine if flat && !coincide => Model::Similarity,
        _ if coincide => Model::Translation,
        other => other,
    };
    let linear = match model {
        Model::Translation => [[1.0, 0.0], [0.0, 1.0]],
        Model::Rigid => rotation(moments.turn()),
        Model::Similarity => {
            let [c, s] = moments.turn();
            let q = moments.xx + moments.yy;
            [[c / q, -s / q], [s / q, c / q]]
        }
        Model::Affine => affine(from, to, s, v, moments.yy > moments.xx),
    };
    let [[a, b], [c, d]] = linear;
    let motion = Affine::new(a, b, v[0] - (a * s[0] + b * s[1]), c, d, v[1] - (c * s[0] + d * s[1]));
    let condition = if flat { f64::INFINITY } else { (most / least).sqrt() };
    Fit { motion, rms: rms(&linear, from, to, s, v), model, condition }
}

/// A contour moved onto another as far as the model can: what is left is what the motion cannot do. Both are finite and have as many
/// points.
pub(crate) fn aligned(points: &[[f64; 2]], onto: &[[f64; 2]], model: Model) -> Vec<[f64; 2]> {
    let m = fit_finite(points, onto, model).motion;
    points.iter().map(|p| [0, 1].map(|c| m[(c, 0)] * p[0] + m[(c, 1)] * p[1] + m[(c, 2)])).collect()
}

/// Sums of products of the centred coordinates (x, y) of `from` and (u, v) of `to`.
struct Moments {
    xx: f64,
    xy: f64,
    yy: f64,
    xu: f64,
    xv: f64,
    yu: f64,
    yv: f64,
}

impl Moments {
    fn of(from: &[[f64; 2]], to: &[[f64; 2]], s: [f64; 2], t: [f64; 2]) -> Self {
        let mut m = Self { xx: 0.0, xy: 0.0, yy: 0.0, xu: 0.0, xv: 0.0, yu: 0.0, yv: 0.0 };
        for (p, q) in from.iter().zip(to) {
            let (x, y, u, v) = (p[0] - s[0], p[1] - s[1], q[0] - t[0], q[1] - t[1]);
            m.xx += x * x;
            m.xy += x * y;
            m.yy += y * y;
            m.xu += x * u;
            m.xv += x * v;
            m.yu += y * u;
            m.yv += y * v;
        }
        m
    }

    /// Squared spread of `from` along its principal axes, the least first.
    fn spread(&self) -> (f64, f64) {
        let (half, root) = (0.5 * (self.xx + self.yy), libm::hypot(0.5 * (self.xx - self.yy), self.xy));
        let most = half + root;
        // The determinant over the larger one: their difference would lose the smaller.
        ((self.xx * self.yy - self.xy * self.xy).max(0.0) / most.max(f64::MIN_POSITIVE), most)
    }

    /// Sums of s·v and of s×v: the turn and scale that takes `from` to `to`, times the squared spread.
    fn turn(&self) -> [f64; 2] {
        [self.xu + self.yv, self.xv - self.yu]
    }
}

/// The rotation along a direction; none where it has no length.
fn rotation([c, s]: [f64; 2]) -> [[f64; 2]; 2] {
    let length = libm::hypot(c, s);
    if length == 0.0 {
        return [[1.0, 0.0], [0.0, 1.0]];
    }
    [[c / length, -s / length], [s / length, c / length]]
}

/// Equation (6) by Gram-Schmidt on the two columns of the centred contour, the longer one first.
fn affine(from: &[[f64; 2]], to: &[[f64; 2]], s: [f64; 2], t: [f64; 2], y_first: bool) -> [[f64; 2]; 2] {
    let (i, j) = if y_first { (1, 0) } else { (0, 1) };
    let sum = |f: &dyn Fn(f64, f64) -> f64| from.iter().map(|p| f(p[i] - s[i], p[j] - s[j])).sum::<f64>();
    let long = sum(&|x, _| x * x);
    let first = sum(&|x, y| x * y) / long;
    // Once more, for what rounding left of the first column in the second.
    let share = first + sum(&|x, y| x * (y - first * x)) / long;
    let short = sum(&|x, y| (y - share * x) * (y - share * x));
    let mut out = [[0.0; 2]; 2];
    for (axis, row) in out.iter_mut().enumerate() {
        let dot =
            |f: &dyn Fn(f64, f64) -> f64| from.iter().zip(to).map(|(p, q)| f(p[i] - s[i], p[j] - s[j]) * (q[axis] - t[axis])).sum::<f64>();
        row[j] = dot(&|x, y| y - share * x) / short;
        row[i] = dot(&|x, _| x) / long - share * row[j];
    }
    out
}

fn rms(linear: &[[f64; 2]; 2], from: &[[f64; 2]], to: &[[f64; 2]], s: [f64; 2], t: [f64; 2]) -> f64 {
    let [[a, b], [c, d]] = *linear;
    let sum: f64 = from
        .iter()
        .zip(to)
        .map(|(p, q)| {
            let (x, y) = (p[0] - s[0], p[1] - s[1]);
            let (ex, ey) = (q[0] - t[0] - (a * x + b * y), q[1] - t[1] - (c * x + d * y));
            ex * ex + ey * ey
        })
        .sum();
    (sum / from.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::raster::{apply, compose};
    use proptest::prelude::*;

    fn blob(n: usize) -> Vec<[f64; 2]> {
        (0..n)
            .map(|i| {
                let t = i as f64 / n as f64 * std::f64::consts::TAU;
                let r = 100.0 + 30.0 * libm::cos(3.0 * t + 0.4) + 12.0 * libm::sin(5.0 * t);
                [400.0 + r * libm::cos(t), 300.0 + 0.7 * r * libm::sin(t)]
            })
            .collect()
    }

    fn moved(m: &Affine, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        points.iter().map(|p| apply(m, (*p).into()).into()).collect()
    }

    fn similar(scale: f64, angle: f64, x: f64, y: f64) -> Affine {
        let (s, c) = (scale * libm::sin(angle), scale * libm::cos(angle));
        Affine::new(c, -s, x, s, c, y)
    }

    proptest! {
        #[test]
        fn exact_motions_are_found_again(a in prop::array::uniform4(-2.0f64..2.0), d in prop::array::uniform2(-1e3f64..1e3)) {
            prop_assume!((a[0] * a[3] - a[1] * a[2]).abs() > 1e-3);
            let (from, m) = (blob(200), Affine::new(a[0], a[1], d[0], a[2], a[3], d[1]));
            let to = moved(&m, &from);
            let found = fit(&from, &to, Model::Affine).unwrap();
            for (p, q) in from.iter().zip(&to) {
                let r = apply(&found.motion, (*p).into());
                prop_assert!((r.x - q[0]).hypot(r.y - q[1]) < 1e-10);
            }
        }

        #[test]
        fn smaller_models_find_their_own_motions(scale in 0.2f64..5.0, angle in -3.1f64..3.1, d in prop::array::uniform2(-1e3f64..1e3)) {
            let from = blob(60);
            for (model, m) in [
                (Model::Similarity, similar(scale, angle, d[0], d[1])),
                (Model::Rigid, similar(1.0, angle, d[0], d[1])),
                (Model::Translation, similar(1.0, 0.0, d[0], d[1])),
            ] {
                let found = fit(&from, &moved(&m, &from), model).unwrap();
                prop_assert!((found.motion - m).norm() < 1e-10 * (1.0 + m.norm()) && found.rms < 1e-10, "{found:?}");
            }
        }

        #[test]
        fn no_motion_of_the_model_is_better(seed in prop::collection::vec(-5.0f64..5.0, 40), step in prop::array::uniform6(-1e-4f64..1e-4)) {
            let from = blob(20);
            let to: Vec<_> = from.iter().zip(seed.chunks(2)).map(|(p, e)| [1.1 * p[0] - 0.2 * p[1] + e[0], 0.9 * p[1] + e[1]]).collect();
            let found = fit(&from, &to, Model::Affine).unwrap();
            let [a, b, c, d, x, y] = step;
            let other = found.motion + Affine::new(a, b, 100.0 * x, c, d, 100.0 * y);
            let error = moved(&other, &from).iter().zip(&to).map(|(p, q)| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)).sum::<f64>();
            prop_assert!((error / 20.0).sqrt() >= found.rms * (1.0 - 1e-12));
        }
    }

    /// Recorded from NumPy 2.3.5: `np.linalg.lstsq(np.c_[x, y, np.ones(7)], V, rcond=None)[0].T` of these points.
    #[test]
    fn the_answer_is_that_of_numpy() {
        let (from, to, expected) = recorded();
        let found = fit(&from, &to, Model::Affine).unwrap();
        assert!((found.motion - expected).norm() <= 1e-12 * expected.norm(), "{}", (found.motion - expected).norm());
    }

    fn recorded() -> (Vec<[f64; 2]>, Vec<[f64; 2]>, Affine) {
        let from = [[10.0, 20.0], [35.5, 18.25], [60.0, 44.0], [41.0, 80.5], [22.0, 95.0], [-4.0, 61.0], [3.5, 33.0]];
        let to = [[112.0, 31.0], [139.5, 40.0], [158.0, 77.5], [125.25, 108.0], [101.0, 115.0], [85.0, 70.0], [99.0, 44.5]];
        (from.to_vec(), to.to_vec(), NUMPY.into())
    }

    /// Columns of the motion.
    const NUMPY: [[f64; 2]; 3] =
        [[1.0693348823346447, 0.39290074426821103], [-0.31158371159591747, 1.0501350443094686], [107.10018718880622, 7.229667589583586]];

    #[test]
    fn motions_of_the_target_carry_over() {
        let (from, to, _) = recorded();
        for m in [
            similar(1.0, 0.7, 30.0, -20.0),
            similar(1e4, 0.0, 0.0, 0.0),
            similar(1e-4, 1.0, 0.0, 0.0),
            Affine::new(-1.0, 0.0, 5.0, 0.0, 1.0, 0.0),
        ] {
            let expected = compose(&m, &fit(&from, &to, Model::Affine).unwrap().motion);
            let found = fit(&from, &moved(&m, &to), Model::Affine).unwrap().motion;
            assert!((found - expected).norm() < 1e-11 * expected.norm());
        }
    }

    #[test]
    fn points_on_a_line_get_a_similarity_and_say_so() {
        let from: Vec<_> = (0..9).map(|i| [10.0 + 3.0 * f64::from(i), 20.0 - 4.0 * f64::from(i)]).collect();
        let m = similar(1.5, 0.6, 7.0, 8.0);
        for points in [&from[..], &from[..2]] {
            let found = fit(points, &moved(&m, points), Model::Affine).unwrap();
            assert_eq!((found.model, found.condition), (Model::Similarity, f64::INFINITY));
            assert!((found.motion - m).norm() < 1e-9 && found.rms < 1e-9);
        }
    }

    #[test]
    fn points_in_one_place_get_a_translation() {
        for model in [Model::Affine, Model::Similarity, Model::Rigid, Model::Translation] {
            let found = fit(&[[0.1, 0.3]; 7], &[[5.1, 1.3]; 7], model).unwrap();
            assert_eq!(found.model, Model::Translation);
            assert!((found.motion - similar(1.0, 0.0, 5.0, 1.0)).norm() < 1e-12);
        }
    }

    #[test]
    fn what_cannot_be_fitted_is_said() {
        let text = |from: &[[f64; 2]], to: &[[f64; 2]]| fit(from, to, Model::Affine).unwrap_err().to_string();
        assert_eq!(text(&[[0.0; 2]; 3], &[[0.0; 2]; 4]), "expected as many points as the first contour has, 3, found 4");
        assert_eq!(text(&[], &[]), "expected a contour with points, found none");
        assert_eq!(text(&[[0.0; 2]; 2], &[[0.0; 2], [1.0, f64::NAN]]), "expected finite points, found (1, NaN) at point 1");
    }

    #[test]
    fn area_is_signed_and_does_not_mind_where_it_is() {
        let square = [[1e6, 1e6], [1e6 + 2.0, 1e6], [1e6 + 2.0, 1e6 + 3.0], [1e6, 1e6 + 3.0]];
        assert_eq!(area(&square), 6.0);
        assert_eq!(area(&square.map(|[x, y]| [-x, y])), -6.0);
    }
}
