//! Meshes made denser where a warp bends them more than their triangles can: edges are halved whose middle goes elsewhere than the middle of its ends.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 5, which names dense meshes as a need of the method and dynamic tessellation as the remedy.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::refine;
use super::surface::{NONE, Part, Surface, SurfaceError};

/// Triangles from which on no mesh is made denser.
pub const MOST: usize = 1 << 21;

/// A skinned mesh that is made denser. What a new vertex has is the mean of what its edge's ends have: at rest the surface stays where it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skinned {
    /// Vertices at rest.
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For each vertex, or none at all.
    pub uvs: Vec<[f64; 2]>,
    /// The same, unit vectors.
    pub normals: Vec<[f64; 3]>,
    /// The same.
    pub colors: Vec<[f64; 4]>,
    /// What moves each vertex: joints, the lowest first, and how much.
    pub bound: Vec<Vec<(u32, f64)>>,
}

fn mean<const N: usize>(all: &[[f64; N]], [a, b]: [u32; 2]) -> Option<[f64; N]> {
    let (a, b) = (all.get(a as usize)?, all.get(b as usize)?);
    Some(std::array::from_fn(|k| (a[k] + b[k]) / 2.0))
}

/// Each joint once, lowest first, the weights of each vertex made to add up to 1 where they add up to anything.
fn mean_bound(a: &[(u32, f64)], b: &[(u32, f64)]) -> Vec<(u32, f64)> {
    let mut out: BTreeMap<u32, f64> = BTreeMap::new();
    for own in [a, b] {
        let sum: f64 = own.iter().map(|w| w.1).sum();
        let by = if sum > 0.0 { sum } else { 1.0 };
        own.iter().filter(|w| w.1 != 0.0).for_each(|(j, w)| *out.entry(*j).or_default() += w / by / 2.0);
    }
    out.into_iter().collect()
}

impl Skinned {
    /// Adds a vertex half way between two.
    fn push_middle(&mut self, ends: [u32; 2]) {
        let [a, b] = ends.map(|v| v as usize);
        if let Some(p) = mean(&self.positions, ends) {
            self.positions.push(p);
        }
        if let Some(uv) = mean(&self.uvs, ends) {
            self.uvs.push(uv);
        }
        if let Some(n) = mean(&self.normals, ends) {
            let first = Vector3::from(self.normals[a]);
            self.normals.push(Vector3::from(n).try_normalize(1e-12).unwrap_or(first).into());
        }
        if let Some(c) = mean(&self.colors, ends) {
            self.colors.push(c);
        }
        let bound = mean_bound(&self.bound[a], &self.bound[b]);
        self.bound.push(bound);
    }

    /// The edges: of each, the vertices of the side that comes first. Those at one place are one.
    ///
    /// # Errors
    /// Where a position is not finite, or a triangle has a vertex that there is not.
    pub fn surface(&self) -> Result<Surface, SurfaceError> {
        let part = Part { positions: &self.positions, triangles: &self.triangles, normals: &[] };
        Surface::new(&[part], std::f64::consts::PI)
    }

    /// The same vertices, then one in the middle of each of a surface's edges, without new triangles: to ask a warp what becomes of them.
    pub fn with_middles(&self, surface: &Surface) -> Self {
        let mut out = self.clone();
        surface.edges.iter().for_each(|e| out.push_middle(ends(surface, e.sides)));
        out
    }

    /// Halves edges of its surface. The new vertices come after the old; the result lists what each lies between.
    pub fn split(&mut self, mut surface: Surface, wanted: &[bool]) -> Vec<[u32; 2]> {
        let middle = |v: u32| surface.positions[surface.first[v as usize] as usize];
        let middles: Vec<Option<Vector3<f64>>> =
            surface.edges.iter().zip(wanted).map(|(e, w)| w.then(|| (middle(e.ends[0]) + middle(e.ends[1])) / 2.0)).collect();
        let between = refine::split(&mut surface, &middles);
        between.iter().for_each(|ends| self.push_middle(*ends));
        self.triangles = surface.triangles;
        between
    }
}

/// The vertices at the ends of an edge's first side.
fn ends(surface: &Surface, sides: [u32; 2]) -> [u32; 2] {
    surface.ends(if sides[0] == NONE { sides[1] } else { sides[0] })
}

/// Which edges of a surface a warp bends by more than `tolerance` pixels, and the most that it bends any. `field` says where vertices go, then the middles of the edges.
pub fn bent(surface: &Surface, field: &[[f64; 2]], tolerance: f64) -> (Vec<bool>, f64) {
    let n = surface.positions.len();
    let off = surface.edges.iter().enumerate().map(|(i, e)| {
        let [a, b] = ends(surface, e.sides).map(|v| field[v as usize]);
        let m = field[n + i];
        libm::hypot(m[0] - (a[0] + b[0]) / 2.0, m[1] - (a[1] + b[1]) / 2.0)
    });
    let off: Vec<f64> = off.collect();
    (off.iter().map(|d| *d > tolerance).collect(), off.iter().copied().fold(0.0, f64::max))
}

/// A place on an edge of a mesh whose edges were halved: on the half that it lies on, by the new vertices that [`halves`] lists.
pub fn moved_place(place: ([u32; 2], f64), surface: &Surface, halves: &BTreeMap<[u32; 2], u32>) -> ([u32; 2], f64) {
    let ([a, b], share) = place;
    let joined = |v: u32| surface.joined[v as usize];
    let key = |a: u32, b: u32| if joined(a) < joined(b) { [joined(a), joined(b)] } else { [joined(b), joined(a)] };
    match halves.get(&key(a, b)) {
        Some(&m) if a != b && share <= 0.5 => ([a, m], 2.0 * share),
        Some(&m) if a != b => ([m, b], 2.0 * share - 1.0),
        _ => place,
    }
}

/// The new vertices of a split, by the joined ends of the edges that they halve.
pub fn halves(surface: &Surface, between: &[[u32; 2]]) -> BTreeMap<[u32; 2], u32> {
    let first = surface.positions.len() as u32;
    let key = |[a, b]: [u32; 2]| {
        let [a, b] = [a, b].map(|v| surface.joined[v as usize]);
        [a.min(b), a.max(b)]
    };
    // Of two vertices at one place, on both sides of a seam, the first stands for the edge.
    between.iter().enumerate().rev().map(|(i, ends)| (key(*ends), first + i as u32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share an edge of vertices of their own, as at the seam of a texture: a square of side 1.
    fn square() -> Skinned {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0; 3], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let uvs = positions.iter().enumerate().map(|(i, p)| [p[0] + i as f64, p[1]]).collect();
        let bound = vec![vec![(0, 1.0)], vec![(0, 0.5), (1, 1.5)], vec![(1, 2.0)], vec![(0, 1.0)], vec![(1, 2.0)], vec![]];
        Skinned { normals: vec![[0.0, 0.0, 1.0]; 6], colors: Vec::new(), triangles: vec![[0, 1, 2], [3, 4, 5]], positions, uvs, bound }
    }

    fn area(s: &Skinned) -> f64 {
        let one = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| s.positions[v as usize]);
            ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
        };
        s.triangles.iter().map(one).sum()
    }

    #[test]
    fn an_edge_of_a_seam_is_halved_on_both_sides_and_the_surface_stays() {
        let mut s = square();
        let surface = s.surface().unwrap();
        let diagonal = surface.edges.iter().position(|e| !e.open).unwrap();
        let wanted: Vec<bool> = (0..surface.edges.len()).map(|i| i == diagonal).collect();
        let between = s.split(surface.clone(), &wanted);
        assert_eq!((between.len(), s.positions.len(), s.triangles.len()), (2, 8, 4), "{between:?}");
        assert_eq!((s.positions[6], s.positions[7]), ([0.5, 0.5, 0.0], [0.5, 0.5, 0.0]));
        assert!(s.uvs[6] != s.uvs[7], "each side keeps its texture: {:?}", s.uvs);
        assert!((area(&s) - 1.0).abs() < 1e-15 && s.triangles.iter().all(|t| area(&Skinned { triangles: vec![*t], ..s.clone() }) > 0.0));
        // Weights are means of weights that add up to one.
        assert_eq!(s.bound[6], [(0, 0.5), (1, 0.5)]);
        let map = halves(&surface, &between);
        for (place, truth) in [(0.25, [0.25, 0.25]), (0.5, [0.5, 0.5]), (0.8, [0.8, 0.8])] {
            for edge in [[0, 2], [3, 4]] {
                let ([a, b], t) = moved_place((edge, place), &surface, &map);
                let [p, q] = [a, b].map(|v| s.positions[v as usize]);
                assert!((0..2).all(|k| (p[k] + (q[k] - p[k]) * t - truth[k]).abs() < 1e-12), "{edge:?} {place}");
            }
        }
        assert_eq!(moved_place(([0, 1], 0.3), &surface, &map), ([0, 1], 0.3));
        assert_eq!(moved_place(([2, 2], 0.0), &surface, &map), ([2, 2], 0.0));
    }

    #[test]
    fn what_a_warp_bends_is_found_by_its_middle() {
        let s = square();
        let surface = s.surface().unwrap();
        let dense = s.with_middles(&surface);
        assert_eq!(dense.positions.len(), 6 + surface.edges.len());
        // x goes to x + 8 x^2: a middle of an edge along x lies 2 off the mean of its ends.
        let field: Vec<[f64; 2]> = dense.positions.iter().map(|p| [8.0 * p[0] * p[0], 0.0]).collect();
        let (wanted, most) = bent(&surface, &field, 1.0);
        assert_eq!(most, 2.0);
        for (e, w) in surface.edges.iter().zip(&wanted) {
            let [a, b] = ends(&surface, e.sides).map(|v| s.positions[v as usize][0]);
            assert_eq!(*w, a != b, "{e:?}");
        }
        // An affine field bends nothing.
        let field: Vec<[f64; 2]> = dense.positions.iter().map(|p| [3.0 * p[0] - p[1], p[1]]).collect();
        assert_eq!(bent(&surface, &field, 1e-9).0.iter().filter(|w| **w).count(), 0);
    }

    #[test]
    fn weights_of_nothing_stay_nothing() {
        assert_eq!(mean_bound(&[], &[]), []);
        assert_eq!(mean_bound(&[(3, 0.0)], &[(1, 2.0)]), [(1, 0.5)]);
    }
}
