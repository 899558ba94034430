//! One row and none, one or two columns.

use super::cost::Costs;
use super::window::Window;
use super::{Alignment, Options, TILES, ending};

/// Shut columns before the first, so that steps of two need no question.
const PAD: usize = 2;

/// One row of sums after another, distances in `c`.
struct Rows<'a> {
    costs: &'a Costs,
    window: &'a Window,
    open_begin: bool,
    c: Vec<f64>,
}

impl Rows<'_> {
    /// The sums of row `i` in columns `from..to`, after those of the row before; both begin `PAD` before `from`.
    fn next(&mut self, i: usize, from: usize, to: usize, before: &[f64], sums: &mut [f64], mut steps: Option<&mut [u8]>) {
        sums.fill(f64::INFINITY);
        let [low, high] = self.window.rows[i];
        let (low, high) = (low.max(from), (high + 1).min(to));
        if low >= high {
            return;
        }
        let c = &mut self.c[..high - low];
        self.costs.row(i, low, c);
        if i == 0 {
            let last = if self.open_begin { high } else { high.min(1) };
            (low..last).for_each(|j| sums[PAD + j - from] = c[j - low]);
            return;
        }
        let before = &before[low - from..][..high - low + PAD];
        let sums = &mut sums[PAD + low - from..][..high - low];
        if let Some(steps) = &mut steps {
            let steps = &mut steps[low - from..][..high - low];
            for j in 0..sums.len() {
                let (mut least, mut step) = (before[j + 2], 0);
                for (of, s) in [(before[j + 1], 1), (before[j], 2)] {
                    if of < least {
                        (least, step) = (of, s);
                    }
                }
                (sums[j], steps[j]) = (least + c[j], step);
            }
        } else {
            add(before, c, sums);
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add(before: &[f64], c: &[f64], sums: &mut [f64]) {
    let n = sums.len();
    let (two, one, none) = (&before[..n], &before[1..][..n], &before[2..][..n]);
    for j in 0..n {
        let least = if one[j] < none[j] { one[j] } else { none[j] };
        let least = if two[j] < least { two[j] } else { least };
        sums[j] = least + c[j];
    }
}

pub(super) fn align(costs: &Costs, window: &Window, options: &Options) -> Option<Alignment> {
    let (n, m) = (costs.n, costs.m);
    let stride = n.div_ceil(TILES).max(32);
    let mut rows = Rows { costs, window, open_begin: options.open_begin, c: vec![0.0; m] };
    let (mut before, mut sums) = (vec![f64::INFINITY; m + PAD], vec![f64::INFINITY; m + PAD]);
    let mut kept: Vec<Vec<f64>> = Vec::new();
    for i in 0..n {
        rows.next(i, 0, m, &before, &mut sums, None);
        if (i + 1) % stride == 0 {
            kept.push(sums.clone());
        }
        std::mem::swap(&mut before, &mut sums);
    }
    let end = ending(&before[PAD..], n, options)?;
    let cost = before[PAD + end];
    Some(Alignment { cost, path: back(&mut rows, &kept, stride, end) })
}

/// The path, from its last column back: rows between two that were kept are made again, in the columns from which the path can come.
fn back(rows: &mut Rows, kept: &[Vec<f64>], stride: usize, end: usize) -> Vec<[usize; 2]> {
    let n = rows.costs.n;
    let (mut i, mut j) = (n - 1, end);
    let mut path = Vec::with_capacity(n);
    loop {
        let first = i / stride * stride;
        let from = j.saturating_sub(2 * (i - first + 1));
        let (width, height) = (j + 1 - from, i + 1 - first);
        let mut steps = vec![0_u8; width * height];
        let mut before = vec![f64::INFINITY; width + PAD];
        if let Some(row) = first.checked_sub(1).and_then(|r| kept.get(r / stride)) {
            // Both begin as far before their first column.
            before.copy_from_slice(&row[from..][..width + PAD]);
        }
        let mut sums = before.clone();
        for (row, steps) in (first..=i).zip(steps.chunks_exact_mut(width)) {
            rows.next(row, from, j + 1, &before, &mut sums, Some(steps));
            std::mem::swap(&mut before, &mut sums);
        }
        for row in (first..=i).rev() {
            path.push([row, j]);
            if row > 0 {
                j -= usize::from(steps[(row - first) * width + j - from]);
            }
        }
        if first == 0 {
            path.reverse();
            return path;
        }
        i = first - 1;
    }
}
