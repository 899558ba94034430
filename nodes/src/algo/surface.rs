//! Surfaces of triangles made ready to be drawn: parts put together, vertices that coincide joined, edges with both their sides, normals that
//! break at hard edges.

use std::collections::HashMap;

use nalgebra::Vector3;

/// No half-edge: the other side of a border.
pub const NONE: u32 = u32::MAX;

/// One mesh of those that are drawn together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Part<'a> {
    /// Vertices, world space.
    pub positions: &'a [[f64; 3]],
    /// Vertices of each triangle, anticlockwise from outside.
    pub triangles: &'a [[u32; 3]],
    /// A normal for each vertex, or none at all.
    pub normals: &'a [[f64; 3]],
}

/// What keeps triangles from being a surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A vertex that is not a number, or infinitely far out.
    #[error("mesh {part}: expected finite positions, found vertex {vertex} at ({0}, {1}, {2})", at[0], at[1], at[2])]
    Position {
        /// Number of the mesh.
        part: usize,
        /// Number of the vertex.
        vertex: usize,
        /// Where it is.
        at: [f64; 3],
    },
    /// A triangle of a vertex that there is not.
    #[error("mesh {part}: expected vertices below {count}, found triangle {triangle} of {found:?}")]
    Index {
        /// Number of the mesh.
        part: usize,
        /// Number of the triangle.
        triangle: usize,
        /// Number of vertices.
        count: usize,
        /// Its vertices.
        found: [u32; 3],
    },
    /// More vertices or triangles than are counted.
    #[error("expected fewer than a thousand million triangles and vertices, found more")]
    TooMany,
}

/// An edge and the triangles at both its sides. Half-edge 3 t + k of triangle t runs from its corner k to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Joined vertices, the lower first.
    pub ends: [u32; 2],
    /// The half-edge that runs from the lower to the upper end, and the one that runs back; [`NONE`] where there is none.
    pub sides: [u32; 2],
    /// True where a single triangle has this edge.
    pub open: bool,
    /// The cosine of the angle that the surface is bent by: 1 where it is flat, and at borders.
    pub bend: f64,
}

/// Triangles of one or more meshes with their neighbours and normals.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Vertices of all meshes one after another, world space.
    pub positions: Vec<Vector3<f64>>,
    /// Triangles of all meshes one after another.
    pub triangles: Vec<[u32; 3]>,
    /// The mesh that each triangle comes from.
    pub part: Vec<u32>,
    /// Unit normals.
    pub normals: Vec<Vector3<f64>>,
    /// The normal of each corner.
    pub normal_of: Vec<[u32; 3]>,
    /// Joined vertex of each vertex.
    pub joined: Vec<u32>,
    /// Each edge once, by its ends.
    pub edges: Vec<Edge>,
    /// Numbers from 0 of the vertices that came first at their place, by joined vertex.
    pub first: Vec<u32>,
}

impl Surface {
    /// Puts meshes together. Edges bent by more than `hard` radians break the normals, where a mesh has none of its own.
    ///
    /// Vertices at the same place are joined, of different meshes too; triangles without an area count for no edge. Cost: O(n log n).
    ///
    /// # Errors
    /// Where a position is not finite, or a triangle has a vertex that there is not.
    pub fn new(parts: &[Part<'_>], hard: f64) -> Result<Self, SurfaceError> {
        let mut surface = Self::default();
        for (number, part) in parts.iter().enumerate() {
            surface.append(number, part)?;
        }
        surface.join();
        surface.edges = surface.find_edges();
        let areas: Vec<Vector3<f64>> = (0..surface.triangles.len()).map(|t| surface.area_vector(t)).collect();
        surface.edges.iter_mut().for_each(|e| e.bend = bend(e, &areas));
        surface.find_normals(parts, &areas, libm::cos(hard));
        Ok(surface)
    }

    /// As [`Surface::new`], for fills without antialiasing or lines: where all meshes have normals, nothing is joined, and there are no edges.
    ///
    /// # Errors
    /// As there.
    pub fn without_edges(parts: &[Part<'_>], hard: f64) -> Result<Self, SurfaceError> {
        if parts.iter().any(|p| p.normals.len() != p.positions.len()) {
            return Self::new(parts, hard);
        }
        let mut surface = Self::default();
        for (number, part) in parts.iter().enumerate() {
            surface.append(number, part)?;
        }
        surface.normals = parts.iter().flat_map(|p| p.normals).map(|&n| Vector3::from(n)).collect();
        surface.normal_of.clone_from(&surface.triangles);
        surface.mend();
        Ok(surface)
    }

    fn append(&mut self, number: usize, part: &Part<'_>) -> Result<(), SurfaceError> {
        let (start, count) = (self.positions.len(), part.positions.len());
        if start + count > 1 << 30 || self.triangles.len() + part.triangles.len() > 1 << 30 {
            return Err(SurfaceError::TooMany);
        }
        if let Some(vertex) = part.positions.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
            return Err(SurfaceError::Position { part: number, vertex, at: part.positions[vertex] });
        }
        if let Some(triangle) = part.triangles.iter().position(|t| t.iter().any(|&i| i as usize >= count)) {
            return Err(SurfaceError::Index { part: number, triangle, count, found: part.triangles[triangle] });
        }
        self.positions.extend(part.positions.iter().map(|&p| Vector3::from(p)));
        self.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + start as u32)));
        self.part.resize(self.triangles.len(), number as u32);
        Ok(())
    }

    fn join(&mut self) {
        let mut seen: HashMap<[u64; 3], u32> = HashMap::with_capacity(self.positions.len());
        self.joined.reserve(self.positions.len());
        for (i, p) in self.positions.iter().enumerate() {
            // Adding nought makes −0 the same place as 0.
            let key = [p.x, p.y, p.z].map(|v| (v + 0.0).to_bits());
            let next = self.first.len() as u32;
            let id = *seen.entry(key).or_insert(next);
            if id == next {
                self.first.push(i as u32);
            }
            self.joined.push(id);
        }
    }

    /// Joined vertices of a triangle's corners.
    pub fn corners(&self, triangle: usize) -> [u32; 3] {
        self.triangles[triangle].map(|i| self.joined[i as usize])
    }

    /// The vertices, as they were given, at both ends of a half-edge.
    pub fn ends(&self, half: u32) -> [u32; 2] {
        let (t, k) = (half as usize / 3, half as usize % 3);
        [self.triangles[t][k], self.triangles[t][(k + 1) % 3]]
    }

    /// The normals at both ends of a half-edge, on its own side.
    pub fn end_normals(&self, half: u32) -> [u32; 2] {
        let (t, k) = (half as usize / 3, half as usize % 3);
        [self.normal_of[t][k], self.normal_of[t][(k + 1) % 3]]
    }

    /// Twice the area times the normal of a triangle.
    pub fn area_vector(&self, triangle: usize) -> Vector3<f64> {
        let [a, b, c] = self.triangles[triangle].map(|i| self.positions[i as usize]);
        (b - a).cross(&(c - a))
    }

    /// Every edge with both its sides, by its ends. Cost: O(n).
    pub(super) fn find_edges(&self) -> Vec<Edge> {
        // Half-edges in buckets of their lower end, by counting: quicker than sorting them all.
        let mut starts = vec![0_u32; self.first.len() + 1];
        let halves = || {
            (0..self.triangles.len()).flat_map(|t| {
                let [a, b, c] = self.corners(t);
                let real = a != b && b != c && c != a;
                let sides = if real { [(a, b), (b, c), (c, a)] } else { [(NONE, NONE); 3] };
                sides.into_iter().enumerate().filter(move |_| real).map(move |(k, ends)| (ends, (3 * t + k) as u32))
            })
        };
        halves().for_each(|((a, b), _)| starts[a.min(b) as usize + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut ends = starts.clone();
        let mut sorted = vec![(0_u32, 0_u32, false); starts.last().map_or(0, |n| *n as usize)];
        for ((a, b), half) in halves() {
            let at = &mut ends[a.min(b) as usize];
            sorted[*at as usize] = (a.max(b), half, a < b);
            *at += 1;
        }
        let mut edges = Vec::with_capacity(sorted.len() / 2 + 1);
        for low in 0..self.first.len() {
            let bucket = &mut sorted[starts[low] as usize..starts[low + 1] as usize];
            bucket.sort_unstable();
            bucket.chunk_by(|a, b| a.0 == b.0).for_each(|same| push_edges(&mut edges, low as u32, same));
        }
        edges
    }

    fn find_normals(&mut self, parts: &[Part<'_>], areas: &[Vector3<f64>], cos_hard: f64) {
        let given = parts.iter().all(|p| p.normals.len() == p.positions.len());
        if given && !self.positions.is_empty() {
            self.take_normals(parts);
        } else {
            let mut groups = Groups::new(self, cos_hard);
            self.normal_of = (0..self.triangles.len()).map(|t| groups.normals_of(t as u32, self.corners(t))).collect();
            self.normals = self.shape_normals_from(groups.count, areas);
        }
        self.mend();
    }

    /// The normals that the meshes come with. Vertices at one place with the same normal share it.
    fn take_normals(&mut self, parts: &[Part<'_>]) {
        let mut seen: HashMap<(u32, [u64; 3]), u32> = HashMap::with_capacity(self.positions.len());
        let mut id_of = Vec::with_capacity(self.positions.len());
        for (n, &joined) in parts.iter().flat_map(|p| p.normals).zip(&self.joined) {
            let next = self.normals.len() as u32;
            let id = *seen.entry((joined, n.map(|v| (v + 0.0).to_bits()))).or_insert(next);
            if id == next {
                self.normals.push(Vector3::from(*n));
            }
            id_of.push(id);
        }
        self.normal_of = self.triangles.iter().map(|t| t.map(|i| id_of[i as usize])).collect();
    }

    /// Normals of the triangles as they lie, one for each of [`Surface::normals`], not of length one: what a silhouette follows, whatever light is to
    /// make of the surface. Zero where there is no triangle.
    pub fn shape_normals(&self) -> Vec<Vector3<f64>> {
        let areas: Vec<Vector3<f64>> = (0..self.triangles.len()).map(|t| self.area_vector(t)).collect();
        self.shape_normals_from(self.normals.len(), &areas)
    }

    fn shape_normals_from(&self, count: usize, areas: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut normals = vec![Vector3::zeros(); count];
        for (t, area) in areas.iter().enumerate() {
            let p = self.triangles[t].map(|i| self.positions[i as usize]);
            for k in 0..3 {
                let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                // Max, Weights for computing vertex normals from facet normals, 1999, equation 2: exact where vertices lie on a sphere.
                let weight = u.norm_squared() * v.norm_squared();
                if weight > 0.0 {
                    normals[self.normal_of[t][k] as usize] += area / weight;
                }
            }
        }
        normals
    }

    /// Makes all normals of length one; where there is none the triangle's own stands in.
    fn mend(&mut self) {
        let mut bad = vec![false; self.normals.len()];
        for (n, bad) in self.normals.iter_mut().zip(&mut bad) {
            let length = n.norm();
            *bad = !(length > 0.0 && length.is_finite());
            if !*bad {
                *n /= length;
            }
        }
        for t in 0..self.triangles.len() {
            for k in 0..3 {
                let n = self.normal_of[t][k] as usize;
                if bad[n] {
                    let area = self.area_vector(t);
                    let length = area.norm();
                    self.normals[n] = if length > 0.0 { area / length } else { Vector3::z() };
                    bad[n] = length <= 0.0;
                }
            }
        }
    }
}

/// The cosine of the angle between the triangles of an edge, from their area vectors.
fn bend(e: &Edge, areas: &[Vector3<f64>]) -> f64 {
    if e.sides.contains(&NONE) {
        return 1.0;
    }
    let [a, b] = e.sides.map(|h| areas[h as usize / 3]);
    let lengths = (a.norm_squared() * b.norm_squared()).sqrt();
    if lengths > 0.0 { a.dot(&b) / lengths } else { 1.0 }
}

/// Adds the edges of the half-edges between the same two vertices.
fn push_edges(edges: &mut Vec<Edge>, low: u32, same: &[(u32, u32, bool)]) {
    let ends = [low, same[0].0];
    if let [(_, a, up), (_, b, up_too)] = *same
        && up != up_too
    {
        let sides = if up { [a, b] } else { [b, a] };
        return edges.push(Edge { ends, sides, open: false, bend: 1.0 });
    }
    // Three sheets that meet, or two that face opposite ways, have no neighbour across.
    for &(_, half, up) in same {
        edges.push(Edge { ends, sides: if up { [half, NONE] } else { [NONE, half] }, open: same.len() == 1, bend: 1.0 });
    }
}

/// Which corners share a normal: those around a vertex, as far as no hard edge lies between.
struct Groups {
    /// For corners of vertices at hard edges, a corner of the same group; others are groups by vertex.
    parent: Vec<u32>,
    split: Vec<bool>,
    count: usize,
    id: HashMap<u32, u32>,
}

impl Groups {
    fn new(surface: &Surface, cos_hard: f64) -> Self {
        let mut split = vec![false; surface.first.len()];
        for e in surface.edges.iter().filter(|e| e.bend < cos_hard) {
            e.ends.iter().for_each(|&v| split[v as usize] = true);
        }
        let mut groups =
            Self { parent: (0..3 * surface.triangles.len() as u32).collect(), split, count: surface.first.len(), id: HashMap::new() };
        for e in surface.edges.iter().filter(|e| e.bend >= cos_hard && !e.sides.contains(&NONE)) {
            // The half-edge that runs up starts at the lower end, where the other one ends.
            let [up, down] = e.sides;
            groups.unite(e.ends[0], up, next(down));
            groups.unite(e.ends[1], next(up), down);
        }
        groups
    }

    /// Numbers of the normals at a triangle's corners.
    fn normals_of(&mut self, triangle: u32, corners: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|k| {
            if !self.split[corners[k] as usize] {
                return corners[k];
            }
            let root = self.root(3 * triangle + k as u32);
            let fresh = self.count as u32;
            let id = *self.id.entry(root).or_insert(fresh);
            self.count += usize::from(id == fresh);
            id
        })
    }

    fn unite(&mut self, vertex: u32, a: u32, b: u32) {
        if self.split[vertex as usize] {
            let (a, b) = (self.root(a), self.root(b));
            self.parent[a.max(b) as usize] = a.min(b);
        }
    }

    fn root(&mut self, mut corner: u32) -> u32 {
        while self.parent[corner as usize] != corner {
            let up = self.parent[self.parent[corner as usize] as usize];
            self.parent[corner as usize] = up;
            corner = up;
        }
        corner
    }
}

/// The corner after this one in its triangle.
fn next(corner: u32) -> u32 {
    if corner % 3 == 2 { corner - 2 } else { corner + 1 }
}

#[cfg(test)]
#[path = "surface_tests.rs"]
mod tests;
