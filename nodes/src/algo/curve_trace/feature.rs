//! What a curve is drawn to: middles of lines or edges of areas, how strong they are, which way they run.

use super::ink::{Ink, bilinear};

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// The middle of a line.
    Line,
    /// Where ink and paper meet.
    Edge,
}

/// How strong the feature is at each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 0 none, 1 as strong as it gets, row by row.
    pub strength: Vec<f32>,
}

impl Field {
    /// The feature of ink that is blurred by `sigma` pixels. Cost: O(pixels · sigma).
    pub fn new(ink: &Ink, feature: Feature, sigma: f64) -> Self {
        Self::of(ink.amount.clone(), [ink.width, ink.height], feature, sigma)
    }

    /// The feature of so much ink at each pixel.
    pub fn of(amount: Vec<f32>, [width, height]: [usize; 2], feature: Feature, sigma: f64) -> Self {
        let mut strength = blurred(&amount, width, height, sigma);
        if feature == Feature::Edge {
            strength = gradient(&strength, width, height);
        }
        let most = strength.iter().fold(0.0_f32, |m, v| m.max(*v));
        if most > 0.0 {
            strength.iter_mut().for_each(|v| *v /= most);
        }
        Self { width, height, strength }
    }

    /// The strength between pixels.
    pub fn at(&self, at: [f64; 2]) -> f64 {
        bilinear(&self.strength, self.width, self.height, at)
    }

    /// The gradient of the strength between pixels, per pixel.
    pub fn gradient(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let step = 0.5;
        [self.at([x + step, y]) - self.at([x - step, y]), self.at([x, y + step]) - self.at([x, y - step])]
    }

    /// Which way the feature runs: across the direction in which the strength bends most.
    pub fn tangent(&self, at: [f64; 2]) -> [f64; 2] {
        let ([xx, xy, yy], _) = self.bend(at);
        // The eigenvector of the eigenvalue of the greatest amount is across.
        let angle = 0.5 * libm::atan2(2.0 * xy, xx - yy);
        let along = |a: f64| {
            let (s, c) = libm::sincos(a);
            (c * c * xx + 2.0 * s * c * xy + s * s * yy).abs()
        };
        let across = if along(angle) >= along(angle + std::f64::consts::FRAC_PI_2) { angle } else { angle + std::f64::consts::FRAC_PI_2 };
        let (s, c) = libm::sincos(across);
        [-s, c]
    }

    fn bend(&self, [x, y]: [f64; 2]) -> ([f64; 3], [f64; 2]) {
        let s = |dx: f64, dy: f64| self.at([x + dx, y + dy]);
        let middle = s(0.0, 0.0);
        let xx = s(1.0, 0.0) + s(-1.0, 0.0) - 2.0 * middle;
        let yy = s(0.0, 1.0) + s(0.0, -1.0) - 2.0 * middle;
        let xy = (s(1.0, 1.0) + s(-1.0, -1.0) - s(1.0, -1.0) - s(-1.0, 1.0)) / 4.0;
        ([xx, xy, yy], [(s(1.0, 0.0) - s(-1.0, 0.0)) / 2.0, (s(0.0, 1.0) - s(0.0, -1.0)) / 2.0])
    }

    /// A place moved across the feature to its ridge, by `most` pixels at the most.
    pub fn centred(&self, at: [f64; 2], most: f64) -> [f64; 2] {
        let mut p = at;
        for _ in 0..20 {
            let ([xx, xy, yy], g) = self.bend(p);
            let [tx, ty] = self.tangent(p);
            let (nx, ny) = (-ty, tx);
            let (slope, curve) = (g[0] * nx + g[1] * ny, nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy);
            // Newton's step where the strength has a top, half a pixel uphill elsewhere.
            let step =
                if curve < -1e-9 { (-slope / curve).clamp(-0.5, 0.5) } else { 0.5 * slope.signum() * f64::from(u8::from(slope != 0.0)) };
            let next = [p[0] + nx * step, p[1] + ny * step];
            if libm::hypot(next[0] - at[0], next[1] - at[1]) > most {
                break;
            }
            p = next;
            if step.abs() < 1e-4 {
                break;
            }
        }
        p
    }
}

/// The length of the gradient, by central differences.
fn gradient(data: &[f32], width: usize, height: usize) -> Vec<f32> {
    let get = |x: usize, y: usize| data[y * width + x];
    let one = |i: usize| {
        let (x, y) = (i % width, i / width);
        let gx = get((x + 1).min(width - 1), y) - get(x.saturating_sub(1), y);
        let gy = get(x, (y + 1).min(height - 1)) - get(x, y.saturating_sub(1));
        (gx * gx + gy * gy).sqrt()
    };
    (0..data.len()).map(one).collect()
}

/// A Gaussian blur; what lies outside is as the border.
fn blurred(data: &[f32], width: usize, height: usize, sigma: f64) -> Vec<f32> {
    let reach = libm::ceil(3.0 * sigma) as usize;
    let mut kernel: Vec<f64> = (0..=reach).map(|i| libm::exp(-0.5 * (i as f64 / sigma).powi(2))).collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f64>();
    kernel.iter_mut().for_each(|k| *k /= sum);
    let pass = |n: usize, lines: usize, step: usize, jump: usize, from: &[f32]| {
        let mut out = vec![0.0_f32; from.len()];
        for line in 0..lines {
            for i in 0..n {
                let get = |j: usize| f64::from(from[line * jump + j * step]);
                let mut total = kernel[0] * get(i);
                for (k, w) in kernel.iter().enumerate().skip(1) {
                    total += w * (get(i.saturating_sub(k)) + get((i + k).min(n - 1)));
                }
                out[line * jump + i * step] = total as f32;
            }
        }
        out
    };
    let across = pass(width, height, 1, width, data);
    pass(height, width, width, 1, &across)
}
