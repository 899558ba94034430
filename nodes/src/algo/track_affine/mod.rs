//! Affine image registration: where a region of a reference picture is in another frame.
//!
//! The motion M minimises the sum over the region of rho(I(M s) - I0(s)), all channels together, where I0 is the reference and rho a robust
//! function: equations (8) to (12) of Bregler et al. The frame is sampled at the moved region, a small increment of the *reference* is solved
//! for by Gauss-Newton, and its inverse is composed onto the motion, so that the gradients of the reference serve for every frame. The
//! normal equations are summed anew each time, since the robust weights change. A pyramid takes the large motions first; before it, a search at the
//! coarsest level compares the prediction, the moments of the matte and a grid of shifts, and refines the best few.
//!
//! With a matte for the frame as well as for the reference, both are keyed: the background is replaced by the region's mean colour and
//! the matte becomes a channel, so that the outline of a flat drawing counts and what moves behind it does not.
//!
//! **Source**: Bregler, Loeb, Chuang, Deshpande, "Turning to the Masters: Motion Capturing Cartoons", SIGGRAPH 2002, section 3.3, equations
//! (8) to (12); equation (10) is expanded about the identity and the sign lost in (12) restored. Lucas and Kanade, "An Iterative
//! Image Registration Technique", IJCAI 1981. Bergen, Anandan, Hanna, Hingorani, "Hierarchical Model-Based Motion Estimation", ECCV 1992 (the
//! pyramid). Shi and Tomasi, "Good Features to Track", CVPR 1994 (affine model, check against the first frame). Baker and Matthews,
//! "Lucas-Kanade 20 Years On", IJCV 56(3), 2004, section 3.2 (inverse composition).
//!
//! **Fails when** the region has no gradients (`Status::Textureless`), is off the frame, or is so changed that nothing fits
//! (`Status::Unlike`). **Cost**: O(region) a frame and iteration; only the neighbourhood of the region is read.

pub mod eigen;
mod level;
mod options;
mod planes;
mod region;
mod run;
#[cfg(test)]
mod scene;
mod solve;
mod start;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Vector2};

use crate::algo::raster::{Affine, Raster, compose, identity};
use level::{Level, Scratch};
pub use options::{Guess, Model, Options, Region, Robust, Search, Tone, TrackError};
use options::{check_options, check_picture};
pub(crate) use planes::toned;
use planes::{Key, Planes, crop, pyramid};
use region::{Extent, extent, mask_planes, region_weight, used_channels, window_of, with_rim};
use run::{Attempt, Cut, Run, View, failed};
use solve::{is_sane, project};
use start::{Moments, carrying, extrapolate, moments, transport};

/// How the tracking of a frame ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The last step was below the tolerance, and the frame fits.
    Converged,
    /// All iterations were used; the motion is the last.
    Unfinished,
    /// Converged, but some direction of the model cannot be seen in the region and was left as predicted.
    Underdetermined,
    /// Nothing to see under the robust weights; the motion is the first guess.
    Textureless,
    /// Less than a fifth of the region is on the frame; the motion is the first guess.
    OffFrame,
    /// The residual is too large (drift, occlusion, a cut): the motion is the best found.
    Unlike,
    /// The frame has no finite samples near the region; the motion is the first guess.
    NotFinite,
}

/// The motions of the frames before, reference first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Motion of the frame before: frame from reference.
    pub last: Affine,
    /// Motion of the frame before that, where there is one.
    pub before: Option<Affine>,
}

impl Default for Start {
    fn default() -> Self {
        Self { last: identity(), before: None }
    }
}

/// Where the region is in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Frame from reference, pixels, centres at half integers.
    pub motion: Affine,
    /// How it ended.
    pub status: Status,
    /// Iterations over all levels, of the chosen start.
    pub iterations: usize,
    /// Robust standard deviation of the residual where the region has gradients, in toned sample units.
    pub residual: f64,
    /// Root mean square residual over the region's own standard deviation (Shi and Tomasi's check against the reference).
    pub dissimilarity: f64,
    /// Largest over least eigenvalue of the Hessian of the model's parameters (unit: pixels at the region's radius).
    pub condition: f64,
    /// Share of the region inside the frame.
    pub overlap: f64,
}

impl Track {
    /// True where the motion is at the minimum and the frame fits.
    pub fn is_converged(&self) -> bool {
        self.status == Status::Converged
    }
}

/// The region of a reference picture, ready to be found in frames: made once, used for each.
#[derive(Clone, Debug)]
pub struct Template {
    options: Options,
    channels: usize,
    /// Channels that say something of their own.
    used: Vec<usize>,
    plain: Vec<Level>,
    keyed: Vec<Level>,
    /// Colour behind the region, by channel of the picture, and the amplitude of the matte.
    behind: Vec<f32>,
    amplitude: f32,
    moments: Option<Moments>,
    bounds: [f64; 4],
    centre: [f64; 2],
    scale: f64,
}

/// Where the region may be in a frame.
struct Guesses {
    /// Best informed first, never empty.
    all: Vec<Affine>,
    /// Those that need no reason; the others must fit better to be believed.
    expected: Vec<Affine>,
    /// The one that moves least, by the moments of the matte.
    calm: Option<Affine>,
}

/// Rotations tried with the moments of a matte.
const TURNS: usize = 36;
/// Dissimilarity under which nothing is searched.
const GOOD_ENOUGH: f64 = 0.5;
/// What a later attempt's dissimilarity must be under, as a share of an earlier one's: the earlier are the likelier.
const CLEARLY: f64 = 0.9;
/// Dissimilarity above which the costly wide searches are tried.
const LOST: f64 = 0.7;

impl Template {
    /// The template of `region` in `reference`. O(region times levels).
    ///
    /// # Errors
    /// Options out of range, a picture or matte of the wrong size, an empty region, a region without gradients.
    pub fn new(reference: Raster, region: Region, options: &Options) -> Result<Self, TrackError> {
        check_options(options)?;
        let matte = if let Region::Matte(m) = region { Some(m) } else { None };
        check_picture(&reference, matte)?;
        // Specks far from the bulk of a matte are the faults of a matte, not parts of the region.
        let bulk = matte.and_then(|m| moments(m, reference.width));
        let stray = |x: usize, y: usize| bulk.as_ref().is_some_and(|b| b.is_stray(x as f64 + 0.5, y as f64 + 0.5));
        let weight = |x: usize, y: usize| if stray(x, y) { 0.0 } else { region_weight(&region, x, y, reference.width) };
        let found = extent(weight, reference.width, reference.height).ok_or(TrackError::Empty)?;
        let mut template = Self { moments: bulk, ..Self::empty(reference, options, found) };
        let size = (template.bounds[2] - template.bounds[0]).min(template.bounds[3] - template.bounds[1]);
        let mut levels = options.levels;
        while levels > 1 && size / f64::from(1u32 << (levels - 1)) < 10.0 {
            levels -= 1;
        }
        template.build(reference, weight, matte, levels)?;
        Ok(template)
    }

    fn empty(reference: Raster, options: &Options, found: Extent) -> Self {
        Self {
            options: options.clone(),
            channels: reference.channels,
            used: Vec::new(),
            plain: Vec::new(),
            keyed: Vec::new(),
            behind: Vec::new(),
            amplitude: 1.0,
            moments: None,
            bounds: found.bounds,
            centre: found.centre,
            scale: found.radius,
        }
    }

    fn build(
        &mut self,
        reference: Raster,
        weight: impl Fn(usize, usize) -> f32,
        matte: Option<&[f32]>,
        levels: usize,
    ) -> Result<(), TrackError> {
        let block = 1i64 << (levels - 1);
        let margin = (6.0 + 4.0 * self.options.sigma) * block as f64;
        let window = window_of(self.bounds, margin).aligned(block, reference.width, reference.height).ok_or(TrackError::Empty)?;
        let mask = mask_planes(window, weight, reference.width, reference.height);
        self.used = used_channels(reference, window);
        let plain = crop(reference, &self.used, window, self.options.tone, None);
        self.set_key(&plain, &mask, reference.channels);
        let masks = pyramid(mask, levels);
        self.plain = self.levels_of(pyramid(plain, levels), &masks, |m| m.data[0].iter().map(|&v| if v < 0.4 { 0.0 } else { v }).collect());
        if let Some(matte) = matte.filter(|_| self.options.key) {
            let key = Key { matte, behind: &self.behind, amplitude: self.amplitude, premultiplied: false };
            let keyed = crop(reference, &self.used, window, self.options.tone, Some(&key));
            self.keyed = self.levels_of(pyramid(keyed, levels), &masks, with_rim);
        }
        let all_flat = |set: &[Level]| set.iter().all(|l| l.contrast <= 1e-6);
        if all_flat(&self.plain) && all_flat(&self.keyed) { Err(TrackError::Textureless) } else { Ok(()) }
    }

    /// The mean colour of the region goes behind it, and the matte counts as much as the colours do.
    fn set_key(&mut self, plain: &Planes, mask: &Planes, channels: usize) {
        self.behind = vec![0.0; channels];
        let total: f64 = mask.data[0].iter().map(|&w| f64::from(w)).sum();
        let (mut variance, mut size) = (0.0f64, 0.0f64);
        for (plane, &c) in plain.data.iter().zip(&self.used) {
            let (mut s, mut ss) = (0.0f64, 0.0f64);
            for (&v, &w) in plane.iter().zip(&mask.data[0]) {
                s += f64::from(w) * f64::from(v);
                ss += f64::from(w) * f64::from(v) * f64::from(v);
            }
            let mean = s / total.max(1e-12);
            self.behind[c] = mean as f32;
            size = size.max(mean.abs());
            variance += (ss / total.max(1e-12) - mean * mean).max(0.0);
        }
        let amplitude = libm::sqrt(variance).max(0.25 * size);
        self.amplitude = if amplitude > 0.0 { amplitude as f32 } else { 1.0 };
    }

    /// The levels that have enough pixels, finest first; at least the finest.
    fn levels_of(&self, all: Vec<Planes>, masks: &[Planes], weight: impl Fn(&Planes) -> Vec<f32>) -> Vec<Level> {
        let mut out: Vec<Level> = Vec::new();
        for (planes, mask) in all.iter().zip(masks) {
            let Some(level) = Level::new(planes, &weight(mask), self.options.sigma, self.centre, self.scale) else { break };
            if !out.is_empty() && level.total() < 60.0 {
                break;
            }
            out.push(level);
        }
        out
    }

    /// The bounding box of the region in the reference: left, top, right, bottom, in pixels.
    pub fn bounds(&self) -> [f64; 4] {
        self.bounds
    }

    /// Finds the region in `frame`. `matte` is the frame's matte, where it has one; `start` the motions before. O(region).
    ///
    /// # Errors
    /// A frame or matte of the wrong size, or other channels than the reference. All else is told by the status.
    pub fn track(&self, frame: Raster, matte: Option<&[f32]>, start: &Start) -> Result<Track, TrackError> {
        check_picture(&frame, matte)?;
        if frame.channels != self.channels {
            return Err(TrackError::Channels { expected: self.channels, found: frame.channels });
        }
        let view = View { frame, matte: matte.filter(|_| !self.keyed.is_empty()) };
        let guesses = self.guesses(frame, matte, start);
        let mut best: Option<Track> = None;
        for attempt in self.attempts(&view) {
            let enough = self.options.max_dissimilarity.min(if attempt.lost { LOST } else { GOOD_ENOUGH });
            if best.is_some_and(|b| b.dissimilarity <= enough) {
                break;
            }
            let widened = if attempt.turned { self.turned(&guesses.all[0]) } else { Vec::new() };
            let view = View { matte: view.matte.filter(|_| attempt.keyed), ..view };
            let track = self.attempt(&view, if attempt.turned { &widened } else { &guesses.all }, &guesses, &attempt);
            best = Some(best.filter(|b| CLEARLY * b.dissimilarity <= track.dissimilarity).unwrap_or(track));
        }
        Ok(best.unwrap_or_else(|| failed(guesses.all[0], Status::OffFrame)))
    }

    /// What is tried in turn until something fits: the guesses as they are, a search, then a wider one, turned and scaled or without the key.
    fn attempts(&self, view: &View) -> Vec<Attempt> {
        let keyed = view.matte.is_some();
        let only = |radius| vec![Attempt { radius, keyed, ..Attempt::default() }];
        if self.options.search != Search::Auto {
            return match self.options.search {
                Search::Radius(r) => only(r),
                Search::Whole => only(f64::INFINITY),
                _ => only(0.0),
            };
        }
        let size = libm::sqrt((self.bounds[2] - self.bounds[0]) * (self.bounds[3] - self.bounds[1]));
        let radius = (0.35 * size).max(8.0);
        let mut all = vec![
            Attempt { keyed, bail: true, ..Attempt::default() },
            Attempt { radius, keyed, ..Attempt::default() },
            Attempt { radius: 3.0 * radius, keyed, lost: true, ..Attempt::default() },
        ];
        let turned = Attempt { radius: 2.0 * radius, keyed, turned: true, lost: true, bail: false };
        all.extend((self.options.model != Model::Translation).then_some(turned));
        all.extend(keyed.then_some(Attempt { radius, lost: true, ..Attempt::default() }));
        all
    }

    /// A guess turned and scaled about the region's centre.
    fn turned(&self, guess: &Affine) -> Vec<Affine> {
        let mut out = Vec::new();
        for angle in [0.0, -0.21, 0.21, -0.42, 0.42] {
            for size in if self.options.model == Model::Rigid { [1.0].as_slice() } else { &[1.0, 0.84, 1.19] } {
                let (s, c) = libm::sincos(angle);
                let linear = Matrix2::new(c, -s, s, c) * *size;
                let t = Vector2::from(self.centre) - linear * Vector2::from(self.centre);
                out.push(compose(guess, &Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), t])));
            }
        }
        out
    }

    /// Where the region may be.
    fn guesses(&self, frame: Raster, matte: Option<&[f32]>, start: &Start) -> Guesses {
        let own = |m: &Affine| project(m, self.options.model, self.centre);
        let last = if is_sane(&start.last) { start.last } else { identity() };
        let before = start.before.filter(|b| is_sane(b) && self.options.velocity);
        let mut all: Vec<Affine> = before.and_then(|b| extrapolate(&last, &b)).into_iter().chain([last]).map(|m| own(&m)).collect();
        let mut calm = None;
        if self.options.guess != Guess::Previous
            && let (Some(from), Some(matte)) = (&self.moments, matte)
            && let Some(to) = moments(matte, frame.width)
            && to.mass > 0.05 * from.mass
        {
            calm = transport(from, &to, &last).map(|m| own(&m));
            if self.options.guess == Guess::Moments && calm.is_some() {
                all.clear();
            }
            all.extend(calm);
            all.extend(carrying(from, &to, TURNS).iter().filter(|m| is_sane(m)).map(own));
        }
        // A turn that is not seen must not gather speed, so that where the moments speak the velocity does not.
        let expected = if calm.is_some() { [own(&last)].into_iter().chain(calm).collect() } else { all.clone() };
        Guesses { all, expected, calm }
    }

    fn attempt(&self, view: &View, starts: &[Affine], guesses: &Guesses, how: &Attempt) -> Track {
        let levels = if view.matte.is_some() { &self.keyed } else { &self.plain };
        let mut run = Run {
            template: self,
            view: *view,
            levels,
            cut: Cut {
                bounds: self.bounds,
                levels: levels.len(),
                used: &self.used,
                tone: self.options.tone,
                behind: &self.behind,
                amplitude: self.amplitude,
                premultiplied: false,
            },
            expected: &guesses.expected,
            calm: guesses.calm,
            size: [view.frame.width, view.frame.height],
            scratch: Scratch::default(),
            iterations: 0,
        };
        run.descend(starts, how)
    }
}
