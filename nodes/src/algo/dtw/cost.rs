//! Distances between frames.

use std::f64::consts::{PI, TAU};

use pegbar_engine::Setting;

/// How far two frames are from each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Metric {
    /// Sum of the inner angles between numbers, radians: min(|a − b|, 2π − |a − b|) of each pair.
    #[default]
    Angle,
    /// Root of the sum of squared differences.
    Euclidean,
}

/// Why numbers make no series.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SeriesError {
    /// Frames of different lengths.
    #[error("expected {expected} numbers in frame {frame} as in the first, found {found}")]
    Count {
        /// The frame, from 0.
        frame: usize,
        /// Numbers of the first frame.
        expected: usize,
        /// Numbers found.
        found: usize,
    },
    /// A number that is not one.
    #[error("expected numbers below 1e100 in size, or NaN where there is none, found {value} in frame {frame}")]
    NotFinite {
        /// The frame, from 0.
        frame: usize,
        /// The number.
        value: f64,
    },
    /// A weight that is not one.
    #[error("expected weights from 0 to 1e6, found {value} in frame {frame}")]
    Weight {
        /// The frame, from 0.
        frame: usize,
        /// The weight.
        value: f64,
    },
}

/// Frames of so many numbers each.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    dims: usize,
    values: Vec<f64>,
    /// Of each number, or none where all count once.
    weights: Vec<f64>,
}

impl Series {
    /// A series of frames, each number with the weight of its place in `weights`, 1 where there are none. NaN counts nothing.
    ///
    /// # Errors
    /// Where frames have different lengths, a number is infinite or beyond 1e100, or a weight is negative, infinite or beyond 1e6.
    pub fn new(frames: &[&[f64]], weights: Option<&[&[f64]]>) -> Result<Self, SeriesError> {
        let dims = frames.first().map_or(0, |f| f.len());
        let lengths = frames.iter().chain(weights.into_iter().flatten()).map(|f| f.len());
        if let Some((at, found)) = lengths.enumerate().find(|(_, l)| *l != dims) {
            return Err(SeriesError::Count { frame: at % frames.len().max(1), expected: dims, found });
        }
        let mut series = Self { dims, values: frames.concat(), weights: weights.map(|w| w.concat()).unwrap_or_default() };
        series.weights.truncate(series.values.len());
        if let Some(at) = series.weights.iter().position(|w| !(0.0..=1e6).contains(w)) {
            return Err(SeriesError::Weight { frame: at / dims, value: series.weights[at] });
        }
        if let Some(at) = series.values.iter().position(|v| v.abs() > 1e100) {
            return Err(SeriesError::NotFinite { frame: at / dims, value: series.values[at] });
        }
        if series.values.iter().any(|v| v.is_nan()) {
            series.weights.resize(series.values.len(), 1.0);
            for (v, w) in series.values.iter_mut().zip(&mut series.weights).filter(|(v, _)| v.is_nan()) {
                (*v, *w) = (0.0, 0.0);
            }
        }
        Ok(series)
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.values.len() / self.dims.max(1)
    }

    /// True where there is no frame.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Numbers a frame.
    pub fn dims(&self) -> usize {
        self.dims
    }
}

/// Rows of distances between two series.
pub struct Costs {
    pub(super) n: usize,
    pub(super) m: usize,
    pub(super) k: usize,
    pub(super) metric: Metric,
    /// Target, frame by frame.
    pub(super) a: Vec<f64>,
    /// Source, dimension by dimension.
    pub(super) b: Vec<f64>,
    /// Weights likewise; none where all are 1.
    pub(super) weights: Option<[Vec<f64>; 2]>,
}

/// Angles from −π to π stay as they are to the bit; then no difference is more than a turn.
fn wrapped(v: f64) -> f64 {
    if v.abs() <= PI {
        return v;
    }
    let rest = v % TAU;
    if rest > PI {
        rest - TAU
    } else if rest < -PI {
        rest + TAU
    } else {
        rest
    }
}

fn transposed(rows: &[f64], k: usize) -> Vec<f64> {
    let m = rows.len() / k;
    (0..k).flat_map(|d| (0..m).map(move |j| rows[j * k + d])).collect()
}

impl Costs {
    /// Of two series with as many numbers a frame.
    pub fn new(target: &Series, source: &Series, metric: Metric) -> Self {
        let k = target.dims;
        let numbers = |s: &Series| match metric {
            Metric::Angle => s.values.iter().copied().map(wrapped).collect(),
            Metric::Euclidean => s.values.clone(),
        };
        let ones = |s: &Series| if s.weights.is_empty() { vec![1.0; s.values.len()] } else { s.weights.clone() };
        let plain = target.weights.is_empty() && source.weights.is_empty();
        let weights = (!plain).then(|| [ones(target), transposed(&ones(source), k)]);
        Self { n: target.len(), m: source.len(), k, metric, a: numbers(target), b: transposed(&numbers(source), k), weights }
    }

    /// Distances of target frame `i` to source frames from `first` on, as many as `out` holds. Cost: O(numbers of a frame · `out`).
    pub fn row(&self, i: usize, first: usize, out: &mut [f64]) {
        let a = &self.a[i * self.k..][..self.k];
        match (&self.weights, self.metric) {
            (None, Metric::Angle) => plain_row::<true>(a, &self.b, self.m, first, out),
            (None, Metric::Euclidean) => plain_row::<false>(a, &self.b, self.m, first, out),
            (Some([wa, wb]), metric) => {
                let wa = &wa[i * self.k..][..self.k];
                for (j, c) in out.iter_mut().enumerate() {
                    let pair = |d: usize| (a[d], self.b[d * self.m + first + j], wa[d], wb[d * self.m + first + j]);
                    *c = weighted(self.k, pair, metric, wa);
                }
            }
        }
    }
}

/// A distance in which numbers have weights: the weighted mean, times their number. What shares no number is as far as can be, but a target frame in
/// which nothing is seen is at home everywhere.
fn weighted(k: usize, pair: impl Fn(usize) -> (f64, f64, f64, f64), metric: Metric, wa: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for d in 0..k {
        let (a, b, wa, wb) = pair(d);
        let w = wa * wb;
        sum += w * if metric == Metric::Angle { term::<true>(a, b) } else { term::<false>(a, b) };
        total += w;
    }
    if total == 0.0 {
        return if wa.iter().all(|w| *w == 0.0) { 0.0 } else { f64::INFINITY };
    }
    let mean = sum * k as f64 / total;
    if metric == Metric::Angle { mean } else { mean.sqrt() }
}

/// What one number adds to a distance.
#[inline(always)]
pub(super) fn term<const ANGLE: bool>(a: f64, b: f64) -> f64 {
    let d = a - b;
    if ANGLE {
        let (inner, outer) = (d.abs(), TAU - d.abs());
        // Written out: `min` would look for NaN.
        if outer < inner { outer } else { inner }
    } else {
        d * d
    }
}

/// Columns at once.
const COLUMNS: usize = 16;

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn plain_row<const ANGLE: bool>(a: &[f64], b: &[f64], m: usize, first: usize, out: &mut [f64]) {
    for (chunk, c) in out.chunks_mut(COLUMNS).enumerate() {
        let from = first + chunk * COLUMNS;
        let mut sums = [0.0; COLUMNS];
        if let Some(whole) = c.first_chunk_mut::<COLUMNS>() {
            for (d, a) in a.iter().enumerate() {
                let b = &b[d * m + from..][..COLUMNS];
                for l in 0..COLUMNS {
                    sums[l] += term::<ANGLE>(*a, b[l]);
                }
            }
            *whole = sums;
        } else {
            for (l, c) in c.iter_mut().enumerate() {
                *c = a.iter().enumerate().fold(0.0, |s, (d, a)| s + term::<ANGLE>(*a, b[d * m + from + l]));
            }
        }
        if !ANGLE {
            c.iter_mut().for_each(|c| *c = c.sqrt());
        }
    }
}
