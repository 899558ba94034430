//! Dynamic time warping: the monotone alignment of two series with the least sum of distances. Jain, Sheikh, Hodgins 2009, section 3.3,
//! equations 3 and 4; Sakoe and Chiba 1978; step patterns, windows and open ends as in Giorgino 2009 (dtw-python).
//!
//! Only values at the edges of tiles are kept, 64 rows and 64 columns of them; the tiles that the path crosses are made again on the way back. Memory is
//! so 64 (n + m) numbers and one tile.

mod asymmetric;
mod cost;
mod frames;
mod slopes;
mod symmetric;
#[cfg(test)]
mod tests;
mod window;

pub use cost::{Costs, Metric, Series, SeriesError};
pub use frames::{Drawings, source_frames};
pub use window::{Band, BandShape};

use pegbar_engine::Setting;

use window::Window;

/// From which cells a path comes to the next, and how their distances count. Rows are the target's frames, columns the source's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Steps {
    /// One row, one column, or both, each counted once: the classic pattern.
    #[default]
    Symmetric1,
    /// The same, a step along both counted twice, so that no way is shorter than another.
    Symmetric2,
    /// One row and none, one or two columns: each target frame is met exactly once, at most at twice the source's speed.
    Asymmetric,
    /// From a third to three times the source's speed: at most two steps along one after a step along both (P = 1/2).
    SymmetricP05,
    /// From half to twice the source's speed: a step along both for each along one (P = 1).
    SymmetricP1,
    /// From two thirds to one and a half times the source's speed: two steps along both for each along one (P = 2).
    SymmetricP2,
    /// As `SymmetricP05`, each target frame counted once: no wait of more than two drawings, and no frame of the source left out.
    AsymmetricP05,
    /// As `SymmetricP1`, each target frame counted once.
    AsymmetricP1,
    /// As `SymmetricP2`, each target frame counted once.
    AsymmetricP2,
}

impl Steps {
    /// True where sums grow with the frames of both series.
    fn counts_both(self) -> bool {
        matches!(self, Self::Symmetric2 | Self::SymmetricP05 | Self::SymmetricP1 | Self::SymmetricP2)
    }
}

/// What is asked of an alignment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// The step pattern.
    pub steps: Steps,
    /// True where the source may have frames before those that match.
    pub open_begin: bool,
    /// True where the source may have frames after those that match.
    pub open_end: bool,
    /// How far from the diagonal the path may run.
    pub band: Option<Band>,
    /// Pairs of target and source frame, from 0, that the path passes through.
    pub pins: Vec<[usize; 2]>,
}

/// An alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// Sum of distances along the path, as the steps weigh them.
    pub cost: f64,
    /// Pairs of target and source frame, from 0, in the order of time.
    pub path: Vec<[usize; 2]>,
}

/// Why there is no alignment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DtwError {
    /// A series without a frame, or without a number in it.
    #[error("expected series of at least one frame with at least one number, found {n} of target and {m} of source with {dims}")]
    Empty {
        /// Target frames.
        n: usize,
        /// Source frames.
        m: usize,
        /// Numbers a frame.
        dims: usize,
    },
    /// Series of different dimensions.
    #[error("expected as many numbers in each frame of target and source, found {target} and {found}")]
    Dimensions {
        /// Numbers in a target frame.
        target: usize,
        /// Numbers in a source frame.
        found: usize,
    },
    /// A pin outside the series.
    #[error("expected pins of target frames below {n} and source frames below {m}, found ({0}, {1})", pin[0], pin[1])]
    Pin {
        /// The pin.
        pin: [usize; 2],
        /// Target frames.
        n: usize,
        /// Source frames.
        m: usize,
    },
    /// Nothing gets through.
    #[error("expected a path from the first to the last frame, found none: {n} target and {m} source frames, {steps:?} steps")]
    NoPath {
        /// Target frames.
        n: usize,
        /// Source frames.
        m: usize,
        /// The step pattern.
        steps: Steps,
    },
}

/// Rows and columns between the values that are kept.
const TILES: usize = 64;

/// Aligns `source` to `target`.
///
/// The cost has the bits of the plain recursion in 64-bit numbers: distances summed over dimensions in order, then the least predecessor added.
/// A step of several cells runs inside of windows with all of them. Among equals the step along both comes first, then that along the source; a target frame that waits comes last, as in dtw-python.
///
/// # Errors
/// Series that are empty or of different dimensions, pins outside them, and windows, pins or steps that leave no path.
/// Cost: O(n m k), a window's share of it.
pub fn dtw(target: &Series, source: &Series, metric: Metric, options: &Options) -> Result<Alignment, DtwError> {
    comparable(target, source)?;
    let (n, m) = (target.len(), source.len());
    let window = Window::new(n, m, options)?;
    let costs = Costs::new(target, source, metric);
    let alignment = match options.steps {
        Steps::Asymmetric => asymmetric::align(&costs, &window, options),
        Steps::Symmetric1 => symmetric::align::<false>(&costs, &window, options),
        Steps::Symmetric2 => symmetric::align::<true>(&costs, &window, options),
        _ => slopes::align(&costs, &window, options),
    };
    alignment.ok_or(DtwError::NoPath { n, m, steps: options.steps })
}

/// Nothing, where two series have frames with the same number of numbers.
///
/// # Errors
/// Series that are empty or of different dimensions.
pub fn comparable(target: &Series, source: &Series) -> Result<(), DtwError> {
    let (n, m) = (target.len(), source.len());
    if n == 0 || m == 0 || target.dims() == 0 {
        return Err(DtwError::Empty { n, m, dims: target.dims() });
    }
    if target.dims() != source.dims() {
        return Err(DtwError::Dimensions { target: target.dims(), found: source.dims() });
    }
    Ok(())
}

/// First and last column, from 0, that a path may run through in each row of `n` target frames and `m` source frames; the last before the first where
/// nothing gets through.
///
/// # Errors
/// Pins outside the series.
pub fn allowed(n: usize, m: usize, options: &Options) -> Result<Vec<[usize; 2]>, DtwError> {
    Window::new(n, m, options).map(|w| w.rows)
}

/// The column in which the path ends, by the last row of sums; `None` where nothing came there.
///
/// Open ends take the least sum: patterns that count both series by the length of the way, as in dtw-python, unless the beginning is open as well and the length unknown.
fn ending(last: &[f64], n: usize, options: &Options) -> Option<usize> {
    let m = last.len();
    let scale = |j: usize| if options.steps.counts_both() && !options.open_begin { (n + j + 1) as f64 } else { 1.0 };
    let end = if options.open_end {
        let last_pin = options.pins.iter().map(|p| p[1]).max().unwrap_or(0);
        (last_pin..m).fold(last_pin, |best, j| if last[j] / scale(j) < last[best] / scale(best) { j } else { best })
    } else {
        m - 1
    };
    last[end].is_finite().then_some(end)
}
