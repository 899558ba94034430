//! One level: a lattice of control points, most of which may be at rest.

/// Control points of a tile, each way.
const TILE: usize = 8;
/// A tile in which nothing moves.
const REST: u32 = u32::MAX;

/// Moves of a lattice of control points, in tiles of which only those are kept in which something moves.
///
/// Control point (i, j) stands at origin + (i - 1, j - 1) spacings; a tile of them lies before the first each way, so that supports that reach beyond the
/// rectangle need no case of their own.
#[derive(Clone, Debug)]
pub(super) struct Level {
    origin: [f64; 2],
    spacing: [f64; 2],
    inverse: [f64; 2],
    /// Tiles across and down.
    tiles: [usize; 2],
    /// Where each tile's control points start in `moves`, by tiles.
    index: Vec<u32>,
    moves: Vec<[f64; 2]>,
}

/// The four cubic B-splines that are not 0 at a share `s` of a cell.
pub(super) fn basis(s: f64) -> [f64; 4] {
    let (r, s2) = (1.0 - s, s * s);
    [r * r * r / 6.0, (3.0 * s2 * s - 6.0 * s2 + 4.0) / 6.0, (-3.0 * s2 * s + 3.0 * s2 + 3.0 * s + 1.0) / 6.0, s2 * s / 6.0]
}

/// Their derivatives.
fn slopes(s: f64) -> [f64; 4] {
    let (r, s2) = (1.0 - s, s * s);
    [-r * r / 2.0, (3.0 * s2 - 4.0 * s) / 2.0, (-3.0 * s2 + 2.0 * s + 1.0) / 2.0, s2 / 2.0]
}

impl Level {
    /// A lattice at rest, of so many cells in a rectangle `[left, top, right, bottom]`.
    pub(super) fn new([left, top, right, bottom]: [f64; 4], cells: [usize; 2]) -> Self {
        let extent = [right - left, bottom - top];
        let tiles = cells.map(|n| (n + 3).div_ceil(TILE) + 2);
        Self {
            origin: [left, top],
            spacing: [0, 1].map(|k| extent[k] / cells[k] as f64),
            inverse: [0, 1].map(|k| cells[k] as f64 / extent[k]),
            tiles,
            index: vec![REST; tiles[0] * tiles[1]],
            moves: Vec::new(),
        }
    }

    /// The first of the four by four control points about a place, counted from the corner of the first tile, and the shares of its cell; `None` where none
    /// of them is there.
    fn cell(&self, p: [f64; 2]) -> Option<([usize; 2], [f64; 2])> {
        let u = [0, 1].map(|k| (p[k] - self.origin[k]) * self.inverse[k]);
        let floor = u.map(libm::floor);
        let last = self.tiles.map(|n| (n * TILE - 4) as f64);
        let first = floor.map(|f| f + TILE as f64);
        let is_there = (0..2).all(|k| first[k] >= 0.0 && first[k] <= last[k]);
        is_there.then(|| (first.map(|f| f as usize), [u[0] - floor[0], u[1] - floor[1]]))
    }

    /// The moves of four by four control points, rows for y; `None` where all of them are at rest.
    fn block(&self, [i, j]: [usize; 2]) -> Option<[[[f64; 2]; 4]; 4]> {
        let (left, right) = (i / TILE, (i + 3) / TILE);
        let own = (TILE - i % TILE).min(4);
        let mut block = [[[0.0; 2]; 4]; 4];
        let mut is_moved = false;
        for (l, line) in block.iter_mut().enumerate() {
            let (y, row) = ((j + l) / TILE * self.tiles[0], (j + l) % TILE * TILE);
            let mut copy = |to: &mut [[f64; 2]], tile: usize, from: usize| {
                let start = self.index[y + tile];
                if start != REST {
                    is_moved = true;
                    to.copy_from_slice(&self.moves[start as usize + row + from..][..to.len()]);
                }
            };
            let (first, second) = line.split_at_mut(own);
            copy(first, left, i % TILE);
            if !second.is_empty() {
                copy(second, right, 0);
            }
        }
        is_moved.then_some(block)
    }

    /// How far a place is moved.
    pub(super) fn displacement(&self, p: [f64; 2]) -> [f64; 2] {
        let Some((first, [s, t])) = self.cell(p) else { return [0.0; 2] };
        let Some(block) = self.block(first) else { return [0.0; 2] };
        blend(&block, &basis(s), &basis(t))
    }

    /// How far a place is moved, and the derivative of that: rows x and y, columns by x and by y.
    pub(super) fn derivative(&self, p: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let none = ([0.0; 2], [[0.0; 2]; 2]);
        let Some((first, [s, t])) = self.cell(p) else { return none };
        let Some(block) = self.block(first) else { return none };
        let (b, db, c, dc) = (basis(s), slopes(s), basis(t), slopes(t));
        let (mut by, mut by_x, mut by_y) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for l in 0..4 {
            let (line, sloped) = (line(&block[l], &b), line(&block[l], &db));
            for n in 0..2 {
                by[n] += c[l] * line[n];
                by_x[n] += c[l] * sloped[n] * self.inverse[0];
                by_y[n] += dc[l] * line[n] * self.inverse[1];
            }
        }
        (by, [[by_x[0], by_y[0]], [by_x[1], by_y[1]]])
    }

    /// The lattice that moves each place `p` by about `r`: rows are p, r and a weight (Lee, Wolberg, Shin 1997, equations 3 to 5).
    pub(super) fn approximate(&self, rows: impl Iterator<Item = ([f64; 2], [f64; 2], f64)>) -> Self {
        let mut level = Self { index: self.index.clone(), moves: Vec::new(), ..*self };
        let mut sums: Vec<f64> = Vec::new();
        for (p, r, weight) in rows.filter(|row| row.2 > 0.0) {
            let Some(([i, j], [s, t])) = self.cell(p) else { continue };
            let (b, c) = (basis(s), basis(t));
            let square = |b: [f64; 4]| b.iter().map(|v| v * v).sum::<f64>();
            let over = 1.0 / (square(b) * square(c));
            for (l, k) in (0..16).map(|n| (n / 4, n % 4)) {
                let w = b[k] * c[l];
                let at = level.make(i + k, j + l, &mut sums);
                let share = weight * w * w;
                sums[at] += share;
                (0..2).for_each(|n| level.moves[at][n] += share * (w * r[n] * over));
            }
        }
        for (by, sum) in level.moves.iter_mut().zip(&sums).filter(|(_, sum)| **sum > 0.0) {
            *by = by.map(|v| v / sum);
        }
        level
    }

    /// Where a control point's move stands; its tile is made where there is none.
    fn make(&mut self, i: usize, j: usize, sums: &mut Vec<f64>) -> usize {
        let tile = j / TILE * self.tiles[0] + i / TILE;
        if self.index[tile] == REST {
            self.index[tile] = self.moves.len() as u32;
            self.moves.resize(self.moves.len() + TILE * TILE, [0.0; 2]);
            sums.resize(self.moves.len(), 0.0);
        }
        self.index[tile] as usize + j % TILE * TILE + i % TILE
    }

    /// Cuts moves short that are longer than `bound` spacings either way; true where one was.
    pub(super) fn limit(&mut self, bound: f64) -> bool {
        let most = self.spacing.map(|h| h * bound);
        let mut is_cut = false;
        for by in &mut self.moves {
            let cut = [by[0].clamp(-most[0], most[0]), by[1].clamp(-most[1], most[1])];
            is_cut |= cut != *by;
            *by = cut;
        }
        is_cut
    }

    /// Control points across and down, the outer tiles among them.
    pub(super) fn size(&self) -> [usize; 2] {
        self.tiles.map(|n| n * TILE)
    }

    /// Origin and the inverse of the spacing, such that `(p - origin) * inverse` counts control points as [`Level::narrow`] does.
    pub(super) fn frame(&self) -> ([f64; 2], [f64; 2]) {
        ([0, 1].map(|k| self.origin[k] - TILE as f64 * self.spacing[k]), self.inverse)
    }

    /// All control points' moves, row by row, x and y by turns, in 32 bits.
    pub(super) fn narrow(&self) -> Vec<f32> {
        let [w, h] = self.size();
        let mut moves = vec![0.0; 2 * w * h];
        for (tile, &start) in self.index.iter().enumerate().filter(|(_, start)| **start != REST) {
            let (x, y) = (tile % self.tiles[0] * TILE, tile / self.tiles[0] * TILE);
            for (l, row) in self.moves[start as usize..][..TILE * TILE].chunks_exact(TILE).enumerate() {
                let to = &mut moves[2 * ((y + l) * w + x)..][..2 * TILE];
                to.iter_mut().zip(row.as_flattened()).for_each(|(to, from)| *to = *from as f32);
            }
        }
        moves
    }
}

/// The sum of a row of control points' moves by basis functions.
fn line(row: &[[f64; 2]; 4], across: &[f64; 4]) -> [f64; 2] {
    [0, 1].map(|n| (across[0] * row[0][n] + across[1] * row[1][n]) + (across[2] * row[2][n] + across[3] * row[3][n]))
}

/// The sum of control points' moves by the products of basis functions.
fn blend(block: &[[[f64; 2]; 4]; 4], across: &[f64; 4], down: &[f64; 4]) -> [f64; 2] {
    let lines = [0, 1, 2, 3].map(|l| line(&block[l], across));
    [0, 1].map(|n| (down[0] * lines[0][n] + down[1] * lines[1][n]) + (down[2] * lines[2][n] + down[3] * lines[3][n]))
}
