//! One attempt at one frame: from the first guesses down the pyramid.

use nalgebra::{Vector2, Vector6};

use super::level::{Fit, Level, Scratch};
use super::planes::{Key, Planes, Window, crop, gaussian_taps, pyramid, smoothed};
use super::region::{has_finite, window_of};
use super::solve::{Hold, away, distance, hardly_seen, increment, project, solve, update};
use super::start::{moved_bounds, shifted, unrest};
use super::{Status, Template, Tone, Track};
use crate::algo::raster::{Affine, Raster, apply, identity};

/// Share of the region that must be on the frame.
pub(super) const LEAST_OVERLAP: f64 = 0.2;
/// Starts that are refined at the coarsest level.
const REFINED: usize = 3;
/// Starts that are refined when nothing has fitted yet.
const REFINED_WIDE: usize = 8;
/// Cost at the coarsest level under which a guess is taken without a search.
pub(super) const FITS: f64 = 0.12;
/// Cost at the coarsest level under which no other start can do much better.
pub(super) const FITS_WELL: f64 = 0.03;
/// What a start pays for each unit of unrest: an outline without features fits many ways, and the calmest is the one that is meant.
pub(super) const CALM: f64 = 0.04;
/// Unrest between a start and the calmest motion under which the latter says what cannot be seen.
const NEARLY_CALM: f64 = 0.2;
/// Condition number beyond which a direction counts as unseen.
pub(super) const UNSEEN: f64 = 1e6;

/// What is looked at: a frame, and its matte where the frame is keyed.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) frame: Raster<'a>,
    pub(super) matte: Option<&'a [f32]>,
}

/// One way to look for the region.
#[derive(Default)]
pub(super) struct Attempt {
    /// How far the grid of shifts reaches, in pixels.
    pub(super) radius: f64,
    /// With the key, where there is one.
    pub(super) keyed: bool,
    /// From turned and scaled copies of the first guess, each shifted.
    pub(super) turned: bool,
    /// Only when the region is clearly lost: this way is costly.
    pub(super) lost: bool,
    /// Give up after the coarsest level where nothing fits well.
    pub(super) bail: bool,
}

/// One attempt at one frame.
pub(super) struct Run<'a> {
    pub(super) template: &'a Template,
    pub(super) view: View<'a>,
    pub(super) levels: &'a [Level],
    pub(super) cut: Cut<'a>,
    /// Motions that need no reason.
    pub(super) expected: &'a [Affine],
    /// The motion that moves least, by the moments of the matte.
    pub(super) calm: Option<Affine>,
    pub(super) size: [usize; 2],
    pub(super) scratch: Scratch,
    pub(super) iterations: usize,
}

/// A motion after some iterations.
#[derive(Clone, Copy)]
struct Refined {
    motion: Affine,
    /// Where the iterations began: what cannot be seen stays as it is there.
    start: Affine,
    status: Status,
    fit: Fit,
    condition: f64,
}

/// Which part of a frame is looked at, and how.
pub(super) struct Cut<'a> {
    /// The region's box in the reference.
    pub(super) bounds: [f64; 4],
    pub(super) levels: usize,
    /// Channels that are compared.
    pub(super) used: &'a [usize],
    pub(super) tone: Tone,
    pub(super) behind: &'a [f32],
    pub(super) amplitude: f32,
    pub(super) premultiplied: bool,
}

impl Cut<'_> {
    /// The pyramid of the frame over the boxes of `guesses`, grown by `margin` pixels; `None` where they are all off the frame.
    pub(super) fn planes(&self, view: &View, guesses: &[Affine], margin: f64) -> Option<(Window, Vec<Planes>)> {
        let block = 1i64 << (self.levels - 1);
        let around = guesses
            .iter()
            .map(|m| moved_bounds(m, self.bounds))
            .reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
        let window = window_of(around, margin.min(1e9)).aligned(block, view.frame.width, view.frame.height)?;
        let (behind, amplitude, premultiplied) = (self.behind, self.amplitude, self.premultiplied);
        let key = view.matte.map(|matte| Key { matte, behind, amplitude, premultiplied });
        let fine = crop(view.frame, self.used, window, self.tone, key.as_ref());
        Some((window, pyramid(fine, self.levels)))
    }
}

impl Run<'_> {
    /// From the coarsest level to the finest.
    pub(super) fn descend(&mut self, guesses: &[Affine], how: &Attempt) -> Track {
        let options = &self.template.options;
        let (taps, _) = gaussian_taps(options.sigma);
        let top = self.levels.len() - 1;
        let coarsest = self.levels[top].step;
        let first = guesses[0];
        let margin = (2.0 + 2.0 * options.sigma) * coarsest;
        let Some((window, mut all)) = self.cut.planes(&self.view, guesses, margin + how.radius) else {
            return failed(first, Status::OffFrame);
        };
        if !has_finite(self.view.frame, window) {
            return failed(first, Status::NotFinite);
        }
        let whole = Window { x0: i64::MIN / 4, y0: i64::MIN / 4, x1: i64::MAX / 4, y1: i64::MAX / 4 };
        let coarse = smoothed(&all[top], whole, &taps);
        let (cost, mut at) = self.choose(&coarse, guesses, how);
        if how.bail && cost > FITS {
            return Track { iterations: self.iterations, ..failed(first, Status::Unlike) };
        }
        // The iterations may have left the crop: the finer levels need all of the region.
        let needed = window_of(moved_bounds(&at.motion, self.template.bounds), 0.5 * coarsest);
        if !window.covers(&needed, self.size) {
            match self.cut.planes(&self.view, &[at.motion], margin) {
                Some((_, found)) => all = found,
                None => return failed(first, Status::OffFrame),
            }
        }
        for l in (0..top).rev() {
            let step = self.levels[l].step;
            let part = window_of(moved_bounds(&at.motion, self.template.bounds), 6.0 * step);
            let frame = smoothed(&all[l], part, &taps);
            at = self.refine(l, &frame, at.motion, at.start);
            if matches!(at.status, Status::Textureless | Status::OffFrame) {
                break;
            }
        }
        if matches!(at.status, Status::Textureless | Status::OffFrame) {
            return Track { iterations: self.iterations, ..failed(first, at.status) };
        }
        let dissimilarity = self.levels[0].dissimilarity(&self.scratch);
        let mut status = at.status;
        if status == Status::Converged && at.condition > UNSEEN {
            status = Status::Underdetermined;
        }
        if dissimilarity > options.max_dissimilarity {
            status = Status::Unlike;
        }
        Track {
            motion: at.motion,
            status,
            iterations: self.iterations,
            residual: at.fit.scale,
            dissimilarity,
            condition: at.condition,
            overlap: at.fit.overlap,
        }
    }

    /// The cost of a placement at the coarsest level.
    fn cost(&mut self, frame: &Planes, motion: &Affine) -> f64 {
        let level = &self.levels[self.levels.len() - 1];
        level.sample(frame, self.size, motion, &mut self.scratch);
        if self.template.options.gain {
            level.remove_gain(&mut self.scratch);
        }
        level.cost(&self.scratch)
    }

    /// What a motion pays for being unexpected.
    fn dues(&self, motion: &Affine) -> f64 {
        CALM * unrest(motion, self.expected)
    }

    /// Where what cannot be seen is held: shaped as the moments say, where that is near, and centred as `start` is.
    fn anchor(&self, start: &Affine) -> Affine {
        let Some(calm) = self.calm.filter(|c| unrest(start, &[*c]) < NEARLY_CALM) else { return *start };
        let centre = self.template.centre.into();
        let d = apply(start, centre) - apply(&calm, centre);
        shifted(&calm, d.x, d.y)
    }

    /// All starts with their costs and dues at the coarsest level, best first.
    fn starts(&mut self, frame: &Planes, guesses: &[Affine], how: &Attempt) -> Vec<(f64, Affine)> {
        let mut starts: Vec<(f64, Affine)> = guesses.iter().map(|m| (self.cost(frame, m) + self.dues(m), *m)).collect();
        let best = starts.iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|s| s.1);
        let around: Vec<Affine> = if how.turned { guesses.to_vec() } else { best.into_iter().collect() };
        for guess in around {
            for (dx, dy) in grid(frame, apply(&guess, self.template.centre.into()), how.radius, if how.turned { 2.0 } else { 1.0 }) {
                let m = shifted(&guess, dx, dy);
                starts.push((self.cost(frame, &m) + self.dues(&m), m));
            }
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        starts
    }

    /// The best `most` of the starts that are well apart.
    fn pick(&self, starts: &[(f64, Affine)], apart: f64, most: usize) -> Vec<Affine> {
        let mut picked: Vec<Affine> = Vec::new();
        for (_, m) in starts {
            if picked.len() < most && picked.iter().all(|p| distance(p, m, self.template.bounds) > apart) {
                picked.push(*m);
            }
        }
        picked
    }

    /// Compares all starts at the coarsest level, refines the best few, and keeps the one that fits best, with its cost.
    fn choose(&mut self, frame: &Planes, guesses: &[Affine], how: &Attempt) -> (f64, Refined) {
        let top = self.levels.len() - 1;
        let starts = self.starts(frame, guesses, how);
        let picked = self.pick(&starts, 1.5 * frame.step, if how.turned { REFINED_WIDE } else { REFINED });
        let mut best: Option<(f64, f64, Refined, usize)> = None;
        for m in picked {
            self.iterations = 0;
            let refined = self.refine(top, frame, m, self.anchor(&m));
            let cost = self.cost(frame, &refined.motion);
            let paid = cost + self.dues(&refined.motion);
            if best.as_ref().is_none_or(|b| paid < b.0) {
                best = Some((paid, cost, refined, self.iterations));
            }
            if paid < FITS_WELL {
                break;
            }
        }
        let Some((_, cost, refined, iterations)) = best else {
            let none =
                Refined { motion: guesses[0], start: guesses[0], status: Status::OffFrame, fit: Fit::default(), condition: f64::NAN };
            return (1.0, none);
        };
        self.iterations = iterations;
        if top == 0 {
            // The residuals of the chosen one are read after the last level.
            self.cost(frame, &refined.motion);
        }
        (cost, refined)
    }

    /// Gauss-Newton at one level from `start`; what cannot be seen stays as in `anchor`.
    fn refine(&mut self, l: usize, frame: &Planes, start: Affine, anchor: Affine) -> Refined {
        let (template, level) = (self.template, &self.levels[l]);
        let options = &template.options;
        let tolerance = if l == 0 { options.tolerance } else { options.tolerance.max(0.04 * level.step) };
        let too_far = template.scale;
        let mut at = Refined { motion: start, start: anchor, status: Status::Unfinished, fit: Fit::default(), condition: f64::NAN };
        let mut last = None;
        let (mut share, mut before) = (1.0, Vector6::zeros());
        for _ in 0..options.iterations {
            self.iterations += 1;
            let overlap = level.sample(frame, self.size, &at.motion, &mut self.scratch);
            if overlap < LEAST_OVERLAP {
                return Refined { motion: start, status: Status::OffFrame, ..at };
            }
            if options.gain {
                level.remove_gain(&mut self.scratch);
            }
            at.fit = level.fit(overlap, &mut self.scratch);
            let sums = level.sums(&at.fit, options, &mut self.scratch);
            let misfit = at.fit.scale / level.contrast.max(1e-12);
            let hold = Hold { away: away(&at.motion, &anchor, template.centre, template.scale), hardly: hardly_seen(misfit) };
            let Some(step) = solve(&sums, &hold, options.model, false) else {
                return Refined { motion: start, status: Status::Textureless, ..at };
            };
            last = Some(sums);
            let theta = step.theta * share;
            let step = increment(&theta, options.model, template.centre, template.scale);
            let moved = distance(&step, &identity(), template.bounds);
            let Some(next) = update(&at.motion, &step).filter(|_| moved <= too_far) else {
                at.motion = start;
                break;
            };
            at.motion = project(&next, options.model, template.centre);
            if moved <= tolerance {
                at.status = Status::Converged;
                break;
            }
            // Steps that do not get shorter go to and fro between the sides of a ragged minimum.
            if l == 0 && theta.norm_squared() > 0.5 * before.norm_squared() && before != Vector6::zeros() {
                share *= 0.6;
            }
            before = theta;
        }
        if l == 0 {
            at.condition = last.and_then(|s| solve(&s, &Hold::default(), options.model, true)).map_or(f64::NAN, |s| s.condition);
        }
        at
    }
}

/// Shifts of every `stride`-th sample of `frame` that keep the region's `centre` within `radius` and on the crop.
pub(super) fn grid(frame: &Planes, centre: Vector2<f64>, radius: f64, stride: f64) -> Vec<(f64, f64)> {
    let step = frame.step * stride;
    let reach = |axis: usize, n: usize| {
        let low = (frame.origin[axis] - centre[axis]).max(-radius) / step;
        let high = (frame.origin[axis] + n as f64 * frame.step - centre[axis]).min(radius) / step;
        (libm::ceil(low).max(-1e4) as i64, libm::floor(high).min(1e4) as i64)
    };
    let ((x0, x1), (y0, y1)) = (reach(0, frame.width), reach(1, frame.height));
    (y0..=y1).flat_map(|j| (x0..=x1).map(move |i| (i as f64 * step, j as f64 * step))).filter(|d| *d != (0.0, 0.0)).collect()
}

/// The answer where nothing was found: the first guess, and why.
pub(super) fn failed(motion: Affine, status: Status) -> Track {
    Track { motion, status, iterations: 0, residual: f64::NAN, dissimilarity: f64::INFINITY, condition: f64::NAN, overlap: 0.0 }
}
