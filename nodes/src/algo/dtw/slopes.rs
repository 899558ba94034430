//! Patterns that limit the slope: steps of several cells, each with its weight. Sakoe and Chiba 1978, table I; names and order as in Giorgino 2009.

use super::cost::Costs;
use super::window::Window;
use super::{Alignment, Options, Steps, TILES, ending};

/// Rows that a step reaches back, at most.
const REACH: usize = 3;

/// One step: rows and columns back to where it begins, and the cells that it adds, in their order, each with rows back, columns back, and weight.
struct Step {
    rows: usize,
    columns: usize,
    cells: &'static [(usize, usize, f64)],
}

const fn step(rows: usize, columns: usize, cells: &'static [(usize, usize, f64)]) -> Step {
    Step { rows, columns, cells }
}

const THIRD: f64 = 1.0 / 3.0;
const TWO_THIRDS: f64 = 2.0 / 3.0;

const SYMMETRIC_P05: &[Step] = &[
    step(1, 3, &[(0, 2, 2.0), (0, 1, 1.0), (0, 0, 1.0)]),
    step(1, 2, &[(0, 1, 2.0), (0, 0, 1.0)]),
    step(1, 1, &[(0, 0, 2.0)]),
    step(2, 1, &[(1, 0, 2.0), (0, 0, 1.0)]),
    step(3, 1, &[(2, 0, 2.0), (1, 0, 1.0), (0, 0, 1.0)]),
];
const SYMMETRIC_P1: &[Step] =
    &[step(1, 2, &[(0, 1, 2.0), (0, 0, 1.0)]), step(1, 1, &[(0, 0, 2.0)]), step(2, 1, &[(1, 0, 2.0), (0, 0, 1.0)])];
const SYMMETRIC_P2: &[Step] = &[
    step(2, 3, &[(1, 2, 2.0), (0, 1, 2.0), (0, 0, 1.0)]),
    step(1, 1, &[(0, 0, 2.0)]),
    step(3, 2, &[(2, 1, 2.0), (1, 0, 2.0), (0, 0, 1.0)]),
];
const ASYMMETRIC_P05: &[Step] = &[
    step(1, 3, &[(0, 2, THIRD), (0, 1, THIRD), (0, 0, THIRD)]),
    step(1, 2, &[(0, 1, 0.5), (0, 0, 0.5)]),
    step(1, 1, &[(0, 0, 1.0)]),
    step(2, 1, &[(1, 0, 1.0), (0, 0, 1.0)]),
    step(3, 1, &[(2, 0, 1.0), (1, 0, 1.0), (0, 0, 1.0)]),
];
const ASYMMETRIC_P1: &[Step] =
    &[step(1, 2, &[(0, 1, 0.5), (0, 0, 0.5)]), step(1, 1, &[(0, 0, 1.0)]), step(2, 1, &[(1, 0, 1.0), (0, 0, 1.0)])];
const ASYMMETRIC_P2: &[Step] = &[
    step(2, 3, &[(1, 2, TWO_THIRDS), (0, 1, TWO_THIRDS), (0, 0, TWO_THIRDS)]),
    step(1, 1, &[(0, 0, 1.0)]),
    step(3, 2, &[(2, 1, 1.0), (1, 0, 1.0), (0, 0, 1.0)]),
];

fn pattern(steps: Steps) -> &'static [Step] {
    match steps {
        Steps::SymmetricP05 => SYMMETRIC_P05,
        Steps::SymmetricP1 => SYMMETRIC_P1,
        Steps::SymmetricP2 => SYMMETRIC_P2,
        Steps::AsymmetricP05 => ASYMMETRIC_P05,
        Steps::AsymmetricP1 => ASYMMETRIC_P1,
        Steps::AsymmetricP2 => ASYMMETRIC_P2,
        Steps::Symmetric1 | Steps::Symmetric2 | Steps::Asymmetric => &[],
    }
}

/// The last rows of sums and of distances, the newest first; shut columns before the first, so that no step needs a question.
#[derive(Clone)]
struct State {
    sums: [Vec<f64>; REACH + 1],
    costs: [Vec<f64>; REACH + 1],
}

impl State {
    fn new(width: usize) -> Self {
        let shut = || std::array::from_fn(|_| vec![f64::INFINITY; REACH + width]);
        Self { sums: shut(), costs: shut() }
    }

    /// The columns from `from`, so many of them.
    fn part(&self, from: usize, width: usize) -> Self {
        // Both begin as far before their first column.
        let part = |rows: &[Vec<f64>; REACH + 1]| std::array::from_fn(|r| rows[r][from..][..REACH + width].to_vec());
        Self { sums: part(&self.sums), costs: part(&self.costs) }
    }

    fn turn(&mut self) {
        self.sums.rotate_right(1);
        self.costs.rotate_right(1);
        self.sums[0].fill(f64::INFINITY);
        self.costs[0].fill(f64::INFINITY);
    }
}

struct Rows<'a> {
    costs: &'a Costs,
    window: &'a Window,
    open_begin: bool,
    pattern: &'static [Step],
    /// Room for the sums of one step.
    candidate: Vec<f64>,
}

impl Rows<'_> {
    /// Row `i` in columns `from..to` after those before it.
    fn next(&mut self, i: usize, from: usize, to: usize, state: &mut State, mut taken: Option<&mut [u8]>) {
        state.turn();
        let [low, high] = self.window.rows[i];
        let (low, high) = (low.max(from), (high + 1).min(to));
        if low >= high {
            return;
        }
        self.costs.row(i, low, &mut state.costs[0][REACH + low - from..][..high - low]);
        if i == 0 {
            let last = if self.open_begin { high } else { high.min(1) };
            let [sums, ..] = &mut state.sums;
            (low..last).for_each(|j| sums[REACH + j - from] = state.costs[0][REACH + j - from]);
            return;
        }
        let (sums, before) = state.sums.split_at_mut(1);
        let (first, n) = (REACH + low - from, high - low);
        let least = &mut sums[0][first..][..n];
        let mut taken = taken.as_mut().map(|t| &mut t[low - from..][..n]);
        let candidate = &mut self.candidate[..n];
        for (s, step) in self.pattern.iter().enumerate() {
            candidate.copy_from_slice(&before[step.rows - 1][first - step.columns..][..n]);
            for &(row, column, weight) in step.cells {
                let costs = &state.costs[row][first - column..][..n];
                candidate.iter_mut().zip(costs).for_each(|(sum, c)| *sum += weight * c);
            }
            match &mut taken {
                Some(taken) => {
                    for ((least, taken), sum) in least.iter_mut().zip(taken.iter_mut()).zip(&*candidate).filter(|((l, _), s)| **s < **l) {
                        (*least, *taken) = (*sum, s as u8);
                    }
                }
                None => least.iter_mut().zip(&*candidate).for_each(|(least, sum)| *least = if *sum < *least { *sum } else { *least }),
            }
        }
    }
}

pub(super) fn align(costs: &Costs, window: &Window, options: &Options) -> Option<Alignment> {
    let (n, m) = (costs.n, costs.m);
    let stride = n.div_ceil(TILES).max(32);
    let pattern = pattern(options.steps);
    let mut rows = Rows { costs, window, open_begin: options.open_begin, pattern, candidate: vec![0.0; m] };
    let mut state = State::new(m);
    let mut kept: Vec<State> = Vec::new();
    for i in 0..n {
        rows.next(i, 0, m, &mut state, None);
        if (i + 1) % stride == 0 {
            kept.push(state.clone());
        }
    }
    let last = &state.sums[0][REACH..];
    let end = ending(last, n, options)?;
    Some(Alignment { cost: last[end], path: back(&mut rows, &kept, stride, end) })
}

/// The path, from its last column back: rows between two that were kept are made again, in the columns from which the path can come.
fn back(rows: &mut Rows, kept: &[State], stride: usize, end: usize) -> Vec<[usize; 2]> {
    let (mut i, mut j) = (rows.costs.n - 1, end);
    let mut path = Vec::with_capacity(rows.costs.n + rows.costs.m);
    loop {
        let first = i / stride * stride;
        // No step has more than three columns a row.
        let from = j.saturating_sub(REACH * (i - first + 1));
        let width = j + 1 - from;
        let mut taken = vec![0_u8; width * (i + 1 - first)];
        let mut state = match first.checked_sub(1).and_then(|row| kept.get(row / stride)) {
            Some(whole) => whole.part(from, width),
            None => State::new(width),
        };
        for (row, taken) in (first..=i).zip(taken.chunks_exact_mut(width)) {
            rows.next(row, from, j + 1, &mut state, Some(taken));
        }
        loop {
            if i == 0 {
                path.push([0, j]);
                path.reverse();
                return path;
            }
            let step = &rows.pattern[usize::from(taken[(i - first) * width + j - from])];
            path.extend(step.cells.iter().rev().map(|(r, c, _)| [i - r, j - c]));
            (i, j) = (i - step.rows, j - step.columns);
            if i < first {
                break;
            }
        }
    }
}
