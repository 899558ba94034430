//! Eigen-tracking: where a drawn character is, and which of its poses it shows.
//!
//! The pictures of a character in all its poses span a linear space: a mean picture M and components E. Sought are the motion A and the
//! coefficients w that minimise the sum over the region of rho(I(A s) - M(s) - Σ w_l E_l(s)), equations (14) and (15) of Bregler et al.,
//! all channels together. Both are solved for in one Gauss-Newton step: the motion by inverse composition on the picture M + Σ w E as it is
//! at the time, whose slopes are those of the mean and the components blended, so that what moves is what is drawn. Coarse to fine, from
//! several starts: the motions before, the moments of the matte against those of each pose, a grid of shifts where nothing fits. The
//! components that hardly anything speaks for are held by their variance over the examples.
//!
//! With a matte for the frame both sides are keyed as in [`super`]: the outline counts, and the ground does not.
//!
//! **Source**: Bregler, Loeb, Chuang, Deshpande, "Turning to the Masters: Motion Capturing Cartoons", SIGGRAPH 2002, section 3.3, equations
//! (14) and (15), where the minus of (14) is lost in (15). Black and Jepson, "EigenTracking", IJCV 26(1), 1998. Baker, Gross, Matthews,
//! "Lucas-Kanade 20 Years On: Part 3", CMU-RI-TR-03-35, 2003, section 3 (simultaneous inverse composition).
//!
//! **Fails when** the space does not hold the pose (`Status::Unlike`), or as [`super`] does. **Cost**: O(pixels · components) an iteration and
//! O(pixels · components²) twice a level; only pixels where the pictures have slopes or change are looked at.

mod redraw;
mod run;
mod space;
#[cfg(test)]
mod tests;

use super::level::Level;
use super::options::{check_options, check_picture};
use super::planes::{Planes, pyramid};
use super::region::{extent, with_rim};
use super::run::View;
use super::solve::is_sane;
use super::start::Moments;
use super::{Options, Status, Tone, TrackError};
use crate::algo::raster::{Affine, Raster, apply, identity};
use crate::algo::window::Window;
use nalgebra::{Matrix2, Vector2};
pub(crate) use redraw::placed;
pub use redraw::{Drawn, DrawnPose};
use redraw::{Redraw, every_pose, weights_of};
use space::{Layers, Space};

/// A linear space of pictures of a region.
#[derive(Clone, Copy, Debug)]
pub struct Pictures<'a> {
    /// The mean: samples in `window`, rows from the top, channels interleaved; premultiplied where there is an alpha, then toned but for
    /// alpha.
    pub mean: &'a [f64],
    /// Orthonormal components, one after the other.
    pub components: &'a [f64],
    /// Variance of the examples along each.
    pub variances: &'a [f64],
    /// Coordinates of the examples along each, where they are known: poses to start from.
    pub examples: &'a [Vec<f64>],
    /// Where the samples lie in the plane.
    pub window: Window,
    /// Samples a pixel.
    pub channels: usize,
    /// Which of them is alpha.
    pub alpha: Option<usize>,
    /// Tone of the samples.
    pub tone: Tone,
}

/// How to track, beyond [`Options`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EigenOptions {
    /// How much the variance of the examples holds the coefficients: 0 not at all, 1 as their probability says.
    pub prior: f64,
    /// Most pixels of a level that are looked at: those that say the most, 1024 or more.
    pub pixels: usize,
    /// Most poses that are tried where a frame starts, 1 to 64.
    pub poses: usize,
    /// The level where the work ends, 0 to 9: 0 at full size, 1 at half, and so on; the coarsest where there are fewer.
    pub finest: usize,
}

impl Default for EigenOptions {
    fn default() -> Self {
        Self { prior: 1.0, pixels: 8192, poses: 8, finest: 0 }
    }
}

/// What was found in the frames before.
#[derive(Clone, Debug, PartialEq)]
pub struct EigenStart {
    /// Motion of the frame before: frame from pictures.
    pub last: Affine,
    /// Motion of the frame before that, where there is one.
    pub before: Option<Affine>,
    /// Coefficients of the frame before; none at the first frame.
    pub coefficients: Vec<f64>,
}

impl Default for EigenStart {
    fn default() -> Self {
        Self { last: identity(), before: None, coefficients: Vec::new() }
    }
}

/// Where the region is in a frame, and in which pose.
#[derive(Clone, Debug, PartialEq)]
pub struct EigenTrack {
    /// Frame from pictures, pixels, centres at half integers.
    pub motion: Affine,
    /// How much of each component.
    pub coefficients: Vec<f64>,
    /// How it ended.
    pub status: Status,
    /// Iterations over all levels, of the chosen start.
    pub iterations: usize,
    /// Robust standard deviation of the residual where there are slopes, in toned sample values.
    pub residual: f64,
    /// Root mean square residual over the mean's own standard deviation.
    pub dissimilarity: f64,
    /// Largest over least eigenvalue of the Hessian of the motion once the coefficients have taken their share.
    pub condition: f64,
    /// Share of the region inside the frame.
    pub overlap: f64,
    /// By how much the next best start fitted worse at the coarsest level, 0 to 1; 1 where there was no other.
    pub margin: f64,
}

impl EigenTrack {
    /// True where the motion and the coefficients are at the minimum and the frame fits.
    pub fn is_converged(&self) -> bool {
        self.status == Status::Converged
    }
}

/// Why a space of pictures cannot be tracked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EigenError {
    /// As with one picture.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// Mean and components of other lengths than the window says.
    #[error("expected {expected} samples in the mean and each of {components} components, found {found} in all")]
    Samples {
        /// Samples of the window.
        expected: usize,
        /// Components.
        components: usize,
        /// Samples found in mean and components together.
        found: usize,
    },
    /// NaN or infinity.
    #[error("expected finite samples and variances of at least 0 in the space of pictures, found others")]
    NotFinite,
    /// Pictures without colours.
    #[error("expected pictures with at least one channel beside alpha, found none")]
    NoColours,
    /// A frame with fewer channels than the pictures have colours.
    #[error("expected a frame of at least {expected} channels, as the pictures have colours, found {found}")]
    Colours {
        /// Colours of the pictures.
        expected: usize,
        /// Channels of the frame.
        found: usize,
    },
    /// A matte for pictures without alpha.
    #[error(
        "expected pictures with alpha where the footage has a matte, found none: make the space of keyed pictures, or leave the matte out"
    )]
    NoAlpha,
    /// Drawings that the pictures are not of.
    #[error("expected pictures of red, green, blue and alpha, and at least one key, where the keys are drawn anew, found others")]
    NotDrawn,
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
}

/// A space of pictures ready to be found in frames: made once, used for each.
#[derive(Clone, Debug)]
pub struct EigenTemplate {
    options: Options,
    how: EigenOptions,
    colours: usize,
    used: Vec<usize>,
    plain: Vec<Space>,
    keyed: Vec<Space>,
    behind: Vec<f32>,
    amplitude: f32,
    /// Moments of the alpha of the mean and of each component: 1, x, y, xx, xy, yy.
    moments: Vec<[f64; 6]>,
    variances: Vec<f64>,
    /// Poses that a frame may start from.
    poses: Vec<Vec<f64>>,
    bounds: [f64; 4],
    centre: [f64; 2],
    scale: f64,
}

/// Least size of the region at the coarsest level, in samples: poses are to be told apart.
const COARSEST: f64 = 16.0;
/// Alpha under which a pixel is outside.
const OUTSIDE: f32 = 0.02;

impl EigenTemplate {
    /// The template of a space of pictures; `options.tone` and `options.key` are not looked at. O(samples · components).
    ///
    /// # Errors
    /// Options out of range, samples that do not fill the window or are not finite, an empty or flat region.
    pub fn new(pictures: &Pictures, options: &Options, how: &EigenOptions) -> Result<Self, EigenError> {
        check(pictures, options, how)?;
        let support = Support::new(pictures);
        let weight = |x: usize, y: usize| support.weight(x, y);
        let found = extent(weight, pictures.window.width, pictures.window.height).ok_or(TrackError::Empty)?;
        let shift = [pictures.window.x as f64, pictures.window.y as f64];
        let [x0, y0, x1, y1] = found.bounds;
        let mut template = Self {
            options: Options { tone: pictures.tone, ..options.clone() },
            how: *how,
            colours: pictures.channels - usize::from(pictures.alpha.is_some()),
            used: (0..pictures.channels).filter(|c| Some(*c) != pictures.alpha).collect(),
            plain: Vec::new(),
            keyed: Vec::new(),
            behind: vec![0.0; pictures.channels],
            amplitude: 1.0,
            moments: moments(pictures),
            variances: pictures.variances.to_vec(),
            poses: poses(pictures.examples, pictures.variances, how.poses),
            bounds: [x0 + shift[0], y0 + shift[1], x1 + shift[0], y1 + shift[1]],
            centre: [found.centre[0] + shift[0], found.centre[1] + shift[1]],
            scale: found.radius,
        };
        template.set_key(pictures);
        template.build(pictures, &support);
        let flat = |set: &[Space]| set.iter().all(|s| s.mean.contrast <= 1e-6);
        if flat(&template.plain) && flat(&template.keyed) { Err(TrackError::Textureless.into()) } else { Ok(template) }
    }

    /// The mean colour goes behind, and the alpha counts as much as the colours do.
    fn set_key(&mut self, pictures: &Pictures) {
        let Some(alpha) = pictures.alpha else { return };
        let pixels = || pictures.mean.chunks_exact(pictures.channels).filter(|p| p[alpha] > 1e-3);
        let total: f64 = pixels().map(|p| p[alpha]).sum();
        let (mut variance, mut size) = (0.0, 0.0f64);
        for &c in &self.used {
            let mean = pixels().map(|p| p[c]).sum::<f64>() / total.max(1e-12);
            let square = pixels().map(|p| p[c] * p[c] / p[alpha]).sum::<f64>() / total.max(1e-12);
            self.behind[c] = mean as f32;
            size = size.max(mean.abs());
            variance += (square - mean * mean).max(0.0);
        }
        let amplitude = libm::sqrt(variance).max(0.25 * size);
        self.amplitude = if amplitude > 0.0 { amplitude as f32 } else { 1.0 };
    }

    fn build(&mut self, pictures: &Pictures, support: &Support) {
        let size = (self.bounds[2] - self.bounds[0]).min(self.bounds[3] - self.bounds[1]);
        let mut levels = self.options.levels;
        while levels > 1 && size / f64::from(1u32 << (levels - 1)) < COARSEST {
            levels -= 1;
        }
        let canvas = Canvas::new(pictures, levels, self.options.sigma);
        let all = |channels: &[Layer]| -> Vec<Vec<Planes>> {
            (0..=pictures.variances.len()).map(|i| pyramid(canvas.planes(pictures, i, channels, &self.behind), levels)).collect()
        };
        let masks = pyramid(canvas.mask(pictures, support), levels);
        let colours: Vec<Layer> = self.used.iter().map(|&c| Layer::Colour(c)).collect();
        let cover = if pictures.alpha.is_some() { all(&[Layer::Alpha(1.0)]) } else { Vec::new() };
        self.plain = self.spaces(&all(&colours), &cover, &masks, |m| m.data[0].clone());
        if pictures.alpha.is_some() {
            let keyed: Vec<Layer> = colours.into_iter().chain([Layer::Alpha(f64::from(self.amplitude))]).collect();
            self.keyed = self.spaces(&all(&keyed), &[], &masks, with_rim);
        }
    }

    /// The levels that have enough pixels, finest first; at least the finest.
    fn spaces(
        &self,
        pictures: &[Vec<Planes>],
        cover: &[Vec<Planes>],
        masks: &[Planes],
        weight: impl Fn(&Planes) -> Vec<f32>,
    ) -> Vec<Space> {
        let mut out: Vec<Space> = Vec::new();
        for (l, mask) in masks.iter().enumerate() {
            let at = |all: &[Vec<Planes>]| all.iter().map(|p| p[l].clone()).collect::<Vec<_>>();
            let (pictures, cover, weight) = (at(pictures), at(cover), weight(mask));
            let layers = Layers { pictures: &pictures, cover: &cover, weight: &weight, variances: &self.variances, most: self.how.pixels };
            let Some(space) = Space::new(&layers, self.options.sigma, self.centre, self.scale) else { break };
            if !out.is_empty() && space.mean.total() < 60.0 {
                break;
            }
            out.push(space);
        }
        out
    }

    /// The bounding box of the pictures: left, top, right, bottom, in pixels.
    pub fn bounds(&self) -> [f64; 4] {
        self.bounds
    }

    /// Number of components.
    pub fn n_components(&self) -> usize {
        self.variances.len()
    }

    /// Finds the region in `frame`. `matte` is the frame's matte, where it has one; `start` what was found before. O(region · components).
    ///
    /// # Errors
    /// A frame or matte of the wrong size or with too few channels, a matte where the pictures have no alpha. All else is told by the
    /// status.
    pub fn track(&self, frame: Raster, matte: Option<&[f32]>, start: &EigenStart) -> Result<EigenTrack, EigenError> {
        self.check_frame(&frame, matte)?;
        Ok(self.find(frame, matte, start, self.how.finest))
    }

    /// Finds the region in `frame` as [`Self::track`] does, but for the finest levels, where `drawn` is drawn anew in each pose. `last` is
    /// what was drawn in the frame before, and `contour` the points of the keys in a pose of the space, where they are known. Drawings that
    /// cannot be held against the frame leave what was found without them.
    ///
    /// # Errors
    /// As [`Self::track`]; pictures of other colours than red, green and blue with alpha, or no keys.
    pub fn track_drawn(
        &self,
        frame: Raster,
        matte: Option<&[f32]>,
        start: &EigenStart,
        drawn: &dyn Drawn,
        last: Option<&DrawnPose>,
        contour: impl Fn(&[f64]) -> Option<Vec<[f64; 2]>>,
    ) -> Result<(EigenTrack, Option<DrawnPose>), EigenError> {
        self.check_frame(&frame, matte)?;
        if self.keyed.is_empty() || self.used != [0, 1, 2] || drawn.n_keys() == 0 {
            return Err(EigenError::NotDrawn);
        }
        // Pictures say where to begin: the coarsest level is enough.
        let found = self.find(frame, matte, start, usize::MAX);
        let weights = contour(&found.coefficients).and_then(|points| weights_of(drawn, &points));
        let mut starts: Vec<DrawnPose> = weights.into_iter().map(|weights| DrawnPose { motion: found.motion, weights }).collect();
        if let Some(last) = last.filter(|l| l.weights.len() == drawn.n_keys() && is_sane(&l.motion)) {
            starts.push(last.clone());
            starts.push(DrawnPose { motion: found.motion, weights: last.weights.clone() });
        }
        if starts.is_empty() {
            starts = every_pose(drawn, &found.motion, matte, frame.width);
        }
        let (spaces, levels) = (&self.keyed, self.keyed.len());
        let redraw = Redraw {
            drawn,
            cut: self.cut(levels),
            options: &self.options,
            view: View { frame, matte },
            pivot: self.centre,
            centre: apply(&found.motion, self.centre.into()).into(),
            scale: self.scale,
            contrast: spaces[0].contrast(),
            pixels: self.how.pixels,
        };
        let drawn = redraw.find(&starts, || every_pose(drawn, &found.motion, matte, frame.width), &found);
        Ok(drawn.map_or((found, None), |(track, pose)| (track, Some(pose))))
    }

    fn check_frame(&self, frame: &Raster, matte: Option<&[f32]>) -> Result<(), EigenError> {
        check_picture(frame, matte)?;
        if frame.channels < self.colours {
            return Err(EigenError::Colours { expected: self.colours, found: frame.channels });
        }
        if matte.is_some() && self.keyed.is_empty() {
            return Err(EigenError::NoAlpha);
        }
        Ok(())
    }

    /// The moments of the alpha in a pose; `None` where there is no alpha.
    fn moments_of(&self, coefficients: &[f64]) -> Option<Moments> {
        let (first, rest) = self.moments.split_first()?;
        let mut m = *first;
        for (r, c) in rest.iter().zip(coefficients) {
            (0..6).for_each(|k| m[k] += c * r[k]);
        }
        let [mass, x, y, xx, xy, yy] = m;
        let centre = Vector2::new(x, y) / mass;
        let spread = Matrix2::new(xx, xy, xy, yy) / mass - centre * centre.transpose() + Matrix2::identity() * 0.5;
        (mass >= 1.0 && spread.determinant() > 0.0 && spread[(0, 0)] > 0.0).then_some(Moments { mass, centre, spread })
    }

    /// A level for each space, to be made the picture of a pose.
    fn blank(spaces: &[Space]) -> Vec<Level> {
        spaces.iter().map(|s| s.mean.clone()).collect()
    }
}

fn check(p: &Pictures, options: &Options, how: &EigenOptions) -> Result<(), EigenError> {
    check_options(options)?;
    let ranges = [
        ("prior", how.prior, 0.0, 1e6),
        ("pixels", how.pixels as f64, 1024.0, 1e9),
        ("poses", how.poses as f64, 1.0, 64.0),
        ("finest", how.finest as f64, 0.0, 9.0),
    ];
    if let Some((name, found, low, high)) = ranges.into_iter().find(|(_, v, low, high)| !(low..=high).contains(&v)) {
        return Err(EigenError::Option { name, low, high, found });
    }
    let (width, height, channels, l) = (p.window.width, p.window.height, p.channels, p.variances.len());
    let samples = p.window.samples(channels).filter(|_| (2..1 << 23).contains(&width) && (2..1 << 23).contains(&height));
    let Some(expected) = samples.filter(|_| width.saturating_mul(height) <= 1 << 30) else {
        return Err(TrackError::Size { width, height, channels }.into());
    };
    if p.mean.len() != expected || Some(p.components.len()) != expected.checked_mul(l) {
        return Err(EigenError::Samples { expected, components: l, found: p.mean.len() + p.components.len() });
    }
    if channels == usize::from(p.alpha.is_some()) || p.alpha.is_some_and(|a| a >= channels) {
        return Err(EigenError::NoColours);
    }
    let fine = |v: &f64| v.abs() <= 1e30;
    if !p.mean.iter().chain(p.components).all(fine) || !p.variances.iter().all(|v| (0.0..=1e30).contains(v)) {
        return Err(EigenError::NotFinite);
    }
    Ok(())
}

/// Which pixels any pose covers.
struct Support {
    width: usize,
    height: usize,
    covered: Vec<bool>,
}

impl Support {
    fn new(p: &Pictures) -> Self {
        let (width, height) = (p.window.width, p.window.height);
        let Some(alpha) = p.alpha else { return Self { width, height, covered: vec![true; width * height] } };
        let covers = |of: &[f64], gain: f64| -> Vec<bool> {
            of.iter().skip(alpha).step_by(p.channels).map(|v| libm::fabs(v * gain) > f64::from(OUTSIDE)).collect()
        };
        let mut covered = covers(p.mean, 1.0);
        for (part, variance) in p.components.chunks_exact(p.mean.len()).zip(p.variances) {
            let more = covers(part, 2.0 * libm::sqrt(*variance));
            covered.iter_mut().zip(more).for_each(|(c, m)| *c |= m);
        }
        Self { width, height, covered }
    }

    fn weight(&self, x: usize, y: usize) -> f32 {
        let inside = x < self.width && y < self.height && self.covered[y * self.width + x];
        f32::from(u8::from(inside))
    }
}

/// One plane of what is compared.
#[derive(Clone, Copy)]
enum Layer {
    /// A channel, with the mean colour behind.
    Colour(usize),
    /// Alpha times a gain.
    Alpha(f64),
}

/// The pictures with room around them.
struct Canvas {
    margin: usize,
    width: usize,
    height: usize,
}

impl Canvas {
    fn new(p: &Pictures, levels: usize, sigma: f64) -> Self {
        let block = 1usize << (levels - 1);
        let margin = libm::ceil(6.0 + 4.0 * sigma) as usize * block;
        let up = |n: usize| (n + 2 * margin).div_ceil(block) * block;
        Self { margin, width: up(p.window.width), height: up(p.window.height) }
    }

    fn plane(&self, p: &Pictures, value: impl Fn(usize) -> f64, outside: Option<f64>) -> Vec<f32> {
        let clamped = |i: usize, n: usize| (i.max(self.margin) - self.margin).min(n - 1);
        let mut out = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let (cx, cy) = (clamped(x, p.window.width), clamped(y, p.window.height));
                let inside = (cx + self.margin, cy + self.margin) == (x, y);
                out.push(match outside.filter(|_| !inside) {
                    Some(v) => v as f32,
                    None => value(cy * p.window.width + cx) as f32,
                });
            }
        }
        out
    }

    /// Planes of the mean (0) or a component. Without alpha the edge is repeated; else there is nothing outside.
    fn planes(&self, p: &Pictures, picture: usize, layers: &[Layer], behind: &[f32]) -> Planes {
        let d = p.mean.len();
        let of = if picture == 0 { p.mean } else { &p.components[(picture - 1) * d..picture * d] };
        let base = if picture == 0 { 1.0 } else { 0.0 };
        let data = layers.iter().map(|layer| match (*layer, p.alpha) {
            (Layer::Alpha(gain), alpha) => self.plane(p, |i| alpha.map_or(base, |a| of[i * p.channels + a]) * gain, alpha.map(|_| 0.0)),
            (Layer::Colour(c), None) => self.plane(p, |i| of[i * p.channels + c], None),
            (Layer::Colour(c), Some(a)) => {
                let back = f64::from(behind[c]);
                self.plane(p, |i| of[i * p.channels + c] + (base - of[i * p.channels + a]) * back, Some(base * back))
            }
        });
        self.with(p, data.collect())
    }

    fn mask(&self, p: &Pictures, support: &Support) -> Planes {
        let value = |i: usize| if support.covered[i] { 1.0 } else { 0.0 };
        self.with(p, vec![self.plane(p, value, Some(0.0))])
    }

    fn with(&self, p: &Pictures, data: Vec<Vec<f32>>) -> Planes {
        let origin = [p.window.x as f64 - self.margin as f64, p.window.y as f64 - self.margin as f64];
        Planes { width: self.width, height: self.height, origin, step: 1.0, data }
    }
}

/// Raw moments of the alpha of each picture; none without alpha.
fn moments(p: &Pictures) -> Vec<[f64; 6]> {
    let Some(alpha) = p.alpha else { return Vec::new() };
    let of = |picture: &[f64]| {
        let mut m = [0.0; 6];
        for (i, px) in picture.chunks_exact(p.channels).enumerate() {
            let x = p.window.x as f64 + (i % p.window.width) as f64 + 0.5;
            let y = p.window.y as f64 + (i / p.window.width) as f64 + 0.5;
            for (to, v) in m.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                *to += px[alpha] * v;
            }
        }
        m
    };
    [p.mean].into_iter().chain(p.components.chunks_exact(p.mean.len())).map(of).collect()
}

/// The mean pose, then the examples that are farthest from all before them; without examples the ends of the widest components.
fn poses(examples: &[Vec<f64>], variances: &[f64], most: usize) -> Vec<Vec<f64>> {
    let n = variances.len();
    let mut all = vec![vec![0.0; n]];
    let ends: Vec<Vec<f64>> = if examples.iter().any(|e| e.len() == n) {
        examples.iter().filter(|e| e.len() == n && e.iter().all(|v| v.is_finite())).cloned().collect()
    } else {
        let end = |l: usize, s: f64| (0..n).map(|i| if i == l { s * libm::sqrt(variances[l]) } else { 0.0 }).collect();
        (0..n).flat_map(|l| [end(l, 1.4), end(l, -1.4)]).take(most).collect()
    };
    let gap = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    while all.len() < most {
        let nearest = |e: &Vec<f64>| all.iter().map(|p| gap(p, e)).fold(f64::INFINITY, f64::min);
        match ends.iter().map(|e| (nearest(e), e)).max_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((far, e)) if far > 0.0 => all.push(e.clone()),
            _ => break,
        }
    }
    all
}
