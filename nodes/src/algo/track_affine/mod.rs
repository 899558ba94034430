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

mod level;
mod planes;
#[cfg(test)]
mod scene;
mod solve;
mod start;
#[cfg(test)]
mod tests;

use crate::algo::raster::{Affine, Raster, compose, identity};
use level::{Fit, Level, Scratch};
use nalgebra::{Matrix2, Vector2};
use planes::{Key, Planes, Window, crop, gaussian_taps, pyramid, smoothed, unit};
use solve::{distance, increment, is_sane, project, solve, update};
use start::{Moments, carrying, extrapolate, moments, moved_bounds, shifted};

/// Which motions are allowed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Model {
    /// Two parameters.
    Translation,
    /// Rotation and translation: three.
    Rigid,
    /// Rigid with one scale: four.
    Similarity,
    /// Six parameters, the `theta` of equation (11).
    #[default]
    Affine,
}

/// How much a pixel that does not fit counts; the bend of each is `cut` robust standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Robust {
    /// Least squares, as printed in the paper.
    None,
    /// Weight min(1, c/|r|): misfits count less.
    Huber,
    /// Weight 1/(1 + r²/c²)²: gross misfits hardly count.
    #[default]
    GemanMcClure,
}

/// What the differences are taken of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Tone {
    /// The samples as they are.
    Linear,
    /// sqrt(x + 0.0016) - 0.04, close to a display encoding: darks count as much as they are seen, and the noise is nearly even.
    #[default]
    Encoded,
}

/// Where the first guesses come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Guess {
    /// The motions before, and the moments of the matte where there is one; the best fit wins.
    #[default]
    Auto,
    /// The motions before only.
    Previous,
    /// The moments of the matte only; the motion before where there is no matte.
    Moments,
}

/// How far around the first guess the coarsest level looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Search {
    /// Not at all: for small motions.
    None,
    /// Only where the guesses do not fit: a third of the region's size, then three times as far, then turned and scaled too.
    #[default]
    Auto,
    /// This many pixels each way, 0 or more.
    Radius(f64),
    /// The whole frame: O(frame times region) at the coarsest level.
    Whole,
}

/// How to track.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Most pyramid levels, 1 to 10; fewer are used where the region would get smaller than some ten pixels.
    pub levels: usize,
    /// Most iterations at each level, 1 to 200.
    pub iterations: usize,
    /// Standard deviation of the Gaussian and its derivatives in pixels of each level, 0 (central differences) to 8.
    pub sigma: f64,
    /// Robust weights.
    pub robust: Robust,
    /// Bend of the robust weights, in robust standard deviations (median magnitude / 0.6745), 0.5 to 100. Small rejects
    /// more; large is closer to least squares.
    pub cut: f64,
    /// Motions allowed.
    pub model: Model,
    /// First guesses.
    pub guess: Guess,
    /// Predict at constant velocity from the two motions before.
    pub velocity: bool,
    /// Coarse search.
    pub search: Search,
    /// An iteration that moves no corner of the region by more than this, in pixels, is the last. 0 runs all iterations.
    pub tolerance: f64,
    /// Tone of the samples.
    pub tone: Tone,
    /// Fit a gain and an offset a channel, for flicker and fades.
    pub gain: bool,
    /// Use mattes as keys (background replaced, outline counted) where the frame has one too; else as weights only.
    pub key: bool,
    /// Relative root mean square residual above which the frame counts as unlike the reference; 0 is a perfect fit, and
    /// unrelated pictures have about 1.4.
    pub max_dissimilarity: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            levels: 6,
            iterations: 15,
            sigma: 0.8,
            robust: Robust::default(),
            cut: 4.0,
            model: Model::default(),
            guess: Guess::default(),
            velocity: true,
            search: Search::default(),
            tolerance: 0.01,
            tone: Tone::default(),
            gain: false,
            key: true,
            max_dissimilarity: 0.9,
        }
    }
}

/// Which pixels of the reference are followed.
#[derive(Clone, Copy, Debug)]
pub enum Region<'a> {
    /// All of them.
    Whole,
    /// Those whose centres lie in the box (left, top, right, bottom), in pixels.
    Box([f64; 4]),
    /// Those of a matte, `width * height` weights from 0 to 1.
    Matte(&'a [f32]),
}

/// Why a template cannot be made, or a frame not be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// A picture without samples, or too large to index.
    #[error("expected a picture of 2x2 to 2^30 pixels with at least one channel, found {width}x{height} with {channels}")]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Samples a pixel.
        channels: usize,
    },
    /// A matte of another size.
    #[error("expected a matte of {expected} samples, one a pixel, found {found}")]
    Matte {
        /// Pixels of the picture.
        expected: usize,
        /// Samples of the matte.
        found: usize,
    },
    /// A frame with other channels than the reference.
    #[error("expected {expected} channels as in the reference, found {found}")]
    Channels {
        /// Channels of the reference.
        expected: usize,
        /// Channels of the frame.
        found: usize,
    },
    /// An option out of range.
    #[error("expected {name} from {low} to {high}, found {found}")]
    Option {
        /// The field.
        name: &'static str,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
        /// The value given.
        found: f64,
    },
    /// A region without pixels.
    #[error("expected a region with at least one pixel inside the reference, found none: check the matte or the box")]
    Empty,
    /// A region without gradients.
    #[error("expected a region with some texture or outline, found one flat colour: give a larger region")]
    Textureless,
}

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

/// What the iterations read of the options.
#[derive(Clone, Copy, Debug)]
struct Tracking {
    robust: Robust,
    cut: f64,
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

/// Share of the region that must be on the frame.
const LEAST_OVERLAP: f64 = 0.2;
/// Rotations tried with the moments of a matte.
const TURNS: usize = 36;
/// Starts that are refined at the coarsest level.
const REFINED: usize = 3;
/// Cost at the coarsest level under which a guess is taken without a search.
const FITS: f64 = 0.12;
/// Dissimilarity under which nothing else is tried.
const GOOD_ENOUGH: f64 = 0.5;
/// Condition number beyond which a direction counts as unseen.
const UNSEEN: f64 = 1e6;

fn check_options(o: &Options) -> Result<(), TrackError> {
    let radius = if let Search::Radius(r) = o.search { r } else { 0.0 };
    let ranges = [
        ("levels", o.levels as f64, 1.0, 10.0),
        ("iterations", o.iterations as f64, 1.0, 200.0),
        ("sigma", o.sigma, 0.0, 8.0),
        ("cut", o.cut, 0.5, 100.0),
        ("search radius", radius, 0.0, 1e6),
        ("tolerance", o.tolerance, 0.0, 1e6),
        ("max dissimilarity", o.max_dissimilarity, 0.0, 1e6),
    ];
    match ranges.into_iter().find(|(_, v, low, high)| !(low..=high).contains(&v)) {
        Some((name, found, low, high)) => Err(TrackError::Option { name, low, high, found }),
        None => Ok(()),
    }
}

fn check_picture(p: &Raster, matte: Option<&[f32]>) -> Result<(), TrackError> {
    let (width, height, channels) = (p.width, p.height, p.channels);
    let pixels = width.saturating_mul(height);
    if width < 2 || height < 2 || channels == 0 || pixels > 1 << 30 || p.data.len() != pixels.saturating_mul(channels) {
        return Err(TrackError::Size { width, height, channels });
    }
    match matte {
        Some(m) if m.len() != pixels => Err(TrackError::Matte { expected: pixels, found: m.len() }),
        _ => Ok(()),
    }
}

impl Template {
    /// The template of `region` in `reference`. O(region times levels).
    ///
    /// # Errors
    /// Options out of range, a picture or matte of the wrong size, an empty region, a region without gradients.
    pub fn new(reference: Raster, region: Region, options: &Options) -> Result<Self, TrackError> {
        check_options(options)?;
        let matte = if let Region::Matte(m) = region { Some(m) } else { None };
        check_picture(&reference, matte)?;
        let weight = |x: usize, y: usize| region_weight(&region, x, y, reference.width);
        let found = extent(weight, reference.width, reference.height).ok_or(TrackError::Empty)?;
        let mut template = Self::empty(reference, options, found);
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
            self.moments = moments(matte, reference.width);
            let key = Key { matte, behind: &self.behind, amplitude: self.amplitude };
            let keyed = crop(reference, &self.used, window, self.options.tone, Some(&key));
            self.keyed = self.levels_of(pyramid(keyed, levels), &masks, with_rim);
        } else if let Some(matte) = matte {
            self.moments = moments(matte, reference.width);
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
            let widened = if attempt.turned { self.turned(&guesses[0]) } else { Vec::new() };
            let view = View { matte: view.matte.filter(|_| attempt.keyed), ..view };
            let track = self.attempt(&view, if attempt.turned { &widened } else { &guesses }, &attempt);
            let fits = track.dissimilarity <= GOOD_ENOUGH.min(self.options.max_dissimilarity);
            if best.is_none_or(|b| track.dissimilarity < b.dissimilarity) {
                best = Some(track);
            }
            if fits {
                break;
            }
        }
        Ok(best.unwrap_or_else(|| failed(guesses[0], Status::OffFrame)))
    }

    /// What is tried in turn until something fits: the guesses as they are, a search, then a wider one, turned and scaled or without the key.
    fn attempts(&self, view: &View) -> Vec<Attempt> {
        let keyed = view.matte.is_some();
        let only = |radius| vec![Attempt { radius, keyed, turned: false, bail: false }];
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
            Attempt { radius: 0.0, keyed, turned: false, bail: true },
            Attempt { radius, keyed, turned: false, bail: false },
            Attempt { radius: 3.0 * radius, keyed, turned: false, bail: false },
        ];
        let turned = Attempt { radius, keyed, turned: true, bail: false };
        all.extend((self.options.model != Model::Translation).then_some(turned));
        all.extend(keyed.then_some(Attempt { radius, keyed: false, turned: false, bail: false }));
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

    /// The first guesses, best informed first; never empty.
    fn guesses(&self, frame: Raster, matte: Option<&[f32]>, start: &Start) -> Vec<Affine> {
        let mut out = Vec::new();
        let last = if is_sane(&start.last) { start.last } else { identity() };
        let before = start.before.filter(|b| is_sane(b) && self.options.velocity);
        out.extend(before.and_then(|b| extrapolate(&last, &b)));
        out.push(last);
        if self.options.guess != Guess::Previous
            && let (Some(from), Some(matte)) = (&self.moments, matte)
            && let Some(to) = moments(matte, frame.width)
            && to.mass > 0.05 * from.mass
        {
            if self.options.guess == Guess::Moments {
                out.clear();
            }
            out.extend(carrying(from, &to, TURNS).into_iter().filter(is_sane));
        }
        if out.is_empty() {
            out.push(last);
        }
        out.iter().map(|m| project(m, self.options.model, self.centre)).collect()
    }

    fn attempt(&self, view: &View, guesses: &[Affine], how: &Attempt) -> Track {
        let levels = if view.matte.is_some() { &self.keyed } else { &self.plain };
        let mut run = Run {
            template: self,
            view: *view,
            levels,
            size: [view.frame.width, view.frame.height],
            scratch: Scratch::default(),
            iterations: 0,
        };
        run.descend(guesses, how)
    }
}

/// What is looked at: a frame, and its matte where the frame is keyed.
#[derive(Clone, Copy)]
struct View<'a> {
    frame: Raster<'a>,
    matte: Option<&'a [f32]>,
}

/// One way to look for the region.
struct Attempt {
    /// How far the grid of shifts reaches, in pixels.
    radius: f64,
    /// With the key, where there is one.
    keyed: bool,
    /// From turned and scaled copies of the first guess.
    turned: bool,
    /// Give up after the coarsest level where nothing fits well.
    bail: bool,
}

/// One attempt at one frame.
struct Run<'a> {
    template: &'a Template,
    view: View<'a>,
    levels: &'a [Level],
    size: [usize; 2],
    scratch: Scratch,
    iterations: usize,
}

/// A motion after some iterations.
#[derive(Clone, Copy)]
struct Refined {
    motion: Affine,
    status: Status,
    fit: Fit,
    condition: f64,
}

impl Run<'_> {
    /// The pyramid of the frame over the guesses' boxes, grown by `margin` pixels; `None` where they are all off the frame.
    fn planes(&self, guesses: &[Affine], margin: f64) -> Option<(Window, Vec<Planes>)> {
        let template = self.template;
        let block = 1i64 << (self.levels.len() - 1);
        let around = guesses
            .iter()
            .map(|m| moved_bounds(m, template.bounds))
            .reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
        let window = window_of(around, margin.min(1e9)).aligned(block, self.size[0], self.size[1])?;
        let key = self.view.matte.map(|matte| Key { matte, behind: &template.behind, amplitude: template.amplitude });
        let fine = crop(self.view.frame, &template.used, window, template.options.tone, key.as_ref());
        Some((window, pyramid(fine, self.levels.len())))
    }

    /// From the coarsest level to the finest.
    fn descend(&mut self, guesses: &[Affine], how: &Attempt) -> Track {
        let options = &self.template.options;
        let (taps, _) = gaussian_taps(options.sigma);
        let top = self.levels.len() - 1;
        let coarsest = self.levels[top].step;
        let first = guesses[0];
        let margin = (2.0 + 2.0 * options.sigma) * coarsest;
        let Some((window, mut all)) = self.planes(guesses, margin + how.radius) else { return failed(first, Status::OffFrame) };
        if !has_finite(self.view.frame, window) {
            return failed(first, Status::NotFinite);
        }
        let whole = Window { x0: i64::MIN / 4, y0: i64::MIN / 4, x1: i64::MAX / 4, y1: i64::MAX / 4 };
        let coarse = smoothed(&all[top], whole, &taps);
        let (cost, mut at) = self.choose(&coarse, guesses, how.radius, top == 0);
        if how.bail && cost > FITS {
            return Track { iterations: self.iterations, ..failed(first, Status::Unlike) };
        }
        // The iterations may have left the crop: the finer levels need all of the region.
        let needed = window_of(moved_bounds(&at.motion, self.template.bounds), 0.5 * coarsest);
        if !window.covers(&needed, self.size) {
            match self.planes(&[at.motion], margin) {
                Some((_, found)) => all = found,
                None => return failed(first, Status::OffFrame),
            }
        }
        for l in (0..top).rev() {
            let step = self.levels[l].step;
            let part = window_of(moved_bounds(&at.motion, self.template.bounds), 6.0 * step);
            let frame = smoothed(&all[l], part, &taps);
            at = self.refine(l, &frame, at.motion);
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

    /// Compares all starts at the coarsest level, refines the best few, and keeps the one that fits best.
    fn choose(&mut self, frame: &Planes, guesses: &[Affine], radius: f64, finest: bool) -> (f64, Refined) {
        let mut starts: Vec<(f64, Affine)> = guesses.iter().map(|m| (self.cost(frame, m), *m)).collect();
        let around = starts.iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(guesses[0], |s| s.1);
        for (dx, dy) in self.grid(frame, &around, radius) {
            let m = shifted(&around, dx, dy);
            starts.push((self.cost(frame, &m), m));
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut picked: Vec<Affine> = Vec::new();
        for (_, m) in &starts {
            let apart = 1.5 * frame.step;
            if picked.len() < REFINED && picked.iter().all(|p| distance(p, m, self.template.bounds) > apart) {
                picked.push(*m);
            }
        }
        let top = self.levels.len() - 1;
        let mut best: Option<(f64, Refined, usize)> = None;
        for m in picked {
            self.iterations = 0;
            let refined = self.refine(top, frame, m);
            let cost = self.cost(frame, &refined.motion);
            if best.as_ref().is_none_or(|b| cost < b.0) {
                best = Some((cost, refined, self.iterations));
            }
        }
        let Some((cost, refined, iterations)) = best else {
            let none = Refined { motion: guesses[0], status: Status::OffFrame, fit: Fit::default(), condition: f64::NAN };
            return (1.0, none);
        };
        self.iterations = iterations;
        if finest {
            self.cost(frame, &refined.motion);
        }
        (cost, refined)
    }

    /// Shifts, in whole samples of the coarsest level, that keep the region's centre within `radius` and on the crop.
    fn grid(&self, frame: &Planes, around: &Affine, radius: f64) -> Vec<(f64, f64)> {
        let centre = crate::algo::raster::apply(around, self.template.centre.into());
        let reach = |axis: usize, n: usize| {
            let low = (frame.origin[axis] - centre[axis]).max(-radius) / frame.step;
            let high = (frame.origin[axis] + n as f64 * frame.step - centre[axis]).min(radius) / frame.step;
            (libm::ceil(low).max(-1e4) as i64, libm::floor(high).min(1e4) as i64)
        };
        let ((x0, x1), (y0, y1)) = (reach(0, frame.width), reach(1, frame.height));
        let mut out = Vec::new();
        for j in y0..=y1 {
            for i in x0..=x1 {
                if (i, j) != (0, 0) {
                    out.push((i as f64 * frame.step, j as f64 * frame.step));
                }
            }
        }
        out
    }

    /// Gauss-Newton at one level.
    fn refine(&mut self, l: usize, frame: &Planes, start: Affine) -> Refined {
        let (template, level) = (self.template, &self.levels[l]);
        let options = &template.options;
        let how = Tracking { robust: options.robust, cut: options.cut };
        let tolerance = if l == 0 { options.tolerance } else { options.tolerance.max(0.04 * level.step) };
        let too_far = template.scale;
        let mut at = Refined { motion: start, status: Status::Unfinished, fit: Fit::default(), condition: f64::NAN };
        let mut last = None;
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
            let sums = level.sums(&at.fit, &how, &mut self.scratch);
            let Some(step) = solve(&sums, options.model, false) else {
                return Refined { motion: start, status: Status::Textureless, ..at };
            };
            last = Some(sums);
            let step = increment(&step.theta, options.model, template.centre, template.scale);
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
        }
        if l == 0 {
            at.condition = last.and_then(|s| solve(&s, options.model, true)).map_or(f64::NAN, |s| s.condition);
        }
        at
    }
}

fn failed(motion: Affine, status: Status) -> Track {
    Track { motion, status, iterations: 0, residual: f64::NAN, dissimilarity: f64::INFINITY, condition: f64::NAN, overlap: 0.0 }
}

/// Where a region is: its box, its centroid and its radius (root mean square distance along an axis, doubled).
struct Extent {
    bounds: [f64; 4],
    centre: [f64; 2],
    radius: f64,
}

fn region_weight(region: &Region, x: usize, y: usize, width: usize) -> f32 {
    match region {
        Region::Whole => 1.0,
        Region::Matte(m) => m.get(y * width + x).map_or(0.0, |&m| unit(m)),
        Region::Box([x0, y0, x1, y1]) => {
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            if px >= *x0 && px <= *x1 && py >= *y0 && py <= *y1 { 1.0 } else { 0.0 }
        }
    }
}

fn extent(weight: impl Fn(usize, usize) -> f32, width: usize, height: usize) -> Option<Extent> {
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut s, mut sx, mut sy, mut sq) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for y in 0..height {
        for x in 0..width {
            let w = f64::from(weight(x, y));
            if w <= 0.0 {
                continue;
            }
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            if w >= 0.25 {
                bounds = [bounds[0].min(px - 0.5), bounds[1].min(py - 0.5), bounds[2].max(px + 0.5), bounds[3].max(py + 0.5)];
            }
            (s, sx, sy, sq) = (s + w, sx + w * px, sy + w * py, sq + w * (px * px + py * py));
        }
    }
    if bounds[0].is_infinite() {
        return None;
    }
    let (cx, cy) = (sx / s, sy / s);
    let radius = libm::sqrt((2.0 * (sq / s - cx * cx - cy * cy)).max(1.0));
    Some(Extent { bounds, centre: [cx, cy], radius })
}

fn window_of(bounds: [f64; 4], margin: f64) -> Window {
    let cut = |v: f64| v.clamp(-1e12, 1e12) as i64;
    Window {
        x0: cut(libm::floor(bounds[0] - margin)),
        y0: cut(libm::floor(bounds[1] - margin)),
        x1: cut(libm::ceil(bounds[2] + margin)),
        y1: cut(libm::ceil(bounds[3] + margin)),
    }
}

/// The region's weights as planes; zero off the picture.
fn mask_planes(window: Window, weight: impl Fn(usize, usize) -> f32, width: usize, height: usize) -> Planes {
    let (w, h) = ((window.x1 - window.x0) as usize, (window.y1 - window.y0) as usize);
    let mut plane = vec![0.0f32; w * h];
    for (j, row) in plane.chunks_exact_mut(w).enumerate() {
        for (i, v) in row.iter_mut().enumerate() {
            let (x, y) = (window.x0 as usize + i, window.y0 as usize + j);
            if x < width && y < height {
                *v = weight(x, y);
            }
        }
    }
    Planes { width: w, height: h, origin: [window.x0 as f64, window.y0 as f64], step: 1.0, data: vec![plane] }
}

/// The region and two samples around it, full weight: the outline of a keyed region has its gradients on both sides.
fn with_rim(mask: &Planes) -> Vec<f32> {
    let (w, h) = (mask.width, mask.height);
    let inside = |x: i64, y: i64| x >= 0 && y >= 0 && x < w as i64 && y < h as i64 && mask.data[0][y as usize * w + x as usize] > 0.3;
    let mut out = vec![0.0f32; w * h];
    for y in 0..h as i64 {
        for x in 0..w as i64 {
            if (-2..=2).any(|dy| (-2..=2).any(|dx| inside(x + dx, y + dy))) {
                out[y as usize * w + x as usize] = 1.0;
            }
        }
    }
    out
}

/// The channels that are not a copy of an earlier one over the window: a grey plate is often stored as three equal channels.
fn used_channels(reference: Raster, window: Window) -> Vec<usize> {
    let n = reference.channels;
    let (x0, x1) = (window.x0.max(0) as usize, (window.x1.max(0) as usize).min(reference.width));
    let (y0, y1) = (window.y0.max(0) as usize, (window.y1.max(0) as usize).min(reference.height));
    let pixels = || (y0..y1).flat_map(|y| reference.row(y)[x0 * n..x1 * n].chunks_exact(n));
    let copies = |a: usize, b: usize| pixels().all(|p| p[a].to_bits() == p[b].to_bits());
    let constant = |c: usize| {
        let first = pixels().next().map(|p| p[c].to_bits());
        pixels().all(|p| Some(p[c].to_bits()) == first)
    };
    let mut used: Vec<usize> = Vec::new();
    for c in 0..n {
        if !constant(c) && !used.iter().any(|&u| copies(u, c)) {
            used.push(c);
        }
    }
    if used.is_empty() { vec![0] } else { used }
}

/// True where at least one sample near the region is finite: a coarse lattice is enough.
fn has_finite(frame: Raster, window: Window) -> bool {
    let (x0, x1) = (window.x0.max(0) as usize, (window.x1.max(0) as usize).min(frame.width));
    let (y0, y1) = (window.y0.max(0) as usize, (window.y1.max(0) as usize).min(frame.height));
    (y0..y1).step_by(7).any(|y| frame.row(y)[x0 * frame.channels..x1 * frame.channels].iter().any(|v| v.is_finite()))
}
