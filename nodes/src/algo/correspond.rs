//! Which point of a mesh's lines is drawn where: sections between anchors, paired along their lengths.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2: "anchors are connected along silhouette edges of the mesh, and by
//! a snake in the drawing". Pairing by corners: Sakoe, Chiba 1978 on the curves' directions.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use pegbar_engine::Setting;

use super::mesh_lines::distance;

/// How the points of two sections are paired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Pairing {
    /// At the same share of their lengths.
    Length,
    /// So that what runs alike comes together: corners on corners.
    Corners,
}

/// A line of a mesh or of a drawing.
#[derive(Clone, Copy, Debug)]
pub struct Strand<'a> {
    /// Position of its first point among all.
    pub first: usize,
    /// Its points.
    pub points: &'a [[f64; 2]],
    /// True where the last joins the first.
    pub closed: bool,
}

/// A place on an edge of the mesh: its vertices, the same one twice at a vertex, and the share of the way from the first to the second.
pub type Place = ([u32; 2], f64);

/// The lines of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshLines<'a> {
    /// The lines.
    pub strands: &'a [Strand<'a>],
    /// For each point 0 where something hides it; none at all where all is seen.
    pub visible: &'a [u8],
    /// For each point the vertices of the edge that it lies on.
    pub edges: &'a [[u32; 2]],
    /// For each point how far along that edge it is.
    pub shares: &'a [f64],
}

impl MeshLines<'_> {
    fn seen(&self, i: usize) -> bool {
        self.visible.get(i).is_none_or(|v| *v != 0)
    }

    fn place(&self, i: usize) -> Option<Place> {
        self.edges.get(i).copied().zip(self.shares.get(i).copied())
    }
}

/// A place on the mesh's lines: a share of the way from one of their points to the next, or a point alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Position of the first among all points.
    pub from: usize,
    /// Position of the second, which follows on the same line; the same for a point alone.
    pub to: usize,
    /// 0 at the first, 1 at the second.
    pub share: f64,
}

impl Spot {
    /// A point of the lines.
    pub fn point(at: usize) -> Self {
        Self { from: at, to: at, share: 0.0 }
    }
}

/// The place a share of the way from one place to another, where both lie on one edge. Perspective is left out: it is the share on the mesh.
pub fn between(a: Place, b: Place, share: f64) -> Option<Place> {
    let mut weights: Vec<(u32, f64)> = Vec::with_capacity(4);
    for (([v, w], s), part) in [(a, 1.0 - share), (b, share)] {
        for (vertex, own) in [(v, 1.0 - s), (w, s)].into_iter().filter(|o| o.1 > 1e-9) {
            match weights.iter_mut().find(|o| o.0 == vertex) {
                Some(known) => known.1 += own * part,
                None => weights.push((vertex, own * part)),
            }
        }
    }
    weights.retain(|w| w.1 > 1e-9);
    weights.sort_by_key(|w| w.0);
    match weights[..] {
        [(v, _)] => Some(([v, v], 0.0)),
        [(v, a), (w, b)] => Some(([v, w], b / (a + b))),
        _ => None,
    }
}

/// The place of a line's segment nearest to a pixel, of those that are seen, and how far off it is. A segment that goes out of sight counts a pixel farther.
/// Cost: O(points).
pub fn nearest_spot(lines: &MeshLines<'_>, at: [f64; 2]) -> Option<(Spot, f64)> {
    let mut best: Option<(Spot, f64, f64)> = None;
    for l in lines.strands {
        let n = l.points.len();
        for i in 0..n {
            let j = if i + 1 < n {
                i + 1
            } else if l.closed {
                0
            } else {
                i
            };
            let ends = [lines.seen(l.first + i), lines.seen(l.first + j)];
            if ends == [false, false] {
                continue;
            }
            let (share, off) = onto(at, l.points[i], l.points[j]);
            let counts = if ends == [true, true] { off } else { off + 1.0 };
            if off.is_finite() && best.is_none_or(|b| counts < b.2) {
                best = Some((Spot { from: l.first + i, to: l.first + j, share }, off, counts));
            }
        }
    }
    best.map(|(spot, off, _)| (spot, off))
}

/// The share of a segment nearest to a point, and how far that is.
fn onto(point: [f64; 2], a: [f64; 2], b: [f64; 2]) -> (f64, f64) {
    let d = [b[0] - a[0], b[1] - a[1]];
    let length_sq = d[0] * d[0] + d[1] * d[1];
    let t = if length_sq > 0.0 { ((point[0] - a[0]) * d[0] + (point[1] - a[1]) * d[1]) / length_sq } else { 0.0 };
    let t = t.clamp(0.0, 1.0);
    (t, distance(point, mix(a, b, t)))
}

fn mix(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
}

/// Where an anchor stands on the mesh's lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// The place on the lines that it is at; none where it stands by itself.
    pub spot: Option<Spot>,
    /// Where it is drawn.
    pub drawn: [f64; 2],
}

/// A pair: a place on an edge of the mesh and where it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The vertices of the edge.
    pub edge: [u32; 2],
    /// How far along it.
    pub share: f64,
    /// Place in the picture.
    pub at: [f64; 2],
    /// Place in the drawing.
    pub drawn: [f64; 2],
}

/// What keeps sections from being paired.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CorrespondError {
    /// No way between two anchors on the mesh.
    #[error("anchors {from} and {to}: expected a way between them along the lines of the mesh, found none within gaps of {bridge} px")]
    NoWay {
        /// Number of the first, from 1.
        from: usize,
        /// Number of the second.
        to: usize,
        /// The widest gap that is bridged.
        bridge: f64,
    },
}

/// How.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Pairing within a section.
    pub pairing: Pairing,
    /// How far an anchor's drawn place may be from the drawn curve that it stands on, pixels.
    pub snap: f64,
    /// Widest gap between two lines of the mesh that a way goes across, pixels.
    pub bridge: f64,
    /// Least distance between two pairs on the mesh's side, pixels.
    pub spacing: f64,
    /// Most distance between two pairs where a line runs along an edge, pixels; 0 pairs the points of the lines alone.
    pub step: f64,
    /// What becomes of a section without a way.
    pub missing: Missing,
}

/// What becomes of a section of the drawing that has no way on the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Missing {
    /// It is an error.
    Error,
    /// It is left unpaired, and counted.
    Skip,
}

/// What was paired.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paired {
    /// The pairs between anchors, not those of the anchors themselves.
    pub pairs: Vec<Pair>,
    /// Sections that were found.
    pub sections: usize,
    /// Sections without a way.
    pub skipped: usize,
}

/// How much farther than from the nearest curve an anchor may be from others that it is of too, pixels: two traces of one line are as far apart.
const MEET: f64 = 1.0;

/// For each drawn curve the anchors that stand on it, in their order along it: each on the curve nearest to it.
fn on_curves(drawn: &[Along<'_>], anchors: &[Anchor], snap: f64) -> Vec<Vec<(f64, usize)>> {
    let mut out = vec![Vec::new(); drawn.len()];
    for (k, a) in anchors.iter().enumerate().filter(|(_, a)| a.spot.is_some()) {
        let all: Vec<(f64, f64)> = drawn.iter().map(|own| own.nearest(a.drawn)).collect();
        let least = all.iter().map(|n| n.0).fold(f64::INFINITY, f64::min);
        for (on, (off, place)) in out.iter_mut().zip(all) {
            if off <= snap && off <= least + MEET {
                on.push((place, k));
            }
        }
    }
    out.iter_mut().for_each(|on| on.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))));
    out
}

/// Pairs the mesh's lines with drawn curves, section by section between anchors that follow each other on a drawn curve. An anchor stands on the drawn curve
/// nearest to it, and on others that meet it there; away from any it stands for itself. Cost: O(sections · n log n) with n points of the lines, and O(n²) for
/// where they meet.
///
/// # Errors
/// Where there is no way between two anchors along the mesh's lines.
pub fn pair(lines: &MeshLines<'_>, drawn: &[Strand<'_>], anchors: &[Anchor], options: &Options) -> Result<Paired, CorrespondError> {
    let net = Net::new(lines, anchors, options.bridge);
    let curves: Vec<Along<'_>> = drawn.iter().map(Along::new).collect();
    let mut out = Paired::default();
    for (own, on) in curves.iter().zip(on_curves(&curves, anchors, options.snap)) {
        let n = on.len();
        let sections = if own.strand.closed && n > 1 { n } else { n.saturating_sub(1) };
        for s in 0..sections {
            let ((from, a), (mut to, b)) = (on[s], on[(s + 1) % n]);
            if s + 1 == n {
                to += own.length();
            }
            if to - from < 1e-9 {
                continue;
            }
            let section = |share: f64| own.at(from + (to - from) * share);
            let way = net.ends[a].zip(net.ends[b]).and_then(|(a, b)| net.best([a, b], to - from, &section));
            match (way, options.missing) {
                (Some(way), _) => {
                    out.sections += 1;
                    out.pairs.extend(paired(&net, &way, &section, options));
                }
                (None, Missing::Skip) => out.skipped += 1,
                (None, Missing::Error) => return Err(CorrespondError::NoWay { from: a + 1, to: b + 1, bridge: options.bridge }),
            }
        }
    }
    Ok(out)
}

/// The inner points of a way with their places in a drawn section.
fn paired(net: &Net, way: &[usize], section: &impl Fn(f64) -> [f64; 2], options: &Options) -> Vec<Pair> {
    let points = net.dense(way, options.step);
    let places: Vec<[f64; 2]> = points.iter().map(|p| p.at).collect();
    let shares = shares(&places);
    let to = match options.pairing {
        Pairing::Length => shares.clone(),
        Pairing::Corners => corners(&places, &shares, section),
    };
    let mut out = Vec::new();
    let mut last = places.first().copied().unwrap_or_default();
    let end = places.last().copied().unwrap_or_default();
    for i in 1..points.len().saturating_sub(1) {
        let Some((edge, share)) = points[i].place else { continue };
        if distance(places[i], last) >= options.spacing && distance(places[i], end) >= options.spacing {
            out.push(Pair { edge, share, at: places[i], drawn: section(to[i]) });
            last = places[i];
        }
    }
    out
}

/// The share of the length at each point.
fn shares(points: &[[f64; 2]]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = vec![0.0];
    for p in points.windows(2) {
        sum += distance(p[0], p[1]);
        out.push(sum);
    }
    let n = out.len().max(2) - 1;
    out.iter_mut().enumerate().for_each(|(i, s)| *s = if sum > 0.0 { *s / sum } else { i as f64 / n as f64 });
    out
}

/// Places on both sections at which they are compared.
const STEPS: usize = 96;

/// The share of the drawn section for each point of a way, by the cheapest monotone matching of directions.
fn corners(points: &[[f64; 2]], shares: &[f64], section: &impl Fn(f64) -> [f64; 2]) -> Vec<f64> {
    let at = |s: f64| {
        let i = shares.partition_point(|v| *v <= s).clamp(1, points.len() - 1);
        let step = shares[i] - shares[i - 1];
        let t = if step > 0.0 { ((s - shares[i - 1]) / step).clamp(0.0, 1.0) } else { 0.0 };
        [0, 1].map(|k| points[i - 1][k] + (points[i][k] - points[i - 1][k]) * t)
    };
    // Directions against that of the whole: a limb that was drawn elsewhere has its corners all the same.
    let directions = |f: &dyn Fn(f64) -> [f64; 2]| -> Vec<f64> {
        let (a, b) = (f(0.0), f(1.0));
        let whole = libm::atan2(b[1] - a[1], b[0] - a[0]);
        let one = |i: usize| {
            let s = i as f64 / STEPS as f64;
            let (p, q) = (f((s - 1.0 / STEPS as f64).max(0.0)), f((s + 1.0 / STEPS as f64).min(1.0)));
            libm::atan2(q[1] - p[1], q[0] - p[0]) - whole
        };
        (0..=STEPS).map(one).collect()
    };
    let (mesh, drawn) = (directions(&at), directions(section));
    let cost = |i: usize, j: usize| {
        let turn = 1.0 - libm::cos(mesh[i] - drawn[j]);
        let shift = (i as f64 - j as f64) / STEPS as f64;
        turn + 2.0 * shift * shift
    };
    let n = STEPS + 1;
    let (mut sum, mut from) = (vec![f64::INFINITY; n * n], vec![0_u8; n * n]);
    sum[0] = cost(0, 0);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).skip(1) {
        let get = |ok: bool, i: usize, j: usize| if ok { sum[i * n + j] } else { f64::INFINITY };
        let ways = [
            get(i > 0 && j > 0, i.wrapping_sub(1), j.wrapping_sub(1)),
            // Standing still on one side is dearer than it looks, or all would gather in the corners.
            get(i > 0, i.wrapping_sub(1), j) + 0.05,
            get(j > 0, i, j.wrapping_sub(1)) + 0.05,
        ];
        let best = (0..3).min_by(|a, b| ways[*a].total_cmp(&ways[*b])).unwrap_or(0);
        (sum[i * n + j], from[i * n + j]) = (ways[best] + cost(i, j), best as u8);
    }
    let (mut path, mut i, mut j) = (vec![(STEPS, STEPS)], STEPS, STEPS);
    while (i, j) != (0, 0) {
        match from[i * n + j] {
            0 => (i, j) = (i - 1, j - 1),
            1 => i -= 1,
            _ => j -= 1,
        }
        path.push((i, j));
    }
    path.reverse();
    // The middle of all that a step of the way was matched with.
    let mut sums = vec![(0.0, 0.0); n];
    path.iter().for_each(|&(i, j)| sums[i] = (sums[i].0 + j as f64, sums[i].1 + 1.0));
    let mut map: Vec<f64> = sums.into_iter().map(|(s, c)| s / c / STEPS as f64).collect();
    (map[0], map[STEPS]) = (0.0, 1.0);
    let to = |s: f64| {
        let x = (s * STEPS as f64).clamp(0.0, STEPS as f64);
        let i = (x as usize).min(STEPS - 1);
        map[i] + (map[i + 1] - map[i]) * (x - i as f64)
    };
    shares.iter().map(|&s| to(s)).collect()
}

/// A curve by its length.
pub struct Along<'a> {
    strand: &'a Strand<'a>,
    places: Vec<f64>,
}

impl<'a> Along<'a> {
    /// Of a line.
    pub fn new(strand: &'a Strand<'a>) -> Self {
        let n = strand.points.len();
        let mut places = vec![0.0];
        for i in 0..if strand.closed { n } else { n.saturating_sub(1) } {
            places.push(places[i] + distance(strand.points[i], strand.points[(i + 1) % n]));
        }
        Self { strand, places }
    }

    /// Its whole length.
    pub fn length(&self) -> f64 {
        self.places.last().copied().unwrap_or(0.0)
    }

    /// The point at a place; it goes round a closed line.
    pub fn at(&self, place: f64) -> [f64; 2] {
        let (n, length) = (self.strand.points.len(), self.length());
        if n < 2 || length <= 0.0 {
            return self.strand.points.first().copied().unwrap_or_default();
        }
        let place = if self.strand.closed { place - (place / length).floor() * length } else { place.clamp(0.0, length) };
        let i = self.places.partition_point(|p| *p <= place).clamp(1, self.places.len() - 1);
        let step = self.places[i] - self.places[i - 1];
        let t = if step > 0.0 { (place - self.places[i - 1]) / step } else { 0.0 };
        mix(self.strand.points[i - 1], self.strand.points[i % n], t)
    }

    /// How far a point is from it, and the place nearest to it.
    pub fn nearest(&self, point: [f64; 2]) -> (f64, f64) {
        let n = self.strand.points.len();
        let mut best = (f64::INFINITY, 0.0);
        for i in 1..self.places.len() {
            let (a, b) = (self.strand.points[i - 1], self.strand.points[i % n]);
            let (t, off) = onto(point, a, b);
            if off < best.0 {
                best = (off, self.places[i - 1] + t * (self.places[i] - self.places[i - 1]));
            }
        }
        best
    }
}

/// A point of the net.
#[derive(Clone, Copy, Debug)]
struct Knot {
    at: [f64; 2],
    seen: bool,
    /// None within a triangle.
    place: Option<Place>,
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
struct Net {
    /// The points of the lines first.
    knots: Vec<Knot>,
    near: Vec<Vec<Link>>,
    /// Where each anchor is.
    ends: Vec<Option<usize>>,
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
    fn new(lines: &MeshLines<'_>, anchors: &[Anchor], bridge: f64) -> Self {
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
    fn dense(&self, way: &[usize], step: f64) -> Vec<Knot> {
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
    fn best(&self, ends: [usize; 2], length: f64, section: &impl Fn(f64) -> [f64; 2]) -> Option<Vec<usize>> {
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
        let n = self.knots.len();
        if from == to {
            return None;
        }
        let (mut cost, mut before, mut closed) = (vec![f64::INFINITY; n], vec![usize::MAX; n], vec![false; n]);
        banned.iter().for_each(|&b| closed[b] = true);
        // Neighbours themselves: the other way is not the same edge.
        let direct = banned.is_empty();
        let mut open = BinaryHeap::from([Open { cost: 0.0, at: from }]);
        cost[from] = 0.0;
        while let Some(Open { cost: here, at }) = open.pop() {
            if std::mem::replace(&mut closed[at], true) {
                continue;
            }
            if at == to {
                break;
            }
            for link in &self.near[at] {
                let next = link.to;
                if closed[next] || (link.kind == Step::Short && !short) || !(direct || at != from || next != to) {
                    continue;
                }
                let there = here + link.cost * dear(next);
                if there < cost[next] {
                    (cost[next], before[next]) = (there, at);
                    open.push(Open { cost: there, at: next });
                }
            }
        }
        if before[to] == usize::MAX {
            return None;
        }
        let (mut way, mut at) = (vec![to], to);
        while at != from {
            at = before[at];
            way.push(at);
        }
        way.reverse();
        Some(way)
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

#[derive(PartialEq)]
struct Open {
    cost: f64,
    at: usize,
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.at.cmp(&self.at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ellipse(n: usize, centre: [f64; 2], [a, b]: [f64; 2]) -> Vec<[f64; 2]> {
        let at = |i: usize| {
            let (s, c) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
            [centre[0] + a * c, centre[1] + b * s]
        };
        (0..n).map(at).collect()
    }

    fn options() -> Options {
        Options { pairing: Pairing::Length, snap: 3.0, bridge: 6.0, spacing: 0.0, step: 0.0, missing: Missing::Error }
    }

    /// Every point at a vertex of its own.
    fn vertices(n: usize) -> (Vec<[u32; 2]>, Vec<f64>) {
        ((0..n as u32).map(|i| [i; 2]).collect(), vec![0.0; n])
    }

    fn find(
        lines: &[Strand<'_>],
        visible: &[u8],
        drawn: &[Strand<'_>],
        anchors: &[Anchor],
        options: &Options,
    ) -> Result<Paired, CorrespondError> {
        let (edges, shares) = vertices(lines.iter().map(|l| l.points.len()).sum());
        pair(&MeshLines { strands: lines, visible, edges: &edges, shares: &shares }, drawn, anchors, options)
    }

    fn anchor(at: usize, drawn: [f64; 2]) -> Anchor {
        Anchor { spot: Some(Spot::point(at)), drawn }
    }

    fn strand(points: &[[f64; 2]], closed: bool) -> Strand<'_> {
        Strand { first: 0, points, closed }
    }

    #[test]
    fn a_closed_line_goes_the_way_that_the_drawing_goes() {
        let (mesh, drawn) = (ellipse(80, [50.0, 50.0], [30.0, 30.0]), ellipse(300, [60.0, 40.0], [45.0, 25.0]));
        // A quarter and three quarters between two anchors: the longer way must not be cut short.
        let anchors = [(0, 0), (20, 75)].map(|(m, d)| anchor(m, drawn[d]));
        let found = find(&[strand(&mesh, true)], &[1; 80], &[strand(&drawn, true)], &anchors, &options()).unwrap();
        assert_eq!((found.sections, found.pairs.len()), (2, 78));
        for p in &found.pairs {
            let angle = std::f64::consts::TAU * f64::from(p.edge[0]) / 80.0;
            let truth = [60.0 + 45.0 * angle.cos(), 40.0 + 25.0 * angle.sin()];
            assert!(distance(p.drawn, truth) < 9.0, "{} at {:?}, not {truth:?}", p.edge[0], p.drawn);
        }
    }

    #[test]
    fn a_way_goes_over_to_the_line_that_hides_its_own() {
        // A line that goes behind a second one two pixels off.
        let first: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i), 10.0]).collect();
        let second: Vec<[f64; 2]> = (0..40).map(|i| [21.0, 11.0 + f64::from(i)]).collect();
        let all = [first.clone(), second.clone()].concat();
        let lines = [Strand { first: 0, points: &first, closed: false }, Strand { first: 40, points: &second, closed: false }];
        let visible: Vec<u8> = (0..80).map(|i| u8::from(!(21..40).contains(&i))).collect();
        let drawn: Vec<[f64; 2]> = vec![[0.0, 0.0], [21.0, 0.0], [21.0, 40.0]];
        let anchors = [anchor(0, drawn[0]), anchor(79, drawn[2])];
        let found = find(&lines, &visible, &[strand(&drawn, false)], &anchors, &options()).unwrap();
        assert!(found.pairs.iter().any(|p| p.edge[0] < 21) && found.pairs.iter().any(|p| p.edge[0] >= 40));
        assert!(found.pairs.iter().all(|p| visible[p.edge[0] as usize] == 1 && all[p.edge[0] as usize][0] < 22.0));
        let error = find(&lines, &visible, &[strand(&drawn, false)], &anchors, &Options { bridge: 0.5, ..options() }).unwrap_err();
        assert_eq!(
            error.to_string(),
            "anchors 1 and 2: expected a way between them along the lines of the mesh, found none within gaps of 0.5 px"
        );
    }

    #[test]
    fn corners_come_to_lie_on_corners() {
        let corner = |at: f64| vec![[0.0, 0.0], [at, 0.0], [at, 60.0]];
        let mesh: Vec<[f64; 2]> = (0..=100).map(|i| if i < 50 { [f64::from(i), 0.0] } else { [50.0, f64::from(i - 50)] }).collect();
        let drawn = corner(90.0);
        let anchors = [anchor(0, drawn[0]), anchor(100, drawn[2])];
        let at_corner = |pairing| {
            let found = find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], &anchors, &Options { pairing, ..options() }).unwrap();
            distance(found.pairs.iter().find(|p| p.edge[0] == 50).unwrap().drawn, [90.0, 0.0])
        };
        assert!(at_corner(Pairing::Length) > 10.0);
        assert!(at_corner(Pairing::Corners) < 3.0, "{}", at_corner(Pairing::Corners));
    }

    #[test]
    fn an_anchor_is_of_the_nearest_of_curves_that_run_close_by() {
        // Two lines of the mesh, drawn two pixels from each other, less than an anchor may be off: eyes that nearly touch.
        let [left, right] = [0.0, 40.0].map(|x| (0..=50).map(|i| [x, f64::from(i)]).collect::<Vec<_>>());
        let lines = [Strand { first: 0, points: &left, closed: false }, Strand { first: 51, points: &right, closed: false }];
        let drawn = [19.0, 21.0].map(|x| vec![[x, 0.0], [x, 50.0]]);
        let curves = [strand(&drawn[0], false), strand(&drawn[1], false)];
        let on = |at: usize, x: f64, y: f64| anchor(at, [x, y]);
        let ends = [on(0, 19.0, 0.0), on(50, 19.3, 50.0), on(51, 21.0, 0.0), on(101, 20.8, 50.0)];
        let found = find(&lines, &[], &curves, &ends, &options()).unwrap();
        assert_eq!((found.sections, found.pairs.len()), (2, 98));
        assert!(found.pairs.iter().all(|p| (p.drawn[0] - if p.edge[0] <= 50 { 19.0 } else { 21.0 }).abs() < 1e-9));
        // Where they meet it is of both.
        let cross = [vec![[0.0, 10.0], [50.0, 10.0]], vec![[25.0, 10.3], [25.0, 50.0]]];
        let mesh: Vec<[f64; 2]> = (0..=50).map(|i| [f64::from(i), 10.0]).chain((1..=40).map(|i| [25.0, 10.0 + f64::from(i)])).collect();
        let tee = [Strand { first: 0, points: &mesh[..51], closed: false }, Strand { first: 51, points: &mesh[51..], closed: false }];
        let ends = [on(0, 0.0, 10.0), on(25, 25.0, 10.0), on(50, 50.0, 10.0), on(90, 25.0, 50.0)];
        assert_eq!(find(&tee, &[], &[strand(&cross[0], false), strand(&cross[1], false)], &ends, &options()).unwrap().sections, 3);
    }

    #[test]
    fn anchors_away_from_curves_make_no_section_and_pairs_keep_their_distance() {
        let mesh: Vec<[f64; 2]> = (0..=100).map(|i| [f64::from(i), 0.0]).collect();
        let drawn = vec![[0.0, 5.0], [100.0, 5.0]];
        let on = |m: usize, x: f64, y: f64| anchor(m, [x, y]);
        let all_of = |anchors: &[Anchor], spacing| {
            find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], anchors, &Options { spacing, ..options() }).unwrap()
        };
        assert_eq!(all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 30.0)], 0.0), Paired::default());
        let all = all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 0.0);
        assert!(all.pairs.iter().all(|p| distance(p.drawn, [f64::from(p.edge[0]), 5.0]) < 1e-9) && all.pairs.len() == 99);
        assert_eq!(all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 10.0).pairs.len(), 9);
        assert_eq!(find(&[], &[], &[strand(&drawn, false)], &[], &options()).unwrap(), Paired::default());
    }

    #[test]
    fn a_drawn_curve_is_followed_along_an_edge() {
        // One edge of 100 px, drawn as an arc: pairs at every 4 px of it, where the arc is at that share of its length.
        let mesh = [[0.0, 0.0], [100.0, 0.0]];
        let arc = |t: f64| [50.0 - 50.0 * (std::f64::consts::PI * t).cos(), 50.0 * (std::f64::consts::PI * t).sin()];
        let drawn: Vec<[f64; 2]> = (0..=1000).map(|i| arc(f64::from(i) / 1000.0)).collect();
        let anchors = [anchor(0, drawn[0]), anchor(1, drawn[1000])];
        let at = |step, spacing| {
            find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], &anchors, &Options { step, spacing, ..options() }).unwrap().pairs
        };
        assert_eq!((at(0.0, 0.0).len(), at(4.0, 0.0).len(), at(4.0, 9.0).len()), (0, 24, 7));
        for (i, p) in at(4.0, 0.0).iter().enumerate() {
            let share = (i + 1) as f64 / 25.0;
            assert_eq!(p.edge, [0, 1]);
            assert!((p.share - share).abs() < 1e-12 && distance(p.at, [100.0 * share, 0.0]) < 1e-9);
            assert!(distance(p.drawn, arc(share)) < 0.01, "{p:?}");
        }
    }

    #[test]
    fn places_lie_between_others_on_the_same_edge_only() {
        assert_eq!(between(([4, 4], 0.0), ([2, 2], 0.0), 0.25), Some(([2, 4], 0.75)));
        assert_eq!(between(([2, 4], 0.5), ([4, 2], 0.0), 0.5), Some(([2, 4], 0.75)));
        assert_eq!(between(([2, 4], 0.5), ([2, 2], 0.0), 1.0), Some(([2, 2], 0.0)));
        assert_eq!(between(([2, 4], 0.5), ([2, 5], 0.5), 0.5), None);
    }

    #[test]
    fn ways_go_over_where_long_segments_cross() {
        // A line of one segment goes behind another of one: no point of either is near the crossing.
        let (first, second) = ([[0.0, 10.0], [100.0, 10.0]], [[50.0, -50.0], [50.0, 60.0]]);
        let lines = [Strand { first: 0, points: &first, closed: false }, Strand { first: 2, points: &second, closed: false }];
        let drawn = [[0.0, 10.0], [50.0, 10.0], [50.0, 60.0]];
        let anchors = [anchor(0, drawn[0]), anchor(3, drawn[2])];
        let options = Options { step: 4.0, ..options() };
        let found = find(&lines, &[1, 0, 1, 1], &[strand(&drawn, false)], &anchors, &options).unwrap();
        assert!(found.pairs.len() >= 24 && found.pairs.iter().all(|p| distance(p.at, p.drawn) < 1e-9), "{:?}", found.pairs);
    }

    #[test]
    fn a_drawing_that_is_the_render_moves_nothing() {
        // Two rings, one partly behind the other, and a short way through their middle; the drawing is the outline of both.
        let (left, right) = (ellipse(60, [50.0, 50.0], [30.0, 30.0]), ellipse(60, [90.0, 50.0], [30.0, 30.0]));
        let inside = |p: &[f64; 2], centre: f64| distance(*p, [centre, 50.0]) < 29.9;
        let bar: Vec<[f64; 2]> = (0..=20).map(|i| [70.0, 28.0 + 2.2 * f64::from(i)]).collect();
        let mut visible: Vec<u8> = left.iter().map(|p| u8::from(!inside(p, 90.0))).collect();
        visible.extend([1; 81]);
        let lines =
            [(0, &left, true), (60, &right, true), (120, &bar, false)].map(|(first, points, closed)| Strand { first, points, closed });
        // Round the left one from crossing to crossing, then round the right one.
        let corner = 30.0 * (1.0 - (20.0_f64 / 30.0).powi(2)).sqrt();
        let mut drawn = vec![[70.0, 50.0 + corner]];
        drawn.extend((0..60).map(|i| left[i]).filter(|p| !inside(p, 90.0)));
        drawn.push([70.0, 50.0 - corner]);
        drawn.extend((31..90).map(|i| right[i % 60]).filter(|p| !inside(p, 50.0)));
        let anchors = [anchor(30, left[30]), anchor(60, right[0])];
        let found = find(&lines, &visible, &[strand(&drawn, true)], &anchors, &options()).unwrap();
        assert_eq!(found.sections, 2);
        assert!(found.pairs.len() > 70);
        let worst = found.pairs.iter().map(|p| distance(p.at, p.drawn)).fold(0.0, f64::max);
        assert!(worst < 0.5, "{worst}");
    }

    #[test]
    fn a_section_without_a_way_is_left_out_where_that_is_asked_for() {
        let mesh = [[0.0, 0.0], [10.0, 0.0], [0.0, 90.0], [10.0, 90.0], [20.0, 90.0]];
        let lines = [Strand { first: 0, points: &mesh[..2], closed: false }, Strand { first: 2, points: &mesh[2..], closed: false }];
        let drawn = [[0.0, 0.0], [0.0, 90.0], [20.0, 90.0]];
        let anchors = [anchor(0, drawn[0]), anchor(2, drawn[1]), anchor(4, drawn[2])];
        let found = find(&lines, &[], &[strand(&drawn, false)], &anchors, &Options { missing: Missing::Skip, ..options() }).unwrap();
        assert_eq!((found.sections, found.skipped, found.pairs.len()), (1, 1, 1));
        assert!(find(&lines, &[], &[strand(&drawn, false)], &anchors, &options()).is_err());
    }

    #[test]
    fn the_nearest_spot_is_on_a_segment() {
        let mesh = [[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]];
        let (edges, shares) = vertices(3);
        let lines = [strand(&mesh, false)];
        let own = MeshLines { strands: &lines, visible: &[1, 1, 0], edges: &edges, shares: &shares };
        let (spot, off) = nearest_spot(&own, [40.0, 3.0]).unwrap();
        assert_eq!((spot, off), (Spot { from: 0, to: 1, share: 0.4 }, 3.0));
        assert_eq!(nearest_spot(&MeshLines { visible: &[0; 3], ..own }, [40.0, 3.0]), None);
        assert_eq!(nearest_spot(&own, [f64::NAN, 3.0]), None);
    }
}
