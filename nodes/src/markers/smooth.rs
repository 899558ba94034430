//! `markers.smooth`: takes the tremble out of marked points, without lag, never across a hold or a cut.
//!
//! **Method** drawing by drawing, each coordinate by itself: local regression over a window of drawings, with Gaussian weights or by Savitzky and Golay
//! ([`crate::algo::markers::smooth`]). Frames with the same markers are one drawing, so that what is on twos stays on twos; a drawing that stands long is a
//! hold, which stays as it is and ends the window on either side. A marker that is not seen is left out of its neighbours' windows.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.1 (markers smoothed over a window w); Savitzky and Golay 1964; Cleveland 1979.
//!
//! **Fails when** frames have other markers than the first, or a number is infinite.
//!
//! **Cost** O(frames · markers · window).
//!
//! ```ron
//! "steady": (type: "markers.smooth", markers: "@marked", window: 5),
//! ```

use std::ops::Range;
use std::sync::Arc;

use pegbar_engine::node::{AnySequence, AnyStream, Context, In, NodeError, Whole};
use pegbar_engine::value::{TimeMap, Value, ValueRef, downcast};
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::markers::smooth::{Filter, Smooth, bridged, parts};
use crate::algo::motion::Holds;
use crate::data::{Markers2, Markers3};

/// What becomes of frames where a marker is not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Gaps {
    /// It stays unseen.
    Keep,
    /// It goes straight from where it was last seen to where it is next. Before the first and after the last it stays unseen.
    Interpolate,
}

/// Takes the tremble out of marked points, without lag, never across a hold or a cut.
#[derive(Node)]
#[node(
    id = "markers.smooth",
    version = 1,
    kind = whole,
    outputs = MarkersSmoothOutputs,
    type_from = "markers",
    source = "Jain, Sheikh, Hodgins 2009, section 3.1; Savitzky, Golay 1964",
    example = "\"steady\": (type: \"markers.smooth\", markers: \"@marked\", window: 5)"
)]
pub(crate) struct MarkersSmooth {
    /// The markers, of pictures or of the world.
    markers: AnySequence,
    /// Drawings that are taken together, the one in the middle included. Below 2 nothing is smoothed.
    #[input(default = 0.0, range = 0.0..=1000.0, unit = "drawings")]
    window: f64,
    /// Which filter.
    #[input(default = gaussian)]
    filter: Filter,
    /// Degree of the polynomials of Savitzky and Golay: 2 or 3 keep the height of arcs, 1 is a running mean.
    #[input(default = 2, range = 0..=6)]
    degree: u32,
    /// Drawings that are held, where frames with the same markers would not tell them.
    holds: Option<In<TimeMap>>,
    /// Frames that a drawing stands to be a hold that nothing is smoothed across.
    #[input(default = 6, range = 2..=1000000, unit = "frames")]
    stand: u32,
    /// First frames of shots: nothing is smoothed across them.
    #[input(default = [])]
    cuts: Vec<i64>,
    /// What becomes of frames where a marker is not seen.
    #[input(default = keep)]
    gaps: Gaps,
}

/// The markers, smoothed.
#[derive(Outputs)]
pub(crate) struct MarkersSmoothOutputs {
    /// Of the same type as those that came in.
    markers: AnyStream,
}

/// Markers of either kind as rows of numbers.
trait Rows: Value + Clone {
    fn row(&self) -> Vec<f64>;
    fn names(&self) -> &[String];
    fn with(&self, row: &[f64]) -> Self;
}

macro_rules! rows {
    ($type:ident) => {
        impl Rows for $type {
            fn row(&self) -> Vec<f64> {
                self.points.as_flattened().to_vec()
            }
            fn names(&self) -> &[String] {
                &self.names
            }
            fn with(&self, row: &[f64]) -> Self {
                Self { points: row.as_chunks().0.to_vec(), names: self.names.clone() }
            }
        }
    };
}

rows!(Markers2);
rows!(Markers3);

/// The drawings of a sequence of frames.
struct Drawings {
    holds: Holds,
    /// Those that are smoothed together.
    parts: Vec<Range<usize>>,
    /// Those that stay as they are.
    fixed: Vec<bool>,
}

impl MarkersSmooth {
    fn smoothed<T: Rows>(&self, values: &[ValueRef], cx: &Context) -> Result<Vec<ValueRef>, NodeError> {
        let first = cx.clock.first;
        let at = |k: usize, message: String| NodeError::input(format!("markers at frame {}: {message}", first + k as i64));
        let mut frames: Vec<Arc<T>> = Vec::with_capacity(values.len());
        for (k, value) in values.iter().enumerate() {
            let markers =
                downcast::<T>(value.clone()).ok_or_else(|| at(k, format!("expected {}, found {}", T::NAME, value.type_name())))?;
            let begin = frames.first().unwrap_or(&markers);
            let (n, own) = (begin.row().len(), markers.row());
            if own.len() != n || markers.names() != begin.names() {
                return Err(at(k, "expected the markers of the first frame, found others".to_owned()));
            }
            if own.iter().any(|v| v.is_infinite()) {
                return Err(at(k, "expected finite places, or NaN, found infinity".to_owned()));
            }
            frames.push(markers);
        }
        let rows: Vec<Vec<f64>> = frames.iter().map(|f| f.row()).collect();
        let found = self.filtered(&rows, first)?;
        Ok(frames.iter().zip(&found).map(|(f, row)| Arc::new(f.with(row)) as ValueRef).collect())
    }

    fn drawings(&self, rows: &[Vec<f64>], first: i64) -> Result<Drawings, NodeError> {
        let n = rows.len();
        let holds = match self.holds.as_deref() {
            Some(map) if map.source_frames.len() == n => Holds::of(&map.source_frames),
            Some(map) => {
                let message = format!("holds: expected {n} frames as the markers have, found {}", map.source_frames.len());
                return Err(NodeError::input(message));
            }
            None => {
                let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan());
                let mut ids = vec![0.0; n];
                (1..n).for_each(|k| ids[k] = if same(&rows[k - 1], &rows[k]) { ids[k - 1] } else { k as f64 });
                Holds::of(&ids)
            }
        };
        let m = holds.first.len();
        let mut cuts = Vec::new();
        for frame in &self.cuts {
            let at = usize::try_from(frame - first).ok().and_then(|k| holds.drawing.get(k));
            let message = || NodeError::input(format!("cuts: expected frames of the markers, found {frame}"));
            cuts.push(*at.ok_or_else(message)?);
        }
        let length = |d: usize| holds.first.get(d + 1).copied().unwrap_or(n) - holds.first[d];
        let fixed: Vec<bool> = (0..m).map(|d| length(d) >= self.stand as usize).collect();
        let long: Vec<usize> = (0..m).filter(|&d| fixed[d]).collect();
        let parts = parts(m, &cuts, &long);
        Ok(Drawings { holds, parts, fixed })
    }

    fn filtered(&self, rows: &[Vec<f64>], first: i64) -> Result<Vec<Vec<f64>>, NodeError> {
        let Drawings { holds, parts, fixed } = self.drawings(rows, first)?;
        let smooth = Smooth { window: self.window, filter: self.filter, degree: self.degree as usize };
        let mut found = rows.to_vec();
        for i in 0..rows.first().map_or(0, Vec::len) {
            let curve: Vec<f64> = rows.iter().map(|r| r[i]).collect();
            let mut track = holds.drawings(&curve);
            if self.gaps == Gaps::Interpolate {
                track = bridged(&track, &holds.times, &parts);
            }
            let track = holds.frames(&smooth.apply(&track, &holds.times, &parts, &fixed));
            found.iter_mut().zip(track).for_each(|(row, v)| row[i] = v);
        }
        Ok(found)
    }
}

impl Whole for MarkersSmooth {
    fn run(self, cx: &Context) -> Result<MarkersSmoothOutputs, NodeError> {
        let values = self.markers.gather()?;
        if !(0.0..=1000.0).contains(&self.window) {
            return Err(NodeError::input(format!("expected `window` from 0 to 1000, found {}", self.window)));
        }
        let found = match values.first().map(|v| v.type_name()) {
            Some(name) if name == Markers2::NAME => self.smoothed::<Markers2>(&values, cx)?,
            Some(name) if name == Markers3::NAME => self.smoothed::<Markers3>(&values, cx)?,
            Some(other) => return Err(NodeError::input(format!("markers: expected Markers2 or Markers3, found {other}"))),
            None => Vec::new(),
        };
        Ok(MarkersSmoothOutputs { markers: AnyStream(found) })
    }
}
