//! Time of a toon render, 1920 by 1080: about 50,000 triangles that cover a twentieth of the picture, in three bands by what each pixel's centre sees, on one
//! thread, and with outlines, creases and anti-aliasing on two. With `TOON_MESH=FOLDER` it is the mesh of that folder, so that another renderer can be timed
//! on the same: `pos.f32` and `nrm.f32` (x, y, z a vertex), `tri.u32`, and `cam.json` (`view` and `proj`, row by row).

use std::path::Path;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix4, Vector3};
use pegbar_nodes::algo::camera::{Camera, Orbit, perspective};
use pegbar_nodes::algo::silhouette::Lines;
use pegbar_nodes::algo::surface::{Part, Surface};
use pegbar_nodes::algo::toon::{Light, Paint, Pen, Style, render};

const SIZE: [usize; 2] = [1920, 1080];

struct Scene {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    camera: Camera,
}

/// A trefoil: a knotted tube, which hides parts of itself.
fn knot() -> Option<Scene> {
    let (along, around) = (500_u32, 50_u32);
    let tau = std::f64::consts::TAU;
    let middle = |t: f64| {
        let r = 2.0 + libm::cos(3.0 * t);
        Vector3::new(r * libm::cos(2.0 * t), r * libm::sin(2.0 * t), libm::sin(3.0 * t))
    };
    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..along {
        let t = tau * f64::from(i) / f64::from(along);
        let tangent = (middle(t + 1e-4) - middle(t - 1e-4)).normalize();
        let side = tangent.cross(&Vector3::z()).normalize();
        let up = side.cross(&tangent);
        for k in 0..around {
            let (sin, cos) = libm::sincos(tau * f64::from(k) / f64::from(around));
            let normal = side * cos + up * sin;
            positions.push((middle(t) + normal * 0.45).into());
            normals.push(normal.into());
            let at = |i: u32, k: u32| (i % along) * around + k % around;
            triangles.extend([[at(i, k), at(i + 1, k), at(i, k + 1)], [at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]]);
        }
    }
    let view = Orbit { target: [0.0; 3], azimuth: 0.3, elevation: 0.2, roll: 0.0, distance: 22.0 }.view();
    let camera = Camera::new(view, perspective(0.7, SIZE, 1.0, 100.0), SIZE.map(|n| n as i64)).ok()?;
    Some(Scene { positions, normals, triangles, camera })
}

fn read(folder: &Path) -> Option<Scene> {
    let bytes = |name: &str| std::fs::read(folder.join(name)).ok();
    let floats = |name: &str| -> Option<Vec<[f64; 3]>> {
        let number = |b: &[u8; 4]| f64::from(f32::from_le_bytes(*b));
        let all: Vec<f64> = bytes(name)?.as_chunks::<4>().0.iter().map(number).collect();
        Some(all.as_chunks::<3>().0.to_vec())
    };
    let corners: Vec<u32> = bytes("tri.u32")?.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    let seen: serde_json::Value = serde_json::from_slice(&bytes("cam.json")?).ok()?;
    let matrix = |name: &str| -> Option<Matrix4<f64>> {
        let rows: [[f64; 4]; 4] = serde_json::from_value(seen[name].clone()).ok()?;
        Some(Matrix4::from_fn(|row, column| rows[row][column]))
    };
    let camera = Camera::new(matrix("view")?, matrix("proj")?, SIZE.map(|n| n as i64)).ok()?;
    let triangles = corners.as_chunks::<3>().0.to_vec();
    Some(Scene { positions: floats("pos.f32")?, normals: floats("nrm.f32")?, triangles, camera })
}

fn style(lines: bool, threads: usize) -> Style<'static> {
    let pen = Pen { outline: 3.0, inner: 1.5, taper: 6.0, thin_far: 0.0, weight: 0.0, bias: 0.003, colour: [0.0, 0.0, 0.0, 1.0] };
    let shades = [0.25_f32, 0.5, 0.75].map(|k| [k; 3]).to_vec();
    Style {
        paint: Paint { base: vec![[0.9, 0.6, 0.35]], ..Paint::default() },
        light: Light {
            direction: Vector3::new(0.35, 0.5, 0.8).normalize(),
            thresholds: vec![1.0 / 3.0, 2.0 / 3.0],
            shades,
            highlight: None,
        },
        lines: lines.then_some((Lines { silhouettes: true, borders: true, crease: Some(0.7), seams: false, intersections: false }, pen)),
        round: None,
        antialias: lines,
        threads,
    }
}

fn renders(c: &mut Criterion) {
    let scene = std::env::var_os("TOON_MESH").map_or_else(knot, |folder| read(Path::new(&folder)));
    let Some(Scene { positions, normals, triangles, camera }) = scene else { return };
    let part = [Part { positions: &positions, triangles: &triangles, normals: &normals }];
    let (Ok(plain), Ok(joined)) = (Surface::without_edges(&part, 3.2), Surface::new(&part, 3.2)) else { return };
    let mut group = c.benchmark_group(format!("toon, {} triangles, 1920 x 1080", triangles.len()));
    group.sample_size(20);
    group.bench_function("bands, one thread", |b| {
        b.iter_batched(|| plain.clone(), |surface| render(surface, &camera, style(false, 1)), BatchSize::LargeInput)
    });
    group.bench_function("lines and anti-aliasing, two threads", |b| {
        b.iter_batched(|| joined.clone(), |surface| render(surface, &camera, style(true, 2)), BatchSize::LargeInput)
    });
    group.finish();
}

criterion_group!(benches, renders);
criterion_main!(benches);
