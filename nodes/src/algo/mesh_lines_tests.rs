use std::f64::consts::TAU;

use super::super::camera::{Orbit, orthographic, perspective};
use super::super::solids::{cube, sphere};
use super::*;

const SIZE: [usize; 2] = [512, 512];

fn camera(azimuth: f64, elevation: f64, in_perspective: bool) -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth, elevation, roll: 0.0, distance: 5.0 };
    let projection = if in_perspective { perspective(0.9, SIZE, 0.1, 100.0) } else { orthographic(100.0, SIZE, 0.1, 100.0) };
    Camera::new(orbit.view(), projection, SIZE.map(|n| n as i64)).unwrap()
}

fn search() -> Search {
    Search { lines: Lines { crease: None, ..Lines::default() }, hard: 1.0, subdivide: 0, smooth: 0 }
}

fn torus(major: f64, minor: f64, around: u32, up: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let at = |i: u32, j: u32| (i % around) * up + j % up;
    let place = |i: u32, j: u32| {
        let (u, v) = (TAU * f64::from(i) / f64::from(around), TAU * f64::from(j) / f64::from(up));
        let r = major + minor * v.cos();
        [r * u.sin(), minor * v.sin(), r * u.cos()]
    };
    let positions = (0..around).flat_map(|i| (0..up).map(move |j| place(i, j))).collect();
    let quads = (0..around).flat_map(|i| (0..up).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]));
    (positions, quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// Points of the curve where the torus about y turns away from the eye: for each angle around, n · (eye − p) = 0 is a cos v + b sin v = r.
fn torus_contour(camera: &Camera, major: f64, minor: f64) -> Vec<[f64; 2]> {
    let sight = camera.toward()(&Vector3::zeros());
    let mut out = Vec::new();
    for i in 0..3000 {
        let u = TAU * f64::from(i) / 3000.0;
        let outward = Vector3::new(u.sin(), 0.0, u.cos());
        let (a, b, r) =
            if camera.is_orthographic() { (sight.dot(&outward), sight.y, 0.0) } else { (sight.dot(&outward) - major, sight.y, minor) };
        let (phase, length) = (b.atan2(a), a.hypot(b));
        if r.abs() > length {
            continue;
        }
        for v in [phase + (r / length).acos(), phase - (r / length).acos()] {
            let p = outward * (major + minor * v.cos()) + Vector3::y() * (minor * v.sin());
            let [x, y, _] = camera.project(p.into());
            out.push([x, y]);
        }
    }
    out
}

/// The largest distance of any point of one set to the other, both ways.
fn hausdorff(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let way = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        a.iter().map(|p| b.iter().map(|q| distance(*p, *q)).fold(f64::INFINITY, f64::min)).fold(0.0, f64::max)
    };
    way(a, b).max(way(b, a))
}

/// Samples along lines, so many a pixel.
fn dense(lines: &[Line], density: f64) -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for line in lines {
        let n = line.points.len();
        for i in 0..if line.closed { n } else { n - 1 } {
            let (a, b) = (line.points[i].pixel, line.points[(i + 1) % n].pixel);
            let steps = (distance(a, b) * density).ceil().max(1.0) as usize;
            out.extend((0..steps).map(|k| [0, 1].map(|d| a[d] + (b[d] - a[d]) * k as f64 / steps as f64)));
        }
    }
    out
}

#[test]
fn the_outline_of_a_sphere_is_a_circle_and_closed() {
    let (positions, triangles) = sphere(96, 48);
    for in_perspective in [false, true] {
        let camera = camera(0.4, 0.3, in_perspective);
        let lines = find(&positions, &triangles, &camera, &search()).unwrap();
        assert_eq!((lines.len(), lines[0].closed), (1, true));
        // In perspective a sphere before the eye is a circle of focal length · tan(asin(1 / distance)).
        let radius = if in_perspective { 256.0 / 0.45_f64.tan() * (0.2_f64).asin().tan() } else { 100.0 };
        let truth: Vec<[f64; 2]> = (0..2000)
            .map(|i| {
                let (s, c) = (TAU * f64::from(i) / 2000.0).sin_cos();
                [256.0 + radius * c, 256.0 + radius * s]
            })
            .collect();
        let apart = hausdorff(&dense(&lines, 8.0), &truth);
        println!("sphere, perspective {in_perspective}: {apart:.3} px");
        assert!(apart < 0.3, "{apart}");
        for p in &lines[0].points {
            assert!(p.visible && p.outline, "{p:?}");
        }
    }
}

#[test]
fn the_outline_of_a_torus_meets_the_closed_form_and_its_numbers_stay_for_24_frames() {
    let (positions, triangles) = torus(1.2, 0.45, 160, 64);
    let (mut known, mut next, mut worst) = (Vec::<Known>::new(), 1, 0.0_f64);
    for frame in 0..24 {
        let camera = camera(0.3 + 0.05 * f64::from(frame), 0.75 + 0.01 * f64::from(frame), frame % 2 == 1);
        let lines = find(&positions, &triangles, &camera, &search()).unwrap();
        assert!(lines.len() == 2 && lines.iter().all(|l| l.closed), "frame {frame}: {} lines", lines.len());
        let apart = hausdorff(&dense(&lines, 1.0), &torus_contour(&camera, 1.2, 0.45));
        // Half a pixel of it lies between the samples.
        assert!(apart < 0.9, "frame {frame}: {apart}");
        worst = worst.max(apart);
        let ids = number(&lines, &known, next);
        assert_eq!(ids, [1, 2], "frame {frame}");
        next = next.max(3);
        known = lines
            .iter()
            .zip(ids)
            .map(|(l, id)| Known { id, kind: l.kind, positions: l.points.iter().map(|p| p.position).collect() })
            .collect();
    }
    println!("torus: {worst:.3} px at the worst of 24 frames");
}

#[test]
fn what_something_covers_is_not_seen() {
    let (mut positions, mut triangles) = sphere(64, 32);
    let n = positions.len() as u32;
    // A smaller one before it, and one behind it that looks out at one side.
    for (centre, radius) in [([0.0, 0.0, 2.0], 0.3), ([0.9, 0.0, -2.0], 0.5)] {
        let (more, faces) = sphere(64, 32);
        let start = positions.len() as u32;
        assert_eq!(more.len() as u32, n);
        positions.extend(more.into_iter().map(|p| [0, 1, 2].map(|k| p[k] * radius + centre[k])));
        triangles.extend(faces.into_iter().map(|t| t.map(|v| v + start)));
    }
    let lines = find(&positions, &triangles, &camera(0.0, 0.0, false), &search()).unwrap();
    let of = |start: u32| lines.iter().find(|l| l.points[0].edge[0] / n == start).unwrap();
    assert!(of(0).points.iter().all(|p| p.visible) && of(1).points.iter().all(|p| p.visible && !p.outline));
    for p in &of(2).points {
        let outside = (p.position.x * p.position.x + p.position.y * p.position.y).sqrt();
        if (outside - 1.0).abs() > 0.04 {
            assert_eq!(p.visible, outside > 1.0, "{}", p.position);
        }
    }
}

#[test]
fn creases_are_found_and_a_dense_search_ends_on_edges_of_the_mesh() {
    let (positions, triangles) = cube();
    let lines = Lines { silhouettes: true, borders: true, crease: Some(0.7), seams: false, intersections: false };
    let found = find(&positions, &triangles, &camera(0.5, 0.4, false), &Search { lines, ..search() }).unwrap();
    let ridge: usize = found.iter().filter(|l| l.kind == Kind::Crease).map(|l| l.points.len() - 1).sum();
    assert_eq!(ridge, 6, "three edges before, three behind, the other six are the outline");
    let dense = Search { lines: Lines { crease: None, ..lines }, hard: 3.2, subdivide: 3, smooth: 1 };
    let (positions, triangles) = sphere(12, 6);
    let found = find(&positions, &triangles, &camera(0.5, 0.4, false), &dense).unwrap();
    assert!(found[0].closed && found[0].points.len() > 8);
    let is_edge = |e: [u32; 2]| e[0] == e[1] || triangles.iter().any(|t| t.contains(&e[0]) && t.contains(&e[1]));
    assert!(found.iter().flat_map(|l| &l.points).all(|p| is_edge(p.edge) && (0.0..=1.0).contains(&p.share)));
    let error = find(&positions, &triangles, &camera(0.5, 0.4, false), &Search { subdivide: 12, ..dense }).unwrap_err().to_string();
    assert!(error.starts_with("expected at most 4194304 triangles after subdivision"), "{error}");
}

#[test]
fn where_a_ball_runs_through_a_cube_there_are_circles_seen_from_before() {
    let (mut positions, mut triangles) = sphere(96, 64);
    let (block, faces) = cube();
    let n = positions.len() as u32;
    positions.iter_mut().for_each(|p| *p = p.map(|v| v * 1.25));
    positions.extend(block);
    triangles.extend(faces.iter().map(|t| t.map(|v| v + n)));
    let camera = camera(0.5, 0.4, false);
    let lines = Lines { silhouettes: false, borders: false, crease: None, seams: false, intersections: true };
    let found = find(&positions, &triangles, &camera, &Search { lines, ..search() }).unwrap();
    assert_eq!(found.iter().map(|l| (l.kind, l.closed)).collect::<Vec<_>>(), [(Kind::Intersection, true); 6]);
    let toward = camera.toward();
    for line in &found {
        // On the face that the circle lies in, of radius 0.75.
        let axis = (0..3).find(|&k| line.points.iter().all(|p| (p.position[k].abs() - 1.0).abs() < 1e-9)).unwrap();
        let face = toward(&line.points[0].position)[axis] * line.points[0].position[axis] > 0.0;
        for p in &line.points {
            assert!((p.position.norm() - 1.25).abs() < 3e-3);
            let out = p.position.dot(&toward(&p.position));
            assert!(!p.visible || face && out > -0.05, "{}", p.position);
            assert!(p.visible || !face || out < 0.05, "{}", p.position);
        }
    }
}

#[test]
fn numbers_go_with_the_lines_and_are_never_given_twice() {
    let line = |x: f64| Line {
        kind: Kind::Silhouette,
        closed: false,
        points: (0..5)
            .map(|i| LinePoint {
                edge: [0; 2],
                share: 0.0,
                position: Vector3::new(x, f64::from(i), 0.0),
                pixel: [0.0; 2],
                visible: true,
                outline: true,
            })
            .collect(),
    };
    let known = |id: i64, x: f64| Known { id, kind: Kind::Silhouette, positions: line(x).points.iter().map(|p| p.position).collect() };
    let before = [known(7, 0.0), known(4, 10.0)];
    assert_eq!(number(&[line(9.0), line(1.0)], &before, 8), [4, 7]);
    assert_eq!(number(&[line(9.0), line(9.5), line(0.5)], &before, 8), [4, 8, 7], "the first of equals keeps the number");
    assert_eq!(number(&[line(0.0)], &[Known { kind: Kind::Crease, ..known(7, 0.0) }], 8), [8]);
}

#[test]
fn places_lie_between_others_on_the_same_edge_only() {
    assert_eq!(between(([4, 4], 0.0), ([2, 2], 0.0), 0.25), Some(([2, 4], 0.75)));
    assert_eq!(between(([2, 4], 0.5), ([4, 2], 0.0), 0.5), Some(([2, 4], 0.75)));
    assert_eq!(between(([2, 4], 0.5), ([2, 2], 0.0), 1.0), Some(([2, 2], 0.0)));
    assert_eq!(between(([2, 4], 0.5), ([2, 5], 0.5), 0.5), None);
}

/// Cubes from −1 to 1, scaled and moved.
fn cubes(placed: &[([f64; 3], [f64; 3])]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (scale, at) in placed {
        let (own, faces) = cube();
        let start = positions.len() as u32;
        positions.extend(own.into_iter().map(|p| [0, 1, 2].map(|k| p[k] * scale[k] + at[k])));
        triangles.extend(faces.into_iter().map(|t| t.map(|v| v + start)));
    }
    (positions, triangles)
}

/// The parts of lines that are seen, by both ends of each segment.
fn shown(lines: &[Line]) -> Vec<[[f64; 2]; 2]> {
    let mut out = Vec::new();
    for line in lines {
        let n = line.points.len();
        for i in 0..if line.closed { n } else { n - 1 } {
            let (a, b) = (line.points[i], line.points[(i + 1) % n]);
            if a.visible && b.visible {
                out.push([a.pixel, b.pixel]);
            }
        }
    }
    out
}

#[test]
fn long_edges_are_cut_where_they_go_behind_something() {
    // A beam behind a block: each of its long edges is one edge of the mesh, whose middle the block hides. A bolt sunk two ten-thousandths into the block.
    let (positions, triangles) = cubes(&[([1.9, 0.3, 0.1], [0.0, 0.0, -1.0]), ([0.7; 3], [0.0; 3]), ([0.1, 0.1, 0.1], [0.2, 0.1, 0.5998])]);
    for in_perspective in [false, true] {
        let camera = camera(0.0, 0.0, in_perspective);
        let lines = find(&positions, &triangles, &camera, &Search { hard: 0.0, ..search() }).unwrap();
        let [left, _, _] = camera.project([-0.7, 0.3, 0.7]);
        let [right, upper, _] = camera.project([0.7, 0.7, 0.7]);
        let beam = lines.iter().filter(|l| l.points[0].edge[0] < 8).cloned().collect::<Vec<_>>();
        let shown = shown(&beam);
        let within = |p: [f64; 2]| p[0] > left + 1e-4 && p[0] < right - 1e-4 && p[1] > upper;
        assert!(!shown.is_empty() && !shown.iter().flatten().any(|p| within(*p)), "{shown:?}");
        for x in [left, right] {
            let ends = shown.iter().flatten().filter(|p| (p[0] - x).abs() < 1e-4).count();
            assert_eq!(ends, 2, "the upper and the lower edge end at column {x}: {shown:?}");
        }
        // All that is seen of the bolt is nothing.
        assert!(lines.iter().filter(|l| l.points[0].edge[0] >= 16).all(|l| l.points.iter().all(|p| !p.visible)));
        // What is cut lies on the mesh where it is said to.
        for p in lines.iter().flat_map(|l| &l.points) {
            let [a, b] = p.edge.map(|v| Vector3::from(positions[v as usize]));
            let [x, y, _] = camera.project((a + (b - a) * p.share).into());
            assert!(distance([x, y], p.pixel) < 1e-9, "{p:?}");
        }
    }
}
