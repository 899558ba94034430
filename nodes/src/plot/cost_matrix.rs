//! `plot.cost_matrix`: how far each drawing is from each captured frame, and the path of a time warp through it.
//!
//! **Method** the distances that `retime.dtw` sums, row by row, each pixel the mean over its area ([`crate::algo::plot`]); path, retime, pins and what a band
//! shuts are drawn on them.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.3, equation 3; Sakoe and Chiba 1978, figure 1; Giorgino 2009 (density plot).
//!
//! A path that follows the dark valleys is a good warp; one that runs over a bright ridge is forced, by an end, a pin or a band. Level steps of the retime are
//! holds.
//!
//! **Fails when** the descriptors differ in size, or path, map or pins lie outside the clocks.
//!
//! **Cost** O(target · source frames · numbers); memory of the descriptors and the picture, however many frames there are.
//!
//! ```ron
//! "warp": (type: "plot.cost_matrix", target: "@drawn.angles", source: "@captured.angles", path: "@time.path", map: "@time.map"),
//! ```

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Context, Fault, In, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::value::{Curve, TimeMap, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::dtw::{Band, BandShape, Costs, Metric, Options, Series, allowed, comparable};
use crate::algo::plot::{MatrixPlot, PlotError, Ramp, Shrunk, draw_matrix, matrix_area};
use crate::algo::window::Window;
use crate::data::{Image, WarpPath};
use crate::render::{blank, drawing, within};
use crate::time::{position, series};

/// How far each drawing is from each captured frame, and the path of a time warp through it.
///
/// Drawings run to the right, captured frames upwards. Give it what `retime.dtw` is given, and its path and map.
#[derive(Node)]
#[node(
    id = "plot.cost_matrix",
    version = 1,
    kind = whole,
    outputs = PlotCostMatrixOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.3, eq. 3; Giorgino 2009",
    example = "\"warp\": (type: \"plot.cost_matrix\", target: \"@drawn.angles\", source: \"@captured.angles\", path: \"@time.path\", map: \"@time.map\")"
)]
pub(crate) struct PlotCostMatrix {
    /// Descriptors of the drawings. NaN counts nothing.
    target: Sequence<Vector>,
    /// Descriptors of the capture, on any clock. NaN counts nothing.
    #[input(any_clock)]
    source: Sequence<Vector>,
    /// How far two descriptors are from each other.
    #[input(default = angle)]
    metric: Metric,
    /// Weight of each number of the target.
    target_weights: Option<Sequence<Vector>>,
    /// Weight of each number of the source.
    #[input(any_clock)]
    source_weights: Option<Sequence<Vector>>,
    /// The path: what `retime.dtw` found.
    path: Option<In<WarpPath>>,
    /// The retime that was made of it: a second line, level where a drawing is held.
    map: Option<In<TimeMap>>,
    /// How many source frames the path may be off the diagonal; what is shut is veiled.
    #[input(default = None, range = 0.0..=1000000.0, unit = "frames")]
    band: Option<f64>,
    /// The diagonal of a band.
    #[input(default = slanted)]
    band_shape: BandShape,
    /// Pairs of target and source frame that go together: squares, and what they shut is veiled.
    #[input(default = [])]
    pins: Vec<[f64; 2]>,
    /// Above the plot.
    #[input(default = "")]
    title: String,
    /// Below the horizontal axis.
    #[input(default = "target frame")]
    x_label: String,
    /// Along the vertical axis.
    #[input(default = "source frame")]
    y_label: String,
    /// Width and height.
    #[input(default = (720, 600), range = 1..=16384, unit = "px")]
    size: [i64; 2],
    /// Colours of near and far.
    #[input(default = viridis)]
    ramp: Ramp,
    /// Distances at the ends of the colours. The least and the greatest where it is left out.
    #[input(default = None)]
    range: Option<[f64; 2]>,
    /// Width of the lines.
    #[input(default = 2.0, range = 0.1..=100.0, unit = "px")]
    line_width: f64,
    /// Height of a capital.
    #[input(default = 9.0, range = 4.0..=200.0, unit = "px")]
    text_size: f64,
}

/// The plot, where its axes are, and how far the path is off.
#[derive(Outputs)]
pub(crate) struct PlotCostMatrixOutputs {
    /// It: four channels, linear light, opaque.
    image: Image,
    /// Left, top, right and bottom of the matrix in pixels, the ends of the horizontal axis, and its units a frame: what `plot.playhead` needs.
    axes: Vector,
    /// At each target frame: the mean distance of its pairs of the path; NaN where there is none.
    distance: Stream<Curve>,
}

/// Distances along the path.
#[derive(Default)]
struct Along {
    /// Sum and number of each target frame.
    rows: Vec<(f64, usize)>,
    largest: Option<(f64, [usize; 2])>,
}

impl Along {
    fn add(&mut self, [i, j]: [usize; 2], distance: f64) {
        self.rows[i].0 += distance;
        self.rows[i].1 += 1;
        if self.largest.is_none_or(|(most, _)| distance > most) {
            self.largest = Some((distance, [i, j]));
        }
    }

    /// Mean and largest in words.
    fn caption(&self, unit: &str, first: [i64; 2]) -> String {
        let (sum, count) = self.rows.iter().fold((0.0, 0), |(s, n), r| (s + r.0, n + r.1));
        let Some((most, [i, j])) = self.largest else { return "path: no distance known".to_owned() };
        let (frame, source) = (first[0] + i as i64, first[1] + j as i64);
        format!("path: mean {:.3}{unit}, largest {most:.3}{unit} at ({frame}, {source})", sum / count as f64)
    }
}

impl PlotCostMatrix {
    /// Positions of the path's pairs, in their order.
    fn pairs(&self, [target, source]: [&Clock; 2], [n, m]: [usize; 2]) -> Result<Vec<[usize; 2]>, NodeError> {
        let Some(path) = &self.path else { return Ok(Vec::new()) };
        let pair = |p: &[i64; 2]| {
            let at = |clock: &Clock, frame: i64, count: usize| clock.index(frame).filter(|k| *k < count);
            at(target, p[0], n).zip(at(source, p[1], m)).map(|(i, j)| [i, j]).ok_or_else(|| {
                let ends = |c: &Clock, count: usize| format!("{} to {}", c.first, c.first + count as i64 - 1);
                NodeError::input(format!(
                    "path: expected pairs of target frames {} and source frames {}, found ({}, {})",
                    ends(target, n),
                    ends(source, m),
                    p[0],
                    p[1]
                ))
            })
        };
        path.pairs.data().as_chunks::<2>().0.iter().map(pair).collect()
    }

    /// The source frame of each target frame, from 0.
    fn retime(&self, n: usize, source: &Clock) -> Result<Vec<f64>, NodeError> {
        let Some(map) = &self.map else { return Ok(Vec::new()) };
        let frames = &map.source_frames;
        if frames.len() < n {
            return Err(NodeError::input(format!("map: expected a source frame for each of {n} target frames, found {}", frames.len())));
        }
        if let Some(k) = frames[..n].iter().position(|f| !f.is_finite()) {
            return Err(NodeError::input(format!("map: expected source frames, found {} at position {k}", frames[k])));
        }
        Ok(frames[..n].iter().map(|f| f - source.first as f64).collect())
    }

    fn plot(&self, first: [i64; 2]) -> Result<MatrixPlot, NodeError> {
        let unit = if self.metric == Metric::Angle { "distance, rad" } else { "distance" };
        Ok(MatrixPlot {
            title: self.title.clone(),
            labels: [self.x_label.clone(), self.y_label.clone()],
            unit: unit.to_owned(),
            // Room for it is left whatever it will say.
            caption: if self.path.is_some() { "path".to_owned() } else { String::new() },
            first,
            ramp: self.ramp,
            range: self.range,
            path: Vec::new(),
            map: Vec::new(),
            pins: Vec::new(),
            window: Vec::new(),
            text: within("text_size", self.text_size, 4.0, 200.0)?,
            width: within("line_width", self.line_width, 0.1, 100.0)?,
        })
    }
}

/// Row by row into a picture of `size`, and what the path, in any order, passes through.
fn shrink(cx: &Context, costs: &Costs, counts: [usize; 2], size: [usize; 2], path: &[[usize; 2]]) -> Result<(Shrunk, Along), NodeError> {
    let (mut shrunk, mut row) = (Shrunk::new(counts, size), vec![0.0; counts[1]]);
    let mut along = Along { rows: vec![(0.0, 0); counts[0]], largest: None };
    let mut cells = path.to_vec();
    cells.sort_unstable();
    let mut cells = cells.into_iter().peekable();
    for i in 0..counts[0] {
        cx.check()?;
        costs.row(i, 0, &mut row);
        shrunk.add(i, &row);
        while let Some(cell) = cells.next_if(|c| c[0] == i) {
            if row[cell[1]].is_finite() {
                along.add(cell, row[cell[1]]);
            }
        }
    }
    Ok((shrunk, along))
}

fn refused(error: PlotError) -> NodeError {
    NodeError::new(Fault::Parameters, error.to_string())
}

impl Whole for PlotCostMatrix {
    fn run(self, cx: &Context) -> Result<PlotCostMatrixOutputs, NodeError> {
        let target: Series = series(&self.target, self.target_weights.as_ref(), "target")?;
        let source: Series = series(&self.source, self.source_weights.as_ref(), "source")?;
        comparable(&target, &source).map_err(|e| NodeError::input(e.to_string()))?;
        let clocks = [self.target.clock().unwrap_or(cx.clock), self.source.clock().unwrap_or(cx.clock)];
        let (counts, first) = ([target.len(), source.len()], clocks.map(|c| c.first));
        let pin = |p: &[f64; 2]| Ok([position(clocks[0], p[0], "target")?, position(clocks[1], p[1], "source")?]);
        let pins = self.pins.iter().map(pin).collect::<Result<Vec<_>, NodeError>>()?;
        let band = self.band.map(|width| Band { shape: self.band_shape, width });
        let is_narrow = band.is_some() || !pins.is_empty();
        let options = Options { band, pins, ..Options::default() };
        let window =
            if is_narrow { allowed(counts[0], counts[1], &options).map_err(|e| NodeError::input(e.to_string()))? } else { Vec::new() };
        let pairs = self.pairs(clocks, counts)?;
        let middle = |p: &[usize; 2]| p.map(|v| v as f64);
        let mut plot = MatrixPlot {
            path: pairs.iter().map(middle).collect(),
            map: self.retime(counts[0], clocks[1])?,
            pins: options.pins.iter().map(middle).collect(),
            window,
            ..self.plot(first)?
        };
        let picture = Window::from_bounds(0, 0, self.size[0], self.size[1]);
        let area = matrix_area(&plot, counts, picture.width, picture.height).map_err(refused)?;
        let mut samples = blank(picture)?;
        let size = [area[2] - area[0], area[3] - area[1]].map(|v| v as usize);
        let (shrunk, along) = shrink(cx, &Costs::new(&target, &source, self.metric), counts, size, &pairs)?;
        if self.path.is_some() {
            plot.caption = along.caption(if self.metric == Metric::Angle { " rad" } else { "" }, first);
        }
        draw_matrix(&plot, &shrunk, &mut samples, picture.width, picture.height).map_err(refused)?;
        let mut distance: Vec<Curve> =
            along.rows.iter().map(|(s, n)| Curve { value: if *n > 0 { s / *n as f64 } else { f64::NAN } }).collect();
        // A single descriptor stands for every frame of the clock.
        if let Some(last) = distance.last().cloned() {
            distance.resize(cx.clock.len().max(distance.len()), last);
        }
        let ends = [first[0] as f64 - 0.5, first[0] as f64 + counts[0] as f64 - 0.5];
        let axes = area.into_iter().chain(ends).chain([1.0]).collect();
        Ok(PlotCostMatrixOutputs {
            image: drawing(picture, picture, samples)?.image,
            axes: Vector { values: axes },
            distance: Stream(distance),
        })
    }

    fn check(&self) -> Vec<Problem> {
        match self.range {
            Some([low, high]) if low.partial_cmp(&high) != Some(std::cmp::Ordering::Less) => {
                vec![Problem { input: "range", message: format!("expected the lower end first, found {low} and {high}") }]
            }
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
#[path = "cost_matrix_tests.rs"]
mod tests;
