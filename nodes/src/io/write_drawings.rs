//! `io.write_drawings`: vector drawings to SVG.
//!
//! One file a frame (`####` in the path), or one file in all: a single drawing as it is, a stream in a layer a frame, which browsers play. Numbers are
//! written in the fewest digits that read back to the same bits, colours in eight bits a channel. Groups and names of paths are kept as labels.
//!
//! **Source**: W3C, Scalable Vector Graphics 1.1. **Fails when** a point is not finite, or the value is none of drawings and shapes. **Cost**: O(points);
//! one file of a stream is in memory as it is written.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "in": (type: "io.read_drawings", path: "frog.####.svg"),
//!     "out": (type: "io.write_drawings", drawing: "@in", path: "$out/frog.svg"),
//! })
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnySequence, Context, Fault, NodeError, Problem, Whole};
use pegbar_engine::setting::OutputPath;
use pegbar_engine::value::{ValueRef, downcast};

use super::file;
use crate::algo::paint::FillRule;
use crate::algo::svg::{Frame, Outline, Playback, Style, write};
use crate::data::{Contour, Drawing, KeyDrawings, KeyShapes, Shape};

/// Writes vector drawings, or contours, to SVG.
#[derive(Node)]
#[node(
    id = "io.write_drawings",
    version = 1,
    kind = whole,
    source = "W3C, Scalable Vector Graphics 1.1",
    example = "\"out\": (type: \"io.write_drawings\", drawing: \"@frog\", path: \"$out/frog.####.svg\")"
)]
pub(crate) struct IoWriteDrawings {
    /// Drawings or shapes; key drawings or key shapes, which are a layer each.
    drawing: AnySequence,
    /// The file, inside the output folder, ending in .svg; with `####` or `%04d` for one file a frame.
    path: OutputPath,
    /// Width and height of the format. A drawing's own where it is left out; for shapes 640 by 360.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
    /// True where browsers play the layers of one file in turn; false shows the first.
    #[input(default = true)]
    animate: bool,
    /// Colour of shapes' lines, as seen on screen.
    #[input(default = (0.0, 0.0, 0.0), range = 0.0..=1.0)]
    stroke_color: [f64; 3],
    /// Width of shapes' lines. 0 draws none.
    #[input(default = 2.0, range = 0.0..=1000.0, unit = "px")]
    stroke_width: f64,
    /// Colour of closed shapes' insides. Left empty where it is left out.
    #[input(default = None, range = 0.0..=1.0)]
    fill_color: Option<[f64; 3]>,
}

impl Whole for IoWriteDrawings {
    fn check(&self) -> Vec<Problem> {
        let path = self.path.at(0);
        let message = || format!("expected a path ending in .svg, found {}", path.file_name().unwrap_or_default().to_string_lossy());
        let fine = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg"));
        if fine { Vec::new() } else { vec![Problem { input: "path", message: message() }] }
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let Some(clock) = self.drawing.clock() else {
            if self.path.is_sequence() {
                let message = "expected one value a frame for a path with ####, found one for the whole graph";
                return Err(NodeError::new(Fault::Parameters, message));
            }
            let layers = self.layers(self.drawing.get(0)?, None)?;
            return self.write(0, &layers, None);
        };
        let mut all = Vec::new();
        for (k, frame) in clock.frames().enumerate() {
            cx.check()?;
            let at = |e: NodeError| NodeError { message: format!("frame {frame}: {e}"), ..e };
            if self.path.is_sequence() {
                self.write(frame, &self.layers(self.drawing.get(k)?, None).map_err(at)?, None)?;
            } else {
                all.extend(self.layers(self.drawing.get(k)?, Some(frame)).map_err(at)?);
            }
        }
        if self.path.is_sequence() { Ok(()) } else { self.write(0, &all, self.animate.then_some(Playback { fps: clock.rate() })) }
    }
}

/// One drawing, and the name of the layer that it is written to.
type Layer = (Option<String>, Drawing);

impl IoWriteDrawings {
    /// The drawings of a value.
    fn layers(&self, value: ValueRef, frame: Option<i64>) -> Result<Vec<Layer>, NodeError> {
        let name = |k: usize, names: &[String]| {
            let own = names.get(k).filter(|n| !n.is_empty()).cloned().unwrap_or_else(|| format!("key {k}"));
            Some(frame.map_or(own.clone(), |f| format!("{f} {own}")))
        };
        let single = frame.map(|f| f.to_string());
        let layers = match value.type_name() {
            "Drawing" => downcast::<Drawing>(value).map(|d| vec![(single, (*d).clone())]),
            "Shape" => downcast::<Shape>(value).map(|s| vec![(single, self.shape(&s.points, s.closed))]),
            "KeyDrawings" => {
                downcast::<KeyDrawings>(value).map(|d| (0..d.len()).map(|k| (name(k, &d.keys), d.drawing(d.key(k).to_vec()))).collect())
            }
            "KeyShapes" => downcast::<KeyShapes>(value).map(|s| {
                let [k, n, _] = s.points.shape();
                let points = s.points.data().as_chunks::<2>().0;
                (0..k).map(|i| (name(i, &s.names), self.shape(&points[i * n..(i + 1) * n], s.closed))).collect()
            }),
            other => return Err(NodeError::input(format!("expected Drawing, Shape, KeyDrawings or KeyShapes, found {other}"))),
        };
        let layers: Vec<Layer> = layers.ok_or_else(|| NodeError::internal("a value of another type than its name"))?;
        layers.iter().try_for_each(|(_, d)| finite(d))?;
        Ok(layers)
    }

    fn shape(&self, points: &[[f64; 2]], closed: bool) -> Drawing {
        let opaque = |[r, g, b]: [f64; 3]| [r, g, b, 1.0];
        let stroke = if self.stroke_width > 0.0 { opaque(self.stroke_color) } else { [0.0; 4] };
        Drawing {
            points: points.to_vec(),
            contours: vec![points.len() as u32],
            closed: vec![u8::from(closed)],
            paths: vec![1],
            fill: vec![self.fill_color.filter(|_| closed).map_or([0.0; 4], opaque)],
            stroke: vec![stroke],
            width: vec![self.stroke_width],
            rule: vec![0],
            depth: vec![0.0],
            size: [640.0, 360.0],
            ..Drawing::default()
        }
    }

    fn write(&self, frame: i64, layers: &[Layer], playback: Option<Playback>) -> Result<(), NodeError> {
        let own = layers.first().map_or([640.0, 360.0], |(_, d)| d.size);
        let size = self.size.map_or(own, |s| s.map(|v| v as f64));
        let frames: Vec<Frame> = layers.iter().map(|(layer, d)| Frame { layer: layer.clone(), outlines: outlines(d) }).collect();
        let text = write(size, &frames, playback);
        file::write(&self.path.at(frame), Fault::Io, |out| std::io::Write::write_all(out, text.as_bytes()))
    }
}

/// That all numbers of a drawing can be written.
fn finite(drawing: &Drawing) -> Result<(), NodeError> {
    for (i, outline) in drawing.outlines().iter().enumerate() {
        let points = outline.iter().flat_map(|c| c.points).flatten();
        let mut numbers = points.chain(&drawing.fill[i]).chain(&drawing.stroke[i]).chain([&drawing.width[i], &drawing.depth[i]]);
        if let Some(found) = numbers.find(|v| !v.is_finite()) {
            return Err(NodeError::input(format!("{}: expected finite numbers, found {found}", drawing.name(i))));
        }
    }
    if drawing.size.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Ok(());
    }
    Err(NodeError::input(format!("expected a format of more than 0 pixels, found {} x {}", drawing.size[0], drawing.size[1])))
}

fn outlines(drawing: &Drawing) -> Vec<Outline<'_>> {
    drawing.outlines().into_iter().enumerate().map(|(i, contours)| outline(drawing, i, contours)).collect()
}

fn outline<'a>(drawing: &'a Drawing, i: usize, contours: Vec<Contour<'a>>) -> Outline<'a> {
    let rule = if drawing.rule[i] == 1 { FillRule::EvenOdd } else { FillRule::NonZero };
    Outline {
        name: drawing.names.get(i).map_or("", String::as_str),
        groups: drawing.groups.get(i).map_or(&[], Vec::as_slice),
        depth: drawing.depth[i],
        lines: contours.into_iter().map(|c| (c.points, c.closed)).collect(),
        style: Style { fill: drawing.fill[i], stroke: drawing.stroke[i], width: drawing.width[i].max(0.0), rule },
    }
}
