//! Values of any type as curves, gathered into groups that share an axis.

use pegbar_engine::node::{AnySequence, NodeError};
use pegbar_engine::value::{TimeMap, Value, ValueRef};

use crate::data::Affine2;

/// The most numbers of a value that are drawn as curves.
const MOST: usize = 64;

/// Curves of one unit, which share an axis.
#[derive(Debug, PartialEq)]
pub(super) struct Group {
    /// What stands along its axis.
    pub(super) label: String,
    /// Name and values of each curve, one a frame.
    pub(super) curves: Vec<(String, Vec<f64>)>,
    /// True for a value that holds all frames by itself.
    pub(super) spans: bool,
}

/// The curves of a sequence of values. `name` is the given one, if any.
pub(super) fn groups(values: &AnySequence, name: Option<&str>) -> Result<Vec<Group>, NodeError> {
    if values.is_empty() {
        return Ok(Vec::new());
    }
    let ty = values.get(0)?.type_name();
    if ty == TimeMap::NAME && values.len() == 1 {
        let curve = numbers(&values.get(0)?)?;
        let label = name.unwrap_or("source frame").to_owned();
        return Ok(vec![Group { curves: vec![(label.clone(), curve)], label, spans: true }]);
    }
    let rows = (0..values.len()).map(|k| numbers(&values.get(k)?)).collect::<Result<Vec<_>, _>>()?;
    let count = rows[0].len();
    if let Some(k) = rows.iter().position(|r| r.len() != count) {
        let found = format!("expected {count} numbers at every frame, found {} at position {k} of the sequence", rows[k].len());
        return Err(NodeError::input(format!("{}: {found}", name.unwrap_or(ty))));
    }
    let curve = |i: usize| rows.iter().map(|r| r[i]).collect::<Vec<f64>>();
    if ty == Affine2::NAME && count == 6 {
        return Ok(affine(curve, name));
    }
    let label = name.map_or_else(|| ty.to_lowercase(), str::to_owned);
    let called = |i: usize| if count == 1 { label.clone() } else { format!("{label}[{i}]") };
    let curves = (0..count).map(|i| (called(i), curve(i))).collect();
    Ok(vec![Group { label, curves, spans: false }])
}

/// Linear part and translation are in different units. The matrix has its rows `[a1, a2, dx]` and `[a3, a4, dy]`.
fn affine(curve: impl Fn(usize) -> Vec<f64>, name: Option<&str>) -> Vec<Group> {
    let prefix = name.map_or_else(String::new, |n| format!("{n} "));
    let group = |label: &str, parts: &[(&str, usize)]| Group {
        label: format!("{prefix}{label}"),
        curves: parts.iter().map(|(n, i)| (format!("{prefix}{n}"), curve(*i))).collect(),
        spans: false,
    };
    vec![group("linear part", &[("a1", 0), ("a2", 1), ("a3", 3), ("a4", 4)]), group("translation, px", &[("dx", 2), ("dy", 5)])]
}

/// All numbers of a value, in the order of its arrays.
fn numbers(value: &ValueRef) -> Result<Vec<f64>, NodeError> {
    let parts = value.parts();
    let count: usize = parts.arrays.iter().map(|(_, a)| a.bytes.len() / a.dtype.size()).sum();
    if count == 0 || (count > MOST && value.type_name() != TimeMap::NAME) {
        let found = format!("expected values of 1 to {MOST} numbers, found {} of {count}", value.type_name());
        return Err(NodeError::input(found).help("plot.curves is for curves, vectors, weights, motions and time maps"));
    }
    Ok(parts.arrays.iter().flat_map(|(_, a)| a.numbers()).collect())
}
