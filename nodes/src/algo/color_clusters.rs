//! A soft matte from clusters of colour: the layer and the ground are a Gaussian mixture each, and alpha is the probability of the layer.
//!
//! **Method** [`fit`] learns the mixtures from one frame and a seed (colours of the layer, or a rough matte). [`alpha`] evaluates the posterior at every pixel, gives ink to the
//! layer that it outlines, makes neighbours agree, tidies regions, and solves the pixels of the edge for their coverage. [`adapt`] re-estimates the mixtures from a frame and its matte.
//!
//! **Source** C. Bregler, L. Loeb, E. Chuang, H. Deshpande, *Turning to the masters: motion capturing cartoons*, 2002, section 3.2 (the adaptive alpha matte from probabilistic
//! colour segmentation). The parts name their own sources.
//!
//! **Fails when** layer and ground share a colour over regions wider than a few pixels: colour alone cannot tell them apart. [`Model::separation`] says so beforehand.
//!
//! **Cost** `alpha` is O(pixels × components); `fit` is O(samples × components × steps), whatever the size of the picture beyond one pass.

mod coverage;
mod edge;
mod field;
mod fit;
mod gaussian;
mod kernel;
mod regions;
#[cfg(test)]
mod tests;

pub use coverage::alpha;
pub use gaussian::Gaussian;

use super::color;
use super::raster::Raster;
use fit::{Weighted, distance_sq};
use thiserror::Error;

/// The volume of colours, in cubic units, over which a colour that no cluster explains is spread.
const COLOR_VOLUME: f64 = 1e6;
/// How much more likely an unknown colour is ground than layer.
const UNKNOWN_IS_GROUND: f64 = 10.0;
/// Colours this near to a seed colour (units of the space) may be the layer; the ones beyond are ground.
const SEED_REACH: f64 = 12.0;
/// The same for the colour of ink, which varies more.
const INK_REACH: f64 = 16.0;
/// The spread of a cluster before any pixel was seen.
const SEED_SIGMA: f64 = 4.0;
/// Fewer samples than this describe no side.
const MIN_SAMPLES: usize = 4;
/// Rounds in which the uncertain pixels of the first frame choose a side and the sides learn from them.
const ROUNDS: usize = 4;
/// Most clusters a side.
const MAX_CLUSTERS: usize = 32;

/// The space in which colours cluster. Distances are in units of about one just noticeable difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Space {
    /// CIE L\*a\*b\*, D65: the usual choice.
    #[default]
    Lab,
    /// Oklab times 100: hue stays put as colours darken.
    Oklab,
    /// sRGB-encoded RGB times 100: where the grain was added to encoded values.
    Display,
    /// Linear RGB times 100: for renders.
    Linear,
}

/// How the pixels of an edge were mixed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Mix {
    /// In linear light: film, footage, compositing in linear light.
    #[default]
    Linear,
    /// In sRGB values: most painting programs, and animation that was composited in eight bits.
    Display,
}

/// What [`fit`], [`alpha`] and [`adapt`] go by.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Clusters a side, 1 to 32. Too few make one cluster span two colours; too many cost time. A list of seed colours sets those of the layer itself, one a colour.
    pub clusters: usize,
    /// The space that colours cluster in.
    pub space: Space,
    /// Width in pixels of the ink that outlines the layer, 0 for no ink. Pixels of the ink's colour belong to the layer up to this far from it, and to the ground beyond.
    pub ink: f64,
    /// Colour of the ink, sRGB values 0 to 1.
    pub ink_color: [f64; 3],
    /// Share of colours that no cluster explains, 0 to 0.5; they count as ground. 0 makes the nearest cluster answer for any colour.
    pub outlier: f64,
    /// Smallest spread of a cluster, in units of the space: how far from a flat colour its pixels may be.
    pub min_sigma: f64,
    /// How much neighbours of like colour agree, as the log odds that one of them is worth: 0 for none, 1 usual, 3 for coarse grain.
    pub smoothness: f64,
    /// Parts of the layer smaller than this many pixels are removed; 0 keeps all.
    pub min_area: f64,
    /// Holes up to this many pixels are filled; 0 fills none, infinity all that do not touch the border of the picture.
    pub fill_holes: f64,
    /// Holes count as closed where gaps of at most this many pixels in their walls let the ground in, 0 to 64.
    pub close_gaps: f64,
    /// Keep the largest part of the layer only.
    pub largest_component: bool,
    /// Probabilities up to `clip.0` become 0, those from `clip.1` on become 1, the rest is stretched; (0, 1) keeps them all. The solved edge is not clipped.
    pub clip: (f64, f64),
    /// Half the width of the mixed edge, in pixels: 0 leaves the posterior as it is, 1 suits drawings, 2 or 3 soft footage. At most 16.
    pub edge: f64,
    /// How the pixels of the edge were mixed.
    pub mix: Mix,
    /// Most pixels that a side learns from.
    pub max_samples: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            clusters: 5,
            space: Space::Lab,
            ink: 4.0,
            ink_color: [0.06, 0.05, 0.05],
            outlier: 0.01,
            min_sigma: 1.0,
            smoothness: 1.0,
            min_area: 16.0,
            fill_holes: 64.0,
            close_gaps: 0.0,
            largest_component: false,
            clip: (0.1, 0.9),
            edge: 1.0,
            mix: Mix::Linear,
            max_samples: 16_384,
        }
    }
}

/// Where the first frame shows the layer.
#[derive(Clone, Copy, Debug)]
pub enum Seed<'a> {
    /// Colours of the layer, sRGB values 0 to 1, one a flat colour.
    Colours(&'a [[f64; 3]]),
    /// A rough matte, one sample a pixel: 0.9 and above is layer, 0.1 and below ground, anything between unknown. Without any layer the unknown is taken for it at first, so that a
    /// box around the layer will do.
    Hint(&'a [f32]),
}

/// Two mixtures and the ink between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Clusters of the layer.
    pub foreground: Vec<Gaussian>,
    /// Clusters of the ground.
    pub background: Vec<Gaussian>,
    /// Clusters of ink, which belongs to whichever side it lies at; empty without ink.
    pub ink: Vec<Gaussian>,
    /// Share of the layer among all pixels, without its ink.
    pub prior: f64,
    /// Share of ink among all pixels.
    pub ink_prior: f64,
    /// Share of colours that no cluster explains.
    pub outlier: f64,
    /// The space that the clusters are in; the options of later calls do not change it.
    pub space: Space,
}

/// What a matte says about itself, for warnings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// Sum of alpha over the number of pixels, 0 to 1. 0 or 1 says that one side is not in the picture.
    pub area: f64,
    /// Mean log likelihood of a pixel under both mixtures, in nats: a fall from one frame to the next says that new colours came into the picture.
    pub log_likelihood: f64,
    /// Mean of the smaller of the two posteriors before any clean-up: the share of pixels that the colours alone get wrong if the model is right.
    pub ambiguity: f64,
}

/// Why there is no matte.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MatteError {
    /// The picture has no samples.
    #[error("expected a picture with pixels, found {width} by {height} with {channels} channels")]
    Empty {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Samples a pixel.
        channels: usize,
    },
    /// More pixels than can be numbered.
    #[error("expected at most {} pixels, found {found}; scale the picture down", u32::MAX)]
    TooLarge {
        /// Pixels of the picture.
        found: usize,
    },
    /// A matte of another size than the picture.
    #[error("expected a matte of {expected} samples, found {found}; it must have the size of the picture")]
    Size {
        /// Pixels of the picture.
        expected: usize,
        /// Samples of the matte.
        found: usize,
    },
    /// An option outside its range.
    #[error("expected {name} {range}, found {found}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// What it may be.
        range: &'static str,
        /// What it is.
        found: f64,
    },
    /// A seed colour that is none.
    #[error("expected foreground colours of three sRGB values from 0 to 1, found ({}, {}, {})", found[0], found[1], found[2])]
    Colour {
        /// The colour.
        found: [f64; 3],
    },
    /// A seed without the layer.
    #[error("expected pixels of the layer in the first frame, found {found}; {hint}")]
    NoForeground {
        /// How many there are.
        found: usize,
        /// What to do.
        hint: &'static str,
    },
    /// A seed without the ground.
    #[error("expected pixels of the ground in the first frame, found {found}; {hint}")]
    NoBackground {
        /// How many there are.
        found: usize,
        /// What to do.
        hint: &'static str,
    },
}

impl Model {
    /// Shares of layer, ground and ink.
    fn shares(&self) -> [f64; 3] {
        [self.prior, (1.0 - self.prior - self.ink_prior).max(0.0), self.ink_prior]
    }

    /// Densities of an unknown colour on each side; positive, so that every colour has a posterior.
    fn floors(&self) -> [f64; 3] {
        let density = self.outlier.max(1e-9) / COLOR_VOLUME;
        [density * self.prior / UNKNOWN_IS_GROUND, density * (1.0 - self.prior), 0.0]
    }

    /// The smallest Bhattacharyya distance between a cluster of the layer and one of the ground that hold at least a fiftieth of their side: below 1 colours alone will confuse
    /// the two, above 3 they hardly can.
    pub fn separation(&self) -> f64 {
        let held = |side: &'_ [Gaussian]| side.iter().filter(|g| g.weight >= 0.02).copied().collect::<Vec<_>>();
        let (layer, ground) = (held(&self.foreground), held(&self.background));
        let pairs = layer.iter().flat_map(|f| ground.iter().map(move |b| f.bhattacharyya(b)));
        pairs.flatten().fold(f64::INFINITY, f64::min)
    }
}

/// Refuses what no number of pixels could help.
fn validate(image: Raster<'_>, options: &Options) -> Result<(), MatteError> {
    let Raster { width, height, channels, .. } = image;
    if width == 0 || height == 0 || channels == 0 {
        return Err(MatteError::Empty { width, height, channels });
    }
    if width.saturating_mul(height) > u32::MAX as usize {
        return Err(MatteError::TooLarge { found: width.saturating_mul(height) });
    }
    let ranges = [
        ("clusters", options.clusters as f64, 1.0, MAX_CLUSTERS as f64, "from 1 to 32"),
        ("ink", options.ink, 0.0, 1e6, "of 0 pixels or more"),
        ("outlier", options.outlier, 0.0, 0.5, "from 0 to 0.5"),
        ("min_sigma", options.min_sigma, 1e-3, 100.0, "from 0.001 to 100"),
        ("smoothness", options.smoothness, 0.0, 100.0, "from 0 to 100"),
        ("min_area", options.min_area, 0.0, f64::INFINITY, "of 0 pixels or more"),
        ("close_gaps", options.close_gaps, 0.0, 64.0, "from 0 to 64 pixels"),
        ("fill_holes", options.fill_holes, 0.0, f64::INFINITY, "of 0 pixels or more"),
        ("clip", options.clip.0, 0.0, options.clip.1, "of two values in order, from 0 to 1"),
        ("clip", options.clip.1, 1e-3, 1.0, "of two values in order, from 0 to 1"),
        ("edge", options.edge, 0.0, 16.0, "from 0 to 16 pixels"),
        ("max_samples", options.max_samples as f64, 16.0, 1e7, "from 16 to 10000000"),
    ];
    let bad = ranges.into_iter().find(|(_, v, low, high, _)| !(v >= low && v <= high));
    bad.map_or(Ok(()), |(name, found, _, _, range)| Err(MatteError::Option { name, range, found }))
}

/// sRGB values to the coordinates of `space`.
fn seed_coordinates(space: Space, srgb: [f64; 3]) -> [f64; 3] {
    kernel::coordinates(space, srgb.map(|v| color::linear_from_srgb(v) as f32)).map(f64::from)
}

/// What the seed says of a pixel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Label {
    Ground,
    Layer,
    Unknown,
    /// Not to learn from.
    Mixed,
}

/// Pixels to learn from: their coordinates, what the seed says, and how many pixels each stands for.
struct Samples {
    points: Vec<[f64; 3]>,
    labels: Vec<Label>,
    counts: Vec<f64>,
}

impl Samples {
    /// Every so many pixels of each label, so that a small layer in a large picture is still well described.
    fn gather(planes: &kernel::Planes, label: impl Fn([f64; 3], usize) -> Label, max_samples: usize) -> Self {
        let at = |i: usize| [planes.x[i], planes.y[i], planes.z[i]].map(f64::from);
        let labels: Vec<Label> = (0..planes.x.len()).map(|i| label(at(i), i)).collect();
        let mut out = Self { points: Vec::new(), labels: Vec::new(), counts: Vec::new() };
        for kind in [Label::Ground, Label::Layer, Label::Unknown] {
            let total = labels.iter().filter(|l| **l == kind).count();
            let step = total.div_ceil(max_samples).max(1);
            let of_kind = (0..labels.len()).filter(|i| labels[*i] == kind);
            for i in of_kind.skip(step / 2).step_by(step) {
                out.points.push(at(i));
                out.labels.push(kind);
                out.counts.push(step as f64);
            }
        }
        out
    }

    fn count(&self, kind: Label) -> usize {
        self.labels.iter().filter(|l| **l == kind).count()
    }

    /// A weight for each sample: its count times what `share` says.
    fn weights(&self, share: impl Fn(usize) -> f64) -> Vec<f64> {
        self.counts.iter().enumerate().map(|(i, c)| c * share(i)).collect()
    }

    fn weighted<'a>(&'a self, weights: &'a [f64]) -> Weighted<'a> {
        Weighted { points: &self.points, weights }
    }
}

/// Learns a model from one frame. `image` is linear RGB (more channels are ignored, fewer than three are taken as grey), layers of it composited.
///
/// # Errors
/// An empty picture, a hint of another size, an option out of range, a colour that is none, or a seed without layer or ground.
pub fn fit(image: Raster<'_>, seed: Seed<'_>, options: &Options) -> Result<Model, MatteError> {
    validate(image, options)?;
    let planes = kernel::planes(image, options.space);
    match seed {
        Seed::Colours(colours) => fit_colours(&planes, image.width, colours, options),
        Seed::Hint(hint) => fit_hint(&planes, hint, options),
    }
}

fn fit_colours(planes: &kernel::Planes, width: usize, colours: &[[f64; 3]], options: &Options) -> Result<Model, MatteError> {
    if let Some(&found) = colours.iter().find(|c| c.iter().any(|v| !(0.0..=1.0).contains(v))) {
        return Err(MatteError::Colour { found });
    }
    let seeds: Vec<[f64; 3]> = colours.iter().map(|c| seed_coordinates(options.space, *c)).collect();
    let near = |p: [f64; 3]| seeds.iter().any(|s| distance_sq(p, *s) <= SEED_REACH * SEED_REACH);
    let ink_at = seed_coordinates(options.space, options.ink_color);
    let is_ink = |p: [f64; 3]| options.ink > 0.0 && distance_sq(p, ink_at) <= INK_REACH * INK_REACH;
    let rim = rim(planes, width, near, options);
    let label = |p: [f64; 3], i: usize| match () {
        () if near(p) => Label::Unknown,
        // What lies around the layer holds blends of its colours and its ink, which must not be learnt as ground.
        () if rim[i] => {
            if is_ink(p) {
                Label::Unknown
            } else {
                Label::Mixed
            }
        }
        () => Label::Ground,
    };
    let mut samples = Samples::gather(planes, label, options.max_samples);
    if samples.count(Label::Ground) < MIN_SAMPLES {
        samples = Samples::gather(planes, |p, _| if near(p) { Label::Unknown } else { Label::Ground }, options.max_samples);
    }
    let (layer, ground) = (samples.count(Label::Unknown), samples.count(Label::Ground));
    if layer < MIN_SAMPLES {
        return Err(MatteError::NoForeground { found: layer, hint: "pick `foreground` colours from the picture" });
    }
    if ground < MIN_SAMPLES {
        return Err(MatteError::NoBackground { found: ground, hint: "the `foreground` colours cover the whole picture" });
    }
    let weight = 1.0 / seeds.len() as f64;
    let mut model = start_model(options, seeds.iter().map(|s| Gaussian::round(weight, *s, SEED_SIGMA)).collect());
    let has_ink = samples.points.iter().filter(|p| is_ink(**p)).count() >= MIN_SAMPLES;
    if has_ink {
        model.ink = vec![Gaussian::round(1.0, ink_at, SEED_SIGMA)];
    }
    let ground_weights = samples.weights(|i| f64::from(samples.labels[i] == Label::Ground && !(has_ink && is_ink(samples.points[i]))));
    let first = fit::mixture(
        samples.weighted(&ground_weights),
        options.clusters,
        options.min_sigma * options.min_sigma,
        options.outlier / COLOR_VOLUME,
    );
    model.background = first;
    settle(&mut model, &samples, options, Anchors { layer: &seeds, ink: Some(ink_at) });
    Ok(model)
}

/// The pixels within the width of the ink, and two of blends, of those with a colour of the layer; single pixels of the grain count as none.
fn rim(planes: &kernel::Planes, width: usize, near: impl Fn([f64; 3]) -> bool, options: &Options) -> Vec<bool> {
    let at = |i: usize| [planes.x[i], planes.y[i], planes.z[i]].map(f64::from);
    let mut rim: Vec<bool> = (0..planes.x.len()).map(|i| near(at(i))).collect();
    regions::tidy(&mut rim, width, regions::Tidy { min_area: options.min_area, max_hole: 0.0, largest_only: false });
    regions::dilate(&mut rim, width, options.ink.min(64.0).ceil() as usize + 2);
    rim
}

fn fit_hint(planes: &kernel::Planes, hint: &[f32], options: &Options) -> Result<Model, MatteError> {
    if hint.len() != planes.x.len() {
        return Err(MatteError::Size { expected: planes.x.len(), found: hint.len() });
    }
    let label = |_, i: usize| match hint[i] {
        v if v >= 0.9 => Label::Layer,
        v if v <= 0.1 => Label::Ground,
        _ => Label::Unknown,
    };
    let samples = Samples::gather(planes, label, options.max_samples);
    let boxed = samples.count(Label::Layer) < MIN_SAMPLES;
    let layer_label = if boxed { Label::Unknown } else { Label::Layer };
    let (layer, ground) = (samples.count(layer_label), samples.count(Label::Ground));
    if layer < MIN_SAMPLES {
        return Err(MatteError::NoForeground { found: layer, hint: "paint the layer white in the hint" });
    }
    if ground < MIN_SAMPLES {
        return Err(MatteError::NoBackground { found: ground, hint: "paint the ground black in the hint" });
    }
    let (floor_sq, unexplained) = (options.min_sigma * options.min_sigma, options.outlier / COLOR_VOLUME);
    let of = |kind: Label| samples.weights(|i| f64::from(samples.labels[i] == kind));
    let mut model = start_model(options, fit::mixture(samples.weighted(&of(layer_label)), options.clusters, floor_sq, unexplained));
    model.background = fit::mixture(samples.weighted(&of(Label::Ground)), options.clusters, floor_sq, unexplained);
    split_ink(&mut model, options);
    settle(&mut model, &samples, options, Anchors { layer: &[], ink: None });
    Ok(model)
}

/// A model with its layer alone and even shares.
fn start_model(options: &Options, foreground: Vec<Gaussian>) -> Model {
    let ink_prior = if options.ink > 0.0 { 0.02 } else { 0.0 };
    let (background, ink) = (Vec::new(), Vec::new());
    Model { foreground, background, ink, prior: 0.3, ink_prior, outlier: options.outlier, space: options.space }
}

/// Moves the clusters that have the colour of ink to the ink, from either side, unless that would leave the layer with nothing or the layer has none.
fn split_ink(model: &mut Model, options: &Options) {
    let at = seed_coordinates(options.space, options.ink_color);
    let is_ink = |g: &Gaussian| options.ink > 0.0 && distance_sq(g.mean, at) <= INK_REACH * INK_REACH;
    let (ink, rest): (Vec<_>, Vec<_>) = model.foreground.iter().copied().partition(is_ink);
    if ink.is_empty() || rest.is_empty() {
        model.ink_prior = 0.0;
        return;
    }
    (model.ink, model.foreground) = (ink, rest);
    let (of_ground, ground): (Vec<_>, Vec<_>) = model.background.iter().copied().partition(is_ink);
    if !ground.is_empty() {
        model.background = ground;
        model.ink.extend(of_ground);
    }
    normalise(&mut model.ink);
    normalise(&mut model.foreground);
    normalise(&mut model.background);
}

/// Scales weights to a sum of 1; a side without any is left as it is.
fn normalise(side: &mut [Gaussian]) {
    let total: f64 = side.iter().map(|g| g.weight).sum();
    if total > 0.0 {
        side.iter_mut().for_each(|g| g.weight /= total);
    }
}

/// Colours that clusters may not drift away from.
struct Anchors<'a> {
    layer: &'a [[f64; 3]],
    ink: Option<[f64; 3]>,
}

/// Lets the uncertain samples choose a side, and the sides learn from them, a few times over.
fn settle(model: &mut Model, samples: &Samples, options: &Options, anchors: Anchors<'_>) {
    let (floor_sq, unexplained) = (options.min_sigma * options.min_sigma, options.outlier / COLOR_VOLUME);
    let near_ink = |p: [f64; 3]| anchors.ink.is_none_or(|a| distance_sq(p, a) <= INK_REACH * INK_REACH);
    for _ in 0..ROUNDS {
        let posteriors = posteriors(model, samples);
        let side = |s: usize| samples.weights(|i| posteriors[i][s]);
        let (layer, ground) = (side(0), side(1));
        let ink = samples.weights(|i| posteriors[i][2] * f64::from(near_ink(samples.points[i])));
        let totals = [samples.weighted(&layer).total(), samples.weighted(&ground).total(), samples.weighted(&ink).total()];
        let all: f64 = totals.iter().sum::<f64>().max(1e-300);
        model.prior = (totals[0] / all).clamp(0.05, 0.9);
        model.ink_prior = if model.ink.is_empty() { 0.0 } else { (totals[2] / all).clamp(1e-3, 0.05) };
        let learn = |weights: &[f64], side: &[Gaussian]| fit::refine(samples.weighted(weights), side.to_vec(), floor_sq, unexplained, 6);
        if anchors.layer.is_empty() {
            model.foreground = learn(&layer, &model.foreground);
        } else {
            model.foreground = anchored(samples, &layer, &model.foreground, anchors.layer, floor_sq);
        }
        model.background = learn(&ground, &model.background);
        if !model.ink.is_empty() {
            model.ink = learn(&ink, &model.ink);
        }
    }
}

/// One cluster a seed colour, learnt from the samples nearest to that seed, with a few samples' worth of belief in the seed itself.
fn anchored(samples: &Samples, weights: &[f64], old: &[Gaussian], seeds: &[[f64; 3]], floor_sq: f64) -> Vec<Gaussian> {
    let nearest = |p: [f64; 3]| {
        let distances = seeds.iter().map(|s| distance_sq(p, *s));
        distances.enumerate().fold((0, f64::INFINITY), |best, (i, d)| if d < best.1 { (i, d) } else { best })
    };
    let owner: Vec<(usize, f64)> = samples.points.iter().map(|p| nearest(*p)).collect();
    let mut out = Vec::with_capacity(old.len());
    for (k, g) in old.iter().enumerate() {
        let own: Vec<f64> =
            weights.iter().zip(&owner).map(|(w, (o, d))| if *o == k && *d <= SEED_REACH * SEED_REACH { *w } else { 0.0 }).collect();
        let single = fit::refine(samples.weighted(&own), vec![Gaussian { weight: 1.0, ..*g }], floor_sq, 0.0, 1);
        let n: f64 = own.iter().sum();
        let shape = single.first().filter(|s| s.weight > 0.0).copied().unwrap_or(*g);
        let believed = Gaussian::round(1.0, seeds[k], SEED_SIGMA);
        out.push(Gaussian { weight: n + 1.0, ..fit::blend(&believed, &shape, n / (n + 8.0)) });
    }
    normalise(&mut out);
    out
}

/// Posterior of layer, ground and ink for each sample, those that the seed is sure of held to it.
fn posteriors(model: &Model, samples: &Samples) -> Vec<[f64; 3]> {
    let white = |side: &[Gaussian]| side.iter().filter_map(|g| Some((libm::log(g.weight), g.whitening()?))).collect::<Vec<_>>();
    let sides = [white(&model.foreground), white(&model.background), white(&model.ink)];
    let (shares, floors) = (model.shares(), model.floors());
    let density =
        |s: usize, p: [f64; 3]| floors[s] + shares[s] * sides[s].iter().map(|(w, g)| libm::exp(w + g.log_density(p))).sum::<f64>();
    let one = |(p, label): (&[f64; 3], &Label)| {
        if *label == Label::Mixed {
            return [0.0; 3];
        }
        let layer = if *label == Label::Ground { 0.0 } else { density(0, *p) };
        let ground = if *label == Label::Layer { 0.0 } else { density(1, *p) };
        let ink = density(2, *p);
        let total = (layer + ground + ink).max(1e-300);
        [layer / total, ground / total, ink / total]
    };
    samples.points.iter().zip(&samples.labels).map(one).collect()
}

/// The model after one more frame and its matte. `rate` 0 keeps the model, 1 forgets all but where the clusters were; pixels between 0.05 and 0.95 teach nothing. O(samples × components).
///
/// A cluster whose colour is not in this frame keeps its shape, and loses its weight at `rate`, but never all of it: it may come back.
///
/// # Errors
/// An empty picture, a matte of another size, or an option out of range (`rate` included).
pub fn adapt(image: Raster<'_>, alpha: &[f32], model: &Model, rate: f64, options: &Options) -> Result<Model, MatteError> {
    validate(image, options)?;
    if !(0.0..=1.0).contains(&rate) {
        return Err(MatteError::Option { name: "adapt", range: "from 0 to 1", found: rate });
    }
    if alpha.len() != image.width * image.height {
        return Err(MatteError::Size { expected: image.width * image.height, found: alpha.len() });
    }
    if rate == 0.0 {
        return Ok(model.clone());
    }
    let planes = kernel::planes(image, model.space);
    let label = |_, i: usize| match alpha[i] {
        v if v >= 0.95 => Label::Layer,
        v if v <= 0.05 => Label::Ground,
        _ => Label::Unknown,
    };
    let samples = Samples::gather(&planes, label, options.max_samples);
    Ok(learn(model, &samples, rate, options))
}

/// The model moved towards what the certain samples show.
fn learn(model: &Model, samples: &Samples, rate: f64, options: &Options) -> Model {
    let posteriors = posteriors(model, samples);
    let side = |s: usize| samples.weights(|i| if samples.labels[i] == Label::Unknown { 0.0 } else { posteriors[i][s] });
    let (floor_sq, unexplained) = (options.min_sigma * options.min_sigma, options.outlier / COLOR_VOLUME);
    let weights = [side(0), side(1), side(2)];
    let totals = [0, 1, 2].map(|s| samples.weighted(&weights[s]).total());
    let renew = |s: usize, old: &[Gaussian]| {
        if totals[s] < MIN_SAMPLES as f64 {
            return old.to_vec();
        }
        let new = fit::refine(samples.weighted(&weights[s]), old.to_vec(), floor_sq, unexplained, 3);
        let mut side: Vec<Gaussian> = old.iter().zip(&new).map(|(o, n)| fit::blend(o, n, rate)).collect();
        side.iter_mut().for_each(|g| g.weight = g.weight.max(1e-3));
        normalise(&mut side);
        side
    };
    let all = totals.iter().sum::<f64>().max(1e-300);
    let share = |old: f64, s: usize, low: f64, high: f64| ((1.0 - rate) * old + rate * (totals[s] / all)).clamp(low, high);
    Model {
        foreground: renew(0, &model.foreground),
        background: renew(1, &model.background),
        ink: renew(2, &model.ink),
        prior: share(model.prior, 0, 0.05, 0.9),
        ink_prior: if model.ink.is_empty() { 0.0 } else { share(model.ink_prior, 2, 1e-3, 0.05) },
        ..*model
    }
}
