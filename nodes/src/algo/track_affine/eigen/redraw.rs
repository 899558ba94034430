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

mod directions;
mod ground;
mod misfit;
mod poses;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, DVector, Vector2};

use super::super::level::LEAST_SCALE;
use super::super::planes::{Planes, Window, gaussian_taps, smoothed, toned, untoned};
use super::super::region::{has_finite, window_of};
use super::super::run::{Cut, View};
use super::super::solve::{is_sane, project};
use super::super::start::moved_bounds;
use super::super::{Options, Status};
use super::EigenTrack;
use crate::algo::raster::{Affine, compose};
use directions::Directions;
use ground::{away_from, fill};
use misfit::{robust_cost, robust_scale, robust_weight, soft_cost, telling};
use poses::apart;
pub(crate) use poses::placed;
pub use poses::{Drawn, DrawnPose};
pub(super) use poses::{every_pose, weights_of};

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
const LEAST_AXIS: f64 = 0.5;
/// The same at the finest level.
const LEAST_FINE: f64 = 0.01;
/// Starts that are refined at the coarsest level.
const REFINED: usize = 3;
/// Coverage over which a pixel is the character's.
const COVERED: f32 = 0.02;
/// Largest weight, and one minus the least.
const FARTHEST: f64 = 2.0;
/// A start that costs less is taken without a look at others.
const FITS: f64 = 0.1;
/// Relative residual under which no other start is tried.
const SURE: f64 = 0.4;

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

/// A step that was taken.
struct Improved {
    pose: DrawnPose,
    /// What the frame would be in this pose.
    picture: Planes,
    moved: f64,
    /// By how much the cost sank with the single step.
    gained: f64,
}

/// How much a step is held back.
struct Damping {
    by: f64,
    raise: f64,
}

impl Damping {
    /// After a step that gained this share of what was to be expected.
    fn ease(&mut self, share: f64) {
        let over = 2.0 * share - 1.0;
        self.by = (self.by * (1.0 - over * over * over).max(1.0 / 3.0)).max(1e-9);
        self.raise = 2.0;
    }

    fn raise(&mut self) {
        self.by *= self.raise;
        self.raise *= 2.0;
    }
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
        let coarse = self.view.matte.is_some().then(|| self.keyed(&keyed[top], &taps));
        let chosen = |all: &[DrawnPose]| coarse.as_ref().map_or_else(Vec::new, |target| self.choose(target, all, &taps));
        let seen = Seen { window, keyed, plain: self.cut.planes(&View { matte: None, ..self.view }, &motions, margin)?.1 };
        let mut best: Option<(Settled, usize)> = None;
        let is_sure = |best: &Option<(Settled, usize)>| best.as_ref().is_some_and(|b| b.0.dissimilarity < SURE);
        // What fits at the coarsest level may be another pose: then every pose is looked at. A matte with holes leads astray: the starts follow as they are.
        for round in 0..3 {
            let tried = match round {
                0 => chosen(starts),
                1 => chosen(&others()),
                _ => starts.iter().map(|p| Candidate { paid: f64::INFINITY, pose: p.clone(), iterations: 0 }).collect(),
            };
            for candidate in tried {
                let mut iterations = before.iterations + candidate.iterations;
                let Some(settled) = self.descend(&seen, candidate.pose, margin, &taps, &mut iterations) else { continue };
                if best.as_ref().is_none_or(|b| settled.dissimilarity < b.0.dissimilarity) {
                    best = Some((settled, iterations));
                }
                if is_sure(&best) {
                    break;
                }
            }
            if is_sure(&best) {
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
        let least = if finest { LEAST_FINE } else { LEAST_AXIS };
        let (mut damping, mut scale, mut status) = (Damping { by: 1e-4, raise: 2.0 }, 0.0, Status::Unfinished);
        for _ in 0..most {
            *iterations += 1;
            let directions = Directions::new(self.drawn, self.options.model, &pose, |p| self.scaled(p), target.step, least);
            let slopes = self.slopes(target, &pose, &picture, &directions, taps)?;
            let (telling, share) = telling(&slopes, self.pixels);
            scale = robust_scale(&picture, &target.frame, &telling).max(LEAST_SCALE * self.contrast);
            // Hands that are still off are no outliers: nearly all counts.
            let bend = (scale * self.options.cut).max(self.contrast * if finest { NARROW } else { WIDE }) as f32;
            let linear = self.linear(target, &picture, &slopes, &telling, &directions, bend);
            let (mut moved, mut better) = (f64::INFINITY, false);
            for _ in 0..TRIALS {
                if let Some(step) = self.step(&linear, &directions, &pose, (damping.by, 1.0), target.step) {
                    moved = step.moved;
                    // What lies right holds back what does not: twice the step is often nearer.
                    let far = self.step(&linear, &directions, &pose, (damping.by, 2.0), target.step).filter(|_| moved > tolerance);
                    let gain = share / step.gain.max(f64::MIN_POSITIVE);
                    if let Some(found) = self.improved(target, &picture, [Some(step), far], bend, taps)? {
                        damping.ease(gain * found.gained);
                        (pose, picture, moved, better) = (found.pose, found.picture, found.moved, true);
                        break;
                    }
                    if moved <= tolerance {
                        break;
                    }
                }
                damping.raise();
            }
            if moved <= tolerance || !better {
                // Where no step is better, the pose is at the minimum as far as the samples can say.
                let near = moved <= tolerance.max(0.1 * target.step);
                status = if near { Status::Converged } else { Status::Unfinished };
                break;
            }
        }
        let dissimilarity = self.dissimilarity(target, &picture, &pose)?;
        Some(Settled { pose, status, residual: scale, dissimilarity })
    }

    /// The step, if it is no worse than the `picture` as it is, or the one beyond it where that is better still; `None` outside where nothing can be drawn.
    fn improved(
        &self,
        target: &Target,
        picture: &Planes,
        [step, far]: [Option<Step>; 2],
        bend: f32,
        taps: &[f32],
    ) -> Option<Option<Improved>> {
        let cost = |seen: &Planes| robust_cost(seen, &target.frame, bend, self.options.robust);
        let Some(step) = step else { return Some(None) };
        let (before, seen) = (cost(picture), self.picture(target, &step.pose, [0.0; 2], taps)?);
        let after = cost(&seen);
        if after > before {
            return Some(None);
        }
        let found = Improved { pose: step.pose, picture: seen, moved: step.moved, gained: before - after };
        let Some(far) = far else { return Some(Some(found)) };
        let seen = self.picture(target, &far.pose, [0.0; 2], taps)?;
        let is_nearer = cost(&seen) < after;
        Some(Some(if is_nearer { Improved { pose: far.pose, picture: seen, moved: far.moved, ..found } } else { found }))
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
