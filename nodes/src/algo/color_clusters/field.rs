//! Spatial regularisation: mean-field inference in a contrast-sensitive Ising field on the eight-neighbour grid.
//!
//! **Source** Pairwise term: Y. Boykov, M.-P. Jolly, *Interactive graph cuts*, 2001, with the contrast scale of C. Rother and others, *GrabCut*, 2004, eq. 5. Inference: mean
//! field, all pixels at once. Unlike a cut it keeps a probability, and it has no seed and no order, so that any split of the work gives the same bits.

use super::kernel::{Planes, exp2_f32, sigmoid_f32};

/// Rounds of the mean field: a disturbance is felt as many pixels away.
const ROUNDS: usize = 6;

/// Pixels of a row that are worked on or left alone together.
const SEGMENT: usize = 32;
/// Log odds beyond which a pixel among its like is not asked again.
const SURE: f32 = 4.0;

/// A plane with a border of one sample, in which pixel (x, y) is at (y + 1) · stride + x + 1.
struct Padded {
    width: usize,
    height: usize,
    stride: usize,
}

impl Padded {
    fn start(&self, y: usize) -> usize {
        (y + 1) * self.stride + 1
    }
    fn zeros(&self) -> Vec<f32> {
        vec![0.0; self.stride * (self.height + 2)]
    }
}

/// Half the inverse of the mean squared difference of neighbours, the contrast scale; the grain below `floor_sq` never counts as contrast.
fn contrast_scale(p: &Planes, width: usize, height: usize, floor_sq: f64) -> f32 {
    let (mut sum, mut n) = (0.0f64, 0.0f64);
    for y in (0..height).step_by(1 + height / 256) {
        let row = y * width;
        for i in (row + 1)..(row + width) {
            let (a, b, c) = (p.x[i] - p.x[i - 1], p.y[i] - p.y[i - 1], p.z[i] - p.z[i - 1]);
            sum += f64::from(a * a + b * b + c * c);
            n += 1.0;
        }
    }
    (0.5 / (sum / n.max(1.0)).max(floor_sq)) as f32
}

/// Replaces log odds by probabilities that agree with their neighbours, in place. `strength` is the log odds that one neighbour of the same colour is worth.
///
/// Only segments of rows with a doubt or a border in or beside them are worked on; elsewhere all pixels are of one mind already. O(pixels).
pub(super) fn smooth(log_odds: &mut [f32], planes: &Planes, width: usize, height: usize, strength: f64, floor_sq: f64) {
    let grid = Padded { width, height, stride: width + 2 };
    let scale = contrast_scale(planes, width, height, floor_sq);
    let active = active_segments(log_odds, width);
    // The links of a pixel to the left and above belong to the segments there.
    let linked = grow(&active, width.div_ceil(SEGMENT), 1);
    let links = links(planes, &grid, &linked, scale, strength as f32);
    let mut now = grid.zeros();
    for y in 0..height {
        let s = grid.start(y);
        spins(&log_odds[y * width..(y + 1) * width], &mut now[s..s + width]);
    }
    let mut next = now.clone();
    for _ in 0..ROUNDS {
        for (y, from, to) in spans(&active, width) {
            let s = grid.start(y) + from;
            round(&log_odds[y * width + from..y * width + to], &now, &links, &grid, s, &mut next[s..s + to - from]);
        }
        std::mem::swap(&mut now, &mut next);
    }
    for y in 0..height {
        let s = grid.start(y);
        for (o, m) in log_odds[y * width..(y + 1) * width].iter_mut().zip(&now[s..s + width]) {
            *o = 0.5 + 0.5 * m;
        }
    }
}

/// Whether each segment of each row holds a doubtful pixel, or lies beside one of another mind.
fn active_segments(log_odds: &[f32], width: usize) -> Vec<bool> {
    let across = width.div_ceil(SEGMENT);
    let minds: Vec<i8> = log_odds.chunks(width).flat_map(|row| row.chunks(SEGMENT).map(mind)).collect();
    let disputed = |i: usize| {
        let other = |j: Option<usize>| j.and_then(|j| minds.get(j)).is_some_and(|m| *m != minds[i]);
        minds[i] == 0 || other(i.checked_sub(1)) || other(Some(i + 1)) || other(i.checked_sub(across)) || other(Some(i + across))
    };
    let disputed: Vec<bool> = (0..minds.len()).map(disputed).collect();
    grow(&disputed, across, 2)
}

/// 1 or −1 for a segment that is surely layer or ground, 0 for a mixed or doubtful one.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn mind(segment: &[f32]) -> i8 {
    let (mut layer, mut ground) = (true, true);
    for &u in segment {
        layer &= u > SURE;
        ground &= u < -SURE;
    }
    i8::from(layer) - i8::from(ground)
}

/// Segments within one column of a marked one, and within so many rows.
fn grow(marked: &[bool], across: usize, rows: usize) -> Vec<bool> {
    let wide = |i: usize| {
        let x = i % across;
        marked[i] || (x > 0 && marked[i - 1]) || (x + 1 < across && marked[i + 1])
    };
    let wide: Vec<bool> = (0..marked.len()).map(wide).collect();
    let tall = |i: usize| {
        let (x, y) = (i % across, i / across);
        (y.saturating_sub(rows)..(y + rows + 1).min(marked.len() / across)).any(|v| wide[v * across + x])
    };
    (0..marked.len()).map(tall).collect()
}

/// Row, first and past-last column of each run of marked segments.
fn spans(marked: &[bool], width: usize) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let across = width.div_ceil(SEGMENT);
    marked
        .chunks(across.max(1))
        .enumerate()
        .flat_map(move |(y, row)| {
            row.chunk_by(|a, b| a == b).scan(0, move |at, run| {
                let from = *at;
                *at += run.len();
                Some((run[0], y, from * SEGMENT, (*at * SEGMENT).min(width)))
            })
        })
        .filter_map(|(marked, y, from, to)| marked.then_some((y, from, to)))
}

/// The weight of the link from each pixel to its right, lower left, lower and lower right neighbour; nil across the border and where no pixel needs it.
fn links(p: &Planes, grid: &Padded, needed: &[bool], scale: f32, strength: f32) -> [Vec<f32>; 4] {
    let mut out = [grid.zeros(), grid.zeros(), grid.zeros(), grid.zeros()];
    let w = grid.width;
    for (link, (dx, dy)) in out.iter_mut().zip([(1isize, 0usize), (-1, 1), (0, 1), (1, 1)]) {
        // A diagonal neighbour is √2 further away.
        let weight = if dx != 0 && dy != 0 { strength * std::f32::consts::FRAC_1_SQRT_2 } else { strength };
        let (first, last) = (usize::from(dx < 0), w - usize::from(dx > 0));
        for (y, from, to) in spans(needed, w).filter(|(y, ..)| y + dy < grid.height) {
            let (from, to) = (from.max(first), to.min(last).max(from.max(first)));
            let (a, b, n) = (y * w + from, (y * w + from + dy * w).wrapping_add_signed(dx), to - from);
            if n == 0 {
                continue;
            }
            let s = grid.start(y) + from;
            link_row(
                [&p.x[a..a + n], &p.y[a..a + n], &p.z[a..a + n]],
                [&p.x[b..b + n], &p.y[b..b + n], &p.z[b..b + n]],
                scale * std::f32::consts::LOG2_E,
                weight,
                &mut link[s..s + n],
            );
        }
    }
    out
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn link_row(a: [&[f32]; 3], b: [&[f32]; 3], scale: f32, weight: f32, out: &mut [f32]) {
    let n = out.len();
    let ([ax, ay, az], [bx, by, bz]) = (a.map(|v| &v[..n]), b.map(|v| &v[..n]));
    for i in 0..n {
        let d = [ax[i] - bx[i], ay[i] - by[i], az[i] - bz[i]];
        out[i] = weight * exp2_f32(-scale * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]));
    }
}

/// Expected spins, −1 to 1, of pixels by themselves.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn spins(log_odds: &[f32], out: &mut [f32]) {
    for (o, &u) in out.iter_mut().zip(log_odds) {
        *o = 2.0 * sigmoid_f32(u) - 1.0;
    }
}

/// One round for one row, which starts at `s` in the padded planes.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn round(log_odds: &[f32], now: &[f32], links: &[Vec<f32>; 4], grid: &Padded, s: usize, out: &mut [f32]) {
    let n = out.len().min(log_odds.len());
    let t = grid.stride;
    let (up, down) = (s - t, s + t);
    let [right, lower_left, lower, lower_right] = links;
    let (l0, l1) = (&right[s..s + n], &right[s - 1..s - 1 + n]);
    let (l2, l3) = (&lower_left[s..s + n], &lower_left[up + 1..up + 1 + n]);
    let (l4, l5) = (&lower[s..s + n], &lower[up..up + n]);
    let (l6, l7) = (&lower_right[s..s + n], &lower_right[up - 1..up - 1 + n]);
    let (m0, m1) = (&now[s + 1..s + 1 + n], &now[s - 1..s - 1 + n]);
    let (m2, m3) = (&now[down - 1..down - 1 + n], &now[up + 1..up + 1 + n]);
    let (m4, m5) = (&now[down..down + n], &now[up..up + n]);
    let (m6, m7) = (&now[down + 1..down + 1 + n], &now[up - 1..up - 1 + n]);
    let (u, out) = (&log_odds[..n], &mut out[..n]);
    for i in 0..n {
        let straight = (l0[i] * m0[i] + l1[i] * m1[i]) + (l4[i] * m4[i] + l5[i] * m5[i]);
        let diagonal = (l2[i] * m2[i] + l3[i] * m3[i]) + (l6[i] * m6[i] + l7[i] * m7[i]);
        out[i] = 2.0 * sigmoid_f32(u[i] + (straight + diagonal)) - 1.0;
    }
}
