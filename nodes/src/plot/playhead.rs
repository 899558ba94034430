//! `plot.playhead`: a line on a plot at the frame that is shown.
//!
//! **Method** the frame's place along the axes that `plot.curves` gives.
//!
//! **Source** usual practice.
//!
//! **Fails when** `axes` is not what `plot.curves` gives.
//!
//! **Cost** O(samples), to copy the plot.
//!
//! ```ron
//! "now": (type: "plot.playhead", image: "@plot", axes: "@plot.axes"),
//! ```

use kurbo::Point;
use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Vector;

use crate::algo::grid::polyline;
use crate::algo::paint::{Canvas, FillRule};
use crate::data::Image;
use crate::render::{Drawing, drawing, rgba, screen, within};

/// A line on a plot at the frame that is shown.
#[derive(Node)]
#[node(
    id = "plot.playhead",
    version = 1,
    uses_frame,
    outputs = Drawing,
    example = "\"now\": (type: \"plot.playhead\", image: \"@plot\", axes: \"@plot.axes\")"
)]
pub(crate) struct PlotPlayhead {
    /// The plot.
    image: In<Image>,
    /// Where its axes are: the output `axes` of `plot.curves`.
    axes: In<Vector>,
    /// Colour of the line, as seen on screen.
    #[input(default = (0.8, 0.1, 0.15), range = 0.0..=1.0)]
    color: [f64; 3],
    /// Width of the line.
    #[input(default = 1.5, range = 0.1..=100.0, unit = "px")]
    width: f64,
}

impl PerFrame for PlotPlayhead {
    fn run(self, cx: &Context) -> Result<Drawing, NodeError> {
        let [left, top, right, bottom, first, last, unit] = self.axes.values[..] else {
            let found = format!("expected the seven numbers of plot.curves' output `axes`, found {}", self.axes.values.len());
            return Err(NodeError::input(found));
        };
        let half = within("width", self.width, 0.1, 100.0)? / 2.0;
        let share = (cx.frame as f64 * unit - first) / (last - first);
        let window = self.image.data_window();
        let mut samples = rgba(&self.image, window)?;
        if (0.0..=1.0).contains(&share) {
            let x = left + (right - left) * share;
            let mut canvas = Canvas::new(&mut samples, window.width, window.height).map_err(|e| NodeError::internal(e.to_string()))?;
            let corners = [(x - half, top), (x + half, top), (x + half, bottom), (x - half, bottom)].map(Point::from);
            canvas.fill(&polyline(&corners, true), FillRule::NonZero, screen(self.color));
            let handle = [(x, top), (x - 4.0 * half, top - 6.0 * half), (x + 4.0 * half, top - 6.0 * half)].map(Point::from);
            canvas.fill(&polyline(&handle, true), FillRule::NonZero, screen(self.color));
        }
        drawing(window, self.image.display_window(), samples)
    }
}
