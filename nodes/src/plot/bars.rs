//! `plot.bars`: named numbers as horizontal bars, several series side by side.
//!
//! **Method** see [`crate::algo::plot`]: exact coverage, round numbers on the axis, whiskers to the largest, a dashed line at each mean.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, figure 10 (error of each marker: capture, and lifts of it); Okabe, Ito 2008 (colours).
//!
//! A number that is not known (NaN) has no bar and a dash for its number. Series go together by the names of their rows: what one does not have has no bar.
//!
//! **Fails when** there is nothing to plot, a column or a row is asked for that is not there, or the picture is too small for its texts.
//!
//! **Cost** O(values + pixels).
//!
//! ```ron
//! "errors": (type: "plot.bars", values: ["@captured_off.markers", "@lifted_off.markers"], labels: ["captured", "lifted"], unit: "m"),
//! ```

use pegbar_engine::node::{AnySequence, Context, Fault, List, NodeError, Problem, Whole};
use pegbar_engine::value::{ValueRef, downcast};
use pegbar_engine::{Node, Setting};

use crate::algo::plot::{BarPlot, BarSeries, ON_WHITE, draw_bars};
use crate::algo::window::Window;
use crate::basis::numbers;
use crate::data::Table;
use crate::render::{Drawing, blank, cycled, drawing, within};

/// In which order rows stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Order {
    /// As they come.
    Given,
    /// The longest bar of the first series at the top.
    Largest,
}

/// The most rows of a plot.
const MOST: usize = 4096;

/// Named numbers as horizontal bars, several series side by side.
///
/// Tables, as `eval.rms` makes them of markers, vectors, weights and curves. Of what changes from frame to frame bars show the mean over frames, and whiskers
/// go to the largest.
#[derive(Node)]
#[node(
    id = "plot.bars",
    version = 1,
    kind = whole,
    outputs = Drawing,
    source = "Jain, Sheikh, Hodgins 2009, fig. 10; Okabe, Ito 2008",
    example = "\"errors\": (type: \"plot.bars\", values: [\"@captured_off.markers\", \"@lifted_off.markers\"], labels: [\"captured\", \"lifted\"], unit: \"m\")"
)]
pub(crate) struct PlotBars {
    /// What is plotted, a series each.
    #[input(any_clock)]
    values: List<AnySequence>,
    /// What the legend calls each series, in their order.
    #[input(default = [])]
    labels: Vec<String>,
    /// Names of the bars, where values have none; of tables with names, the rows that are shown, in this order.
    #[input(default = [])]
    names: Vec<String>,
    /// The column of tables that bars show.
    #[input(default = "rms")]
    column: String,
    /// The column to whose numbers whiskers go; that called `max` where there is one and nothing is said, none where it is empty.
    #[input(default = None)]
    whisker: Option<String>,
    /// All numbers are multiplied by it: 100 makes centimetres of metres.
    #[input(default = 1.0)]
    factor: f64,
    /// Their unit, then.
    #[input(default = "")]
    unit: String,
    /// In which order rows stand.
    #[input(default = given)]
    order: Order,
    /// Draw and write the mean of each series.
    #[input(default = true)]
    mean: bool,
    /// Write the numbers beside the bars.
    #[input(default = true)]
    numbers: bool,
    /// Above the plot.
    #[input(default = "")]
    title: String,
    /// Below the axis; the column and the unit where it is left out.
    #[input(default = None)]
    x_label: Option<String>,
    /// Ends of the axis. Fitted to bars and whiskers where it is left out.
    #[input(default = None)]
    x_range: Option<[f64; 2]>,
    /// Width.
    #[input(default = 960, range = 1..=16384, unit = "px")]
    width: i64,
    /// Height. As much as the rows need where it is left out.
    #[input(default = None, range = 1..=65536, unit = "px")]
    height: Option<i64>,
    /// Colours of the series in turn, as seen on screen. Seven that all kinds of sight tell apart where it is left out.
    #[input(default = [], range = 0.0..=1.0)]
    colors: Vec<[f64; 3]>,
    /// Height of a capital.
    #[input(default = 9.0, range = 4.0..=200.0, unit = "px")]
    text_size: f64,
}

/// A series before it goes together with others.
struct Bars {
    names: Vec<String>,
    lengths: Vec<f64>,
    whiskers: Vec<f64>,
}

/// Mean of what is known, and the largest of it; NaN where nothing is.
fn mean_and_most(all: impl Iterator<Item = f64>) -> [f64; 2] {
    let (mut sum, mut count, mut most) = (0.0, 0, f64::NAN);
    for v in all.filter(|v| !v.is_nan()) {
        (sum, count, most) = (sum + v, count + 1, v.max(most));
    }
    [if count > 0 { sum / f64::from(count) } else { f64::NAN }, most]
}

impl PlotBars {
    /// What errors call a series.
    fn called(&self, k: usize) -> String {
        self.labels.get(k).filter(|l| !l.is_empty()).map_or(format!("values {k}"), |l| format!("values `{l}`"))
    }

    fn of_table(&self, table: &Table, k: usize) -> Result<Bars, NodeError> {
        let column = |name: &str, input: &str| {
            let message = || format!("{input}: {}: expected a column of the table, found {name:?}, which is none", self.called(k));
            let there = || format!("its columns are {}", table.columns.join(", "));
            table.column(name).ok_or_else(|| NodeError::input(message()).help(there()))
        };
        let lengths = column(&self.column, "column")?;
        let whiskers = match self.whisker.as_deref() {
            None => table.column("max").unwrap_or_default(),
            Some("") => Vec::new(),
            Some(name) => column(name, "whisker")?,
        };
        Ok(Bars { names: table.rows.clone(), lengths, whiskers })
    }

    fn of_stream(&self, cx: &Context, values: &AnySequence, k: usize) -> Result<Bars, NodeError> {
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for frame in 0..values.len() {
            cx.check()?;
            let row = numbers(&values.get(frame)?);
            if row.len() > MOST || rows.first().is_some_and(|r: &Vec<f64>| r.len() != row.len()) {
                let expected = rows.first().map_or(format!("at most {MOST} numbers"), |r| format!("{} numbers at every frame", r.len()));
                return Err(NodeError::input(format!("{}: expected {expected}, found {} at position {frame}", self.called(k), row.len())));
            }
            rows.push(row);
        }
        let count = rows.first().map_or(0, Vec::len);
        let all: Vec<[f64; 2]> = (0..count).map(|i| mean_and_most(rows.iter().map(|r| r[i]))).collect();
        let whiskers = if rows.len() > 1 && self.whisker.as_deref() != Some("") { all.iter().map(|a| a[1]).collect() } else { Vec::new() };
        Ok(Bars { names: Vec::new(), lengths: all.iter().map(|a| a[0]).collect(), whiskers })
    }

    fn bars(&self, cx: &Context, values: &AnySequence, k: usize) -> Result<Bars, NodeError> {
        let first: Option<ValueRef> = if values.len() == 1 { Some(values.get(0)?) } else { None };
        let mut bars = match first.and_then(downcast::<Table>) {
            Some(table) => self.of_table(&table, k)?,
            None => self.of_stream(cx, values, k)?,
        };
        if bars.names.is_empty() {
            let n = bars.lengths.len();
            if !self.names.is_empty() && self.names.len() != n {
                let message = format!("names: {}: expected a name for each of {n} bars, found {}", self.called(k), self.names.len());
                return Err(NodeError::input(message));
            }
            bars.names = if self.names.is_empty() { (0..n).map(|i| format!("[{i}]")).collect() } else { self.names.clone() };
        }
        for v in bars.lengths.iter_mut().chain(&mut bars.whiskers) {
            *v *= self.factor;
        }
        Ok(bars)
    }

    /// Names of the rows: those that are asked for, or all, those of the first series first.
    fn rows(&self, all: &[Bars]) -> Result<Vec<String>, NodeError> {
        let mut rows: Vec<String> = Vec::new();
        for name in all.iter().flat_map(|b| &b.names) {
            if !rows.contains(name) {
                rows.push(name.clone());
            }
        }
        if !self.names.is_empty() {
            if let Some(name) = self.names.iter().find(|n| !rows.contains(n)) {
                let error = NodeError::input(format!("names: expected rows of the tables, found {name:?}, which is none"));
                return Err(error.help(format!("the rows are {}", rows.join(", "))));
            }
            rows.clone_from(&self.names);
        }
        match rows.len() {
            0 => Err(NodeError::input("values: expected at least one bar, found none")),
            n if n > MOST => Err(NodeError::new(Fault::Limit, format!("values: expected at most {MOST} bars, found {n}"))),
            _ => Ok(rows),
        }
    }

    fn plot(&self, cx: &Context) -> Result<BarPlot, NodeError> {
        let sequences = &self.values.0;
        if self.labels.len() > sequences.len() {
            let found = format!("labels: expected at most one for each of {} values, found {}", sequences.len(), self.labels.len());
            return Err(NodeError::new(Fault::Parameters, found));
        }
        if !self.factor.is_finite() {
            return Err(NodeError::new(Fault::Parameters, format!("factor: expected a number, found {}", self.factor)));
        }
        let all = sequences.iter().enumerate().map(|(k, s)| self.bars(cx, s, k)).collect::<Result<Vec<_>, _>>()?;
        let mut rows = self.rows(&all)?;
        let at = |bars: &Bars, list: &[f64], row: &String| {
            bars.names.iter().position(|n| n == row).and_then(|i| list.get(i).copied()).unwrap_or(f64::NAN)
        };
        if let (Order::Largest, Some(first)) = (self.order, all.first()) {
            let length = |row: &String| Some(at(first, &first.lengths, row)).filter(|v| !v.is_nan()).unwrap_or(f64::NEG_INFINITY);
            rows.sort_by(|a, b| length(b).total_cmp(&length(a)));
        }
        let has_whiskers = all.iter().any(|b| !b.whiskers.is_empty());
        let series = all.iter().enumerate().map(|(k, bars)| BarSeries {
            name: self.labels.get(k).cloned().unwrap_or_default(),
            colour: cycled(&self.colors, &ON_WHITE, k),
            lengths: rows.iter().map(|row| at(bars, &bars.lengths, row)).collect(),
            whiskers: rows.iter().map(|row| at(bars, &bars.whiskers, row)).collect(),
        });
        let series = series.collect();
        let unit = if self.unit.is_empty() { String::new() } else { format!(", {}", self.unit) };
        let whiskers = if has_whiskers { format!("; whiskers to {}", self.whisker.as_deref().unwrap_or("max")) } else { String::new() };
        let is_table = sequences.iter().any(|s| s.len() == 1 && s.get(0).is_ok_and(|v| downcast::<Table>(v).is_some()));
        let what = if is_table { self.column.as_str() } else { "value" };
        Ok(BarPlot {
            title: self.title.clone(),
            x_label: self.x_label.clone().unwrap_or_else(|| format!("{what}{unit}{whiskers}")),
            rows,
            series,
            range: self.x_range,
            mean: self.mean,
            values: self.numbers,
            text: within("text_size", self.text_size, 4.0, 200.0)?,
        })
    }
}

impl Whole for PlotBars {
    fn run(self, cx: &Context) -> Result<Drawing, NodeError> {
        let plot = self.plot(cx)?;
        let height = self.height.unwrap_or_else(|| i64::try_from(plot.height()).unwrap_or(i64::MAX));
        let window = Window::from_bounds(0, 0, self.width, height);
        let mut samples = blank(window)?;
        let drawn = draw_bars(&plot, &mut samples, window.width, window.height);
        drawn.map_err(|e| NodeError::new(Fault::Parameters, e.to_string()))?;
        drawing(window, window, samples)
    }

    fn check(&self) -> Vec<Problem> {
        match self.x_range {
            Some([low, high]) if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) => {
                vec![Problem { input: "x_range", message: format!("expected the lower end first, found {low} and {high}") }]
            }
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
#[path = "bars_tests.rs"]
mod tests;
