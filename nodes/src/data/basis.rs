//! Linear spaces of values.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;
use serde::{Deserialize, Serialize};

use crate::algo::track_affine::Tone;
use crate::algo::window::Window;

/// What the values of a space are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BasisKind {
    /// Numbers of any meaning.
    #[default]
    Values,
    /// x and y of each point in turn, pixels.
    Shapes,
    /// Samples of pictures.
    Images,
}

/// A linear space around a mean: what principal component analysis finds.
///
/// Of pictures the values are the samples in `window`, rows from the top, channels interleaved: premultiplied, toned as `tone` says but for alpha.
#[derive(Clone, Debug, PartialEq, Value)]
#[value(check = "validate")]
pub struct Basis {
    /// The mean; of shapes x and y of each point in turn, pixels.
    #[value(shape = "[d]")]
    pub mean: Vec<f64>,
    /// Orthonormal directions, the widest first.
    #[value(shape = "[l, d]")]
    pub components: NdArray<f64, 2>,
    /// Variance of the examples along each direction.
    #[value(shape = "[l]")]
    pub variances: Vec<f64>,
    /// What the values are: values, shapes or images. Default: values.
    #[value(text)]
    pub kind: BasisKind,
    /// Coordinates of each example along each direction; none where they were not kept.
    #[value(text)]
    pub coordinates: Vec<Vec<f64>>,
    /// Of pictures: the rectangle that the samples fill, `[x0, y0, x1, y1]`, ends exclusive.
    #[value(text)]
    pub window: Option<Window>,
    /// Of pictures: the rectangle that is shown.
    #[value(text)]
    pub display_window: Option<Window>,
    /// Of pictures: name of each channel.
    #[value(text)]
    pub channels: Vec<String>,
    /// Of pictures: how samples were encoded, alpha excepted: linear or encoded. Default: encoded.
    #[value(text)]
    pub tone: Tone,
}

impl Basis {
    /// A space of numbers.
    pub fn new(mean: Vec<f64>, components: NdArray<f64, 2>, variances: Vec<f64>) -> Self {
        Self {
            mean,
            components,
            variances,
            kind: BasisKind::default(),
            coordinates: Vec::new(),
            window: None,
            display_window: None,
            channels: Vec::new(),
            tone: Tone::default(),
        }
    }

    /// The largest coordinate of an example along each direction; the standard deviation where coordinates were not kept.
    ///
    /// Weights of spaces are in this unit: 1 is as far as the farthest example goes.
    pub fn reach(&self) -> Vec<f64> {
        let largest = |l: usize| self.coordinates.iter().filter_map(|c| c.get(l)).fold(0.0, |a: f64, b| a.max(b.abs()));
        let all = self.variances.iter().enumerate();
        all.map(|(l, v)| if self.coordinates.is_empty() { v.max(0.0).sqrt() } else { largest(l) }).collect()
    }

    fn validate(&self) -> Result<(), String> {
        let ([l, d], n, v) = (self.components.shape(), self.mean.len(), self.variances.len());
        if d != n && l > 0 || l != v {
            return Err(format!("expected components of {v} by {n} as variances and mean say, found {l} by {d}"));
        }
        if let Some(found) = self.coordinates.iter().map(Vec::len).find(|c| *c != l) {
            return Err(format!("expected {l} coordinates of each example, one for each component, found {found}"));
        }
        if self.kind == BasisKind::Images {
            let samples = self.window.and_then(|w| w.samples(self.channels.len()));
            if samples != Some(n) {
                return Err(format!("expected a window and channels of {n} samples in all, found others"));
            }
        }
        Ok(())
    }
}
