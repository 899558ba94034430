//! A drawn scene with known motion: a hat of flat colours and an ink outline, supersampled, on a textured ground that stands still.

use nalgebra::{Matrix2x3, Vector2};

/// Columns and rows of a frame.
pub(super) const SIZE: (usize, usize) = (320, 240);
/// The hat's centre in the reference.
pub(super) const CENTRE: [f64; 2] = [160.3, 119.6];
/// The hat's box about its centre: left, top, right, bottom.
pub(super) const BOX: [f64; 4] = [-56.0, -40.0, 56.0, 36.0];

/// A small deterministic generator (SplitMix64).
pub(super) struct Random(pub(super) u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in low..high.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Nearly normal, deviation 1.
    pub(super) fn normal(&mut self) -> f64 {
        (0..6).map(|_| self.range(-1.0, 1.0)).sum::<f64>() / libm::sqrt(2.0)
    }
}

/// A warp of the reference within the limits of a level: 4, 15 or 35 px; 4, 12 or 25 degrees and per cent.
pub(super) fn warp(level: usize, rng: &mut Random) -> Matrix2x3<f64> {
    let px = [4.0, 15.0, 35.0][level];
    let part = [0.04, 0.12, 0.25][level];
    let angle = rng.range(-1.0, 1.0) * [4.0f64, 12.0, 25.0][level].to_radians();
    let (sx, sy, shear) = (1.0 + rng.range(-part, part), 1.0 + rng.range(-part, part), rng.range(-part, part));
    let (s, c) = libm::sincos(angle);
    let a = nalgebra::Matrix2::new(c, -s, s, c) * nalgebra::Matrix2::new(1.0, shear, 0.0, 1.0) * nalgebra::Matrix2::new(sx, 0.0, 0.0, sy);
    let d = Vector2::new(rng.range(-px, px), rng.range(-px, px));
    let centre = Vector2::from(CENTRE);
    let t = centre + d - a * centre;
    Matrix2x3::from_columns(&[a.column(0).into(), a.column(1).into(), t])
}

/// Approximate signed distance to a superellipse of power 4 or 2, negative inside.
fn blob(x: f64, y: f64, rx: f64, ry: f64, power: i32) -> f64 {
    let (u, v) = ((x / rx).abs(), (y / ry).abs());
    let f = u.powi(power) + v.powi(power) - 1.0;
    let p = f64::from(power);
    let g = libm::hypot(p * u.powi(power - 1) / rx, p * v.powi(power - 1) / ry);
    f / g.max(1e-3)
}

const INK: [f64; 3] = [0.06, 0.05, 0.08];

/// Display colour of the hat at a point about its centre, where there is any.
fn hat(x: f64, y: f64) -> Option<[f64; 3]> {
    let crown = blob(x / (1.0 + y * 0.005), y + 8.0, 30.0, 28.0, 4);
    let brim = blob(x, y - 22.0 - 0.002 * x * x, 52.0, 9.0, 2);
    let edge = 1.3;
    if crown > edge && brim > edge {
        return None;
    }
    if brim.abs() <= edge || (brim > 0.0 && crown.abs() <= edge) {
        return Some(INK);
    }
    if brim < 0.0 {
        return Some([0.55, 0.36, 0.2]);
    }
    let band = (6.0..12.5).contains(&y);
    let edge_of_band = (y - 6.0).abs() < 0.9;
    Some(if edge_of_band {
        INK
    } else if band {
        [0.75, 0.16, 0.14]
    } else {
        [0.66, 0.45, 0.26]
    })
}

fn ground(x: f64, y: f64) -> [f64; 3] {
    let wave = |k: f64, l: f64, p: f64| libm::cos(k * x + l * y + p);
    let s = 0.5 + 0.12 * wave(0.11, 0.05, 0.3) + 0.1 * wave(-0.04, 0.16, 1.3) + 0.07 * wave(0.31, 0.22, 2.0) + 0.05 * wave(0.5, -0.43, 0.7);
    let t = 0.08 * wave(0.05, -0.09, 0.1) + 0.04 * wave(0.23, 0.3, 1.9);
    [s * 0.75 + t, s * 0.9, s * 0.6 - t]
}

/// A frame with the hat moved by `motion`: linear-light RGB with grain of deviation `grain` (display units), and the exact matte.
pub(super) fn render(motion: &Matrix2x3<f64>, grain: f64, seed: u64) -> (Vec<f32>, Vec<f32>) {
    const SUB: usize = 4;
    let (w, h) = SIZE;
    let mut rng = Random(seed);
    let linear = motion.fixed_view::<2, 2>(0, 0).into_owned();
    let inverse = linear.try_inverse().unwrap();
    let offset = motion.column(2).into_owned();
    let (mut rgb, mut matte) = (Vec::with_capacity(w * h * 3), Vec::with_capacity(w * h));
    for j in 0..h {
        for i in 0..w {
            let back = ground(i as f64 + 0.5, j as f64 + 0.5);
            let (mut sum, mut cover) = ([0.0; 3], 0.0);
            let at = |i: f64, j: f64| inverse * (Vector2::new(i, j) - offset) - Vector2::from(CENTRE);
            let mid = at(i as f64 + 0.5, j as f64 + 0.5);
            let near = mid.x.abs() < 62.0 && mid.y.abs() < 46.0;
            for k in 0..if near { SUB * SUB } else { 0 } {
                let sub = |k: usize| (k as f64 + 0.5) / SUB as f64;
                let p = at(i as f64 + sub(k % SUB), j as f64 + sub(k / SUB));
                if let Some(c) = hat(p.x, p.y) {
                    cover += 1.0;
                    (0..3).for_each(|n| sum[n] += c[n]);
                }
            }
            let n = (SUB * SUB) as f64;
            for c in 0..3 {
                let display = back[c] * (1.0 - cover / n) + sum[c] / n + grain * rng.normal();
                rgb.push((display.max(0.0) * display.max(0.0)) as f32);
            }
            matte.push((cover / n) as f32);
        }
    }
    (rgb, matte)
}

/// Largest distance between two motions over the corners of the hat's box.
pub(super) fn corner_error(a: &Matrix2x3<f64>, b: &Matrix2x3<f64>) -> f64 {
    let [x0, y0, x1, y1] = BOX;
    [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].iter().fold(0.0f64, |m, &(x, y)| {
        let p = nalgebra::Vector3::new(x + CENTRE[0], y + CENTRE[1], 1.0);
        m.max((a * p - b * p).norm())
    })
}
