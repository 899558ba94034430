//! Silhouettes, creases, borders and intersections of a surface as chains of points on its edges.
//!
//! Edges between front and back faces zig-zag over the surface. Instead g(p) = n(p) · (eye − p) is interpolated over each triangle from its
//! corners, and its zero set is followed: Hertzmann and Zorin, *Illustrating smooth surfaces*, SIGGRAPH 2000, section 4.1. Its points lie on
//! edges, where the correspondences of Li, Gleicher, Xu and Shum, *Stylizing Motion with Drawings*, 2003, section 3.2 want them. At a hard edge g
//! differs on both sides; the boundary of what faces the eye then runs along the edge wherever one side faces it and the other does not, so
//! that silhouettes of closed surfaces are closed. At an edge where three or more triangles meet, a silhouette runs where the eye sees all of them on one
//! side.

use nalgebra::Vector3;

use super::crossings::{Crossing, crossings};
use super::surface::{Edge, NONE, Surface};

/// What a line shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Where the surface turns away from the eye.
    Silhouette,
    /// The rim of an open surface.
    Border,
    /// A sharp bend.
    Crease,
    /// Where two meshes, or two colours, meet.
    Seam,
    /// Where the surface runs through itself.
    Intersection,
}

/// A point on an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgePoint {
    /// The vertices that the edge joins, as the surface numbers them.
    pub vertices: [u32; 2],
    /// Where between them: 0 at the first, 1 at the second.
    pub t: f64,
    /// The point of the edge.
    pub position: Vector3<f64>,
    /// The point of the smooth surface that the mesh stands for.
    pub smooth: Vector3<f64>,
    /// The normal there.
    pub normal: Vector3<f64>,
}

/// Points in a row along a line. A closed one does not repeat its first.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// What it shows.
    pub kind: Kind,
    /// True where the last point joins the first.
    pub closed: bool,
    /// At least two.
    pub points: Vec<EdgePoint>,
}

/// Which lines are looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lines {
    /// Where the surface turns away from the eye.
    pub silhouettes: bool,
    /// Rims of open surfaces.
    pub borders: bool,
    /// Edges that are bent by more than this, radians.
    pub crease: Option<f64>,
    /// Edges where meshes or colours meet.
    pub seams: bool,
    /// Where parts run through each other.
    pub intersections: bool,
}

impl Default for Lines {
    fn default() -> Self {
        Self { silhouettes: true, borders: true, crease: Some(60_f64.to_radians()), seams: true, intersections: false }
    }
}

/// The lines of a surface as seen from where `toward` points, from each of its points. Order and points depend on the surface alone. Visibility is not
/// looked at. `is_seam` says of an edge whether two colours meet there. Cost: O(n), of intersections as of [`crossings`].
pub fn chains(
    surface: &Surface,
    toward: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    lines: Lines,
    is_seam: impl Fn(&Edge) -> bool,
) -> Vec<Chain> {
    let finder = Finder::new(surface, toward);
    let mut out = Vec::new();
    if lines.silhouettes {
        finder.join(Kind::Silhouette, finder.silhouettes(), &mut out);
    }
    let whole = |wanted: &dyn Fn(&Edge) -> bool| -> Vec<[u32; 2]> {
        let edges = surface.edges.iter().filter(|e| wanted(e));
        edges.map(|e| e.ends.map(|v| finder.vertex_node(v))).collect()
    };
    if lines.borders {
        finder.join(Kind::Border, whole(&|e| e.open), &mut out);
    }
    let seam = |e: &Edge| {
        !e.sides.contains(&NONE) && (e.sides.map(|h| surface.part[h as usize / 3]).windows(2).any(|p| p[0] != p[1]) || is_seam(e))
    };
    if lines.seams {
        finder.join(Kind::Seam, whole(&seam), &mut out);
    }
    if let Some(angle) = lines.crease {
        let cos = libm::cos(angle);
        let crease = |e: &Edge| e.bend < cos && !(lines.seams && seam(e)) && !(lines.silhouettes && finder.is_silhouette(e));
        finder.join(Kind::Crease, whole(&crease), &mut out);
    }
    if lines.intersections {
        let (points, links) = crossings(surface);
        join(Kind::Intersection, links, |node| finder.crossed(&points[node as usize]), &mut out);
    }
    out
}

/// The edges between triangles that face the eye and triangles that do not: where the mesh itself ends, however round what it stands for. Cost: O(n).
pub fn folds(surface: &Surface, toward: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vec<Chain> {
    let place = |joined: u32| {
        let vertex = surface.first[joined as usize];
        (vertex, surface.positions[vertex as usize])
    };
    let facing = |half: u32| {
        let t = half as usize / 3;
        surface.area_vector(t).dot(&toward(&place(surface.corners(t)[0]).1)) >= 0.0
    };
    let is_fold = |e: &&Edge| !e.sides.contains(&NONE) && facing(e.sides[0]) != facing(e.sides[1]);
    let point = |joined: u32| {
        let (vertex, position) = place(joined);
        EdgePoint { vertices: [vertex; 2], t: 0.0, position, smooth: position, normal: Vector3::zeros() }
    };
    let mut out = Vec::new();
    join(Kind::Silhouette, surface.edges.iter().filter(is_fold).map(|e| e.ends).collect(), point, &mut out);
    out
}

/// The zero set in the making. Its nodes are the half-edges (3 t + k) that g changes sign on, one of both where g is the same on both sides, and after
/// them the joined vertices.
struct Finder<'a> {
    surface: &'a Surface,
    /// Toward the eye, at each vertex.
    sight: Vec<Vector3<f64>>,
    /// Of the surface as it lies.
    normals: Vec<Vector3<f64>>,
    /// g at each corner.
    facing: Vec<[f64; 3]>,
    /// The node of each half-edge with a sign change.
    node: Vec<u32>,
}

impl<'a> Finder<'a> {
    fn new(surface: &'a Surface, toward: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Self {
        let sight: Vec<Vector3<f64>> = surface.positions.iter().map(toward).collect();
        let unit = |n: Vector3<f64>| n.try_normalize(1e-300).unwrap_or_else(Vector3::zeros);
        let normals: Vec<Vector3<f64>> = surface.shape_normals().into_iter().map(unit).collect();
        let g = |t: usize, k: usize| normals[surface.normal_of[t][k] as usize].dot(&sight[surface.triangles[t][k] as usize]);
        let facing = (0..surface.triangles.len()).map(|t| [0, 1, 2].map(|k| g(t, k))).collect();
        let mut finder = Self { surface, sight, facing, normals, node: (0..3 * surface.triangles.len() as u32).collect() };
        for e in &surface.edges {
            if finder.is_smooth(e) {
                let [up, down] = e.sides;
                finder.node[up.max(down) as usize] = up.min(down);
            }
        }
        finder
    }

    fn vertex_node(&self, joined: u32) -> u32 {
        3 * self.surface.triangles.len() as u32 + joined
    }

    /// g at both ends of a half-edge.
    fn ends(&self, half: u32) -> [f64; 2] {
        let (t, k) = (half as usize / 3, half as usize % 3);
        [self.facing[t][k], self.facing[t][(k + 1) % 3]]
    }

    /// True where g is the same on both sides.
    fn is_smooth(&self, e: &Edge) -> bool {
        let [up, down] = e.sides;
        if up == NONE || down == NONE {
            return false;
        }
        let ([a, b], [c, d]) = (self.ends(up), self.ends(down));
        a == d && b == c
    }

    /// True where one side faces the eye all along, and the other does not.
    fn is_silhouette(&self, e: &Edge) -> bool {
        if e.sides.contains(&NONE) {
            return false;
        }
        let [up, down] = e.sides.map(|h| self.ends(h).map(|g| g >= 0.0));
        up[0] != down[1] && up[1] != down[0] && up[0] == up[1]
    }

    /// Where g changes its sign on a half-edge, as a fraction from its start.
    fn crossing(&self, half: u32) -> Option<f64> {
        let [a, b] = self.ends(half);
        ((a >= 0.0) != (b >= 0.0)).then(|| (a / (a - b)).clamp(0.0, 1.0))
    }

    fn silhouettes(&self) -> Vec<[u32; 2]> {
        let mut links = Vec::new();
        for (t, g) in self.facing.iter().enumerate() {
            let front = g.map(|g| g >= 0.0);
            let [a, b, c] = self.surface.corners(t);
            if front != [front[0]; 3] && a != b && b != c && c != a {
                let mut crossed = (0..3).filter(|&k| front[k] != front[(k + 1) % 3]).map(|k| self.node[3 * t + k]);
                links.extend(crossed.next().zip(crossed.next()).map(|(a, b)| [a, b]));
            }
        }
        for e in self.surface.edges.iter().filter(|e| !e.sides.contains(&NONE) && !self.is_smooth(e)) {
            self.along_hard(e, &mut links);
        }
        let clashes = self.surface.edges.chunk_by(|a, b| a.ends == b.ends).filter(|same| same.len() > 1);
        links.extend(clashes.filter(|same| self.is_fold(same)).map(|same| same[0].ends.map(|v| self.vertex_node(v))));
        links
    }

    /// True where all triangles that meet in an edge without a neighbour across lie on the same side of it, as the eye sees it.
    fn is_fold(&self, same: &[Edge]) -> bool {
        let surface = self.surface;
        let [a, b] = same[0].ends.map(|v| surface.first[v as usize] as usize);
        let across = (surface.positions[b] - surface.positions[a]).cross(&self.sight[a]);
        let side = |half: &u32| {
            let opposite = surface.triangles[*half as usize / 3][(*half as usize + 2) % 3];
            across.dot(&(surface.positions[opposite as usize] - surface.positions[a]))
        };
        let sides = || same.iter().flat_map(|e| &e.sides).filter(|h| **h != NONE).map(side);
        sides().all(|s| s >= 0.0) || sides().all(|s| s <= 0.0)
    }

    /// The pieces of a hard edge whose one side faces the eye while the other does not.
    fn along_hard(&self, e: &Edge, links: &mut Vec<[u32; 2]>) {
        let [up, down] = e.sides;
        let signs = [self.ends(up)[0] >= 0.0, self.ends(down)[1] >= 0.0];
        let mut breaks: Vec<(f64, u32, usize)> = Vec::new();
        breaks.extend(self.crossing(up).map(|t| (t, self.node[up as usize], 0)));
        breaks.extend(self.crossing(down).map(|t| (1.0 - t, self.node[down as usize], 1)));
        breaks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut sign, mut from) = (signs, self.vertex_node(e.ends[0]));
        for (_, node, side) in breaks {
            if sign[0] != sign[1] {
                links.push([from, node]);
            }
            sign[side] = !sign[side];
            from = node;
        }
        if sign[0] != sign[1] {
            links.push([from, self.vertex_node(e.ends[1])]);
        }
    }

    /// The point of a node.
    fn point(&self, node: u32) -> EdgePoint {
        let surface = self.surface;
        let corners = 3 * surface.triangles.len() as u32;
        if node >= corners {
            let vertex = surface.first[(node - corners) as usize];
            let position = surface.positions[vertex as usize];
            return EdgePoint { vertices: [vertex; 2], t: 0.0, position, smooth: position, normal: Vector3::zeros() };
        }
        let (vertices, normals) = (surface.ends(node), surface.end_normals(node));
        let t = self.crossing(node).unwrap_or(0.0);
        let [a, b] = vertices.map(|v| surface.positions[v as usize]);
        let [na, nb] = normals.map(|n| self.normals[n as usize]);
        let position = a + (b - a) * t;
        EdgePoint {
            vertices,
            t,
            position,
            smooth: position + bulge(a, b, na, nb, t),
            normal: (na + (nb - na) * t).try_normalize(1e-12).unwrap_or(na),
        }
    }

    fn join(&self, kind: Kind, links: Vec<[u32; 2]>, out: &mut Vec<Chain>) {
        join(kind, links, |node| self.point(node), out);
    }

    fn crossed(&self, at: &Crossing) -> EdgePoint {
        let [a, b] = at.vertices.map(|v| self.surface.positions[v as usize]);
        let [na, nb] = at.normals.map(|n| self.normals[n as usize]);
        let position = a + (b - a) * at.t;
        let normal = (na + (nb - na) * at.t).try_normalize(1e-12).unwrap_or(na);
        EdgePoint { vertices: at.vertices, t: at.t, position, smooth: position, normal }
    }
}

/// Puts links together to chains that are as long as they can be, ends and forks first.
fn join(kind: Kind, links: Vec<[u32; 2]>, point: impl Fn(u32) -> EdgePoint, out: &mut Vec<Chain>) {
    let mut at: Vec<(u32, u32)> = Vec::with_capacity(2 * links.len());
    for (i, link) in links.iter().enumerate().filter(|(_, l)| l[0] != l[1]) {
        at.extend(link.map(|node| (node, i as u32)));
    }
    at.sort_unstable();
    let mut used = vec![false; links.len()];
    let mut walk = |start: u32, first: u32| {
        let (mut nodes, mut link) = (vec![start], first);
        while !std::mem::replace(&mut used[link as usize], true) {
            let here = nodes[nodes.len() - 1];
            let [a, b] = links[link as usize];
            let there = if a == here { b } else { a };
            nodes.push(there);
            let meeting = around(&at, there);
            if meeting.len() != 2 || there == start {
                break;
            }
            link = if meeting[0].1 == link { meeting[1].1 } else { meeting[0].1 };
        }
        if nodes.len() > 1 {
            let closed = nodes.len() > 3 && nodes.first() == nodes.last();
            if closed {
                nodes.pop();
            }
            out.push(Chain { kind, closed, points: nodes.into_iter().map(&point).collect() });
        }
    };
    for loops in [false, true] {
        for &(node, link) in &at {
            if loops || around(&at, node).len() != 2 {
                walk(node, link);
            }
        }
    }
}

/// The links at a node.
fn around(at: &[(u32, u32)], node: u32) -> &[(u32, u32)] {
    let start = at.partition_point(|a| a.0 < node);
    let len = at[start..].partition_point(|a| a.0 == node);
    &at[start..start + len]
}

/// How far the smooth surface lies from the chord a b at `t`: the boundary curve of a PN triangle, Vlachos, Peters, Boyd and Mitchell, *Curved PN
/// triangles*, 2001, equations for b₂₁₀ and b₁₂₀. At most a quarter of the edge, so that wild normals do no harm.
pub fn bulge(a: Vector3<f64>, b: Vector3<f64>, na: Vector3<f64>, nb: Vector3<f64>, t: f64) -> Vector3<f64> {
    let edge = b - a;
    let (at_a, at_b) = (na * (-edge.dot(&na) / 3.0), nb * (edge.dot(&nb) / 3.0));
    let s = 1.0 - t;
    let offset = at_a * (3.0 * s * s * t) + at_b * (3.0 * s * t * t);
    let (length, most) = (offset.norm(), edge.norm() / 4.0);
    if length > most { offset * (most / length) } else { offset }
}

#[cfg(test)]
#[path = "silhouette_tests.rs"]
mod tests;
