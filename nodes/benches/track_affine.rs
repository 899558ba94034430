//! Time a frame of the affine tracker, one thread: a textured region of a fifth of the frame's width on a moving path, grey, 640x480 and
//! 1920x1080, with the motion of the frame before known ("ones") and not ("jump": 24 px at 640x480, found by the search). And the same frames, the
//! same region, with a space of ten components besides ("eigen"), and that stopped at half size ("eigen half").

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix2, Vector2};
use pegbar_nodes::algo::raster::{Affine, Raster, apply, identity, invert};
use pegbar_nodes::algo::track_affine::eigen::{EigenOptions, EigenStart, EigenTemplate, Pictures};
use pegbar_nodes::algo::track_affine::{Options, Region, Start, Template, Tone};
use pegbar_nodes::algo::window::Window;

/// The frame's size and the radius of the region, in pixels.
struct Scene {
    width: usize,
    height: usize,
    radius: f64,
}

impl Scene {
    fn centre(&self) -> Vector2<f64> {
        Vector2::new(0.35 * self.width as f64, 0.5 * self.height as f64)
    }

    /// Frame `t` of a path of turns, stretches and shifts.
    fn motion(&self, t: f64) -> Affine {
        let s = self.radius / 85.0;
        let (sin, cos) = libm::sincos(0.03 * t);
        let linear = Matrix2::new(cos, -sin, sin, cos) * Matrix2::new(1.0 + 0.02 * t, 0.01 * t, 0.0, 1.0 - 0.015 * t);
        let shift = self.centre() + Vector2::new(9.0 * s * t, 7.5 * s * t) - linear * self.centre();
        Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), shift])
    }

    fn frame(&self, t: f64) -> Vec<f32> {
        let inverse = invert(&self.motion(t)).unwrap_or_else(identity);
        let mut noise = 1u32;
        let mut out = Vec::with_capacity(self.width * self.height);
        for j in 0..self.height {
            for i in 0..self.width {
                let at = Vector2::new(i as f64 + 0.5, j as f64 + 0.5);
                let p = (apply(&inverse, at) - self.centre()) / self.radius;
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let grain = f64::from(noise >> 8) / f64::from(1 << 24) - 0.5;
                let value = if p.x.powi(4) + p.y.powi(4) < 1.0 { texture(p.x, p.y) } else { texture(0.004 * at.x, 0.004 * at.y) * 0.5 };
                out.push((value + 0.012 * grain) as f32);
            }
        }
        out
    }
}

/// Waves and soft-edged blobs, in about 0..1.
fn texture(u: f64, v: f64) -> f64 {
    let wave = |k: f64, l: f64, p: f64| libm::cos(k * u + l * v + p);
    let blob = |x: f64, y: f64, r: f64| 1.0 / (1.0 + libm::exp(((libm::hypot(u - x, v - y) - r) / 0.012).clamp(-40.0, 40.0)));
    let waves = wave(9.0, 4.0, 0.3) + wave(-5.0, 13.0, 1.2) + wave(17.0, -11.0, 2.2) + wave(3.0, 21.0, 0.7);
    0.5 + 0.03 * waves + 0.2 * blob(-0.3, 0.2, 0.3) - 0.2 * blob(0.4, -0.35, 0.25) + 0.15 * blob(0.2, 0.5, 0.2)
        - 0.1 * blob(-0.5, -0.5, 0.15)
}

/// Smooth patterns over the pictures of a space, of length one: waves across and down.
fn patterns(width: usize, height: usize) -> Vec<f64> {
    let waves = [(1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2), (2, 2), (3, 0), (0, 3)];
    let wave = |n: i32, i: usize, of: usize| libm::cos(std::f64::consts::PI * f64::from(n) * (i as f64 + 0.5) / of as f64);
    let pattern = |(a, b): &(i32, i32)| {
        let all: Vec<f64> = (0..width * height).map(|i| wave(*a, i % width, width) * wave(*b, i / width, height)).collect();
        let length = libm::sqrt(all.iter().map(|v| v * v).sum());
        all.into_iter().map(move |v| v / length)
    };
    waves.iter().flat_map(pattern).collect()
}

/// The space of a region of a frame (left, top, columns, rows) and ten patterns that change it by a twentieth.
fn space(frame: &Raster, [x, y, width, height]: [usize; 4], options: &Options, how: &EigenOptions) -> Option<EigenTemplate> {
    let mean: Vec<f64> = (y..y + height).flat_map(|j| frame.row(j)[x..x + width].iter().map(|v| f64::from(*v))).collect();
    let pictures = Pictures {
        mean: &mean,
        components: &patterns(width, height),
        variances: &[0.0025 * (width * height) as f64; 10],
        examples: &[],
        window: Window { x: x as i64, y: y as i64, width, height },
        channels: 1,
        alpha: None,
        tone: Tone::Linear,
    };
    EigenTemplate::new(&pictures, options, how).ok()
}

fn track(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("track_affine");
    for scene in [Scene { width: 640, height: 480, radius: 85.0 }, Scene { width: 1920, height: 1080, radius: 191.25 }] {
        let (c, h) = (scene.centre(), 0.8 * scene.radius);
        let frames: Vec<Vec<f32>> = [0.0, 2.0].iter().map(|&t| scene.frame(t)).collect();
        let rasters: Vec<Raster> = frames.iter().filter_map(|f| Raster::new(f, scene.width, scene.height, 1)).collect();
        let options = Options { tone: Tone::Linear, ..Options::default() };
        let region = Region::Box([c.x - h, c.y - h, c.x + h, c.y + h]);
        let size = format!("{}x{}", scene.width, scene.height);
        group.bench_function(BenchmarkId::new("template", &size), |b| b.iter(|| Template::new(black_box(rasters[0]), region, &options)));
        let Ok(template) = Template::new(rasters[0], region, &options) else { continue };
        let ones = Start { last: scene.motion(1.0), before: Some(identity()) };
        let jump = Start::default();
        for (name, start) in [("ones", ones), ("jump", jump)] {
            group.bench_function(BenchmarkId::new(name, &size), |b| b.iter(|| template.track(black_box(rasters[1]), None, &start)));
        }
        let [x, y, side] = [c.x - h, c.y - h, 2.0 * h].map(|v| libm::round(v) as usize);
        let start = EigenStart { last: scene.motion(1.0), before: Some(identity()), coefficients: vec![0.0; 10] };
        for (name, finest) in [("eigen", 0), ("eigen half", 1)] {
            let how = EigenOptions { finest, ..EigenOptions::default() };
            let Some(space) = space(&rasters[0], [x, y, side, side], &Options { cut: 2.0, ..options }, &how) else { continue };
            if let Ok(found) = space.track(rasters[1], None, &start) {
                let off = |p: [f64; 2]| (apply(&found.motion, p.into()) - apply(&scene.motion(2.0), p.into())).norm();
                let corners = [[c.x - h, c.y - h], [c.x + h, c.y - h], [c.x + h, c.y + h], [c.x - h, c.y + h]];
                println!("{name} {size}: corners off by {:.4} px at most", corners.map(off).into_iter().fold(0.0, f64::max));
            }
            group.bench_function(BenchmarkId::new(name, &size), |b| b.iter(|| space.track(black_box(rasters[1]), None, &start)));
        }
    }
    group.finish();
}

criterion_group!(benches, track);
criterion_main!(benches);
