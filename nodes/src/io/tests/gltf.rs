//! Characters in and out: other people's, and what the graph makes of them. Their files are no part of the project: where the folder
//! `shared/data/characters` does not lie next to the project these tests say so and pass.

use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::value::{ValueRef, downcast};

use super::{Stage, only_failure};
use crate::data::{Image, Mesh, MorphTargets, Skeleton, SkinnedMesh, Weights};

fn characters() -> Option<std::path::PathBuf> {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/characters"));
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: there is no folder {}", folder.display());
    None
}

/// All values of some ports.
fn ports(stage: &Stage, nodes: &str, ports: &[&str]) -> Vec<Vec<ValueRef>> {
    let graph = stage.graph((1, 6), nodes);
    let port = |name: &&str| {
        let (node, output) = name.split_once('.').unwrap();
        let node = graph.find(node).unwrap();
        Port { node, output: graph.nodes[node].ty.schema.output(output).unwrap().0 }
    };
    let ports: Vec<Port> = ports.iter().map(port).collect();
    let mut report = execute(&graph, &[], &ports, &Options::default()).unwrap();
    assert!(report.failures.is_empty(), "{:#?}", report.failures);
    ports.iter().map(|p| report.kept.remove(p).unwrap().into_iter().map(Option::unwrap).collect()).collect()
}

fn meshes(values: &[ValueRef]) -> Vec<std::sync::Arc<Mesh>> {
    values.iter().map(|v| downcast::<Mesh>(v.clone()).unwrap()).collect()
}

/// The furthest that any vertex is from another's of the same number, by the size of the first.
fn apart(a: &Mesh, b: &Mesh) -> f64 {
    assert_eq!((a.positions.len(), &a.triangles), (b.positions.len(), &b.triangles));
    let size = a.positions.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    a.positions.iter().flatten().zip(b.positions.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / size
}

const CHARACTERS: [(&str, &str); 10] = [
    ("kaykit_mage.glb", "\"Walking_A\""),
    ("khronos_fox.glb", "\"Run\""),
    ("khronos_morph_stress_test.gltf", "\"TheWave\""),
    ("khronos_simple_skin.gltf", "0"),
    ("animated_morph_cube/AnimatedMorphCube.gltf", "\"Square\""),
    ("quaternius_clownfish.glb", "5"),
    ("quaternius_frog.glb", "3"),
    ("quaternius_horse.glb", "4"),
    ("quaternius_platformer.glb", "16"),
    ("robot_expressive.glb", "\"Dance\""),
];

#[test]
fn characters_move_alike_after_they_are_written_and_read_again() {
    let Some(folder) = characters() else { return };
    for (name, animation) in CHARACTERS {
        let stage = Stage::new();
        let path = folder.join(name);
        let skin = |id: &str, from: &str| {
            format!(
                r#""{id}": (type: "skin.linear_blend", mesh: "@{from}.mesh", skeleton: "@{from}.skeleton", pose: "@{from}.pose", morphs: "@{from}.morphs", weights: "@{from}.weights", precision: double),"#
            )
        };
        // Of two textures one repeats, which it cannot beside another.
        let material = if name.contains("stress") { ", material: \"TestMaterial\"" } else { "" };
        let read = format!(
            r#""in": (type: "io.read_gltf", path: "{}", animation: {animation}{material}), {}"#,
            path.display(),
            skin("skin", "in")
        );
        let write = r#""w": (type: "io.write_gltf", mesh: "@in.mesh", skeleton: "@in.skeleton", pose: "@in.pose", morphs: "@in.morphs",
            weights: "@in.weights", texture: "@in.texture", path: "all.glb"),
            "b": (type: "io.write_gltf", mesh: "@skin", path: "baked.gltf"),"#;
        let report = stage.run((1, 6), &format!("{read} {write}"));
        assert!(report.is_complete(), "{name}: {:#?}", report.failures);
        let back = format!(
            r#"{read} "back": (type: "io.read_gltf", path: "out/all.glb"), {} "baked": (type: "io.read_gltf", path: "out/baked.gltf"), {}"#,
            skin("again", "back"),
            skin("rebaked", "baked")
        );
        let values = ports(&stage, &back, &["skin.mesh", "again.mesh", "rebaked.mesh", "in.texture", "back.texture"]);
        let (first, again, baked) = (meshes(&values[0]), meshes(&values[1]), meshes(&values[2]));
        assert!(first.len() == 6 && first.iter().zip(&first[1..]).any(|(a, b)| a.positions != b.positions), "{name} does not move");
        for (k, one) in first.iter().enumerate() {
            assert!(
                apart(one, &again[k]) < 1e-6 && apart(one, &baked[k]) < 1e-6,
                "{name} {k}: {} {}",
                apart(one, &again[k]),
                apart(one, &baked[k])
            );
            assert_eq!((&one.uvs.len(), one.colors.len()), (&again[k].uvs.len(), again[k].colors.len()));
        }
        let image = |v: &ValueRef| downcast::<Image>(v.clone()).unwrap();
        let (was, is) = (image(&values[3][0]), image(&values[4][0]));
        assert_eq!((was.width(), was.height()), (is.width(), is.height()), "{name}");
    }
}

#[test]
fn a_fox_walks_as_it_does_in_blender() {
    let Some(folder) = characters() else { return };
    let stage = Stage::new();
    let fox = folder.join("khronos_fox.glb");
    let nodes = format!(
        r#""fox": (type: "io.read_gltf", path: "{}", animation: "Walk", start: 0.375),
        "skin": (type: "skin.linear_blend", mesh: "@fox.mesh", skeleton: "@fox.skeleton", pose: "@fox.pose"),"#,
        fox.display()
    );
    // World positions in Blender 5.0.1 (bpy, importer with merge_vertices off) at frame 10 of 24 a second, the first being 1: 9 / 24 s in; axes turned back to Y up.
    let blender = [
        (0, [1.3665283918380737, 36.23383712768555, -18.04037094116211]),
        (500, [7.627102851867676, 26.35187530517578, -21.35908317565918]),
        (1000, [6.9881086349487305, 26.476978302001953, 16.60097885131836]),
        (1727, [-0.3040226995944977, 51.14543914794922, 70.05807495117188]),
    ];
    let values = ports(&stage, &nodes, &["skin.mesh"]);
    let mesh = &meshes(&values[0])[0];
    for (vertex, truth) in blender {
        for (a, b) in mesh.positions[vertex].iter().zip(truth) {
            // A fox of 70 units: 1e-5 of its size is what 32 bits leave after a chain of 12 joints.
            assert!((a - b).abs() < 2e-4, "{vertex}: {:?} {truth:?}", mesh.positions[vertex]);
        }
    }
}

#[test]
fn parts_are_read_by_name_and_poses_fit_all_of_them() {
    let Some(folder) = characters() else { return };
    let stage = Stage::new();
    let read =
        |id: &str, more: &str| format!(r#""{id}": (type: "io.read_gltf", path: "{}" {more}),"#, folder.join("kaykit_mage.glb").display());
    let nodes = [read("all", ""), read("hat", ", mesh: \"Mage_Hat\""), read("two", ", mesh: [\"Mage_Hat\", \"Mage_Head\"], animation: []")]
        .concat();
    let values = ports(&stage, &nodes, &["all.mesh", "hat.mesh", "two.mesh", "all.skeleton", "hat.skeleton"]);
    let vertices: Vec<usize> = values[..3].iter().map(|v| downcast::<SkinnedMesh>(v[0].clone()).unwrap().positions.len()).collect();
    assert!(vertices[1] > 0 && vertices[1] < vertices[2] && vertices[2] < vertices[0], "{vertices:?}");
    let skeleton = |v: &ValueRef| downcast::<Skeleton>(v.clone()).unwrap();
    assert_eq!(skeleton(&values[3][0]), skeleton(&values[4][0]));
    let report =
        stage.run((1, 2), &format!(r#"{} "w": (type: "io.write_gltf", mesh: "@no.mesh", path: "x.glb")"#, read("no", ", mesh: \"Hat\"")));
    let message = only_failure(&report, &folder.join("kaykit_mage.glb"));
    assert!(message.contains("expected a mesh of the file, found \"Hat\"; there are \"Spellbook\""), "{message}");
}

#[test]
fn faces_are_morphed_by_one_slider_for_all_their_meshes() {
    let Some(folder) = characters() else { return };
    let stage = Stage::new();
    let nodes = format!(
        r#""robot": (type: "io.read_gltf", path: "{}", animation: "Death", speed: 6),"#,
        folder.join("robot_expressive.glb").display()
    );
    let values = ports(&stage, &nodes, &["robot.morphs", "robot.weights"]);
    let morphs = downcast::<MorphTargets>(values[0][0].clone()).unwrap();
    assert_eq!(morphs.names, ["Angry", "Surprised", "Sad"]);
    assert!((0..3).all(|k| morphs.target(k).iter().any(|d| *d != [0.0; 3])));
    assert_eq!(downcast::<Weights>(values[1][0].clone()).unwrap().weights.len(), 3);
}

#[test]
fn a_cycle_goes_round_and_a_clip_ends() {
    let stage = Stage::new();
    stage.put("bar.gltf", include_bytes!("../../skin/testdata/bar.gltf"));
    // Keys at frames 0 and 10; the clock starts at its frame 1 with the time 8 / 24 s.
    let read =
        |id: &str, end: &str| format!(r#""{id}": (type: "io.read_gltf", path: "bar.gltf", start: 0.33333333333333333, end: {end}),"#);
    let values = ports(&stage, &[read("held", "hold"), read("round", "loop")].concat(), &["held.pose", "round.pose", "held.duration"]);
    let x = |values: &[ValueRef]| -> Vec<f64> {
        let poses = values.iter().map(|v| downcast::<crate::data::Pose>(v.clone()).unwrap());
        poses.map(|p| (p.translations[0][0] / 0.03).round()).collect()
    };
    assert_eq!(x(&values[0]), [8.0, 9.0, 10.0, 10.0, 10.0, 10.0]);
    assert_eq!(x(&values[1])[..2], [8.0, 9.0]);
    assert_eq!(x(&values[1])[3..], [1.0, 2.0, 3.0]);
}

#[test]
fn a_file_that_is_broken_or_elsewhere_is_one_error_and_no_file() {
    let stage = Stage::new();
    let write = r#""w": (type: "io.write_gltf", mesh: "@in.mesh", skeleton: "@in.skeleton", path: "x.glb")"#;
    let refused = |bytes: &[u8]| {
        stage.put("bad.gltf", bytes);
        let report = stage.run((1, 2), &format!(r#""in": (type: "io.read_gltf", path: "bad.gltf"), {write}"#));
        assert!(stage.written().is_empty());
        only_failure(&report, &stage.path("bad.gltf"))
    };
    assert!(refused(b"{").contains("bad.gltf: json: EOF while parsing an object at line 1 column 1"));
    assert!(refused(br#"{"asset":{"version":"1.0"}}"#).ends_with("asset.version: expected 2.0, found \"1.0\""));
    let draco = br#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    assert!(refused(draco).contains("expected a file that can be read without KHR_draco_mesh_compression"));
    let outside = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"file:///etc/passwd"}]}"#;
    assert!(refused(outside).contains("buffers[0]: expected data or a path relative to the file"));
    let message = refused(br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"gone.bin"}]}"#);
    assert!(message.contains("gone.bin"), "{message}");
}

#[test]
fn a_stream_is_baked_on_twos_with_a_target_for_each_drawing() {
    let stage = Stage::new();
    stage.put("bar.gltf", include_bytes!("../../skin/testdata/bar.gltf"));
    let nodes = r#""bar": (type: "io.read_gltf", path: "bar.gltf"),
        "skin": (type: "skin.linear_blend", mesh: "@bar.mesh", skeleton: "@bar.skeleton", pose: "@bar.pose"),
        "twos": (type: "time.hold", stream: "@skin.mesh", step: 2),"#;
    let report = stage.run((1, 6), &format!(r#"{nodes} "w": (type: "io.write_gltf", mesh: "@twos", path: "twos.glb")"#));
    assert!(report.is_complete(), "{:#?}", report.failures);
    let values = ports(&stage, r#""in": (type: "io.read_gltf", path: "out/twos.glb")"#, &["in.morphs", "in.weights"]);
    assert_eq!(downcast::<MorphTargets>(values[0][0].clone()).unwrap().names, ["frame 3", "frame 5"]);
    let weights: Vec<Vec<f64>> = values[1].iter().map(|v| downcast::<Weights>(v.clone()).unwrap().weights.clone()).collect();
    assert_eq!(weights, [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]);
}

#[test]
fn what_a_file_names_is_watched_with_it() {
    let stage = Stage::new();
    let file = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"a%20b.bin"},{"byteLength":4,"uri":"gone.bin"}],"images":[{"uri":"a.png"}]}"#;
    ["a.gltf", "a b.bin", "a.png"].iter().for_each(|name| stage.put(name, file));
    let graph = stage.graph((1, 2), r#""in": (type: "io.read_gltf", path: "a.gltf")"#);
    let files = pegbar_engine::key::files_of(&graph, graph.find("in").unwrap(), 0);
    assert_eq!(files, ["a.gltf", "a b.bin", "a.png"].map(|name| stage.path(name)));
    let digests = |bytes: &[u8]| {
        stage.put("a b.bin", bytes);
        let target = pegbar_engine::plan::Target { node: graph.find("in").unwrap(), frames: None };
        let plan = match pegbar_engine::plan::plan(&graph, &[target], &[], pegbar_engine::plan::Known::new()) {
            Ok(pegbar_engine::plan::Planned::Ready(plan)) => plan,
            _ => panic!("a plan of one source"),
        };
        let keys = pegbar_engine::key::Keys::of(&graph, &plan, &pegbar_engine::stamp::Files::new(None)).unwrap();
        keys.value(graph.find("in").unwrap(), 0, 0)
    };
    assert_ne!(digests(b"1234"), digests(b"4321"), "another buffer is another key");
}
