//! Where triangles of a surface run through each other.
//!
//! An edge and a triangle cross where signs of exact volumes say so, each of which is taken in one order whoever asks: triangles that share an edge agree
//! where it crosses a third, so that what they cross in are closed lines wherever the parts are.
//!
//! **Source** Shewchuk, *Adaptive precision floating-point arithmetic and fast robust geometric predicates*, 1997.

use std::collections::HashMap;

use robust::{Coord3D, orient3d};

use super::surface::Surface;

/// A point where an edge runs through a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// The vertices that the edge joins.
    pub vertices: [u32; 2],
    /// The normals there, on one of its sides.
    pub normals: [u32; 2],
    /// Where between them: 0 at the first, 1 at the second.
    pub t: f64,
}

/// The points in which edges run through triangles, and the pairs of them between which two triangles cross. Triangles that share a vertex do not, nor do
/// those that only touch. Cost: O(n log n + pairs of triangles whose boxes overlap).
pub fn crossings(surface: &Surface) -> (Vec<Crossing>, Vec<[u32; 2]>) {
    let mut found = Found { surface, known: HashMap::new(), points: Vec::new(), links: Vec::new() };
    Boxes::new(surface).pairs(|a, b| found.look(a as usize, b as usize));
    (found.points, found.links)
}

struct Found<'a> {
    surface: &'a Surface,
    /// The point of an edge, by its joined vertices, and a triangle.
    known: HashMap<([u32; 2], u32), u32>,
    points: Vec<Crossing>,
    links: Vec<[u32; 2]>,
}

impl Found<'_> {
    /// Where two triangles cross.
    fn look(&mut self, a: usize, b: usize) {
        let [ca, cb] = [a, b].map(|t| self.surface.corners(t));
        if ca.iter().any(|v| cb.contains(v)) {
            return;
        }
        let sides = [ca.map(|v| self.volume([cb[0], cb[1], cb[2], v])), cb.map(|v| self.volume([ca[0], ca[1], ca[2], v]))];
        if sides.iter().any(|s| s.iter().all(|v| *v >= 0.0) || s.iter().all(|v| *v < 0.0)) {
            return;
        }
        let mut ends = [0; 2];
        let mut count = 0;
        for (edges_of, through, sides) in [(a, b, sides[0]), (b, a, sides[1])] {
            for k in 0..3 {
                let next = (k + 1) % 3;
                if (sides[k] >= 0.0) != (sides[next] >= 0.0) && self.runs_through(edges_of, k, through) {
                    let point = self.point(edges_of, k, through, sides[k] / (sides[k] - sides[next]));
                    ends[count.min(1)] = point;
                    count += 1;
                }
            }
        }
        if count == 2 && ends[0] != ends[1] {
            self.links.push(ends);
        }
    }

    /// Of the tetrahedron of four joined vertices: its sign is exact.
    fn volume(&self, of: [u32; 4]) -> f64 {
        let [a, b, c, d] = of.map(|v| {
            let p = self.surface.positions[self.surface.first[v as usize] as usize];
            Coord3D { x: p.x, y: p.y, z: p.z }
        });
        orient3d(a, b, c, d)
    }

    /// True where the line of a triangle's edge passes the three of another on the same side.
    fn runs_through(&self, edge_of: usize, k: usize, through: usize) -> bool {
        let ends = sorted(self.ends(edge_of, k));
        let side = |k: usize| {
            let side = self.ends(through, k);
            let [c, d] = sorted(side);
            (self.volume([ends[0], ends[1], c, d]) >= 0.0) != (side[0] > side[1])
        };
        let first = side(0);
        side(1) == first && side(2) == first
    }

    /// The joined vertices of an edge, as the triangle has them.
    fn ends(&self, triangle: usize, k: usize) -> [u32; 2] {
        let corners = self.surface.corners(triangle);
        [corners[k], corners[(k + 1) % 3]]
    }

    /// The number of the point at `t` of an edge.
    fn point(&mut self, edge_of: usize, k: usize, through: usize, t: f64) -> u32 {
        let ends = self.ends(edge_of, k);
        let next = self.points.len() as u32;
        let number = *self.known.entry((sorted(ends), through as u32)).or_insert(next);
        if number == next {
            let normals = self.surface.end_normals((3 * edge_of + k) as u32);
            self.points.push(Crossing { vertices: ends.map(|v| self.surface.first[v as usize]), normals, t });
        }
        number
    }
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Lower and upper ends of a box.
type Bounds = [[f64; 3]; 2];

fn overlap(a: &Bounds, b: &Bounds) -> bool {
    (0..3).all(|k| a[0][k] <= b[1][k] && b[0][k] <= a[1][k])
}

fn around(bounds: impl Iterator<Item = Bounds>) -> Bounds {
    bounds.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], [l, h]| {
        [[0, 1, 2].map(|k| low[k].min(l[k])), [0, 1, 2].map(|k| high[k].max(h[k]))]
    })
}

/// Triangles in a leaf.
const LEAF: usize = 4;

/// A tree of boxes around triangles: halves of each lie apart along its longest side.
struct Boxes {
    /// Of each triangle.
    own: Vec<Bounds>,
    /// Triangles, those of each node in a row.
    order: Vec<u32>,
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// In `order`.
    range: [usize; 2],
    /// The first half; the second comes after all that is below it. None for a leaf.
    halves: Option<[usize; 2]>,
}

impl Boxes {
    fn new(surface: &Surface) -> Self {
        let own = surface.triangles.iter().map(|t| around(t.iter().map(|v| [surface.positions[*v as usize].into(); 2]))).collect();
        let mut boxes = Self { own, order: (0..surface.triangles.len() as u32).collect(), nodes: Vec::new() };
        boxes.grow(0, surface.triangles.len());
        boxes
    }

    /// Adds the node of a range and all below it; gives its number.
    fn grow(&mut self, from: usize, to: usize) -> usize {
        let own = &self.own;
        let part = &mut self.order[from..to];
        let bounds = around(part.iter().map(|t| own[*t as usize]));
        let at = self.nodes.len();
        self.nodes.push(Node { bounds, range: [from, to], halves: None });
        if to - from > LEAF {
            let length = |k: usize| bounds[1][k] - bounds[0][k];
            let axis = (0..3).fold(0, |most, k| if length(k) > length(most) { k } else { most });
            let middle = |t: u32| own[t as usize][0][axis] + own[t as usize][1][axis];
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |a, b| middle(*a).total_cmp(&middle(*b)).then(a.cmp(b)));
            let halves = [self.grow(from, from + half), self.grow(from + half, to)];
            self.nodes[at].halves = Some(halves);
        }
        at
    }

    /// Calls `visit` for each pair of triangles whose boxes overlap.
    fn pairs(&self, mut visit: impl FnMut(u32, u32)) {
        let mut open = vec![[0, 0]];
        while let Some([i, j]) = open.pop() {
            let (a, b) = (&self.nodes[i], &self.nodes[j]);
            match (a.halves, b.halves) {
                (Some([l, r]), _) if i == j => open.extend([[l, l], [l, r], [r, r]]),
                _ if i != j && !overlap(&a.bounds, &b.bounds) => {}
                (Some([l, r]), other) if other.is_none() || a.range[1] - a.range[0] >= b.range[1] - b.range[0] => {
                    open.extend([[l, j], [r, j]]);
                }
                (_, Some([l, r])) => open.extend([[i, l], [i, r]]),
                _ => {
                    for (n, &s) in self.order[a.range[0]..a.range[1]].iter().enumerate() {
                        let after = if i == j { a.range[0] + n + 1 } else { b.range[0] };
                        for &t in &self.order[after..b.range[1]] {
                            if overlap(&self.own[s as usize], &self.own[t as usize]) {
                                visit(s, t);
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::algo::solids::{Solid, cube, sphere};
    use crate::algo::surface::Part;

    /// A ball of radius 1 about a place.
    fn ball(middle: [f64; 3], columns: u32, rows: u32) -> Solid {
        let (mut positions, triangles) = sphere(columns, rows);
        positions.iter_mut().for_each(|p| *p = [0, 1, 2].map(|k| p[k] + middle[k]));
        (positions, triangles)
    }

    /// The cube of a size from a place on.
    fn block(at: [f64; 3], size: f64) -> Solid {
        let (mut positions, triangles) = cube();
        positions.iter_mut().for_each(|p| *p = [0, 1, 2].map(|k| at[k] + size * (p[k] + 1.0) / 2.0));
        (positions, triangles)
    }

    fn surface(parts: &[Solid]) -> Surface {
        let parts: Vec<Part<'_>> = parts.iter().map(|(p, t)| Part { positions: p, triangles: t, normals: &[] }).collect();
        Surface::new(&parts, 1.0).unwrap()
    }

    fn place(surface: &Surface, point: &Crossing) -> Vector3<f64> {
        let [a, b] = point.vertices.map(|v| surface.positions[v as usize]);
        a + (b - a) * point.t
    }

    /// Links at each point.
    fn meeting((points, links): &(Vec<Crossing>, Vec<[u32; 2]>)) -> Vec<usize> {
        let mut n = vec![0; points.len()];
        links.iter().flatten().for_each(|p| n[*p as usize] += 1);
        n
    }

    #[test]
    fn two_balls_cross_in_a_circle() {
        let both = surface(&[ball([0.0; 3], 180, 90), ball([1.2, 0.3, 0.1], 170, 80)]);
        let found = crossings(&both);
        assert!(!found.1.is_empty() && meeting(&found).iter().all(|n| *n == 2));
        // The circle lies in the plane half-way, and its radius is the other side of a triangle of 1 and half the distance.
        let toward = Vector3::new(1.2_f64, 0.3, 0.1);
        let far = toward.norm() / 2.0;
        let around: f64 =
            found.1.iter().map(|l| (place(&both, &found.0[l[0] as usize]) - place(&both, &found.0[l[1] as usize])).norm()).sum();
        let radius = (1.0 - far * far).sqrt();
        for point in &found.0 {
            let p = place(&both, point);
            let along = p.dot(&toward) / toward.norm();
            assert!((along - far).abs() < 1e-3 && ((p - toward * (along / toward.norm())).norm() - radius).abs() < 1e-3, "{p:?}");
        }
        assert!((around - std::f64::consts::TAU * radius).abs() < 2e-3, "{around}");
    }

    #[test]
    fn what_a_plane_cuts_is_where_its_edges_cross_it() {
        let plane = (vec![[-5.0, -5.0, 0.3], [5.0, -5.0, 0.3], [5.0, 5.0, 0.3], [-5.0, 5.0, 0.3]], vec![[0, 1, 2], [0, 2, 3]]);
        let (solid, triangles) = ball([0.1, 0.2, 0.0], 16, 12);
        let crossed = |t: &&[u32; 3]| t.iter().any(|v| solid[*v as usize][2] >= 0.3) && t.iter().any(|v| solid[*v as usize][2] < 0.3);
        let count = triangles.iter().filter(crossed).count();
        let both = surface(&[(solid.clone(), triangles.clone()), plane]);
        let found = crossings(&both);
        // Those over the plane's diagonal cross both of its triangles.
        assert!((count..count + 4).contains(&found.1.len()), "{count} {}", found.1.len());
        assert!(meeting(&found).iter().all(|n| *n == 2));
        assert!(found.0.iter().all(|p| (place(&both, p).z - 0.3).abs() < 1e-12));
    }

    #[test]
    fn parts_at_the_same_corners_and_faces_still_give_closed_lines() {
        // Boxes in whole numbers: vertices on planes, edges on edges, faces on faces.
        for at in [[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.5, 0.5, 0.5], [1.0, 1.0, -1.0]] {
            for size in [1.0, 2.0, 3.0] {
                let both = surface(&[block([0.0; 3], 2.0), block(at, size)]);
                let found = crossings(&both);
                assert!(meeting(&found).iter().all(|n| *n <= 2), "{at:?} {size}");
            }
        }
        let found = crossings(&surface(&[block([0.0; 3], 2.0), block([1.0; 3], 2.0)]));
        assert!(found.1.len() >= 6 && meeting(&found).iter().all(|n| *n == 2));
        // Apart, and within.
        assert_eq!(crossings(&surface(&[block([0.0; 3], 1.0), block([1.5; 3], 1.0), block([-9.0; 3], 20.0)])).1, [[0; 2]; 0]);
        assert_eq!(crossings(&surface(&[])).0, []);
    }

    #[test]
    fn all_pairs_of_boxes_are_found_once() {
        let both = surface(&[ball([0.0; 3], 20, 14), ball([0.4, 0.3, 0.2], 13, 9)]);
        let boxes = Boxes::new(&both);
        let mut found = Vec::new();
        boxes.pairs(|a, b| found.push(sorted([a, b])));
        found.sort_unstable();
        let n = both.triangles.len() as u32;
        let all =
            (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b])).filter(|p| overlap(&boxes.own[p[0] as usize], &boxes.own[p[1] as usize]));
        assert!(found.iter().copied().eq(all));
    }
}
