//! How near a value must be to its golden, by type, and why.

use super::summary::{Digest, Kept, STATISTICS, Summary};

/// The greatest difference allowed, and why.
struct Tolerance {
    numbers: f64,
    /// Of mean, least, greatest and deviation.
    statistics: [f64; 4],
    reason: &'static str,
}

/// One 8-bit code.
const CODE: f64 = 1.0 / 255.0;

fn tolerance(type_name: &str, golden: &Digest) -> Tolerance {
    let all = |tolerance: f64, reason| Tolerance { numbers: tolerance, statistics: [tolerance; 4], reason };
    let largest = golden.numbers.iter().chain(&golden.statistics).filter(|v| v.is_finite()).fold(0.0, |m: f64, v| m.max(v.abs()));
    match (golden.dtype.as_str(), type_name) {
        ("i64" | "u32" | "u8", _) => all(0.0, "integers are exact"),
        ("f32", "Image" | "Matte") if golden.kept == Kept::Blocks => Tolerance {
            numbers: CODE,
            // Least and greatest are of one pixel each, where an edge may fall a little otherwise.
            statistics: [CODE, 8.0 * CODE, 8.0 * CODE, CODE],
            reason: "means of blocks: one 8-bit code, which rounding never moves and a change that is seen does",
        },
        ("f32", "Image" | "Matte") => all(CODE, "samples: one 8-bit code"),
        ("f32", _) => all(1e-5 * largest.max(1.0), "1e-5 of the extent: a few roundings of f32"),
        _ => all(1e-6 * largest.max(1.0), "1e-6 of the extent: a thousandth of what is seen, a million roundings of f64"),
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

/// What is wrong with one array; `None` where it is near enough.
fn compare_arrays(type_name: &str, golden: &Digest, found: &Digest) -> Option<String> {
    let form = |d: &Digest| format!("{} {:?}, {} not finite", d.dtype, d.shape, d.not_finite);
    if form(golden) != form(found) || golden.numbers.len() != found.numbers.len() || golden.kept != found.kept {
        return Some(format!("expected {}, found {}", form(golden), form(found)));
    }
    let tolerance = tolerance(type_name, golden);
    // What is written down is rounded, which is no difference.
    let slack = |v: f64| if golden.dtype == "f32" { 1e-4 * v.abs().max(1.0) } else { 1e-8 * v.abs().max(1.0) };
    let numbers = golden.numbers.iter().zip(&found.numbers).enumerate();
    let numbers = numbers.map(|(i, (e, f))| (format!("number {i}"), *e, *f, tolerance.numbers));
    let statistics = golden.statistics.iter().zip(&found.statistics).zip(STATISTICS.iter().zip(tolerance.statistics));
    let statistics = statistics.map(|((e, f), (name, tolerance))| ((*name).to_owned(), *e, *f, tolerance));
    let beyond: Vec<_> =
        statistics.chain(numbers).filter(|(_, e, f, t)| difference(*e, *f) > t + if *t > 0.0 { slack(*e) } else { 0.0 }).collect();
    let worst = beyond.iter().max_by(|a, b| difference(a.1, a.2).total_cmp(&difference(b.1, b.2)))?;
    let (place, expected, found, allowed) = worst;
    Some(format!(
        "{} numbers differ, most of all {place}: expected {expected}, found {found}; difference {} > {allowed} ({})",
        beyond.len(),
        difference(*expected, *found),
        tolerance.reason
    ))
}

/// Everything in which a value is not its golden, a line each.
pub(super) fn compare(golden: &Summary, found: &Summary) -> Vec<String> {
    let mut wrong = Vec::new();
    if golden.type_name != found.type_name {
        return vec![format!("expected {}, found {}", golden.type_name, found.type_name)];
    }
    if golden.meta != found.meta {
        wrong.push(format!("meta: expected {:?}, found {:?}", golden.meta, found.meta));
    }
    for (name, digest) in &golden.arrays {
        match found.arrays.iter().find(|(n, _)| n == name) {
            Some((_, f)) => wrong.extend(compare_arrays(&golden.type_name, digest, f).map(|w| format!("array `{name}`: {w}"))),
            None => wrong.push(format!("array `{name}`: expected one, found none")),
        }
    }
    let more = found.arrays.iter().filter(|(n, _)| !golden.arrays.iter().any(|(g, _)| g == n));
    wrong.extend(more.map(|(name, _)| format!("array `{name}`: expected none, found one")));
    wrong
}

#[test]
fn a_change_that_is_seen_is_found_and_rounding_is_not() {
    let digest = |dtype: &str, numbers: Vec<f64>| Digest {
        dtype: dtype.to_owned(),
        shape: vec![numbers.len()],
        kept: Kept::Whole,
        numbers,
        statistics: Vec::new(),
        not_finite: 0,
    };
    let differ =
        |ty: &str, dtype: &str, a: f64, b: f64| compare_arrays(ty, &digest(dtype, vec![a, 1.0]), &digest(dtype, vec![b, 1.0])).is_some();
    assert!(!differ("Image", "f32", 0.5, 0.503) && differ("Image", "f32", 0.5, 0.505));
    assert!(!differ("Affine2", "f64", 100.0, 100.000_05) && differ("Affine2", "f64", 100.0, 100.001));
    assert!(!differ("Mesh", "u32", 3.0, 3.0) && differ("Mesh", "u32", 3.0, 4.0));
    assert!(
        !differ("Curve", "f64", f64::NAN, f64::NAN) && differ("Curve", "f64", f64::NAN, 1.0) && differ("Curve", "f64", 1.0, f64::INFINITY)
    );
}
