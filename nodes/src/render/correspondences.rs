//! `render.correspondences`: lines of a mesh, curves of a drawing and what belongs together, to be looked at and to set anchors by.
//!
//! **Method** pen lines and dots over the render and the drawing, side by side or on each other; rulers of pixels along their edges.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, figure 5.
//!
//! **Fails when** pairs name a vertex that the mesh has not.
//!
//! **Cost** O(pixels + length of the lines).
//!
//! ```ron
//! "look": (type: "render.correspondences", render: "@toon.image", drawing: "@drawing", silhouette: "@lines.curves", drawn: "@leg.curves", pairs: "@pairs", mesh: "@skin", camera: "@camera"),
//! ```

use kurbo::{Affine, BezPath, Point};
use pegbar_engine::node::{Context, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Setting};

use super::{Drawing, blank, drawing, rgba, seen_by, within};
use crate::algo::grid::{ON_FOOTAGE, dot, polyline};
use crate::algo::paint::{Canvas, FillRule, hex, text_outline};
use crate::algo::window::Window;
use crate::data::{Camera, Correspondences, Curves, Image, Mesh};

/// How render and drawing are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Layout {
    /// The render to the left, the drawing to the right.
    Beside,
    /// The drawing over the render.
    Over,
}

/// Lines of a mesh, curves of a drawing and what belongs together, to be looked at and to set anchors by.
///
/// The first pairs, the anchors, are numbered from 1.
#[derive(Node)]
#[node(
    id = "render.correspondences",
    version = 1,
    outputs = Drawing,
    source = "Li, Gleicher, Xu, Shum 2003, fig. 5",
    example = "\"look\": (type: \"render.correspondences\", render: \"@toon.image\", drawing: \"@drawing\", silhouette: \"@lines.curves\", drawn: \"@leg.curves\", pairs: \"@pairs\", mesh: \"@skin\", camera: \"@camera\")"
)]
pub(crate) struct RenderCorrespondences {
    /// The mesh as it is rendered.
    render: In<Image>,
    /// The drawing. The render stands for it where it is left out.
    drawing: Option<In<Image>>,
    /// The lines of the mesh; hidden ones are faint.
    silhouette: Option<In<Curves>>,
    /// The curves of the drawing.
    drawn: List<Option<In<Curves>>>,
    /// What belongs together.
    pairs: Option<In<Correspondences>>,
    /// The mesh that the pairs are on; without it, and the camera, their drawn places alone are shown.
    mesh: Option<In<Mesh>>,
    /// Where it is seen from.
    camera: Option<In<Camera>>,
    /// Render and drawing side by side or on each other.
    #[input(default = beside)]
    layout: Layout,
    /// So many of the first pairs are anchors: dots with numbers. Those that count more than 1 where it is left out.
    #[input(default = None, range = 0..=1000000)]
    anchors: Option<u32>,
    /// Number the lines of the mesh.
    #[input(default = true)]
    ids: bool,
    /// Pixels between the numbers of the rulers. 0 draws none.
    #[input(default = 50, range = 0..=65536, unit = "px")]
    ruler: u32,
    /// Opacity of the pictures below.
    #[input(default = 0.5, range = 0.0..=1.0)]
    opacity: f64,
    /// Width of the lines.
    #[input(default = 1.5, range = 0.1..=100.0, unit = "px")]
    width: f64,
    /// Height of the numbers' capitals.
    #[input(default = 8.0, range = 1.0..=1000.0, unit = "px")]
    text_size: f64,
}

const ANCHOR: u32 = 0xD55E00;
const PAIR: u32 = 0x0072B2;
const DRAWN: u32 = 0xCC79A7;
const DARK: u32 = 0x202020;

/// The two halves of the sheet: what is added to pixels of the render, and of the drawing.
struct Sheet<'a> {
    canvas: Canvas<'a>,
    render: [f64; 2],
    drawing: [f64; 2],
    text_size: f64,
}

fn at(p: [f64; 2], by: [f64; 2]) -> Option<Point> {
    let q = Point::new(p[0] + by[0], p[1] + by[1]);
    // What is further out is on no picture, and costs time.
    (q.x.abs() < 1e5 && q.y.abs() < 1e5).then_some(q)
}

impl Sheet<'_> {
    fn line(&mut self, points: &[Point], closed: bool, width: f64, colour: [f32; 4]) {
        if points.len() > 1 {
            self.canvas.line(&polyline(points, closed), width, colour);
        }
    }

    fn label(&mut self, text: &str, p: Point, colour: u32) {
        let size = self.text_size;
        let moved = Affine::translate((p.x, p.y));
        let halo: BezPath = moved * text_outline(text, size, size * 0.55);
        self.canvas.fill(&halo, FillRule::NonZero, [0.9, 0.9, 0.9, 0.9]);
        let path: BezPath = moved * text_outline(text, size, size * 0.16);
        self.canvas.fill(&path, FillRule::NonZero, hex(colour));
    }

    fn anchor(&mut self, number: usize, p: Point) {
        let r = self.text_size;
        self.canvas.fill(&dot(p, r + 2.0), FillRule::NonZero, [1.0; 4]);
        self.canvas.fill(&dot(p, r), FillRule::NonZero, hex(ANCHOR));
        self.label(&number.to_string(), Point::new(p.x + r * 0.7, p.y - r * 0.5), ANCHOR);
    }

    fn rulers(&mut self, step: f64, origin: [f64; 2], size: [usize; 2]) {
        let [w, h] = size.map(|n| n as f64);
        for (extent, down) in [(w, false), (h, true)] {
            let mut v = step;
            while v < extent {
                let (a, b) = if down { ([0.0, v], [5.0, v]) } else { ([v, 0.0], [v, 5.0]) };
                let tick = [a, b].map(|p| Point::new(p[0] + origin[0], p[1] + origin[1]));
                self.line(&tick, false, 1.0, hex(DARK));
                let text =
                    Point::new(b[0] + origin[0] + 1.0, b[1] + origin[1] + if down { self.text_size / 2.0 } else { self.text_size + 1.0 });
                self.label(&format!("{v}"), text, DARK);
                v += step;
            }
        }
    }
}

impl RenderCorrespondences {
    fn n_anchors(&self) -> usize {
        let Some(pairs) = &self.pairs else { return 0 };
        match self.anchors {
            Some(n) => (n as usize).min(pairs.points.len()),
            None => pairs.weights.iter().take_while(|w| **w > 1.0).count(),
        }
    }

    /// Where a pair is on the render.
    fn on_render(&self) -> Result<Vec<Option<[f64; 2]>>, NodeError> {
        let Some(pairs) = &self.pairs else { return Ok(Vec::new()) };
        let (Some(mesh), Some(camera)) = (&self.mesh, &self.camera) else { return Ok(vec![None; pairs.points.len()]) };
        let camera = seen_by(camera)?;
        let place = |(i, (&[a, b], &s)): (usize, (&[u32; 2], &f64))| {
            let get = |v: u32| {
                let n = mesh.positions.len();
                let message = || format!("pair {i}: expected vertices below {n}, found {v}");
                mesh.positions.get(v as usize).copied().ok_or_else(|| NodeError::input(message()))
            };
            let (p, q) = (get(a)?, get(b)?);
            let [x, y, _] = camera.project([0, 1, 2].map(|k| p[k] + (q[k] - p[k]) * s));
            Ok(Some([x, y]))
        };
        pairs.edges.iter().zip(&pairs.shares).enumerate().map(place).collect()
    }

    fn draw_curves(&self, sheet: &mut Sheet<'_>) {
        let (render, drawing) = (sheet.render, sheet.drawing);
        if let Some(lines) = &self.silhouette {
            for (k, curve) in lines.iter().enumerate() {
                let colour = hex(ON_FOOTAGE[k % ON_FOOTAGE.len()]);
                let n = curve.points.len();
                for i in 0..if curve.closed { n } else { n.saturating_sub(1) } {
                    let j = (i + 1) % n;
                    let seen = lines.visible[curve.first + i] != 0 && lines.visible[curve.first + j] != 0;
                    if let (Some(a), Some(b)) = (at(curve.points[i], render), at(curve.points[j], render)) {
                        let colour = if seen { colour } else { colour.map(|v| v * 0.3) };
                        sheet.line(&[a, b], false, if seen { self.width } else { self.width * 0.6 }, colour);
                    }
                }
                let middle = (0..n).filter(|i| lines.visible[curve.first + i] != 0).nth(n / 3).or(Some(n / 3));
                if let Some(p) = middle.and_then(|i| curve.points.get(i)).and_then(|p| at(*p, render)).filter(|_| self.ids) {
                    sheet.label(&format!("#{}", curve.id), p, ON_FOOTAGE[k % ON_FOOTAGE.len()]);
                }
            }
        }
        for curve in self.drawn.0.iter().flatten().flat_map(|c| c.iter()) {
            let points: Vec<Point> = curve.points.iter().filter_map(|p| at(*p, drawing)).collect();
            sheet.line(&points, curve.closed, self.width, hex(DRAWN));
        }
    }

    fn draw_pairs(&self, sheet: &mut Sheet<'_>) -> Result<(), NodeError> {
        let Some(pairs) = &self.pairs else { return Ok(()) };
        let (places, n) = (self.on_render()?, self.n_anchors());
        let (render, drawn) = (sheet.render, sheet.drawing);
        for (i, (place, point)) in places.iter().zip(&pairs.points).enumerate().rev() {
            let (p, q) = (place.and_then(|p| at(p, render)), at(*point, drawn));
            if let (Some(p), Some(q)) = (p, q) {
                let faint = if self.layout == Layout::Over { 0.9 } else { 0.25 };
                let colour = hex(if i < n { ANCHOR } else { PAIR }).map(|v| v * if i < n { 0.8 } else { faint });
                sheet.line(&[p, q], false, if i < n { 1.2 } else { 0.7 }, colour);
            }
            for p in [p, q].into_iter().flatten() {
                if i < n {
                    sheet.anchor(i + 1, p);
                } else {
                    sheet.canvas.fill(&dot(p, 2.4), FillRule::NonZero, hex(PAIR));
                }
            }
        }
        Ok(())
    }
}

impl PerFrame for RenderCorrespondences {
    fn run(self, _cx: &Context) -> Result<Drawing, NodeError> {
        within("opacity", self.opacity, 0.0, 1.0)?;
        within("width", self.width, 0.1, 100.0)?;
        within("text_size", self.text_size, 1.0, 1000.0)?;
        let first = self.render.display_window();
        let second = self.drawing.as_ref().map_or(first, |d| d.display_window());
        let beside = self.layout == Layout::Beside;
        let (width, height) = (
            if beside { first.width.saturating_add(second.width) } else { first.width.max(second.width) },
            first.height.max(second.height),
        );
        let window = Window::new(0, 0, width, height);
        let mut samples = blank(window)?;
        samples.fill(1.0);
        let pictures = [(Some(&self.render), first, 0), (self.drawing.as_ref(), second, if beside { first.width } else { 0 })];
        for (image, own, left) in pictures {
            let Some(image) = image else { continue };
            let picture = rgba(image, own)?;
            let opacity = self.opacity as f32;
            for (y, row) in picture.chunks_exact((4 * own.width).max(1)).enumerate() {
                for (x, above) in row.as_chunks::<4>().0.iter().enumerate() {
                    let below = &mut samples[4 * (y * width + x + left)..][..4];
                    let keep = 1.0 - above[3] * opacity;
                    below.iter_mut().zip(above).for_each(|(b, a)| *b = *b * keep + a * opacity);
                }
            }
        }
        let mut sheet = Sheet {
            canvas: Canvas::new(&mut samples, width, height).map_err(|e| NodeError::internal(e.to_string()))?,
            render: [-first.x as f64, -first.y as f64],
            drawing: [if beside { first.width as f64 } else { 0.0 } - second.x as f64, -second.y as f64],
            text_size: self.text_size,
        };
        self.draw_curves(&mut sheet);
        self.draw_pairs(&mut sheet)?;
        if self.ruler > 0 {
            sheet.rulers(f64::from(self.ruler), [0.0, 0.0], [first.width, first.height]);
            if beside {
                sheet.rulers(f64::from(self.ruler), [first.width as f64, 0.0], [second.width, second.height]);
            }
        }
        drawing(window, window, samples)
    }
}
