//! Speed of the pixel kernels on 1920 × 1080 RGBA pictures in `f32`, one thread.

use criterion::{Criterion, criterion_group, criterion_main};
use pegbar_nodes::algo::filter::{ResizeFilter, gaussian_blur, resize};
use pegbar_nodes::algo::merge::over_in_place;
use pegbar_nodes::algo::raster::{Affine, Raster};
use pegbar_nodes::algo::warp_affine::{Filter, Outside, Source, WarpOptions, warp_affine, warp_affine_over};
use pegbar_nodes::algo::window::Window;
use std::hint::black_box;

const SIZE: [usize; 2] = [1920, 1080];

/// A disc of smooth colours with a soft edge, premultiplied.
fn picture() -> Vec<f32> {
    let pixel = |i: usize| {
        let (x, y) = ((i % SIZE[0]) as f32 / 1920.0, (i / SIZE[0]) as f32 / 1920.0);
        let a = ((0.25 - (x - 0.5).hypot(y - 0.28)) * 640.0).clamp(0.0, 1.0);
        [a * (0.5 + 0.4 * libm::sinf(40.0 * x)), a * (0.5 + 0.4 * libm::sinf(50.0 * y)), a * 0.3, a]
    };
    (0..SIZE[0] * SIZE[1]).flat_map(pixel).collect()
}

fn warps(c: &mut Criterion) {
    let data = picture();
    let Some(raster) = Raster::new(&data, SIZE[0], SIZE[1], 4) else { return };
    let source = Source::new(raster, [0, 0]);
    let window = Window::at_origin(SIZE[0], SIZE[1]);
    let mut out = vec![0.0; data.len()];
    let map = Affine::new(0.94, 0.09, 20.0, -0.12, 0.97, 120.0);
    for filter in [Filter::Bilinear, Filter::Cubic, Filter::Lanczos3] {
        let options = WarpOptions { filter, outside: Outside::Transparent, antialias: true };
        c.bench_function(&format!("warp {filter:?}"), |b| b.iter(|| warp_affine(source, black_box(&map), options, &mut out, window)));
    }
    let options = WarpOptions::default();
    c.bench_function("warp Bilinear, over, fused", |b| b.iter(|| warp_affine_over(source, black_box(&map), options, &mut out, window)));
    let half = Affine::new(0.5, 0.05, 20.0, -0.05, 0.5, 120.0);
    c.bench_function("warp Bilinear to a half", |b| b.iter(|| warp_affine(source, black_box(&half), options, &mut out, window)));
    let sheared = Affine::new(0.6, 0.25, 200.0, -0.1, 0.7, 150.0);
    for filter in [Filter::Bilinear, Filter::Cubic, Filter::Lanczos3] {
        let options = WarpOptions { filter, outside: Outside::Transparent, antialias: true };
        let name = format!("warp {filter:?}, sheared and shrunk");
        c.bench_function(&name, |b| b.iter(|| warp_affine(source, black_box(&sheared), options, &mut out, window)));
    }
}

fn merges(c: &mut Criterion) {
    let data = picture();
    let mut background = data.clone();
    c.bench_function("over", |b| b.iter(|| over_in_place(black_box(&data), &mut background, 4)));
}

fn filters(c: &mut Criterion) {
    let data = picture();
    let Some(raster) = Raster::new(&data, SIZE[0], SIZE[1], 4) else { return };
    let source = Source::new(raster, [0, 0]);
    let window = Window::at_origin(SIZE[0], SIZE[1]);
    let mut out = vec![0.0; data.len()];
    for sigma in [1.0, 5.0, 50.0] {
        let name = format!("blur {sigma}");
        c.bench_function(&name, |b| b.iter(|| gaussian_blur(source, black_box([sigma; 2]), Outside::Clamp, &mut out, window)));
    }
    let mut half = vec![0.0; data.len() / 4];
    c.bench_function("resize to a half by area", |b| {
        b.iter(|| resize(black_box(source), ResizeFilter::Area, &mut half, SIZE[0] / 2, SIZE[1] / 2))
    });
}

criterion_group!(pixels, warps, merges, filters);
criterion_main!(pixels);
