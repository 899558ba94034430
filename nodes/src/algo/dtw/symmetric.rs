//! One row, one column, or both.
//!
//! A number hangs on the one to its left and the one above, so that neither rows nor columns can be worked on at once. A band of rows is therefore cut into
//! strips, one for each lane, and each lane runs one column behind the lane above it: what it reads of that lane was made a step before.

use super::cost::{Costs, Metric, term};
use super::window::Window;
use super::{Alignment, Options, TILES, ending};

/// Strips side by side.
const LANES: usize = 8;
/// Rows of a strip.
const DEPTH: usize = 16;
/// Rows of a band.
const BAND: usize = LANES * DEPTH;

type Lanes = [f64; LANES];
const SHUT: Lanes = [f64::INFINITY; LANES];

/// Sums at the edges of tiles.
struct Edges {
    /// Rows and columns of a tile.
    tile: [usize; 2],
    /// The last row of each row of tiles.
    rows: Vec<Vec<f64>>,
    /// The last column of each column of tiles.
    columns: Vec<Vec<f64>>,
}

/// What stands before the first row: in its columns, and before the first column.
struct Above {
    row: Vec<f64>,
    corner: f64,
}

impl Above {
    fn new<const TWICE: bool>(costs: &Costs, open_begin: bool) -> Self {
        if open_begin {
            return Self { row: vec![0.0; costs.m], corner: 0.0 };
        }
        let mut first = [0.0];
        costs.row(0, 0, &mut first);
        // The first cell counts once although the step to it would count twice; both the double and the difference are exact.
        Self { row: vec![f64::INFINITY; costs.m], corner: if TWICE && first[0].is_finite() { -first[0] } else { 0.0 } }
    }
}

pub(super) fn align<const TWICE: bool>(costs: &Costs, window: &Window, options: &Options) -> Option<Alignment> {
    let (n, m) = (costs.n, costs.m);
    let above = Above::new::<TWICE>(costs, options.open_begin);
    let tile = [n.div_ceil(TILES).next_multiple_of(BAND), m.div_ceil(TILES).max(BAND)];
    let mut edges = Edges { tile, rows: Vec::new(), columns: vec![vec![f64::INFINITY; n]; m / tile[1]] };
    let last = match (costs.metric, costs.k) {
        _ if window.narrow || costs.weights.is_some() => by_rows::<TWICE>(costs, window, &above, &mut edges),
        (Metric::Angle, 8) => by_lanes::<TWICE, true, 8>(costs, &above, &mut edges),
        (Metric::Angle, _) => by_lanes::<TWICE, true, 0>(costs, &above, &mut edges),
        (Metric::Euclidean, _) => by_lanes::<TWICE, false, 0>(costs, &above, &mut edges),
    };
    let end = ending(&last, n, options)?;
    Some(Alignment { cost: last[end], path: back::<TWICE>(costs, window, &above, &edges, end) })
}

/// The last row of sums, a row at a time.
fn by_rows<const TWICE: bool>(costs: &Costs, window: &Window, above: &Above, edges: &mut Edges) -> Vec<f64> {
    let (n, m) = (costs.n, costs.m);
    let mut before: Vec<f64> = std::iter::once(above.corner).chain(above.row.iter().copied()).collect();
    let (mut sums, mut c) = (vec![f64::INFINITY; m + 1], vec![0.0; m]);
    for i in 0..n {
        let [low, high] = window.rows[i];
        sums.fill(f64::INFINITY);
        if low <= high {
            costs.row(i, low, &mut c[low..=high]);
            row::<TWICE>(&c[low..=high], &before[low..=high + 1], &mut sums[low..=high + 1], None);
        }
        for (t, column) in edges.columns.iter_mut().enumerate() {
            column[i] = sums[(t + 1) * edges.tile[1]];
        }
        if (i + 1) % edges.tile[0] == 0 {
            edges.rows.push(sums[1..].to_vec());
        }
        std::mem::swap(&mut before, &mut sums);
    }
    before.split_off(1)
}

/// A row of sums after the row before. Both have one number more than there are distances: that of the column before, which in `sums` stands there already.
fn row<const TWICE: bool>(c: &[f64], before: &[f64], sums: &mut [f64], mut steps: Option<&mut [u8]>) {
    let mut left = sums[0];
    for (j, &c) in c.iter().enumerate() {
        let both = before[j] + if TWICE { 2.0 * c } else { c };
        let (mut least, mut step) = (both, 0);
        for (sum, s) in [(left + c, 1), (before[j + 1] + c, 2)] {
            if sum < least {
                (least, step) = (sum, s);
            }
        }
        left = least;
        sums[j + 1] = least;
        if let Some(steps) = &mut steps {
            steps[j] = step;
        }
    }
}

/// The last row of sums, many rows at a time.
fn by_lanes<const TWICE: bool, const ANGLE: bool, const K: usize>(costs: &Costs, above: &Above, edges: &mut Edges) -> Vec<f64> {
    let (n, m, k) = (costs.n, costs.m, costs.k);
    let reversed = reversed(&costs.b, m);
    let (mut top, mut corner, mut out) = (above.row.clone(), above.corner, vec![0.0; m]);
    for first in (0..n).step_by(BAND) {
        // Rows after the last are its like; nobody reads them.
        let lanes = |h: usize, d: usize| std::array::from_fn(|l| costs.a[(first + l * DEPTH + h).min(n - 1) * k + d]);
        let a: Vec<Lanes> = (0..DEPTH).flat_map(|h| (0..k).map(move |d| (h, d))).map(|(h, d)| lanes(h, d)).collect();
        let strips = Strips { a: &a, b: &reversed, top: &top, corner, first, last: (first + BAND).min(n) - 1, tile: edges.tile[1] };
        sweep::<TWICE, ANGLE, K>(&strips, &mut out, &mut edges.columns);
        if (first + BAND).is_multiple_of(edges.tile[0]) {
            edges.rows.push(out.clone());
        }
        std::mem::swap(&mut top, &mut out);
        corner = f64::INFINITY;
    }
    top
}

/// Each dimension from the last column to the first, with room for lanes that have not begun or are done: lanes then read neighbours.
fn reversed(b: &[f64], m: usize) -> Vec<f64> {
    let mut all = Vec::with_capacity(b.len() / m * (m + 2 * (LANES - 1)));
    for dimension in b.chunks_exact(m) {
        all.extend([0.0; LANES - 1]);
        all.extend(dimension.iter().rev());
        all.extend([0.0; LANES - 1]);
    }
    all
}

/// A band of rows, cut into strips: lane `l` has the rows from `first + l DEPTH` on.
struct Strips<'a> {
    /// Target numbers: row of the strip by dimension.
    a: &'a [Lanes],
    b: &'a [f64],
    top: &'a [f64],
    corner: f64,
    first: usize,
    last: usize,
    tile: usize,
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn sweep<const TWICE: bool, const ANGLE: bool, const K: usize>(strips: &Strips, out: &mut [f64], columns: &mut [Vec<f64>]) {
    let Strips { a, b, top, corner, first, last, tile } = *strips;
    let m = out.len();
    let k = if K == 0 { a.len() / DEPTH } else { K };
    let padded = m + 2 * (LANES - 1);
    let (last_lane, last_depth) = ((last - first) / DEPTH, (last - first) % DEPTH);
    let mut now = vec![SHUT; k];
    let mut sums = [SHUT; DEPTH];
    let mut above = SHUT;
    above[0] = corner;
    for s in 0..m + LANES - 1 {
        for (d, b) in b.chunks_exact(padded).enumerate() {
            now[d].copy_from_slice(&b[m + LANES - 2 - s..][..LANES]);
        }
        // What was above a column is aslant of the next.
        let mut aslant = above;
        above[0] = top.get(s).copied().unwrap_or(f64::INFINITY);
        above[1..].copy_from_slice(&sums[DEPTH - 1][..LANES - 1]);
        // Lanes that have not begun, or are done.
        let mut shut = [0.0; LANES];
        if s < LANES - 1 || s >= m {
            (0..LANES).filter(|l| *l > s || s - l >= m).for_each(|l| shut[l] = f64::INFINITY);
        }
        let mut up = above;
        for (h, left) in sums.iter_mut().enumerate() {
            let mut c = [0.0; LANES];
            for (a, b) in a[h * k..][..k].iter().zip(&now[..k]) {
                for l in 0..LANES {
                    c[l] += term::<ANGLE>(a[l], b[l]);
                }
            }
            let mut sum = SHUT;
            for l in 0..LANES {
                let c = if ANGLE { c[l] } else { c[l].sqrt() } + shut[l];
                let both = aslant[l] + if TWICE { 2.0 * c } else { c };
                let along = left[l] + c;
                let least = if along < both { along } else { both };
                let waits = up[l] + c;
                sum[l] = if waits < least { waits } else { least };
            }
            (aslant, up, *left) = (*left, sum, sum);
        }
        if let Some(column) = s.checked_sub(last_lane).filter(|j| *j < m) {
            out[column] = sums[last_depth][last_lane];
        }
        let lane = (s + 1) % tile;
        if lane < LANES
            && s + 1 > lane
            && let Some(column) = columns.get_mut((s + 1 - lane) / tile - 1)
        {
            let rows = column.iter_mut().skip(first + lane * DEPTH).take(DEPTH);
            rows.zip(&sums).for_each(|(x, sum)| *x = sum[lane]);
        }
    }
}

/// The path, from its last column back: each tile that it crosses is made again, now with its steps.
fn back<const TWICE: bool>(costs: &Costs, window: &Window, above: &Above, edges: &Edges, end: usize) -> Vec<[usize; 2]> {
    let (mut i, mut j) = (costs.n - 1, end);
    let mut path = Vec::with_capacity(costs.n + costs.m);
    let (mut steps, mut c) = (Vec::new(), vec![0.0; edges.tile[1]]);
    loop {
        let [top, first] = [i / edges.tile[0] * edges.tile[0], j / edges.tile[1] * edges.tile[1]];
        let width = j + 1 - first;
        let mut before = edges.before(above, top, first, j);
        let mut sums = before.clone();
        steps.clear();
        steps.resize(width * (i + 1 - top), 0_u8);
        for (r, steps) in (top..=i).zip(steps.chunks_exact_mut(width)) {
            let c = &mut c[..width];
            costs.row(r, first, c);
            let [low, high] = window.rows[r];
            c.iter_mut().enumerate().filter(|(x, _)| !(low..=high).contains(&(first + x))).for_each(|(_, c)| *c = f64::INFINITY);
            sums[0] = edges.left(r, first);
            row::<TWICE>(c, &before, &mut sums, Some(steps));
            std::mem::swap(&mut before, &mut sums);
        }
        loop {
            path.push([i, j]);
            let step = steps[(i - top) * width + j - first];
            let (up, left) = (step != 1, step != 2);
            if up && i == 0 || left && j == 0 {
                path.reverse();
                return path;
            }
            (i, j) = (i - usize::from(up), j - usize::from(left));
            if i < top || j < first {
                break;
            }
        }
    }
}

impl Edges {
    /// The row of sums before row `top`, from the column before `first` to column `last`.
    fn before(&self, above: &Above, top: usize, first: usize, last: usize) -> Vec<f64> {
        let (row, corner) = match top.checked_sub(1) {
            None => (&above.row, above.corner),
            Some(r) => (&self.rows[r / self.tile[0]], f64::INFINITY),
        };
        let corner = if first == 0 { corner } else { row[first - 1] };
        std::iter::once(corner).chain(row[first..=last].iter().copied()).collect()
    }

    /// The sum in row `r` in the column before `first`.
    fn left(&self, r: usize, first: usize) -> f64 {
        first.checked_sub(1).map_or(f64::INFINITY, |j| self.columns[j / self.tile[1]][r])
    }
}
