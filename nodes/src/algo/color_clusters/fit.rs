//! Fitting the mixtures: seeded k-means++, weighted expectation maximisation, and its incremental form over time.
//!
//! All sums run over the samples in order, all random numbers come from a counter: two fits of the same picture have the same bits.

use super::gaussian::{Gaussian, Whitening};

/// Steps of Lloyd's algorithm before expectation maximisation takes over.
const LLOYD_STEPS: usize = 6;
/// Most steps of expectation maximisation.
const EM_STEPS: usize = 24;
/// The gain of the mean log likelihood at which it stops.
const EM_GAIN: f64 = 2e-4;
/// Candidates tried for each centre of k-means++.
const CANDIDATES: usize = 4;

/// Colours with a weight each, for one side of the model.
#[derive(Clone, Copy)]
pub(super) struct Weighted<'a> {
    pub(super) points: &'a [[f64; 3]],
    pub(super) weights: &'a [f64],
}

impl Weighted<'_> {
    pub(super) fn total(&self) -> f64 {
        self.weights.iter().sum()
    }
}

/// Count, first and second moments of the colours that one component answers for.
#[derive(Clone, Copy, Default)]
struct Moments {
    n: f64,
    sum: [f64; 3],
    /// Upper triangle: xx, xy, xz, yy, yz, zz, about the reference point.
    square: [f64; 6],
}

impl Moments {
    /// Adds `x` with weight `w`; moments are about `about`, near the mean, so that nothing cancels.
    fn add(&mut self, x: [f64; 3], about: [f64; 3], w: f64) {
        let d = [x[0] - about[0], x[1] - about[1], x[2] - about[2]];
        self.n += w;
        for i in 0..3 {
            self.sum[i] += w * d[i];
        }
        let products = [d[0] * d[0], d[0] * d[1], d[0] * d[2], d[1] * d[1], d[1] * d[2], d[2] * d[2]];
        for (s, p) in self.square.iter_mut().zip(products) {
            *s += w * p;
        }
    }

    /// The normal distribution with these moments, its variances no smaller than `floor_sq`; `None` without samples.
    fn gaussian(&self, about: [f64; 3], weight: f64, floor_sq: f64) -> Option<Gaussian> {
        if self.n.is_nan() || self.n <= 1e-9 {
            return None;
        }
        let d = self.sum.map(|s| s / self.n);
        let s = self.square.map(|s| s / self.n);
        let c = |i: usize, p: usize, q: usize| s[i] - d[p] * d[q];
        let (xy, xz, yz) = (c(1, 0, 1), c(2, 0, 2), c(4, 1, 2));
        // A little roundness keeps flat colours, whose covariance is nil, invertible.
        let diagonal = |i: usize, p: usize| c(i, p, p).max(0.0) + floor_sq;
        let covariance = [[diagonal(0, 0), xy, xz], [xy, diagonal(3, 1), yz], [xz, yz, diagonal(5, 2)]];
        Some(Gaussian { weight, mean: [about[0] + d[0], about[1] + d[1], about[2] + d[2]], covariance })
    }
}

/// A counter-based generator (SplitMix64, Steele and others 2014): the same numbers on every run.
struct Counter(u64);

impl Counter {
    /// A number in [0, 1).
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

pub(super) fn distance_sq(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2])
}

/// The sample at which the running sum of `mass` passes `share` of its total.
fn draw(mass: impl Iterator<Item = f64> + Clone, share: f64) -> usize {
    let target = share * mass.clone().sum::<f64>();
    let mut running = 0.0;
    let mut last = 0;
    for (i, m) in mass.enumerate() {
        if m > 0.0 {
            last = i;
            running += m;
            if running > target {
                break;
            }
        }
    }
    last
}

/// Centres by greedy k-means++: of a few candidates drawn by squared distance, the one that lowers the sum most. O(k × samples).
///
/// **Source** D. Arthur, S. Vassilvitskii, *k-means++: the advantages of careful seeding*, 2007, and its greedy variant there in section 6.
fn seed_centres(s: Weighted<'_>, k: usize) -> Vec<[f64; 3]> {
    let mut random = Counter(0x7065_6762_6172);
    let first = draw(s.weights.iter().copied(), 0.5);
    let Some(&start) = s.points.get(first) else { return Vec::new() };
    let mut centres = vec![start];
    let mut nearest: Vec<f64> = s.points.iter().map(|p| distance_sq(*p, start)).collect();
    while centres.len() < k {
        let mass = nearest.iter().zip(s.weights).map(|(d, w)| d * w);
        let left: f64 = mass.clone().sum();
        if left.is_nan() || left <= 0.0 {
            break;
        }
        let mut best = (f64::INFINITY, 0);
        for _ in 0..CANDIDATES {
            let i = draw(mass.clone(), random.next());
            let cost = s.points.iter().zip(&nearest).zip(s.weights).map(|((p, d), w)| w * d.min(distance_sq(*p, s.points[i]))).sum();
            if cost < best.0 {
                best = (cost, i);
            }
        }
        let centre = s.points[best.1];
        centres.push(centre);
        for (d, p) in nearest.iter_mut().zip(s.points) {
            *d = d.min(distance_sq(*p, centre));
        }
    }
    centres
}

/// Clusters by k-means, as the mixture that expectation maximisation starts from. Fewer than `k` where there are fewer colours.
fn k_means(s: Weighted<'_>, k: usize, floor_sq: f64) -> Vec<Gaussian> {
    let mut centres = seed_centres(s, k);
    let mut moments = Vec::new();
    for _ in 0..LLOYD_STEPS {
        moments = vec![Moments::default(); centres.len()];
        for (p, &w) in s.points.iter().zip(s.weights) {
            let mut best = (f64::INFINITY, 0);
            for (i, c) in centres.iter().enumerate() {
                let d = distance_sq(*p, *c);
                if d < best.0 {
                    best = (d, i);
                }
            }
            moments[best.1].add(*p, centres[best.1], w);
        }
        let about = centres.clone();
        for ((c, m), a) in centres.iter_mut().zip(&moments).zip(&about) {
            if m.n > 0.0 {
                *c = std::array::from_fn(|i| a[i] + m.sum[i] / m.n);
            }
        }
        if centres == about {
            break;
        }
        // The last moments are about the centres of the step before, which is where they are turned into components.
        for (m, (c, a)) in moments.iter_mut().zip(centres.iter().zip(&about)) {
            recentre(m, *a, *c);
        }
    }
    let total = s.total();
    let parts = moments.iter().zip(&centres);
    parts.filter_map(|(m, c)| m.gaussian(*c, m.n / total, floor_sq)).collect()
}

/// Moves the reference point of moments.
fn recentre(m: &mut Moments, from: [f64; 3], to: [f64; 3]) {
    let t: [f64; 3] = std::array::from_fn(|i| from[i] - to[i]);
    let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    for (q, (i, j)) in m.square.iter_mut().zip(pairs) {
        *q += t[i] * m.sum[j] + t[j] * m.sum[i] + m.n * t[i] * t[j];
    }
    for (s, t) in m.sum.iter_mut().zip(t) {
        *s += m.n * t;
    }
}

/// One step of expectation and maximisation; the new components and the mean log likelihood under the old ones. A component left without samples is kept as it was, with no weight.
fn em_step(s: Weighted<'_>, side: &[Gaussian], floor_sq: f64, outlier: f64) -> (Vec<Gaussian>, f64) {
    let white: Vec<(usize, Whitening, f64)> = side
        .iter()
        .enumerate()
        .filter(|(_, g)| g.weight > 0.0)
        .filter_map(|(i, g)| Some((i, g.whitening()?, libm::log(g.weight))))
        .collect();
    let mut moments = vec![Moments::default(); side.len()];
    let mut densities = vec![0.0; white.len()];
    let mut log_likelihood = 0.0;
    for (p, &w) in s.points.iter().zip(s.weights).filter(|(_, w)| **w > 0.0) {
        // Colours that nothing explains fall to the floor and pull at no component.
        let mut sum = outlier;
        for (d, (_, g, log_weight)) in densities.iter_mut().zip(&white) {
            *d = libm::exp(log_weight + g.log_density(*p));
            sum += *d;
        }
        log_likelihood += w * libm::log(sum);
        for (d, (i, g, _)) in densities.iter().zip(&white) {
            let share = d / sum;
            if share > 1e-6 {
                moments[*i].add(*p, g.mean, w * share);
            }
        }
    }
    let total = moments.iter().map(|m| m.n).sum::<f64>().max(1e-300);
    let renew = |(m, g): (&Moments, &Gaussian)| m.gaussian(g.mean, m.n / total, floor_sq).unwrap_or(Gaussian { weight: 0.0, ..*g });
    (moments.iter().zip(side).map(renew).collect(), log_likelihood / s.total().max(1e-300))
}

/// A mixture of at most `k` components. O(steps × samples × k).
///
/// **Source** A. Dempster, N. Laird, D. Rubin, *Maximum likelihood from incomplete data via the EM algorithm*, 1977.
pub(super) fn mixture(s: Weighted<'_>, k: usize, floor_sq: f64, outlier: f64) -> Vec<Gaussian> {
    let start = k_means(s, k, floor_sq);
    refine(s, start, floor_sq, outlier, EM_STEPS)
}

/// At most `steps` steps of expectation maximisation from given components.
pub(super) fn refine(s: Weighted<'_>, mut side: Vec<Gaussian>, floor_sq: f64, outlier: f64, steps: usize) -> Vec<Gaussian> {
    let mut before = f64::NEG_INFINITY;
    for _ in 0..steps {
        let (next, log_likelihood) = em_step(s, &side, floor_sq, outlier);
        side = next;
        if log_likelihood - before < EM_GAIN {
            break;
        }
        before = log_likelihood;
    }
    side
}

/// The components between two states of a mixture by their moments: `rate` 0 gives `old`, 1 gives `new`. A component that `new` gives no weight keeps its shape.
pub(super) fn blend(old: &Gaussian, new: &Gaussian, rate: f64) -> Gaussian {
    let weight = (1.0 - rate) * old.weight + rate * new.weight;
    if new.weight.is_nan() || new.weight <= 0.0 {
        return Gaussian { weight, ..*old };
    }
    let mean: [f64; 3] = std::array::from_fn(|i| (1.0 - rate) * old.mean[i] + rate * new.mean[i]);
    let mut covariance = [[0.0; 3]; 3];
    for (i, row) in covariance.iter_mut().enumerate() {
        for (j, c) in row.iter_mut().enumerate() {
            let between = (new.mean[i] - old.mean[i]) * (new.mean[j] - old.mean[j]);
            *c = (1.0 - rate) * old.covariance[i][j] + rate * new.covariance[i][j] + rate * (1.0 - rate) * between;
        }
    }
    Gaussian { weight, mean, covariance }
}
