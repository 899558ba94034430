//! Anticipation and follow through: the cartoon animation filter, and a damped spring.

/// Adds to a curve its acceleration, smoothed and turned round: before it moves it goes back, and it overshoots where it stops.
///
/// x* = x - amount · width² · (G'' * x) for a Gaussian G of standard deviation `width`: Wang, Drucker, Agrawala, Cohen, "The Cartoon Animation Filter",
/// SIGGRAPH 2006, equation 1. Times rise, in frames; beyond its ends the curve is held. A curve at rest, or at a steady pace within four widths, stays
/// as it is. O(n · width).
pub fn anticipate(curve: &[f64], times: &[f64], amount: f64, width: f64) -> Vec<f64> {
    let n = curve.len();
    if n == 0 || amount == 0.0 {
        return curve.to_vec();
    }
    // Cells reach half way to the neighbours; what they hold of the kernel is exact, so that uneven holds do not pull.
    let edges: Vec<f64> = (0..n + 1)
        .map(|i| match i {
            0 => f64::NEG_INFINITY,
            i if i == n => f64::INFINITY,
            i => 0.5 * (times[i - 1] + times[i]),
        })
        .collect();
    // The integral of G'' is G'; written as differences from the curve's own value, a constant gives nought.
    let slope = |t: f64| if t.is_finite() { -t * libm::exp(-0.5 * t * t / (width * width)) } else { 0.0 };
    let norm = 1.0 / (libm::sqrt(std::f64::consts::TAU) * width);
    let at = |k: usize| {
        let sum: f64 = (0..n)
            .filter(|&i| edges[i] - times[k] < 8.0 * width && times[k] - edges[i + 1] < 8.0 * width)
            .map(|i| (slope(edges[i + 1] - times[k]) - slope(edges[i] - times[k])) * (curve[i] - curve[k]))
            .sum();
        curve[k] - amount * norm * sum
    };
    (0..n).map(at).collect()
}

/// A curve drawn along by a damped spring: it sets out late, overshoots and settles.
///
/// Solves y'' = ω² (x - y) - 2 ζ ω y', ω = 2π / `period`, exactly for an x that is straight between frames. It starts at rest on the curve, so that what
/// stands still stays. `damping` is ζ: 1 does not overshoot, 0 never settles. O(n).
pub fn spring(curve: &[f64], times: &[f64], period: f64, damping: f64) -> Vec<f64> {
    let omega = std::f64::consts::TAU / period;
    let mut out: Vec<f64> = curve.first().copied().into_iter().collect();
    let (mut gap, mut speed) = (0.0, 0.0);
    for k in 1..curve.len() {
        let h = times[k] - times[k - 1];
        let pace = (curve[k] - curve[k - 1]) / h;
        // Against a target at a steady pace the spring trails by 2 ζ pace / ω.
        let trail = -2.0 * damping * pace / omega;
        let (g, s) = swing(gap - trail, speed - pace, omega, damping, h);
        (gap, speed) = (g + trail, s + pace);
        out.push(curve[k] + gap);
    }
    out
}

/// A free damped swing after a time: position and speed.
fn swing(position: f64, speed: f64, omega: f64, damping: f64, time: f64) -> (f64, f64) {
    let decay = damping * omega;
    let square = omega * omega - decay * decay;
    let root = libm::sqrt(square.abs());
    // The two solutions that start as (1, 0) and (0, 1), by the kind of roots.
    let (c, s) = if root * time < 1e-7 {
        (1.0, time)
    } else if square > 0.0 {
        (libm::cos(root * time), libm::sin(root * time) / root)
    } else {
        (libm::cosh(root * time), libm::sinh(root * time) / root)
    };
    let e = libm::exp(-decay * time);
    let along = speed + decay * position;
    let p = e * (position * c + along * s);
    let v = e * (speed * c - (square * position + decay * along) * s);
    (p, v)
}
