//! What a run cost, in units for people.

use std::time::Duration;

use pegbar_engine::exec::NodeStats;
use pegbar_engine::graph::{Graph, GraphNode};
use pegbar_engine::job::Outcome;

use crate::console::count;

/// `820 ms`, `12.3 s`, `3 min 05 s`, `2 h 07 min`: three figures at most.
pub(crate) fn duration(time: Duration) -> String {
    let secs = time.as_secs_f64();
    match secs {
        s if s < 0.000_999_5 => format!("{:.0} us", s * 1e6),
        s if s < 0.009_995 => format!("{:.2} ms", s * 1e3),
        s if s < 0.099_95 => format!("{:.1} ms", s * 1e3),
        s if s < 0.999_5 => format!("{:.0} ms", s * 1e3),
        s if s < 9.995 => format!("{s:.2} s"),
        s if s < 59.95 => format!("{s:.1} s"),
        s if s < 3599.5 => format!("{} min {:02} s", (s.round() as u64) / 60, (s.round() as u64) % 60),
        s => format!("{} h {:02} min", ((s / 60.0).round() as u64) / 60, ((s / 60.0).round() as u64) % 60),
    }
}

/// `512 B`, `1.5 MB`: powers of 1000, three figures at most.
pub(crate) fn bytes(n: u64) -> String {
    const UNITS: [&str; 5] = ["B", "kB", "MB", "GB", "TB"];
    let mut value = n as f64;
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < UNITS.len() {
        value /= 1000.0;
        unit += 1;
    }
    let digits = if unit == 0 || value >= 99.95 { 0 } else { 1 };
    format!("{value:.digits$} {}", UNITS[unit])
}

/// Rows of cells as columns: the first two to the left, the others to the right.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|t| t.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate().map(|(c, (t, &w))| if c < 2 { format!("{t:<w$}") } else { format!("{t:>w$}") });
        text.push_str(format!("  {}", cells.collect::<Vec<_>>().join("  ")).trim_end());
        text.push('\n');
    }
    text
}

/// A column of the summary: its head, and its cell of a node, given the share of all time.
type Column = (&'static str, fn(&GraphNode, &NodeStats, f64) -> String);

const COLUMNS: &[Column] = &[
    ("node", |node, _, _| node.name.clone()),
    ("type", |node, _, _| node.ty.schema.id.to_owned()),
    ("tasks", |_, stats, _| stats.tasks.to_string()),
    ("cached", |_, stats, _| stats.skipped.to_string()),
    ("time", |_, stats, _| duration(stats.time)),
    ("share", |_, _, share| format!("{:.1} %", share * 100.0)),
    ("peak memory", |_, stats, _| bytes(stats.peak_bytes)),
];

/// A line for each node that ran, and the total.
pub(crate) fn summary(graph: &Graph, outcome: &Outcome) -> String {
    let report = &outcome.report;
    let total: f64 = report.stats.iter().map(|s| s.time.as_secs_f64()).sum();
    let mut rows: Vec<Vec<String>> = vec![COLUMNS.iter().map(|(head, _)| (*head).to_owned()).collect()];
    for (node, stats) in graph.nodes.iter().zip(&report.stats).filter(|(_, s)| s.tasks + s.skipped > 0) {
        let share = if total > 0.0 { stats.time.as_secs_f64() / total } else { 0.0 };
        rows.push(COLUMNS.iter().map(|(_, cell)| cell(node, stats, share)).collect());
    }
    let rate = outcome.frames as f64 / outcome.wall.as_secs_f64().max(1e-9);
    let frames = count(outcome.frames, "frame");
    let spilled = match report.spilled {
        (0, _) => String::new(),
        (n, size) => format!("; {} went to disk, {}", count(usize::try_from(n).unwrap_or(usize::MAX), "value"), bytes(size)),
    };
    let total = format!(
        "{frames} in {}, {} frames/s, peak memory of results {}{spilled}\n",
        duration(outcome.wall),
        figures(rate),
        bytes(report.peak_bytes)
    );
    let table = if rows.len() > 1 { format!("{}\n", table(&rows)) } else { String::new() };
    format!("{table}{total}{}", files(outcome))
}

/// Three figures.
pub(crate) fn figures(value: f64) -> String {
    match value {
        v if v >= 99.95 => format!("{v:.0}"),
        v if v >= 9.995 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

fn files(outcome: &Outcome) -> String {
    match (outcome.written.first(), outcome.written.last()) {
        (Some(one), Some(_)) if outcome.written.len() == 1 => format!("1 file: {}\n", one.display()),
        (Some(first), Some(last)) => format!("{} files: {} ... {}\n", outcome.written.len(), first.display(), last.display()),
        _ => String::new(),
    }
}
