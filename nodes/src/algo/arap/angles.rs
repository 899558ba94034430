//! Rotations of triangles: followed across the mesh, past half a turn.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};

/// For each triangle those that share an edge with it.
pub(super) fn neighbours(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * triangles.len());
    for (e, &[a, b, c]) in triangles.iter().enumerate() {
        edges.extend([(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b), e as u32)));
    }
    edges.sort_unstable();
    let mut all = vec![Vec::with_capacity(3); triangles.len()];
    for pair in edges.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            all[pair[0].2 as usize].push(pair[1].2);
            all[pair[1].2 as usize].push(pair[0].2);
        }
    }
    all
}

/// A step between two triangles; the smallest is taken first.
struct Step {
    turn: f64,
    from: u32,
    to: u32,
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> Ordering {
        other.turn.total_cmp(&self.turn).then_with(|| (other.from, other.to).cmp(&(self.from, self.to)))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Step {}

/// An angle less whole turns, in (-π, π].
pub(super) fn wrapped(angle: f64) -> f64 {
    let rest = angle - TAU * libm::floor(angle / TAU + 0.5);
    if rest <= -PI { rest + TAU } else { rest }
}

/// Adds whole turns to the angles (first of each map) so that neighbours agree, the surest neighbours first; each connected part turns by
/// half a turn at the most on the whole, by area.
pub(super) fn unwrap(maps: &mut [[f64; 4]], sides: &[Vec<u32>], areas: &[f64]) {
    // Where all are within a quarter turn nothing can be more than half a turn apart.
    if maps.iter().all(|m| m[0].abs() < PI / 2.0) {
        return;
    }
    let mut done = vec![false; maps.len()];
    let mut open = BinaryHeap::new();
    for root in 0..maps.len() {
        if done[root] {
            continue;
        }
        let mut part = vec![root];
        done[root] = true;
        push_steps(&mut open, maps, sides, &done, root);
        while let Some(Step { from, to, .. }) = open.pop() {
            let to = to as usize;
            if done[to] {
                continue;
            }
            let near = maps[from as usize][0];
            maps[to][0] = near + wrapped(maps[to][0] - near);
            done[to] = true;
            part.push(to);
            push_steps(&mut open, maps, sides, &done, to);
        }
        let area: f64 = part.iter().map(|&e| areas[e]).sum();
        let mean = part.iter().map(|&e| areas[e] * maps[e][0]).sum::<f64>() / area;
        let turns = wrapped(mean) - mean;
        part.iter().for_each(|&e| maps[e][0] += turns);
    }
}

fn push_steps(open: &mut BinaryHeap<Step>, maps: &[[f64; 4]], sides: &[Vec<u32>], done: &[bool], from: usize) {
    for &to in sides[from].iter().filter(|&&to| !done[to as usize]) {
        let turn = wrapped(maps[to as usize][0] - maps[from][0]).abs();
        open.push(Step { turn, from: from as u32, to });
    }
}

/// Sine and cosine to about an ulp, for angles of a few turns: the kernels of fdlibm without its branches, so that loops are vectorised.
#[inline(always)]
pub(super) fn sin_cos(x: f64) -> (f64, f64) {
    // Half of pi in two parts: products with small whole numbers of the first are exact.
    const HIGH: f64 = 1.570_796_326_734_125_6;
    const LOW: f64 = 6.077_100_506_506_192e-11;
    /// Added and taken away, it rounds to a whole number.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted = x * std::f64::consts::FRAC_2_PI + ROUND;
    let quarter = shifted.to_bits();
    let turns = shifted - ROUND;
    let r = (x - turns * HIGH) - turns * LOW;
    let z = r * r;
    let sin = r + r * z * (S[0] + z * (S[1] + z * (S[2] + z * (S[3] + z * (S[4] + z * S[5])))));
    let cos = 1.0 - 0.5 * z + z * z * (C[0] + z * (C[1] + z * (C[2] + z * (C[3] + z * (C[4] + z * C[5])))));
    let (s, c) = if quarter & 1 == 0 { (sin, cos) } else { (cos, sin) };
    let sign = |bit: u64| f64::from_bits(1.0_f64.to_bits() | (bit << 62 & 1 << 63));
    (s * sign(quarter), c * sign(quarter + 1))
}

/// Coefficients of fdlibm's `__kernel_sin`.
const S: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_007e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// Coefficients of fdlibm's `__kernel_cos`.
const C: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];
