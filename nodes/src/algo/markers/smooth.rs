//! Tracks of markers, smoothed without lag: drawing by drawing, never across a hold or a cut.
//!
//! Each value becomes that of a polynomial fitted to its neighbours by least squares (local regression, Cleveland 1979). With even weights it is the filter
//! of Savitzky and Golay (1964), at the ends too, where the last whole window is read off; with Gaussian weights and a straight line it is a Gaussian filter
//! that keeps straight motion as it is, at the ends too. Both are symmetric: nothing is late.

use std::ops::Range;

use pegbar_engine::Setting;

/// Which filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Filter {
    /// Gaussian weights of a quarter of the window, a straight line.
    Gaussian,
    /// Even weights, a polynomial: keeps extremes better, and less smooth.
    SavitzkyGolay,
}

/// How tracks are smoothed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smooth {
    /// Drawings that are taken together, the one in the middle included.
    pub window: f64,
    /// Which filter.
    pub filter: Filter,
    /// Degree of the polynomials of Savitzky and Golay.
    pub degree: usize,
}

/// The value at 0 of the polynomial through points (time, value) with weights, by Gram-Schmidt on the powers of time. Of as many points as coefficients it is
/// the one through them; of fewer one of a lower degree.
fn fitted(points: &[(f64, f64, f64)], degree: usize) -> f64 {
    let reach = points.iter().map(|(t, ..)| t.abs()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).zip(points).map(|((a, b), (_, _, w))| a * b * w).sum::<f64>();
    let values: Vec<f64> = points.iter().map(|(_, v, _)| *v).collect();
    // Each polynomial at the points, and at 0.
    let mut basis: Vec<(Vec<f64>, f64)> = Vec::new();
    let mut found = 0.0;
    for k in 0..=degree.min(points.len().saturating_sub(1)) {
        let mut own: Vec<f64> = points.iter().map(|(t, ..)| libm::pow(t / reach, k as f64)).collect();
        let mut at_zero = if k == 0 { 1.0 } else { 0.0 };
        let size = dot(&own, &own);
        for (other, zero) in &basis {
            let share = dot(&own, other);
            own.iter_mut().zip(other).for_each(|(a, b)| *a -= share * b);
            at_zero -= share * zero;
        }
        let left = dot(&own, &own);
        if left <= 1e-24 * size {
            break;
        }
        let length = libm::sqrt(left);
        own.iter_mut().for_each(|v| *v /= length);
        at_zero /= length;
        found += dot(&own, &values) * at_zero;
        basis.push((own, at_zero));
    }
    found
}

impl Smooth {
    /// Smooths one track: a value a drawing, NaN where there is none, at times that rise. Each of `parts` is smoothed by itself; drawings that are in no part
    /// stay, and so do the `fixed` ones, though others look at them. O(drawings · window).
    pub fn apply(&self, values: &[f64], times: &[f64], parts: &[Range<usize>], fixed: &[bool]) -> Vec<f64> {
        let mut found = values.to_vec();
        let half = (self.window / 2.0).floor();
        if half < 1.0 {
            return found;
        }
        for part in parts {
            let known: Vec<usize> = part.clone().filter(|&d| values[d].is_finite()).collect();
            for (at, &d) in known.iter().enumerate().filter(|(_, d)| !fixed[**d]) {
                let window = self.window(at, known.len(), half as usize);
                let point = |i: usize| {
                    let away = i as f64 - at as f64;
                    let weight = match self.filter {
                        Filter::Gaussian => libm::exp(-8.0 * (away / self.window) * (away / self.window)),
                        Filter::SavitzkyGolay => 1.0,
                    };
                    (times[known[i]] - times[d], values[known[i]], weight)
                };
                let points: Vec<_> = window.map(point).collect();
                found[d] = fitted(&points, if self.filter == Filter::Gaussian { 1 } else { self.degree });
            }
        }
        found
    }

    /// The drawings about one of `n`: cut off at the ends; for polynomials the whole window that is nearest.
    fn window(&self, at: usize, n: usize, half: usize) -> Range<usize> {
        match self.filter {
            Filter::Gaussian => at.saturating_sub(half)..(at + half + 1).min(n),
            Filter::SavitzkyGolay => {
                let start = at.saturating_sub(half).min(n.saturating_sub(2 * half + 1));
                start..(start + 2 * half + 1).min(n)
            }
        }
    }
}

/// Gaps of a track between two values of one part, filled on the straight way.
pub fn bridged(values: &[f64], times: &[f64], parts: &[Range<usize>]) -> Vec<f64> {
    let mut found = values.to_vec();
    for part in parts {
        let known: Vec<usize> = part.clone().filter(|&d| values[d].is_finite()).collect();
        for pair in known.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            for d in a + 1..b {
                let t = (times[d] - times[a]) / (times[b] - times[a]);
                found[d] = values[a] + (values[b] - values[a]) * t;
            }
        }
    }
    found
}

/// Parts of so many drawings between cuts and holds. A cut is before a drawing; a hold is the last of one part and the first of the next.
pub fn parts(n: usize, cuts: &[usize], holds: &[usize]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = 0;
    for d in 0..n {
        if d > start && cuts.contains(&d) {
            found.push(start..d);
            start = d;
        }
        if d > start && holds.contains(&d) {
            found.push(start..d + 1);
            start = d;
        }
    }
    if start < n {
        found.push(start..n);
    }
    found
}
