use std::sync::Arc;

use pegbar_engine::node::{Cancel, Context, In, NodeError, PerFrame, Recurrent};

use super::silhouette::MeshSilhouetteOutputs;
use super::*;
use crate::algo::camera::{Camera as AlgoCamera, Orbit, orthographic};
use crate::algo::fairing::volume;
use crate::counted::clock;
use crate::data::{Camera, Mesh};

/// A vase of rings: the cross-section turns about y, wavy so that it has lines inside.
fn vase(shift: f64) -> Mesh {
    let radius = |j: usize| 0.6 + 0.25 * (j as f64 * 0.45).sin();
    let point = |j: usize, i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / 40.0).sin_cos();
        [radius(j) * s + shift, 0.1 * j as f64 - 1.0, radius(j) * c]
    };
    let positions = (0..21).flat_map(|j| (0..40).map(move |i| point(j, i))).collect();
    let at = |j: usize, i: usize| (j * 40 + i % 40) as u32;
    let quads = (0..20).flat_map(|j| (0..40).map(move |i| [at(j, i), at(j, i + 1), at(j + 1, i + 1), at(j + 1, i)]));
    Mesh { positions, triangles: Arc::new(quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()), ..Mesh::default() }
}

fn camera() -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.3, elevation: 0.4, roll: 0.0, distance: 5.0 };
    Camera::from(&AlgoCamera::new(orbit.view(), orthographic(80.0, [300, 260], 0.1, 100.0), [300, 260]).unwrap())
}

fn node(mesh: Mesh) -> MeshSilhouette {
    MeshSilhouette {
        mesh: In::new(mesh),
        camera: In::new(camera()),
        silhouettes: true,
        borders: true,
        crease_deg: 180.0,
        intersections: false,
        hard_deg: 60.0,
        subdivide: 0,
        smooth: 0,
        visible_only: false,
        min_length: 0.0,
        follow: true,
    }
}

fn run(node: MeshSilhouette, state: Option<&silhouette::LineState>) -> Result<(MeshSilhouetteOutputs, silhouette::LineState), NodeError> {
    let clock = clock(24);
    node.run(state, &Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

#[test]
fn lines_come_with_kinds_places_and_numbers_that_stay() {
    let (out, mut state) = run(node(vase(0.0)), None).unwrap();
    assert_eq!(out.curves.validate(), Ok(()));
    assert_eq!(out.count.value as usize, out.curves.lengths.len());
    assert_eq!(out.curves.kinds.iter().filter(|k| **k == 2).count(), 2, "both rims");
    assert!(out.curves.visible.contains(&0) && out.curves.visible.contains(&1));
    // The numbers are those of the longest first, and go with the mesh wherever it moves.
    let first = out.curves.ids.clone();
    assert_eq!(first, (1..=first.len() as i64).collect::<Vec<_>>());
    for k in 1..6 {
        let (out, next) = run(node(vase(f64::from(k))), Some(&state)).unwrap();
        assert_eq!(out.curves.ids, first);
        state = next;
    }
    let (fewer, _) = run(MeshSilhouette { borders: false, ..node(vase(0.0)) }, Some(&state)).unwrap();
    let kept: Vec<i64> = first.iter().zip(&out.curves.kinds).filter(|(_, k)| **k == 1).map(|(id, _)| *id).collect();
    assert_eq!(fewer.curves.ids, kept);
}

#[test]
fn what_is_hidden_or_short_may_be_left_out() {
    let (out, _) = run(MeshSilhouette { visible_only: true, ..node(vase(0.0)) }, None).unwrap();
    assert!(out.curves.visible.iter().all(|v| *v == 1) && !out.curves.points.is_empty());
    let (longer, _) = run(MeshSilhouette { min_length: 100.0, ..node(vase(0.0)) }, None).unwrap();
    let (all, _) = run(node(vase(0.0)), None).unwrap();
    assert!(longer.count.value <= all.count.value && longer.count.value > 0.0);
    let (endless, _) = run(MeshSilhouette { min_length: 65536.0, ..node(vase(0.0)) }, None).unwrap();
    assert_eq!(endless.count.value, 0.0);
    let (none, _) = run(MeshSilhouette { silhouettes: false, borders: false, ..node(vase(0.0)) }, None).unwrap();
    assert_eq!(none.count.value, 0.0);
}

#[test]
fn a_broken_mesh_is_refused_by_name() {
    let mut mesh = vase(0.0);
    mesh.positions[3][1] = f64::NAN;
    let message = run(node(mesh), None).map(|_| ()).unwrap_err().message;
    assert!(message.starts_with("mesh: mesh 0: expected finite positions, found vertex 3"), "{message}");
    let (empty, _) = run(node(Mesh::default()), None).unwrap();
    assert_eq!(empty.count.value, 0.0);
}

#[test]
fn a_smooth_mesh_keeps_its_triangles_its_seams_and_its_rims() {
    let mut mesh = vase(0.0);
    // A vertex twice, as at the seam of a texture.
    mesh.positions.push(mesh.positions[85]);
    let copy = mesh.positions.len() as u32 - 1;
    Arc::make_mut(&mut mesh.triangles)
        .iter_mut()
        .filter(|t| t.contains(&85))
        .take(2)
        .for_each(|t| *t = t.map(|v| if v == 85 { copy } else { v }));
    let clock = clock(1);
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    let smooth = |iterations| MeshSmooth { mesh: In::new(mesh.clone()), iterations }.run(&cx).unwrap().mesh;
    let out = smooth(3);
    assert_eq!(out.triangles, mesh.triangles);
    assert_eq!(out.positions[85], out.positions[copy as usize]);
    assert_ne!(out.positions[85], mesh.positions[85]);
    assert_eq!(out.positions[0], mesh.positions[0], "a rim");
    let volumes = [&out, &mesh].map(|m| volume(&m.positions, &m.triangles));
    assert!((volumes[0] / volumes[1] - 1.0).abs() < 1e-3, "{volumes:?}");
    assert_eq!(smooth(0), mesh);
}

fn features(paths: &str) -> Result<features::MeshFeaturesOutputs, NodeError> {
    let paths = <features::Paths as pegbar_engine::setting::Setting>::parse(paths).unwrap();
    let clock = clock(1);
    let node = MeshFeatures { mesh: In::new(vase(0.0)), camera: In::new(camera()), paths };
    node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
}

#[test]
fn what_is_painted_on_a_mesh_lies_on_its_edges_where_it_was_painted() {
    let out = features("[(points: [(120, 120), (150, 140), (180, 125)]), (vertices: [10, 50, 90]), (vertices: [0, 3, 123], closed: true)]")
        .unwrap();
    let (curves, mesh) = (&out.curves, vase(0.0));
    assert_eq!(curves.validate(), Ok(()));
    assert_eq!(
        (out.count.value, &curves.kinds[..], &curves.ids[..], &curves.closed[..]),
        (3.0, &[5, 5, 5][..], &[1, 2, 3][..], &[0, 0, 1][..])
    );
    let algo = AlgoCamera::try_from(&camera()).unwrap();
    let painted = [[120.0, 120.0], [150.0, 140.0], [180.0, 125.0]];
    let n = curves.lengths[0] as usize;
    assert!(n > 6, "{n}");
    let mut last = f64::NEG_INFINITY;
    for i in 0..n {
        let ([a, b], s) = (curves.edges[i].map(|v| mesh.positions[v as usize]), curves.shares[i]);
        let [x, y, _] = algo.project([0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * s));
        assert!((x - curves.points[i][0]).abs() + (y - curves.points[i][1]).abs() < 1e-9);
        let off = painted.windows(2).map(|w| {
            let (d, p) = ([w[1][0] - w[0][0], w[1][1] - w[0][1]], [x - w[0][0], y - w[0][1]]);
            let t = ((d[0] * p[0] + d[1] * p[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
            (p[0] - d[0] * t).hypot(p[1] - d[1] * t)
        });
        assert!(off.fold(f64::INFINITY, f64::min) < 1e-9 && x >= last && curves.visible[i] == 1, "point {i}");
        last = x;
    }
    // Rings have 40 vertices: up the side, one above the other.
    assert_eq!(curves.edges[n..n + 3], [[10, 10], [50, 50], [90, 90]]);
}

#[test]
fn a_curve_that_is_none_is_told() {
    let told = |paths: &str| features(paths).err().map(|e| e.message).unwrap_or_default();
    assert_eq!(told("[(points: [(1, 1), (4, 4)])]"), "curve 1: expected a curve across two or more edges of the mesh, found 0");
    assert_eq!(told("[(vertices: [1, 99999])]"), "expected vertices below 840, found 99999");
    assert!(told("[(uvs: [(0, 0), (1, 1)])]").starts_with("mesh: expected places on a texture"));
    let problems = |paths: &str| {
        let paths = <features::Paths as pegbar_engine::setting::Setting>::parse(paths).unwrap();
        MeshFeatures { mesh: In::new(vase(0.0)), camera: In::new(camera()), paths }
            .check()
            .into_iter()
            .map(|p| p.message)
            .collect::<Vec<_>>()
    };
    assert_eq!(problems("[(points: [(1, 1)])]"), ["curve 1: expected two or more of either vertices, points or uvs, found [0, 1, 0]"]);
    assert_eq!(problems("[(vertices: [1, 2], uvs: [(0, 0), (1, 1)])]").len(), 1);
    assert_eq!(problems("[(vertices: [1, 2])]"), Vec::<String>::new());
}
