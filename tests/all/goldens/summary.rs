//! A value in a few numbers: small enough to be read in a diff, enough of them to see a change.

use std::fmt::Write as _;

use pegbar_engine::array::ArrayView;
use pegbar_engine::value::{AnyValue, Meta};
use serde_json::Value as Json;

/// Arrays of at most so many numbers are kept whole.
const WHOLE: usize = 64;
/// Blocks each way, or samples along an array.
const BLOCKS: usize = 8;

/// How the numbers of a [`Digest`] come from the array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// All of them.
    Whole,
    /// Means of 8 x 8 blocks, row by row, channels together.
    Blocks,
    /// 64 elements, evenly strided.
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
pub(super) struct Digest {
    pub(super) dtype: String,
    pub(super) shape: Vec<usize>,
    pub(super) kept: Kept,
    pub(super) numbers: Vec<f64>,
    /// Mean, least, greatest, standard deviation of the finite elements; none for an array that is kept whole.
    pub(super) statistics: Vec<f64>,
    /// Elements that are no finite number.
    pub(super) not_finite: usize,
}

/// One value in a few numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Summary {
    pub(super) type_name: String,
    pub(super) arrays: Vec<(String, Digest)>,
    pub(super) meta: Meta,
}

pub(super) const STATISTICS: [&str; 4] = ["mean", "least", "greatest", "deviation"];

/// The elements of an array, as f64; exact but for integers beyond 2^53, which no node makes.
fn elements(array: &ArrayView) -> Vec<f64> {
    array.numbers()
}

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

fn digest(type_name: &str, array: &ArrayView) -> Digest {
    let all = elements(array);
    let shape = array.shape.to_vec();
    let (kept, numbers) = match (type_name, shape[..].len()) {
        _ if all.len() <= WHOLE => (Kept::Whole, all.clone()),
        ("Image", 3) => (Kept::Blocks, block_means(&all, [shape[0], shape[1], shape[2]])),
        ("Matte", 2) => (Kept::Blocks, block_means(&all, [shape[0], shape[1], 1])),
        _ => (Kept::Strided, (0..WHOLE).map(|k| all[k * (all.len() - 1) / (WHOLE - 1)]).collect()),
    };
    Digest {
        dtype: array.dtype.to_string(),
        shape,
        numbers,
        statistics: if kept == Kept::Whole { Vec::new() } else { statistics(&all) },
        not_finite: if kept == Kept::Whole { 0 } else { all.iter().filter(|v| !v.is_finite()).count() },
        kept,
    }
}

impl Summary {
    pub(super) fn new(value: &dyn AnyValue) -> Self {
        let parts = value.parts();
        let type_name = value.type_name().to_owned();
        let arrays = parts.arrays.iter().map(|(name, array)| ((*name).to_owned(), digest(&type_name, array))).collect();
        Self { arrays, meta: parts.meta, type_name }
    }

    /// The golden's text.
    pub(super) fn write(&self, indent: &str, out: &mut String) {
        let _ = write!(out, "{{\n{indent}  \"type\": \"{}\"", self.type_name);
        if !self.meta.is_empty() {
            let _ = write!(out, ",\n{indent}  \"meta\": {}", Json::Object(self.meta.clone()));
        }
        for (name, digest) in &self.arrays {
            let _ = write!(out, ",\n{indent}  \"{name}\": {{ \"dtype\": \"{}\", \"shape\": {:?}", digest.dtype, digest.shape);
            digest.write(indent, out);
        }
        let _ = write!(out, "\n{indent}}}");
    }

    /// A summary back from a golden.
    pub(super) fn read(json: &Json) -> Option<Self> {
        let mut summary = Self { type_name: String::new(), arrays: Vec::new(), meta: Meta::new() };
        for (name, json) in json.as_object()? {
            match name.as_str() {
                "type" => summary.type_name = json.as_str()?.to_owned(),
                "meta" => summary.meta = json.as_object()?.clone(),
                _ => summary.arrays.push((name.clone(), Digest::read(json)?)),
            }
        }
        Some(summary)
    }
}

impl Digest {
    fn write(&self, indent: &str, out: &mut String) {
        // Samples of pictures are shown to a fortieth of their tolerance, geometry to a thousandth.
        let digits = if self.dtype == "f32" { 4 } else { 9 };
        for (name, value) in STATISTICS.iter().zip(&self.statistics) {
            let _ = write!(out, ", \"{name}\": {}", number(*value, digits));
        }
        if self.not_finite > 0 {
            let _ = write!(out, ", \"not_finite\": {}", self.not_finite);
        }
        let _ = write!(out, ", \"{}\": [", self.kept.name());
        let row = if self.kept == Kept::Blocks { self.numbers.len() / BLOCKS } else { 16 };
        for (i, value) in self.numbers.iter().enumerate() {
            if self.numbers.len() > 16 && i % row == 0 {
                let _ = write!(out, "{}\n{indent}    ", if i > 0 { "," } else { "" });
            } else if i > 0 {
                out.push_str(", ");
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

/// A number as JSON: fixed digits after the point for those below one, else so many significant ones. JSON has no NaN, which stands in quotes.
fn number(value: f64, digits: usize) -> String {
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
