//! Fields made into surfaces: dual marching cubes, then evened out.
//!
//! **Source** Nielson, *Dual marching cubes*, IEEE Visualization 2004: one vertex for each sheet of the surface in a cell, one quadrangle for each edge
//! of the grid that the surface crosses. A face whose corners alternate is cut so that its inner corners part, in both cells alike.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::field::{Blob, field, projected};

/// A surface of triangles, closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Net {
    pub(super) positions: Vec<Vector3<f64>>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The edges of a cell: the axis they run along, and the corner that they start from (bit k: one step along axis k).
const EDGES: [(usize, usize); 12] = [(0, 0), (0, 2), (0, 4), (0, 6), (1, 0), (1, 1), (1, 4), (1, 5), (2, 0), (2, 1), (2, 2), (2, 3)];
/// How often the grid is moved on when a surface folds within a cell.
const TRIES: u32 = 8;

struct Grid {
    origin: Vector3<f64>,
    cell: f64,
    /// Number of corners along each axis.
    n: [usize; 3],
    values: Vec<f64>,
}

impl Grid {
    fn over(blobs: &[Blob], cell: f64, shift: f64) -> Self {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for (middle, reach) in blobs.iter().map(Blob::bounds) {
            low = low.inf(&middle.add_scalar(-reach));
            high = high.sup(&middle.add_scalar(reach));
        }
        // Fillets swell a little beyond the blobs.
        let origin = low.add_scalar(-cell * (3.0 + shift));
        let n = [0, 1, 2].map(|k| ((high[k] - origin[k]) / cell) as usize + 4);
        let mut grid = Self { origin, cell, n, values: vec![f64::INFINITY; n[0] * n[1] * n[2]] };
        grid.sample(blobs);
        grid
    }

    fn at(&self, i: [usize; 3]) -> usize {
        (i[2] * self.n[1] + i[1]) * self.n[0] + i[0]
    }

    fn point(&self, i: [usize; 3]) -> Vector3<f64> {
        self.origin + Vector3::from_fn(|k, _| i[k] as f64 * self.cell)
    }

    /// Samples blocks of corners; where a block's middle is far from the surface, the whole block is given its sign.
    fn sample(&mut self, blobs: &[Blob]) {
        const SIDE: usize = 4;
        let blocks = self.n.map(|n| n.div_ceil(SIDE));
        // Fields of ellipsoids may grow faster than distance: half as much again is on the safe side.
        let far = 1.5 * SIDE as f64 * self.cell;
        for b in (0..blocks[0] * blocks[1] * blocks[2]).map(|b| [b % blocks[0], b / blocks[0] % blocks[1], b / (blocks[0] * blocks[1])]) {
            let middle = field(blobs, &(self.point(b.map(|i| i * SIDE)).add_scalar(self.cell * 1.5)));
            for c in (0..SIDE * SIDE * SIDE).map(|c| [c % SIDE, c / SIDE % SIDE, c / (SIDE * SIDE)]) {
                let i = [0, 1, 2].map(|k| b[k] * SIDE + c[k]);
                if (0..3).all(|k| i[k] < self.n[k]) {
                    let value = if middle.abs() > far { middle } else { field(blobs, &self.point(i)) };
                    let at = self.at(i);
                    self.values[at] = value;
                }
            }
        }
    }

    /// Which sheet each edge of the cell belongs to, where the surface crosses it.
    fn sheets(&self, cell: [usize; 3]) -> [Option<u8>; 12] {
        let inside = std::array::from_fn::<bool, 8, _>(|c| self.values[self.at(corner(cell, c))] < 0.0);
        let mut sheet = std::array::from_fn::<_, 12, _>(|e| {
            let (axis, c) = EDGES[e];
            (inside[c] != inside[c | 1 << axis]).then_some(e as u8)
        });
        for (axis, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
            let crossed: Vec<usize> = (0..12).filter(|&e| sheet[e].is_some() && on_face(e, axis, side)).collect();
            if crossed.len() == 2 {
                join(&mut sheet, crossed[0], crossed[1]);
            }
            for c in (0..8).filter(|&c| crossed.len() == 4 && inside[c] && c >> axis & 1 == side) {
                let own: Vec<usize> = crossed.iter().copied().filter(|&e| EDGES[e].1 == c || EDGES[e].1 | 1 << EDGES[e].0 == c).collect();
                join(&mut sheet, own[0], own[1]);
            }
        }
        sheet
    }

    /// Where the surface crosses an edge that starts at a corner.
    fn crossing(&self, start: [usize; 3], axis: usize) -> Vector3<f64> {
        let mut end = start;
        end[axis] += 1;
        let (a, b) = (self.values[self.at(start)], self.values[self.at(end)]);
        self.point(start) + Vector3::ith(axis, self.cell * a / (a - b))
    }
}

fn corner(cell: [usize; 3], c: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| cell[k] + (c >> k & 1))
}

fn on_face(edge: usize, axis: usize, side: usize) -> bool {
    let (along, start) = EDGES[edge];
    along != axis && start >> axis & 1 == side
}

fn join(sheet: &mut [Option<u8>; 12], a: usize, b: usize) {
    let (from, to) = (sheet[a].max(sheet[b]), sheet[a].min(sheet[b]));
    sheet.iter_mut().filter(|s| s.is_some() && **s == from).for_each(|s| *s = to);
}

/// Quadrangles, anticlockwise from outside, and their vertices.
type Quads = (Vec<Vector3<f64>>, Vec<[u32; 4]>);

fn quads(grid: &Grid) -> Quads {
    let mut vertices = BTreeMap::new();
    let mut positions = Vec::new();
    let cells = grid.n.map(|n| n - 1);
    for at in 0..cells[0] * cells[1] * cells[2] {
        let cell = [at % cells[0], at / cells[0] % cells[1], at / (cells[0] * cells[1])];
        let sheets = grid.sheets(cell);
        for root in (0..12).filter(|&e| sheets[e] == Some(e as u8)) {
            let edges: Vec<usize> = (0..12).filter(|&e| sheets[e] == Some(root as u8)).collect();
            let sum: Vector3<f64> = edges.iter().map(|&e| grid.crossing(corner(cell, EDGES[e].1), EDGES[e].0)).sum();
            vertices.extend(edges.iter().map(|&e| ((cell, e), positions.len() as u32)));
            positions.push(sum / edges.len() as f64);
        }
    }
    let mut quads = Vec::new();
    for (axis, at) in (0..3).flat_map(|axis| (0..grid.values.len()).map(move |at| (axis, at))) {
        let start = [at % grid.n[0], at / grid.n[0] % grid.n[1], at / (grid.n[0] * grid.n[1])];
        quads.extend(quad(grid, &vertices, start, axis));
    }
    (positions, quads)
}

/// The quadrangle about an edge of the grid, if the surface crosses it.
fn quad(grid: &Grid, vertices: &BTreeMap<([usize; 3], usize), u32>, start: [usize; 3], axis: usize) -> Option<[u32; 4]> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut end = start;
    end[axis] += 1;
    if end[axis] >= grid.n[axis] {
        return None;
    }
    let (from, to) = (grid.values[grid.at(start)] < 0.0, grid.values[grid.at(end)] < 0.0);
    if from == to {
        return None;
    }
    let around = [(1, 1), (0, 1), (0, 0), (1, 0)];
    let mut quad = [0; 4];
    for (slot, (du, dv)) in quad.iter_mut().zip(around) {
        let mut cell = start;
        cell[u] = cell[u].checked_sub(du)?;
        cell[v] = cell[v].checked_sub(dv)?;
        let e = EDGES.iter().position(|&edge| edge == (axis, du << u | dv << v))?;
        *slot = *vertices.get(&(cell, e))?;
    }
    // The cells go anticlockwise about the axis, so the quadrangle faces along it.
    if to {
        quad.reverse();
    }
    Some(quad)
}

/// True where each edge has two sides.
fn is_manifold(quads: &[[u32; 4]]) -> bool {
    let mut edges: Vec<[u32; 2]> = quads.iter().flat_map(|q| (0..4).map(|k| [q[k], q[(k + 1) % 4]])).collect();
    edges.sort_unstable();
    let doubled = edges.windows(2).any(|w| w[0] == w[1]);
    !doubled && edges.iter().all(|&[a, b]| edges.binary_search(&[b, a]).is_ok())
}

/// The surface of a body, of quadrangles about as long as `cell`, each cut in two.
///
/// Vertices lie on the surface and are spread evenly over it. `None` where the surface stays folded within cells wherever they are.
pub(super) fn net(blobs: &[Blob], cell: f64) -> Option<Net> {
    let tries = (0..TRIES).map(|i| quads(&Grid::over(blobs, cell, f64::from(i) / f64::from(TRIES))));
    let (mut positions, quads) = tries.into_iter().find(|(_, quads)| is_manifold(quads))?;
    let f = |p: &Vector3<f64>| field(blobs, p);
    for _ in 0..10 {
        spread(&mut positions, &quads, &f, cell);
    }
    positions.iter_mut().for_each(|p| *p = projected(&f, p, cell / 2.0, 1e-9));
    let triangles = quads.iter().flat_map(|q| halves(&positions, *q)).collect();
    Some(Net { positions, triangles })
}

/// Moves each vertex half-way to the mean of its neighbours, and back on the surface.
fn spread(positions: &mut [Vector3<f64>], quads: &[[u32; 4]], f: &impl Fn(&Vector3<f64>) -> f64, cell: f64) {
    let mut sums = vec![(Vector3::zeros(), 0.0); positions.len()];
    for (a, b) in quads.iter().flat_map(|q| (0..4).map(move |k| (q[k] as usize, q[(k + 1) % 4] as usize))) {
        sums[a].0 += positions[b];
        sums[a].1 += 1.0;
    }
    for (p, (sum, n)) in positions.iter_mut().zip(sums) {
        *p = projected(f, &((*p + sum / n) / 2.0), cell / 2.0, cell / 50.0);
    }
}

/// A quadrangle cut along the diagonal that leaves the rounder triangles.
fn halves(positions: &[Vector3<f64>], [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    let [one, other] = [[[a, b, c], [a, c, d]], [[b, c, d], [b, d, a]]];
    let worst = |cut: &[[u32; 3]; 2]| roundness(positions, cut[0]).min(roundness(positions, cut[1]));
    if worst(&other) > worst(&one) { other } else { one }
}

/// 1 for an equilateral triangle, 0 for one without an area: its area over the sum of its squared sides.
pub(super) fn roundness(positions: &[Vector3<f64>], t: [u32; 3]) -> f64 {
    let [a, b, c] = t.map(|i| positions[i as usize]);
    let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    if sides > 0.0 { 2.0 * 3f64.sqrt() * (b - a).cross(&(c - a)).norm() / sides } else { 0.0 }
}
