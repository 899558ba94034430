//! `curve.trace`: curves of a drawing between anchors.
//!
//! **Method** a live-wire, the cheapest path along the ink, which no dead end and no blot can hold; then a snake with its ends fixed at the anchors settles on
//! the line to a fraction of a pixel ([`crate::algo::curve_trace`]).
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2; Mortensen, Barrett 1995; Kass, Witkin, Terzopoulos 1988.
//!
//! **Fails when** an anchor lies outside of the picture or without ink around; a path takes the wrong one of two lines that cross, or
//! cuts across paper where a line goes a long way round (`least_on_ink`): another anchor says which.
//!
//! **Cost** O(pixels), and O(w log w) for each pair of anchors with w pixels in their window.
//!
//! ```ron
//! "leg": (type: "curve.trace", image: "@drawing", anchors: [(212.0, 140.0), (240.0, 310.0), (198.0, 330.0)]),
//! ```

use pegbar_engine::node::{Context, Fault, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use crate::algo::color::linear_from_srgb;
use crate::algo::curve_trace::{Along, Ink, InkStyle, Method, Options, Snake, TraceError, Traced, trace};
use crate::data::{Curves, Image, Markers2};
use crate::render::{rgba, within};

/// Curves of a drawing between anchors.
#[derive(Node)]
#[node(
    id = "curve.trace",
    version = 2,
    outputs = CurveTraceOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.2; Mortensen, Barrett 1995; Kass, Witkin, Terzopoulos 1988",
    example = "\"leg\": (type: \"curve.trace\", image: \"@drawing\", anchors: [(212.0, 140.0), (240.0, 310.0), (198.0, 330.0)])"
)]
pub(crate) struct CurveTrace {
    /// The drawing: ink on paper, a painted figure, or lines on nothing.
    pub(crate) image: In<Image>,
    /// Places that the curve goes through, in their order, pixels of the format.
    #[input(default = [], unit = "px")]
    pub(crate) anchors: Vec<[f64; 2]>,
    /// The same as markers, after those; what is not seen is left out.
    pub(crate) markers: Option<In<Markers2>>,
    /// How the curve is found.
    #[input(default = both)]
    pub(crate) method: Method,
    /// What of the ink the curve is.
    #[input(default = center)]
    pub(crate) along: Along,
    /// Go on from the last anchor to the first.
    #[input(default = false)]
    pub(crate) closed: bool,
    /// Colour of the ink as seen on screen. Whatever is darker than the paper where it is left out.
    #[input(default = None, range = 0.0..=1.0)]
    pub(crate) ink_color: Option<[f64; 3]>,
    /// Colour of the paper as seen on screen. The most frequent one where it is left out, white below what is transparent.
    #[input(default = None, range = 0.0..=1.0)]
    pub(crate) paper_color: Option<[f64; 3]>,
    /// As much ink counts as ink: 0 paper, 1 solid ink. Small takes pencil in, large leaves smudges out.
    #[input(default = 0.4, range = 0.01..=0.99)]
    pub(crate) threshold: f64,
    /// Width of the line. Measured along the way where it is left out.
    #[input(default = None, range = 0.5..=64.0, unit = "px")]
    pub(crate) width: Option<f64>,
    /// How far an anchor may be moved to the ink. 0 leaves anchors where they are.
    #[input(default = 8.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) snap: f64,
    /// How far the curve may leave the box of two anchors. Small is quick, large finds long ways round.
    #[input(default = 64.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) margin: f64,
    /// How much the snake resists being stretched.
    #[input(default = 0.002, range = 0.0..=1000.0)]
    pub(crate) alpha: f64,
    /// How much it resists being bent. 0 keeps corners, large evens the pencil's tremble out and carries bends across gaps.
    #[input(default = 1.0, range = 0.0..=1000.0)]
    pub(crate) beta: f64,
    /// Its inertia. Small is quick and may swing, large is slow.
    #[input(default = 1.0, range = 0.1..=1000.0)]
    pub(crate) gamma: f64,
    /// Most steps of the snake. 0 leaves the curve as it was found.
    #[input(default = 200, range = 0..=100000)]
    pub(crate) iterations: u32,
    /// Share of the curve between two anchors that is to lie on ink. 0 lets curves go over paper.
    #[input(default = 0.2, range = 0.0..=1.0)]
    pub(crate) least_on_ink: f64,
}

/// The curve, and how well it lies on the ink.
#[derive(Outputs)]
pub(crate) struct CurveTraceOutputs {
    /// One drawn curve, its points about a pixel apart.
    pub(crate) curves: Curves,
    /// The anchors where they came to lie.
    pub(crate) anchors: Markers2,
    /// Share of the curve that lies on ink, 0 to 1: less than 1 where it bridges gaps.
    pub(crate) on_ink: Curve,
    /// Width of the line, pixels.
    pub(crate) line_width: Curve,
}

fn linear(color: Option<[f64; 3]>) -> Option<[f64; 3]> {
    color.map(|c| c.map(linear_from_srgb))
}

/// The ink of a picture, over all of its format.
pub(crate) fn ink_of(image: &Image, style: &InkStyle) -> Result<Ink, NodeError> {
    let window = image.display_window();
    Ok(Ink::new(&rgba(image, window)?, window.width, style))
}

impl CurveTrace {
    fn places(&self) -> (Vec<[f64; 2]>, Vec<String>) {
        let mut places = self.anchors.clone();
        let mut names: Vec<String> = (1..=places.len()).map(|n| n.to_string()).collect();
        if let Some(markers) = &self.markers {
            for (i, p) in markers.points.iter().enumerate().filter(|(_, p)| p.iter().all(|v| !v.is_nan())) {
                places.push(*p);
                names.push(markers.names.get(i).cloned().unwrap_or_else(|| (names.len() + 1).to_string()));
            }
        }
        (places, names)
    }

    fn options(&self) -> Options {
        Options {
            method: self.method,
            along: self.along,
            width: self.width,
            threshold: self.threshold,
            snap: self.snap,
            margin: self.margin,
            snake: Snake { alpha: self.alpha, beta: self.beta, gamma: self.gamma, iterations: self.iterations },
            closed: self.closed,
            least_on_ink: self.least_on_ink,
        }
    }

    fn check_numbers(&self) -> Result<(), NodeError> {
        within("threshold", self.threshold, 0.01, 0.99)?;
        within("least_on_ink", self.least_on_ink, 0.0, 1.0)?;
        within("snap", self.snap, 0.0, 65536.0)?;
        within("margin", self.margin, 0.0, 65536.0)?;
        within("alpha", self.alpha, 0.0, 1000.0)?;
        within("beta", self.beta, 0.0, 1000.0)?;
        within("gamma", self.gamma, 0.1, 1000.0)?;
        within("width", self.width.unwrap_or(1.0), 0.5, 64.0)?;
        Ok(())
    }
}

impl PerFrame for CurveTrace {
    fn run(self, _cx: &Context) -> Result<CurveTraceOutputs, NodeError> {
        self.check_numbers()?;
        let style = InkStyle { ink: linear(self.ink_color), paper: linear(self.paper_color), threshold: self.threshold };
        let ink = ink_of(&self.image, &style)?;
        let (places, names) = self.places();
        let origin = [self.image.display_window().x as f64, self.image.display_window().y as f64];
        let places: Vec<[f64; 2]> = places.iter().map(|p| [p[0] - origin[0], p[1] - origin[1]]).collect();
        let Traced { mut points, mut anchors, on_ink, width, .. } = trace(&ink, &places, &self.options()).map_err(|e| {
            let help = match e {
                TraceError::OffInk { .. } => "set an anchor on the line between them, or a wider `margin`; `least_on_ink: 0` lets it be",
                _ => "anchors are pixels of the format; `snap` says how far they may be off, `threshold` what is ink",
            };
            NodeError::new(Fault::Input, e.to_string()).help(help)
        })?;
        points.iter_mut().chain(&mut anchors).for_each(|p| *p = [p[0] + origin[0], p[1] + origin[1]]);
        let mut curves = Curves::default();
        curves.push_drawn(points, self.closed);
        let unique = names.iter().collect::<std::collections::BTreeSet<_>>().len() == names.len();
        let anchors = Markers2 { points: anchors, names: if unique { names } else { Vec::new() } };
        Ok(CurveTraceOutputs { curves, anchors, on_ink: Curve { value: on_ink }, line_width: Curve { value: width } })
    }
}
