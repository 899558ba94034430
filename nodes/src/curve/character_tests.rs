//! Other people's characters, drawn over and found again. Their files are no part of the project: where the folder `shared/data/characters` does not lie next
//! to the project this test says so and passes.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::node::{Cancel, Context, In, List, PerFrame, Recurrent};
use pegbar_engine::value::downcast;

use super::anchors::{Anchor, Anchors};
use super::{CorrespondCurves, CurveTrace};
use crate::algo::camera::{Camera as AlgoCamera, Orbit, orthographic};
use crate::algo::correspond::{Missing, Pairing};
use crate::algo::curve_trace::{Along, Method};
use crate::algo::mesh_lines::{Line, Search, distance, find};
use crate::algo::silhouette::Lines;
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::algo::skin::Skin;
use crate::algo::surface::{Part, Surface};
use crate::algo::toon::{Light, Paint, Pen, Style, coverage, render};
use crate::counted::clock;
use crate::data::{Camera, Image, Mesh, Pose, Skeleton, SkinnedMesh};
use crate::mesh::MeshSilhouette;
use crate::pose::PoseFit;

const SIZE: usize = 384;

/// Files, and the animation whose first frame is drawn over.
const CHARACTERS: [(&str, &str); 6] = [
    ("kaykit_mage.glb", "\"Walking_A\""),
    ("khronos_fox.glb", "\"Run\""),
    ("quaternius_frog.glb", "3"),
    ("quaternius_horse.glb", "4"),
    ("quaternius_platformer.glb", "16"),
    ("robot_expressive.glb", "\"Dance\""),
];

struct Character {
    mesh: SkinnedMesh,
    skeleton: Skeleton,
    pose: Pose,
}

fn character(path: &Path, animation: &str) -> Character {
    let text = format!(
        r#"Graph(pegbar: 1, frames: (first: 1, last: 3, fps: 24), nodes: {{ "in": (type: "io.read_gltf", path: "{}", animation: {animation}) }})"#,
        path.display()
    );
    let registry = crate::registry();
    let loaded = load_text(Path::new("character.ron"), &text, &registry, &LoadOptions::default());
    let graph = loaded.graph.unwrap_or_else(|| panic!("{}", loaded.sources.render_all(&loaded.diagnostics, false)));
    let node = graph.find("in").unwrap();
    let port = |name: &str| Port { node, output: graph.nodes[node].ty.schema.output(name).unwrap().0 };
    let ports = ["mesh", "skeleton", "pose"].map(port);
    let mut report = execute(&graph, &[], &ports, &Options::default()).unwrap();
    assert!(report.failures.is_empty(), "{:#?}", report.failures);
    let mut first = |p: &Port| report.kept.remove(p).unwrap().remove(0).unwrap();
    let [mesh, skeleton, pose] = [first(&ports[0]), first(&ports[1]), first(&ports[2])];
    Character {
        mesh: downcast::<SkinnedMesh>(mesh).unwrap().as_ref().clone(),
        skeleton: downcast::<Skeleton>(skeleton).unwrap().as_ref().clone(),
        pose: downcast::<Pose>(pose).unwrap().as_ref().clone(),
    }
}

impl Character {
    fn world(&self, pose: &Pose) -> Vec<nalgebra::Matrix4<f64>> {
        let local: Vec<_> = pose.joints().unwrap().iter().map(Joint::matrix).collect();
        world_from_joint(&self.skeleton.parents, &local).unwrap()
    }

    fn posed(&self, pose: &Pose) -> Mesh {
        let m = &self.mesh;
        let skin = Skin::new(&m.positions, &[], m.joints.shape()[1], m.joints.data(), m.weights.data(), m.n_joints()).unwrap();
        let motions: Vec<_> = self.world(pose).iter().zip(m.inverse_bind()).map(|(w, b)| w * b).collect();
        m.rest().moved(skin.pose(&motions, false).unwrap().0, Vec::new())
    }

    /// A camera that sees all of it from the front and a little to the side.
    fn camera(&self) -> AlgoCamera {
        let positions = self.posed(&self.pose).positions;
        let ends = |k: usize| positions.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        let [x, y, z] = [0, 1, 2].map(ends);
        let target = [x, y, z].map(|[a, b]| (a + b) / 2.0);
        let size = [x, y, z].iter().map(|[a, b]| b - a).fold(0.0, f64::max);
        let orbit = Orbit { target, azimuth: 0.6, elevation: 0.15, roll: 0.0, distance: 4.0 * size };
        let projection = orthographic(0.6 * SIZE as f64 / size, [SIZE; 2], 0.1 * size, 10.0 * size);
        AlgoCamera::new(orbit.view(), projection, [SIZE as i64; 2]).unwrap()
    }

    /// The joint whose turn by half a radian moves most of the outline without moving all of the figure: a limb.
    fn limb(&self) -> usize {
        let n = self.skeleton.n_joints();
        let weight = |j: usize| {
            let is_below = |mut k: usize| loop {
                if k == j {
                    return true;
                }
                match usize::try_from(self.skeleton.parents[k]) {
                    Ok(p) => k = p,
                    Err(_) => return false,
                }
            };
            let own = self.mesh.joints.data().iter().zip(self.mesh.weights.data());
            own.filter(|(k, _)| is_below(**k as usize)).map(|(_, w)| w).sum::<f64>() / self.mesh.positions.len() as f64
        };
        let shares: Vec<f64> = (0..n).map(weight).collect();
        (0..n).min_by(|a, b| (shares[*a] - 0.1).abs().total_cmp(&(shares[*b] - 0.1).abs())).unwrap()
    }
}

fn outlines(mesh: &Mesh, camera: &AlgoCamera) -> Vec<Line> {
    let lines = Lines { crease: None, seams: false, ..Lines::default() };
    find(&mesh.positions, &mesh.triangles, camera, &Search { lines, hard: 1.0, subdivide: 0, smooth: 0 }).unwrap()
}

/// The mesh in ink on white paper, and its exact coverage.
fn drawn(mesh: &Mesh, camera: &AlgoCamera) -> (Image, Image) {
    let surface = || Surface::new(&[Part { positions: &mesh.positions, triangles: &mesh.triangles, normals: &[] }], 1.0).unwrap();
    let pen = Pen { outline: 2.0, inner: 0.0, taper: 0.0, thin_far: 0.0, weight: 0.0, bias: 0.003, colour: [0.0, 0.0, 0.0, 1.0] };
    let light = Light { direction: Vector3::y(), thresholds: vec![], shades: vec![[1.0; 3]], highlight: None };
    let lines = Lines { crease: None, seams: false, ..Lines::default() };
    let style = Style {
        paint: Paint { base: vec![[1.0; 3]], ..Paint::default() },
        light,
        lines: Some((lines, pen)),
        round: None,
        antialias: true,
        threads: 1,
    };
    let mut ink = render(surface(), camera, style).image;
    for p in ink.as_chunks_mut::<4>().0 {
        let keep = 1.0 - p[3];
        p.iter_mut().for_each(|v| *v += keep);
    }
    let cover: Vec<f32> = coverage(&surface(), camera).into_iter().flat_map(|a| [a; 4]).collect();
    (Image::new(SIZE, SIZE, 4, ink).unwrap(), Image::new(SIZE, SIZE, 4, cover).unwrap())
}

fn project(camera: &AlgoCamera, p: Vector3<f64>) -> [f64; 2] {
    let [x, y, _] = camera.project(p.into());
    [x, y]
}

/// Where a point of an edge is seen.
fn on_edge(mesh: &Mesh, camera: &AlgoCamera, [a, b]: [u32; 2], share: f64) -> [f64; 2] {
    let [p, q] = [a, b].map(|v| Vector3::from(mesh.positions[v as usize]));
    project(camera, p + (q - p) * share)
}

/// Both ends of the longest run of outline that is a part of one line, and the places between them on that line.
fn run_of_outline(lines: &[Line]) -> (usize, Vec<usize>) {
    let mut best = (0, Vec::new(), 0.0);
    for (l, line) in lines.iter().enumerate() {
        let runs = line.points.iter().enumerate().map(|(i, p)| (i, p.outline)).collect::<Vec<_>>();
        for run in runs.split(|r| !r.1).filter(|r| r.len() > 3) {
            let length: f64 = run.windows(2).map(|w| distance(line.points[w[0].0].pixel, line.points[w[1].0].pixel)).sum();
            if length > best.2 {
                best = (l, run.iter().map(|r| r.0).collect(), length);
            }
        }
    }
    (best.0, best.1)
}

#[test]
fn characters_that_were_drawn_over_are_traced_corresponded_and_posed() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/characters"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no folder {}", folder.display());
        return;
    }
    let clock = clock(1);
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    for (name, animation) in CHARACTERS {
        let figure = character(&folder.join(name), animation);
        let camera = figure.camera();
        let seen = Camera::from(&camera);
        let limb = figure.limb();
        // The drawing: a limb turned by thirty degrees across the line of sight.
        let mut changed = figure.pose.clone();
        let own = figure.pose.joint(limb).unwrap().rotation;
        let sight = figure.world(&figure.pose)[limb].fixed_view::<3, 3>(0, 0).transpose() * camera.toward()(&Vector3::zeros());
        let turn = UnitQuaternion::from_scaled_axis(sight.normalize() * 0.5);
        let q = (own * turn).coords;
        changed.rotations[limb] = [q.x, q.y, q.z, q.w];
        let (before, after) = (figure.posed(&figure.pose), figure.posed(&changed));
        let (ink, matte) = drawn(&after, &camera);

        // The pose is found again from the outline alone.
        let fit = |pose: &Pose| PoseFit {
            mesh: Some(In::new(figure.mesh.clone())),
            skeleton: In::new(figure.skeleton.clone()),
            pose: In::new(pose.clone()),
            camera: In::new(seen.clone()),
            drawing: Some(In::new(matte.clone())),
            markers: None,
            marker_joints: Vec::new(),
            root: true,
            turns: vec!["*".to_owned()],
            lengths: Vec::new(),
            scales: Vec::new(),
            marker_weight: 1.0,
            outline_weight: 1.0,
            turn_prior: 3.0,
            length_prior: 30.0,
            scale_prior: 30.0,
            reach: 48.0,
            threshold: 0.4,
            rounds: 12,
        };
        let found = fit(&figure.pose).run(&cx).unwrap();
        let joints = |pose: &Pose| -> Vec<[f64; 2]> {
            figure.world(pose).iter().map(|m| project(&camera, m.fixed_view::<3, 1>(0, 3).into_owned())).collect()
        };
        let truth = joints(&changed);
        let off = |pose: &Pose| joints(pose).iter().zip(&truth).map(|(a, b)| distance(*a, *b)).sum::<f64>() / truth.len() as f64;
        println!(
            "{name}, {limb}: joints {:.2} px off before, {:.2} px after; outline {:.2} px",
            off(&figure.pose),
            off(&found.pose),
            found.outline_error.value
        );
        // Samples two pixels apart are half a pixel from each other on the mean at the best.
        assert!(found.outline_error.value < 3.5, "{name}: {}", found.outline_error.value);

        // The longest line of the outline is traced in the drawing and paired with the mesh as it was.
        let lines = outlines(&after, &camera);
        let (l, run) = run_of_outline(&lines);
        let picks: Vec<usize> = (0..5).map(|k| run[k * (run.len() - 1) / 4]).collect();
        let silhouette = MeshSilhouette {
            mesh: In::new(after.clone()),
            camera: In::new(seen.clone()),
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
        };
        let curves = silhouette.run(None, &cx).unwrap().0.curves;
        let places: Vec<[f64; 2]> = picks.iter().map(|&i| lines[l].points[i].pixel).collect();
        let traced = CurveTrace {
            image: In::new(ink),
            anchors: places.clone(),
            markers: None,
            method: Method::Both,
            along: Along::Center,
            closed: false,
            ink_color: None,
            paper_color: None,
            threshold: 0.3,
            width: None,
            snap: 8.0,
            margin: 64.0,
            alpha: 0.002,
            beta: 1.0,
            gamma: 1.0,
            iterations: 200,
            least_on_ink: 0.2,
        };
        let traced = traced.run(&cx).unwrap();
        let anchors = places.iter().map(|&p| Anchor { render: Some(p), vertex: None, drawn: p }).collect();
        let pairs = CorrespondCurves {
            silhouette: List(vec![In::new(curves)]),
            drawn: List(vec![In::new(traced.curves)]),
            anchors: Anchors(anchors),
            render_markers: None,
            drawn_markers: None,
            pairing: Pairing::Length,
            spacing: 0.0,
            step: 4.0,
            snap: 12.0,
            bridge: 6.0,
            anchor_weight: 4.0,
            missing: Missing::Error,
        };
        let pairs = pairs.run(&cx).unwrap();
        let c = &pairs.correspondences;
        let miss: Vec<f64> =
            c.edges.iter().zip(&c.shares).zip(&c.points).map(|((e, s), p)| distance(on_edge(&after, &camera, *e, *s), *p)).collect();
        let mean = miss.iter().sum::<f64>() / miss.len() as f64;
        println!(
            "  {} pairs in {} sections, {mean:.2} px off on the mean, on ink {:.2}",
            miss.len(),
            pairs.sections.value,
            traced.on_ink.value
        );
        assert!(pairs.sections.value >= 3.0 && mean < 3.0, "{name}: {mean}");
        assert!(c.edges.iter().flatten().all(|v| (*v as usize) < before.positions.len()));
    }
}
