//! Coverage, depth, bands and lines against closed forms.

use nalgebra::Vector3;

use super::*;
use crate::algo::camera::{Orbit, orthographic, perspective};
use crate::algo::paint::{FillRule, coverage as painted};
use crate::algo::solids::{Solid, cube, sphere};
use crate::algo::surface::Part;

const SIZE: [usize; 2] = [120, 100];

/// Straight ahead at the origin from 5 away, 40 pixels a metre.
fn flat() -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 5.0 };
    Camera::new(orbit.view(), orthographic(40.0, SIZE, 0.1, 100.0), [120, 100]).unwrap()
}

fn lens() -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.4, elevation: 0.3, roll: 0.0, distance: 5.0 };
    Camera::new(orbit.view(), perspective(0.6, SIZE, 0.1, 100.0), [120, 100]).unwrap()
}

fn surface(solids: &[&Solid]) -> Surface {
    let parts: Vec<Part<'_>> = solids.iter().map(|(p, t)| Part { positions: p, triangles: t, normals: &[] }).collect();
    Surface::new(&parts, 1.0).unwrap()
}

fn style() -> Style<'static> {
    let light = Light { direction: Vector3::z(), thresholds: vec![0.5], shades: vec![[0.5; 3], [1.0; 3]], highlight: None };
    let paint = Paint { base: vec![[1.0, 0.5, 0.25], [0.0, 1.0, 0.0]], ..Paint::default() };
    Style { paint, light, lines: None, round: None, antialias: true, threads: 1 }
}

const INK: Pen = Pen { outline: 3.0, inner: 2.0, taper: 6.0, thin_far: 0.5, weight: 0.3, bias: 0.003, colour: [0.0, 0.0, 0.0, 1.0] };

fn alpha(render: &Render) -> Vec<f32> {
    render.image.chunks_exact(4).map(|p| p[3]).collect()
}

fn worst(found: &[f32], truth: &[f32]) -> f32 {
    found.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// The area of a polygon within a pixel, by cutting it at the pixel's four sides.
fn pixel_area(polygon: &[[f64; 2]], x: f64, y: f64) -> f64 {
    let mut p = polygon.to_vec();
    for (axis, sign, limit) in [(0, 1.0, x), (0, -1.0, x + 1.0), (1, 1.0, y), (1, -1.0, y + 1.0)] {
        let inside = |q: &[f64; 2]| sign * (q[axis] - limit);
        let mut next = Vec::new();
        for i in 0..p.len() {
            let (a, b) = (p[(i + p.len() - 1) % p.len()], p[i]);
            let (da, db) = (inside(&a), inside(&b));
            if (da >= 0.0) != (db >= 0.0) {
                next.push([0, 1].map(|k| a[k] + (b[k] - a[k]) * da / (da - db)));
            }
            if db >= 0.0 {
                next.push(b);
            }
        }
        p = next;
    }
    let cross = |i: usize| p[i][0] * p[(i + 1) % p.len()][1] - p[i][1] * p[(i + 1) % p.len()][0];
    (0..p.len()).map(cross).sum::<f64>().abs() / 2.0
}

#[test]
fn a_triangle_covers_what_it_covers() {
    let camera = flat();
    for (i, z) in [(0, 0.0), (1, 1.0), (2, -2.0)] {
        let tilt = f64::from(i) * 0.7;
        let corners = [[-1.2, -0.9, z], [1.31, -0.4 + tilt, z + 0.5], [-0.3 + tilt, 1.02, z - 0.2]];
        let render = render(surface(&[&(corners.to_vec(), vec![[0, 1, 2]])]), &camera, style());
        let screen = corners.map(|c| camera.project(c)).map(|[x, y, _]| [x, y]);
        let truth: Vec<f32> = (0..12000).map(|p| pixel_area(&screen, f64::from(p % 120), f64::from(p / 120)) as f32).collect();
        assert!(worst(&alpha(&render), &truth) < 1e-5);
    }
}

#[test]
fn slivers_thinner_than_a_sample_are_there() {
    let corners = vec![[-1.0, 0.0012, 0.0], [1.0, 0.004, 0.0], [-1.0, 0.0036, 0.0]];
    let render = render(surface(&[&(corners, vec![[0, 1, 2]])]), &flat(), style());
    let sum: f32 = alpha(&render).iter().sum();
    assert!((sum - 0.0024 * 40.0 * 80.0 / 2.0).abs() < 1e-4, "found {sum}");
    assert!(render.image.chunks_exact(4).filter(|p| p[3] > 0.0).all(|p| (p[0] / p[3] - 1.0).abs() < 1e-5));
}

#[test]
fn a_sphere_covers_a_disc() {
    let ball = surface(&[&sphere(64, 48)]);
    let render = render(ball, &flat(), Style { round: Some(0.002), ..style() });
    let disc = kurbo::Shape::to_path(&kurbo::Circle::new((60.0, 50.0), 40.0), 1e-6);
    let found = worst(&alpha(&render), &painted(&disc, FillRule::NonZero, 120, 100));
    assert!(found <= 1.0 / 255.0, "found {found}");
}

#[test]
fn bands_end_where_the_light_says() {
    let render = render(surface(&[&sphere(64, 48)]), &flat(), Style { round: Some(0.01), ..style() });
    let mut lit = 0;
    for y in 0..100_usize {
        for x in 0..120_usize {
            let (dx, dy) = ((x as f64 + 0.5 - 60.0) / 40.0, (y as f64 + 0.5 - 50.0) / 40.0);
            let r = (dx * dx + dy * dy).sqrt();
            // n · z is √(1 − r²): half at r = 0.866. A pixel is 0.025 wide.
            if r > 0.96 || (r - 0.866).abs() < 0.03 {
                continue;
            }
            let shade = if r < 0.866 { 1.0 } else { 0.5 };
            lit += 1;
            let off = worst(&render.image[4 * (y * 120 + x)..][..4], &[shade, 0.5 * shade, 0.25 * shade, 1.0]);
            assert!(off < 1e-6, "pixel {x}, {y}");
        }
    }
    assert!(lit > 3000);
}

#[test]
fn depth_is_that_along_the_axis() {
    let camera = lens();
    let corners = [[-0.9, -0.9, 0.3], [1.3, -0.4, 0.5], [-0.3, 1.0, -0.2]];
    let render = render(surface(&[&(corners.to_vec(), vec![[0, 1, 2]])]), &camera, style());
    let world = camera.clip_from_world().try_inverse().unwrap();
    let normal = Vector3::from([0, 1, 2].map(|k| corners[1][k] - corners[0][k]))
        .cross(&Vector3::from([0, 1, 2].map(|k| corners[2][k] - corners[0][k])));
    let mut seen = 0;
    for (i, &depth) in render.depth.iter().enumerate().filter(|(i, _)| render.image[4 * i + 3] == 1.0) {
        // The ray through the pixel's centre meets the plane.
        let ndc = [(i % 120) as f64 + 0.5, (i / 120) as f64 + 0.5];
        let at = |z: f64| {
            let p = world * nalgebra::Vector4::new(ndc[0] / 60.0 - 1.0, 1.0 - ndc[1] / 50.0, z, 1.0);
            p.xyz() / p.w
        };
        let (a, b) = (at(-1.0), at(0.9));
        let t = normal.dot(&(Vector3::from(corners[0]) - a)) / normal.dot(&(b - a));
        let truth = camera.project((a + (b - a) * t).into())[2];
        assert!((f64::from(depth) - truth).abs() < 1e-4, "expected {truth}, found {depth}");
        seen += 1;
    }
    assert!(seen > 500);
}

#[test]
fn the_nearer_part_is_seen_with_its_number() {
    let (ball, mut block) = (sphere(24, 16), cube());
    block.0.iter_mut().for_each(|p| *p = [p[0] * 0.2, p[1] * 0.2, p[2] * 0.2 + 2.0]);
    let render = render(surface(&[&ball, &block]), &flat(), style());
    let at = |x: usize, y: usize| (render.id[y * 120 + x], render.depth[y * 120 + x]);
    assert_eq!(at(60, 50), (2.0, 2.8));
    assert_eq!(at(80, 50).0, 1.0);
    assert_eq!(at(2, 2), (0.0, 0.0));
    assert_eq!(render.image[4 * (50 * 120 + 60)..][..4], [0.0, 1.0, 0.0, 1.0]);
}

#[test]
fn colours_mix_where_they_meet() {
    // Two half planes that meet at column 60.3: a third of that pixel is the left one's.
    let square = |x0: f64, x1: f64| (vec![[x0, -1.0, 0.0], [x1, -1.0, 0.0], [x1, 1.0, 0.0], [x0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 3]]);
    let (left, right) = (square(-1.0, 0.3 / 40.0), square(0.3 / 40.0, 1.0));
    let render = render(surface(&[&left, &right]), &flat(), style());
    let pixel = &render.image[4 * (50 * 120 + 60)..][..4];
    // Sixteen samples have a column each: five of them lie left of 0.3.
    assert_eq!(pixel, [5.0 / 16.0, 0.5 * 5.0 / 16.0 + 11.0 / 16.0, 0.25 * 5.0 / 16.0, 1.0]);
}

#[test]
fn a_texture_lies_where_its_coordinates_say() {
    let square = (vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 3]]);
    let picture: Vec<f32> = (0..16).flat_map(|i| [(i % 4) as f32 / 4.0, (i / 4) as f32 / 4.0, 0.0, 1.0]).collect();
    let texture = Texture::new(&picture, 4, 4).unwrap();
    let uvs = vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let paint = Paint { base: vec![[1.0; 3]], uvs, textures: vec![Some(&texture)], ..Paint::default() };
    let render = render(surface(&[&square]), &flat(), Style { paint, ..style() });
    for (i, j) in (0..4).flat_map(|j| (0..4).map(move |i| (i, j))) {
        // The square is 80 pixels wide, from 20, 10 on; centres of the texture's pixels lie between two of the picture's.
        let at = |dx: usize| render.image[4 * ((10 + 20 * j + 9 + dx) * 120 + 20 + 20 * i + 9 + dx)..][..3].to_vec();
        let mean: Vec<f32> = at(0).iter().zip(at(1)).map(|(a, b)| (a + b) / 2.0).collect();
        assert!((mean[0] - i as f32 / 4.0).abs() < 0.03 && (mean[1] - j as f32 / 4.0).abs() < 0.03, "{i}, {j}: {mean:?}");
    }
}

#[test]
fn a_highlight_is_a_disc_where_light_is_mirrored() {
    let spot = Highlight { cos: 0.2_f64.cos(), strength: 1.0, colour: [9.0; 3] };
    let light = Light { highlight: Some(spot), ..style().light };
    let render = render(surface(&[&sphere(96, 64)]), &flat(), Style { light, ..style() });
    // Light and eye are one, so that the spot is the cap within 0.2 radians: a disc of radius sin 0.2.
    let found = render.image.chunks_exact(4).filter(|p| p[0] > 5.0).count() as f64;
    let truth = std::f64::consts::PI * (40.0 * 0.2_f64.sin()).powi(2);
    assert!((found - truth).abs() < 12.0, "expected {truth}, found {found}");
}

#[test]
fn the_outline_of_a_sphere_is_a_ring_of_ink() {
    let style = Style { lines: Some((Lines::default(), Pen { thin_far: 0.0, weight: 0.0, ..INK })), round: Some(0.25), ..style() };
    let render = render(surface(&[&sphere(20, 14)]), &flat(), style);
    let ink = |x: f64, y: f64| {
        let i = 4 * (y.floor() as usize * 120 + x.floor() as usize);
        render.image[i + 3] - render.image[i]
    };
    for k in 0..360 {
        let (s, c) = f64::from(k).to_radians().sin_cos();
        // The pen is 3 pixels wide: its middle is within half a pixel of the circle everywhere.
        assert!(ink(60.0 + 40.0 * c, 50.0 + 40.0 * s) > 0.9, "gap at {k} degrees");
        assert!(ink(60.0 + 42.8 * c, 50.0 + 42.8 * s) < 0.1, "blot outside at {k} degrees");
        assert!(ink(60.0 + 37.0 * c, 50.0 + 37.0 * s).abs() < 0.6, "blot inside at {k} degrees");
    }
    let total: f32 = render.image.chunks_exact(4).map(|p| p[3]).sum();
    let truth = std::f32::consts::PI * 41.5 * 41.5;
    assert!((total - truth).abs() < 60.0, "expected {truth}, found {total}");
}

#[test]
fn the_outermost_outline_of_coarse_meshes_has_no_gap() {
    // Lumps, every other triangle of which is flat, and the rest as round as they are: where both meet a line leaves the edge, and goes where it is hidden.
    let lump = |around: u32, up: u32, by: f64| {
        let (mut round, triangles) = sphere(around, up);
        for (i, p) in round.iter_mut().enumerate() {
            let r = 1.0 + 0.25 * libm::sin(by * (i * i) as f64);
            *p = p.map(|v| v * r);
        }
        let (mut positions, mut normals) = (Vec::<[f64; 3]>::new(), Vec::<[f64; 3]>::new());
        for (n, t) in triangles.iter().enumerate() {
            let corners = t.map(|v| Vector3::from(round[v as usize]));
            let flat = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
            for p in corners {
                positions.push(p.into());
                normals.push(if n % 2 == 0 { flat.into() } else { p.normalize().into() });
            }
        }
        (positions, normals)
    };
    let meshes = [lump(6, 4, 1.7), lump(8, 5, 2.3), lump(9, 7, 0.9), lump(12, 9, 3.1)];
    for (k, (positions, normals)) in meshes.iter().enumerate() {
        let triangles: Vec<[u32; 3]> = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let surface = || Surface::new(&[Part { positions, triangles: &triangles, normals }], 1.0).unwrap();
        for view in 0..12 {
            let (azimuth, elevation) = (0.55 * f64::from(view), 0.15 * f64::from(view % 5));
            let orbit = Orbit { target: [0.0; 3], azimuth, elevation, roll: 0.0, distance: 5.0 };
            let camera = Camera::new(orbit.view(), orthographic(30.0, SIZE, 0.1, 100.0), [120, 100]).unwrap();
            let pen = Pen { thin_far: 0.0, weight: 0.0, bias: 0.0, ..INK };
            let cover = alpha(&render(surface(), &camera, style()));
            let drawn = render(surface(), &camera, Style { lines: Some((Lines::default(), pen)), ..style() });
            let is_ink = |x: usize, y: usize| drawn.image[4 * (y * 120 + x)] < 0.25 && drawn.image[4 * (y * 120 + x) + 3] > 0.9;
            for (i, cover) in cover.iter().enumerate().filter(|(_, cover)| (0.3..0.7).contains(*cover)) {
                let (x, y) = (i % 120, i / 120);
                let inked = (y - 3..=y + 3).any(|y| (x - 3..=x + 3).any(|x| is_ink(x, y)));
                assert!(inked, "mesh {k}, view {view}: nothing at {x}, {y}, which is covered by {cover}");
            }
        }
    }
}

#[test]
fn hidden_lines_are_not_drawn() {
    // A cube in a larger one.
    let (outer, mut inner) = (cube(), cube());
    inner.0.iter_mut().for_each(|p| *p = p.map(|v| v * 0.7));
    let style = || Style { lines: Some((Lines::default(), INK)), ..style() };
    let with = render(surface(&[&outer, &inner]), &lens(), style());
    let without = render(surface(&[&outer]), &lens(), style());
    // The pen thins with the depth of the middle, which both share.
    assert!(worst(&with.image, &without.image) < 1e-6);
    let dark = |r: &Render| r.image.chunks_exact(4).filter(|p| p[3] == 1.0 && p[0] < 0.1).count();
    assert!(dark(&without) > 300, "found {}", dark(&without));
}

#[test]
fn two_balls_that_run_through_each_other_have_a_line_where_it_is_seen() {
    let shift = Vector3::new(0.5, 0.2, 0.6);
    let (ball, mut other) = (sphere(120, 90), sphere(110, 80));
    other.0.iter_mut().for_each(|p| *p = [0, 1, 2].map(|k| p[k] * 0.8 + shift[k]));
    let drawn = |intersections: bool| {
        let lines = Lines { silhouettes: false, borders: false, crease: None, seams: false, intersections };
        let pen = Pen { thin_far: 0.0, weight: 0.0, taper: 0.0, ..INK };
        render(surface(&[&ball, &other]), &flat(), Style { lines: Some((lines, pen)), ..style() })
    };
    let (with, without) = (drawn(true), drawn(false));
    let ink: Vec<f32> = with.image.chunks_exact(4).zip(without.image.chunks_exact(4)).map(|(a, b)| worst(a, b)).collect();
    // The circle on both: centre and radius by the cosine rule. A place of it is seen where both balls face the eye, and the one does not hide it.
    let far = shift.norm();
    let along = (far * far + 1.0 - 0.64) / (2.0 * far);
    let radius = (1.0 - along * along).sqrt();
    let axis = shift / far;
    let u = axis.cross(&Vector3::z()).normalize();
    let v = axis.cross(&u);
    let circle = (0..720).map(|k| {
        let (s, c) = (f64::from(k) / 2.0).to_radians().sin_cos();
        axis * along + (u * c + v * s) * radius
    });
    let seen: Vec<([f64; 2], f64)> = circle.map(|p| ([60.0 + 40.0 * p.x, 50.0 - 40.0 * p.y], p.z.min((p.z - shift.z) / 0.8))).collect();
    assert!(seen.iter().any(|s| s.1 > 0.3) && seen.iter().any(|s| s.1 < -0.3));
    for (at, facing) in &seen {
        let found = ink[at[1].floor() as usize * 120 + at[0].floor() as usize];
        assert!(*facing < 0.05 || found > 0.4, "gap at {at:?}");
    }
    for (i, _) in ink.iter().enumerate().filter(|(_, ink)| **ink > 0.05) {
        let at = [(i % 120) as f64 + 0.5, (i / 120) as f64 + 0.5];
        let near = |s: &([f64; 2], f64)| s.1 > -0.05 && (s.0[0] - at[0]).hypot(s.0[1] - at[1]) < 2.5;
        assert!(seen.iter().any(near), "blot at {at:?}");
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let mut block = cube();
    block.0.iter_mut().for_each(|p| *p = [p[0] * 0.6 + 0.5, p[1] * 0.6, p[2] * 0.6 + 0.4]);
    let drawn = |threads: usize| {
        let style = Style { lines: Some((Lines::default(), INK)), round: Some(0.25), threads, ..style() };
        render(surface(&[&sphere(20, 14), &block]), &lens(), style)
    };
    let one = drawn(1);
    for threads in [2, 3, 7] {
        assert!(drawn(threads) == one, "{threads} threads");
    }
}

#[test]
fn a_floor_that_runs_behind_the_eye_fills_what_it_fills() {
    let floor =
        (vec![[-400.0, -1.0, -400.0], [400.0, -1.0, -400.0], [400.0, -1.0, 400.0], [-400.0, -1.0, 400.0]], vec![[0, 2, 1], [0, 3, 2]]);
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 5.0 };
    let camera = Camera::new(orbit.view(), perspective(0.8, SIZE, 0.1, 1000.0), [120, 100]).unwrap();
    let style = Style { lines: Some((Lines::default(), INK)), round: Some(0.25), ..style() };
    let render = render(surface(&[&floor]), &camera, style);
    let cover = alpha(&render);
    // Level with the horizon in the middle: its far rim lies 1 / 405 of the depth below.
    assert!((0..48).all(|y| cover[y * 120..][..120].iter().all(|&a| a == 0.0)));
    assert!((53..100).all(|y| cover[y * 120..][..120].iter().all(|&a| (a - 1.0).abs() < 1e-6)));
    // At row 75 a pixel's centre is 25.5 below the middle.
    let truth = 50.0 / (0.4_f32.tan() * 25.5);
    assert!((render.depth[75 * 120 + 60] - truth).abs() < 1e-3, "found {}", render.depth[75 * 120 + 60]);
}

#[test]
fn nothing_and_triangles_that_are_none_draw_nothing() {
    let style = || Style { lines: Some((Lines::default(), INK)), round: Some(0.25), ..style() };
    let empty = render(Surface::default(), &flat(), style());
    assert!(empty.image.len() == 48000 && empty.image.iter().all(|&v| v == 0.0));
    let points = vec![[0.0; 3], [0.5, 0.5, 0.0], [1.0, 1.0, 0.0]];
    let none = render(surface(&[&(points.clone(), vec![[0, 1, 2], [0, 0, 1], [2, 2, 2]])]), &flat(), Style { lines: None, ..style() });
    assert!(none.image.iter().all(|&v| v == 0.0));
    render(surface(&[&(points, vec![[0, 1, 2], [0, 0, 1], [2, 2, 2]])]), &lens(), style());
}

#[test]
fn without_antialiasing_a_pixel_is_what_its_centre_sees() {
    let render = render(surface(&[&sphere(32, 24)]), &flat(), Style { antialias: false, ..style() });
    assert!(alpha(&render).iter().all(|&a| a == 0.0 || a == 1.0));
    let count: f32 = alpha(&render).iter().sum();
    assert!((count - std::f32::consts::PI * 1600.0).abs() < 60.0, "found {count}");
}
