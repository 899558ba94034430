//! Time of one matte of a 1080p frame, of its parts, and of the fit.

use criterion::{Criterion, criterion_group, criterion_main};
use pegbar_nodes::algo::color;
use pegbar_nodes::algo::color_clusters::{Options, Seed, adapt, alpha, fit};
use pegbar_nodes::algo::raster::Raster;
use std::hint::black_box;

const WIDTH: usize = 1920;
const HEIGHT: usize = 1080;

/// A disc of two flat colours with an outline of ink, on waves of four colours with grain.
fn frame() -> Vec<f32> {
    let ground = [[0.24, 0.43, 0.27], [0.59, 0.67, 0.47], [0.47, 0.55, 0.7], [0.78, 0.74, 0.59]];
    let mut state = 1u32;
    let mut out = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for i in 0..WIDTH * HEIGHT {
        let (x, y) = ((i % WIDTH) as f32, (i / WIDTH) as f32);
        let radius = (x - 960.0).hypot(y - 540.0);
        let c: [f32; 3] = match radius {
            r if r > 330.0 => {
                let t = 1.5 + 0.7 * (x * 0.011 + 0.02 * y).sin() + 0.7 * (y * 0.013 - 0.017 * x).cos();
                let (k, f) = (t as usize, t.fract());
                std::array::from_fn(|c| ground[k][c] * (1.0 - f) + ground[k + 1][c] * f)
            }
            r if r > 322.0 => [0.08, 0.07, 0.07],
            _ if x > 1000.0 => [0.08, 0.15, 0.6],
            _ => [0.1, 0.2, 0.8],
        };
        for v in c {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let grain = ((state >> 8) as f32 / 16_777_216.0 - 0.5) * 0.03;
            out.push(color::linear_from_srgb_f32((v + grain).clamp(0.0, 1.0)));
        }
    }
    out
}

fn mattes(criterion: &mut Criterion) {
    let data = frame();
    let Some(image) = Raster::new(&data, WIDTH, HEIGHT, 3) else { return };
    let colours = [[0.1, 0.2, 0.8], [0.08, 0.15, 0.6]];
    let full = Options::default();
    let plain = Options { smoothness: 0.0, min_area: 0.0, fill_holes: 0.0, edge: 0.0, ink: 0.0, ..full.clone() };
    let mut out = vec![0.0; WIDTH * HEIGHT];
    let mut group = criterion.benchmark_group("color_clusters 1080p");
    group.sample_size(10);
    group.bench_function("fit", |b| b.iter(|| fit(black_box(image), Seed::Colours(&colours), &full)));
    for (name, options) in [("alpha", &full), ("alpha, posterior only", &plain)] {
        let Ok(model) = fit(image, Seed::Colours(&colours), options) else { return };
        group.bench_function(name, |b| b.iter(|| alpha(black_box(image), &model, options, &mut out)));
    }
    let Ok(model) = fit(image, Seed::Colours(&colours), &full) else { return };
    let Ok(_) = alpha(image, &model, &full, &mut out) else { return };
    group.bench_function("adapt", |b| b.iter(|| adapt(black_box(image), &out, &model, 0.5, &full)));
    group.finish();
}

criterion_group!(benches, mattes);
criterion_main!(benches);
