//! How near a value must be to its reference, and why; and what has to hold of it whatever the reference says.

use serde::Deserialize;

use super::summary::{Digest, Kept, STATISTICS, Summary, number};

/// How a difference is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// The greatest difference of two numbers, in their own unit.
    #[default]
    Absolute,
    /// The same, over the largest number of the reference.
    Relative,
    /// Root of the mean of the squares of all differences.
    Rms,
    /// Every bit.
    Bits,
}

/// The greatest difference allowed, and why.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// How the difference is measured.
    #[serde(default)]
    pub metric: Metric,
    /// What it may be.
    #[serde(default)]
    pub at_most: f64,
    /// Of pictures: by how many codes of 255 a pixel of the small picture beside the reference may differ; [`Tolerance::PIXELS`] where not said.
    #[serde(default)]
    pub pixels: Option<f64>,
    /// Why that much.
    pub reason: String,
}

/// Digits behind the point of differences: a thousandth of the finest tolerance.
const SHOWN: usize = 9;
/// One 8-bit code.
const CODE: f64 = 1.0 / 255.0;

impl Tolerance {
    /// Codes by which a pixel of a small picture may differ: a code of linear light is three in the darkest parts of sRGB.
    pub const PIXELS: f64 = 3.0;

    fn new(metric: Metric, at_most: f64, reason: &str) -> Self {
        Self { metric, at_most, pixels: None, reason: reason.to_owned() }
    }

    /// That of a value of which no golden says anything.
    fn usual(digest: &Digest, is_picture: bool) -> Self {
        let largest = largest(digest).max(1.0);
        match digest.dtype.as_str() {
            "i64" | "u32" | "u8" => Self::new(Metric::Absolute, 0.0, "integers are exact"),
            "f32" if is_picture && digest.kept == Kept::Blocks => Self::new(
                Metric::Absolute,
                CODE,
                "means of blocks: one 8-bit code, which rounding never moves and a change that is seen does",
            ),
            "f32" if is_picture => Self::new(Metric::Absolute, CODE, "samples: one 8-bit code"),
            "f32" => Self::new(Metric::Absolute, 1e-5 * largest, "1e-5 of the extent: a few roundings of f32"),
            _ => {
                Self::new(Metric::Absolute, 1e-6 * largest, "1e-6 of the extent: a thousandth of what is seen, a million roundings of f64")
            }
        }
    }
}

fn largest(digest: &Digest) -> f64 {
    digest.numbers.iter().chain(&digest.statistics).filter(|v| v.is_finite()).fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// Tolerances by output (`image`, `track.motion`) or type (`Image`); an output's own wins.
#[derive(Clone)]
pub struct Tolerances {
    /// What the golden says, later entries first.
    pub rules: Vec<(String, Tolerance)>,
    /// True for types that are pictures.
    pub is_picture: fn(&str) -> bool,
}

impl Tolerances {
    /// What is said of an output of a type.
    pub fn of(&self, output: &str, type_name: &str) -> Option<&Tolerance> {
        let named = |name: &str| self.rules.iter().rev().find(|(n, _)| n == name).map(|(_, t)| t);
        named(output).or_else(|| named(type_name))
    }
}

/// One array, or the text, of a value that is not near enough to its reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Name of the array; `meta` for the text, empty for the value itself.
    pub array: String,
    /// Which numbers differ: how many of how many, and the worst; in words.
    pub what: String,
    /// The tolerance with its reason; empty where there is none.
    pub allowed: String,
}

impl Difference {
    /// A difference of a value as a whole.
    pub fn of_value(what: impl Into<String>) -> Self {
        Self { array: String::new(), what: what.into(), allowed: String::new() }
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.array.is_empty() {
            write!(f, "array `{}`: ", self.array)?;
        }
        f.write_str(&self.what)?;
        if self.allowed.is_empty() { Ok(()) } else { write!(f, "; {}", self.allowed) }
    }
}

/// The difference of two numbers; none between those that are the same, finite or not.
fn difference(expected: f64, found: f64) -> f64 {
    if expected == found || (expected.is_nan() && found.is_nan()) {
        return 0.0;
    }
    let difference = (expected - found).abs();
    if difference.is_finite() { difference } else { f64::INFINITY }
}

/// One number of a digest, and what it may differ by.
struct Entry {
    place: String,
    expected: f64,
    found: f64,
    allowed: f64,
    /// Of many numbers: never exact, not even of integers.
    is_statistic: bool,
}

/// The numbers of two digests side by side.
fn entries(golden: &Digest, found: &Digest, at_most: f64, is_picture: bool) -> Vec<Entry> {
    // Least and greatest are of one pixel each, where an edge may fall a little otherwise; so are samples.
    let single = if is_picture && golden.kept != Kept::Whole { 8.0 } else { 1.0 };
    let allowed = [at_most, single * at_most, single * at_most, at_most];
    let statistics = golden.statistics.iter().zip(&found.statistics).zip(STATISTICS.iter().zip(allowed));
    let statistics = statistics.map(|((e, f), (name, allowed))| Entry {
        place: (*name).to_owned(),
        expected: *e,
        found: *f,
        allowed,
        is_statistic: true,
    });
    let of_number = if golden.kept == Kept::Strided { single * at_most } else { at_most };
    let numbers = golden.numbers.iter().zip(&found.numbers).enumerate();
    let numbers =
        numbers.map(|(k, (e, f))| Entry { place: golden.place(k), expected: *e, found: *f, allowed: of_number, is_statistic: false });
    statistics.chain(numbers).collect()
}

/// What is wrong with one array; `None` where it is near enough.
fn compare_arrays(name: &str, golden: &Digest, found: &Digest, said: Option<&Tolerance>, is_picture: bool) -> Option<Difference> {
    let form = |d: &Digest| format!("{} {:?}, {} not finite", d.dtype, d.shape, d.not_finite);
    let wrong = |what: String, allowed: String| Some(Difference { array: name.to_owned(), what, allowed });
    if form(golden) != form(found) || golden.numbers.len() != found.numbers.len() || golden.kept != found.kept {
        return wrong(format!("expected {}, found {}", form(golden), form(found)), String::new());
    }
    let usual = said.is_none().then(|| Tolerance::usual(golden, is_picture));
    let tolerance = said.or(usual.as_ref())?;
    let at_most = tolerance.at_most * if tolerance.metric == Metric::Relative { largest(golden) } else { 1.0 };
    // What is written down is rounded, which is no difference.
    let slack = |v: f64| if golden.dtype == "f32" { 1e-4 * v.abs().max(1.0) } else { 1e-8 * v.abs().max(1.0) };
    let reach = |e: &Entry| e.allowed + if e.allowed > 0.0 || e.is_statistic { slack(e.expected) } else { 0.0 };
    let all = entries(golden, found, at_most, is_picture);
    if tolerance.metric == Metric::Rms {
        let numbers = &all[golden.statistics.len().min(all.len())..];
        let mean = numbers.iter().map(|e| difference(e.expected, e.found).powi(2)).sum::<f64>() / numbers.len().max(1) as f64;
        let (rms, worst) = (mean.sqrt(), worst(numbers.iter()));
        let far = rms > at_most + if at_most > 0.0 { slack(largest(golden)) } else { 0.0 };
        let what = format!("root mean square {rms}, most of all {}", worst.map(told).unwrap_or_default());
        return if far { wrong(what, format!("allowed {} ({})", number(at_most, SHOWN), tolerance.reason)) } else { None };
    }
    let beyond: Vec<&Entry> = all.iter().filter(|e| difference(e.expected, e.found) > reach(e)).collect();
    let worst = worst(beyond.iter().copied())?;
    let what = format!("{} of {} numbers differ, most of all {}", beyond.len(), all.len(), told(worst));
    wrong(what, format!("allowed {} ({})", number(worst.allowed, SHOWN), tolerance.reason))
}

fn worst<'a>(entries: impl Iterator<Item = &'a Entry>) -> Option<&'a Entry> {
    entries.max_by(|a, b| difference(a.expected, a.found).total_cmp(&difference(b.expected, b.found)))
}

fn told(e: &Entry) -> String {
    let apart = number(difference(e.expected, e.found), SHOWN);
    format!("{}: expected {}, found {}, difference {apart}", e.place, e.expected, e.found)
}

/// Everything in which a value is not its reference; nothing where it is near enough. `output` is its name, by which tolerances are found.
pub fn compare(output: &str, golden: &Summary, found: &Summary, tolerances: &Tolerances) -> Vec<Difference> {
    if golden.type_name != found.type_name {
        return vec![Difference::of_value(format!("expected {}, found {}", golden.type_name, found.type_name))];
    }
    let said = tolerances.of(output, &golden.type_name);
    if let (Some(tolerance), Some(expected), Some(bits)) = (said.filter(|t| t.metric == Metric::Bits), &golden.bits, &found.bits) {
        let same = expected == bits;
        let mut wrong = Difference::of_value(format!("expected the bits {expected}, found {bits}"));
        wrong.allowed = format!("allowed none ({})", tolerance.reason);
        return if same { Vec::new() } else { vec![wrong] };
    }
    let is_picture = (tolerances.is_picture)(&golden.type_name);
    let mut wrong = Vec::new();
    let one = |array: &str, what: String| Difference { array: array.to_owned(), what, allowed: String::new() };
    if golden.meta != found.meta {
        let json = |of: &Summary| serde_json::Value::Object(of.meta.clone()).to_string();
        wrong.push(one("meta", format!("expected {}, found {}", json(golden), json(found))));
    }
    for (name, digest) in &golden.arrays {
        match found.arrays.iter().find(|(n, _)| n == name) {
            Some((_, f)) => wrong.extend(compare_arrays(name, digest, f, said, is_picture)),
            None => wrong.push(one(name, "expected one, found none".to_owned())),
        }
    }
    let more = found.arrays.iter().filter(|(n, _)| !golden.arrays.iter().any(|(g, _)| g == n));
    wrong.extend(more.map(|(name, _)| one(name, "expected none, found one".to_owned())));
    wrong
}

/// What has to hold of a value, whatever the reference says.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Invariant {
    /// No element is NaN or infinite.
    pub finite: bool,
    /// Least and greatest that an element of its arrays of fractions may be.
    pub within: Option<(f64, f64)>,
}

impl Invariant {
    /// What does not hold of a value.
    pub fn broken_by(&self, found: &Summary) -> Vec<String> {
        let mut wrong = Vec::new();
        for (name, digest) in found.arrays.iter().filter(|(_, d)| d.dtype.starts_with('f')) {
            let n = digest.n_not_finite();
            if self.finite && n > 0 {
                wrong.push(format!("array `{name}`: expected finite numbers, found {n} that are not"));
            }
            if let (Some((least, greatest)), Some((low, high))) = (self.within, digest.range())
                && (low < least || high > greatest)
            {
                wrong.push(format!("array `{name}`: expected numbers from {least} to {greatest}, found {low} to {high}"));
            }
        }
        wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(dtype: &str, numbers: Vec<f64>) -> Digest {
        Digest { dtype: dtype.to_owned(), shape: vec![numbers.len()], kept: Kept::Whole, numbers, statistics: Vec::new(), not_finite: 0 }
    }

    fn differ(is_picture: bool, dtype: &str, a: f64, b: f64, said: Option<&Tolerance>) -> bool {
        compare_arrays("x", &digest(dtype, vec![a, 1.0]), &digest(dtype, vec![b, 1.0]), said, is_picture).is_some()
    }

    #[test]
    fn a_change_that_is_seen_is_found_and_rounding_is_not() {
        assert!(!differ(true, "f32", 0.5, 0.503, None) && differ(true, "f32", 0.5, 0.505, None));
        assert!(!differ(false, "f64", 100.0, 100.000_05, None) && differ(false, "f64", 100.0, 100.001, None));
        assert!(!differ(false, "u32", 3.0, 3.0, None) && differ(false, "u32", 3.0, 4.0, None));
        assert!(!differ(false, "f64", f64::NAN, f64::NAN, None) && differ(false, "f64", f64::NAN, 1.0, None));
        assert!(differ(false, "f64", 1.0, f64::INFINITY, None));
    }

    #[test]
    fn each_metric_measures_what_it_says() {
        let said = |metric, at_most| Tolerance { metric, at_most, pixels: None, reason: "why".to_owned() };
        assert!(!differ(false, "f64", 50.0, 50.4, Some(&said(Metric::Relative, 0.01))));
        assert!(differ(false, "f64", 50.0, 50.6, Some(&said(Metric::Relative, 0.01))));
        // Two numbers, of which one differs by 1: a root mean square of 0.71.
        assert!(!differ(false, "f64", 5.0, 6.0, Some(&said(Metric::Rms, 0.75))));
        assert!(differ(false, "f64", 5.0, 6.0, Some(&said(Metric::Rms, 0.7))));
        assert!(differ(false, "f64", 5.0, 6.0, Some(&said(Metric::Absolute, 0.9))));
    }

    #[test]
    fn statistics_of_integers_are_written_rounded() {
        let many =
            |deviation: f64| Digest { statistics: vec![0.5, 0.0, 1.0, deviation], kept: Kept::Strided, ..digest("u8", vec![0.0, 1.0]) };
        let differ = |a, b| compare_arrays("x", &many(a), &many(b), None, false).is_some();
        assert!(!differ(0.363_092_189, 0.363_092_188_706_9) && differ(0.363_092, 0.363_093));
    }

    #[test]
    fn the_worst_of_a_matrix_is_told_by_row_and_column() {
        let matrix = |v: f64| Digest { shape: vec![2, 3], ..digest("f64", vec![0.0, 1.0, 2.0, 3.0, v, 5.0]) };
        let told = compare_arrays("matrix", &matrix(4.0), &matrix(6.5), None, false).map(|d| d.to_string()).unwrap_or_default();
        let expected = "array `matrix`: 1 of 6 numbers differ, most of all element [1, 1]: expected 4, found 6.5, difference 2.5; allowed";
        assert!(told.starts_with(expected), "{told}");
    }
}
