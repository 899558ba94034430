//! Triangles of one connectivity over several sets of points, changed one edge or point at a time.

use super::diagonals::quality;
use super::{Point, lerp, orient};

/// The mesh. Every change but a move is refused where it would turn a triangle over in any contour.
pub(super) struct Mesh {
    /// Points of a contour; those after them may move and vanish.
    pub(super) n_contour: usize,
    /// For each contour the places of all points.
    pub(super) points: Vec<Vec<Point>>,
    /// Corners in the positive sense; `None` where a triangle has vanished.
    triangles: Vec<Option<[usize; 3]>>,
    /// The triangles at each point.
    star: Vec<Vec<usize>>,
}

impl Mesh {
    pub(super) fn new(n_contour: usize, points: Vec<Vec<Point>>, triangles: Vec<[usize; 3]>) -> Self {
        let mut mesh = Self { n_contour, star: vec![Vec::new(); points[0].len()], points, triangles: Vec::new() };
        triangles.into_iter().for_each(|t| mesh.add(t));
        mesh
    }

    fn add(&mut self, t: [usize; 3]) {
        t.iter().for_each(|&v| self.star[v].push(self.triangles.len()));
        self.triangles.push(Some(t));
    }

    fn remove(&mut self, id: usize) {
        if let Some(t) = self.triangles[id].take() {
            t.iter().for_each(|&v| self.star[v].retain(|&i| i != id));
        }
    }

    /// Points of all kinds, those that vanished among them.
    pub(super) fn n_points(&self) -> usize {
        self.star.len()
    }

    /// Whether the point is an interior one that is still there.
    pub(super) fn is_free(&self, v: usize) -> bool {
        v >= self.n_contour && !self.star[v].is_empty()
    }

    /// The triangles at a point.
    pub(super) fn around(&self, v: usize) -> impl Iterator<Item = [usize; 3]> + '_ {
        self.star[v].iter().filter_map(|&i| self.triangles[i])
    }

    /// The points joined to a point.
    pub(super) fn neighbours(&self, v: usize) -> Vec<usize> {
        let mut all: Vec<usize> = self.around(v).flatten().filter(|&u| u != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Inner edges, each once, by their lower end.
    pub(super) fn inner_edges(&self) -> Vec<(usize, usize)> {
        let all = self.triangles.iter().flatten().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let mut edges: Vec<(usize, usize)> = all.map(|(a, b)| (a.min(b), a.max(b))).collect();
        edges.sort_unstable();
        edges.chunk_by(|a, b| a == b).filter(|c| c.len() == 2).map(|c| c[0]).collect()
    }

    /// The two triangles at an inner edge: their identity and the corner opposite, the one with the edge in the sense a-b first.
    fn sides(&self, a: usize, b: usize) -> Option<[(usize, usize); 2]> {
        let has = |id: &usize, from: usize, to: usize| {
            let t = self.triangles[*id]?;
            (0..3).find(|&i| t[i] == from && t[(i + 1) % 3] == to).map(|i| (*id, t[(i + 2) % 3]))
        };
        let find = |from, to| self.star[a].iter().find_map(|id| has(id, from, to));
        Some([find(a, b)?, find(b, a)?])
    }

    /// Worst shape of some triangles in all contours, as if the points were there; negative where one is turned over or flat.
    pub(super) fn worst(&self, triangles: &[[usize; 3]]) -> f64 {
        let each = self.points.iter().flat_map(|p| triangles.iter().map(|t| shape(t.map(|i| p[i]))));
        each.fold(f64::INFINITY, f64::min)
    }

    /// Turns an edge where that betters the worst shape.
    pub(super) fn flip(&mut self, a: usize, b: usize) -> bool {
        let Some([(left, c), (right, d)]) = self.sides(a, b) else { return false };
        let (old, new) = ([[a, b, c], [b, a, d]], [[d, c, a], [c, d, b]]);
        if self.worst(&new) <= self.worst(&old) + 1e-9 {
            return false;
        }
        self.remove(left);
        self.remove(right);
        new.into_iter().for_each(|t| self.add(t));
        true
    }

    /// Puts a point on the middle of an inner edge.
    pub(super) fn split(&mut self, a: usize, b: usize) -> bool {
        let Some([(left, c), (right, d)]) = self.sides(a, b) else { return false };
        let v = self.n_points();
        let new = [[a, v, c], [v, b, c], [b, v, d], [v, a, d]];
        self.points.iter_mut().for_each(|p| p.push(lerp(p[a], p[b], 0.5)));
        if self.worst(&new) <= 0.0 {
            self.points.iter_mut().for_each(|p| p.truncate(v));
            return false;
        }
        self.star.push(Vec::new());
        self.remove(left);
        self.remove(right);
        new.into_iter().for_each(|t| self.add(t));
        true
    }

    /// Draws an interior point into the neighbour that leaves the best shapes, where the worst of them is at least `least`.
    pub(super) fn collapse(&mut self, v: usize, least: f64) -> bool {
        let neighbours = self.neighbours(v);
        let merged = |u: usize| -> Vec<[usize; 3]> {
            self.around(v).filter(|t| !t.contains(&u)).map(|t| t.map(|i| if i == v { u } else { i })).collect()
        };
        let fits = |u: usize| neighbours.iter().filter(|&&w| w != u && self.sides_or_edge(u, w)).count() == 2;
        let best = neighbours.iter().filter(|&&u| fits(u)).map(|&u| (u, self.worst(&merged(u)))).max_by(|x, y| x.1.total_cmp(&y.1));
        let Some((u, shape)) = best else { return false };
        if shape < least {
            return false;
        }
        let new = merged(u);
        self.star[v].clone().into_iter().for_each(|id| self.remove(id));
        new.into_iter().for_each(|t| self.add(t));
        true
    }

    /// Whether two points are joined.
    fn sides_or_edge(&self, a: usize, b: usize) -> bool {
        self.around(a).any(|t| t.contains(&b))
    }

    /// A contour in which a triangle has no area, by exact arithmetic.
    pub(super) fn degenerate(&self) -> Option<usize> {
        self.points.iter().position(|p| self.triangles.iter().flatten().any(|t| orient(p[t[0]], p[t[1]], p[t[2]]) <= 0.0))
    }

    /// Triangles and points without those that vanished.
    pub(super) fn into_parts(self) -> (Vec<[u32; 3]>, Vec<Vec<Point>>) {
        let mut name = vec![0u32; self.n_points()];
        let kept: Vec<usize> = (0..self.n_points()).filter(|&v| v < self.n_contour || self.is_free(v)).collect();
        kept.iter().enumerate().for_each(|(i, &v)| name[v] = i as u32);
        let triangles = self.triangles.iter().flatten().map(|t| t.map(|v| name[v])).collect();
        (triangles, self.points.iter().map(|p| kept.iter().map(|&v| p[v]).collect()).collect())
    }
}

/// [`quality`], its sign exact.
pub(super) fn shape(t: [Point; 3]) -> f64 {
    let q = quality(t);
    // Far from flat the sign is certain without exact arithmetic.
    if q.abs() > 1e-6 {
        return q;
    }
    let area = orient(t[0], t[1], t[2]);
    if area > 0.0 { q.max(f64::MIN_POSITIVE) } else { q.min(0.0) }
}
