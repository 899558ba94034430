//! Ink lines: chains on the screen, cut where something hides them, drawn with a pen of changing width.

use kurbo::{BezPath, Point, Shape as _};

use super::{Light, on_threads, rows_of};
use crate::algo::camera::Camera;
use crate::algo::hidden::Hidden;
use crate::algo::paint::{FillRule, fill_rows, ink_widths};
use crate::algo::silhouette::{Chain, EdgePoint, Kind};
use crate::algo::visibility::{Seen, Sight};

/// Between two samples of a line, pixels.
const STEP: f64 = 1.0;

/// Gaps shorter than this many pixels are specks to the eye.
const GAP: f64 = 2.0;

/// Ink that closes a gap of the outermost outline begins this many pixels before it.
const LAP: usize = 4;

/// Pieces shorter than so many widths of the pen are dots, not lines.
const DOT: f64 = 3.0;

/// Longer chains than this many samples are cut short: a point next to the eye may be a million pixels away.
const MOST: usize = 1 << 16;

/// How lines are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pen {
    /// Width of silhouettes and borders, pixels.
    pub outline: f64,
    /// Width of creases, seams and intersections, pixels.
    pub inner: f64,
    /// Over how many pixels a line that ends of itself thins out to nothing.
    pub taper: f64,
    /// How much lines thin out with distance: width × (depth of the middle / depth)^this. 0 not at all, 1 as perspective has it.
    pub thin_far: f64,
    /// How much wider lines are where the surface faces away from the light: 1 doubles them.
    pub weight: f64,
    /// How deep a line may lie under what is before it and still be drawn, as a part of the surface's extent.
    pub bias: f64,
    /// Linear, premultiplied.
    pub colour: [f32; 4],
}

/// A line ready to be filled by the non-zero rule, and the rows that it touches.
pub(super) struct Stroke {
    path: BezPath,
    rows: [f64; 2],
    /// Along its middle.
    places: Vec<Point>,
}

/// A place along a chain on the screen.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Point,
    /// Nearness.
    near: f64,
    /// Width that the pen has there.
    width: f64,
    /// The edge of the surface that a point of the chain lies on.
    edge: [u32; 2],
    /// True where the chain turns, so that this place must not be smoothed away.
    corner: bool,
    seen: Seen,
}

/// The shares of a way that something hides; `None` where the picture has nothing of it.
type Gaps = Option<Vec<[f64; 2]>>;

/// A run of places of a chain that are before the eye. A closed one repeats its first at its end.
struct Line {
    places: Vec<Sample>,
    closed: bool,
    kind: Kind,
    /// From each place to the next.
    hidden: Vec<Gaps>,
}

/// Ways of a line that one thread looks at before it takes the next.
const WAYS: usize = 64;

/// All that does not change from chain to chain.
struct Plotter<'a> {
    camera: &'a Camera,
    sight: Sight<'a>,
    hidden: Hidden<'a>,
    pen: &'a Pen,
    light: &'a Light,
}

/// The visible parts of chains as strokes, in their order; then those of `folds`, along which the mesh ends, that are outermost and have no ink beside them.
pub(super) fn strokes<'a>(
    (chains, folds): (&[Chain], &[Chain]),
    (sight, hidden): (Sight<'a>, Hidden<'a>),
    camera: &'a Camera,
    pen: &'a Pen,
    light: &'a Light,
    threads: usize,
) -> Vec<Stroke> {
    let plotter = Plotter { camera, sight, hidden, pen, light };
    let mut lines = Vec::new();
    chains.iter().for_each(|chain| plotter.plot(chain, &mut lines));
    let jobs = lines.iter_mut().flat_map(|Line { places, hidden, kind, .. }| {
        let (places, kind) = (&*places, *kind);
        hidden.chunks_mut(WAYS).enumerate().map(move |(i, ways)| (kind, &places[i * WAYS..], ways))
    });
    on_threads(jobs.collect(), threads, |(): &mut (), (kind, places, ways): (Kind, &[Sample], &mut [Gaps])| {
        places.windows(2).zip(ways).for_each(|(ends, way)| *way = plotter.hidden_of(kind, ends[0], ends[1]));
    });
    let mut out = Vec::new();
    for line in &lines {
        plotter.cut(plotter.dense(line), line.closed, line.kind, &mut out);
    }
    plotter.close(folds, &mut out);
    out
}

impl Plotter<'_> {
    /// A point of a chain on the screen; `None` behind the near plane.
    fn place(&self, point: &EdgePoint, kind: Kind) -> Option<Sample> {
        let ([x, y], near) = self.sight.place(&point.smooth)?;
        let far = libm::pow(self.sight.middle / self.sight.depth(near).max(self.sight.small), self.pen.thin_far).clamp(0.1, 10.0);
        let dark = 1.0 + self.pen.weight * (0.5 - 0.5 * point.normal.dot(&self.light.direction));
        let base = if matches!(kind, Kind::Silhouette | Kind::Border) { self.pen.outline } else { self.pen.inner };
        Some(Sample { at: Point::new(x, y), near, width: base * far * dark, edge: point.vertices, corner: false, seen: Seen::Yes })
    }

    /// Adds the lines of a chain; nothing of them is hidden yet.
    fn plot(&self, chain: &Chain, out: &mut Vec<Line>) {
        let places: Vec<Option<Sample>> = chain.points.iter().map(|p| self.place(p, chain.kind)).collect();
        let closed = chain.closed && places.iter().all(Option::is_some);
        for run in places.split(Option::is_none).filter(|r| r.len() > 1) {
            let mut places: Vec<Sample> = run.iter().copied().flatten().collect();
            if closed {
                places.extend(places.first().copied());
            }
            mark_corners(&mut places, closed);
            out.push(Line { hidden: vec![None; places.len() - 1], places, closed, kind: chain.kind });
        }
    }

    /// Samples a pixel apart, as far as they may be in the picture.
    fn dense(&self, line: &Line) -> Vec<Sample> {
        let kind = line.kind;
        let mut out: Vec<Sample> = Vec::new();
        for (pair, way) in line.places.windows(2).zip(&line.hidden) {
            let [a, b] = [pair[0], pair[1]];
            let hidden = way.as_deref().unwrap_or_default();
            let steps = if way.is_none() { 1 } else { (a.at.distance(b.at) / STEP).ceil().clamp(1.0, 4096.0) as usize };
            // A point is seen where the line is on either of its sides.
            let seen = |t: f64| !hidden.iter().any(|p| p[0] <= t && t <= p[1]);
            match out.last_mut() {
                Some(last) if last.seen != Seen::Yes && seen(0.0) => last.seen = Seen::Yes,
                Some(_) => {}
                None => out.push(Sample { seen: self.look(&a, seen(0.0), kind), ..a }),
            }
            for k in 1..=steps.min(MOST.saturating_sub(out.len())) {
                let t = k as f64 / steps as f64;
                let mix = |a: f64, b: f64| a + (b - a) * t;
                let sample = Sample {
                    at: a.at.lerp(b.at, t),
                    near: mix(a.near, b.near),
                    width: mix(a.width, b.width),
                    corner: k == steps && b.corner,
                    ..b
                };
                out.push(Sample { seen: self.look(&sample, seen(t), kind), ..sample });
            }
        }
        out
    }

    /// True where the picture has nothing of the way from one place to the next.
    fn is_away(&self, a: Point, b: Point) -> bool {
        let margin = 4.0 * self.pen.outline.max(self.pen.inner) + 16.0;
        let [w, h] = self.camera.size.map(|n| n as f64 + margin);
        a.x.max(b.x) < -margin || a.x.min(b.x) > w || a.y.max(b.y) < -margin || a.y.min(b.y) > h
    }

    /// What hides the way from one place of a line to the next.
    fn hidden_of(&self, kind: Kind, a: Sample, b: Sample) -> Gaps {
        if self.is_away(a.at, b.at) {
            return None;
        }
        let slack = self.sight.least.max(1e3 * self.sight.small * self.pen.bias);
        Some(self.hidden.of_kind(kind, [a.edge, b.edge], [a, b].map(|s| ([s.at.x, s.at.y], s.near)), slack))
    }

    /// Whether a sample is seen, and if not, what the depth buffer says of why.
    fn look(&self, s: &Sample, seen: bool, kind: Kind) -> Seen {
        if seen {
            return Seen::Yes;
        }
        match self.sight.seen([s.at.x, s.at.y], s.near, kind) {
            Seen::Covered => Seen::Covered,
            _ => Seen::Turned,
        }
    }

    /// True next to nothing at all: the outermost outline neither thins out nor has dots to lose.
    fn is_rim(&self, s: &Sample) -> bool {
        self.sight.is_outline([s.at.x, s.at.y])
    }

    /// Cuts a line into its visible runs and makes strokes of them. A closed one repeats its first sample at its end.
    fn cut(&self, mut line: Vec<Sample>, closed: bool, kind: Kind, out: &mut Vec<Stroke>) {
        settle(&mut line, |s| self.is_rim(s));
        if line.iter().all(|s| s.seen == Seen::Yes) {
            return self.stroke(&line, closed, [true; 2], kind, out);
        }
        if closed && let Some(hidden) = line.iter().position(|s| s.seen != Seen::Yes) {
            line.pop();
            line.rotate_left(hidden);
        }
        let mut start = 0;
        while let Some(from) = line[start..].iter().position(|s| s.seen == Seen::Yes).map(|i| i + start) {
            let to = line[from..].iter().position(|s| s.seen != Seen::Yes).map_or(line.len(), |i| i + from);
            // A line goes on behind what covers it; one that turns away, or just ends, is lifted off the paper.
            let before = if from > 0 {
                line.get(from - 1)
            } else if closed {
                line.last()
            } else {
                None
            };
            let after = if to < line.len() || !closed { line.get(to) } else { line.first() };
            let lifted = [(before, from), (after, to - 1)]
                .map(|(beyond, end)| beyond.is_none_or(|s| s.seen != Seen::Covered) && !self.is_rim(&line[end]));
            self.stroke(&line[from..to], false, lifted, kind, out);
            start = to;
        }
    }

    /// Adds strokes where the outermost outline has none: a coarse mesh reaches beyond, and then hides, the line of the smooth surface that it stands for.
    fn close(&self, folds: &[Chain], out: &mut Vec<Stroke>) {
        let inked = Inked::new(self.camera.size, out, self.pen.outline);
        let mut lines = Vec::new();
        folds.iter().for_each(|chain| self.plot(chain, &mut lines));
        for mut line in lines {
            let ways = line.places.windows(2).map(|p| (!self.is_away(p[0].at, p[1].at)).then(Vec::new));
            line.hidden = ways.collect();
            let mut samples = self.dense(&line);
            let mut bare: Vec<bool> = samples.iter().map(|s| self.is_rim(s) && inked.is_bare(s.at)).collect();
            let mut start = 0;
            for same in bare.clone().chunk_by(|a, b| a == b) {
                let end = start + same.len();
                if same[0] && (same.len() as f64) < GAP {
                    bare[start..end].fill(false);
                }
                start = end;
            }
            if bare.contains(&true) {
                for (i, s) in samples.iter_mut().enumerate() {
                    let near = bare[i.saturating_sub(LAP)..bare.len().min(i + LAP + 1)].contains(&true);
                    s.seen = if near { Seen::Yes } else { Seen::Covered };
                }
                self.cut(samples, line.closed, line.kind, out);
            }
        }
    }

    /// Adds one stroke; `lifted` says at which ends it thins out.
    fn stroke(&self, line: &[Sample], closed: bool, lifted: [bool; 2], kind: Kind, out: &mut Vec<Stroke>) {
        let mut points = thinned(line, closed);
        if kind == Kind::Silhouette {
            // Taubin, A signal processing approach to fair surface design, 1995: every other pass outwards, so that circles do not shrink.
            [0.5, -0.53, 0.5, -0.53].into_iter().for_each(|by| smooth(&mut points, closed, by));
        }
        if points.len() < 2 {
            return;
        }
        let lengths = along(&points);
        let total = lengths.last().copied().unwrap_or(0.0);
        if kind == Kind::Silhouette && total < DOT * points[0].width && !points.iter().any(|s| self.is_rim(s)) {
            return;
        }
        let taper = self.pen.taper.min(total / 2.0);
        let rise = |distance: f64| if taper > 0.0 { (distance / taper).clamp(0.0, 1.0).sqrt() } else { 1.0 };
        let ends =
            |s: f64| if closed { 1.0 } else { (if lifted[0] { rise(s) } else { 1.0 }) * (if lifted[1] { rise(total - s) } else { 1.0 }) };
        let widths: Vec<f64> = points.iter().zip(&lengths).map(|(p, s)| p.width * ends(*s)).collect();
        let places: Vec<Point> = points.iter().map(|p| p.at).collect();
        let path = ink_widths(&places, &widths, closed);
        if !path.elements().is_empty() {
            let bounds = path.bounding_box();
            out.push(Stroke { rows: [bounds.y0, bounds.y1], path, places });
        }
    }
}

/// The pixels that the middles of strokes run through.
struct Inked {
    size: [usize; 2],
    pixels: Vec<bool>,
    /// Pixels from the middle of a stroke that it still has ink for.
    reach: usize,
}

impl Inked {
    fn new(size: [usize; 2], strokes: &[Stroke], width: f64) -> Self {
        let mut inked = Self { size, pixels: vec![false; size[0] * size[1]], reach: (width / 2.0).ceil() as usize };
        for pair in strokes.iter().flat_map(|s| s.places.windows(2)) {
            let steps = pair[0].distance(pair[1]).ceil().clamp(1.0, 64.0) as usize;
            for k in 0..=steps {
                let p = pair[0].lerp(pair[1], k as f64 / steps as f64);
                if p.x >= 0.0 && p.y >= 0.0 && p.x < size[0] as f64 && p.y < size[1] as f64 {
                    inked.pixels[p.y as usize * size[0] + p.x as usize] = true;
                }
            }
        }
        inked
    }

    /// True where no stroke is near a place well inside of the picture.
    fn is_bare(&self, at: Point) -> bool {
        let ([w, h], reach) = (self.size, self.reach);
        let least = reach as f64;
        if !(at.x >= least && at.y >= least && at.x + least + 1.0 < w as f64 && at.y + least + 1.0 < h as f64) {
            return false;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        (y - reach..=y + reach).all(|y| !self.pixels[y * w + x - reach..=y * w + x + reach].contains(&true))
    }
}

/// Marks where a line turns by more than thirty degrees.
fn mark_corners(line: &mut [Sample], closed: bool) {
    let n = line.len();
    let turn = |a: Point, b: Point, c: Point| {
        let (u, v) = (b - a, c - b);
        u.dot(v) < 0.866 * (u.hypot2() * v.hypot2()).sqrt()
    };
    for i in 1..n.saturating_sub(1) {
        line[i].corner = turn(line[i - 1].at, line[i].at, line[i + 1].at);
    }
    if closed && n > 3 {
        let corner = turn(line[n - 2].at, line[0].at, line[1].at);
        (line[0].corner, line[n - 1].corner) = (corner, corner);
    }
}

/// Closes gaps that are too short to be real, then drops pieces that are, but for those on the rim.
fn settle(line: &mut [Sample], is_rim: impl Fn(&Sample) -> bool) {
    for wanted in [Seen::Yes, Seen::Turned] {
        let mut start = 0;
        while start < line.len() {
            let here = line[start].seen == Seen::Yes;
            let end = line[start..].iter().position(|s| (s.seen == Seen::Yes) != here).map_or(line.len(), |i| i + start);
            let length: f64 = line[start..end].windows(2).map(|p| p[0].at.distance(p[1].at)).sum();
            let inside = start > 0 && end < line.len();
            let least = if here { GAP.max(DOT * line[start].width) } else { GAP };
            if here != (wanted == Seen::Yes) && inside && length < least && !(here && line[start..end].iter().any(&is_rim)) {
                line[start..end].iter_mut().for_each(|s| s.seen = if here { Seen::Covered } else { Seen::Yes });
            }
            start = end;
        }
    }
}

/// Samples some pixels apart, but all corners and both ends. A closed line loses its repeated end.
fn thinned(line: &[Sample], closed: bool) -> Vec<Sample> {
    let mut out: Vec<Sample> = Vec::with_capacity(line.len() / 2 + 2);
    for (i, s) in line.iter().enumerate() {
        let last = i + 1 == line.len();
        if (last && !closed) || s.corner || out.last().is_none_or(|p| p.at.distance(s.at) >= 2.5) {
            out.push(*s);
        }
    }
    if closed && out.len() > 1 && out[0].at.distance(out[out.len() - 1].at) < 1.0 {
        out.pop();
    }
    out
}

/// Moves places, and widths, by a part of the way to the middle of their neighbours; corners and free ends stay.
fn smooth(line: &mut [Sample], closed: bool, by: f64) {
    let old = line.to_vec();
    let n = old.len();
    for i in 0..n {
        if old[i].corner || n < 3 || (!closed && (i == 0 || i + 1 == n)) {
            continue;
        }
        let (a, b) = (old[(i + n - 1) % n], old[(i + 1) % n]);
        line[i].at = old[i].at.lerp(a.at.midpoint(b.at), by);
        line[i].width += ((a.width + b.width) / 2.0 - old[i].width) * by;
    }
}

/// The length from the start to each sample.
fn along(line: &[Sample]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = vec![0.0];
    for pair in line.windows(2) {
        sum += pair[0].at.distance(pair[1].at);
        out.push(sum);
    }
    out
}

/// Lays strokes over a picture of `width` columns. Where they overlap the ink is not darker.
pub(super) fn lay(strokes: &[Stroke], colour: [f32; 4], width: usize, image: &mut [f32], threads: usize) {
    let height = image.len() / (4 * width);
    let rows = rows_of(height, threads);
    let jobs = image.chunks_mut(4 * rows * width).enumerate().map(|(i, part)| (i * rows, part)).collect();
    on_threads(jobs, threads, |(): &mut (), (top, part): (usize, &mut [f32])| {
        let own = part.len() / (4 * width);
        let here: Vec<&Stroke> = strokes.iter().filter(|s| s.rows[1] >= top as f64 && s.rows[0] <= (top + own) as f64).collect();
        if here.is_empty() {
            return;
        }
        let mut ink = vec![0.0_f32; own * width];
        for stroke in here {
            let path = kurbo::Affine::translate((0.0, -(top as f64))) * &stroke.path;
            fill_rows(&path, FillRule::NonZero, width, own, |y, x0, row| {
                for (ink, cover) in ink[y * width + x0..].iter_mut().zip(row) {
                    *ink = ink.max(*cover);
                }
            });
        }
        for (pixel, ink) in part.chunks_exact_mut(4).zip(ink).filter(|(_, ink)| *ink > 0.0) {
            let keep = 1.0 - colour[3] * ink;
            pixel.iter_mut().zip(colour).for_each(|(below, above)| *below = *below * keep + above * ink);
        }
    });
}
