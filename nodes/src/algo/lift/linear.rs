//! The system of one frame, and its rounds.

use nalgebra::{DMatrix, DVector, Dyn, LU, Matrix2x3, Matrix3, Vector2, Vector3};

use super::subspace::inner;
use super::tree::{Factor, Rows, Tree};
use super::{BasisMode, LiftError, LimbRows, Options, Subspace, temporal};
use crate::algo::camera::Camera;
use crate::algo::pose_descriptor::pixels_a_metre;

pub(super) type Pose = Vec<Vector3<f64>>;
/// A pose, and how sure each marker of it is.
type Solved = (Pose, Vec<f64>);

/// A limb shorter than this, metres, has no direction.
const POINT: f64 = 1e-9;

/// What is known of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Where markers are drawn, pixels; NaN where they are not seen: their rows are left out.
    pub markers: Vec<[f64; 2]>,
    /// The capture, metres.
    pub prior: Pose,
    /// Of each limb, metres; those of the capture where there are none.
    pub lengths: Option<Vec<f64>>,
    /// What draws it.
    pub camera: Camera,
    /// Poses that the figure takes.
    pub subspace: Option<Subspace>,
}

/// A lifted frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Lifted {
    /// Metres.
    pub markers: Pose,
    /// Root of the mean squared distance of drawn and lifted markers in the picture, pixels.
    pub residual: f64,
    /// Of the worst limb, as a share of its length.
    pub length_error: f64,
    /// Standard deviation of each marker's place, summed over the axes, for a drawn error of 1; at most, as rings, bases and time make it less.
    pub uncertainty: Vec<f64>,
}

/// Limbs, weights, and how a basis counts.
#[derive(Clone, Debug)]
pub struct Lift<'a> {
    /// The limbs.
    pub tree: &'a Tree,
    /// Weights and rounds.
    pub options: Options,
    /// How frames' subspaces count.
    pub basis_mode: BasisMode,
}

/// The rows of a limb that closes a ring.
#[derive(Clone, Copy, Debug)]
struct Ring {
    limb: [usize; 2],
    u: Vector3<f64>,
    beta: f64,
    weight: f64,
}

/// A frame, linearised: its matrix and right-hand side.
#[derive(Debug)]
pub(super) struct System<'a> {
    tree: &'a Tree,
    blocks: Vec<Matrix3<f64>>,
    right: Pose,
    rows: Vec<Rows>,
    rings: Vec<Ring>,
    /// A subspace, and the weight that is taken from its directions again.
    soft: Option<(&'a Subspace, f64)>,
}

impl System<'_> {
    /// The matrix times a pose; constraints, whose weight is infinite, left out.
    pub(super) fn times(&self, x: &[Vector3<f64>]) -> Pose {
        let mut y: Pose = self.blocks.iter().zip(x).map(|(b, x)| b * x).collect();
        self.each_row(|[from, to], u, _, weight| {
            let pull = u * (weight * u.dot(&(x[to] - x[from])));
            y[to] += pull;
            y[from] -= pull;
        });
        for (d, weight) in self.soft.iter().flat_map(|(s, w)| s.directions.iter().map(move |d| (d, w))) {
            let along = weight * inner(d, x);
            y.iter_mut().zip(d).for_each(|(y, d)| *y -= along * d);
        }
        y
    }

    /// The right-hand side without limbs, of a figure that is drawn to `prior` by `more`.
    pub(super) fn start(&self, prior: &[Vector3<f64>], more: f64) -> Pose {
        self.right.iter().zip(prior).map(|(r, p)| r + p * more).collect()
    }

    /// The right-hand side, all that limbs pull included.
    pub(super) fn right(&self) -> Pose {
        let mut right = self.right.clone();
        self.each_row(|[from, to], u, beta, weight| {
            right[to] += u * (weight * beta);
            right[from] -= u * (weight * beta);
        });
        right
    }

    fn each_row(&self, mut act: impl FnMut([usize; 2], Vector3<f64>, f64, f64)) {
        for (edge, rows) in self.tree.edges.iter().zip(&self.rows) {
            for k in 0..2 {
                if rows.weight[k] > 0.0 && rows.weight[k].is_finite() {
                    act([edge.parent, edge.child], rows.u.column(k).into(), rows.beta[k], rows.weight[k]);
                }
            }
        }
        self.rings.iter().filter(|r| r.weight.is_finite()).for_each(|r| act(r.limb, r.u, r.beta, r.weight));
    }

    /// Takes the matrix apart, with `more` on its diagonal.
    pub(super) fn solver(&self, more: f64) -> Result<Solver<'_>, LiftError> {
        let blocks: Vec<_> = self.blocks.iter().map(|b| b + Matrix3::from_diagonal_element(more)).collect();
        let factor = Factor::new(self.tree, &blocks, &self.rows).ok_or(LiftError::Undetermined)?;
        let mut low: Vec<(Pose, f64)> = Vec::new();
        for ring in self.rings.iter().filter(|r| r.weight > 0.0) {
            let mut column = vec![Vector3::zeros(); self.tree.n];
            column[ring.limb[1]] += ring.u;
            column[ring.limb[0]] -= ring.u;
            low.push((column, 1.0 / ring.weight));
        }
        let directions = self.soft.iter().flat_map(|(s, w)| s.directions.iter().map(move |d| (d.clone(), -1.0 / w)));
        low.extend(directions);
        let solved: Vec<Pose> = low.iter().map(|(column, _)| factor.solve_of(column)).collect();
        let small = DMatrix::from_fn(low.len(), low.len(), |i, j| inner(&low[i].0, &solved[j]) + if i == j { low[i].1 } else { 0.0 });
        let small = (!low.is_empty()).then(|| small.lu());
        Ok(Solver { system: self, factor, low, solved, small })
    }
}

impl Factor<'_> {
    fn solve_of(&self, right: &[Vector3<f64>]) -> Pose {
        let mut x = right.to_vec();
        self.solve(&mut x, None);
        x
    }
}

/// A system taken apart: the tree, and by Woodbury's formula what is no tree.
pub(super) struct Solver<'a> {
    system: &'a System<'a>,
    factor: Factor<'a>,
    /// Columns beside the tree, and the inverse of each one's weight.
    low: Vec<(Pose, f64)>,
    solved: Vec<Pose>,
    small: Option<LU<f64, Dyn, Dyn>>,
}

impl Solver<'_> {
    /// The pose for a right-hand side; `pulled` with the lengths of limbs in it, else as if they were all nought.
    pub(super) fn solve(&self, right: &[Vector3<f64>], pulled: bool) -> Option<Pose> {
        let mut x = right.to_vec();
        self.factor.solve(&mut x, pulled.then_some(&self.system.rows[..]));
        let Some(small) = &self.small else { return Some(x) };
        let rings: Vec<f64> = self.system.rings.iter().filter(|r| r.weight > 0.0).map(|r| r.beta).collect();
        let beta = |k: usize| if pulled { rings.get(k).copied().unwrap_or(0.0) } else { 0.0 };
        let off = DVector::from_fn(self.low.len(), |k, _| inner(&self.low[k].0, &x) - beta(k));
        for (column, z) in self.solved.iter().zip(small.solve(&off)?.iter()) {
            x.iter_mut().zip(column).for_each(|(x, c)| *x -= c * *z);
        }
        Some(x)
    }

    fn uncertainty(&self) -> Vec<f64> {
        self.factor.covariances().iter().map(|c| c.trace().max(0.0).sqrt()).collect()
    }
}

/// A camera at a marker: pixels, their change with the marker's place, and pixels a metre.
struct Seen {
    pixel: Vector2<f64>,
    change: Matrix2x3<f64>,
}

fn seen(camera: &Camera, at: Vector3<f64>) -> Option<Seen> {
    let clip = camera.clip_from_world();
    let p = clip * at.push(1.0);
    let half = camera.size.map(|n| n as f64 / 2.0);
    let [sx, sy] = [half[0], -half[1]];
    let row = |k: usize, scale: f64| (clip.fixed_view::<1, 3>(k, 0) - clip.fixed_view::<1, 3>(3, 0) * (p[k] / p.w)) * (scale / p.w);
    let change = Matrix2x3::from_rows(&[row(0, sx), row(1, sy)]);
    let pixel = camera.pixel(&p);
    (p.w > 0.0 && pixel.iter().all(|v| v.is_finite())).then_some(Seen { pixel: pixel.into(), change })
}

/// A frame with what does not change from round to round.
pub(super) struct Known<'a> {
    pub(super) frame: &'a Frame,
    lengths: Vec<f64>,
    /// Pixels a metre at each marker of the capture.
    scales: Vec<f64>,
    /// Depth that foreshortening tells of each limb, and the axis of depth.
    depths: Vec<Option<(Vector3<f64>, f64)>>,
}

impl<'a> Lift<'a> {
    /// Lifts frames; they know of each other by `smooth_weight` alone.
    ///
    /// # Errors
    /// The position of the frame at fault, with lists of other lengths than the tree's, capture that is not finite or that the camera does not see, or
    /// weights that leave a marker's place open.
    /// Cost: O(frames · rounds · markers); with P directions of a basis O(frames · rounds · markers · P²).
    pub fn run(&self, frames: &[Frame]) -> Result<Vec<Lifted>, (usize, LiftError)> {
        let exact = self.options.length_weight.is_infinite();
        let is_hard = |f: &Frame| f.subspace.is_some() && self.basis_mode == BasisMode::Hard;
        if let Some(k) = frames.iter().position(|f| is_hard(f) && (exact || self.options.smooth_weight > 0.0)) {
            return Err((k, LiftError::Overdetermined));
        }
        let at = |k: usize| move |e: LiftError| (k, e);
        let known = frames.iter().enumerate().map(|(k, f)| self.known(f).map_err(at(k))).collect::<Result<Vec<_>, _>>()?;
        let mut lifted: Vec<Solved> = Vec::with_capacity(frames.len());
        if self.options.smooth_weight > 0.0 && frames.len() > 2 {
            lifted = self.together(&known)?;
        } else {
            for (k, known) in known.iter().enumerate() {
                lifted.push(self.alone(known).map_err(at(k))?);
            }
        }
        Ok(known.iter().zip(lifted).map(|(known, (x, uncertainty))| self.finished(known, x, uncertainty)).collect())
    }

    fn alone(&self, known: &Known) -> Result<Solved, LiftError> {
        let mut x = known.frame.prior.clone();
        let mut round = 0;
        loop {
            let system = self.system(known, &x)?;
            let solver = system.solver(0.0)?;
            let next = match &known.frame.subspace {
                Some(space) if self.basis_mode == BasisMode::Hard => space.least(|x| system.times(x), &system.right()),
                _ => solver.solve(&system.right, true),
            };
            let next = next.filter(|x| x.iter().flatten_all().all(f64::is_finite)).ok_or(LiftError::Undetermined)?;
            let moved = farthest(&x, &next);
            x = next;
            if round == self.options.relinearize || moved < 1e-12 {
                return Ok((x, solver.uncertainty()));
            }
            round += 1;
        }
    }

    fn together(&self, known: &[Known]) -> Result<Vec<Solved>, (usize, LiftError)> {
        let mut x: Vec<Pose> = known.iter().map(|k| k.frame.prior.clone()).collect();
        let mut round = 0;
        loop {
            let all = known.iter().zip(&x).enumerate();
            let systems = all.map(|(k, (known, x))| self.system(known, x).map_err(|e| (k, e))).collect::<Result<Vec<_>, _>>()?;
            let priors: Vec<&Pose> = known.iter().map(|k| &k.frame.prior).collect();
            let next = temporal::solve(&systems, &priors, self.options.smoothing())?;
            let moved = x.iter().zip(&next).map(|(a, b)| farthest(a, b)).fold(0.0, f64::max);
            x = next;
            if round == self.options.relinearize || moved < 1e-9 {
                let sure = |(k, s): (usize, &System)| s.solver(0.0).map(|s| s.uncertainty()).map_err(|e| (k, e));
                let sure = systems.iter().enumerate().map(sure).collect::<Result<Vec<_>, _>>()?;
                return Ok(x.into_iter().zip(sure).collect());
            }
            round += 1;
        }
    }

    fn known<'f>(&self, frame: &'f Frame) -> Result<Known<'f>, LiftError> {
        let (n, limbs) = (self.tree.n, &self.tree.limbs);
        let counts = [("markers of the capture", n, frame.prior.len()), ("drawn markers", n, frame.markers.len())];
        let lengths = frame.lengths.as_ref().map(|l| ("lengths of limbs", limbs.len(), l.len()));
        let of_basis = frame.subspace.as_ref().map(|s| ("markers in the basis", n, s.mean.len()));
        for (what, expected, found) in counts.into_iter().chain(lengths).chain(of_basis) {
            if expected != found {
                return Err(LiftError::Count { what, expected, found });
            }
        }
        if let Some(marker) = frame.prior.iter().position(|p| !p.iter().all(|v| v.abs() < 1e6)) {
            return Err(LiftError::Prior { marker, found: frame.prior[marker].into() });
        }
        let prior = &frame.prior;
        let mut lengths = frame.lengths.clone().unwrap_or_else(|| limbs.iter().map(|[a, b]| (prior[*b] - prior[*a]).norm()).collect());
        if let Some(limb) = lengths.iter().position(|l| !(0.0..1e6).contains(l)) {
            return Err(LiftError::Length { limb, found: lengths[limb] });
        }
        let scales = if frame.camera.is_orthographic() {
            vec![pixels_a_metre(&frame.camera, prior.first().copied().unwrap_or_default().into()); n]
        } else {
            prior.iter().map(|p| pixels_a_metre(&frame.camera, (*p).into())).collect()
        };
        if let Some(marker) = scales.iter().position(|s: &f64| !(s.is_finite() && *s > 0.0)) {
            return Err(LiftError::Behind { marker });
        }
        let mut depths = vec![None; limbs.len()];
        if self.options.stretch > 0.0 || self.options.depth_weight > 0.0 {
            let toward = frame.camera.toward();
            for (k, &[a, b]) in limbs.iter().enumerate() {
                let scale = (scales[a] + scales[b]) / 2.0;
                let [from, to] = [a, b].map(|m| Vector2::from(frame.markers[m]));
                let drawn = (to - from).norm() / scale;
                let axis = toward(&((prior[a] + prior[b]) / 2.0)).normalize();
                let limb = prior[b] - prior[a];
                let deep = axis.dot(&limb);
                let flat = (limb.norm_squared() - deep * deep).max(0.0).sqrt();
                if !drawn.is_finite() {
                    continue;
                }
                // A limb that points at the camera says nothing of its length.
                if flat > 0.3 * limb.norm() && flat > POINT && drawn > POINT {
                    lengths[k] *= libm::pow(drawn / flat, self.options.stretch);
                }
                let depth = (lengths[k] * lengths[k] - drawn * drawn).max(0.0).sqrt();
                depths[k] = Some((axis, depth.copysign(deep)));
            }
        }
        Ok(Known { frame, lengths, scales, depths })
    }

    /// The system around `x`: equations 6, 8 and 9, and what goes beyond them.
    fn system<'s>(&'s self, known: &Known<'s>, x: &[Vector3<f64>]) -> Result<System<'s>, LiftError> {
        let (frame, o) = (known.frame, &self.options);
        let prior_weight = o.squared(o.prior_weight);
        let soft = frame.subspace.as_ref().filter(|_| self.basis_mode == BasisMode::Soft && o.basis_weight > 0.0);
        let soft = soft.map(|s| (s, o.squared(o.basis_weight)));
        let diagonal = prior_weight + soft.map_or(0.0, |s| s.1);
        let mut blocks = vec![Matrix3::from_diagonal_element(diagonal); self.tree.n];
        let mut right: Pose = frame.prior.iter().map(|p| p * prior_weight).collect();
        if let Some((space, weight)) = soft {
            right.iter_mut().zip(&space.mean).for_each(|(r, m)| *r += m * weight);
            for d in &space.directions {
                let along = weight * inner(d, &space.mean);
                right.iter_mut().zip(d).for_each(|(r, d)| *r -= along * d);
            }
        }
        for (m, drawn) in frame.markers.iter().enumerate().filter(|(_, p)| p.iter().all(|v| v.is_finite())) {
            let seen = seen(&frame.camera, x[m]).ok_or(LiftError::Behind { marker: m })?;
            let j = seen.change / known.scales[m];
            let b = (Vector2::from(*drawn) - seen.pixel) / known.scales[m] + j * x[m];
            blocks[m] += j.transpose() * j;
            right[m] += j.transpose() * b;
        }
        let weight = o.squared(o.length_weight);
        let row = |limb: usize| {
            let [from, to] = self.tree.limbs[limb];
            self.limb_row(x[to] - x[from], known.lengths[limb]).map(|(u, beta)| (u, beta, weight))
        };
        let rows = self.tree.edges.iter().map(|edge| {
            let sign = if edge.turned { -1.0 } else { 1.0 };
            let mut rows = Rows::default();
            let deep = known.depths[edge.limb].filter(|_| o.depth_weight > 0.0);
            let deep = deep.map(|(axis, depth)| (axis, depth, o.squared(o.depth_weight)));
            for (k, (u, beta, weight)) in [row(edge.limb), deep].into_iter().enumerate().filter_map(|(k, r)| Some((k, r?))) {
                rows.u.set_column(k, &(u * sign));
                (rows.beta[k], rows.weight[k]) = (beta, weight);
            }
            rows
        });
        let ring = |limb: &usize| row(*limb).map(|(u, beta, weight)| Ring { limb: self.tree.limbs[*limb], u, beta, weight });
        let rings = self.tree.rings.iter().filter_map(ring).collect();
        Ok(System { tree: self.tree, blocks, right, rows: rows.collect(), rings, soft })
    }

    /// 2 dᵀ (X_i − X_j) = L² + |d|² (eq. 8); nothing of a limb without a direction.
    fn limb_row(&self, d: Vector3<f64>, length: f64) -> Option<(Vector3<f64>, f64)> {
        let square = d.norm_squared();
        let scale = match self.options.rows {
            _ if square <= POINT * POINT => return None,
            LimbRows::Unscaled if self.options.length_weight.is_finite() => 1.0,
            _ if length > POINT => 0.5 / length,
            _ => 0.5 / square.sqrt(),
        };
        Some((d * (2.0 * scale), (length * length + square) * scale))
    }

    fn finished(&self, known: &Known, mut x: Pose, uncertainty: Vec<f64>) -> Lifted {
        if self.options.length_weight.is_infinite() {
            // What the last round left is taken off limb by limb, from the root.
            let before = x.clone();
            for edge in self.tree.edges.iter().rev() {
                let limb = before[edge.child] - before[edge.parent];
                let scale = if limb.norm() > POINT { known.lengths[edge.limb] / limb.norm() } else { 1.0 };
                x[edge.child] = x[edge.parent] + limb * scale;
            }
        }
        let off = |(m, drawn): (usize, &[f64; 2])| {
            let pixel = seen(&known.frame.camera, x[m])?.pixel;
            Some((pixel - Vector2::from(*drawn)).norm_squared()).filter(|s| s.is_finite())
        };
        let squares: Vec<f64> = known.frame.markers.iter().enumerate().filter_map(off).collect();
        let residual = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        let wrong = |(&[a, b], l): (&[usize; 2], &f64)| if *l > POINT { ((x[b] - x[a]).norm() / l - 1.0).abs() } else { 0.0 };
        let length_error = self.tree.limbs.iter().zip(&known.lengths).map(wrong).fold(0.0, f64::max);
        Lifted { markers: x, residual, length_error, uncertainty }
    }
}

fn farthest(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// All coordinates.
trait FlattenAll<'a> {
    fn flatten_all(self) -> impl Iterator<Item = f64>;
}

impl<'a, I: Iterator<Item = &'a Vector3<f64>>> FlattenAll<'a> for I {
    fn flatten_all(self) -> impl Iterator<Item = f64> {
        self.flat_map(|v| [v.x, v.y, v.z])
    }
}
