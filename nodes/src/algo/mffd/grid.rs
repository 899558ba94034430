//! A deformation at every sample of a grid, in 32 bits: shares are counted from a cell near by, which 64 bits find, so that the whole is within a
//! few hundred-thousandths of a pixel.

use multiversion::multiversion;

use super::level::Level;
use super::{Combine, Ffd};

/// Samples that are moved together.
const LANES: usize = 8;
/// Samples of a straight row that take one level after another, and of a bent one that are found in a level at a time.
const BLOCK: usize = 64;
/// Control points whose moves lie open at a time.
const OPEN: usize = 1 << 22;

/// Added to a number it leaves the nearest whole one in the low bits, which is done by lanes, as a cast is not. At whole numbers the cell before may be the
/// one that is found, with a share of 1: the spline is the same. It holds for 4 million cells; moves that fold nowhere, of which there are `MOST` at the most,
/// are shorter together.
const WHOLE: f32 = 12_582_912.0;

/// The shares of four control points in samples.
type Shares = [[f32; LANES]; 4];
/// The cell of a sample that is moved already.
const DONE: i32 = i32::MAX;

/// A level laid open: the moves of all its control points, row by row.
struct Open {
    /// x and y by turns.
    moves: Vec<f32>,
    size: [usize; 2],
    origin: [f64; 2],
    inverse: [f64; 2],
}

/// The columns of a grid in a level, for rows that stay straight: what they take of a line of control points is the same in each.
struct Columns {
    /// Where in the line the four control points of a column begin.
    first: Vec<u32>,
    /// Their shares, each twice, as x and y take turns.
    basis: Vec<[f32; 8]>,
}

impl Ffd {
    /// How far each sample of a grid is moved, row by row: sample (i, j) lies at `start` + (i, j). Cost: O(samples · levels).
    pub fn displacements(&self, start: [f64; 2], [width, height]: [usize; 2]) -> Vec<[f32; 2]> {
        let mut out = vec![[0.0; 2]; width * height];
        let mut levels = &self.levels[..];
        while let Some(first) = levels.first() {
            // Levels are laid open as many as memory is fit for.
            let area = |l: &Level| l.size()[0] * l.size()[1];
            let mut sum = area(first);
            let n = 1 + levels[1..].iter().take_while(|l| (sum + area(l) <= OPEN).then(|| sum += area(l)).is_some()).count();
            let (now, later) = levels.split_at(n);
            let now: Vec<Open> = now.iter().map(open).collect();
            // Before the first level of all, rows are straight for those that are composed too.
            let own = if self.combine == Combine::Added { now.len() } else { usize::from(levels.len() == self.levels.len()) };
            let (straight, bent) = now.split_at(own);
            let columns: Vec<Columns> = straight.iter().map(|level| level.columns(start[0], width)).collect();
            let mut lines = vec![Vec::new(); straight.len()];
            let mut at = [vec![0.0; width.next_multiple_of(BLOCK)], vec![0.0; width.next_multiple_of(BLOCK)]];
            for (j, row) in out.chunks_exact_mut(width.max(1)).enumerate() {
                let y = start[1] + j as f64;
                add_straight(straight, &columns, &mut lines, y, row);
                if !bent.is_empty() {
                    bend(bent, [start[0], y], &mut at, row);
                }
            }
            levels = later;
        }
        out
    }
}

fn open(level: &Level) -> Open {
    let (origin, inverse) = level.frame();
    Open { moves: level.narrow(), size: level.size(), origin, inverse }
}

impl Open {
    fn columns(&self, start: f64, width: usize) -> Columns {
        let column = |k: usize| {
            let (i, s) = self.split(start + k as f64, 0);
            let b = basis(&[s]);
            (2 * self.within(i, 0) as u32, [0, 0, 1, 1, 2, 2, 3, 3].map(|k| b[k][0]))
        };
        let (first, basis) = (0..width).map(column).unzip();
        Columns { first, basis }
    }

    /// The cell of a place across (0) or down (1), which may be far beyond the lattice, and the share of it.
    #[inline(always)]
    fn split(&self, p: f64, axis: usize) -> (i32, f32) {
        let u = ((p - self.origin[axis]) * self.inverse[axis]).clamp(-5e8, 5e8);
        let floor = u.floor();
        (floor as i32, (u - floor) as f32)
    }

    /// The first control point of a cell; beyond the lattice that of the outermost one, where nothing moves.
    #[inline(always)]
    fn within(&self, cell: i32, axis: usize) -> usize {
        cell.clamp(0, self.size[axis] as i32 - 4) as usize
    }

    /// The line of control points that a straight row of samples takes from, x and y by turns.
    #[inline(always)]
    fn line(&self, y: f64, out: &mut Vec<f32>) {
        let (j, t) = self.split(y, 1);
        let c = basis(&[t]).map(|c| c[0]);
        let n = 2 * self.size[0];
        let rows = self.moves[self.within(j, 1) * n..][..4 * n].chunks_exact(n);
        out.clear();
        out.resize(n, 0.0);
        for (c, row) in c.iter().zip(rows) {
            out.iter_mut().zip(row).for_each(|(out, d)| *out = c.mul_add(*d, *out));
        }
    }
}

/// Adds what levels move a straight row of samples by. Products and sums are fused on every processor, slowly on one that has no such operation, so that
/// bits are the same.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_straight(levels: &[Open], columns: &[Columns], lines: &mut [Vec<f32>], y: f64, row: &mut [[f32; 2]]) {
    levels.iter().zip(&mut *lines).for_each(|(level, line)| level.line(y, line));
    for (block, out) in row.chunks_mut(BLOCK).enumerate() {
        let mut sums = [[0.0_f32; 8]; BLOCK];
        for (columns, line) in columns.iter().zip(&*lines) {
            let columns = columns.first[block * BLOCK..].iter().zip(&columns.basis[block * BLOCK..]);
            for (sum, (first, basis)) in sums.iter_mut().zip(columns) {
                let Some(d) = line.get(*first as usize..).and_then(|d| d.first_chunk::<8>()) else { continue };
                for e in 0..8 {
                    sum[e] = basis[e].mul_add(d[e], sum[e]);
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(&sums) {
            let by = |k: usize| (sum[k] + sum[4 + k]) + (sum[2 + k] + sum[6 + k]);
            *out = [out[0] + by(0), out[1] + by(1)];
        }
    }
}

/// Moves a row of samples, which lies where `row` says, by levels one after another.
///
/// Neighbours lie in the same cell or the next one, mostly. Lanes are samples, therefore: each takes from the control points of both cells, with shares of 0
/// where they are not its own.
#[multiversion(targets("x86_64+avx2+fma"))]
fn bend(levels: &[Open], start: [f64; 2], [by_x, by_y]: &mut [Vec<f32>; 2], row: &mut [[f32; 2]]) {
    for ((x, y), by) in by_x.iter_mut().zip(by_y.iter_mut()).zip(&*row) {
        [*x, *y] = *by;
    }
    let (mut across, mut down) = (Places::NONE, Places::NONE);
    for level in levels {
        for (block, (x, y)) in by_x.as_chunks_mut::<BLOCK>().0.iter_mut().zip(by_y.as_chunks_mut::<BLOCK>().0).enumerate() {
            across.find(level, 0, start[0] + (block * BLOCK) as f64, x);
            down.find(level, 1, start[1], y);
            for (k, (x, y)) in x.as_chunks_mut::<LANES>().0.iter_mut().zip(y.as_chunks_mut::<LANES>().0).enumerate() {
                add_bent(level, &across, &down, k, x, y);
            }
        }
    }
    for ((x, y), by) in by_x.iter().zip(by_y.iter()).zip(row) {
        *by = [*x, *y];
    }
}

/// Cells of samples one way, and their shares of the four control points from there on; aligned such that no vector lies in two lines of the cache.
#[repr(align(64))]
struct Places {
    cells: [i32; BLOCK],
    basis: [[f32; BLOCK]; 4],
    /// The first and the last of the cells of samples that are moved together.
    range: [[i32; 2]; BLOCK / LANES],
}

impl Places {
    const NONE: Self = Self { cells: [0; BLOCK], basis: [[0.0; BLOCK]; 4], range: [[0; 2]; BLOCK / LANES] };

    /// Finds samples that were at `start`, across one after another, and have moved; beyond the lattice the outermost cells, where nothing moves.
    #[inline(always)]
    fn find(&mut self, level: &Open, axis: usize, start: f64, by: &[f32; BLOCK]) {
        let (first, share) = level.split(start, axis);
        let (inverse, last) = (level.inverse[axis] as f32, level.size[axis] as i32 - 5);
        let first = first - WHOLE.to_bits() as i32;
        let mut shares = [0.0; BLOCK];
        for n in 0..BLOCK {
            let by = if axis == 0 { n as f32 + by[n] } else { by[n] };
            let u = by.mul_add(inverse, share);
            let shifted = u - 0.5 + WHOLE;
            self.cells[n] = (shifted.to_bits() as i32 + first).max(0).min(last);
            shares[n] = u - (shifted - WHOLE);
        }
        for (range, cells) in self.range.iter_mut().zip(self.cells.as_chunks::<LANES>().0) {
            *range = [cells.iter().fold(i32::MAX, |a, b| a.min(*b)), cells.iter().fold(0, |a, b| a.max(*b))];
        }
        self.basis = basis(&shares);
    }

    #[inline(always)]
    fn lanes(&self, at: usize) -> ([i32; LANES], Shares) {
        let mut cells = [0; LANES];
        let mut basis = [[0.0; LANES]; 4];
        cells.copy_from_slice(&self.cells[at * LANES..][..LANES]);
        for k in 0..4 {
            basis[k].copy_from_slice(&self.basis[k][at * LANES..][..LANES]);
        }
        (cells, basis)
    }
}

/// Moves samples by a level.
#[inline(always)]
fn add_bent(level: &Open, across: &Places, down: &Places, at: usize, x: &mut [f32; LANES], y: &mut [f32; LANES]) {
    let ((i, b), (j, c)) = (across.lanes(at), down.lanes(at));
    let ([left, right], [top, bottom]) = (across.range[at], down.range[at]);
    let by = match (right - left, bottom - top) {
        (0, 0) => spline(level, [left, top], &b, &c),
        (0, 1) => spline(level, [left, top], &b, &spread(&c, &j, top)),
        (1, 0) => spline(level, [left, top], &spread(&b, &i, left), &c),
        (1, 1) => spline(level, [left, top], &spread(&b, &i, left), &spread(&c, &j, top)),
        _ => scattered(level, across, down, at),
    };
    for n in 0..LANES {
        x[n] += by[0][n];
    }
    for n in 0..LANES {
        y[n] += by[1][n];
    }
}

/// Moves of samples in many cells, two by two cells at a time.
#[inline(always)]
fn scattered(level: &Open, across: &Places, down: &Places, at: usize) -> [[f32; LANES]; 2] {
    let ((mut i, b), (mut j, c)) = (across.lanes(at), down.lanes(at));
    let mut sums = [[0.0; LANES]; 2];
    for own in 0..LANES {
        if i[own] == DONE {
            continue;
        }
        let [left, top] = [&i, &j].map(|cells| cells.iter().fold(DONE, |a, b| a.min(*b)).max(cells[own] - 1));
        let by = spline(level, [left, top], &spread(&b, &i, left), &spread(&c, &j, top));
        for n in 0..LANES {
            let is_own = (i[n] - left) as u32 <= 1 && (j[n] - top) as u32 <= 1;
            i[n] = if is_own { DONE } else { i[n] };
            j[n] = if is_own { DONE } else { j[n] };
        }
        for n in 0..LANES {
            sums[0][n] += by[0][n];
        }
        for n in 0..LANES {
            sums[1][n] += by[1][n];
        }
    }
    sums
}

/// The sums of control points' moves by the products of shares, from a cell's first on.
#[inline(always)]
fn spline<const C: usize, const R: usize>(
    level: &Open,
    [left, top]: [i32; 2],
    b: &[[f32; LANES]; C],
    c: &[[f32; LANES]; R],
) -> [[f32; LANES]; 2] {
    let (mut sum_x, mut sum_y) = ([0.0; LANES], [0.0; LANES]);
    let width = level.size[0];
    let from = 2 * (top as usize * width + left as usize);
    let Some(moves) = level.moves.get(from..from + 2 * ((R - 1) * width + C)) else { return [sum_x, sum_y] };
    for (l, c) in c.iter().enumerate() {
        let d = &moves[2 * l * width..][..2 * C];
        let (mut line_x, mut line_y) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..C {
            for n in 0..LANES {
                line_x[n] = b[k][n].mul_add(d[2 * k], line_x[n]);
                line_y[n] = b[k][n].mul_add(d[2 * k + 1], line_y[n]);
            }
        }
        for n in 0..LANES {
            sum_x[n] = c[n].mul_add(line_x[n], sum_x[n]);
            sum_y[n] = c[n].mul_add(line_y[n], sum_y[n]);
        }
    }
    [sum_x, sum_y]
}

/// The shares of five control points from a cell's first on, 0 for samples that are neither of this cell nor of the next one.
#[inline(always)]
fn spread(basis: &Shares, cells: &[i32; LANES], first: i32) -> [[f32; LANES]; 5] {
    let (mut here, mut next, mut wide) = ([0.0; LANES], [0.0; LANES], [[0.0; LANES]; 5]);
    for n in 0..LANES {
        here[n] = f32::from(u8::from(cells[n] == first));
        next[n] = f32::from(u8::from(cells[n] == first + 1));
    }
    for n in 0..LANES {
        wide[0][n] = here[n] * basis[0][n];
    }
    for k in 1..4 {
        for n in 0..LANES {
            wide[k][n] = next[n].mul_add(basis[k - 1][n], here[n] * basis[k][n]);
        }
    }
    for n in 0..LANES {
        wide[4][n] = next[n] * basis[3][n];
    }
    wide
}

/// The four cubic B-splines at each share.
#[inline(always)]
fn basis<const N: usize>(shares: &[f32; N]) -> [[f32; N]; 4] {
    let mut parts = [[0.0f32; N]; 4];
    for n in 0..N {
        let s = shares[n];
        let (r, s2) = (1.0 - s, s * s);
        parts[0][n] = r * r * r * (1.0 / 6.0);
        parts[1][n] = 0.5_f32.mul_add(s, -1.0).mul_add(s2, 2.0 / 3.0);
        parts[3][n] = s2 * s * (1.0 / 6.0);
        parts[2][n] = 0.5_f32.mul_add(r, -1.0).mul_add(r * r, 2.0 / 3.0);
    }
    parts
}
