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
        let start_y = at_y.first().copied().unwrap_or(0.0);
        let at_y_is_straight = at_y.iter().all(|y| *y == start_y);
        let chunks = at_x.as_chunks_mut::<LANES>().0.iter_mut().zip(at_y.as_chunks_mut::<LANES>().0);
        let sums = by_x.as_chunks_mut::<LANES>().0.iter_mut().zip(by_y.as_chunks_mut::<LANES>().0);
        // A row that is still straight has one line of control points, blended once.
        let row = at_y_is_straight.then(|| straight(&rows, level, start_y));
        for ((x, y), (sum_x, sum_y)) in chunks.zip(sums) {
            let (i, s) = split(x, level.origin[0], level.inverse[0], last[0]);
            let b = basis(&s);
            let (dx, dy) = match &row {
                Some(row) => cells(&i, |own| Some(line(&b, row.get(2 * own as usize..)?.first_chunk::<8>()?))),
                None => {
                    let (j, t) = split(y, level.origin[1], level.inverse[1], last[1]);
                    let c = basis(&t);
                    let cell: [i32; LANES] = std::array::from_fn(|n| j[n] * width + i[n]);
                    cells(&cell, |own| {
                        let block = rows.map(|row| row.get(2 * own as usize..).and_then(|r| r.first_chunk::<8>()));
                        let [Some(r0), Some(r1), Some(r2), Some(r3)] = block else { return None };
                        Some(spline(&b, &c, &[*r0, *r1, *r2, *r3]))
                    })
                }
            };
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

/// What lanes find in their cells. Neighbours lie in one, or in a few: each is evaluated for all lanes and taken by those that lie in it.
#[inline(always)]
fn cells(cell: &[i32; LANES], mut of: impl FnMut(i32) -> Option<([f32; LANES], [f32; LANES])>) -> ([f32; LANES], [f32; LANES]) {
    if cell.iter().fold(0, |all, c| all | (c ^ cell[0])) == 0 {
        return of(cell[0]).unwrap_or(([0.0; LANES], [0.0; LANES]));
    }
    let (mut dx, mut dy) = ([0.0f32; LANES], [0.0f32; LANES]);
    let mut is_done = [false; LANES];
    for first in 0..LANES {
        if is_done[first] {
            continue;
        }
        let Some((x, y)) = of(cell[first]) else { continue };
        for n in 0..LANES {
            let is_own = cell[n] == cell[first];
            dx[n] = if is_own { x[n] } else { dx[n] };
            dy[n] = if is_own { y[n] } else { dy[n] };
            is_done[n] |= is_own;
        }
    }
    (dx, dy)
}

/// The line of control points of a straight row of samples, x and y by turns.
#[inline(always)]
fn straight(rows: &[&[f32]; 4], level: &Open, y: f64) -> Vec<f32> {
    let (j, t) = split(&[y; LANES], level.origin[1], level.inverse[1], (level.size[1] - 4) as f64);
    let c = basis(&t).map(|c| c[0]);
    let from = 2 * j[0] as usize * level.size[0];
    let [r0, r1, r2, r3] = rows.map(|r| r.get(from..from + 2 * level.size[0]).unwrap_or_default());
    let pairs = r0.iter().zip(r1).zip(r2.iter().zip(r3));
    pairs.map(|((a, b), (d, e))| (c[0] * a + c[1] * b) + (c[2] * d + c[3] * e)).collect()
}

/// The moves of a cell of a line at all lanes.
#[inline(always)]
fn line(b: &[[f32; LANES]; 4], r: &[f32; 8]) -> ([f32; LANES], [f32; LANES]) {
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    let r = *r;
    for n in 0..LANES {
        x[n] = (b[0][n] * r[0] + b[1][n] * r[2]) + (b[2][n] * r[4] + b[3][n] * r[6]);
        y[n] = (b[0][n] * r[1] + b[1][n] * r[3]) + (b[2][n] * r[5] + b[3][n] * r[7]);
    }
    (x, y)
}

/// The moves of one cell at all lanes: rows of its control points, x and y by turns.
#[inline(always)]
fn spline(b: &[[f32; LANES]; 4], c: &[[f32; LANES]; 4], rows: &[[f32; 8]; 4]) -> ([f32; LANES], [f32; LANES]) {
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    let [r0, r1, r2, r3] = rows;
    for n in 0..LANES {
        let line = |r: &[f32; 8], k: usize| (b[0][n] * r[k] + b[1][n] * r[2 + k]) + (b[2][n] * r[4 + k] + b[3][n] * r[6 + k]);
        let sum = |k: usize| (c[0][n] * line(r0, k) + c[1][n] * line(r1, k)) + (c[2][n] * line(r2, k) + c[3][n] * line(r3, k));
        x[n] = sum(0);
        y[n] = sum(1);
    }
    (x, y)
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
