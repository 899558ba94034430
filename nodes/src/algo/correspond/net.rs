//! The lines of a mesh as a net, and the ways in it that are most like what is drawn.

use super::{Anchor, MeshLines, mix, onto, shares};
use crate::algo::mesh_lines::{Place, between, distance};
use crate::algo::shortest_way::shortest_way;

/// A point of the net.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    pub(super) at: [f64; 2],
    seen: bool,
    /// None within a triangle.
    pub(super) place: Option<Place>,
}

/// A step of the net.
#[derive(Clone, Copy, Debug)]
struct Link {
    to: usize,
    cost: f64,
    kind: Step,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Along a line.
    Along,
    /// From one line to another.
    Over,
    /// From a line to itself: outlines of meshes run to and fro on edges, but thin limbs are to be gone round.
    Short,
}

/// The mesh's lines as a net: neighbours on a line, where lines cross in the picture, and where they come near each other.
pub(super) struct Net {
    /// The points of the lines first.
    pub(super) knots: Vec<Knot>,
    near: Vec<Vec<Link>>,
    /// Where each anchor is.
    pub(super) ends: Vec<Option<usize>>,
}

/// How much dearer a way is where nobody sees it, and across a gap.
const HIDDEN: f64 = 4.0;
const GAP: f64 = 3.0;
/// What going over to another line costs in any case, pixels, or ways would change lines for nothing.
const CHANGE: f64 = 0.5;
/// Where lines run this near to an anchor, pixels, it may be meant to stand on any of them.
const BESIDE: f64 = 3.0;
/// Places of a drawn section that ways are compared with.
const SAMPLES: usize = 128;

impl Net {
    pub(super) fn new(lines: &MeshLines<'_>, anchors: &[Anchor], bridge: f64) -> Self {
        let segments = Segments::new(lines);
        let knots: Vec<Knot> =
            (0..segments.points.len()).map(|i| Knot { at: segments.points[i], seen: lines.seen(i), place: lines.place(i) }).collect();
        let mut build = Build { knots, splits: vec![Vec::new(); segments.points.len()], segments: &segments };
        let ends: Vec<Option<usize>> = anchors.iter().map(|a| a.spot.and_then(|s| build.knot(s.from, s.to, s.share))).collect();
        let mut changes = Vec::new();
        let kind = |a: usize, b: usize| if segments.line[a] == segments.line[b] { Step::Short } else { Step::Over };
        for [a, b] in segments.meetings(lines, bridge) {
            changes.extend(build.at(a).zip(build.at(b)).map(|(p, q)| (kind(a.0, b.0), p, q)));
        }
        for (a, &end) in anchors.iter().zip(&ends) {
            let Some((spot, end)) = a.spot.zip(end) else { continue };
            for near in segments.beside(lines, build.knots[end].at, bridge.min(BESIDE)) {
                changes.extend(build.at(near).filter(|k| *k != end).map(|k| (kind(spot.from, near.0), end, k)));
            }
        }
        let Build { knots, splits, .. } = build;
        let mut net = Self { near: vec![Vec::new(); knots.len()], knots, ends };
        for (i, mut own) in splits.into_iter().enumerate() {
            let Some(j) = segments.next[i] else { continue };
            own.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut last = i;
            for k in own.into_iter().map(|s| s.1).chain([j]) {
                net.join(last, k, Step::Along);
                last = k;
            }
        }
        changes.into_iter().for_each(|(kind, a, b)| net.join(a, b, kind));
        net
    }

    fn join(&mut self, a: usize, b: usize, kind: Step) {
        let length = distance(self.knots[a].at, self.knots[b].at);
        if length.is_finite() {
            let hidden = if self.knots[a].seen && self.knots[b].seen { 1.0 } else { HIDDEN };
            let cost = if kind == Step::Along { length * hidden + 1e-6 } else { length * hidden * GAP + CHANGE };
            self.near[a].push(Link { to: b, cost, kind });
            self.near[b].push(Link { to: a, cost, kind });
        }
    }

    /// A way with places between its points, at most `step` apart, wherever it runs along an edge of the mesh.
    pub(super) fn dense(&self, way: &[usize], step: f64) -> Vec<Knot> {
        let mut out: Vec<Knot> = way.first().map(|&k| self.knots[k]).into_iter().collect();
        for w in way.windows(2) {
            let (a, b) = (self.knots[w[0]], self.knots[w[1]]);
            let along = self.near[w[0]].iter().any(|l| l.to == w[1] && l.kind == Step::Along);
            let length = distance(a.at, b.at);
            if let (true, true, Some((p, q))) = (along, step > 0.0 && length > step, a.place.zip(b.place)) {
                let parts = (length / step).ceil();
                let inner = (1..parts as usize).map(|i| i as f64 / parts);
                let knot =
                    |t: f64| between(p, q, t).map(|place| Knot { at: mix(a.at, b.at, t), seen: a.seen && b.seen, place: Some(place) });
                out.extend(inner.filter_map(knot));
            }
            out.push(b);
        }
        out
    }

    /// Of several ways between two points the one that is most like the drawn section: the shortest, the shortest that keeps off that, and those that keep
    /// nearest to the section, without and with short cuts from a line to itself.
    pub(super) fn best(&self, ends: [usize; 2], length: f64, section: &impl Fn(f64) -> [f64; 2]) -> Option<Vec<usize>> {
        let first = self.way(ends, &[], false, &mut |_| 1.0);
        let inner = first.as_ref().and_then(|w| w.get(1..w.len() - 1)).unwrap_or_default();
        let second = self.way(ends, inner, false, &mut |_| 1.0);
        let shape = self.moved(ends, section);
        let width = 2.0 + 0.02 * length;
        let mut known = vec![f64::NAN; self.knots.len()];
        let mut dear = |k: usize| {
            if known[k].is_nan() {
                let off = shape.iter().map(|p| (p[0] - self.knots[k].at[0]).powi(2) + (p[1] - self.knots[k].at[1]).powi(2));
                known[k] = 1.0 + off.fold(f64::INFINITY, f64::min).sqrt() / width;
            }
            known[k]
        };
        let (third, fourth) = (self.way(ends, &[], false, &mut dear), self.way(ends, &[], true, &mut dear));
        let all = [first, second, third, fourth].into_iter().flatten();
        all.map(|w| (self.mismatch(&w, section), w)).min_by(|a, b| a.0.total_cmp(&b.0)).map(|b| b.1)
    }

    /// A drawn section once its ends are moved to those of a way.
    fn moved(&self, ends: [usize; 2], section: &impl Fn(f64) -> [f64; 2]) -> Vec<[f64; 2]> {
        let [a, b] = ends.map(|k| self.knots[k].at);
        let (x, y) = (section(0.0), section(1.0));
        let one = |i: usize| {
            let s = i as f64 / SAMPLES as f64;
            let p = section(s);
            [0, 1].map(|k| p[k] + (a[k] - x[k]) * (1.0 - s) + (b[k] - y[k]) * s)
        };
        (0..=SAMPLES).map(one).collect()
    }

    /// The mean distance of a way from a drawn section once both ends are on each other, pixels; what nobody sees counts as a few pixels off.
    fn mismatch(&self, way: &[usize], section: &impl Fn(f64) -> [f64; 2]) -> f64 {
        let knots: Vec<Knot> = way.iter().map(|&i| self.knots[i]).collect();
        let places: Vec<[f64; 2]> = knots.iter().map(|k| k.at).collect();
        let shares = shares(&places);
        let (Some(&a), Some(&b)) = (places.first(), places.last()) else { return f64::INFINITY };
        let (x, y) = (section(0.0), section(1.0));
        let off = |(p, &s): (&[f64; 2], &f64)| {
            let to = section(s);
            let moved = [0, 1].map(|k| p[k] + (x[k] - a[k]) * (1.0 - s) + (y[k] - b[k]) * s);
            distance(moved, to)
        };
        let offs: Vec<f64> = places.iter().zip(&shares).map(off).collect();
        let hidden = |i: usize| if knots[i].seen && knots[i + 1].seen { 0.0 } else { HIDDEN };
        (0..offs.len() - 1).map(|i| (shares[i + 1] - shares[i]) * ((offs[i] + offs[i + 1]) / 2.0 + hidden(i))).sum()
    }

    /// The cheapest way (Dijkstra) that keeps off some points, with or without short cuts, each step as much dearer as `dear` says of where it leads.
    fn way(&self, [from, to]: [usize; 2], banned: &[usize], short: bool, dear: &mut impl FnMut(usize) -> f64) -> Option<Vec<usize>> {
        // Neighbours themselves: the other way is not the same edge.
        let direct = banned.is_empty();
        let may = |at: usize, link: &Link| {
            !banned.contains(&link.to) && (short || link.kind != Step::Short) && (direct || at != from || link.to != to)
        };
        shortest_way(self.knots.len(), [from, to], |at, step| {
            self.near[at].iter().filter(|link| may(at, link)).for_each(|link| step(link.to, link.cost * dear(link.to)));
        })
        .filter(|_| from != to)
    }
}

/// A net while its segments are being split.
struct Build<'a> {
    knots: Vec<Knot>,
    /// Of each segment the points within it.
    splits: Vec<Vec<(f64, usize)>>,
    segments: &'a Segments,
}

impl Build<'_> {
    fn at(&mut self, (segment, share): (usize, f64)) -> Option<usize> {
        self.knot(segment, self.segments.next.get(segment).copied().flatten().unwrap_or(segment), share)
    }

    /// The point at a place of a segment, a new one within it.
    fn knot(&mut self, from: usize, to: usize, share: f64) -> Option<usize> {
        let (a, b) = (*self.knots.get(from)?, *self.knots.get(to)?);
        if from == to || share <= 1e-9 {
            return Some(from);
        }
        if share >= 1.0 - 1e-9 {
            return Some(to);
        }
        if let Some(known) = self.splits.get(from)?.iter().find(|k| (k.0 - share).abs() < 1e-9) {
            return Some(known.1);
        }
        let place = a.place.zip(b.place).and_then(|(a, b)| between(a, b, share));
        // A line goes out of sight where it meets another: up to there it is seen.
        self.knots.push(Knot { at: mix(a.at, b.at, share), seen: a.seen || b.seen, place });
        self.splits.get_mut(from)?.push((share, self.knots.len() - 1));
        Some(self.knots.len() - 1)
    }
}

/// All segments of the lines, each by its first point.
struct Segments {
    points: Vec<[f64; 2]>,
    /// The point after each on its line.
    next: Vec<Option<usize>>,
    /// The line of each point.
    line: Vec<usize>,
    /// How far along its line each point is, and how long the lines are that are closed.
    along: Vec<f64>,
    round: Vec<f64>,
}

/// The nearest place of a line to a point: the line, how far, the segment and the share.
type Nearby = (usize, f64, (usize, f64));

impl Segments {
    fn new(lines: &MeshLines<'_>) -> Self {
        let mut out = Self { points: Vec::new(), next: Vec::new(), line: Vec::new(), along: Vec::new(), round: Vec::new() };
        for (l, strand) in lines.strands.iter().enumerate() {
            let (n, first) = (strand.points.len(), out.points.len());
            let closed = strand.closed && n > 2;
            let mut sum = 0.0;
            for (i, p) in strand.points.iter().enumerate() {
                sum += if i > 0 { distance(*p, strand.points[i - 1]) } else { 0.0 };
                out.points.push(*p);
                out.line.push(l);
                out.along.push(sum);
                out.next.push(if i + 1 < n { Some(first + i + 1) } else { closed.then_some(first) });
            }
            let last = strand.points.first().zip(strand.points.last()).map_or(0.0, |(a, b)| distance(*a, *b));
            out.round.push(if closed { sum + last } else { f64::INFINITY });
        }
        out
    }

    /// Places of two segments each at which a way may go over: where lines cross, and from each seen point the nearest place of each other line, or of its own
    /// farther along, within `most`.
    fn meetings(&self, lines: &MeshLines<'_>, most: f64) -> Vec<[(usize, f64); 2]> {
        let finite = |i: usize| self.points[i].iter().all(|v| v.is_finite());
        let mut all: Vec<[usize; 2]> =
            (0..self.points.len()).filter_map(|i| Some([i, self.next[i]?])).filter(|s| s.iter().all(|i| finite(*i))).collect();
        let low = |s: &[usize; 2], k: usize| self.points[s[0]][k].min(self.points[s[1]][k]);
        let high = |s: &[usize; 2], k: usize| self.points[s[0]][k].max(self.points[s[1]][k]);
        all.sort_by(|a, b| low(a, 0).total_cmp(&low(b, 0)).then(a.cmp(b)));
        let mut out = Vec::new();
        let mut best: Vec<Vec<Nearby>> = vec![Vec::new(); self.points.len()];
        for (k, a) in all.iter().enumerate() {
            let (right, top, bottom) = (high(a, 0) + most, low(a, 1) - most, high(a, 1) + most);
            for b in all[k + 1..].iter().take_while(|b| low(b, 0) <= right).filter(|b| low(b, 1) <= bottom && high(b, 1) >= top) {
                let apart = a.iter().all(|i| !b.contains(i));
                if let Some((t, u)) = crossing(a.map(|i| self.points[i]), b.map(|i| self.points[i])).filter(|_| apart) {
                    out.push([(a[0], t), (b[0], u)]);
                }
                if most > 0.0 {
                    a.iter().for_each(|&p| self.look(lines, p, *b, most, &mut best[p]));
                    b.iter().for_each(|&p| self.look(lines, p, *a, most, &mut best[p]));
                }
            }
        }
        for (p, all) in best.iter().enumerate() {
            out.extend(all.iter().map(|n| [(p, 0.0), n.2]));
        }
        out
    }

    /// The places of all segments that are seen within `most` of a point.
    fn beside(&self, lines: &MeshLines<'_>, at: [f64; 2], most: f64) -> Vec<(usize, f64)> {
        let one = |(i, j): (usize, &Option<usize>)| {
            let j = (*j)?;
            let (t, off) = onto(at, self.points[i], self.points[j]);
            (off <= most && (lines.seen(i) || lines.seen(j))).then_some((i, t))
        };
        if most > 0.0 { self.next.iter().enumerate().filter_map(one).collect() } else { Vec::new() }
    }

    /// Notes the place of a segment nearest to a point where it is the nearest of its line so far.
    fn look(&self, lines: &MeshLines<'_>, p: usize, segment: [usize; 2], most: f64, best: &mut Vec<Nearby>) {
        if !lines.seen(p) || !segment.iter().any(|i| lines.seen(*i)) {
            return;
        }
        let line = self.line[segment[0]];
        let (t, d) = onto(self.points[p], self.points[segment[0]], self.points[segment[1]]);
        let off = (self.along[p] - self.along[segment[0]]).abs();
        if line == self.line[p] && off.min(self.round[line] - off) <= 3.0 * d + 2.0 {
            return;
        }
        match best.iter_mut().find(|e| e.0 == line) {
            _ if d > most => {}
            Some(e) if d < e.1 => *e = (line, d, (segment[0], t)),
            Some(_) => {}
            None => best.push((line, d, (segment[0], t))),
        }
    }
}

/// Where two segments cross: the share of each.
fn crossing([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> Option<(f64, f64)> {
    let (r, s, q) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]], [c[0] - a[0], c[1] - a[1]]);
    let cross = |x: [f64; 2], y: [f64; 2]| x[0] * y[1] - x[1] * y[0];
    let det = cross(r, s);
    let (t, u) = (cross(q, s) / det, cross(q, r) / det);
    ((0.0..=1.0).contains(&t) && (0.0..=1.0).contains(&u)).then_some((t, u))
}
