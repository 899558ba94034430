//! The last pixels: a pose that is found is drawn anew, and drawn again until the drawing lies on the frame.
//!
//! Pictures of poses that lie far apart span poses between them badly: an arm that is halfway from one to the next shows twice. Where the
//! pictures were drawn, equation (14) holds much better with pictures of the moment: the mean is the drawing in the pose as it is at the
//! time, and the E_l are what that drawing changes by when a little more of a key is mixed in. Motion and weights of the keys are solved
//! for by damped Gauss-Newton steps, robustly, coarse to fine. Poses beyond a key, and of three keys at once, are drawings as others are.
//!
//! Starts are compared at the coarsest level, frame and drawing keyed by the matte. Then the drawing is laid on what the frame shows around
//! the character, so that the true outline counts and not the matte's: its holes and its rim do no harm.
//!
//! **Source**: Bregler et al., equation (14); Levenberg-Marquardt after Madsen, Nielsen, Tingleff, "Methods for Non-Linear Least Squares Problems", 2004, section 3.2.
//! Ground behind the character: pull-push, Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4.1.

use nalgebra::{DMatrix, DVector, Vector2};

use super::super::level::LEAST_SCALE;
use super::super::planes::Window;
use super::super::planes::{Planes, gaussian_taps, smoothed, toned};
use super::super::region::{has_finite, window_of};
use super::super::run::{Cut, View};
use super::super::solve::{is_sane, project};
use super::super::start::{Moments, moments, moved_bounds, transport};
use super::super::{Model, Options, Robust, Status, Tone};
use super::EigenTrack;
use crate::algo::raster::{Affine, apply, compose};

/// What draws a character in any mixture of its keys.
pub trait Drawn {
    /// Number of keys.
    fn n_keys(&self) -> usize;

    /// Points of a key, pixels: how far poses lie apart, and where they are.
    fn key(&self, k: usize) -> &[[f64; 2]];

    /// The keys mixed by these weights, moved by `place` (sample coordinates from pixels of the keys, lines as wide as `line` times
    /// theirs): RGBA in linear light, premultiplied, rows from the top. `None` where nothing can be drawn.
    fn draw(&self, weights: &[f64], place: &Affine, line: f64, size: [usize; 2]) -> Option<Vec<f32>>;
}

/// A motion and the weights of the keys.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPose {
    /// Frame from pictures, pixels.
    pub motion: Affine,
    /// How much of each key; they add up to 1.
    pub weights: Vec<f64>,
}

/// Most steps a level, but for the finest, which has twice as many.
const ROUNDS: usize = 8;
/// Most steps that are tried for one, each damped more.
const TRIALS: usize = 4;
/// Bend of the robust weights over the contrast, at the levels but the finest.
const WIDE: f64 = 0.5;
/// The same at the finest.
const NARROW: f64 = 0.25;
/// Steps that are shorter, in samples, are the last at the finest level and at the others.
const FINE: f64 = 0.02;
/// See [`FINE`].
const COARSE: f64 = 0.05;
/// How far the drawing is shifted for the picture of what that changes, samples.
const SHIFTED: f64 = 0.1;
/// How far keys are mixed in for theirs: displacement of the point that goes farthest, samples.
const MIXED: f64 = 0.2;
/// Mixtures of keys are left alone where keys differ by less along them, root mean square, samples: coarse levels hardly show them.
const LEAST_AXIS: f64 = 0.25;
/// The same at the finest level.
const LEAST_FINE: f64 = 0.01;
/// Starts that are refined at the coarsest level.
const REFINED: usize = 3;
/// Coverage over which a pixel is the character's.
const COVERED: f32 = 0.02;
/// Largest weight, and one minus the least.
const FARTHEST: f64 = 2.0;
/// So many keys are tried two by two as well.
const FEW: usize = 8;
/// A start that costs less is taken without a look at others.
const FITS: f64 = 0.1;
/// Relative residual under which no other start is tried.
const SURE: f64 = 0.4;
/// Tone scale of costs that are compared between starts.
const SOFT: f32 = 0.15;

/// A level of the frame that drawings are compared with.
struct Target {
    /// Toned, keyed or not, smoothed.
    frame: Planes,
    /// Behind the drawing: linear, a plane a colour; none where the frame is keyed.
    ground: Option<Vec<Vec<f32>>>,
    step: f64,
}

/// What the drawings are held against, and how.
pub(super) struct Redraw<'a> {
    pub(super) drawn: &'a dyn Drawn,
    pub(super) cut: Cut<'a>,
    pub(super) options: &'a Options,
    pub(super) view: View<'a>,
    /// What a motion that is cut to the model keeps in its place, in the pictures.
    pub(super) pivot: [f64; 2],
    /// What steps turn about, in the frame.
    pub(super) centre: [f64; 2],
    pub(super) scale: f64,
    /// Standard deviation of the tones of the character.
    pub(super) contrast: f64,
    /// Most pixels that a step is solved on.
    pub(super) pixels: usize,
}

/// The normal equations of a linearisation.
struct Linear {
    h: DMatrix<f64>,
    b: DVector<f64>,
}

/// A step that may be taken.
struct Step {
    pose: DrawnPose,
    /// How far it moves the points of the character, root mean square, pixels.
    moved: f64,
    /// By how much the cost of the samples that were looked at would sink if they were linear.
    gain: f64,
}

/// The directions of a step: those of the motion, and mixtures of the keys that no motion makes.
struct Directions {
    /// Of the motion: which of the six parameters each moves.
    motion: Vec<[f64; 6]>,
    /// Of the pose, each on its own, and each moving the points by one sample, root mean square.
    mixes: Vec<Mix>,
}

/// A change of pose.
struct Mix {
    /// What each key gains; nothing in all.
    weights: Vec<f64>,
    /// What the six parameters of the motion take back.
    motion: [f64; 6],
    /// How far the point moves that goes farthest, samples.
    farthest: f64,
}

impl Directions {
    /// `place` gives the centred and scaled coordinates of a point of the frame.
    ///
    /// Keys differ by what a motion does as well, and by what other keys do: pictures of such differences cancel in part, and what is left of
    /// them is mostly the error of the differences. So motion is taken out first, and the rest is turned to its principal axes.
    fn new(drawn: &dyn Drawn, model: Model, pose: &DrawnPose, place: impl Fn([f64; 2]) -> [f64; 2], sample: f64, least: f64) -> Self {
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

    fn len(&self) -> usize {
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

/// A start that was refined at the coarsest level.
struct Candidate {
    paid: f64,
    pose: DrawnPose,
    iterations: usize,
}

/// The levels of a frame.
struct Seen {
    window: Window,
    keyed: Vec<Planes>,
    plain: Vec<Planes>,
}

/// A level's answer.
struct Settled {
    pose: DrawnPose,
    status: Status,
    residual: f64,
    dissimilarity: f64,
}

impl Redraw<'_> {
    /// The pose nearest to what the starts say, drawn anew; `None` where the drawings cannot be held against the frame.
    pub(super) fn find(
        &self,
        starts: &[DrawnPose],
        others: impl Fn() -> Vec<DrawnPose>,
        before: &EigenTrack,
    ) -> Option<(EigenTrack, DrawnPose)> {
        let top = self.cut.levels - 1;
        let coarsest = f64::from(1u32 << top);
        let motions: Vec<Affine> = starts.iter().map(|s| s.motion).collect();
        let (taps, _) = gaussian_taps(self.options.sigma);
        let margin = 3.0 * coarsest + 0.15 * self.scale;
        let (window, keyed) = self.cut.planes(&self.view, &motions, margin)?;
        if !has_finite(self.view.frame, window) {
            return None;
        }
        let own =
            |all: &[DrawnPose]| all.iter().map(|p| Candidate { paid: f64::INFINITY, pose: p.clone(), iterations: 0 }).collect::<Vec<_>>();
        let mut tried = if self.view.matte.is_some() {
            let target = self.keyed(&keyed[top], &taps);
            let mut tried = self.choose(&target, starts, &taps);
            if tried.first().is_none_or(|c| c.paid > FITS) {
                tried.extend(self.choose(&target, &others(), &taps));
                tried.sort_by(|a, b| a.paid.total_cmp(&b.paid));
            }
            // A matte with holes leads astray: the starts as they are come last.
            tried.truncate(REFINED);
            tried
        } else {
            Vec::new()
        };
        tried.extend(own(starts));
        let seen = Seen { window, keyed, plain: self.cut.planes(&View { matte: None, ..self.view }, &motions, margin)?.1 };
        let mut best: Option<(Settled, usize)> = None;
        for candidate in tried {
            let mut iterations = before.iterations + candidate.iterations;
            let Some(settled) = self.descend(&seen, candidate.pose, margin, &taps, &mut iterations) else { continue };
            if best.as_ref().is_none_or(|b| settled.dissimilarity < b.0.dissimilarity) {
                best = Some((settled, iterations));
            }
            if best.as_ref().is_some_and(|b| b.0.dissimilarity < SURE) {
                break;
            }
        }
        let (Settled { pose, mut status, residual, dissimilarity }, iterations) = best?;
        if dissimilarity > self.options.max_dissimilarity {
            status = Status::Unlike;
        }
        let track = EigenTrack { motion: pose.motion, status, iterations, residual, dissimilarity, ..before.clone() };
        Some((track, pose))
    }

    /// From below the coarsest level, where the pose was chosen, to the finest; without a matte from the coarsest.
    fn descend(&self, seen: &Seen, mut pose: DrawnPose, margin: f64, taps: &[f32], iterations: &mut usize) -> Option<Settled> {
        let (top, matte) = (self.cut.levels - 1, self.view.matte.is_some());
        let needed = window_of(moved_bounds(&pose.motion, self.cut.bounds), 0.5 * f64::from(1u32 << top));
        let moved;
        let seen = if seen.window.covers(&needed, [self.view.frame.width, self.view.frame.height]) {
            seen
        } else {
            let (window, keyed) = self.cut.planes(&self.view, &[pose.motion], margin)?;
            let (_, plain) = self.cut.planes(&View { matte: None, ..self.view }, &[pose.motion], margin)?;
            moved = Seen { window, keyed, plain };
            &moved
        };
        let mut last = None;
        for l in (0..if matte { top.max(1) } else { top + 1 }).rev() {
            let part = self.around(&pose, seen.plain[l].step);
            let cropped = |planes: &Planes| smoothed(planes, part, &[1.0]);
            let own = matte.then(|| cropped(&seen.keyed[l]));
            let target = self.grounded(&cropped(&seen.plain[l]), own.as_ref(), &pose, taps)?;
            let settled = self.settle(&target, pose, taps, l == 0, iterations)?;
            pose = settled.pose.clone();
            last = Some(settled);
        }
        last
    }

    /// What is looked at around a pose: it may still be off by a few samples.
    fn around(&self, pose: &DrawnPose, step: f64) -> Window {
        let points = placed(self.drawn, pose);
        let low = points.iter().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
        let high = points.iter().fold([f64::NEG_INFINITY; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])]);
        window_of([low[0], low[1], high[0], high[1]], 8.0 * step)
    }

    fn keyed(&self, planes: &Planes, taps: &[f32]) -> Target {
        Target { frame: smoothed(planes, WHOLE, taps), ground: None, step: planes.step }
    }

    /// The frame as it is, with what it shows around the character carried on behind it.
    fn grounded(&self, plain: &Planes, keyed: Option<&Planes>, pose: &DrawnPose, taps: &[f32]) -> Option<Target> {
        let (w, h) = (plain.width, plain.height);
        let drawing = self.drawing(plain, pose, [0.0; 2])?;
        let cover = keyed.and_then(|k| k.data.last()).map(|a| (a, self.cut.amplitude));
        let own = |i: usize| drawing[4 * i + 3] > COVERED || cover.is_some_and(|(a, gain)| a[i] > 0.1 * gain);
        let reach = if keyed.is_some() { 2 } else { 4 };
        let free = away_from(&(0..w * h).map(own).collect::<Vec<_>>(), w, h, reach);
        let mut ground = plain.data.clone();
        fill(&mut ground, &free, w, h);
        let linear = |v: &mut f32| *v = untoned(*v, self.options.tone);
        ground.iter_mut().flatten().for_each(linear);
        Some(Target { frame: smoothed(plain, WHOLE, taps), ground: Some(ground), step: plain.step })
    }

    /// The drawing in the samples of `like`, shifted by so many samples.
    fn drawing(&self, like: &Planes, pose: &DrawnPose, shift: [f64; 2]) -> Option<Vec<f32>> {
        let s = 1.0 / like.step;
        let to = Affine::new(s, 0.0, shift[0] - s * like.origin[0], 0.0, s, shift[1] - s * like.origin[1]);
        self.drawn.draw(&pose.weights, &compose(&to, &pose.motion), s, [like.width, like.height])
    }

    /// What the frame would be if the character were there in this pose.
    fn picture(&self, target: &Target, pose: &DrawnPose, shift: [f64; 2], taps: &[f32]) -> Option<Planes> {
        let drawing = self.drawing(&target.frame, pose, shift)?;
        let tone = self.options.tone;
        let plane = |k: usize| -> Vec<f32> {
            match (&target.ground, self.cut.used.get(k)) {
                (Some(ground), Some(&c)) => {
                    drawing.chunks_exact(4).zip(&ground[k]).map(|(p, g)| toned(p[c] + (1.0 - p[3]) * g, tone)).collect()
                }
                (None, Some(&c)) => drawing.chunks_exact(4).map(|p| toned(p[c], tone) + (1.0 - p[3]) * self.cut.behind[c]).collect(),
                (_, None) => drawing.chunks_exact(4).map(|p| p[3] * self.cut.amplitude).collect(),
            }
        };
        let data = (0..target.frame.data.len()).map(plane).collect();
        Some(smoothed(&Planes { data, ..blank(&target.frame) }, WHOLE, taps))
    }

    /// The starts that fit best at the coarsest level, refined there, the best first; no more where one fits.
    fn choose(&self, target: &Target, starts: &[DrawnPose], taps: &[f32]) -> Vec<Candidate> {
        let cost = |pose: &DrawnPose| self.picture(target, pose, [0.0; 2], taps).map(|p| soft_cost(&p, &target.frame));
        let mut tried: Vec<(f64, &DrawnPose)> = starts.iter().filter_map(|s| Some((cost(s)?, s))).collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut found: Vec<Candidate> = Vec::new();
        for (_, start) in tried.into_iter().take(REFINED) {
            let mut iterations = 0;
            let Some(settled) = self.settle(target, start.clone(), taps, false, &mut iterations) else { continue };
            let Some(paid) = cost(&settled.pose) else { continue };
            found.push(Candidate { paid, pose: settled.pose, iterations });
            if paid < FITS {
                break;
            }
        }
        found.sort_by(|a, b| a.paid.total_cmp(&b.paid));
        found
    }

    /// Damped Gauss-Newton at one level.
    fn settle(&self, target: &Target, mut pose: DrawnPose, taps: &[f32], finest: bool, iterations: &mut usize) -> Option<Settled> {
        let mut picture = self.picture(target, &pose, [0.0; 2], taps)?;
        let tolerance = self.options.tolerance.max(if finest { FINE } else { COARSE } * target.step);
        let most = if finest { self.options.iterations.min(2 * ROUNDS) } else { ROUNDS };
        let (mut damping, mut raise, mut scale, mut status) = (1e-4, 2.0, 0.0, Status::Unfinished);
        for _ in 0..most {
            *iterations += 1;
            let directions = Directions::new(
                self.drawn,
                self.options.model,
                &pose,
                |p| self.scaled(p),
                target.step,
                if finest { LEAST_FINE } else { LEAST_AXIS },
            );
            let slopes = self.slopes(target, &pose, &picture, &directions, taps)?;
            let (telling, share) = telling(&slopes, self.pixels);
            scale = robust_scale(&picture, &target.frame, &telling).max(LEAST_SCALE * self.contrast);
            // Hands that are still off are no outliers: nearly all counts.
            let bend = (scale * self.options.cut).max(self.contrast * if finest { NARROW } else { WIDE }) as f32;
            let linear = self.linear(target, &picture, &slopes, &telling, &directions, bend);
            let cost = |seen: &Planes| robust_cost(seen, &target.frame, bend, self.options.robust);
            let before = cost(&picture);
            let (mut moved, mut better) = (f64::INFINITY, false);
            for _ in 0..TRIALS {
                if let Some(step) = self.step(&linear, &directions, &pose, (damping, 1.0), target.step) {
                    moved = step.moved;
                    let seen = self.picture(target, &step.pose, [0.0; 2], taps)?;
                    let after = cost(&seen);
                    if after <= before {
                        let start = std::mem::replace(&mut pose, step.pose);
                        (picture, better) = (seen, true);
                        // What lies right holds back what does not: twice the step is often nearer.
                        if let Some(far) =
                            self.step(&linear, &directions, &start, (damping, 2.0), target.step).filter(|_| moved > tolerance)
                        {
                            let seen = self.picture(target, &far.pose, [0.0; 2], taps)?;
                            if cost(&seen) < after {
                                (pose, picture, moved) = (far.pose, seen, far.moved);
                            }
                        }
                        // The damping goes by what was gained over what was to be expected.
                        let over = 2.0 * share * (before - after) / step.gain.max(f64::MIN_POSITIVE) - 1.0;
                        damping = (damping * (1.0 - over * over * over).max(1.0 / 3.0)).max(1e-9);
                        raise = 2.0;
                        break;
                    }
                    if moved <= tolerance {
                        break;
                    }
                }
                damping *= raise;
                raise *= 2.0;
            }
            let still = moved <= tolerance || !better;
            if still {
                // Where no step is better, the pose is at the minimum as far as the samples can say.
                let near = moved <= tolerance.max(0.1 * target.step);
                status = if near { Status::Converged } else { Status::Unfinished };
                break;
            }
        }
        let dissimilarity = self.dissimilarity(target, &picture, &pose)?;
        Some(Settled { pose, status, residual: scale, dissimilarity })
    }

    /// Pictures of what a shift across, down, and a little of each key changes, for one sample or a weight of 1.
    fn slopes(&self, target: &Target, pose: &DrawnPose, picture: &Planes, directions: &Directions, taps: &[f32]) -> Option<Vec<Planes>> {
        let changed = |with: Planes, by: f64| {
            let gain = (1.0 / by) as f32;
            let data = with.data.iter().zip(&picture.data).map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b) * gain).collect()).collect();
            Planes { data, ..blank(&target.frame) }
        };
        let mut all = vec![
            changed(self.picture(target, pose, [SHIFTED, 0.0], taps)?, SHIFTED),
            changed(self.picture(target, pose, [0.0, SHIFTED], taps)?, SHIFTED),
        ];
        for mix in &directions.mixes {
            let by = MIXED / mix.farthest;
            let with = self.moved(pose, mix.motion.map(|v| v * by), &mix.weights, by, target.step)?;
            all.push(changed(self.picture(target, &with, [0.0; 2], taps)?, by));
        }
        Some(all)
    }

    /// Normal equations under the robust weights, in samples of the level for the motion.
    fn linear(
        &self,
        target: &Target,
        picture: &Planes,
        slopes: &[Planes],
        telling: &[usize],
        directions: &Directions,
        bend: f32,
    ) -> Linear {
        let n = directions.len();
        let (mut h, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let keys = directions.mixes.len();
        let mut row = vec![0.0f64; n];
        for &i in telling {
            let [u, v] = self.place(target, i);
            for c in 0..picture.data.len() {
                let r = target.frame.data[c][i] - picture.data[c][i];
                let weight = f64::from(robust_weight(r, bend, self.options.robust));
                let (gx, gy) = (f64::from(slopes[0].data[c][i]), f64::from(slopes[1].data[c][i]));
                let six = [gx * u, gx * v, gy * u, gy * v, gx, gy];
                for (to, d) in row.iter_mut().zip(&directions.motion) {
                    *to = d.iter().zip(six).map(|(d, s)| d * s).sum();
                }
                for k in 0..keys {
                    row[n - keys + k] = f64::from(slopes[2 + k].data[c][i]);
                }
                for a in 0..n {
                    let pulled = weight * row[a];
                    b[a] += pulled * f64::from(r);
                    for e in 0..=a {
                        h[(a, e)] += pulled * row[e];
                    }
                }
            }
        }
        h.fill_upper_triangle_with_lower_triangle();
        Linear { h, b }
    }

    /// Centred and scaled frame coordinates of a sample.
    fn place(&self, target: &Target, i: usize) -> [f64; 2] {
        let p = &target.frame;
        let at = |k: usize, n: usize| p.origin[k] + p.step * (n as f64 + 0.5);
        self.scaled([at(0, i % p.width), at(1, i / p.width)])
    }

    /// Centred and scaled frame coordinates.
    fn scaled(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (p[k] - self.centre[k]) / self.scale)
    }

    /// A pose after the motion takes a step of six parameters, in samples, and the keys a share of `weights`.
    fn moved(&self, pose: &DrawnPose, six: [f64; 6], weights: &[f64], share: f64, sample: f64) -> Option<DrawnPose> {
        let [a, b, c, d, x, y] = six.map(|v| v * sample);
        let s = self.scale;
        let about = Vector2::from(self.centre);
        let linear = nalgebra::Matrix2::new(1.0 + a / s, b / s, c / s, 1.0 + d / s);
        let t = about + Vector2::new(x, y) - linear * about;
        let inc = Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t]);
        let motion = compose(&inc, &pose.motion);
        let motion = Some(motion).filter(is_sane).map(|m| project(&m, self.options.model, self.pivot))?;
        Some(DrawnPose { motion, weights: pose.weights.iter().zip(weights).map(|(w, d)| w + share * d).collect() })
    }

    /// What a share of the damped step leads to.
    fn step(&self, linear: &Linear, directions: &Directions, pose: &DrawnPose, (damping, share): (f64, f64), sample: f64) -> Option<Step> {
        let n = linear.b.len();
        let mut h = linear.h.clone();
        let floor = h.trace() * 1e-12;
        for i in 0..n {
            h[(i, i)] += damping * linear.h[(i, i)] + floor;
        }
        let theta = nalgebra::Cholesky::new(h)?.solve(&linear.b) * share;
        if !theta.iter().all(|v| v.is_finite()) {
            return None;
        }
        let gain = 2.0 * theta.dot(&linear.b) - theta.dot(&(&linear.h * &theta));
        let mut six = [0.0; 6];
        for (t, d) in theta.iter().zip(&directions.motion) {
            six.iter_mut().zip(d).for_each(|(s, d)| *s += t * d);
        }
        let mut weights = vec![0.0; pose.weights.len()];
        for (t, mix) in theta.iter().skip(directions.motion.len()).zip(&directions.mixes) {
            six.iter_mut().zip(&mix.motion).for_each(|(s, d)| *s += t * d);
            weights.iter_mut().zip(&mix.weights).for_each(|(w, d)| *w += t * d);
        }
        let next = self.moved(pose, six, &weights, 1.0, sample)?;
        let moved = apart(&placed(self.drawn, &next), &placed(self.drawn, pose));
        let fine = moved <= self.scale && next.weights.iter().all(|w| (1.0 - FARTHEST..=FARTHEST).contains(w));
        fine.then_some(Step { pose: next, moved, gain })
    }

    /// Root mean square residual where the character is drawn, over its contrast.
    fn dissimilarity(&self, target: &Target, picture: &Planes, pose: &DrawnPose) -> Option<f64> {
        let drawing = self.drawing(&target.frame, pose, [0.0; 2])?;
        let (mut sum, mut total) = (0.0, 0.0);
        for (i, p) in drawing.chunks_exact(4).enumerate().filter(|(_, p)| p[3] > 0.5) {
            let square = |c: usize| f64::from(target.frame.data[c][i] - picture.data[c][i]).powi(2);
            sum += f64::from(p[3]) * (0..self.cut.used.len()).map(square).sum::<f64>();
            total += f64::from(p[3]);
        }
        Some(libm::sqrt(sum / f64::max(total, 1.0)) / self.contrast.max(1e-9))
    }
}

const WHOLE: Window = Window { x0: i64::MIN / 4, y0: i64::MIN / 4, x1: i64::MAX / 4, y1: i64::MAX / 4 };

fn blank(like: &Planes) -> Planes {
    Planes { width: like.width, height: like.height, origin: like.origin, step: like.step, data: Vec::new() }
}

/// The sample whose tone is `v`.
fn untoned(v: f32, tone: Tone) -> f32 {
    match tone {
        Tone::Linear => v,
        Tone::Encoded => {
            let root = v.abs() + 0.04;
            (root * root - 0.0016).copysign(v)
        }
    }
}

fn robust_weight(r: f32, bend: f32, robust: Robust) -> f32 {
    match robust {
        Robust::None => 1.0,
        Robust::Huber => (bend / r.abs().max(f32::MIN_POSITIVE)).min(1.0),
        Robust::GemanMcclure => {
            let q = 1.0 + r * r / (bend * bend);
            1.0 / (q * q)
        }
    }
}

/// Sum of the robust function of the residuals, whose weights are those of [`robust_weight`].
fn robust_cost(a: &Planes, b: &Planes, bend: f32, robust: Robust) -> f64 {
    let rho = |r: f32| match robust {
        Robust::None => r * r,
        Robust::Huber if r.abs() <= bend => r * r,
        Robust::Huber => 2.0 * bend * r.abs() - bend * bend,
        Robust::GemanMcclure => r * r / (1.0 + r * r / (bend * bend)),
    };
    let row = |(a, b): (&Vec<f32>, &Vec<f32>)| {
        let chunks = a.chunks(256).zip(b.chunks(256));
        chunks.map(|(a, b)| f64::from(a.iter().zip(b).map(|(a, b)| rho(a - b)).sum::<f32>())).sum::<f64>()
    };
    a.data.iter().zip(&b.data).map(row).sum()
}

/// Mean share of misfit of all samples that differ from nothing: 0 fits, 1 is unlike.
fn soft_cost(a: &Planes, b: &Planes) -> f64 {
    let n = a.data.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let all = a.data.iter().zip(&b.data).flat_map(|(a, b)| a.iter().zip(b));
    all.map(|(a, b)| (a - b) * (a - b)).map(|s| f64::from(s / (s + SOFT * SOFT))).sum::<f64>() / n
}

/// Robust standard deviation of the residuals at some samples.
fn robust_scale(a: &Planes, b: &Planes, at: &[usize]) -> f64 {
    let mut all: Vec<f32> = a.data.iter().zip(&b.data).flat_map(|(a, b)| at.iter().map(|&i| (a[i] - b[i]).abs())).collect();
    if all.is_empty() {
        return 0.0;
    }
    let mid = all.len() / 2;
    let (_, median, _) = all.select_nth_unstable_by(mid, f32::total_cmp);
    f64::from(*median) / 0.6745
}

/// The samples where a step changes something, of more than `most` an even choice; and which share of them it is.
fn telling(slopes: &[Planes], most: usize) -> (Vec<usize>, f64) {
    let n = slopes.first().and_then(|s| s.data.first()).map_or(0, Vec::len);
    let mut energy = vec![0.0f32; n];
    for slope in &slopes[..2.min(slopes.len())] {
        slope.data.iter().for_each(|p| energy.iter_mut().zip(p).for_each(|(e, v)| *e += v * v));
    }
    let peak = energy.iter().fold(0.0f32, |m, v| m.max(*v));
    let all: Vec<usize> = (0..n).filter(|&i| energy[i] > 1e-3 * peak).collect();
    let keep = all.len().min(most);
    ((0..keep).map(|i| all[i * all.len() / keep.max(1)]).collect(), keep as f64 / all.len().max(1) as f64)
}

/// Where nothing within so many samples is set.
fn away_from(set: &[bool], w: usize, h: usize, reach: usize) -> Vec<bool> {
    let mut rows = vec![false; w * h];
    for y in 0..h {
        for x in 0..w {
            rows[y * w + x] = (x.saturating_sub(reach)..(x + reach + 1).min(w)).any(|u| set[y * w + u]);
        }
    }
    let near = |x: usize, y: usize| (y.saturating_sub(reach)..(y + reach + 1).min(h)).any(|v| rows[v * w + x]);
    (0..w * h).map(|i| !near(i % w, i / w)).collect()
}

/// Carries what is known over to what is not: means of the known ones in ever larger cells.
fn fill(planes: &mut [Vec<f32>], known: &[bool], w: usize, h: usize) {
    if known.iter().all(|k| *k) || w * h <= 1 {
        return;
    }
    let (cw, ch) = (w.div_ceil(2), h.div_ceil(2));
    let mut count = vec![0.0f32; cw * ch];
    let mut coarse = vec![vec![0.0f32; cw * ch]; planes.len()];
    for (i, _) in known.iter().enumerate().filter(|(_, k)| **k) {
        let cell = (i / w / 2) * cw + i % w / 2;
        count[cell] += 1.0;
        coarse.iter_mut().zip(planes.iter()).for_each(|(c, p)| c[cell] += p[i]);
    }
    coarse.iter_mut().for_each(|c| c.iter_mut().zip(&count).for_each(|(v, n)| *v /= n.max(1.0)));
    let some: Vec<bool> = count.iter().map(|n| *n > 0.0).collect();
    fill(&mut coarse, &some, cw, ch);
    for (i, _) in known.iter().enumerate().filter(|(_, k)| !**k) {
        // Between the four nearest cells: three quarters of the own one each way.
        let (x, y) = (i % w, i / w);
        let near = |v: usize, n: usize| if v.is_multiple_of(2) { (v / 2).saturating_sub(1) } else { (v / 2 + 1).min(n - 1) };
        let (nx, ny) = (near(x, cw), near(y, ch));
        for (p, c) in planes.iter_mut().zip(&coarse) {
            let at = |x: usize, y: usize| c[y * cw + x];
            p[i] = 0.5625 * at(x / 2, y / 2) + 0.1875 * (at(nx, y / 2) + at(x / 2, ny)) + 0.0625 * at(nx, ny);
        }
    }
}

/// The weights, adding up to 1, whose mixture of the keys is nearest to `points`; `None` where they are not as many, or the keys are in one
/// place.
pub(super) fn weights_of(drawn: &dyn Drawn, points: &[[f64; 2]]) -> Option<Vec<f64>> {
    let k = drawn.n_keys();
    let base = drawn.key(0);
    if points.len() != base.len() {
        return None;
    }
    let difference = |j: usize| -> Vec<f64> { drawn.key(j).as_flattened().iter().zip(base.as_flattened()).map(|(a, b)| a - b).collect() };
    let columns: Vec<Vec<f64>> = (1..k).map(difference).collect();
    let rest: Vec<f64> = points.as_flattened().iter().zip(base.as_flattened()).map(|(a, b)| a - b).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut h = DMatrix::from_fn(k - 1, k - 1, |i, j| dot(&columns[i], &columns[j]));
    let floor = 1e-9 * h.trace();
    (0..k - 1).for_each(|i| h[(i, i)] += floor);
    let b = DVector::from_fn(k - 1, |i, _| dot(&columns[i], &rest));
    let found = if k == 1 { DVector::zeros(0) } else { nalgebra::Cholesky::new(h)?.solve(&b) };
    let mut weights = vec![1.0 - found.sum()];
    weights.extend(found.iter());
    weights.iter().all(|w| w.is_finite()).then_some(weights)
}

/// The moments of the drawing's coverage in the plane of the keys.
fn drawn_moments(drawn: &dyn Drawn, weights: &[f64]) -> Option<Moments> {
    let points = || (0..drawn.n_keys()).flat_map(|k| drawn.key(k));
    let low = points().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
    let high = points().fold([f64::NEG_INFINITY; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])]);
    // A picture of some hundred samples a side says where the bulk is.
    let step = ((high[0] - low[0]).max(high[1] - low[1]) / 96.0).max(1e-6);
    let size = [0, 1].map(|k| (libm::ceil((high[k] - low[k]) / step) as usize + 2).min(200));
    let s = 1.0 / step;
    let picture = drawn.draw(weights, &Affine::new(s, 0.0, 1.0 - s * low[0], 0.0, s, 1.0 - s * low[1]), s, size)?;
    let alpha: Vec<f32> = picture.chunks_exact(4).map(|p| p[3]).collect();
    let m = moments(&alpha, size[0])?;
    let centre = (m.centre - Vector2::new(1.0, 1.0)) * step + Vector2::from(low);
    Some(Moments { mass: m.mass * step * step, centre, spread: m.spread * (step * step) })
}

/// Each key, and each two of a few, where the moments of the matte put them; else where `found` does.
pub(super) fn every_pose(drawn: &dyn Drawn, found: &Affine, matte: Option<&[f32]>, width: usize) -> Vec<DrawnPose> {
    let k = drawn.n_keys();
    let to = matte.and_then(|m| moments(m, width));
    let mixed =
        |i: usize, j: usize| (0..k).map(|n| 0.5 * (f64::from(u8::from(n == i)) + f64::from(u8::from(n == j)))).collect::<Vec<f64>>();
    let pairs = (0..k).flat_map(|i| (i..k).map(move |j| (i, j))).filter(|(i, j)| i == j || k <= FEW);
    let pose = |(i, j)| {
        let weights = mixed(i, j);
        let moved = to.as_ref().and_then(|to| transport(&drawn_moments(drawn, &weights)?, to, found));
        DrawnPose { motion: moved.unwrap_or(*found), weights }
    };
    pairs.map(pose).collect()
}

/// Root mean square distance of points in pairs.
fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sum();
    libm::sqrt(sum / a.len().max(1) as f64)
}

/// Where the points of the keys are in the frame.
pub(crate) fn placed(drawn: &dyn Drawn, pose: &DrawnPose) -> Vec<[f64; 2]> {
    let n = drawn.key(0).len();
    let mixed = |i: usize| {
        let sum = |c: usize| pose.weights.iter().enumerate().map(|(k, w)| w * drawn.key(k)[i][c]).sum::<f64>();
        apply(&pose.motion, Vector2::new(sum(0), sum(1))).into()
    };
    (0..n).map(mixed).collect()
}

#[cfg(test)]
mod tests;
