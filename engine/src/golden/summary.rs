//! Values in a few numbers, so that a golden is small, and a diff of it is read.

use std::fmt::Write as _;

use serde_json::Value as Json;

use crate::array::ArrayView;
use crate::value::{AnyValue, Meta, digest};

/// Arrays of at most so many numbers are kept whole.
const WHOLE: usize = 64;
/// Blocks each way.
const BLOCKS: usize = 8;
/// As [`WHOLE`], in a brief summary: one that is only to tell where a difference begins.
const BRIEF: usize = 16;
/// The longest text, as JSON, of a brief summary.
const LONGEST_META: usize = 120;
/// Hexadecimal digits of a content digest that are kept: 64 bits, which no two values of a show have in common.
const BITS: usize = 16;

/// How the numbers of a [`Digest`] come from the array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// All of them.
    Whole,
    /// Means of 8 x 8 blocks of a picture, row by row, channels together.
    Blocks,
    /// Elements, evenly strided, the first and the last among them.
    Strided,
}

impl Kept {
    const ALL: [(Self, &'static str); 3] = [(Self::Whole, "values"), (Self::Blocks, "block_means"), (Self::Strided, "samples")];

    fn name(self) -> &'static str {
        Self::ALL.iter().find(|(k, _)| *k == self).map_or("", |(_, n)| n)
    }
}

/// One array in a few numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Digest {
    /// Element type.
    pub dtype: String,
    /// Extents.
    pub shape: Vec<usize>,
    /// Where `numbers` come from.
    pub kept: Kept,
    /// The array, or what stands for it.
    pub numbers: Vec<f64>,
    /// Mean, least, greatest, standard deviation of the finite elements; none for an array that is kept whole.
    pub statistics: Vec<f64>,
    /// Elements that are no finite number, of an array that is not kept whole.
    pub not_finite: usize,
}

/// One value in a few numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Its type.
    pub type_name: String,
    /// Start of its content digest, in hexadecimal; `None` where a golden does without.
    pub bits: Option<String>,
    /// Its arrays by name.
    pub arrays: Vec<(String, Digest)>,
    /// Its text.
    pub meta: Meta,
}

/// Names of [`Digest::statistics`].
pub const STATISTICS: [&str; 4] = ["mean", "least", "greatest", "deviation"];

fn statistics(all: &[f64]) -> Vec<f64> {
    let finite: Vec<f64> = all.iter().copied().filter(|v| v.is_finite()).collect();
    if finite.is_empty() {
        return vec![0.0; 4];
    }
    let n = finite.len() as f64;
    let mean = finite.iter().sum::<f64>() / n;
    let variance = finite.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    let least = finite.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    vec![mean, least, greatest, variance.sqrt()]
}

/// Means of the finite elements of blocks of a picture of `[rows, columns, channels]`.
fn block_means(all: &[f64], [rows, columns, channels]: [usize; 3]) -> Vec<f64> {
    let mut means = Vec::new();
    let span = |block: usize, extent: usize| {
        let from = block * extent / BLOCKS;
        from..((block + 1) * extent / BLOCKS).max(from + 1).min(extent)
    };
    for (by, bx) in (0..BLOCKS * BLOCKS).map(|b| (b / BLOCKS, b % BLOCKS)) {
        for c in 0..channels {
            let places = span(by, rows).flat_map(|y| span(bx, columns).map(move |x| (y * columns + x) * channels + c));
            let (sum, n) = places.map(|i| all[i]).filter(|v| v.is_finite()).fold((0.0, 0), |(s, n), v| (s + v, n + 1));
            means.push(if n == 0 { 0.0 } else { sum / f64::from(n) });
        }
    }
    means
}

/// The element that stands at place `k` of `n` evenly strided ones.
fn strided(k: usize, n: usize, len: usize) -> usize {
    k * (len - 1) / (n - 1)
}

impl Digest {
    fn new(array: &ArrayView, is_picture: bool, whole: usize) -> Self {
        let all = array.numbers();
        let shape = array.shape.to_vec();
        let (kept, numbers) = match (is_picture && whole == WHOLE, shape.len()) {
            _ if all.len() <= whole => (Kept::Whole, all.clone()),
            (true, 3) => (Kept::Blocks, block_means(&all, [shape[0], shape[1], shape[2]])),
            (true, 2) => (Kept::Blocks, block_means(&all, [shape[0], shape[1], 1])),
            _ => (Kept::Strided, (0..whole).map(|k| all[strided(k, whole, all.len())]).collect()),
        };
        Self {
            dtype: array.dtype.to_string(),
            shape,
            numbers,
            statistics: if kept == Kept::Whole { Vec::new() } else { statistics(&all) },
            not_finite: if kept == Kept::Whole { 0 } else { all.iter().filter(|v| !v.is_finite()).count() },
            kept,
        }
    }

    /// Least and greatest of the finite elements of the whole array; `None` where there are none.
    pub fn range(&self) -> Option<(f64, f64)> {
        if let [_, least, greatest, _] = self.statistics[..] {
            return Some((least, greatest));
        }
        let finite = || self.numbers.iter().copied().filter(|v| v.is_finite());
        finite().next()?;
        Some((finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)))
    }

    /// Elements of the whole array that are no finite number.
    pub fn n_not_finite(&self) -> usize {
        self.not_finite + if self.kept == Kept::Whole { self.numbers.iter().filter(|v| !v.is_finite()).count() } else { 0 }
    }

    /// Which element or block number `k` of [`Digest::numbers`] is.
    pub fn place(&self, k: usize) -> String {
        if self.kept == Kept::Blocks {
            let channels = (self.numbers.len() / (BLOCKS * BLOCKS)).max(1);
            let (block, channel) = (k / channels, k % channels);
            return format!("block {} across, {} down of {BLOCKS} x {BLOCKS}, channel {channel}", block % BLOCKS + 1, block / BLOCKS + 1);
        }
        let len: usize = self.shape.iter().product();
        let is_strided = self.kept == Kept::Strided && self.numbers.len() > 1 && len > 0;
        let mut at = if is_strided { strided(k, self.numbers.len(), len) } else { k };
        let mut indices = Vec::new();
        for extent in self.shape.iter().rev().filter(|e| **e > 0) {
            indices.push(at % extent);
            at /= extent;
        }
        indices.reverse();
        if indices.is_empty() { "the number".to_owned() } else { format!("element {indices:?}") }
    }

    fn write(&self, break_at: Option<&str>, out: &mut String) {
        // Samples of pictures are shown to a fortieth of their tolerance, geometry to a thousandth.
        let digits = if self.dtype == "f32" { 4 } else { 9 };
        // Writing into a string cannot fail.
        for (name, value) in STATISTICS.iter().zip(&self.statistics) {
            let _ = write!(out, ", \"{name}\": {}", number(*value, digits));
        }
        if self.not_finite > 0 {
            let _ = write!(out, ", \"not_finite\": {}", self.not_finite);
        }
        let _ = write!(out, ", \"{}\": [", self.kept.name());
        let row = if self.kept == Kept::Blocks { self.numbers.len() / BLOCKS } else { 16 };
        for (i, value) in self.numbers.iter().enumerate() {
            match break_at {
                Some(indent) if self.numbers.len() > 16 && i % row == 0 => {
                    let _ = write!(out, "{}\n{indent}    ", if i > 0 { "," } else { "" });
                }
                _ if i > 0 => out.push_str(", "),
                _ => (),
            }
            out.push_str(&number(*value, digits));
        }
        out.push_str("] }");
    }

    fn read(json: &Json) -> Option<Self> {
        let (kept, list) = Kept::ALL.iter().find_map(|(k, name)| Some((*k, json.get(name)?)))?;
        let statistics = STATISTICS.iter().filter_map(|name| float(json.get(name)?)).collect();
        Some(Self {
            dtype: json.get("dtype")?.as_str()?.to_owned(),
            shape: json.get("shape")?.as_array()?.iter().map(|v| v.as_u64().map(|v| v as usize)).collect::<Option<_>>()?,
            kept,
            numbers: list.as_array()?.iter().map(float).collect::<Option<_>>()?,
            statistics,
            not_finite: json.get("not_finite").and_then(Json::as_u64).unwrap_or(0) as usize,
        })
    }
}

impl Summary {
    /// A value in a few numbers: what is compared. Of pictures, the means of 8 x 8 blocks. O(elements).
    pub fn new(value: &dyn AnyValue, is_picture: bool) -> Self {
        Self::with(value, is_picture, WHOLE)
    }

    /// A value in still fewer numbers: what tells where along a graph a difference begins. O(elements).
    pub fn brief(value: &dyn AnyValue) -> Self {
        Self::with(value, false, BRIEF)
    }

    fn with(value: &dyn AnyValue, is_picture: bool, whole: usize) -> Self {
        let parts = value.parts();
        let arrays = parts.arrays.iter().map(|(name, array)| ((*name).to_owned(), Digest::new(array, is_picture, whole))).collect();
        let bits = digest(value).to_hex().chars().take(BITS).collect();
        // What a brief summary has no room for still counts by its bits.
        let fits = whole > BRIEF || Json::Object(parts.meta.clone()).to_string().len() <= LONGEST_META;
        let meta = if fits { parts.meta } else { Meta::new() };
        Self { arrays, meta, bits: Some(bits), type_name: value.type_name().to_owned() }
    }

    /// The golden's text: an array a line, and long arrays over several.
    pub fn write(&self, indent: &str, out: &mut String) {
        let _ = write!(out, "{{\n{indent}  \"type\": \"{}\"", self.type_name);
        if let Some(bits) = &self.bits {
            let _ = write!(out, ",\n{indent}  \"bits\": \"{bits}\"");
        }
        if !self.meta.is_empty() {
            let _ = write!(out, ",\n{indent}  \"meta\": {}", Json::Object(self.meta.clone()));
        }
        for (name, digest) in &self.arrays {
            let _ = write!(out, ",\n{indent}  \"{name}\": {{ \"dtype\": \"{}\", \"shape\": {:?}", digest.dtype, digest.shape);
            digest.write(Some(indent), out);
        }
        let _ = write!(out, "\n{indent}}}");
    }

    /// The same on one line.
    pub fn write_line(&self, out: &mut String) {
        let _ = write!(out, "{{ \"type\": \"{}\"", self.type_name);
        if let Some(bits) = &self.bits {
            let _ = write!(out, ", \"bits\": \"{bits}\"");
        }
        if !self.meta.is_empty() {
            let _ = write!(out, ", \"meta\": {}", Json::Object(self.meta.clone()));
        }
        for (name, digest) in &self.arrays {
            let _ = write!(out, ", \"{name}\": {{ \"dtype\": \"{}\", \"shape\": {:?}", digest.dtype, digest.shape);
            digest.write(None, out);
        }
        out.push_str(" }");
    }

    /// A summary back from a golden; `None` where it is none.
    pub fn read(json: &Json) -> Option<Self> {
        let mut summary = Self { type_name: String::new(), bits: None, arrays: Vec::new(), meta: Meta::new() };
        for (name, json) in json.as_object()? {
            match (name.as_str(), json) {
                ("type", _) => summary.type_name = json.as_str()?.to_owned(),
                ("bits", Json::String(bits)) => summary.bits = Some(bits.clone()),
                ("meta", _) => summary.meta = json.as_object()?.clone(),
                _ => summary.arrays.push((name.clone(), Digest::read(json)?)),
            }
        }
        Some(summary)
    }
}

/// A number as JSON: fixed digits after the point for those below one, else so many significant ones. JSON has no NaN, which stands in quotes.
pub(super) fn number(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return format!("\"{value}\"");
    }
    let whole = if value.abs() >= 1.0 { value.abs().log10() as usize } else { 0 };
    let text = format!("{value:.*}", digits.saturating_sub(whole));
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn float(json: &Json) -> Option<f64> {
    json.as_f64().or_else(|| json.as_str()?.parse().ok())
}
