//! A cel's drawing as data: one closed silhouette, flat areas and ink lines inside it, drawn under a map of the plane.

use super::noise::noise;
use crate::algo::paint::{BezPath, Canvas, FillRule, coverage, flatten, hex, ink, ink_widths, polygon};
use kurbo::Point;

/// Chords lie within this many design units of the curves: a hundredth of a pixel at 1920×1080.
const TOLERANCE: f64 = 0.004;

/// Something drawn inside the silhouette, in order.
#[derive(Clone, Debug)]
enum Mark {
    /// A flat area, clipped by the silhouette.
    Area { lines: Vec<Vec<Point>>, colour: [f32; 4] },
    /// An ink line that tapers at both ends, of `width` design units.
    Line { points: Vec<Point>, closed: bool, width: f64, colour: [f32; 4] },
}

/// A drawing in design units: the size of a 640×360 frame, the origin in the drawing's middle, y down.
#[derive(Clone, Debug)]
pub(super) struct Drawing {
    pub(super) outline: Vec<Point>,
    holes: Vec<Vec<Point>>,
    marks: Vec<Mark>,
    base: [f32; 4],
    ink: [f32; 4],
    line_width: f64,
    seed: u64,
}

impl Drawing {
    /// A drawing from the SVG path data of its silhouette (first sub-path; others are holes), in sRGB colours.
    pub(super) fn new(outline: &str, base: u32, ink: u32, line_width: f64, seed: u64) -> Self {
        let mut drawing =
            Self { outline: Vec::new(), holes: Vec::new(), marks: Vec::new(), base: hex(base), ink: hex(ink), line_width, seed };
        let mut loops = drawing.lines(outline).into_iter().map(|(points, _)| points);
        drawing.outline = loops.next().unwrap_or_default();
        drawing.holes = loops.collect();
        drawing
    }

    /// Adds a flat area.
    pub(super) fn area(mut self, data: &str, colour: u32) -> Self {
        let lines = self.lines(data).into_iter().map(|(points, _)| points).collect();
        self.marks.push(Mark::Area { lines, colour: hex(colour) });
        self
    }

    /// Adds ink lines of `weight` times the outline's width.
    pub(super) fn line(mut self, data: &str, weight: f64) -> Self {
        let (width, colour) = (self.line_width * weight, self.ink);
        for (points, closed) in self.lines(data) {
            self.marks.push(Mark::Line { points, closed, width, colour });
        }
        self
    }

    /// Adds brushed lines of `width` design units in a colour of their own.
    pub(super) fn brush(mut self, data: &str, width: f64, colour: u32) -> Self {
        for (points, closed) in self.lines(data) {
            self.marks.push(Mark::Line { points, closed, width, colour: hex(colour) });
        }
        self
    }

    /// The path's polylines, with the slow wander of a hand that drew them.
    fn lines(&self, data: &str) -> Vec<(Vec<Point>, bool)> {
        let path = BezPath::from_svg(data).unwrap_or_default();
        let mut lines = flatten(&path, TOLERANCE);
        for (points, closed) in &mut lines {
            *points = resample(points, *closed, 1.5);
            points.iter_mut().for_each(|p| *p = wander(*p, 0.035, 0.7, self.seed));
        }
        lines
    }

    /// The outline under `map`.
    pub(super) fn contour(&self, map: impl Fn(Point) -> Point) -> Vec<Point> {
        self.outline.iter().map(|&p| map(p)).collect()
    }

    /// Draws under `map` (pixels from design units, `scale` pixels a unit). The silhouette is exact; `boil` (design units, with a seed of the
    /// drawing's own) moves only the ink within it and its weight.
    pub(super) fn draw(
        &self,
        width: usize,
        height: usize,
        scale: f64,
        boil: (f64, u64),
        map: impl Fn(Point) -> Point,
    ) -> (Vec<f32>, Vec<f32>) {
        let mut silhouette = polygon(&self.contour(&map));
        for hole in &self.holes {
            silhouette.extend(polygon(&hole.iter().map(|&p| map(p)).collect::<Vec<_>>()));
        }
        let matte = coverage(&silhouette, FillRule::EvenOdd, width, height);
        let mut image: Vec<f32> = self.base.iter().copied().cycle().take(width * height * 4).collect();
        if let Ok(mut canvas) = Canvas::new(&mut image, width, height) {
            let boiled = |p: Point| map(wander(p, 0.05, boil.0, boil.1));
            for mark in &self.marks {
                draw_mark(&mut canvas, mark, scale, boiled);
            }
            for line in std::iter::once(&self.outline).chain(&self.holes) {
                let (points, widths) = self.outline_ink(line, scale, boil, &map);
                canvas.fill(&ink_widths(&points, &widths, true), FillRule::NonZero, self.ink);
            }
        }
        for (pixel, &cover) in image.chunks_exact_mut(4).zip(&matte) {
            pixel.iter_mut().for_each(|v| *v *= cover);
        }
        (image, matte)
    }

    /// The outline's ink: heavier where it turns away from the light at the upper left. Half of it lies outside, and the silhouette cuts that.
    fn outline_ink(&self, line: &[Point], scale: f64, boil: (f64, u64), map: impl Fn(Point) -> Point) -> (Vec<Point>, Vec<f64>) {
        let n = line.len();
        let widths = (0..n).map(|i| {
            let (p, tangent) = (line[i], line[(i + 1) % n] - line[(i + n - 1) % n]);
            let facing = (tangent.x * 0.45 + tangent.y * -0.9) / (tangent.x * tangent.x + tangent.y * tangent.y).sqrt().max(1e-9);
            let hand = 0.22 * noise(p.x * 0.05, p.y * 0.05, self.seed ^ 0x51) + 0.3 * boil.0 * noise(p.x * 0.08, p.y * 0.08, boil.1 ^ 0x52);
            2.0 * scale * self.line_width * (1.0 - 0.34 * facing + hand).max(0.3)
        });
        (line.iter().map(|&p| map(p)).collect(), widths.collect())
    }
}

fn draw_mark(canvas: &mut Canvas<'_>, mark: &Mark, scale: f64, map: impl Fn(Point) -> Point) {
    match mark {
        Mark::Area { lines, colour } => {
            let mut path = BezPath::new();
            lines.iter().for_each(|line| path.extend(polygon(&line.iter().map(|&p| map(p)).collect::<Vec<_>>())));
            canvas.fill(&path, FillRule::NonZero, *colour);
        }
        Mark::Line { points, closed, width, colour } => {
            let points: Vec<Point> = points.iter().map(|&p| map(p)).collect();
            let taper = |s: f64| if *closed { 1.0 } else { 2.0 * (s * (1.0 - s)).max(0.0).sqrt() };
            canvas.fill(&ink(&points, *closed, |s| width * scale * (0.12 + 0.88 * taper(s))), FillRule::NonZero, *colour);
        }
    }
}

/// A point moved by up to `amount` along smooth noise of `frequency` cycles a unit.
fn wander(p: Point, frequency: f64, amount: f64, seed: u64) -> Point {
    let (x, y) = (p.x * frequency, p.y * frequency);
    Point::new(p.x + amount * noise(x, y, seed ^ 0xa1), p.y + amount * noise(x, y, seed ^ 0xb2))
}

/// Points no further than `step` apart, the corners kept.
fn resample(points: &[Point], closed: bool, step: f64) -> Vec<Point> {
    let mut out = Vec::new();
    let last = if closed { points.len() } else { points.len().saturating_sub(1) };
    for i in 0..last {
        let (a, b) = (points[i], points[(i + 1) % points.len()]);
        let n = ((b - a).hypot() / step).ceil().clamp(1.0, 1e4) as usize;
        out.extend((0..n).map(|k| a + (b - a) * (k as f64 / n as f64)));
    }
    if !closed {
        out.extend(points.last());
    }
    out
}
