//! Plots: curves over time, panels above each other with one axis of frames; matrices of distances with paths through them; bars with names.
//!
//! A plot is drawn with exact coverage in linear light, so that it looks the same at any size. Lines are reduced to what their columns of pixels
//! show and their strokes are united, not added up, so that a line of a hundred thousand frames costs what its pixels cost.

mod bars;
mod draw;
mod line;
mod matrix;
mod ramp;
mod sheet;
mod ticks;

pub use bars::{BarPlot, BarSeries, draw_bars};
pub use draw::{PlotError, draw};
pub use line::reduced;
pub use matrix::{MatrixPlot, Shrunk, draw_matrix, matrix_area};
pub use ramp::Ramp;
pub use sheet::{dashes, shortened, wrapped};
pub use ticks::{Ticks, ticks};

/// Okabe and Ito's colours that all kinds of sight tell apart, as 0xRRGGBB, in an order that reads on white.
pub const ON_WHITE: [u32; 7] = [0x0072B2, 0xD55E00, 0x009E73, 0xCC79A7, 0xE69F00, 0x56B4E9, 0x000000];

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// What the legend calls it.
    pub name: String,
    /// Where it is known, along the common axis: as many as values, ascending.
    pub x: Vec<f64>,
    /// The values; where one is not finite the line is broken.
    pub y: Vec<f64>,
    /// Its colour, linear and premultiplied.
    pub colour: [f32; 4],
}

/// One pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// What stands along its vertical axis.
    pub label: String,
    /// Its lines; the first lies at the bottom.
    pub series: Vec<Series>,
    /// The ends of its vertical axis; fitted to the values where it is left out.
    pub range: Option<[f64; 2]>,
}

impl Panel {
    /// The lines that a legend names: none where the only one is called what the axis is.
    fn named(&self) -> Vec<&Series> {
        match &self.series[..] {
            [only] if only.name == self.label => Vec::new(),
            all => all.iter().filter(|s| !s.name.is_empty()).collect(),
        }
    }
}

/// All that a plot shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Above it all.
    pub title: String,
    /// Below the horizontal axis.
    pub x_label: String,
    /// Ends of the horizontal axis.
    pub span: [f64; 2],
    /// The least distance of numbers along the horizontal axis: 1 for frames.
    pub x_step: f64,
    /// From the top.
    pub panels: Vec<Panel>,
    /// Shaded stretches of the horizontal axis.
    pub bands: Vec<[f64; 2]>,
    /// Whether the lines are named beside their panel.
    pub legend: bool,
    /// Height of a capital in pixels.
    pub text: f64,
    /// Width of the lines in pixels.
    pub width: f64,
    /// Diameter of the dots at the values in pixels; 0 draws none.
    pub dots: f64,
}

/// A rectangle of the picture: left, top, right, bottom, in pixels.
pub type Area = [f64; 4];

/// The ends of an axis that shows all finite values, with a margin of a twentieth; -1 to 1 where there are none.
pub fn fitted(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let ends = values.filter(|v| v.abs() < LARGEST).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    let [low, high] = ends;
    if low > high {
        return [-1.0, 1.0];
    }
    let size = low.abs().max(high.abs());
    // A constant, or one but for rounding, is drawn flat in the middle rather than as noise.
    if high - low <= 1e-9 * size || size == 0.0 {
        let half = if size == 0.0 { 1.0 } else { size * 0.1 };
        return [low - half, high + half];
    }
    let margin = (high - low) * 0.05;
    [low - margin, high + margin]
}

/// Values further from nought are taken as not finite, which keeps differences finite.
pub(super) const LARGEST: f64 = 1e300;

#[cfg(test)]
mod tests;
