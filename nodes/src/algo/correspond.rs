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

/// Where an anchor stands on the mesh's lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// The point of the lines that it is at; none where it stands by itself.
    pub line_point: Option<usize>,
    /// Where it is drawn.
    pub drawn: [f64; 2],
}

/// A pair: a point of the lines and where it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Position among all points of the lines.
    pub line_point: usize,
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
}

/// How much farther than from the nearest curve an anchor may be from others that it is of too, pixels: two traces of one line are as far apart.
const MEET: f64 = 1.0;

/// What was paired.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paired {
    /// The pairs between anchors, not those of the anchors themselves.
    pub pairs: Vec<Pair>,
    /// Sections that were found.
    pub sections: usize,
}

/// Pairs the mesh's lines (`visible` says which of their points are seen) with drawn curves, section by section between anchors that follow each other on a
/// drawn curve. Anchors away from any curve stand for themselves. Cost: O(sections · n log n) with n points of the lines, and O(n²) for gaps.
///
/// # Errors
/// Where there is no way between two anchors along the mesh's lines.
pub fn pair(
    lines: &[Strand<'_>],
    visible: &[u8],
    drawn: &[Strand<'_>],
    anchors: &[Anchor],
    options: &Options,
) -> Result<Paired, CorrespondError> {
    let net = Net::new(lines, visible, options.bridge);
    let mut out = Paired::default();
    let curves: Vec<Along<'_>> = drawn.iter().map(Along::new).collect();
    // Where curves run close to each other an anchor is of the nearest; of several only where they meet.
    let least: Vec<f64> = anchors.iter().map(|a| curves.iter().map(|c| c.nearest(a.drawn).0).fold(options.snap, f64::min)).collect();
    for (curve, own) in drawn.iter().zip(&curves) {
        let mut on: Vec<(f64, usize)> = anchors
            .iter()
            .enumerate()
            .filter(|(_, a)| a.line_point.is_some())
            .map(|(k, a)| (own.nearest(a.drawn), k))
            .filter(|((off, _), k)| *off <= options.snap.min(least[*k] + MEET))
            .map(|((_, place), k)| (place, k))
            .collect();
        on.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let n = on.len();
        let sections = if curve.closed && n > 1 { n } else { n.saturating_sub(1) };
        for s in 0..sections {
            let ((from, a), (mut to, b)) = (on[s], on[(s + 1) % n]);
            if s + 1 == n {
                to += own.length();
            }
            if to - from < 1e-9 {
                continue;
            }
            let ends = [anchors[a].line_point, anchors[b].line_point].map(|p| p.unwrap_or(0));
            let section = |share: f64| own.at(from + (to - from) * share);
            let way = net.best(ends, &section).ok_or(CorrespondError::NoWay { from: a + 1, to: b + 1, bridge: options.bridge })?;
            out.sections += 1;
            out.pairs.extend(paired(&net, &way, &section, options));
        }
    }
    Ok(out)
}

/// The inner points of a way with their places in a drawn section.
fn paired(net: &Net, way: &[usize], section: &impl Fn(f64) -> [f64; 2], options: &Options) -> Vec<Pair> {
    let places: Vec<[f64; 2]> = way.iter().map(|&i| net.points[i]).collect();
    let shares = shares(&places);
    let to = match options.pairing {
        Pairing::Length => shares.clone(),
        Pairing::Corners => corners(&places, &shares, section),
    };
    let mut out = Vec::new();
    let mut last = places.first().copied().unwrap_or_default();
    let end = places.last().copied().unwrap_or_default();
    for i in 1..way.len().saturating_sub(1) {
        if distance(places[i], last) >= options.spacing && distance(places[i], end) >= options.spacing {
            out.push(Pair { line_point: way[i], drawn: section(to[i]) });
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
        let (a, b) = (self.strand.points[i - 1], self.strand.points[i % n]);
        [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
    }

    /// How far a point is from it, and the place nearest to it.
    pub fn nearest(&self, point: [f64; 2]) -> (f64, f64) {
        let n = self.strand.points.len();
        let mut best = (f64::INFINITY, 0.0);
        for i in 1..self.places.len() {
            let (a, b) = (self.strand.points[i - 1], self.strand.points[i % n]);
            let d = [b[0] - a[0], b[1] - a[1]];
            let length_sq = d[0] * d[0] + d[1] * d[1];
            let t = if length_sq > 0.0 { ((point[0] - a[0]) * d[0] + (point[1] - a[1]) * d[1]) / length_sq } else { 0.0 };
            let t = t.clamp(0.0, 1.0);
            let off = distance(point, [a[0] + d[0] * t, a[1] + d[1] * t]);
            if off < best.0 {
                best = (off, self.places[i - 1] + t * (self.places[i] - self.places[i - 1]));
            }
        }
        best
    }
}

/// The mesh's lines as a net: neighbours on a line, and where lines come near each other.
struct Net {
    points: Vec<[f64; 2]>,
    /// Of each point its neighbours and what it costs to go there.
    near: Vec<Vec<(usize, f64)>>,
}

/// How much dearer a way is where nobody sees it, and across a gap.
const HIDDEN: f64 = 4.0;
const GAP: f64 = 3.0;

impl Net {
    fn new(lines: &[Strand<'_>], visible: &[u8], bridge: f64) -> Self {
        let points: Vec<[f64; 2]> = lines.iter().flat_map(|l| l.points.iter().copied()).collect();
        let mut near = vec![Vec::new(); points.len()];
        let seen = |i: usize| visible.get(i).is_none_or(|v| *v != 0);
        let mut join = |a: usize, b: usize, dear: f64| {
            let length = distance(points[a], points[b]);
            if length.is_finite() {
                let hidden = if seen(a) && seen(b) { 1.0 } else { HIDDEN };
                near[a].push((b, length * hidden * dear + 1e-6));
                near[b].push((a, length * hidden * dear + 1e-6));
            }
        };
        for l in lines {
            let n = l.points.len();
            (1..n).for_each(|i| join(l.first + i - 1, l.first + i, 1.0));
            if l.closed && n > 2 {
                join(l.first + n - 1, l.first, 1.0);
            }
        }
        if bridge > 0.0 {
            for pair in bridges(lines, &points, &seen, bridge) {
                join(pair[0], pair[1], GAP);
            }
        }
        Self { points, near }
    }

    /// Of the ways between two points the one whose shape is the nearer to the drawn section's.
    fn best(&self, ends: [usize; 2], section: &impl Fn(f64) -> [f64; 2]) -> Option<Vec<usize>> {
        let first = self.way(ends, &[])?;
        let second = self.way(ends, first.get(1..first.len().saturating_sub(1)).unwrap_or_default());
        let Some(second) = second.filter(|w| *w != first) else { return Some(first) };
        Some(if self.mismatch(&second, section) < self.mismatch(&first, section) { second } else { first })
    }

    /// The mean distance of a way from a drawn section once both ends are on each other, per pixel of length.
    fn mismatch(&self, way: &[usize], section: &impl Fn(f64) -> [f64; 2]) -> f64 {
        let places: Vec<[f64; 2]> = way.iter().map(|&i| self.points[i]).collect();
        let shares = shares(&places);
        let (Some(&a), Some(&b)) = (places.first(), places.last()) else { return f64::INFINITY };
        let (x, y) = (section(0.0), section(1.0));
        let off = |(p, &s): (&[f64; 2], &f64)| {
            let to = section(s);
            let moved = [0, 1].map(|k| p[k] + (x[k] - a[k]) * (1.0 - s) + (y[k] - b[k]) * s);
            distance(moved, to)
        };
        let steps: Vec<f64> = shares.windows(2).map(|w| w[1] - w[0]).collect();
        let offs: Vec<f64> = places.iter().zip(&shares).map(off).collect();
        steps.iter().enumerate().map(|(i, w)| w * (offs[i] + offs[i + 1]) / 2.0).sum()
    }

    /// The cheapest way (Dijkstra) that keeps off some points.
    fn way(&self, [from, to]: [usize; 2], banned: &[usize]) -> Option<Vec<usize>> {
        let n = self.points.len();
        if from >= n || to >= n || from == to {
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
            for &(next, by) in &self.near[at] {
                let there = here + by;
                if !closed[next] && there < cost[next] && (direct || at != from || next != to) {
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

/// Pairs of seen points of other lines, or far along the same one, that are near each other: of each point the nearest. Where one line goes behind another,
/// the outline goes over to it.
fn bridges(lines: &[Strand<'_>], points: &[[f64; 2]], seen: &impl Fn(usize) -> bool, most: f64) -> Vec<[usize; 2]> {
    let mut line_of = vec![0; points.len()];
    lines.iter().enumerate().for_each(|(l, s)| line_of[s.first..s.first + s.points.len()].fill(l));
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| seen(i) && points[i].iter().all(|v| v.is_finite())).collect();
    order.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]).then(a.cmp(&b)));
    // Nearest for each point and each other line.
    let mut best: Vec<Vec<(usize, f64, usize)>> = vec![Vec::new(); points.len()];
    for (k, &a) in order.iter().enumerate() {
        for &b in order[k + 1..].iter().take_while(|&&b| points[b][0] - points[a][0] <= most) {
            let d = distance(points[a], points[b]);
            if d > most || line_of[a] == line_of[b] {
                continue;
            }
            for (p, q) in [(a, b), (b, a)] {
                match best[p].iter_mut().find(|e| e.0 == line_of[q]) {
                    Some(e) if d < e.1 => (e.1, e.2) = (d, q),
                    Some(_) => {}
                    None => best[p].push((line_of[q], d, q)),
                }
            }
        }
    }
    let mut out: Vec<[usize; 2]> = best.iter().enumerate().flat_map(|(p, all)| all.iter().map(move |e| [p.min(e.2), p.max(e.2)])).collect();
    out.sort_unstable();
    out.dedup();
    out
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
        Options { pairing: Pairing::Length, snap: 3.0, bridge: 6.0, spacing: 0.0 }
    }

    fn strand(points: &[[f64; 2]], closed: bool) -> Strand<'_> {
        Strand { first: 0, points, closed }
    }

    #[test]
    fn a_closed_line_goes_the_way_that_the_drawing_goes() {
        let (mesh, drawn) = (ellipse(80, [50.0, 50.0], [30.0, 30.0]), ellipse(300, [60.0, 40.0], [45.0, 25.0]));
        // A quarter and three quarters between two anchors: the longer way must not be cut short.
        let anchors = [(0, 0), (20, 75)].map(|(m, d)| Anchor { line_point: Some(m), drawn: drawn[d] });
        let found = pair(&[strand(&mesh, true)], &[1; 80], &[strand(&drawn, true)], &anchors, &options()).unwrap();
        assert_eq!((found.sections, found.pairs.len()), (2, 78));
        for p in &found.pairs {
            let angle = std::f64::consts::TAU * p.line_point as f64 / 80.0;
            let truth = [60.0 + 45.0 * angle.cos(), 40.0 + 25.0 * angle.sin()];
            assert!(distance(p.drawn, truth) < 9.0, "{} at {:?}, not {truth:?}", p.line_point, p.drawn);
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
        let anchors = [Anchor { line_point: Some(0), drawn: drawn[0] }, Anchor { line_point: Some(79), drawn: drawn[2] }];
        let found = pair(&lines, &visible, &[strand(&drawn, false)], &anchors, &options()).unwrap();
        assert!(found.pairs.iter().any(|p| p.line_point < 21) && found.pairs.iter().any(|p| p.line_point >= 40));
        assert!(found.pairs.iter().all(|p| visible[p.line_point] == 1 && all[p.line_point][0] < 22.0));
        let error = pair(&lines, &visible, &[strand(&drawn, false)], &anchors, &Options { bridge: 0.5, ..options() }).unwrap_err();
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
        let anchors = [Anchor { line_point: Some(0), drawn: drawn[0] }, Anchor { line_point: Some(100), drawn: drawn[2] }];
        let at_corner = |pairing| {
            let found = pair(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], &anchors, &Options { pairing, ..options() }).unwrap();
            distance(found.pairs.iter().find(|p| p.line_point == 50).unwrap().drawn, [90.0, 0.0])
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
        let on = |line_point: usize, x: f64, y: f64| Anchor { line_point: Some(line_point), drawn: [x, y] };
        let found = pair(&lines, &[], &curves, &[on(0, 19.0, 0.0), on(50, 19.3, 50.0), on(51, 21.0, 0.0), on(101, 20.8, 50.0)], &options())
            .unwrap();
        assert_eq!((found.sections, found.pairs.len()), (2, 98));
        assert!(found.pairs.iter().all(|p| (p.drawn[0] - if p.line_point <= 50 { 19.0 } else { 21.0 }).abs() < 1e-9));
        // Where they meet it is of both.
        let cross = [vec![[0.0, 10.0], [50.0, 10.0]], vec![[25.0, 10.3], [25.0, 50.0]]];
        let mesh: Vec<[f64; 2]> = (0..=50).map(|i| [f64::from(i), 10.0]).chain((1..=40).map(|i| [25.0, 10.0 + f64::from(i)])).collect();
        let tee = [Strand { first: 0, points: &mesh[..51], closed: false }, Strand { first: 51, points: &mesh[51..], closed: false }];
        let ends = [on(0, 0.0, 10.0), on(25, 25.0, 10.0), on(50, 50.0, 10.0), on(90, 25.0, 50.0)];
        assert_eq!(pair(&tee, &[], &[strand(&cross[0], false), strand(&cross[1], false)], &ends, &options()).unwrap().sections, 3);
    }

    #[test]
    fn anchors_away_from_curves_make_no_section_and_pairs_keep_their_distance() {
        let mesh: Vec<[f64; 2]> = (0..=100).map(|i| [f64::from(i), 0.0]).collect();
        let drawn = vec![[0.0, 5.0], [100.0, 5.0]];
        let on = |m: usize, x: f64, y: f64| Anchor { line_point: Some(m), drawn: [x, y] };
        let find = |anchors: &[Anchor], spacing| {
            pair(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], anchors, &Options { spacing, ..options() }).unwrap()
        };
        assert_eq!(find(&[on(0, 0.0, 5.0), on(100, 100.0, 30.0)], 0.0), Paired::default());
        let all = find(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 0.0);
        assert!(all.pairs.iter().all(|p| distance(p.drawn, [p.line_point as f64, 5.0]) < 1e-9) && all.pairs.len() == 99);
        assert_eq!(find(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 10.0).pairs.len(), 9);
        assert_eq!(pair(&[], &[], &[strand(&drawn, false)], &[], &options()).unwrap(), Paired::default());
    }
}
