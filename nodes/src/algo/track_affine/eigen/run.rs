//! One frame: starts compared at the coarsest level, then joint Gauss-Newton down the pyramid.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix6, Vector2, Vector6};

use super::super::level::{Fit, LEAST_SCALE, Level, Scratch};
use super::super::planes::{Planes, Window, gaussian_taps, smoothed};
use super::super::region::{has_finite, window_of};
use super::super::run::{CALM, Cut, FITS, FITS_WELL, LEAST_OVERLAP, UNSEEN, View, grid};
use super::super::solve::{Equations, Hold, Sums, away, distance, increment, is_sane, project, solve_equations, update};
use super::super::start::{carrying, extrapolate, moments, moved_bounds, shifted, transport, unrest};
use super::super::{Guess, LOST, Model, Search, Status, TURNS};
use super::space::{Curvature, Space};
use super::{EigenStart, EigenTemplate, EigenTrack};
use crate::algo::raster::{Affine, Raster, apply, identity};

/// Starts that are refined jointly.
const REFINED: usize = 3;
/// Iterations for the pose of a start whose motion is held.
const POSING: usize = 2;
/// How much further out the robust weights bend for the last pose: coefficients are of the whole picture, and those of its best parts are others.
const FORGIVING: f64 = 6.0;
/// Largest coefficient, in standard deviations over the examples.
const FARTHEST: f64 = 6.0;
/// Visibility under which a direction is held where it started: what the pose can show as well is not unseen.
const HARDLY: f64 = 0.002;
/// How much longer steps get that go on in one direction.
const LENGTHENED: f64 = 1.5;
/// Iterations at the levels but the finest: what is not found there is found below.
const COARSE_ITERATIONS: usize = 8;

/// A motion and a pose.
#[derive(Clone, Debug)]
struct Place {
    motion: Affine,
    pose: Vec<f64>,
}

/// A place after some iterations.
#[derive(Clone, Debug)]
struct Refined {
    place: Place,
    /// Where what cannot be seen is held.
    anchor: Affine,
    status: Status,
    fit: Fit,
    condition: f64,
}

/// One way to look for the region.
struct Attempt {
    radius: f64,
    keyed: bool,
    turned: bool,
    /// From the best informed guesses alone, and no further where none of them fits.
    brief: bool,
}

/// Motions that are tried, each with a pose; those that need no reason.
struct Guesses {
    all: Vec<Place>,
    /// How many of them, from the first, go on from the frame before.
    informed: usize,
    expected: Vec<Affine>,
}

struct Run<'a> {
    template: &'a EigenTemplate,
    spaces: &'a [Space],
    /// For each level the picture of the pose.
    shown: Vec<Level>,
    view: View<'a>,
    cut: Cut<'a>,
    scratch: Scratch,
    pulled: Vec<Vec<f32>>,
    /// The last level.
    finest: usize,
    iterations: usize,
}

/// A joint step: of the motion and of the pose.
struct Step {
    motion: Vector6<f64>,
    pose: DVector<f64>,
}

impl Step {
    /// Cosine of the angle to the step before, poses over the spread of the examples.
    fn along(&self, before: Option<&Self>, variances: &[f64]) -> Option<f64> {
        let before = before?;
        let spread = variances.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let scaled = |a: &Self, b: &Self| a.motion.dot(&b.motion) + a.pose.dot(&b.pose) / spread;
        Some(scaled(self, before) / libm::sqrt(scaled(self, self) * scaled(before, before)).max(f64::MIN_POSITIVE))
    }
}

/// The normal equations at the last linearisation.
struct System {
    motion: Matrix6<f64>,
    even: Vector6<f64>,
    curvature: Curvature,
    /// Of the components with each other and the prior.
    factor: Option<Cholesky<f64, Dyn>>,
    /// Prior's weight a component.
    prior: DVector<f64>,
}

impl System {
    fn new(sums: &Sums, curvature: Curvature, prior: DVector<f64>) -> Option<Self> {
        let mut own: DMatrix<f64> = curvature.own.clone();
        let floor = own.trace() * 1e-9;
        for l in 0..prior.len() {
            own[(l, l)] += prior[l] + floor;
        }
        let factor = if prior.is_empty() { None } else { Some(Cholesky::new(own)?) };
        Some(Self { motion: sums.hessian(), even: sums.even(), curvature, factor, prior })
    }

    /// The step of the pose for a step of the motion.
    fn pose(&self, right: &DVector<f64>, motion: &Vector6<f64>) -> DVector<f64> {
        let rest = DVector::from_fn(right.len(), |l, _| right[l] - self.curvature.cross[l].dot(motion));
        self.factor.as_ref().map_or_else(|| DVector::zeros(0), |f| f.solve(&rest))
    }

    /// The equations of the motion once the pose has taken its share (the Schur complement).
    fn reduced(&self, sums: &Sums, right: &DVector<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let (mut h, mut b) = (self.motion, sums.gradient());
        let Some(factor) = &self.factor else { return (h, b) };
        let n = right.len();
        let cross = DMatrix::from_fn(n, 6, |l, k| self.curvature.cross[l][k]);
        let (solved, alone) = (factor.solve(&cross), factor.solve(right));
        for i in 0..6 {
            b[i] -= (0..n).map(|l| cross[(l, i)] * alone[l]).sum::<f64>();
            for j in 0..6 {
                h[(i, j)] -= (0..n).map(|l| cross[(l, i)] * solved[(l, j)]).sum::<f64>();
            }
        }
        ((h + h.transpose()) * 0.5, b)
    }
}

impl EigenTemplate {
    /// From the coarsest level to the level `finest`, or the coarsest where there are fewer.
    pub(super) fn find(&self, frame: Raster, matte: Option<&[f32]>, start: &EigenStart, finest: usize) -> EigenTrack {
        let guesses = self.guesses(frame, matte, start);
        let mut best: Option<EigenTrack> = None;
        for attempt in self.attempts(matte.is_some()) {
            let enough = self.options.max_dissimilarity.min(LOST);
            if best.as_ref().is_some_and(|b| b.dissimilarity <= enough) {
                break;
            }
            let view = View { frame, matte: matte.filter(|_| attempt.keyed) };
            let turned = if attempt.turned { self.turned(frame, matte) } else { Vec::new() };
            let track = self.run(view, matte.is_some(), finest).descend(&guesses, &turned, &attempt);
            best = Some(best.filter(|b| 0.9 * b.dissimilarity <= track.dissimilarity).unwrap_or(track));
        }
        best.unwrap_or_else(|| failed(&guesses.all[0], Status::OffFrame))
    }

    fn run<'a>(&'a self, view: View<'a>, keyed: bool, finest: usize) -> Run<'a> {
        let spaces = if keyed { &self.keyed } else { &self.plain };
        let (scratch, pulled) = (Scratch::default(), Vec::new());
        let (cut, finest) = (self.cut(spaces.len()), finest.min(spaces.len() - 1));
        Run { template: self, spaces, shown: Self::blank(spaces), view, cut, scratch, pulled, finest, iterations: 0 }
    }

    pub(super) fn cut(&self, levels: usize) -> Cut<'_> {
        Cut {
            bounds: self.bounds,
            levels,
            used: &self.used,
            tone: self.options.tone,
            behind: &self.behind,
            amplitude: self.amplitude,
            premultiplied: true,
        }
    }

    fn attempts(&self, keyed: bool) -> Vec<Attempt> {
        let only = |radius| vec![Attempt { radius, keyed, turned: false, brief: false }];
        let size = libm::sqrt((self.bounds[2] - self.bounds[0]) * (self.bounds[3] - self.bounds[1]));
        let radius = (0.35 * size).max(8.0);
        match self.options.search {
            Search::None => only(0.0),
            Search::Radius(r) => only(r),
            Search::Whole => only(f64::INFINITY),
            Search::Auto => vec![
                Attempt { radius: 0.0, keyed, turned: false, brief: true },
                Attempt { radius: 0.0, keyed, turned: false, brief: false },
                Attempt { radius, keyed, turned: false, brief: false },
                Attempt { radius: 3.0 * radius, keyed, turned: true, brief: false },
            ],
        }
    }

    /// The motions before, and for each pose the calmest motion that gives it the moments of the matte.
    fn guesses(&self, frame: Raster, matte: Option<&[f32]>, start: &EigenStart) -> Guesses {
        let own = |m: &Affine| project(m, self.options.model, self.centre);
        let last = if is_sane(&start.last) { start.last } else { identity() };
        let fine = start.coefficients.len() == self.variances.len() && start.coefficients.iter().all(|c| c.is_finite());
        let pose = if fine { start.coefficients.clone() } else { vec![0.0; self.variances.len()] };
        let before = start.before.filter(|b| is_sane(b) && self.options.velocity);
        let ahead = before.and_then(|b| extrapolate(&last, &b));
        let mut all: Vec<Place> = ahead.into_iter().chain([last]).map(|m| Place { motion: own(&m), pose: pose.clone() }).collect();
        let mut expected: Vec<Affine> = all.iter().map(|p| p.motion).collect();
        let n_before = all.len();
        let to = matte.filter(|_| self.options.guess != Guess::Previous).and_then(|m| moments(m, frame.width));
        for p in [&pose].into_iter().chain(&self.poses) {
            if let (Some(from), Some(to)) = (self.moments_of(p), &to)
                && to.mass > 0.05 * from.mass
                && let Some(m) = transport(&from, to, &last)
            {
                all.push(Place { motion: own(&m), pose: p.clone() });
                expected.push(own(&m));
            }
        }
        if self.options.guess == Guess::Moments && all.len() > n_before {
            all.drain(..n_before);
        }
        // From where the character was, in another pose: a cut from key to key.
        all.extend(self.poses.iter().map(|p| Place { motion: own(&last), pose: p.clone() }));
        Guesses { informed: n_before + 1, all, expected }
    }

    /// Every turn that gives some pose the moments of the matte.
    fn turned(&self, frame: Raster, matte: Option<&[f32]>) -> Vec<Place> {
        let Some(to) = matte.and_then(|m| moments(m, frame.width)) else { return Vec::new() };
        let mut all = Vec::new();
        if self.options.model != Model::Translation {
            for pose in &self.poses {
                let turns = self.moments_of(pose).map_or_else(Vec::new, |from| carrying(&from, &to, TURNS));
                let own = turns.iter().filter(|m| is_sane(m)).map(|m| project(m, self.options.model, self.centre));
                all.extend(own.map(|motion| Place { motion, pose: pose.clone() }));
            }
        }
        all
    }
}

impl Run<'_> {
    fn descend(&mut self, guesses: &Guesses, turned: &[Place], how: &Attempt) -> EigenTrack {
        let options = &self.template.options;
        let (taps, _) = gaussian_taps(options.sigma);
        let top = self.spaces.len() - 1;
        let coarsest = self.spaces[top].mean.step;
        let (size, bounds) = ([self.view.frame.width, self.view.frame.height], self.template.bounds);
        let margin = (2.0 + 2.0 * options.sigma) * coarsest;
        let most = if how.brief { guesses.informed.min(guesses.all.len()) } else { guesses.all.len() };
        let starts: Vec<Place> = guesses.all[..most].iter().chain(turned).cloned().collect();
        let motions: Vec<Affine> = starts.iter().map(|p| p.motion).collect();
        let Some((window, mut all)) = self.cut.planes(&self.view, &motions, margin + how.radius) else {
            return failed(&starts[0], Status::OffFrame);
        };
        if !has_finite(self.view.frame, window) {
            return failed(&starts[0], Status::NotFinite);
        }
        let whole = Window { x0: i64::MIN / 4, y0: i64::MIN / 4, x1: i64::MAX / 4, y1: i64::MAX / 4 };
        let coarse = smoothed(&all[top], whole, &taps);
        let Some((cost, margin_of_fit, mut at)) = self.choose(&coarse, starts, guesses, how) else {
            return failed(&guesses.all[0], Status::OffFrame);
        };
        if how.brief && cost > FITS {
            return EigenTrack { iterations: self.iterations, ..failed(&guesses.all[0], Status::Unlike) };
        }
        let needed = window_of(moved_bounds(&at.place.motion, bounds), 0.5 * coarsest);
        if !window.covers(&needed, size) {
            match self.cut.planes(&self.view, &[at.place.motion], margin) {
                Some((_, found)) => all = found,
                None => return failed(&guesses.all[0], Status::OffFrame),
            }
        }
        for l in (self.finest..top).rev() {
            let part = window_of(moved_bounds(&at.place.motion, bounds), 6.0 * self.spaces[l].mean.step);
            let frame = smoothed(&all[l], part, &taps);
            at = self.refine(l, &frame, at.place, at.anchor);
            if matches!(at.status, Status::Textureless | Status::OffFrame) {
                return EigenTrack { iterations: self.iterations, ..failed(&guesses.all[0], at.status) };
            }
        }
        let last = self.finest;
        let part = window_of(moved_bounds(&at.place.motion, bounds), 6.0 * self.spaces[last].mean.step);
        let fine = if top == last { coarse } else { smoothed(&all[last], part, &taps) };
        at.place = self.posed(last, &fine, at.place, FORGIVING);
        self.report(at, margin_of_fit)
    }

    fn report(&self, at: Refined, margin: f64) -> EigenTrack {
        let dissimilarity = self.spaces[self.finest].dissimilarity(&self.shown[self.finest], &self.scratch);
        let status = match at.status {
            _ if dissimilarity > self.template.options.max_dissimilarity => Status::Unlike,
            Status::Converged if at.condition > UNSEEN => Status::Underdetermined,
            other => other,
        };
        EigenTrack {
            motion: at.place.motion,
            coefficients: at.place.pose,
            status,
            iterations: self.iterations,
            residual: at.fit.scale,
            dissimilarity,
            condition: at.condition,
            overlap: at.fit.overlap,
            margin,
        }
    }

    /// Shows `place` at a level and compares it; returns the share on the frame.
    fn compare(&mut self, l: usize, frame: &Planes, place: &Place, with_slopes: bool) -> f64 {
        let size = [self.view.frame.width, self.view.frame.height];
        self.spaces[l].place(&mut self.shown[l], &place.pose, with_slopes);
        let overlap = self.shown[l].sample(frame, size, &place.motion, &mut self.scratch);
        if self.template.options.gain {
            self.shown[l].remove_gain(&mut self.scratch);
        }
        overlap
    }

    fn cost(&mut self, frame: &Planes, place: &Place) -> f64 {
        let top = self.spaces.len() - 1;
        self.compare(top, frame, place, false);
        self.shown[top].cost(&self.scratch)
    }

    /// All starts, each in the pose that suits it best, refined jointly where they are the best; the one that fits best and by how much.
    fn choose(&mut self, frame: &Planes, starts: Vec<Place>, guesses: &Guesses, how: &Attempt) -> Option<(f64, f64, Refined)> {
        let top = self.spaces.len() - 1;
        let dues = |m: &Affine| CALM * unrest(m, &guesses.expected);
        let mut tried: Vec<(f64, Place)> = Vec::new();
        for start in starts {
            let posed = self.posed(top, frame, start, 1.0);
            tried.push((self.cost(frame, &posed) + dues(&posed.motion), posed));
        }
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let first = tried.first()?.1.clone();
        for (dx, dy) in grid(frame, apply(&first.motion, Vector2::from(self.template.centre)), how.radius, 1.0) {
            let place = Place { motion: shifted(&first.motion, dx, dy), pose: first.pose.clone() };
            tried.push((self.cost(frame, &place) + dues(&place.motion), place));
        }
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, Refined, usize)> = None;
        let mut next = f64::INFINITY;
        for place in self.pick(tried, 1.5 * frame.step) {
            self.iterations = 0;
            let anchor = place.motion;
            let refined = self.refine(top, frame, place, anchor);
            let paid = self.cost(frame, &refined.place) + dues(&refined.place.motion);
            let better = best.as_ref().is_none_or(|b| paid < b.0);
            next = next.min(if better { best.as_ref().map_or(f64::INFINITY, |b| b.0) } else { paid });
            if better {
                best = Some((paid, refined, self.iterations));
            }
            if paid < if how.radius > 0.0 { FITS_WELL } else { FITS } * 0.5 {
                break;
            }
        }
        let (paid, refined, iterations) = best?;
        self.iterations = iterations;
        if top == self.finest {
            self.cost(frame, &refined.place);
        }
        Some((paid, (next - paid).clamp(0.0, 1.0), refined))
    }

    /// The best few that are well apart in place or in pose.
    fn pick(&self, tried: Vec<(f64, Place)>, apart: f64) -> Vec<Place> {
        let t = self.template;
        let far = |a: &[f64], b: &[f64]| a.iter().zip(b).zip(&t.variances).any(|((a, b), v)| (a - b) * (a - b) > 0.25 * v);
        let mut picked: Vec<Place> = Vec::new();
        for (_, p) in tried {
            let apart = |q: &Place| distance(&q.motion, &p.motion, t.bounds) > apart || far(&q.pose, &p.pose);
            if picked.len() < REFINED && picked.iter().all(apart) {
                picked.push(p);
            }
        }
        picked
    }

    /// The pose of a place whose motion is held, its robust weights bent `forgiving` times as far out.
    fn posed(&mut self, l: usize, frame: &Planes, mut place: Place, forgiving: f64) -> Place {
        let mut kept = None;
        for _ in 0..POSING {
            if self.compare(l, frame, &place, false) < LEAST_OVERLAP {
                break;
            }
            let Some((_, system, right)) = self.linearised(l, 1.0, kept, &place, forgiving) else { break };
            let step = system.pose(&right, &Vector6::zeros());
            self.advance(&mut place.pose, &step, 1.0);
            kept = Some(system);
        }
        place
    }

    /// The equations at the last comparison: with `kept`, its left sides are used again.
    fn linearised(
        &mut self,
        l: usize,
        overlap: f64,
        kept: Option<System>,
        place: &Place,
        forgiving: f64,
    ) -> Option<((Fit, Sums), System, DVector<f64>)> {
        let (t, level, space) = (self.template, &self.shown[l], &self.spaces[l]);
        let fit = level.fit(overlap, &mut self.scratch);
        let sums = level.sums(&Fit { scale: fit.scale * forgiving, ..fit }, &t.options, &mut self.scratch);
        let mut right = space.right(&self.scratch, &mut self.pulled);
        let noise = fit.scale.max(LEAST_SCALE * level.contrast);
        let system = match kept {
            Some(system) => system,
            None => {
                let prior = |l: usize, _| t.how.prior * noise * noise / t.variances[l].max(f64::MIN_POSITIVE);
                System::new(&sums, space.curvature(level, &self.scratch), DVector::from_fn(t.variances.len(), prior))?
            }
        };
        (0..right.len()).for_each(|i| right[i] -= system.prior[i] * place.pose[i]);
        Some(((fit, sums), system, right))
    }

    /// Adds a share of a step to a pose; returns its length over the spread of the examples.
    fn advance(&self, pose: &mut [f64], step: &DVector<f64>, share: f64) -> f64 {
        let variances = &self.template.variances;
        let mut square = 0.0;
        for ((p, s), v) in pose.iter_mut().zip(step.iter()).zip(variances) {
            let most = FARTHEST * libm::sqrt(*v);
            let next = (*p + share * s).clamp(-most, most);
            square += (next - *p) * (next - *p);
            *p = next;
        }
        libm::sqrt(square / variances.iter().sum::<f64>().max(f64::MIN_POSITIVE))
    }

    /// Joint Gauss-Newton at one level; what cannot be seen stays as in `anchor`.
    fn refine(&mut self, l: usize, frame: &Planes, start: Place, anchor: Affine) -> Refined {
        let t = self.template;
        let options = &t.options;
        let tolerance = if l == 0 { options.tolerance } else { options.tolerance.max(0.1 * self.spaces[l].mean.step) };
        let most = if l == 0 { options.iterations } else { options.iterations.min(COARSE_ITERATIONS) };
        let mut at = Refined { place: start.clone(), anchor, status: Status::Unfinished, fit: Fit::default(), condition: f64::NAN };
        let back = |status, at: &Refined| Refined { place: start.clone(), status, ..at.clone() };
        let (mut kept, mut share, mut before, mut slow) = (None, 1.0, (f64::INFINITY, None), false);
        for iteration in 0..most {
            self.iterations += 1;
            let fresh = iteration == 0 || slow;
            let overlap = self.compare(l, frame, &at.place, fresh);
            if overlap < LEAST_OVERLAP {
                return back(Status::OffFrame, &at);
            }
            if fresh {
                kept = None;
            }
            let Some(((fit, sums), system, right)) = self.linearised(l, overlap, kept.take(), &at.place, 1.0) else {
                return back(Status::Textureless, &at);
            };
            at.fit = fit;
            let Some((step, condition)) = self.step(&at, &sums, &system, &right, l == 0 && fresh) else {
                return back(Status::Textureless, &at);
            };
            if fresh {
                at.condition = condition;
            }
            let inc = increment(&(step.motion * share), options.model, t.centre, t.scale);
            let moved = distance(&inc, &identity(), t.bounds);
            let Some(next) = update(&at.place.motion, &inc).filter(|_| moved <= t.scale) else {
                at.place = start;
                break;
            };
            at.place.motion = project(&next, options.model, t.centre);
            let posed = self.advance(&mut at.place.pose, &step.pose, share);
            if moved <= tolerance && posed <= tolerance {
                at.status = Status::Converged;
                break;
            }
            let (length, along) = (moved + posed, step.along(before.1.as_ref(), &t.variances));
            slow = length > 0.9 * before.0 || along.is_some_and(|cos| cos < 0.0);
            // Robust weights follow the residuals a part of the way each time: steps that go on in one direction are lengthened, those that go to and fro cut.
            share = match along {
                Some(cos) if cos > 0.8 && length > 0.4 * before.0 => LENGTHENED,
                Some(cos) if cos < 0.0 && l == 0 => 0.6 * share.min(1.0),
                _ => share.min(1.0),
            };
            before = (length, Some(step));
            kept = Some(system);
        }
        at
    }

    fn step(&self, at: &Refined, sums: &Sums, system: &System, right: &DVector<f64>, exact: bool) -> Option<(Step, f64)> {
        let t = self.template;
        let hold = Hold { away: away(&at.place.motion, &at.anchor, t.centre, t.scale), hardly: HARDLY };
        let (h, b) = system.reduced(sums, right);
        let found = solve_equations(&Equations { h, b, even: system.even, hold: &hold }, t.options.model, exact)?;
        Some((Step { pose: system.pose(right, &found.theta), motion: found.theta }, found.condition))
    }
}

/// The answer where nothing was found: the first guess, and why.
fn failed(place: &Place, status: Status) -> EigenTrack {
    EigenTrack {
        motion: place.motion,
        coefficients: place.pose.clone(),
        status,
        iterations: 0,
        residual: f64::NAN,
        dissimilarity: f64::INFINITY,
        condition: f64::NAN,
        overlap: 0.0,
        margin: 0.0,
    }
}
