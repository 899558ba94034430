//! Painted backdrops: a colour for each place, then brush strokes in that colour on top.

use super::noise::{fbm, hash2, noise, smoothstep, unit};
use crate::algo::paint::{Canvas, FillRule, hex, ink};
use kurbo::Point;

type Colour = [f64; 3];

fn rgb(code: u32) -> Colour {
    let c = hex(code);
    [f64::from(c[0]), f64::from(c[1]), f64::from(c[2])]
}

fn lerp(a: Colour, b: Colour, t: f64) -> Colour {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

fn times(a: Colour, k: f64) -> Colour {
    a.map(|v| v * k)
}

/// The stage or the meadow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Stage,
    Meadow,
}

impl Place {
    /// The colour at a place of the 640×360 frame, and the direction that a brush would take there.
    fn at(self, x: f64, y: f64, seed: u64) -> (Colour, f64) {
        match self {
            Self::Stage => stage(x, y, seed),
            Self::Meadow => meadow(x, y, seed),
        }
    }
}

/// Paints the ground: RGBA, linear, opaque. `scale` pixels a design unit, `origin` the pixel of the design's corner. Cost: O(pixels).
pub(super) fn paint_ground(place: Place, width: usize, height: usize, scale: f64, origin: (f64, f64), seed: u64) -> Vec<f32> {
    let mut image = Vec::with_capacity(width * height * 4);
    let design = |i: f64, j: f64| ((i - origin.0) / scale, (j - origin.1) / scale);
    for j in 0..height {
        for i in 0..width {
            let (x, y) = design(i as f64 + 0.5, j as f64 + 0.5);
            let paper = 1.0 + 0.05 * fbm(x * 0.45, y * 0.45, 2, seed ^ 77);
            let colour = times(place.at(x, y, seed).0, paper);
            image.extend(colour.map(|v| v as f32));
            image.push(1.0);
        }
    }
    brush_strokes(&mut image, place, width, height, scale, origin, seed);
    image
}

/// Short strokes on a jittered grid, each with the colour of its middle and bristles along it.
fn brush_strokes(image: &mut [f32], place: Place, width: usize, height: usize, scale: f64, origin: (f64, f64), seed: u64) {
    let Ok(mut canvas) = Canvas::new(image, width, height) else { return };
    // In a frame smaller than 32 by 18 the strokes would be finer than a pixel.
    if scale < 0.05 {
        return;
    }
    const STEP: f64 = 11.0;
    let (left, top) = (-origin.0 / scale, -origin.1 / scale);
    let (columns, rows) = ((width as f64 / scale / STEP) as i64 + 2, (height as f64 / scale / STEP) as i64 + 2);
    for row in 0..rows {
        for column in 0..columns {
            let dice = |k: i64| unit(hash2(column * 8 + k, row, seed ^ 0xb5));
            let (x, y) = (left + (column as f64 + dice(0) - 0.5) * STEP, top + (row as f64 + dice(1) - 0.5) * STEP);
            let (colour, angle) = place.at(x, y, seed);
            let (sin, cos) = libm::sincos(angle + 0.5 * (dice(2) - 0.5));
            let (length, bow) = (9.0 + 13.0 * dice(3), 3.0 * (dice(4) - 0.5));
            // A painter does not drag one thing's colour over another's edge.
            let strays = |t: f64| far_apart(colour, place.at(x + t * length * cos, y + t * length * sin, seed).0);
            if [-1.0, -0.5, 0.5, 1.0].into_iter().any(strays) {
                continue;
            }
            let points: Vec<Point> = (0..=8)
                .map(|k| {
                    let t = f64::from(k) / 4.0 - 1.0;
                    let (along, across) = (t * length, bow * (1.0 - t * t));
                    Point::new((x + along * cos - across * sin) * scale + origin.0, (y + along * sin + across * cos) * scale + origin.1)
                })
                .collect();
            let fat = (3.0 + 4.0 * dice(5)) * scale;
            let outline = ink(&points, false, |s| fat * (0.25 + 3.0 * s * (1.0 - s)).min(1.0));
            let (tone, cover) = (0.88 + 0.24 * dice(6), 0.22 + 0.25 * dice(7));
            canvas.fill_with(&outline, FillRule::NonZero, |i, j| {
                let (px, py) = ((i as f64 - origin.0) / scale - x, (j as f64 - origin.1) / scale - y);
                let bristle =
                    0.72 + 0.28 * noise((px * sin - py * cos) * 1.4, (px * cos + py * sin) * 0.07, seed ^ (column * 131 + row) as u64);
                let alpha = cover * bristle;
                [(colour[0] * tone * alpha) as f32, (colour[1] * tone * alpha) as f32, (colour[2] * tone * alpha) as f32, alpha as f32]
            });
        }
    }
}

/// Whether two colours belong to different things: their ratio in some channel is beyond the play of light and texture.
fn far_apart(a: Colour, b: Colour) -> bool {
    a.iter().zip(b).any(|(a, b)| (a.max(1e-4).sqrt() - b.max(1e-4).sqrt()).abs() > 0.13)
}

/// A theatre: a red curtain in folds, a gold-fringed valance, boards in perspective, a pool of warm light.
fn stage(x: f64, y: f64, seed: u64) -> (Colour, f64) {
    let spot = |cx: f64, cy: f64, rx: f64, ry: f64| libm::exp(-((x - cx) / rx) * ((x - cx) / rx) - ((y - cy) / ry) * ((y - cy) / ry));
    let drape = 40.0 + 11.0 * libm::cos((x - 320.0) * std::f64::consts::PI / 64.0).abs() + 1.5 * noise(x * 0.03, 0.0, seed);
    if y < drape {
        return valance(x, y, drape, seed);
    }
    let hem = 246.0 + 2.5 * libm::sin(x * 0.13 + 2.0 * noise(x * 0.02, 3.0, seed));
    if y < hem {
        let sway = 2.4 * noise(x * 0.012, y * 0.002, seed) + 0.35 * noise(x * 0.05, y * 0.008, seed ^ 5);
        let fold = 0.5 + 0.5 * libm::sin(x * 0.155 + 2.2 * sway);
        let deep = lerp(rgb(0x34101c), rgb(0x8c1d2a), smoothstep(0.0, 0.55, fold));
        let cloth = lerp(deep, rgb(0xc8403a), smoothstep(0.55, 1.0, fold));
        let shade = smoothstep(drape - 6.0, drape + 46.0, y) * 0.6 + 0.4;
        let light = (0.34 + 1.0 * spot(320.0, 165.0, 235.0, 135.0)) * shade;
        let gold = smoothstep(hem - 11.0, hem - 10.0, y) * (1.0 - smoothstep(hem - 4.0, hem - 3.0, y));
        let trim = lerp(rgb(0x7a5218), rgb(0xe8b84a), fold);
        return (times(lerp(cloth, trim, gold), light), std::f64::consts::FRAC_PI_2);
    }
    boards(x, y, hem, 0.40 + 1.05 * spot(320.0, 302.0, 250.0, 52.0), seed)
}

fn valance(x: f64, y: f64, drape: f64, seed: u64) -> (Colour, f64) {
    let fold = 0.5 + 0.5 * libm::sin(x * 0.24 + 0.03 * y + 2.0 * noise(x * 0.03, y * 0.01, seed ^ 8));
    let cloth = lerp(rgb(0x2a0a16), rgb(0x9a2230), fold);
    let fringe = smoothstep(drape - 8.0, drape - 7.0, y);
    let thread = lerp(rgb(0x8a5e1c), rgb(0xf0c860), 0.5 + 0.5 * libm::sin(x * 1.9));
    let glow = 0.42 + 0.5 * libm::exp(-((x - 320.0) / 260.0) * ((x - 320.0) / 260.0));
    (times(lerp(cloth, thread, fringe), glow), std::f64::consts::FRAC_PI_2)
}

fn boards(x: f64, y: f64, hem: f64, light: f64, seed: u64) -> (Colour, f64) {
    let depth = (y - 216.0) / 84.0;
    let across = (x - 320.0) / depth;
    let plank = (across / 44.0).floor();
    let edge = (across / 44.0 - plank - 0.5).abs();
    let tone = unit(hash2(plank as i64, 7, seed));
    let grain = fbm(across * 0.22, 9.0 / depth + 37.0 * tone, 3, seed ^ 2);
    let wood = times(lerp(rgb(0x8f5a34), rgb(0xc9925a), 0.25 + 0.5 * tone + 0.35 * grain), light);
    // Joints are one unit wide near and far, and fade with distance, so that they never break up into dots.
    let gap = smoothstep(1.3, 0.4, (0.5 - edge) * 44.0 * depth) * smoothstep(0.35, 0.9, depth);
    let under = 1.0 - 0.55 * libm::exp(-(y - hem) / 7.0);
    (times(lerp(wood, rgb(0x2a1712), 0.8 * gap), under), libm::atan2(84.0, (x - 320.0) / depth))
}

/// A summer meadow: clouds, three ranges of hills, an old tree, a sandy lane where a ball may bounce.
fn meadow(x: f64, y: f64, seed: u64) -> (Colour, f64) {
    let lane_top = 286.0 + 3.0 * noise(x * 0.02, 1.0, seed);
    let lane_bottom = 334.0 + 5.0 * noise(x * 0.016, 2.0, seed ^ 4);
    if let Some(tree) = tree(x, y, seed) {
        return tree;
    }
    let far = 178.0 + 26.0 * noise(x * 0.008, 5.0, seed) + 6.0 * noise(x * 0.04, 5.0, seed);
    let middle = 206.0 + 22.0 * noise(x * 0.0065 + 3.0, 6.0, seed) + 3.0 * noise(x * 0.06, 6.0, seed);
    let near = 246.0 + 14.0 * noise(x * 0.007 + 9.0, 8.0, seed);
    if y > near {
        if y > lane_top && y < lane_bottom {
            let dust = fbm(x * 0.05, y * 0.3, 3, seed ^ 6);
            let edge = smoothstep(0.0, 7.0, (y - lane_top).min(lane_bottom - y));
            return (lerp(rgb(0xb59a58), lerp(rgb(0xe3c68e), rgb(0xf6e3b8), 0.5 + 0.7 * dust), edge), 0.0);
        }
        let blade = fbm(x * 0.09, y * 0.05, 3, seed ^ 11);
        let grass = lerp(rgb(0x4f8d3f), rgb(0x9cc455), (0.45 + 0.7 * blade + 0.3 * smoothstep(320.0, 250.0, y)).clamp(0.0, 1.0));
        let under = if y < lane_top { 1.0 } else { 0.72 };
        return (flowers(times(grass, under), x, y, seed), -1.3 + 0.3 * blade);
    }
    let tint = |low: u32, high: u32, ridge: f64| {
        lerp(rgb(high), rgb(low), smoothstep(ridge, ridge + 46.0, y + 12.0 * fbm(x * 0.03, y * 0.05, 2, seed ^ 21)))
    };
    if y > middle {
        return (tint(0xa8c873, 0x6ca45c, middle), -0.3 + 0.4 * noise(x * 0.01, 0.0, seed));
    }
    if y > far {
        return (tint(0xb4d4c4, 0x7fb0a6, far), 0.2);
    }
    sky(x, y, seed)
}

fn sky(x: f64, y: f64, seed: u64) -> (Colour, f64) {
    let air = lerp(rgb(0x5fb0e0), rgb(0xfbe8c4), smoothstep(0.0, 205.0, y));
    let puff = fbm(x * 0.011, y * 0.024, 4, seed ^ 31) + 0.10 - 0.14 * smoothstep(90.0, 190.0, y);
    let below = fbm(x * 0.011, y * 0.024 + 0.22, 4, seed ^ 31);
    let cloud = smoothstep(0.10, 0.30, puff);
    let white = lerp(rgb(0xfffaf0), rgb(0xc8d4e6), smoothstep(-0.1, 0.45, below));
    (lerp(air, white, 0.92 * cloud), 0.15)
}

/// The tree at the right, if it covers this place: clumps of leaves lit from the upper left, and a trunk.
fn tree(x: f64, y: f64, seed: u64) -> Option<(Colour, f64)> {
    const CLUMPS: [(f64, f64, f64); 7] = [
        (556.0, 96.0, 44.0),
        (516.0, 124.0, 36.0),
        (598.0, 122.0, 40.0),
        (540.0, 148.0, 38.0),
        (586.0, 156.0, 36.0),
        (624.0, 150.0, 30.0),
        (500.0, 152.0, 24.0),
    ];
    let ragged = 7.0 * noise(x * 0.12, y * 0.12, seed ^ 41) + 4.0 * noise(x * 0.3, y * 0.3, seed ^ 42);
    let mut leaf: Option<f64> = None;
    for (cx, cy, r) in CLUMPS {
        let (dx, dy) = (x - cx, (y - cy) * 1.15);
        if (dx * dx + dy * dy).sqrt() < r + ragged {
            leaf = Some(0.5 - 0.5 * (dx * 0.5 + dy * 0.86) / r + 0.25 * noise(x * 0.15, y * 0.15, seed ^ 43));
        }
    }
    if let Some(light) = leaf {
        let dark = lerp(rgb(0x244d38), rgb(0x4f8c40), smoothstep(0.1, 0.55, light));
        return Some((lerp(dark, rgb(0xb4cf5c), smoothstep(0.6, 1.05, light)), noise(x * 0.05, y * 0.05, seed ^ 44) * 2.0));
    }
    let half = 8.0 + 9.0 * smoothstep(236.0, 264.0, y) + 2.0 * noise(y * 0.05, 2.0, seed);
    let bark = (x - 562.0 - 3.0 * noise(y * 0.03, 0.0, seed)) / half;
    (y > 150.0 && y < 262.0 && bark.abs() < 1.0)
        .then(|| (lerp(rgb(0x9a7350), rgb(0x463026), smoothstep(-0.8, 0.8, bark + 0.3 * noise(x * 0.5, y * 0.06, seed))), 1.5))
}

fn flowers(grass: Colour, x: f64, y: f64, seed: u64) -> Colour {
    let (i, j) = ((x / 13.0).floor(), (y / 9.0).floor());
    let h = hash2(i as i64, j as i64, seed ^ 51);
    let dice = |k: u32| unit(h.rotate_left(k * 16));
    let (dx, dy) = (x - (i + 0.2 + 0.6 * dice(1)) * 13.0, (y - (j + 0.2 + 0.6 * dice(2)) * 9.0) * 1.3);
    if dice(0) < 0.22 && dx * dx + dy * dy < 3.4 {
        let petals = [0xfff6e0, 0xf4c63c, 0xe86a6a, 0xf6f0ff];
        return rgb(petals[(dice(3) * 4.0) as usize % 4]);
    }
    grass
}
