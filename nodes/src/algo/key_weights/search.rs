//! The choice of keys: every set of J, by elimination and bounds.

use super::Problem;
use super::boxed::Boxed;

/// What a search found, beside the set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// No other set costs less than this.
    pub(super) runner_up: f64,
    /// Sets solved with their bounds.
    pub(super) solved: usize,
    /// Whether all sets were looked at or ruled out.
    pub(super) finished: bool,
}

/// Most partial sets that are looked at for one problem: some tens of seconds. Beyond it the certificate says by how much the answer may be
/// off.
const MOST: usize = 1 << 28;

/// The keys that are left once some are chosen and eliminated.
///
/// With the chosen ones free (no bounds but the sum), adding key a lowers the cost by `r[a]² / d[a]`: `d` is what of the key the chosen
/// ones cannot make, squared, and `r` how much of that the shape holds.
#[derive(Clone, Debug, Default)]
struct Level {
    /// Schur complement, rows of all keys in order; the upper triangle beyond the last chosen is in use.
    h: Vec<f64>,
    /// Right-hand side.
    r: Vec<f64>,
    /// Least cost with the chosen ones.
    cost: f64,
}

/// The search and its memory. Positions are in the order that it is given, not the keys' own.
#[derive(Clone, Debug)]
pub(super) struct Search {
    n: usize,
    keys: usize,
    levels: Vec<Level>,
    /// Below this a pivot is rounding, for each position.
    least: Vec<f64>,
    factor: Vec<f64>,
    chosen: Vec<usize>,
    set: Vec<usize>,
    weights: Vec<f64>,
    best: Vec<usize>,
    best_cost: f64,
    runner_up: f64,
    solved: usize,
    looked: usize,
}

impl Search {
    pub(super) fn new(n: usize, keys: usize) -> Self {
        let depth = if keys == n { 0 } else { keys.saturating_sub(1).max(1) };
        let level = Level { h: vec![0.0; n * n], r: vec![0.0; n], cost: 0.0 };
        Self {
            n,
            keys,
            levels: vec![level; depth],
            least: vec![0.0; n],
            factor: vec![0.0; if depth == 0 { 0 } else { n * n }],
            chosen: vec![0; keys],
            set: vec![0; keys],
            weights: vec![0.0; keys],
            best: Vec::with_capacity(keys),
            best_cost: f64::INFINITY,
            runner_up: f64::INFINITY,
            solved: 0,
            looked: 0,
        }
    }

    /// The set that was found, in the keys' own numbers.
    pub(super) fn best(&self) -> &[usize] {
        &self.best
    }

    /// Looks at all sets of as many keys as were asked for.
    pub(super) fn run(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed) -> Found {
        (self.best_cost, self.runner_up, self.solved, self.looked) = (f64::INFINITY, f64::INFINITY, 0, 0);
        self.best.clear();
        for first in 0..=self.n - self.keys {
            self.chosen[0] = first;
            if self.keys == 1 {
                self.leaf(problem, order, boxed);
                continue;
            }
            self.eliminate_sum(problem, order, first);
            if first == 0 {
                self.greedy(problem, order, boxed);
            }
            self.descend(problem, order, boxed, 0, first);
        }
        Found { runner_up: self.runner_up, solved: self.solved, finished: self.looked < MOST }
    }

    /// The first chosen key takes what the others leave of the sum: all others count as their difference from it.
    fn eliminate_sum(&mut self, problem: &Problem, order: &[usize], first: usize) {
        let (n, o) = (self.n, order[first]);
        let level = &mut self.levels[0];
        let g = |a: usize, b: usize| problem.gram[a * n + b];
        for a in first + 1..n {
            let i = order[a];
            for b in a..n {
                let j = order[b];
                level.h[a * n + b] = (g(i, j) - g(i, o)) + (g(o, o) - g(o, j));
            }
            level.r[a] = (problem.linear[i] - problem.linear[o]) + (g(o, o) - g(o, i));
            self.least[a] = 1e-13 * level.h[a * n + a].max(1e-3 * (g(o, o) + g(i, i)) * f64::EPSILON.sqrt());
        }
        level.cost = g(o, o) - 2.0 * problem.linear[o] + problem.constant;
    }

    /// A first set: the key that helps most, one after the other.
    fn greedy(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed) {
        let n = self.n;
        for at in 1..self.keys {
            let (mut best, mut gain) = (None, -1.0);
            for a in 1..n {
                let level = &self.levels[at - 1];
                let d = level.h[a * n + a];
                let new = if d > self.least[a] { level.r[a] * level.r[a] / d } else { 0.0 };
                if new > gain && !self.chosen[1..at].contains(&a) {
                    (best, gain) = (Some(a), new);
                }
            }
            let Some(a) = best else { return };
            self.chosen[at] = a;
            if at + 1 < self.keys {
                // All rows behind the first are wanted here, as the choice is in no order.
                self.pivot(at - 1, a, 1);
            }
        }
        self.leaf(problem, order, boxed);
    }

    /// Level `depth + 1` from level `depth` with key `a` chosen: rows from `from` on.
    fn pivot(&mut self, depth: usize, a: usize, from: usize) {
        let n = self.n;
        let (before, after) = self.levels.split_at_mut(depth + 1);
        let (Some(old), Some(new)) = (before.last(), after.first_mut()) else { return };
        let d = old.h[a * n + a];
        let inverse = if d > self.least[a] { 1.0 / d } else { 0.0 };
        let of = |i: usize| if i < a { old.h[i * n + a] } else { old.h[a * n + i] };
        new.cost = old.cost - old.r[a] * old.r[a] * inverse;
        for i in from..n {
            let share = of(i) * inverse;
            new.r[i] = old.r[i] - share * old.r[a];
            for j in i..n {
                new.h[i * n + j] = old.h[i * n + j] - share * of(j);
            }
        }
    }

    /// All sets that begin with the keys chosen up to `depth`, the last of which is at position `last`.
    fn descend(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed, depth: usize, last: usize) {
        let left = self.keys - 1 - depth;
        self.looked += 1;
        if self.looked > MOST {
            self.runner_up = self.runner_up.min(self.bound(depth, last));
            return;
        }
        if left == 1 {
            return self.singles(problem, order, boxed, depth, last);
        }
        let m = self.n - 1 - last;
        if sets(m, left) > (m * m * m / 6 + 64) as f64 {
            let bound = self.bound(depth, last);
            if bound >= self.best_cost {
                self.runner_up = self.runner_up.min(bound);
                return;
            }
        }
        if left == 2 {
            return self.pairs(problem, order, boxed, depth, last);
        }
        for a in last + 1..=self.n - left {
            self.chosen[depth + 1] = a;
            self.pivot(depth, a, a + 1);
            self.descend(problem, order, boxed, depth + 1, a);
        }
    }

    /// The last key.
    fn singles(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed, depth: usize, last: usize) {
        let n = self.n;
        for a in last + 1..n {
            let level = &self.levels[depth];
            let (d, r) = (level.h[a * n + a], level.r[a]);
            let bound = if d > self.least[a] { level.cost - r * r / d } else { level.cost };
            self.consider(problem, order, boxed, bound, depth + 1, a);
        }
    }

    /// The last two keys: the second one's elimination is never written down.
    fn pairs(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed, depth: usize, last: usize) {
        let n = self.n;
        for a in last + 1..n - 1 {
            self.chosen[depth + 1] = a;
            let level = &self.levels[depth];
            let d = level.h[a * n + a];
            let inverse = if d > self.least[a] { 1.0 / d } else { 0.0 };
            let (r, cost) = (level.r[a], level.cost - level.r[a] * level.r[a] * inverse);
            for b in a + 1..n {
                let level = &self.levels[depth];
                let h = level.h[a * n + b];
                let share = h * inverse;
                let (d, r) = (level.h[b * n + b] - share * h, level.r[b] - share * r);
                // Compared before dividing: nearly all sets end here.
                if r * r <= (cost - self.runner_up) * d && d > self.least[b] {
                    continue;
                }
                let bound = if d > self.least[b] { cost - r * r / d } else { cost };
                self.consider(problem, order, boxed, bound, depth + 2, b);
            }
        }
    }

    /// A whole set, the last key of which is at position `a`, solved where its bound promises more than the best so far.
    fn consider(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed, bound: f64, at: usize, a: usize) {
        if bound < self.best_cost {
            self.chosen[at] = a;
            self.leaf(problem, order, boxed);
        } else if bound < self.runner_up {
            self.runner_up = bound;
        }
    }

    fn leaf(&mut self, problem: &Problem, order: &[usize], boxed: &mut Boxed) {
        for (to, from) in self.set.iter_mut().zip(&self.chosen) {
            *to = order[*from];
        }
        // One order for one set, so that it is solved to the same bits however it was come by.
        self.set.sort_unstable_by_key(|i| order.iter().position(|o| o == i));
        if self.best == self.set {
            return;
        }
        let cost = boxed.solve(problem, &self.set, &mut self.weights).cost;
        self.solved += 1;
        if cost < self.best_cost {
            self.runner_up = self.runner_up.min(self.best_cost);
            self.best_cost = cost;
            self.best.clear();
            self.best.extend_from_slice(&self.set);
        } else {
            self.runner_up = self.runner_up.min(cost);
        }
    }

    /// Least cost with the chosen keys and any number of those that are left, without bounds: below that of every set among them.
    fn bound(&mut self, depth: usize, last: usize) -> f64 {
        let n = self.n;
        let level = &self.levels[depth];
        let mut cost = level.cost;
        // Cholesky by columns, the right-hand side carried along as one more row.
        let f = &mut self.factor;
        for a in last + 1..n {
            let column = |f: &[f64], i: usize, j: usize| (last + 1..j).map(|c| f[i * n + c] * f[j * n + c]).sum::<f64>();
            let d = level.h[a * n + a] - column(f, a, a);
            let pivot = if d > self.least[a] { d.sqrt() } else { 0.0 };
            f[a * n + a] = pivot;
            for i in a + 1..n {
                f[i * n + a] = if pivot > 0.0 { (level.h[a * n + i] - column(f, i, a)) / pivot } else { 0.0 };
            }
            // Row `last` holds the right-hand side: its position is chosen and its row free.
            let carried: f64 = (last + 1..a).map(|c| f[last * n + c] * f[a * n + c]).sum();
            f[last * n + a] = if pivot > 0.0 { (level.r[a] - carried) / pivot } else { 0.0 };
            cost -= f[last * n + a] * f[last * n + a];
        }
        cost
    }
}

/// How many sets of `k` there are among `n`.
fn sets(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |c, i| c * n.saturating_sub(i) as f64 / (i + 1) as f64)
}
