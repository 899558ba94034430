//! `plot.curves`: values over time as one still picture.
//!
//! **Method** see [`crate::algo::plot`]: exact coverage, round numbers on the axes, colours that all kinds of sight tell apart.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, figure 3 (the six affine parameters over time); Okabe, Ito 2008 (colours).
//!
//! **Fails when** there is nothing to plot, or the picture is too small for its texts; the error says how large it must be. Where a value is not
//! finite its line has a gap.
//!
//! **Cost** O(values + pixels × lines); one frame is in memory.
//!
//! ```ron
//! "plot": (type: "plot.curves", curves: ["@track.motion", "@track.residual"], names: ["motion", "residual"]),
//! ```

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{AnySequence, Context, Fault, In, List, NodeError, Problem, Whole};
use pegbar_engine::value::{TimeMap, Vector};
use pegbar_engine::{Node, Outputs, Setting};

use super::gather::{Group, groups};
use crate::algo::plot::{ON_WHITE, Panel, Plot, Series, draw};
use crate::algo::window::Window;
use crate::data::Image;
use crate::render::{blank, cycled, drawing, within};

/// How curves share axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Layout {
    /// A panel for each value, and two for a motion: its linear part and its translation.
    Stacked,
    /// All in one panel.
    Overlaid,
}

/// Values over time as one still picture.
///
/// Curves, vectors, weights, motions (a1, a2, a3, a4, dx, dy) and time maps, one line a number, over the frames of their clock; over seconds where
/// their clocks run at different rates. A value that does not change is a level line.
#[derive(Node)]
#[node(
    id = "plot.curves",
    version = 1,
    kind = whole,
    outputs = PlotCurvesOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, fig. 3; Okabe, Ito 2008",
    example = "\"plot\": (type: \"plot.curves\", curves: [\"@track.motion\", \"@track.residual\"], names: [\"motion\", \"residual\"])"
)]
pub(crate) struct PlotCurves {
    /// What is plotted: values of up to 64 numbers each.
    #[input(any_clock)]
    curves: List<AnySequence>,
    /// A name for each, in their order; those without are called by their types.
    #[input(default = [])]
    names: Vec<String>,
    /// Above the plot.
    #[input(default = "")]
    title: String,
    /// Below the horizontal axis: frame, or seconds, where it is left out.
    #[input(default = None)]
    x_label: Option<String>,
    /// Along the vertical axis of each panel, from the top; the values' names where there are none.
    #[input(default = [])]
    y_labels: Vec<String>,
    /// Width and height.
    #[input(default = (960, 540), range = 1..=16384, unit = "px")]
    size: [i64; 2],
    /// How curves share axes.
    #[input(default = stacked)]
    layout: Layout,
    /// Ends of the vertical axis, of all panels. Fitted to the values where it is left out.
    #[input(default = None)]
    y_range: Option<[f64; 2]>,
    /// Holds to shade: every second run of frames that show one source frame.
    holds: Option<In<TimeMap>>,
    /// Name the lines beside their panel.
    #[input(default = true)]
    legend: bool,
    /// Colours of the lines in turn, as seen on screen. Seven that all kinds of sight tell apart where it is left out.
    #[input(default = [], range = 0.0..=1.0)]
    colors: Vec<[f64; 3]>,
    /// Width of the lines.
    #[input(default = 2.0, range = 0.1..=100.0, unit = "px")]
    line_width: f64,
    /// Diameter of a dot at each value. 0 draws none.
    #[input(default = 0.0, range = 0.0..=100.0, unit = "px")]
    point_size: f64,
    /// Height of a capital.
    #[input(default = 9.0, range = 4.0..=200.0, unit = "px")]
    text_size: f64,
}

/// The plot, and where its axes are.
#[derive(Outputs)]
pub(crate) struct PlotCurvesOutputs {
    /// It: four channels, linear light, opaque.
    image: Image,
    /// Left, top, right and bottom of the panels in pixels, the ends of the horizontal axis, and its units a frame: what `plot.playhead` needs.
    axes: Vector,
}

/// The horizontal axis: frames, or seconds where clocks differ.
struct Across {
    seconds: bool,
    span: [f64; 2],
}

impl Across {
    fn new(clocks: &[&Clock]) -> Self {
        let ratio = |c: &Clock| u64::from(c.fps.0) * u64::from(clocks[0].fps.1) == u64::from(clocks[0].fps.0) * u64::from(c.fps.1);
        let seconds = !clocks.iter().all(|c| ratio(c));
        let mut across = Self { seconds, span: [f64::INFINITY, f64::NEG_INFINITY] };
        for clock in clocks {
            let [first, last] = [clock.first, clock.last].map(|f| across.at(clock, f as f64));
            across.span = [across.span[0].min(first), across.span[1].max(last)];
        }
        if across.span[0] >= across.span[1] {
            across.span = [across.span[0] - 0.5, across.span[0] + 0.5];
        }
        across
    }

    fn at(&self, clock: &Clock, frame: f64) -> f64 {
        if self.seconds { frame / clock.rate() } else { frame }
    }
}

/// Every second run of equal source frames, from half a frame before its first to half a frame after its last.
fn bands(map: &TimeMap, first: i64) -> Vec<[f64; 2]> {
    let mut start = 0;
    let mut out = Vec::new();
    for (number, run) in map.source_frames.chunk_by(|a, b| a == b).enumerate() {
        let end = start + run.len();
        if number % 2 == 1 {
            out.push([start, end].map(|k| first as f64 + k as f64 - 0.5));
        }
        start = end;
    }
    out
}

impl PlotCurves {
    fn gathered<'a>(&'a self, cx: &'a Context<'_>) -> Result<Vec<(Group, &'a Clock)>, NodeError> {
        let sequences = &self.curves.0;
        if self.names.len() > sequences.len() {
            let found = format!("expected at most one name for each of {} curves, found {}", sequences.len(), self.names.len());
            return Err(NodeError::new(Fault::Parameters, found));
        }
        let mut out = Vec::new();
        for (i, sequence) in sequences.iter().enumerate() {
            cx.check()?;
            let name = self.names.get(i).map(String::as_str).filter(|n| !n.is_empty());
            let clock = sequence.clock().unwrap_or(cx.clock);
            out.extend(groups(sequence, name)?.into_iter().map(|g| (g, clock)));
        }
        if out.is_empty() {
            return Err(NodeError::input("expected at least one curve, found none"));
        }
        Ok(out)
    }

    /// The lines of a group; their colours count on from `number`.
    fn series(&self, group: Group, clock: &Clock, across: &Across, number: usize) -> Vec<Series> {
        let lines = group.curves.into_iter().enumerate();
        lines
            .map(|(i, (name, mut y))| {
                let frames = |n: usize| (0..n).map(|k| across.at(clock, clock.first as f64 + k as f64)).collect();
                let x: Vec<f64> = match y[..] {
                    [level] if !group.spans && clock.len() > 1 => {
                        y = vec![level; 2];
                        across.span.to_vec()
                    }
                    _ => frames(y.len()),
                };
                let inside = x.iter().take_while(|x| **x <= across.span[1]).count();
                y.truncate(inside);
                Series { name, x: x[..inside].to_vec(), y, colour: cycled(&self.colors, &ON_WHITE, number + i) }
            })
            .collect()
    }

    fn panels(&self, gathered: Vec<(Group, &Clock)>, across: &Across) -> Vec<Panel> {
        let mut panels: Vec<Panel> = Vec::new();
        let several = gathered.len() > 1;
        for (group, clock) in gathered {
            let label = self.y_labels.get(panels.len()).unwrap_or(&group.label).clone();
            match panels.last_mut() {
                Some(panel) if self.layout == Layout::Overlaid => {
                    let series = self.series(group, clock, across, panel.series.len());
                    panel.series.extend(series);
                }
                _ => panels.push(Panel { label, series: self.series(group, clock, across, 0), range: self.y_range }),
            }
        }
        // One axis for several values is only called what the graph calls it.
        if self.layout == Layout::Overlaid && several {
            panels.iter_mut().for_each(|p| p.label = self.y_labels.first().cloned().unwrap_or_default());
        }
        panels
    }

    fn plot(&self, cx: &Context) -> Result<(Plot, f64), NodeError> {
        let gathered = self.gathered(cx)?;
        let clocks: Vec<&Clock> = gathered.iter().map(|(_, c)| *c).collect();
        let across = Across::new(&clocks);
        let own = cx.clock;
        let bands = self.holds.as_ref().map_or_else(Vec::new, |h| bands(h, own.first));
        let plot = Plot {
            title: self.title.clone(),
            x_label: self.x_label.clone().unwrap_or_else(|| if across.seconds { "seconds" } else { "frame" }.to_owned()),
            span: across.span,
            x_step: if across.seconds { 0.0 } else { 1.0 },
            bands: bands.into_iter().map(|b| b.map(|f| across.at(own, f))).collect(),
            panels: self.panels(gathered, &across),
            legend: self.legend,
            text: within("text_size", self.text_size, 4.0, 200.0)?,
            width: within("line_width", self.line_width, 0.1, 100.0)?,
            dots: within("point_size", self.point_size, 0.0, 100.0)?,
        };
        Ok((plot, across.at(own, 1.0)))
    }
}

impl Whole for PlotCurves {
    fn run(self, cx: &Context) -> Result<PlotCurvesOutputs, NodeError> {
        let (plot, unit) = self.plot(cx)?;
        let window = Window::from_bounds(0, 0, self.size[0], self.size[1]);
        let mut samples = blank(window)?;
        let area = draw(&plot, &mut samples, window.width, window.height);
        let [left, top, right, bottom] = area.map_err(|e| NodeError::new(Fault::Parameters, e.to_string()))?;
        let image = drawing(window, window, samples)?.image;
        Ok(PlotCurvesOutputs { image, axes: Vector { values: vec![left, top, right, bottom, plot.span[0], plot.span[1], unit] } })
    }

    fn check(&self) -> Vec<Problem> {
        match self.y_range {
            Some([low, high]) if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) => {
                vec![Problem { input: "y_range", message: format!("expected the lower end first, found {low} and {high}") }]
            }
            _ => Vec::new(),
        }
    }
}
