//! Outlines: what path data and the basic shapes say, and the points that they become.
//!
//! **Source** W3C, Scalable Vector Graphics 1.1, chapters 8 (paths), 9 (basic shapes) and appendix F.6 (elliptical arcs).

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix2, Vector2};
use svgtypes::{PathParser, PathSegment};

use crate::algo::raster::{Affine, apply};

/// A point, pixels or units of the drawing.
pub type Point = [f64; 2];

/// Most segments and most points of one drawing.
pub const MOST: usize = 1 << 22;

/// What leads from one node of an outline to the next, whose place is its last point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Segment {
    /// A straight line.
    Line(Point),
    /// A quadratic Bézier curve: control point, end.
    Quad(Point, Point),
    /// A cubic Bézier curve: control points, end.
    Cubic(Point, Point, Point),
    /// A part of an ellipse, `centre + u cos(a) + v sin(a)`.
    Arc {
        /// Its centre.
        centre: Point,
        /// Half an axis.
        u: Point,
        /// Half the other axis.
        v: Point,
        /// The angle that it starts at, and by how much it goes on, radians.
        angles: [f64; 2],
        /// The end, as it was given.
        end: Point,
    },
}

/// One line of an outline.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subpath {
    /// Its first node.
    pub start: Point,
    /// What follows.
    pub segments: Vec<Segment>,
    /// Whether a straight line leads from its last node to the first.
    pub closed: bool,
}

fn vector(p: Point) -> Vector2<f64> {
    p.into()
}

fn length(p: Point) -> f64 {
    libm::hypot(p[0], p[1])
}

impl Segment {
    /// The last point.
    pub fn end(&self) -> Point {
        match *self {
            Segment::Line(p) | Segment::Quad(_, p) | Segment::Cubic(_, _, p) | Segment::Arc { end: p, .. } => p,
        }
    }

    fn moved(&self, map: &Affine) -> Self {
        let to = |p: Point| -> Point { apply(map, p.into()).into() };
        let turn = |p: Point| -> Point { (map.fixed_view::<2, 2>(0, 0) * vector(p)).into() };
        match *self {
            Segment::Line(p) => Segment::Line(to(p)),
            Segment::Quad(a, p) => Segment::Quad(to(a), to(p)),
            Segment::Cubic(a, b, p) => Segment::Cubic(to(a), to(b), to(p)),
            Segment::Arc { centre, u, v, angles, end } => Segment::Arc { centre: to(centre), u: turn(u), v: turn(v), angles, end: to(end) },
        }
    }

    /// The largest second derivative in the parameter, from 0 to 1.
    fn bend(&self, start: Point) -> f64 {
        let second = |a: Point, b: Point, c: Point| length([a[0] - 2.0 * b[0] + c[0], a[1] - 2.0 * b[1] + c[1]]);
        match *self {
            Segment::Line(_) => 0.0,
            Segment::Quad(a, p) => 2.0 * second(start, a, p),
            Segment::Cubic(a, b, p) => 6.0 * second(start, a, b).max(second(a, b, p)),
            Segment::Arc { u, v, angles, .. } => angles[1] * angles[1] * libm::hypot(length(u), length(v)),
        }
    }

    /// How many even steps of the parameter keep chords within `tolerance`: a chord over a step h is at most h² |B''| / 8 away.
    pub fn steps(&self, start: Point, tolerance: f64) -> f64 {
        libm::ceil(libm::sqrt(self.bend(start) / (8.0 * tolerance))).max(1.0)
    }

    /// The place at `t`, from 0 to 1.
    pub fn at(&self, start: Point, t: f64) -> Point {
        let s = 1.0 - t;
        let sum = |terms: &[(f64, Point)]| [0, 1].map(|c| terms.iter().map(|(w, p)| w * p[c]).sum());
        match *self {
            _ if t >= 1.0 => self.end(),
            Segment::Line(p) => sum(&[(s, start), (t, p)]),
            Segment::Quad(a, p) => sum(&[(s * s, start), (2.0 * s * t, a), (t * t, p)]),
            Segment::Cubic(a, b, p) => sum(&[(s * s * s, start), (3.0 * s * s * t, a), (3.0 * s * t * t, b), (t * t * t, p)]),
            Segment::Arc { centre, u, v, angles, .. } => {
                let (sin, cos) = libm::sincos(angles[0] + angles[1] * t);
                sum(&[(1.0, centre), (cos, u), (sin, v)])
            }
        }
    }
}

impl Subpath {
    /// The same line under a map.
    pub fn moved(&self, map: &Affine) -> Self {
        let segments = self.segments.iter().map(|s| s.moved(map)).collect();
        Self { start: apply(map, self.start.into()).into(), segments, closed: self.closed }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let numbers = |s: &Segment| match *s {
            Segment::Line(p) => length(p),
            Segment::Quad(a, p) => length(a) + length(p),
            Segment::Cubic(a, b, p) => length(a) + length(b) + length(p),
            Segment::Arc { centre, u, v, angles, end } => length(centre) + length(u) + length(v) + length(end) + length(angles),
        };
        length(self.start).is_finite() && self.segments.iter().all(|s| numbers(s).is_finite())
    }

    /// Whether it comes back to its first node by itself, so that closing it adds no line.
    pub fn meets(&self) -> bool {
        // Drawing programs write as many digits as pixels need.
        const NEAR: f64 = 1e-5;
        let end = self.segments.last().map_or(self.start, Segment::end);
        self.closed && !self.segments.is_empty() && length([end[0] - self.start[0], end[1] - self.start[1]]) < NEAR
    }

    /// The nodes that segments start at.
    fn starts(&self) -> impl Iterator<Item = Point> + '_ {
        std::iter::once(self.start).chain(self.segments.iter().map(Segment::end))
    }
}

/// An outline that cannot be read, in what it should have been.
pub(super) type Unread = &'static str;

struct Pen {
    out: Vec<Subpath>,
    at: Point,
    /// The last control point, for curves that go on smoothly: of a cubic, of a quadratic.
    control: [Option<Point>; 2],
    is_open: bool,
    count: usize,
}

impl Pen {
    fn line(&mut self) -> &mut Subpath {
        if !self.is_open {
            // After a line was closed the next one starts where it did.
            self.out.push(Subpath { start: self.at, ..Subpath::default() });
            self.is_open = true;
        }
        let last = self.out.len() - 1;
        &mut self.out[last]
    }

    fn draw(&mut self, segment: Segment) {
        self.count += 1;
        self.line().segments.push(segment);
        self.at = segment.end();
        self.control = [None; 2];
    }

    fn reflected(&self, kind: usize) -> Point {
        self.control[kind].map_or(self.at, |c| [2.0 * self.at[0] - c[0], 2.0 * self.at[1] - c[1]])
    }

    fn segment(&mut self, segment: PathSegment) {
        let origin = self.at;
        let to = |abs: bool, x: f64, y: f64| if abs { [x, y] } else { [origin[0] + x, origin[1] + y] };
        match segment {
            PathSegment::MoveTo { abs, x, y } => {
                self.at = to(abs, x, y);
                (self.is_open, self.control) = (false, [None; 2]);
                self.count += 1;
                self.line();
            }
            PathSegment::LineTo { abs, x, y } => self.draw(Segment::Line(to(abs, x, y))),
            PathSegment::HorizontalLineTo { abs, x } => self.draw(Segment::Line([to(abs, x, 0.0)[0], origin[1]])),
            PathSegment::VerticalLineTo { abs, y } => self.draw(Segment::Line([origin[0], to(abs, 0.0, y)[1]])),
            PathSegment::CurveTo { abs, x1, y1, x2, y2, x, y } => self.cubic(to(abs, x1, y1), to(abs, x2, y2), to(abs, x, y)),
            PathSegment::SmoothCurveTo { abs, x2, y2, x, y } => self.cubic(self.reflected(0), to(abs, x2, y2), to(abs, x, y)),
            PathSegment::Quadratic { abs, x1, y1, x, y } => self.quad(to(abs, x1, y1), to(abs, x, y)),
            PathSegment::SmoothQuadratic { abs, x, y } => self.quad(self.reflected(1), to(abs, x, y)),
            PathSegment::EllipticalArc { abs, rx, ry, x_axis_rotation, large_arc, sweep, x, y } => {
                self.draw(arc(origin, [rx, ry], x_axis_rotation.to_radians(), [large_arc, sweep], to(abs, x, y)));
            }
            PathSegment::ClosePath { .. } => {
                self.line().closed = true;
                self.at = self.line().start;
                (self.is_open, self.control) = (false, [None; 2]);
            }
        }
    }

    fn cubic(&mut self, a: Point, b: Point, p: Point) {
        self.draw(Segment::Cubic(a, b, p));
        self.control[0] = Some(b);
    }

    fn quad(&mut self, a: Point, p: Point) {
        self.draw(Segment::Quad(a, p));
        self.control[1] = Some(a);
    }
}

/// The lines of path data. A mistake in it is an error, not the end of the outline.
pub(super) fn parse(data: &str) -> Result<Vec<Subpath>, Unread> {
    let mut pen = Pen { out: Vec::new(), at: [0.0; 2], control: [None; 2], is_open: false, count: 0 };
    for segment in PathParser::from(data) {
        pen.segment(segment.map_err(|_| "path data as `M0 0 L10 0 L10 10 Z`")?);
        if pen.count > MOST {
            return Err("at most 4194304 segments");
        }
    }
    if pen.out.iter().all(Subpath::is_finite) { Ok(pen.out) } else { Err("finite numbers") }
}

/// An arc from `start` to `end` on an ellipse with these half axes, turned by `turn` radians: appendix F.6.5 and F.6.6.
fn arc(start: Point, radii: [f64; 2], turn: f64, [large, sweep]: [bool; 2], end: Point) -> Segment {
    let [rx, ry] = radii.map(f64::abs);
    if rx == 0.0 || ry == 0.0 || start == end {
        return Segment::Line(end);
    }
    let (sin, cos) = libm::sincos(turn);
    let rotation = Matrix2::new(cos, -sin, sin, cos);
    let half = rotation.transpose() * (vector(start) - vector(end)) / 2.0;
    let [x, y] = [half.x / rx, half.y / ry];
    let square = x * x + y * y;
    // Radii that are too small to reach the end are made just large enough.
    let grown = libm::sqrt(square.max(1.0));
    let [rx, ry] = [rx * grown, ry * grown];
    let side = if large == sweep { -1.0 } else { 1.0 };
    let along = side * libm::sqrt((1.0 / square - 1.0).max(0.0));
    let inner = Vector2::new(along * rx * half.y / ry, -along * ry * half.x / rx);
    let centre = rotation * inner + (vector(start) + vector(end)) / 2.0;
    let angle = |p: Vector2<f64>| libm::atan2(p.y / ry, p.x / rx);
    let (from, to) = (angle(half - inner), angle(-half - inner));
    let by = match (sweep, to - from) {
        (true, by) if by < 0.0 => by + 2.0 * PI,
        (false, by) if by > 0.0 => by - 2.0 * PI,
        (_, by) => by,
    };
    let axis = |p: Vector2<f64>| -> Point { (rotation * p).into() };
    Segment::Arc { centre: centre.into(), u: axis(Vector2::new(rx, 0.0)), v: axis(Vector2::new(0.0, ry)), angles: [from, by], end }
}

/// An ellipse from its right side round by the bottom, in four arcs.
pub(super) fn ellipse(centre: Point, [rx, ry]: [f64; 2]) -> Subpath {
    let [x, y] = centre;
    let ends = [[x, y + ry], [x - rx, y], [x, y - ry], [x + rx, y]];
    let quarter =
        |(k, end): (usize, Point)| Segment::Arc { centre, u: [rx, 0.0], v: [0.0, ry], angles: [k as f64 * FRAC_PI_2, FRAC_PI_2], end };
    Subpath { start: ends[3], segments: ends.into_iter().enumerate().map(quarter).collect(), closed: true }
}

/// A rectangle, its corners rounded where the radii are not 0, from its top left round by the right.
pub(super) fn rectangle([x, y]: Point, [w, h]: [f64; 2], radii: [f64; 2]) -> Subpath {
    let [rx, ry] = [radii[0].min(w / 2.0), radii[1].min(h / 2.0)];
    if rx <= 0.0 || ry <= 0.0 {
        let corners = [[x + w, y], [x + w, y + h], [x, y + h]];
        return Subpath { start: [x, y], segments: corners.map(Segment::Line).to_vec(), closed: true };
    }
    let (right, bottom) = (x + w, y + h);
    let sides = [
        ([right - rx, y], [right, y + ry]),
        ([right, bottom - ry], [right - rx, bottom]),
        ([x + rx, bottom], [x, bottom - ry]),
        ([x, y + ry], [x + rx, y]),
    ];
    let segments = sides.into_iter().flat_map(|(a, b)| [Segment::Line(a), arc(a, [rx, ry], 0.0, [false, true], b)]);
    Subpath { start: [x + rx, y], segments: segments.collect(), closed: true }
}

/// Straight lines through points.
pub(super) fn polyline(points: &[Point], closed: bool) -> Option<Subpath> {
    let (&start, rest) = points.split_first()?;
    Some(Subpath { start, segments: rest.iter().map(|p| Segment::Line(*p)).collect(), closed })
}

/// How outlines become points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// How far chords may be from curves, pixels.
    pub tolerance: f64,
    /// Even steps on each segment, straight ones too. 0 takes as many as the tolerance asks for.
    pub per_segment: usize,
}

/// Points of lines that correspond: on each segment the same even steps of the parameter, as many as the key that needs most.
///
/// The lines have as many segments each and are all open or all closed; see [`differs`]. `None` where there would be more than [`MOST`] points.
pub fn sampled(keys: &[&Subpath], sampling: Sampling) -> Option<Vec<Vec<Point>>> {
    let n = keys.first().map_or(0, |k| k.segments.len());
    let closed = keys.first().is_some_and(|k| k.closed);
    // Where any key needs the line that closes it, all have it.
    let meets = keys.iter().all(|k| k.meets());
    let mut steps: Vec<f64> = (0..n).map(|i| most_steps(keys, i, sampling)).collect();
    if closed && !meets {
        steps.push(if sampling.per_segment == 0 { 1.0 } else { sampling.per_segment as f64 });
    }
    // Written so that sums that are not numbers are refused.
    let total: f64 = steps.iter().sum();
    let is_few = total * (keys.len() as f64) < MOST as f64;
    is_few.then(|| keys.iter().map(|key| points(key, &steps)).collect())
}

fn most_steps(keys: &[&Subpath], i: usize, sampling: Sampling) -> f64 {
    if sampling.per_segment > 0 {
        return sampling.per_segment as f64;
    }
    let start = |k: &Subpath| if i == 0 { k.start } else { k.segments[i - 1].end() };
    keys.iter().map(|k| k.segments[i].steps(start(k), sampling.tolerance)).fold(1.0, f64::max)
}

fn points(key: &Subpath, steps: &[f64]) -> Vec<Point> {
    let mut out = Vec::with_capacity(steps.iter().sum::<f64>() as usize + 1);
    let closing = key.closed.then_some(Segment::Line(key.start));
    let all = key.segments.iter().copied().chain(closing);
    for ((segment, start), &n) in all.zip(key.starts()).zip(steps) {
        out.push(start);
        out.extend((1..n as usize).map(|k| segment.at(start, k as f64 / n)));
    }
    // A closed line does not come back to its first point in the list; a single point stands by itself.
    if !key.closed || steps.is_empty() {
        out.push(key.segments.last().map_or(key.start, Segment::end));
    }
    out
}

/// What differs between the nodes of two outlines, such that points do not correspond; `None` where they do.
///
/// A straight line in one may be a curve in the other: it is the same node with its handles pulled out.
pub fn differs(a: &[Subpath], b: &[Subpath]) -> Option<String> {
    if a.len() != b.len() {
        return Some(format!("{} lines in one and {} in the other", a.len(), b.len()));
    }
    let word = |closed: bool| if closed { "closed" } else { "open" };
    a.iter().zip(b).enumerate().find_map(|(i, (a, b))| {
        let [n, m] = [a, b].map(|s| s.segments.len());
        let line = if i == 0 { String::new() } else { format!(" in line {}", i + 1) };
        match (n == m, a.closed == b.closed) {
            (false, _) => Some(format!("{n} segments in one and {m} in the other{line}")),
            (_, false) => Some(format!("{} in one and {} in the other{line}", word(a.closed), word(b.closed))),
            _ => None,
        }
    })
}
