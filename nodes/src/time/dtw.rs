//! `retime.dtw`: which frame of capture goes with each drawing.
//!
//! **Method** dynamic time warping ([`crate::algo::dtw`]) of two descriptor streams; each drawing takes the median of the frames that it is matched with, and
//! held drawings take one. The cost is that of the plain recursion to the bit; memory grows with the lengths, not with their product.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.3, equations 3 and 4; Sakoe and Chiba 1978; Giorgino 2009 (step patterns, windows, open ends).
//!
//! **Fails when** nothing gets through: `asymmetric` runs at no more than twice the source's speed, patterns with a P
//! neither faster nor slower than it allows, bands may miss the end, and pins may cross.
//!
//! **Cost** O(target · source frames · numbers).
//!
//! ```ron
//! "time": (type: "retime.dtw", target: "@drawn.angles", source: "@captured.angles", open_begin: true, open_end: true),
//! ```

use std::sync::Arc;

use pegbar_engine::array::NdArray;
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Context, In, NodeError, Sequence, Whole};
use pegbar_engine::value::{Curve, TimeMap, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::dtw::{Alignment, Band, BandShape, Drawings, Metric, Options, Series, Steps, dtw, source_frames};
use crate::data::WarpPath;

/// Which frame of capture goes with each drawing.
#[derive(Node)]
#[node(
    id = "retime.dtw",
    version = 2,
    kind = whole,
    outputs = RetimeDtwOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.3, eqs. 3 and 4; Giorgino 2009",
    example = "\"time\": (type: \"retime.dtw\", target: \"@drawn.angles\", source: \"@captured.angles\")"
)]
pub(crate) struct RetimeDtw {
    /// Descriptors of the drawings. NaN counts nothing.
    target: Sequence<Vector>,
    /// Descriptors of the capture, on any clock. NaN counts nothing.
    #[input(any_clock)]
    source: Sequence<Vector>,
    /// How far two descriptors are from each other.
    #[input(default = angle)]
    metric: Metric,
    /// How the path may run.
    #[input(default = symmetric1)]
    steps: Steps,
    /// True where the capture begins before the drawings do.
    #[input(default = false)]
    open_begin: bool,
    /// True where the capture goes on after the drawings.
    #[input(default = false)]
    open_end: bool,
    /// How many source frames the path may be off the diagonal. As many as it likes where it is left out.
    #[input(default = None, range = 0.0..=1000000.0, unit = "frames")]
    band: Option<f64>,
    /// The diagonal of a band.
    #[input(default = slanted)]
    band_shape: BandShape,
    /// Pairs of target and source frame that go together.
    #[input(default = [])]
    pins: Vec<[f64; 2]>,
    /// Weight of each number of the target: how much of a limb is seen.
    target_weights: Option<Sequence<Vector>>,
    /// Weight of each number of the source.
    #[input(any_clock)]
    source_weights: Option<Sequence<Vector>>,
    /// The first frame of the drawing that each target frame shows. Where it is left out, frames of equal descriptors are one drawing.
    holds: Option<In<TimeMap>>,
    /// Standard deviation, in drawings, of a window over which the map is smoothed: moves do not stutter, holds are held, pins and both ends stay.
    #[input(default = 0.0, range = 0.0..=1000.0, unit = "drawings")]
    smooth: f64,
}

/// The retime.
#[derive(Outputs)]
pub(crate) struct RetimeDtwOutputs {
    /// Source frame for each frame of the target's clock, for `retime.apply`.
    map: TimeMap,
    /// Sum of distances along the path, as the steps weigh them.
    cost: Curve,
    /// Pairs of target and source frame, as the clocks count them.
    path: WarpPath,
}

/// A series out of a stream, and whatever weighs it.
pub(crate) fn series(values: &Sequence<Vector>, weights: Option<&Sequence<Vector>>, name: &str) -> Result<Series, NodeError> {
    // A single value among weights stands for all frames.
    let read = |s: &Sequence<Vector>| (0..values.len()).map(|k| s.get(k.min(s.len().saturating_sub(1)))).collect::<Result<Vec<_>, _>>();
    let weights = weights.filter(|w| !w.is_empty()).map(read).transpose()?;
    let values = read(values)?;
    let numbers: Vec<&[f64]> = values.iter().map(|v| v.values.as_slice()).collect();
    let weights: Option<Vec<&[f64]>> = weights.as_ref().map(|w| w.iter().map(|v| v.values.as_slice()).collect());
    Series::new(&numbers, weights.as_deref()).map_err(|e| NodeError::input(format!("{name}: {e}")))
}

/// Position of a whole frame number on a clock.
pub(crate) fn position(clock: &Clock, frame: f64, what: &str) -> Result<usize, NodeError> {
    let at = clock.index(frame as i64).filter(|_| frame.fract() == 0.0);
    at.ok_or_else(|| NodeError::input(format!("pins: expected whole {what} frames from {} to {}, found {frame}", clock.first, clock.last)))
}

impl RetimeDtw {
    fn drawings(&self, target: &[Arc<Vector>]) -> Result<Drawings, NodeError> {
        let n = target.len();
        let Some(holds) = &self.holds else { return Ok(Drawings::new(n, |k| target[k] == target[k - 1])) };
        let shown = &holds.source_frames;
        if shown.len() != n {
            return Err(NodeError::input(format!("holds: expected a map of {n} frames as the target has, found {}", shown.len())));
        }
        Ok(Drawings::new(n, |k| shown[k] == shown[k - 1]))
    }
}

impl Whole for RetimeDtw {
    fn run(self, cx: &Context) -> Result<RetimeDtwOutputs, NodeError> {
        let target = series(&self.target, self.target_weights.as_ref(), "target")?;
        let source = series(&self.source, self.source_weights.as_ref(), "source")?;
        let (target_clock, source_clock) = (self.target.clock().unwrap_or(cx.clock), self.source.clock().unwrap_or(cx.clock));
        let pin = |p: &[f64; 2]| Ok([position(target_clock, p[0], "target")?, position(source_clock, p[1], "source")?]);
        let pins = self.pins.iter().map(pin).collect::<Result<Vec<_>, NodeError>>()?;
        let options = Options {
            steps: self.steps,
            open_begin: self.open_begin,
            open_end: self.open_end,
            band: self.band.map(|width| Band { shape: self.band_shape, width }),
            pins,
        };
        cx.check()?;
        let Alignment { cost, path } = dtw(&target, &source, self.metric, &options).map_err(|e| {
            NodeError::input(e.to_string()).help(
                "`open_begin` and `open_end` leave frames of the source out; a wider `band`, other `steps` or `pins` let more through",
            )
        })?;
        let frames = (0..self.target.len()).map(|k| self.target.get(k)).collect::<Result<Vec<_>, _>>()?;
        let found = source_frames(&path, &self.drawings(&frames)?, &options.pins, self.smooth);
        let mut source_frames: Vec<f64> = found.iter().map(|j| source_clock.first as f64 + j).collect();
        // A single descriptor stands for every frame of the clock.
        source_frames.resize(cx.clock.len().max(source_frames.len()), source_frames.last().copied().unwrap_or_default());
        let pairs = path.iter().flat_map(|[i, j]| [target_clock.first + *i as i64, source_clock.first + *j as i64]).collect();
        let pairs = NdArray::new([path.len(), 2], pairs).ok_or_else(|| NodeError::internal("a path of another length"))?;
        Ok(RetimeDtwOutputs { map: TimeMap { source_frames }, cost: Curve { value: cost }, path: WarpPath { pairs } })
    }
}

#[cfg(test)]
#[path = "dtw_tests.rs"]
mod tests;
