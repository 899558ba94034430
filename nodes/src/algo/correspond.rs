//! Which point of a mesh's lines is drawn where: sections between anchors, paired along their lengths.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2: "anchors are connected along silhouette edges of the mesh, and by
//! a snake in the drawing". Pairing by corners: Sakoe, Chiba 1978 on the curves' directions.

mod net;

use pegbar_engine::Setting;

use super::mesh_lines::{Place, distance};
use net::Net;

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

#[cfg(test)]
mod tests;
