//! Thirty as-rigid-as-possible in-betweens of 500 and of 5000 triangles, from nothing, one thread: a bar of 25 by 10 (100 by 25) cells that bends
//! and swells. "paper" is unweighted, from the first key, with point 0 held; "default" is symmetric, by area.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use pegbar_nodes::algo::arap::{Arap, Gauge, Options};

type Points = Vec<[f64; 2]>;

fn bar(nx: u32, ny: u32) -> (Vec<[u32; 3]>, Points, Points) {
    let place = |i: u32, j: u32| [10.0 * f64::from(i) / f64::from(nx), 2.0 * f64::from(j) / f64::from(ny) - 1.0];
    let from: Points = (0..=ny).flat_map(|j| (0..=nx).map(move |i| place(i, j))).collect();
    let angle = 150_f64.to_radians();
    let bend = |p: &[f64; 2]| {
        let ((sin, cos), radius) = (libm::sincos(angle * p[0] / 10.0), 10.0 / angle - 1.2 * p[1]);
        [radius * sin + 0.25 * libm::sin(1.3 * p[0]), 10.0 / angle - radius * cos + 0.25 * libm::cos(0.9 * p[0] + p[1])]
    };
    let cells = (0..ny).flat_map(|j| (0..nx).map(move |i| j * (nx + 1) + i));
    let triangles = cells.flat_map(|a| [[a, a + 1, a + nx + 2], [a, a + nx + 2, a + nx + 1]]).collect();
    let to = from.iter().map(bend).collect();
    (triangles, from, to)
}

fn inbetweens(c: &mut Criterion) {
    let t: Vec<f64> = (0..30).map(|k| f64::from(k) / 29.0).collect();
    let paper = Options { symmetric: false, area_weights: false, gauge: Gauge::Vertex(0) };
    let mut group = c.benchmark_group("arap");
    for (n, (triangles, from, to)) in [(500, bar(25, 10)), (5000, bar(100, 25))] {
        for (name, options) in [("paper", paper), ("default", Options::default())] {
            let run = || Arap::new(&triangles, &[&from, &to], options).and_then(|a| a.between(black_box(&t)));
            group.bench_function(BenchmarkId::new(name, n), |b| b.iter(run));
        }
    }
}

criterion_group!(benches, inbetweens);
criterion_main!(benches);
