//! What the tracker can be told, and what is wrong with it.

use crate::algo::raster::Raster;

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
    GemanMcclure,
}

/// What the differences are taken of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, pegbar_engine::Setting)]
#[serde(rename_all = "snake_case")]
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
    /// Use mattes as keys (background replaced, outline counted) where the frame has one too. Else the reference's matte weighs the
    /// pixels, and the frame's only gives its moments.
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

pub(super) fn check_options(o: &Options) -> Result<(), TrackError> {
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

pub(super) fn check_picture(p: &Raster, matte: Option<&[f32]>) -> Result<(), TrackError> {
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
