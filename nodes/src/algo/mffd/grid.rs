//! A deformation at every sample of a grid, in 32 bits: places are kept in 64, so that the whole is within a few hundred-thousandths of a pixel.

use multiversion::multiversion;

use super::level::Level;
use super::{Combine, Ffd};

/// Samples that are looked at together.
const LANES: usize = 16;
/// Samples of a straight row that take one level after another.
const BLOCK: usize = 64;
/// Control points whose moves lie open at a time.
const OPEN: usize = 1 << 22;

/// Added to a number it leaves the nearest whole one in the low bits, which is done by lanes, as a cast is not. At whole numbers the cell before may be the
/// one that is found, with a share of 1: the spline is the same.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// A level laid open: the moves of all its control points, row by row.
struct Open {
    /// x and y by turns.
    moves: Vec<f32>,
    size: [usize; 2],
    origin: [f64; 2],
    inverse: [f64; 2],
}

/// The columns of a grid in a level, for rows that are still straight: what they take of a line of control points is the same in each.
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
        let mut is_straight = true;
        while let Some(first) = levels.first() {
            // Levels are laid open as many as memory is fit for.
            let area = |l: &Level| l.size()[0] * l.size()[1];
            let mut sum = area(first);
            let n = 1 + levels[1..].iter().take_while(|l| (sum + area(l) <= OPEN).then(|| sum += area(l)).is_some()).count();
            let (now, later) = levels.split_at(n);
            let now: Vec<Open> = now.iter().map(open).collect();
            // Rows bend with the first level that is composed.
            let (straight, bent) = now.split_at(if self.combine == Combine::Added { n } else { usize::from(is_straight) });
            let columns: Vec<Columns> = straight.iter().map(|level| level.columns(start[0], width)).collect();
            let mut lines = vec![Vec::new(); straight.len()];
            let mut at = [vec![0.0; width.next_multiple_of(LANES)], vec![0.0; width.next_multiple_of(LANES)]];
            for (j, row) in out.chunks_exact_mut(width.max(1)).enumerate() {
                let y = start[1] + j as f64;
                add_straight(straight, &columns, &mut lines, y, row);
                if !bent.is_empty() {
                    bend(bent, [start[0], y], &mut at, row);
                }
            }
            (levels, is_straight) = (later, false);
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
            let (i, s) = self.split(&[start + k as f64; LANES], 0);
            let b = basis(&s);
            (2 * i[0] as u32, [0, 0, 1, 1, 2, 2, 3, 3].map(|k| b[k][0]))
        };
        let (first, basis) = (0..width).map(column).unzip();
        Columns { first, basis }
    }

    /// Cells and shares of places across (0) or down (1); beyond the lattice the outermost cells, where nothing moves.
    #[inline(always)]
    fn split(&self, p: &[f64; LANES], axis: usize) -> ([i32; LANES], [f32; LANES]) {
        let (origin, inverse, last) = (self.origin[axis], self.inverse[axis], (self.size[axis] - 4) as f64);
        let (mut cells, mut shares) = ([0; LANES], [0.0; LANES]);
        for n in 0..LANES {
            let u = ((p[n] - origin) * inverse).max(0.0).min(last);
            let shifted = u - 0.5 + WHOLE;
            cells[n] = shifted.to_bits() as i32;
            shares[n] = (u - (shifted - WHOLE)) as f32;
        }
        (cells, shares)
    }

    /// The line of control points that a straight row of samples takes from, x and y by turns.
    #[inline(always)]
    fn line(&self, y: f64, out: &mut Vec<f32>) {
        let (j, t) = self.split(&[y; LANES], 1);
        let c = basis(&t).map(|c| c[0]);
        let n = 2 * self.size[0];
        let rows = self.moves[j[0] as usize * n..][..4 * n].chunks_exact(n);
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
#[multiversion(targets("x86_64+avx2+fma"))]
fn bend(levels: &[Open], start: [f64; 2], at: &mut [Vec<f64>; 2], row: &mut [[f32; 2]]) {
    let [at_x, at_y] = at;
    for (k, ((x, y), by)) in at_x.iter_mut().zip(at_y.iter_mut()).zip(&*row).enumerate() {
        (*x, *y) = (start[0] + k as f64 + f64::from(by[0]), start[1] + f64::from(by[1]));
    }
    for level in levels {
        let width = 2 * level.size[0];
        for (x, y) in at_x.as_chunks_mut::<LANES>().0.iter_mut().zip(at_y.as_chunks_mut::<LANES>().0) {
            let ((i, s), (j, t)) = (level.split(x, 0), level.split(y, 1));
            let (b, c) = (basis(&s), basis(&t));
            let mut sums = [[0.0_f32; 8]; LANES];
            for (n, sum) in sums.iter_mut().enumerate() {
                let first = j[n] as usize * width + 2 * i[n] as usize;
                let Some(block) = level.moves.get(first..first + 3 * width + 8) else { continue };
                let rows = [0, 1, 2, 3].map(|k| *block[k * width..].first_chunk::<8>().unwrap_or(&[0.0; 8]));
                let mut own = [0.0; 8];
                for (c, row) in c.iter().zip(&rows) {
                    for e in 0..8 {
                        own[e] = c[n].mul_add(row[e], own[e]);
                    }
                }
                *sum = own;
            }
            for (n, d) in sums.iter().enumerate() {
                let b = b.map(|b| b[n]);
                x[n] += f64::from((b[0] * d[0] + b[1] * d[2]) + (b[2] * d[4] + b[3] * d[6]));
                y[n] += f64::from((b[0] * d[1] + b[1] * d[3]) + (b[2] * d[5] + b[3] * d[7]));
            }
        }
    }
    for (k, ((x, y), by)) in at_x.iter().zip(at_y.iter()).zip(row).enumerate() {
        *by = [(x - start[0] - k as f64) as f32, (y - start[1]) as f32];
    }
}

/// The four cubic B-splines at each share.
#[inline(always)]
fn basis(shares: &[f32; LANES]) -> [[f32; LANES]; 4] {
    let mut parts = [[0.0f32; LANES]; 4];
    for n in 0..LANES {
        let s = shares[n];
        let (r, s2) = (1.0 - s, s * s);
        parts[0][n] = r * r * r * (1.0 / 6.0);
        parts[1][n] = 0.5_f32.mul_add(s, -1.0).mul_add(s2, 2.0 / 3.0);
        parts[3][n] = s2 * s * (1.0 / 6.0);
        parts[2][n] = 1.0 - (parts[0][n] + parts[1][n] + parts[3][n]);
    }
    parts
}
