//! A deformation at every sample of a grid, in 32 bits: places are kept in 64, so that the whole is within a few hundred-thousandths of a pixel.

use multiversion::multiversion;

use super::level::Level;
use super::{Combine, Ffd};

/// Samples that are looked at together.
const LANES: usize = 16;
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
            let mut at = [vec![0.0; width.next_multiple_of(LANES)], vec![0.0; width.next_multiple_of(LANES)]];
            let mut by = [vec![0.0; at[0].len()], vec![0.0; at[0].len()]];
            for (j, row) in out.chunks_exact_mut(width.max(1)).enumerate() {
                for k in 0..2 {
                    by[k].iter_mut().zip(row.iter()).for_each(|(b, v)| *b = f64::from(v[k]));
                }
                let y = start[1] + j as f64;
                draw(&now, self.combine == Combine::Composed, [start[0], y], &mut at, &mut by);
                for k in 0..2 {
                    row.iter_mut().zip(&by[k]).for_each(|(v, b)| v[k] = *b as f32);
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

/// A row of samples under some levels.
#[multiversion(targets("x86_64+avx512f+avx512dq+avx512vl", "x86_64+avx2", "x86_64+avx"))]
fn draw(levels: &[Open], is_composed: bool, start: [f64; 2], at: &mut [Vec<f64>; 2], by: &mut [Vec<f64>; 2]) {
    let [at_x, at_y] = at;
    let [by_x, by_y] = by;
    for (k, (x, y)) in at_x.iter_mut().zip(at_y.iter_mut()).enumerate() {
        (*x, *y) = (start[0] + k as f64, start[1]);
        if is_composed {
            (*x, *y) = (*x + by_x[k], *y + by_y[k]);
        }
    }
    for level in levels {
        let last = level.size.map(|n| (n - 4) as f64);
        let width = level.size[0] as i32;
        let rows = [0, 1, 2, 3].map(|l| &level.moves[2 * l * level.size[0]..]);
        let chunks = at_x.as_chunks_mut::<LANES>().0.iter_mut().zip(at_y.as_chunks_mut::<LANES>().0);
        let sums = by_x.as_chunks_mut::<LANES>().0.iter_mut().zip(by_y.as_chunks_mut::<LANES>().0);
        for ((x, y), (sum_x, sum_y)) in chunks.zip(sums) {
            let (i, s) = split(x, level.origin[0], level.inverse[0], last[0]);
            let (j, t) = split(y, level.origin[1], level.inverse[1], last[1]);
            let (b, c) = (basis(&s), basis(&t));
            let cell: [i32; LANES] = std::array::from_fn(|n| j[n] * width + i[n]);
            let (mut dx, mut dy) = ([0.0f32; LANES], [0.0f32; LANES]);
            let mut is_done = [false; LANES];
            // Neighbours lie in one cell, or in a few: each is evaluated for all of them and taken by those that lie in it.
            for first in 0..LANES {
                if is_done[first] {
                    continue;
                }
                let own = cell[first];
                let block = rows.map(|row| row.get(2 * own as usize..).and_then(|r| r.first_chunk::<8>()));
                let [Some(r0), Some(r1), Some(r2), Some(r3)] = block else { continue };
                for n in 0..LANES {
                    let line = |r: &[f32; 8], k: usize| (b[0][n] * r[k] + b[1][n] * r[2 + k]) + (b[2][n] * r[4 + k] + b[3][n] * r[6 + k]);
                    let sum = |k: usize| (c[0][n] * line(r0, k) + c[1][n] * line(r1, k)) + (c[2][n] * line(r2, k) + c[3][n] * line(r3, k));
                    let (x, y) = (sum(0), sum(1));
                    let is_own = cell[n] == own;
                    dx[n] = if is_own { x } else { dx[n] };
                    dy[n] = if is_own { y } else { dy[n] };
                    is_done[n] |= is_own;
                }
            }
            for n in 0..LANES {
                let (dx, dy) = (f64::from(dx[n]), f64::from(dy[n]));
                sum_x[n] += dx;
                sum_y[n] += dy;
                if is_composed {
                    x[n] += dx;
                    y[n] += dy;
                }
            }
        }
    }
}

/// Cells and shares of places; beyond the lattice the outermost cells, where nothing moves.
#[inline(always)]
fn split(p: &[f64; LANES], origin: f64, inverse: f64, last: f64) -> ([i32; LANES], [f32; LANES]) {
    let (mut cells, mut shares) = ([0; LANES], [0.0; LANES]);
    for n in 0..LANES {
        let u = ((p[n] - origin) * inverse).max(0.0).min(last);
        let shifted = u - 0.5 + WHOLE;
        cells[n] = shifted.to_bits() as i32;
        shares[n] = (u - (shifted - WHOLE)) as f32;
    }
    (cells, shares)
}

/// The four cubic B-splines at each share.
#[inline(always)]
fn basis(shares: &[f32; LANES]) -> [[f32; LANES]; 4] {
    let mut parts = [[0.0f32; LANES]; 4];
    for n in 0..LANES {
        let s = shares[n];
        let (r, s2) = (1.0 - s, s * s);
        parts[0][n] = r * r * r * (1.0 / 6.0);
        parts[1][n] = (0.5 * s - 1.0) * s2 + 2.0 / 3.0;
        parts[3][n] = s2 * s * (1.0 / 6.0);
        parts[2][n] = 1.0 - (parts[0][n] + parts[1][n] + parts[3][n]);
    }
    parts
}
