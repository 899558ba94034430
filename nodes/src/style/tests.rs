//! The whole way of a drawing onto a motion: the edit of the motion, the warp, the lift, the way along, the assembly. Other people's characters are no part of the
//! project: where the folder `shared/data/characters` does not lie next to it the test of them says so and passes.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::value::{Curve, TimeMap, Value, ValueRef, Vector, downcast};

use crate::algo::camera::{self, Orbit, orthographic};
use crate::data::{Field2, Field3, Mesh, Pose, Skeleton};

const SIZE: usize = 512;

/// All values of some ports, `node.output`.
fn try_run(nodes: &str, ports: &[&str]) -> Result<Vec<Vec<ValueRef>>, String> {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("style.ron"), &text, &crate::registry(), &LoadOptions::default());
    let graph = loaded.graph.ok_or_else(|| loaded.sources.render_all(&loaded.diagnostics, false))?;
    let port = |name: &&str| {
        let (node, output) = name.split_once('.').unwrap();
        let node = graph.find(node).unwrap();
        Port { node, output: graph.nodes[node].ty.schema.output(output).unwrap().0 }
    };
    let ports: Vec<Port> = ports.iter().map(port).collect();
    let mut report = execute(&graph, &[], &ports, &Options::default()).unwrap();
    match report.failures.first() {
        Some(failure) => Err(failure.error.message.clone()),
        None => Ok(ports.iter().map(|p| report.kept.remove(p).unwrap().into_iter().map(Option::unwrap).collect()).collect()),
    }
}

fn run(nodes: &str, ports: &[&str]) -> Vec<Vec<ValueRef>> {
    try_run(nodes, ports).unwrap_or_else(|e| panic!("{e}"))
}

fn all<T: Value>(values: &[ValueRef]) -> Vec<Arc<T>> {
    values.iter().map(|v| downcast::<T>(v.clone()).unwrap()).collect()
}

/// An otter that goes from one pose of its walk to the other: outputs mesh, skeleton and pose.
const OTTER: &str = r#""who": (type: "cel.character", character: otter),
    "a": (type: "cel.character_pose", pose: walk_contact), "b": (type: "cel.character_pose", pose: walk_passing),
    "w": (type: "weights.keys", frames: [1, 24], poses: [1, 2]),
    "moves": (type: "retarget.joint_angles", poses: ["@a", "@b"], weights: "@w"),"#;

/// The camera's own numbers, and how a graph says it: the mesh fills two thirds of a picture of 512 pixels.
fn camera_of(mesh: &Mesh) -> (camera::Camera, String) {
    let bound = |k: usize, f: fn(f64, f64) -> f64, start: f64| mesh.positions.iter().map(|p| p[k]).fold(start, f);
    let (low, high) = ([0, 1, 2].map(|k| bound(k, f64::min, f64::INFINITY)), [0, 1, 2].map(|k| bound(k, f64::max, f64::NEG_INFINITY)));
    let target = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
    let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let (scale, azimuth) = (SIZE as f64 * 0.66 / extent, 40.0f64);
    let orbit = Orbit { target, azimuth: azimuth.to_radians(), elevation: 0.0, roll: 0.0, distance: 10.0 * extent };
    let projection = orthographic(scale, [SIZE, SIZE], 0.01 * extent, 100.0 * extent);
    let [x, y, z] = target;
    let text = format!(
        r#""camera": (type: "camera.orthographic", azimuth_deg: {azimuth:?}, scale: {scale:?}, size: ({SIZE}, {SIZE}), target: ({x:?}, {y:?}, {z:?}), distance: {:?}, near: {:?}, far: {:?}),"#,
        10.0 * extent,
        0.01 * extent,
        100.0 * extent
    );
    (camera::Camera::new(orbit.view(), projection, [SIZE as i64; 2]).unwrap(), text)
}

fn seen(mesh: &Mesh, camera: &camera::Camera) -> Vec<[f64; 2]> {
    mesh.positions.iter().map(|p| camera.project(*p)).map(|[x, y, _]| [x, y]).collect()
}

/// Pixels whose centre some triangle covers.
fn covered(points: &[[f64; 2]], triangles: &[[u32; 3]]) -> Vec<bool> {
    let mut mask = vec![false; SIZE * SIZE];
    for t in triangles {
        let p = t.map(|v| points[v as usize]);
        let cross = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let side = cross(p[0], p[1], p[2]);
        let range = |k: usize| {
            let (low, high) = p.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(q[k]), h.max(q[k])));
            low.max(0.0) as usize..(high + 1.0).clamp(0.0, SIZE as f64) as usize
        };
        for y in range(1) {
            for x in range(0) {
                let q = [x as f64 + 0.5, y as f64 + 0.5];
                let inside = (0..3).all(|k| cross(p[k], p[(k + 1) % 3], q) * side >= 0.0);
                mask[y * SIZE + x] |= inside && side != 0.0;
            }
        }
    }
    mask
}

/// Covered pixels beside one that is not.
fn outline(mask: &[bool]) -> Vec<[f64; 2]> {
    let at = |x: usize, y: usize| mask.get(y * SIZE + x).copied().unwrap_or(false);
    let is_edge = |k: &usize| {
        let (x, y) = (k % SIZE, k / SIZE);
        at(x, y) && (x == 0 || y == 0 || x + 1 == SIZE || !at(x - 1, y) || !at(x + 1, y) || !at(x, y - 1) || !at(x, y + 1))
    };
    (0..SIZE * SIZE).filter(is_edge).map(|k| [(k % SIZE) as f64 + 0.5, (k / SIZE) as f64 + 0.5]).collect()
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// How far each pixel of an outline is from another outline, both ways, in order.
fn distances(a: &[[f64; 2]], b: &[[f64; 2]]) -> Vec<f64> {
    let nearest = |p: &[f64; 2], to: &[[f64; 2]]| to.iter().map(|q| apart(*p, *q)).fold(f64::INFINITY, f64::min);
    let mut found: Vec<f64> = a.iter().map(|p| nearest(p, b)).chain(b.iter().map(|p| nearest(p, a))).collect();
    found.sort_by(f64::total_cmp);
    found
}

/// What the animator did to the picture: it sways, and is some fifteen pixels off at most.
fn drawn([x, y]: [f64; 2]) -> [f64; 2] {
    [x + 14.0 * libm::sin(y / 70.0), y + 6.0 * libm::sin(x / 90.0)]
}

/// Vertices on the outline, and where they are drawn, as a graph says them.
fn pairs(points: &[[f64; 2]], triangles: &[[u32; 3]]) -> String {
    let edge = outline(&covered(points, triangles));
    let near = |p: &[f64; 2]| edge.iter().any(|q| apart(*p, *q) < 1.5);
    let mut taken: Vec<[f64; 2]> = Vec::new();
    let mut text = String::new();
    for (v, p) in points.iter().enumerate() {
        if near(p) && taken.iter().all(|q| apart(*p, *q) > 1.0) {
            taken.push(*p);
            let [x, y] = drawn(*p);
            text += &format!("(vertex: {v}, point: ({x:?}, {y:?})), ");
        }
    }
    format!("[{text}]")
}

/// The joint that moves most, by how many joints hang on it, but no root.
fn limb(skeleton: &Skeleton) -> Option<&str> {
    let below = |j: usize| skeleton.parents.iter().filter(|p| **p == j as i64).count();
    let at = (0..skeleton.n_joints()).filter(|j| skeleton.parents[*j] >= 0).max_by_key(|j| below(*j))?;
    skeleton.names.get(at).map(String::as_str)
}

/// The way from a character `who` that `moves` to one that passes through a drawing at frame 12.
fn way(character: &str, moves: &str, camera: &str, edits: &str, pairs: &str, rest: &str) -> String {
    format!(
        r#"{character} {camera}
        "warp": (type: "motion.warp", skeleton: "@who.skeleton", pose: "@{moves}.pose", edits: {edits}),
        "plain": (type: "skin.linear_blend", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@{moves}.pose", precision: double),
        "posed": (type: "skin.linear_blend", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@warp.pose", precision: double),
        "pose12": (type: "time.pick", stream: "@warp.pose", frame: 12),
        "mesh12": (type: "time.pick", stream: "@posed", frame: 12),
        "field": (type: "warp.layered", correspondences: {pairs}, mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose12", camera: "@camera"{rest}),
        "lift": (type: "field.lift", field: "@field", mesh: "@mesh12", camera: "@camera"),
        "along": (type: "field.propagate", field: "@lift", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@warp.pose", frame: 12),
        "styled": (type: "style.assemble", mesh: "@posed", fields: ["@along"], examples: [(frame: 12, before: 6, after: 8)]),"#
    )
}

/// What was found of one character.
#[derive(Debug)]
struct Found {
    /// Of the outlines at the drawn frame, pixels.
    mean: f64,
    p95: f64,
    /// Of the correspondences at the worst, pixels.
    residual: f64,
    least_growth: f64,
    n_folds: usize,
    n_triangles: usize,
}

/// Stylises a character by a drawing of frame 12, and holds the acceptance: at the frame the outlines meet, outside of the range no bit is changed.
fn stylised(character: &str, moves: &str) -> Found {
    let skeleton = all::<Skeleton>(&run(character, &["who.skeleton"])[0])[0].clone();
    let edits = match limb(&skeleton) {
        Some(name) => format!("[(frame: 12, before: 6, after: 8, joints: [(joint: {name:?}, rotate_deg: (4, 0, 6), length: 1.05)])]"),
        None => "[]".to_owned(),
    };
    // The camera looks at the mesh as it is edited at frame 12.
    let shape = way(character, moves, r#""camera": (type: "camera.orthographic"),"#, &edits, "[]", "");
    let posed = all::<Mesh>(&run(&shape, &["mesh12.stream"])[0])[0].clone();
    let (camera, text) = camera_of(&posed);
    let points = seen(&posed, &camera);
    let pairs = pairs(&points, &posed.triangles);
    let ports = ["plain.mesh", "styled.mesh", "field.field", "field.residual", "field.least_growth", "field.folds"];
    let values = run(&way(character, moves, &text, &edits, &pairs, ""), &ports);
    let (plain, styled) = (all::<Mesh>(&values[0]), all::<Mesh>(&values[1]));
    for frame in (1..=6).chain(20..=24) {
        assert_eq!(plain[frame - 1], styled[frame - 1], "frame {frame}");
    }
    assert!((7..=19).any(|f| plain[f - 1].positions != styled[f - 1].positions));
    let field = &all::<Field2>(&values[2])[0].vectors;
    let now = seen(&styled[11], &camera);
    for ((p, d), q) in points.iter().zip(field).zip(&now) {
        assert!(apart([p[0] + d[0], p[1] + d[1]], *q) < 1e-8, "what is lifted is seen as it was warped");
    }
    let truth: Vec<[f64; 2]> = points.iter().map(|p| drawn(*p)).collect();
    let [a, b] = [&truth, &now].map(|p| outline(&covered(p, &posed.triangles)));
    let off = distances(&a, &b);
    let residuals = &all::<Vector>(&values[3])[0].values;
    Found {
        mean: off.iter().sum::<f64>() / off.len() as f64,
        p95: off[off.len() * 95 / 100],
        residual: residuals.iter().copied().fold(0.0, f64::max),
        least_growth: all::<Curve>(&values[4])[0].value,
        n_folds: all::<Vector>(&values[5])[0].values.len(),
        n_triangles: posed.triangles.len(),
    }
}

#[test]
fn an_otter_passes_through_its_drawing_and_is_itself_outside_of_the_range() {
    let found = stylised(OTTER, "moves");
    eprintln!("{found:?}");
    assert!(found.mean <= 1.0 && found.p95 <= 2.0 && found.residual < 4.0, "{found:?}");
    assert!(found.least_growth > 0.0 && found.n_folds * 20 < found.n_triangles, "{found:?}");
}

#[test]
fn every_character_passes_through_a_drawing_made_over_it() {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/characters"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no folder {}", folder.display());
        return;
    }
    let characters = [
        ("kaykit_mage.glb", "\"Walking_A\""),
        ("khronos_fox.glb", "\"Run\""),
        ("khronos_simple_skin.gltf", "0"),
        ("quaternius_clownfish.glb", "5"),
        ("quaternius_frog.glb", "3"),
        ("quaternius_horse.glb", "4"),
        ("quaternius_platformer.glb", "16"),
        ("robot_expressive.glb", "\"Dance\""),
    ];
    for (name, animation) in characters {
        let path = folder.join(name);
        let found = stylised(&format!(r#""who": (type: "io.read_gltf", path: "{}", animation: {animation}),"#, path.display()), "who");
        eprintln!("{name}: {found:?}");
        assert!(found.mean <= 1.0 && found.p95 <= 2.0 && found.residual < 4.0, "{name}: {found:?}");
    }
}

#[test]
fn two_drawings_that_overlap_are_each_met() {
    let base = r#""mesh": (type: "cel.character", character: otter), "camera": (type: "camera.orthographic", scale: 300.0, size: (512, 512), target: (0.0, 0.5, 0.0)),
        "who": (type: "cel.character", character: otter), "pose": (type: "cel.character_pose", pose: walk_contact),
        "posed": (type: "skin.linear_blend", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose"),
        "one": (type: "warp.layered", correspondences: [(vertex: 10, point: (200, 300))], mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose", camera: "@camera", over: picture),
        "two": (type: "warp.layered", correspondences: [(edge: (900, 901), share: 0.5, point: (300, 200))], mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose", camera: "@camera", over: picture),
        "f": (type: "field.lift", field: "@one", mesh: "@posed", camera: "@camera"), "g": (type: "field.lift", field: "@two", mesh: "@posed", camera: "@camera"),"#;
    let with = |overlap: &str| {
        let last = format!(
            r#""styled": (type: "style.assemble", mesh: "@posed", fields: ["@f", "@g"], overlap: {overlap}, examples: [(frame: 8, before: 6, after: 9), (frame: 13, before: 10, after: 4)]),"#
        );
        run(&format!("{base} {last}"), &["posed.mesh", "f.field", "g.field", "styled.mesh", "styled.amounts"])
    };
    let met = with("meet");
    let (mesh, styled) = (all::<Mesh>(&met[0])[0].clone(), all::<Mesh>(&met[3]));
    for (frame, field) in [(8, 1), (13, 2)] {
        let field = all::<Field3>(&met[field])[0].clone();
        let truth = mesh.positions.iter().zip(&field.vectors).map(|(p, d)| [0, 1, 2].map(|k| p[k] + d[k]));
        assert!(truth.eq(styled[frame - 1].positions.iter().copied()), "frame {frame} is met to the bit");
    }
    for frame in [1, 2, 17, 20] {
        assert_eq!(*styled[frame - 1], *mesh, "frame {frame}");
    }
    let added = all::<Vector>(&with("add")[4]);
    assert!(added[7].values[0] == 1.0 && added[7].values[1] > 0.4, "{:?}", added[7]);
}

#[test]
fn a_motion_passes_through_poses_joints_and_times_of_ones_own() {
    let nodes = format!(
        r#"{OTTER} "still": (type: "cel.character_pose", pose: walk_up),
        "warp": (type: "motion.warp", skeleton: "@who.skeleton", pose: "@moves.pose", poses: ["@still", "@moves.pose"], edits: [
            (frame: 6, before: 4, after: 6, pose: 0), (frame: 10, before: 6, after: 6, pose: 1, pose_frame: 20),
            (frame: 18, before: 4, after: 4, shows: 19.5, joints: [(joint: "head", scale: (1.5, 1.5, 1.5), rotate_deg: (0, 90, 0))]),
        ]),"#
    );
    let values = run(&nodes, &["moves.pose", "warp.pose", "still.pose", "warp.times", "warp.amounts", "who.skeleton"]);
    let (own, made, still) = (all::<Pose>(&values[0]), all::<Pose>(&values[1]), all::<Pose>(&values[2])[0].clone());
    let skeleton = all::<Skeleton>(&values[5])[0].clone();
    let close = |a: &Pose, b: &Pose| {
        for (a, b) in a.joints().unwrap().iter().zip(b.joints().unwrap()) {
            assert!((a.translation - b.translation).amax() < 1e-12 && (a.scale - b.scale).amax() < 1e-12);
            assert!((a.rotation.inverse() * b.rotation).angle() < 1e-7);
        }
    };
    close(&made[5], &still);
    close(&made[9], &own[19]);
    for frame in [1, 2, 22, 24] {
        assert_eq!(made[frame - 1], own[frame - 1], "frame {frame}");
    }
    let head = skeleton.find("head").unwrap();
    let (before, after) = (own[18].joint(head).unwrap(), made[17].joint(head).unwrap());
    assert!((after.scale - before.scale * 1.5).amax() < 1e-12);
    let times = &all::<TimeMap>(&values[3])[0].source_frames;
    assert!(
        times[17] == 19.5 && times[5] == 6.0 && times[9] == 10.0 && times[0] == 1.0 && times.windows(2).all(|w| w[0] <= w[1]),
        "{times:?}"
    );
    assert_eq!(all::<Vector>(&values[4])[5].values, [1.0, 0.0, 0.0]);
}

#[test]
fn what_cannot_be_is_told_in_words() {
    let told = |edits: &str, text: &str| {
        let nodes = format!(
            r#"{OTTER} "warp": (type: "motion.warp", skeleton: "@who.skeleton", pose: "@moves.pose", poses: ["@a"], edits: {edits}),"#
        );
        let error = try_run(&nodes, &["warp.pose"]).expect_err(edits);
        assert!(error.contains(text), "{error}");
    };
    told("[(frame: 99)]", "edit 0: expected a frame from 1 to 24, found 99");
    told("[(frame: 3), (frame: 3)]", "expected examples at frames of their own, found two at 3");
    told("[(frame: 3, pose: 4)]", "edit 0: expected a number below 1 of one of `poses`, found 4");
    told("[(frame: 3, joints: [(joint: \"fin\")])]", "edit 0: expected a joint of the skeleton, found \"fin\"");
    told("[(frame: 3, before: -1)]", "edit 0: expected 0 or more frames before and after it");
    told(
        "[(frame: 3, joints: [(joint: \"head\", length: 0)])]",
        "joint \"head\": expected finite numbers, and a length and a scale above 0",
    );
    told("[(frame: 12, before: 2, after: 2, shows: 22)]", "expected time to run forwards");
    let far = way(OTTER, "moves", r#""camera": (type: "camera.orthographic"),"#, "[]", "[(vertex: 999999, point: (1, 2))]", "");
    assert!(try_run(&far, &["field.field"]).unwrap_err().starts_with("pair 0: expected vertices below"));
    let few = format!(r#"{} "x": (type: "style.assemble", mesh: "@posed", fields: ["@along"], examples: []),"#, far.replace("999999", "9"));
    assert_eq!(try_run(&few, &["x.mesh"]).unwrap_err(), "examples: expected one for each of 1 fields, found 0");
}

#[test]
fn a_drawing_serves_again_where_the_motion_comes_back() {
    let cycle = OTTER.replace("frames: [1, 24], poses: [1, 2]", "frames: [1, 5, 9, 13, 17, 21], poses: [1, 2, 1, 2, 1, 2]");
    let edits = r#"[(frame: 9, before: 3, after: 3, joints: [(joint: "head", rotate_deg: (0, 0, 20), length: 1.3)])]"#;
    let nodes = format!(
        r#"{cycle} "camera": (type: "camera.orthographic", scale: 300.0, size: (512, 512), target: (0.0, 0.5, 0.0)),
        "again": (type: "style.find", skeleton: "@who.skeleton", pose: "@moves.pose", frames: [9], transition: 3.0, tolerance: 0.1),
        "warp": (type: "motion.warp", skeleton: "@who.skeleton", pose: "@moves.pose", edits: {edits}, elsewhere: "@again.amounts"),
        "posed": (type: "skin.linear_blend", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@warp.pose", precision: double),
        "pose9": (type: "time.pick", stream: "@warp.pose", frame: 9), "mesh9": (type: "time.pick", stream: "@posed", frame: 9),
        "field": (type: "warp.layered", correspondences: [(vertex: 10, point: (200, 300))], mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose9", camera: "@camera"),
        "lift": (type: "field.lift", field: "@field", mesh: "@mesh9", camera: "@camera"),
        "along": (type: "field.propagate", field: "@lift", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@warp.pose", frame: 9),
        "styled": (type: "style.assemble", mesh: "@posed", fields: ["@along"], examples: [(frame: 9, before: 3, after: 3)], elsewhere: "@again.amounts"),
        "plain": (type: "skin.linear_blend", mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@moves.pose", precision: double),"#
    );
    let values = run(&nodes, &["again.amounts", "styled.mesh", "plain.mesh", "again.distances"]);
    let amounts: Vec<f64> = all::<Vector>(&values[0]).iter().map(|v| v.values[0]).collect();
    let (styled, plain) = (all::<Mesh>(&values[1]), all::<Mesh>(&values[2]));
    let apart = |a: &Mesh, b: &Mesh| {
        a.positions.iter().zip(&b.positions).flat_map(|(p, q)| (0..3).map(move |k| (p[k] - q[k]).abs())).fold(0.0, f64::max)
    };
    assert!(amounts[16] > 1.0 - 1e-9 && amounts[8] == 0.0 && amounts[12] == 0.0, "{amounts:?}");
    assert!(apart(&styled[8], &plain[8]) > 0.01, "the drawing changes something");
    assert!(apart(&styled[16], &styled[8]) < 1e-9, "at its like the figure is as it is drawn");
    assert_eq!(styled[12], plain[12], "between them it is itself");
    // Nothing is known of a frame that there is not.
    let wrong = nodes.replace("frames: [9], tr", "frames: [99], tr");
    assert_eq!(try_run(&wrong, &["again.amounts"]).unwrap_err(), "frames: expected a frame from 1 to 24, found 99");
    let few = nodes.replace(
        "fields: [\"@along\"], examples: [(frame: 9, before: 3, after: 3)]",
        "fields: [\"@along\", \"@along\"], examples: [(frame: 9), (frame: 20)]",
    );
    assert!(try_run(&few, &["styled.mesh"]).unwrap_err().starts_with("elsewhere: expected a finite number for each of 2 fields"));
}

#[test]
fn a_coarse_mesh_is_made_denser_where_it_is_drawn_bent() {
    let base = r#""who": (type: "cel.character", character: otter), "pose": (type: "cel.character_pose", pose: walk_contact),
        "camera": (type: "camera.orthographic", scale: 300.0, size: (512, 512), target: (0.0, 0.5, 0.0)),"#;
    let field = |rest: &str| {
        format!(
            r#"{base} "field": (type: "warp.layered", correspondences: [(vertex: 10, point: (200, 300)), (edge: (900, 901), share: 0.25, point: (300, 200))],
            mesh: "@who.mesh", skeleton: "@who.skeleton", pose: "@pose", camera: "@camera", over: picture{rest}),
            "posed": (type: "skin.linear_blend", mesh: "@field.mesh", skeleton: "@who.skeleton", pose: "@pose"),"#
        )
    };
    let of = |rest: &str| {
        let v = run(&field(rest), &["field.mesh", "field.bend", "field.field", "field.residual", "posed.mesh"]);
        let mesh = all::<crate::data::SkinnedMesh>(&v[0])[0].clone();
        let vectors = all::<Field2>(&v[2])[0].vectors.len();
        assert_eq!(vectors, mesh.positions.len());
        assert_eq!(all::<Mesh>(&v[4])[0].positions.len(), vectors);
        (mesh, all::<Curve>(&v[1])[0].value, all::<Vector>(&v[3])[0].values.iter().copied().fold(0.0, f64::max))
    };
    let (own, none, before) = of("");
    let (same, most, _) = of(", tessellate: 1000.0");
    assert!(none == 0.0 && most > 0.0 && same == own);
    let tolerance = most / 3.0;
    let (once, bend, _) = of(&format!(", tessellate: {tolerance}, tessellate_rounds: 1"));
    let (dense, less, residual) = of(&format!(", tessellate: {tolerance}, tessellate_rounds: 6"));
    assert!(own.positions.len() < once.positions.len() && once.positions.len() <= dense.positions.len());
    assert!(bend < most && less <= tolerance && residual < before + 0.5, "{most} {bend} {less} {before} {residual}");
    assert_eq!(&dense.positions[..own.positions.len()], &own.positions[..], "the vertices that were there keep their numbers");
    assert!(dense.triangles.len() < 4 * own.triangles.len(), "only where it is bent: {} of {}", dense.triangles.len(), own.triangles.len());
    let surface = field(", tessellate: 0.25").replace("over: picture", "over: harmonic");
    assert!(try_run(&surface, &["field.field"]).unwrap_err().starts_with("tessellate: expected a warp over layers or the picture"));
}
