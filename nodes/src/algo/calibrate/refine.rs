//! The direction in turn with the time map: least squares on what the camera sees, Gauss-Newton.
//!
//! A noisy marker adds to directions of limbs, whose warp then bends after the noise, so that the cheapest warp lies beside the true camera. Here limbs are
//! compared as vectors in the picture, in which noise has no mean: r = d − ρ p(a, e, t), the drawn limb less the captured one at its time as the camera sees
//! it, ρ times as large. Each drawing's time may slip by about a frame; that is eliminated in closed form (Golub and Pereyra 1973), after which the time map
//! no more pulls on the camera. Limbs that a style poses its own way count the less the farther they are off (Cauchy weights, Huber 1981). Covariance: the
//! sandwich of White (1980) with the lags of Newey and West (1987), since what a style does to a drawing it does to the next.

use nalgebra::{DMatrix, DVector, Matrix2};
use pegbar_engine::Setting;

use super::super::camera::Camera;
use super::super::dtw::{Drawings, Metric, Options, Series, dtw, source_frames};
use super::{CalibrateError, Views, turned};

/// How a direction is refined, and whose refinement the drawings have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Refinement {
    /// Not at all: the direction of the cheapest warp.
    Off,
    /// By least squares, limbs as long as captured, all as many times larger.
    Same,
    /// By least squares, each limb as many times larger as it likes, the same in all drawings.
    #[default]
    Own,
}

/// Rounds of warp and camera at most.
const WARPS: usize = 12;
/// Steps of Gauss and Newton at one warp.
const STEPS: usize = 12;
/// Degrees on either side for the slope of what the camera sees.
const SLOPE: f64 = 0.05;
/// Degrees below which a step is none.
const STILL: f64 = 0.002;
/// Degrees of the longest step.
const LONGEST: f64 = 5.0;
/// How far a drawing's time is off, frames of capture.
const SLIP: f64 = 1.0;

/// A refined direction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refined {
    /// To be added to azimuth and elevation, degrees.
    pub(super) turn_deg: [f64; 2],
    /// Of azimuth and elevation, square degrees.
    pub(super) covariance: Matrix2<f64>,
}

/// Limbs as vectors in the picture: a frame's limbs, x and y; NaN where an end is not seen.
type Limbs = Vec<Vec<[f64; 2]>>;

fn vectors(frames: &[Vec<[f64; 2]>], limbs: &[[usize; 2]]) -> Limbs {
    let of = |f: &Vec<[f64; 2]>| limbs.iter().map(|&[a, b]| [0, 1].map(|c| f[b][c] - f[a][c])).collect();
    frames.iter().map(of).collect()
}

/// A series of limbs between frames.
fn between(limbs: &Limbs, at: f64, k: usize) -> [f64; 2] {
    let at = at.clamp(0.0, (limbs.len() - 1) as f64);
    let (a, b) = (&limbs[at as usize][k], &limbs[(at as usize + 1).min(limbs.len() - 1)][k]);
    let t = at.fract();
    [0, 1].map(|c| if t == 0.0 { a[c] } else { a[c] + (b[c] - a[c]) * t })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

fn dot(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    a.iter().zip(b).zip(weights).map(|((a, b), w)| a * b * w).sum()
}

/// What is left of `v` once its frame has slipped in time as far as pays, at a price of the squared slip.
fn slipped(v: &[f64], weights: &[f64], slip: &[f64], price: f64) -> Vec<f64> {
    let share = dot(v, slip, weights) / (dot(slip, slip, weights) + price);
    v.iter().zip(slip).map(|(v, s)| if share.is_finite() { v - share * s } else { *v }).collect()
}

/// The normal equations, frame by frame.
struct Normal {
    matrix: DMatrix<f64>,
    /// Each frame's share of the right-hand side.
    shares: Vec<DVector<f64>>,
}

/// Where is looked, and how.
pub(super) struct Refine<'a> {
    pub(super) views: &'a Views<'a>,
    pub(super) camera: &'a Camera,
    pub(super) range_deg: [f64; 2],
    pub(super) refinement: Refinement,
    pub(super) options: &'a Options,
}

impl Refine<'_> {
    fn seen(&self, turn: [f64; 2]) -> Limbs {
        vectors(&self.views.seen(&turned(self.camera, self.views.middle(), turn)), self.views.bones)
    }

    fn groups(&self) -> usize {
        if self.refinement == Refinement::Same { 1 } else { self.views.bones.len() }
    }

    fn group(&self, k: usize) -> usize {
        if self.refinement == Refinement::Same { 0 } else { k }
    }

    /// Sizes of drawn limbs over captured ones at a time map, least squares.
    fn sizes(&self, drawn: &Limbs, seen: &Limbs, map: &[f64]) -> Vec<f64> {
        let (mut across, mut own) = (vec![0.0; self.groups()], vec![0.0; self.groups()]);
        for (d, at) in drawn.iter().zip(map) {
            for (k, d) in d.iter().enumerate() {
                let p = between(seen, *at, k);
                let product = d[0] * p[0] + d[1] * p[1];
                if product.is_finite() {
                    across[self.group(k)] += product;
                    own[self.group(k)] += p[0] * p[0] + p[1] * p[1];
                }
            }
        }
        let whole = across.iter().sum::<f64>() / own.iter().sum::<f64>();
        let size = |(a, o): (&f64, &f64)| if *a > 0.0 && *o > 0.0 { a / o } else { whole };
        across.iter().zip(&own).map(size).collect()
    }

    /// The time map of least distance between drawn and seen limbs.
    fn map(&self, drawn: &Limbs, seen: &Limbs, sizes: &[f64]) -> Result<Vec<f64>, CalibrateError> {
        let row = |f: &Vec<[f64; 2]>, sized: bool| -> Vec<f64> {
            let size = |k: usize| if sized { sizes[self.group(k)] } else { 1.0 };
            f.iter().enumerate().flat_map(|(k, v)| v.map(|c| c * size(k))).collect()
        };
        let series = |frames: &Limbs, sized: bool, name| {
            let rows: Vec<Vec<f64>> = frames.iter().map(|f| row(f, sized)).collect();
            let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
            Series::new(&rows, None).map_err(|source| CalibrateError::Series { name, source })
        };
        let path = dtw(&series(drawn, false, "target")?, &series(seen, true, "source")?, Metric::Euclidean, self.options)?.path;
        Ok(source_frames(&path, &Drawings::new(drawn.len(), |_| false), &[], 1.0))
    }

    /// The normal equations for azimuth, elevation and sizes, and how far each limb is off; `scale` is where weights begin to fall.
    fn normal(&self, drawn: &Limbs, turn: [f64; 2], sizes: &[f64], map: &[f64], scale: f64) -> (Normal, Vec<f64>) {
        let moved = |by: [f64; 2]| self.seen([turn[0] + by[0], turn[1] + by[1]]);
        let (seen, slopes) = (moved([0.0; 2]), [moved([SLOPE, 0.0]), moved([-SLOPE, 0.0]), moved([0.0, SLOPE]), moved([0.0, -SLOPE])]);
        let n = 2 + self.groups();
        let mut normal = Normal { matrix: DMatrix::zeros(n, n), shares: Vec::new() };
        let mut off = Vec::new();
        let size = |k: usize| sizes[self.group(k)];
        for (d, &at) in drawn.iter().zip(map) {
            let known: Vec<usize> = (0..d.len()).filter(|&k| d[k].iter().chain(&between(&seen, at, k)).all(|v| v.is_finite())).collect();
            let stacked = |of: &dyn Fn(usize) -> [f64; 2]| known.iter().flat_map(|&k| of(k)).collect::<Vec<f64>>();
            let apart = |a: [f64; 2], b: [f64; 2], by: f64| [0, 1].map(|c| by * (a[c] - b[c])).map(|v| if v.is_finite() { v } else { 0.0 });
            let residual = stacked(&|k| apart(d[k], between(&seen, at, k).map(|p| size(k) * p), 1.0));
            let slip = stacked(&|k| apart(between(&seen, at + 0.5, k), between(&seen, at - 0.5, k), size(k)));
            let price = (scale / SLIP) * (scale / SLIP);
            let rest = slipped(&residual, &vec![1.0; residual.len()], &slip, price);
            let far: Vec<f64> = rest.chunks_exact(2).map(|r| libm::hypot(r[0], r[1])).collect();
            let weights: Vec<f64> = far.iter().map(|r| 1.0 / (1.0 + (r / scale) * (r / scale))).flat_map(|w| [w; 2]).collect();
            off.extend(far);
            let column = |j: usize| {
                let raw = match j {
                    0 | 1 => {
                        stacked(&|k| apart(between(&slopes[2 * j], at, k), between(&slopes[2 * j + 1], at, k), size(k) / (2.0 * SLOPE)))
                    }
                    _ => stacked(&|k| if self.group(k) == j - 2 { between(&seen, at, k) } else { [0.0; 2] }),
                };
                slipped(&raw, &weights, &slip, price)
            };
            let columns: Vec<Vec<f64>> = (0..n).map(column).collect();
            let residual = slipped(&residual, &weights, &slip, price);
            normal.matrix += DMatrix::from_fn(n, n, |i, j| dot(&columns[i], &columns[j], &weights));
            normal.shares.push(DVector::from_fn(n, |i, _| dot(&columns[i], &residual, &weights)));
        }
        (normal, off)
    }

    /// Refines a direction, in turn with the warp.
    pub(super) fn run(&self, start: [f64; 2]) -> Result<Refined, CalibrateError> {
        let drawn = vectors(self.views.drawn, self.views.bones);
        let seen = self.seen(start);
        let even: Vec<f64> = (0..drawn.len()).map(|n| n as f64 * (seen.len() - 1) as f64 / (drawn.len() - 1).max(1) as f64).collect();
        let mut found = Refined { turn_deg: start, covariance: Matrix2::from_element(f64::NAN) };
        let mut sizes = self.sizes(&drawn, &seen, &even);
        for _ in 0..WARPS {
            let before = found.turn_deg;
            let seen = self.seen(before);
            let mut map = self.map(&drawn, &seen, &sizes)?;
            for _ in 0..3 {
                sizes = self.sizes(&drawn, &seen, &map);
                map = self.map(&drawn, &seen, &sizes)?;
            }
            self.step(&drawn, &map, &mut sizes, &mut found);
            if (0..2).all(|k| (found.turn_deg[k] - before[k]).abs() < 5.0 * STILL) {
                break;
            }
        }
        Ok(found)
    }

    /// Steps of Gauss and Newton at one time map, until they are still.
    fn step(&self, drawn: &Limbs, map: &[f64], sizes: &mut [f64], found: &mut Refined) {
        let mut scale = f64::INFINITY;
        for _ in 0..STEPS {
            let (normal, off) = self.normal(drawn, found.turn_deg, sizes, map, scale);
            let is_first = scale.is_infinite();
            // Two and a half times the noise of a limb, whose length is Rayleigh's: a perfect drawing has none, and weights of 1.
            scale = (2.5 * median(off) / 1.1774).max(1e-9);
            if is_first {
                continue;
            }
            let right = normal.shares.iter().fold(DVector::zeros(normal.matrix.nrows()), |s, v| s + v);
            let Some(inverse) = normal.matrix.clone().try_inverse() else { return };
            let step = &inverse * right;
            if !step.iter().all(|v| v.is_finite()) {
                return;
            }
            found.covariance = sandwich(&normal, &inverse);
            let cut = (LONGEST / step[0].abs().max(step[1].abs())).min(1.0);
            for k in 0..2 {
                found.turn_deg[k] = (found.turn_deg[k] + cut * step[k]).clamp(-self.range_deg[k], self.range_deg[k]);
            }
            sizes.iter_mut().enumerate().for_each(|(g, s)| *s += cut * step[2 + g]);
            if step[0].abs().max(step[1].abs()) < STILL {
                return;
            }
        }
    }
}

/// Covariance of the first two unknowns: the inverse, twice, about the sum of products of frames' shares, with lags of a fifth of the frames.
fn sandwich(normal: &Normal, inverse: &DMatrix<f64>) -> Matrix2<f64> {
    let n = normal.shares.len();
    let lags = n / 5;
    let size = inverse.nrows();
    let mut middle = DMatrix::zeros(size, size);
    for lag in 0..=lags {
        let share = 1.0 - lag as f64 / (lags + 1) as f64;
        for (a, b) in normal.shares.iter().zip(&normal.shares[lag..]) {
            let product = a * b.transpose() * share;
            if lag > 0 {
                middle += product.transpose();
            }
            middle += product;
        }
    }
    (inverse * middle * inverse).fixed_view::<2, 2>(0, 0).into_owned()
}
