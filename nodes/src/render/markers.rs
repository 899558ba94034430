//! `render.markers`: labelled markers drawn over a picture, sets beside each other, with limbs, names and the distances between them.
//!
//! **Method** see [`crate::algo::marker_overlay`]: exact coverage, rims that show on any drawing, names that keep clear of each other.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, figures 4 to 6 (virtual markers on drawings, limbs aligned to them).
//!
//! A marker that is not seen (NaN) is not drawn: the limb over it is dashed, from the next marker inwards that is seen, and the legend counts it.
//!
//! **Fails when** a marker is infinite, a limb or a line between sets names what there is not; the error names it.
//!
//! **Cost** O(pixels + length of the lines + names squared).
//!
//! ```ron
//! "overlay": (type: "render.markers", background: "@drawn", markers: ["@markers", "@lifted"], labels: ["drawn", "lifted"], errors: [("drawn", "lifted")]),
//! ```

use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame, Problem};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::{Node, Setting};

use super::{Drawing, blank, cycled, drawing, faded, laid, rgba, screen, within};
use crate::algo::grid::ON_FOOTAGE;
use crate::algo::marker_overlay::{Corner, Errors, MarkerSet, MarkerShape, Overlay, SHAPES, draw};
use crate::algo::markers::standard::limbs as standard_limbs;
use crate::algo::window::Window;
use crate::data::{Image, Markers2};
use crate::lift::Limbs;

/// Shapes of markers, one a set.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shapes(Vec<MarkerShape>);

impl Setting for Shapes {
    fn type_name() -> String {
        "list of marker shapes (dot, ring, cross, square)".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let found = parse_slice(text, Extensions::empty()).map(Self);
        found.map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
}

/// Sets between which lines are drawn, by their labels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SetPairs(Vec<(String, String)>);

impl Setting for SetPairs {
    fn type_name() -> String {
        "list of pairs of sets (\"from\", \"to\")".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let found = parse_slice(text, Extensions::empty()).map(Self);
        found.map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
}

/// Whose names are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Names {
    /// Nobody's.
    None,
    /// Each name once, beside the first set that shows its marker.
    First,
    /// Those of all sets.
    All,
}

/// Labelled markers drawn over a picture.
///
/// Colours are given as seen on screen, 0 to 1. Sets go together by the names of their markers, those without names by their order.
#[derive(Node)]
#[node(
    id = "render.markers",
    version = 1,
    outputs = Drawing,
    source = "Jain, Sheikh, Hodgins 2009, figs. 4 to 6",
    example = "\"overlay\": (type: \"render.markers\", background: \"@drawn\", markers: [\"@markers\", \"@lifted\"], labels: [\"drawn\", \"lifted\"], errors: [(\"drawn\", \"lifted\")])"
)]
pub(crate) struct RenderMarkers {
    /// Sets of markers, pixels of the format; the first lies at the bottom.
    markers: List<In<Markers2>>,
    /// What the legend calls each set, in their order; those without are left out of it.
    #[input(default = [])]
    labels: Vec<String>,
    /// What is drawn on.
    background: Option<In<Image>>,
    /// Width and height without a background.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// Red, green, blue and opacity of the ground without a background.
    #[input(default = (0.0, 0.0, 0.0, 0.0), range = 0.0..=1.0)]
    background_color: [f64; 4],
    /// How far the background is faded to white, so that markers stand out.
    #[input(default = 0.0, range = 0.0..=1.0)]
    fade: f64,
    /// Colours of the sets in turn. Seven that all kinds of sight tell apart where it is left out.
    #[input(default = [], range = 0.0..=1.0)]
    colors: Vec<[f64; 3]>,
    /// Shapes of the markers of each set in turn. Dots, rings, crosses, squares where it is left out.
    #[input(default = [])]
    shapes: Shapes,
    /// Size of a marker.
    #[input(default = 7.0, range = 0.5..=1000.0, unit = "px")]
    point_size: f64,
    /// Limbs, each by the names of the markers where it begins and ends; those of which a set has no marker are left out. The standard ones where it is left
    /// out.
    #[input(default = None)]
    limbs: Option<Limbs>,
    /// Width of the limbs. 0 draws none.
    #[input(default = 1.5, range = 0.0..=1000.0, unit = "px")]
    limb_width: f64,
    /// The marker that is brought in all sets to where the first has it, so that poses are compared rather than places. Sets stay where they are where it is
    /// left out, or not seen.
    #[input(default = None)]
    root: Option<String>,
    /// Whose names are written.
    #[input(default = none)]
    names: Names,
    /// Sets, by their labels, between which a line joins each marker to its like; the legend says how long they are.
    #[input(default = [])]
    errors: SetPairs,
    /// Width of these lines.
    #[input(default = 1.5, range = 0.1..=1000.0, unit = "px")]
    error_width: f64,
    /// Where the legend stands: what each set is called, and how many of its markers are not seen or outside the picture.
    #[input(default = top_left)]
    legend: Corner,
    /// Height of a capital.
    #[input(default = 9.0, range = 4.0..=200.0, unit = "px")]
    text_size: f64,
    /// Opacity of all that is drawn on the background.
    #[input(default = 1.0, range = 0.0..=1.0)]
    opacity: f64,
}

impl RenderMarkers {
    fn check_numbers(&self) -> Result<(), NodeError> {
        within("fade", self.fade, 0.0, 1.0)?;
        within("opacity", self.opacity, 0.0, 1.0)?;
        within("point_size", self.point_size, 0.5, 1000.0)?;
        within("limb_width", self.limb_width, 0.0, 1000.0)?;
        within("error_width", self.error_width, 0.1, 1000.0)?;
        within("text_size", self.text_size, 4.0, 200.0)?;
        Ok(())
    }

    /// What a set is called in errors.
    fn called(&self, k: usize) -> String {
        self.labels.get(k).filter(|l| !l.is_empty()).map_or(format!("set {k}"), |l| format!("set `{l}`"))
    }

    /// The window that is drawn in, and the ground in it, faded.
    fn ground(&self) -> Result<(Window, Vec<f32>), NodeError> {
        let window = match &self.background {
            Some(image) => image.display_window(),
            None => Window::from_bounds(0, 0, self.size[0], self.size[1]),
        };
        let mut samples = match &self.background {
            Some(image) => rgba(image, window)?,
            None => {
                let [r, g, b, a] = self.background_color;
                let colour = faded(screen([r, g, b]), a);
                let mut samples = blank(window)?;
                samples.chunks_exact_mut(4).for_each(|pixel| pixel.copy_from_slice(&colour));
                samples
            }
        };
        if self.fade > 0.0 {
            let white = vec![1.0; samples.len()];
            laid(&mut samples, &white, self.fade);
        }
        Ok((window, samples))
    }

    fn set(&self, k: usize, markers: &Markers2, origin: [f64; 2]) -> Result<MarkerSet, NodeError> {
        if let Some(at) = markers.points.iter().position(|p| p.iter().any(|v| v.is_infinite())) {
            let name = markers.names.get(at).map_or(format!("marker {at}"), |n| format!("marker {n:?}"));
            let [x, y] = markers.points[at];
            let message = format!("markers: {}, {name}: expected a place, or NaN where it is not seen, found ({x}, {y})", self.called(k));
            return Err(NodeError::input(message));
        }
        let limbs = match &self.limbs {
            Some(limbs) => limbs.0.iter().filter_map(|(from, to)| Some([markers.find(from)?, markers.find(to)?])).collect(),
            None => standard_limbs(&markers.names),
        };
        let shapes = if self.shapes.0.is_empty() { &SHAPES } else { self.shapes.0.as_slice() };
        Ok(MarkerSet {
            label: self.labels.get(k).cloned().unwrap_or_default(),
            points: markers.points.iter().map(|p| [p[0] - origin[0], p[1] - origin[1]]).collect(),
            names: markers.names.clone(),
            limbs,
            colour: cycled(&self.colors, &ON_FOOTAGE, k),
            shape: shapes[k % shapes.len()],
        })
    }

    /// A limb of which no set has both markers is a mistake rather than a gap.
    fn check_limbs(&self, markers: &[&Markers2]) -> Result<(), NodeError> {
        let has = |m: &&Markers2, name: &str| m.find(name).is_some();
        let limbs = self.limbs.iter().flat_map(|l| &l.0);
        let mut lost = limbs.filter(|(from, to)| !markers.iter().any(|m| has(m, from) && has(m, to)));
        match lost.next().filter(|_| !markers.is_empty()) {
            Some((from, to)) => {
                let message = format!("limbs: expected a set with markers {from:?} and {to:?}, found none");
                let names = markers.iter().flat_map(|m| m.names.iter().take(40)).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
                Err(NodeError::input(message).help(if names.is_empty() {
                    "the markers have no names".to_owned()
                } else {
                    format!("the markers are {names}")
                }))
            }
            None => Ok(()),
        }
    }

    /// Brings sets together by their roots.
    fn gather(&self, sets: &mut [MarkerSet]) -> Result<(), NodeError> {
        let Some(root) = self.root.as_ref().filter(|_| !sets.is_empty()) else { return Ok(()) };
        let places: Vec<Option<usize>> = sets.iter().map(|s| s.names.iter().position(|n| n == root)).collect();
        if places[0].is_none() {
            let message = format!("root: {}: expected a marker {root:?}, found none", self.called(0));
            return Err(NodeError::input(message));
        }
        let at = |set: &MarkerSet, k: Option<usize>| k.map(|k| set.points[k]).filter(|p| p.iter().all(|v| v.is_finite()));
        let Some(first) = at(&sets[0], places[0]) else { return Ok(()) };
        for (set, place) in sets.iter_mut().zip(places) {
            if let Some(own) = at(set, place) {
                set.points.iter_mut().for_each(|p| *p = [p[0] + first[0] - own[0], p[1] + first[1] - own[1]]);
            }
        }
        Ok(())
    }

    fn lines(&self, sets: &[MarkerSet]) -> Result<Vec<Errors>, NodeError> {
        let find = |label: &String| {
            let at = sets.iter().position(|s| s.label == *label && !label.is_empty());
            at.ok_or_else(|| {
                let there = sets.iter().filter(|s| !s.label.is_empty()).map(|s| format!("{:?}", s.label)).collect::<Vec<_>>().join(", ");
                let there = if there.is_empty() { "no set has a label".to_owned() } else { format!("the labels are {there}") };
                let message = format!("errors: expected labels of sets, found {label:?}");
                NodeError::new(Fault::Parameters, message).help(there)
            })
        };
        let one = |(from, to): &(String, String)| {
            let (a, b) = (find(from)?, find(to)?);
            let pairs = pairs(&sets[a], &sets[b]).map_err(|e| NodeError::input(format!("errors: {from:?} to {to:?}: {e}")))?;
            Ok(Errors { sets: [a, b], pairs })
        };
        self.errors.0.iter().map(one).collect()
    }

    fn named(&self, sets: &[MarkerSet]) -> Vec<[usize; 2]> {
        let mut written: Vec<&String> = Vec::new();
        let mut out = Vec::new();
        for (k, set) in sets.iter().enumerate().filter(|_| self.names != Names::None) {
            for (i, name) in set.names.iter().enumerate().filter(|(i, _)| set.points[*i].iter().all(|v| v.is_finite())) {
                if self.names == Names::All || !written.contains(&name) {
                    written.push(name);
                    out.push([k, i]);
                }
            }
        }
        out
    }
}

/// Positions of markers of one name, or all in their order where one set has no names.
fn pairs(from: &MarkerSet, to: &MarkerSet) -> Result<Vec<[usize; 2]>, String> {
    let (n, m) = (from.points.len(), to.points.len());
    if from.names.is_empty() || to.names.is_empty() {
        return if n == m {
            Ok((0..n).map(|k| [k; 2]).collect())
        } else {
            Err(format!("expected as many markers where a set has no names, found {n} and {m}"))
        };
    }
    let at = |name: &String| to.names.iter().position(|n| n == name);
    let pairs: Vec<[usize; 2]> = from.names.iter().enumerate().filter_map(|(i, name)| at(name).map(|j| [i, j])).collect();
    if pairs.is_empty() { Err("expected markers of the same names in both, found none".to_owned()) } else { Ok(pairs) }
}

impl PerFrame for RenderMarkers {
    fn run(self, _cx: &Context) -> Result<Drawing, NodeError> {
        self.check_numbers()?;
        let (window, mut samples) = self.ground()?;
        let origin = [window.x as f64, window.y as f64];
        let markers: Vec<&Markers2> = self.markers.0.iter().map(|m| &**m).collect();
        self.check_limbs(&markers)?;
        let mut sets = markers.iter().enumerate().map(|(k, m)| self.set(k, m, origin)).collect::<Result<Vec<_>, _>>()?;
        self.gather(&mut sets)?;
        let overlay = Overlay {
            errors: self.lines(&sets)?,
            named: self.named(&sets),
            sets,
            size: self.point_size,
            limb_width: self.limb_width,
            error_width: self.error_width,
            legend: self.legend,
            text: self.text_size,
        };
        let paint =
            |samples: &mut [f32]| draw(&overlay, samples, window.width, window.height).map_err(|e| NodeError::internal(e.to_string()));
        if self.opacity >= 1.0 {
            paint(&mut samples)?;
        } else {
            // What overlaps in the drawing must not show through itself, so that it is made by itself first.
            let mut layer = blank(window)?;
            paint(&mut layer)?;
            laid(&mut samples, &layer, self.opacity);
        }
        drawing(window, window, samples)
    }

    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        for (i, label) in self.labels.iter().enumerate().filter(|(_, l)| !l.is_empty()) {
            if self.labels[..i].contains(label) {
                problems.push(Problem { input: "labels", message: format!("expected one set of each label, found two {label:?}") });
            }
        }
        problems
    }
}

#[cfg(test)]
#[path = "markers_tests.rs"]
mod tests;
