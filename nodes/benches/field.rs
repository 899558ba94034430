//! Time of a free-form deformation of 2,000 points and of its displacements at every pixel of 1920 by 1080, and of skinning 100,000 vertices by four of sixty
//! joints each, one thread. The points have the smooth displacements of the ITK comparison: seven levels, from 4 by 3 cells to 256 by 192.
//! Composed, added and by ITK the points end 0.0003 px off in the mean, and 0.027, 0.029 and 0.026 px at the worst: no one does less than the others.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Matrix4, Rotation3};
use pegbar_nodes::algo::mffd::{Combine, Datum, Ffd, Options};
use pegbar_nodes::algo::skin::Skin;
use std::hint::black_box;

struct Rng(u64);

impl Rng {
    /// In 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn field([x, y]: [f64; 2]) -> [f64; 2] {
    let bump = |cx: f64, cy: f64, w: f64, h: f64| (-((x - cx) / w).powi(2) - ((y - cy) / h).powi(2)).exp();
    let u =
        30.0 * (x / 310.0 + 0.4).sin() * (y / 260.0).cos() + 12.0 * ((x + 2.0 * y) / 170.0).sin() + 18.0 * bump(700.0, 480.0, 90.0, 70.0);
    let v =
        22.0 * (x / 280.0).cos() * (y / 330.0 + 0.9).sin() + 9.0 * ((2.0 * x - y) / 150.0).cos() - 15.0 * bump(1200.0, 620.0, 80.0, 110.0);
    [x + u, y + v]
}

fn deformations(c: &mut Criterion) {
    let mut rng = Rng(7);
    let data: Vec<Datum> = (0..2000)
        .map(|k| {
            let from = [f64::from(k % 60) * 32.0 + 32.0 * rng.next(), f64::from(k / 60) * 31.8 + 31.8 * rng.next()];
            Datum { from, to: field(from), weight: 1.0 }
        })
        .collect();
    for (name, combine) in [("composed", Combine::Composed), ("added", Combine::Added)] {
        let options = Options { combine, cells: [4, 3], levels: 7, repeats: 8, tolerance: 0.03 };
        c.bench_function(&format!("free-form deformation, 2000 points, 7 levels {name}, 1920 x 1080"), |b| {
            b.iter(|| {
                let fitted = Ffd::fit(black_box(&data), [-1.0, -1.0, 1921.0, 1081.0], &options);
                fitted.map(|(ffd, _)| ffd.displacements([0.5, 0.5], [1920, 1080]))
            });
        });
    }
}

fn skinning(c: &mut Criterion) {
    let (n, mut rng) = (100_000, Rng(3));
    let positions: Vec<[f64; 3]> = (0..n).map(|_| [rng.next(), rng.next(), rng.next()]).collect();
    let joints: Vec<u32> = (0..n).flat_map(|v| (0..4).map(move |k| (v * 56 / n) as u32 + k)).collect();
    let weights: Vec<f64> = (0..4 * n).map(|_| rng.next() + 0.1).collect();
    let turn = |k: u32| Rotation3::from_euler_angles(0.1 * f64::from(k), 0.2, 0.3).to_homogeneous();
    let motions: Vec<Matrix4<f64>> = (0..60).map(turn).collect();
    let Ok(skin) = Skin::new(&positions, &[], 4, &joints, &weights, 60) else { return };
    for (name, narrow) in [("32", true), ("64", false)] {
        c.bench_function(&format!("skinning, 100000 vertices, {name} bits, one frame"), |b| {
            b.iter(|| skin.pose(black_box(&motions), narrow))
        });
    }
    // In 32 bits a vertex moves 34 bytes in (12 of place, 16 of weights, its number and its group's joints) and 24 out, 5.8 MB a frame. What the memory
    // can do, as STREAM counts it: bytes read and written of a copy far larger than the caches.
    let (from, mut to) = (vec![1_u8; 1 << 27], vec![0_u8; 1 << 27]);
    let mut group = c.benchmark_group("memory");
    group.throughput(Throughput::Bytes(2 << 27));
    group.bench_function("copy of 128 MiB", |b| b.iter(|| to.copy_from_slice(black_box(&from))));
}

criterion_group!(benches, deformations, skinning);
criterion_main!(benches);
