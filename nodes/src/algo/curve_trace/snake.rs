//! Snakes: curves with fixed ends that bend to what draws them, no more than they must.

use super::feature::Field;
use super::ink::Ink;

/// How a snake moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snake {
    /// How much it resists being stretched.
    pub alpha: f64,
    /// How much it resists being bent.
    pub beta: f64,
    /// Inertia: larger steps the slower, and the surer.
    pub gamma: f64,
    /// Most steps.
    pub iterations: u32,
}

impl Default for Snake {
    fn default() -> Self {
        Self { alpha: 0.002, beta: 1.0, gamma: 1.0, iterations: 200 }
    }
}

/// A step that moves no point by more than this many pixels is the last.
const STILL: f64 = 1e-3;

/// A polyline drawn to a feature, its ends fixed: E = ∫ ½ α |v′|² + ½ β |v″|² − strength(v), (A + γ I) v ← γ v + ∇strength (Kass, Witkin, Terzopoulos
/// 1988, equations 2, 19 and 20). With `ink` it goes to the nearest ink first, however far that is. Cost: O(points) a step.
pub fn polish(points: Vec<[f64; 2]>, field: &Field, ink: Option<&Ink>, snake: &Snake) -> Vec<[f64; 2]> {
    let mut line = points;
    if let Some(ink) = ink {
        let pull = |p: [f64; 2]| match ink.nearest(p) {
            // The distance has no end to its basin, and the same slope everywhere.
            Some((to, far)) if far > 0.7 => [(to[0] - p[0]) / far, (to[1] - p[1]) / far],
            _ => [0.0; 2],
        };
        line = settle(line, pull, snake);
        line = spread(&line, 1.0);
    }
    let pull = |p: [f64; 2]| field.gradient(p);
    let line = settle(line, pull, snake);
    spread(&line, 1.0)
}

fn settle(mut line: Vec<[f64; 2]>, pull: impl Fn([f64; 2]) -> [f64; 2], snake: &Snake) -> Vec<[f64; 2]> {
    for round in 0..snake.iterations {
        if line.len() < 3 {
            break;
        }
        let forces: Vec<[f64; 2]> = line.iter().map(|p| pull(*p)).collect();
        let bands = Bands::new(line.len() - 2, snake);
        let solved = [0, 1].map(|k| bands.solve(&line, &forces, k, snake));
        let mut most = 0.0_f64;
        for i in 1..line.len() - 1 {
            let next = [solved[0][i - 1], solved[1][i - 1]];
            most = most.max(libm::hypot(next[0] - line[i][0], next[1] - line[i][1]));
            line[i] = next;
        }
        if most < STILL || !most.is_finite() {
            break;
        }
        // Points that have gathered are spread again, or the curve would fold.
        if round % 10 == 9 {
            line = spread(&line, 1.0);
        }
    }
    line
}

/// Points at even distances of about `step`, both ends among them.
pub(super) fn spread(line: &[[f64; 2]], step: f64) -> Vec<[f64; 2]> {
    let lengths: Vec<f64> = line.windows(2).map(|p| libm::hypot(p[1][0] - p[0][0], p[1][1] - p[0][1])).collect();
    let total: f64 = lengths.iter().sum();
    let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return Vec::new() };
    let n = libm::ceil(total / step).clamp(1.0, 1e6) as usize;
    let (mut out, mut at, mut before) = (vec![first], 0, 0.0);
    for k in 1..n {
        let wanted = total * k as f64 / n as f64;
        while at + 1 < lengths.len() && before + lengths[at] < wanted {
            before += lengths[at];
            at += 1;
        }
        let t = if lengths[at] > 0.0 { ((wanted - before) / lengths[at]).clamp(0.0, 1.0) } else { 0.0 };
        let (a, b) = (line[at], line[at + 1]);
        out.push([a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]);
    }
    out.push(last);
    out
}

/// A + γ I with fixed ends, as L D Lᵀ: two bands below a diagonal.
struct Bands {
    d: Vec<f64>,
    l1: Vec<f64>,
    l2: Vec<f64>,
}

impl Bands {
    fn new(n: usize, snake: &Snake) -> Self {
        let (a, b) = (snake.alpha, snake.beta);
        let (mut d, mut l1, mut l2) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            // Next to a fixed end one of the three second differences is missing: the end may turn freely.
            let rows = 6.0 - f64::from(u8::from(i == 0)) - f64::from(u8::from(i + 1 == n));
            let mut diagonal = snake.gamma + 2.0 * a + rows * b;
            let mut first = -a - 4.0 * b;
            let second = b;
            if i >= 2 {
                l2[i] = second / d[i - 2];
                first -= l2[i] * d[i - 2] * l1[i - 1];
                diagonal -= l2[i] * l2[i] * d[i - 2];
            }
            if i >= 1 {
                l1[i] = first / d[i - 1];
                diagonal -= l1[i] * l1[i] * d[i - 1];
            }
            d[i] = diagonal;
        }
        Self { d, l1, l2 }
    }

    fn solve(&self, line: &[[f64; 2]], forces: &[[f64; 2]], k: usize, snake: &Snake) -> Vec<f64> {
        let n = self.d.len();
        let (a, b) = (snake.alpha, snake.beta);
        let (start, end) = (line[0][k], line[n + 1][k]);
        let mut x: Vec<f64> = (0..n).map(|i| snake.gamma * line[i + 1][k] + forces[i + 1][k]).collect();
        // What the fixed ends pull by: the second difference about the first inner point has them once, about its neighbour once more.
        x[0] += (a + 2.0 * b) * start;
        x[n - 1] += (a + 2.0 * b) * end;
        if n > 1 {
            x[1] -= b * start;
            x[n - 2] -= b * end;
        }
        for i in 0..n {
            if i >= 1 {
                x[i] -= self.l1[i] * x[i - 1];
            }
            if i >= 2 {
                x[i] -= self.l2[i] * x[i - 2];
            }
        }
        x.iter_mut().zip(&self.d).for_each(|(x, d)| *x /= d);
        for i in (0..n).rev() {
            if i + 1 < n {
                x[i] -= self.l1[i + 1] * x[i + 1];
            }
            if i + 2 < n {
                x[i] -= self.l2[i + 2] * x[i + 2];
            }
        }
        x
    }
}
