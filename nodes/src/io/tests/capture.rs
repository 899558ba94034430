//! Motion capture and markers through whole graphs.

use std::sync::Arc;

use pegbar_engine::value::{Curve, ValueRef, Vector, downcast};

use super::{Stage, only_failure};
use crate::data::{Markers2, Markers3, Pose, Skeleton};

/// A figure of centimetres at 48 frames a second: a T-pose, then an arm that turns by 30 degrees a frame.
const TAKE: &str = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 100 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
    JOINT LeftArm\n{\nOFFSET 0 50 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 30 0 0\n}\n}\n}\n\
    MOTION\nFrames: 5\nFrame Time: 0.0208333\n0 0 0 0 0 0 0 0 0\n0 100 0 0 0 0 0 0 0\n2 100 0 0 0 0 30 0 0\n4 100 0 0 0 0 60 0 0\n6 100 0 0 0 0 90 0 0\n";

fn all<T: pegbar_engine::value::Value>(values: Vec<ValueRef>) -> Vec<Arc<T>> {
    values.into_iter().map(|v| downcast::<T>(v).unwrap()).collect()
}

/// The hand and the hips at each frame.
fn hands(stage: &Stage, frames: (i64, i64), read: &str, more: &str) -> Vec<[f64; 3]> {
    let nodes = format!(
        r#"{more} "in": {read}, "m": (type: "markers.from_pose", skeleton: "@in.skeleton", pose: "@in.pose", joints: {{ "hand": "LeftArm_end" }}),"#
    );
    all::<Markers3>(stage.values(frames, &nodes, "m").unwrap()).iter().map(|m| m.points[0]).collect()
}

fn close(found: &[[f64; 3]], truth: &[[f64; 3]]) {
    assert_eq!(found.len(), truth.len());
    assert!(found.as_flattened().iter().zip(truth.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
}

/// Where the hand is when the arm has turned by so many degrees, and the hips have gone so many centimetres.
fn hand(degrees: f64, x: f64) -> [f64; 3] {
    let (s, c) = libm::sincos(degrees.to_radians());
    [(x + 30.0 * c) / 100.0, (150.0 + 30.0 * s) / 100.0, 0.0]
}

#[test]
fn a_take_plays_in_its_own_time_on_any_clock() {
    let stage = Stage::new();
    stage.put("take.bvh", TAKE.as_bytes());
    let read = |more: &str| format!(r#"(type: "io.read_bvh", path: "take.bvh", scale: 0.01, skip: 1{more})"#);
    // Two frames of the file for each of film; held at its end.
    close(&hands(&stage, (1, 3), &read(""), ""), &[hand(0.0, 0.0), hand(60.0, 4.0), hand(90.0, 6.0)]);
    let slow: Vec<[f64; 3]> = [0.0, 15.0, 30.0, 45.0].map(|d| hand(d, d / 15.0)).to_vec();
    close(&hands(&stage, (1, 4), &read(", speed: 0.25"), ""), &slow);
    close(&hands(&stage, (1, 3), &read(", start: 0.0625, speed: -0.5"), ""), &[hand(90.0, 6.0), hand(60.0, 4.0), hand(30.0, 2.0)]);
    close(&hands(&stage, (1, 4), &read(", end: loop"), ""), &[hand(0.0, 0.0), hand(60.0, 4.0), hand(30.0, 2.0), hand(0.0, 0.0)]);
    close(&hands(&stage, (1, 2), &read(", fps: 24"), ""), &[hand(0.0, 0.0), hand(30.0, 2.0)]);
    let text = r#"Graph(pegbar: 1, frames: (first: 1, last: 2, fps: 24), clocks: { "capture": (first: 0, last: 4, fps: 48) }, nodes: {
        "in": (type: "io.read_bvh", path: "take.bvh", scale: 0.01, clock: "capture") }, outputs: { "pose": "@in.pose" })"#;
    let options = pegbar_engine::check::LoadOptions::default();
    let graph = pegbar_engine::check::load_text(&stage.path("x.ron"), text, &crate::registry(), &options).graph.unwrap();
    let port = pegbar_engine::graph::Port { node: graph.find("in").unwrap(), output: 1 };
    let mut report = pegbar_engine::exec::execute(&graph, &[], &[port], &pegbar_engine::exec::Options::default()).unwrap();
    let poses = all::<Pose>(report.kept.remove(&port).unwrap().into_iter().map(Option::unwrap).collect());
    let x: Vec<f64> = poses.iter().map(|p| p.translations[0][0]).collect();
    assert_eq!(x, [0.0, 0.0, 0.02, 0.04, 0.06], "the file's own frames, bit by bit");
}

#[test]
fn poses_between_frames_are_turned_the_short_way() {
    let stage = Stage::new();
    stage.put("take.bvh", TAKE.as_bytes());
    let read = r#""in": (type: "io.read_bvh", path: "take.bvh", scale: 0.01, skip: 1),"#;
    let played = |more: &str| {
        let nodes = format!(
            r#"{read} "r": (type: "pose.resample", pose: "@in.pose"{more}),
            "m": (type: "markers.from_pose", skeleton: "@in.skeleton", pose: "@r", joints: {{ "hand": "LeftArm_end" }})"#
        );
        stage.values((1, 4), &nodes, "m").map(|v| all::<Markers3>(v).iter().map(|m| m.points[0]).collect::<Vec<_>>())
    };
    close(&played("").unwrap(), &[hand(0.0, 0.0), hand(60.0, 4.0), hand(90.0, 6.0), hand(90.0, 6.0)]);
    close(&played(", speed: 0.25").unwrap(), &[0.0, 15.0, 30.0, 45.0].map(|d| hand(d, d / 15.0)));
    close(&played(", speed: 4").unwrap(), &[hand(0.0, 0.0), hand(90.0, 6.0), hand(90.0, 6.0), hand(90.0, 6.0)]);
}

#[test]
fn what_is_written_stands_where_it_stood() {
    let stage = Stage::new();
    stage.put("take.bvh", TAKE.as_bytes());
    let read = |path: &str, up: &str| format!(r#"(type: "io.read_bvh", path: "{path}", scale: 0.01, skip: 1, up: {up})"#);
    for up in ["y", "z", "x"] {
        let nodes = format!(
            r#""in": {}, "w": (type: "io.write_bvh", skeleton: "@in.skeleton", pose: "@in.pose", path: "$out/a.bvh", scale: 0.01, order: yxz)"#,
            read("take.bvh", up)
        );
        assert!(stage.run((1, 4), &nodes).is_complete());
        assert_eq!(stage.written(), ["a.bvh"]);
        let again = r#"(type: "io.read_bvh", path: "out/a.bvh", scale: 0.01)"#;
        close(&hands(&stage, (1, 4), again, ""), &hands(&stage, (1, 4), &read("take.bvh", up), ""));
    }
    let skeleton = stage.values((1, 1), r#""in": (type: "io.read_bvh", path: "out/a.bvh", scale: 0.01)"#, "in").unwrap();
    assert_eq!(all::<Skeleton>(skeleton)[0].names, ["Hips", "LeftArm", "LeftArm_end"]);
}

#[test]
fn files_that_are_wrong_are_one_error_and_no_file() {
    let stage = Stage::new();
    let refused = |nodes: &str, file: &str| only_failure(&stage.run((1, 2), nodes), &stage.path(file));
    let write = r#""w": (type: "io.write_bvh", skeleton: "@in.skeleton", pose: "@in.pose", path: "$out/a.bvh")"#;
    stage.put("cut.bvh", &TAKE.as_bytes()[..TAKE.len() - 9]);
    let message = refused(&format!(r#""in": (type: "io.read_bvh", path: "cut.bvh"), {write}"#), "cut.bvh");
    assert!(message.ends_with("line 23, column 1: expected 9 numbers, those of a frame, found 5"), "{message}");
    stage.put("take.bvh", TAKE.as_bytes());
    let message = refused(&format!(r#""in": (type: "io.read_bvh", path: "take.bvh", skip: 5), {write}"#), "take.bvh");
    assert!(message.contains("expected `skip` below 5, the number of the file's frames, found 5"), "{message}");
    assert!(stage.written().is_empty());
}

#[test]
fn rigs_without_a_joint_for_a_marker_are_told_what_is_like_it() {
    let stage = Stage::new();
    stage.put("take.bvh", TAKE.as_bytes());
    let values = |more: &str| {
        let from = format!(r#""m": (type: "markers.from_pose", skeleton: "@in.skeleton", pose: "@in.pose"{more})"#);
        let nodes = format!(r#""in": (type: "io.read_bvh", path: "take.bvh"), {from}"#);
        stage.values((1, 1), &nodes, "m").map(|v| all::<Markers3>(v)[0].names.clone())
    };
    let message = values(r#", joints: { "hand": "LeftArm_End2" }"#).unwrap_err();
    assert_eq!(message, "expected a joint for `hand` (LeftArm_End2, like it `LeftArm_end`), found Hips, LeftArm, LeftArm_end");
    let message = values("").unwrap_err();
    assert!(
        message.starts_with("expected a joint for `left_elbow` (LeftForeArm), `left_wrist` (LeftHand), `right_shoulder` (RightArm"),
        "{message}"
    );
    assert_eq!(values(", missing: skip").unwrap(), ["pelvis", "left_shoulder"]);
    assert_eq!(values(", naming: every").unwrap(), ["Hips", "LeftArm", "LeftArm_end"]);
    let own = r#", naming: cmu, missing: skip, joints: { "tip": "LeftArm_end", "pelvis": "LeftArm" }"#;
    assert_eq!(values(own).unwrap(), ["pelvis", "left_shoulder", "tip"]);
}

/// An arm that turns, by so many degrees at each frame, in the plane that is turned about the vertical by `heading`.
fn arm(angles: &[i64], heading: i64, fps: f64) -> String {
    let rows: Vec<String> = angles.iter().map(|a| format!("0 100 0 0 0 {heading} {a} 0 0\n")).collect();
    let head = TAKE.split_once("MOTION").unwrap().0;
    format!("{head}MOTION\nFrames: {}\nFrame Time: {:.7}\n{}", angles.len(), 1.0 / fps, rows.concat())
}

#[test]
fn the_take_that_fits_drawings_best_is_found_with_its_heading() {
    let stage = Stage::new();
    stage.put("short.bvh", arm(&[0, 10], 0, 30.0).as_bytes());
    stage.put("other.bvh", arm(&[0, -20, -40, -60, -80, -60, -40, -20, 0], 0, 30.0).as_bytes());
    stage.put("same.bvh", arm(&[0, 0, 0, 20, 40, 50, 60, 80, 50, 0], 90, 30.0).as_bytes());
    stage.put("drawn.bvh", arm(&[20, 40, 60, 80], 0, 24.0).as_bytes());
    let limbs = r#"limbs: [("elbow", "hand")]"#;
    let joints = r#"joints: { "elbow": "LeftArm", "hand": "LeftArm_end" }"#;
    let nodes = |path: &str, more: &str| {
        format!(
            r#""d": (type: "io.read_bvh", path: "drawn.bvh", scale: 0.01), "m": (type: "markers.from_pose", skeleton: "@d.skeleton", pose: "@d.pose", {joints}),
            "c": (type: "camera.orthographic", scale: 100.0, size: (200, 200)), "s": (type: "markers.project", markers: "@m", camera: "@c"),
            "a": (type: "pose.descriptor", markers: "@s", {limbs}),
            "f": (type: "io.search_bvh", target: "@a.angles", camera: "@c", path: {path}, scale: 0.01, {limbs}, {joints}{more})"#
        )
    };
    let files = r#"["short.bvh", "other.bvh", "same.bvh"]"#;
    let vector =
        |port: &str| all::<Vector>(stage.values((1, 4), &nodes(files, ", headings: 4"), &format!("f.{port}")).unwrap())[0].values.clone();
    assert_eq!(vector("order"), [2.0, 0.0, 1.0]);
    let distances = vector("distances");
    assert!(distances[2] < 1e-9 && distances[1] > distances[0] && distances[0] > 0.1, "{distances:?}");
    assert!((vector("headings_deg")[2] - 270.0).abs() < 1e-9);
    let hands = |more: &str| {
        let markers = format!(
            r#"{}, "found": (type: "markers.from_pose", skeleton: "@f.skeleton", pose: "@f.pose", joints: {{ "hand": "LeftArm_end" }})"#,
            nodes(files, more)
        );
        all::<Markers3>(stage.values((1, 4), &markers, "found").unwrap()).iter().map(|m| m.points[0]).collect::<Vec<_>>()
    };
    close(&hands(", headings: 4"), &[20.0, 40.0, 60.0, 80.0].map(|a| hand(a, 0.0)));
    let frames = all::<Curve>(stage.values((1, 4), &nodes(files, ", headings: 4"), "f.frame").unwrap());
    assert_eq!(frames.iter().map(|c| c.value).collect::<Vec<_>>(), [3.0, 4.0, 6.0, 7.0]);
    let refused = |path: &str, more: &str| stage.values((1, 4), &nodes(path, more), "f").unwrap_err();
    assert!(refused(r#""same.bvh""#, ", skip: 10").contains("expected more than 10 frames"));
}

#[test]
fn takes_of_many_makers_have_the_standard_markers() {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/mocap"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no folder {}", folder.display());
        return;
    }
    let stage = Stage::new();
    // Markers of the rig, metres a unit, and the axis up.
    for (name, count, scale, up) in [
        ("cmu_01_01.bvh", 22, 0.056444, "y"),
        ("cmu_jumping_jacks.bvh", 22, 0.056444, "y"),
        ("cmu_37_01_slow_walk.bvh", 22, 0.0254, "y"),
        ("cmu_10_02_kick.bvh", 22, 0.0254, "y"),
        ("ad_dab.bvh", 24, 0.0254, "z"),
        ("ad_jumping.bvh", 24, 0.0254, "z"),
        ("ad_jesse_dance.bvh", 24, 0.01, "y"),
        ("pymo_8walk_meredith.bvh", 22, 0.0254, "y"),
    ] {
        let nodes = format!(
            r#""in": (type: "io.read_bvh", path: "{}", scale: {scale}, up: {up}, skip: 1),
            "m": (type: "markers.from_pose", skeleton: "@in.skeleton", pose: "@in.pose"),"#,
            folder.join(name).display()
        );
        let markers = all::<Markers3>(stage.values((1, 24), &nodes, "m").unwrap());
        assert_eq!(markers[0].names.len(), count, "{name}: {:?}", markers[0].names);
        let at = |m: &Markers3, name: &str| m.points[m.find(name).unwrap()];
        for m in &markers {
            // Dancers crouch, and lift a foot.
            let height = at(m, "head")[1] - at(m, "left_ankle")[1];
            assert!((0.4..2.0).contains(&height), "{name}: {height}");
            for [a, b] in crate::algo::markers::standard::limbs(&m.names) {
                let length = m.points[a].iter().zip(m.points[b]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
                assert!((0.02..1.0).contains(&length), "{name}: {} to {}: {length}", m.names[a], m.names[b]);
            }
        }
    }
}

const MARKS: &str = "frame,name,x,y\n1,hip,10,20\n1,hand,30,40\n3,hip,14,20\n3,hand,,\n";

#[test]
fn markers_are_read_as_asked() {
    let stage = Stage::new();
    stage.put("m.csv", MARKS.as_bytes());
    let read = |more: &str| {
        let nodes = format!(r#""m": (type: "io.read_markers", path: "m.csv"{more})"#);
        stage.values((1, 3), &nodes, "m").map(all::<Markers2>)
    };
    let x = |more: &str| read(more).unwrap().iter().map(|m| m.points[0][0]).collect::<Vec<f64>>();
    assert!(read("").unwrap_err().ends_with("m.csv: expected a place of `hip` at frame 2, found none"));
    assert_eq!(x(", missing: hold"), [10.0, 10.0, 14.0]);
    assert_eq!(x(", missing: interpolate"), [10.0, 12.0, 14.0]);
    assert_eq!(x(", missing: interpolate, scale: 2"), [20.0, 24.0, 28.0]);
    assert!(x(", missing: nan")[1].is_nan());
    let hand = read(r#", missing: interpolate, names: ["hand"], offset: 1"#).unwrap();
    assert_eq!((&hand[2].names[..], hand[2].points[0]), (&["hand".to_owned()][..], [30.0, 40.0]));
    let up = read(", missing: hold, size: (64, 48), origin: bottom").unwrap();
    assert_eq!(up[0].points, [[10.0, 28.0], [30.0, 8.0]]);
    let said = |more: &str| read(more).unwrap_err();
    assert!(said(r#", names: ["hnd"]"#).ends_with("expected a marker `hnd`, found hip, hand; did you mean `hand`?"));
    assert!(said(", size: (4, 4)").contains("expected markers in or near the picture of 4 x 4, found 3 of 3 points far from it"));
    assert!(said(", units: fraction, size: (64, 48)").contains("they look like pixels"));
    assert!(said(", size: (64, 48), scale: 0.01").contains("they look like fractions"));
    assert!(said(", origin: bottom").contains("expected `size`"));
    stage.put("f.csv", b"frame,name,x,y\n1,hip,0.1,0.2\n1,hand,0.3,0.4\n2,hip,0.1,0.2\n2,hand,0.3,0.4\n");
    let small = stage.values((1, 2), r#""m": (type: "io.read_markers", path: "f.csv")"#, "m").unwrap_err();
    assert!(small.ends_with("they look like fractions, `units: fraction` with a `size`"), "{small}");
    stage.put("m.csv", MARKS.replace("14,20", "nan,20").as_bytes());
    assert!(said("").ends_with("m.csv: line 4, column `x`: expected a number, or nothing where the marker is not seen, found `nan`"));
}

#[test]
fn markers_that_are_written_read_back_in_either_form() {
    let stage = Stage::new();
    stage.put("m.csv", MARKS.as_bytes());
    let read = |id: &str, path: &str, more: &str| format!(r#""{id}": (type: "io.read_markers", path: "{path}", missing: nan{more}),"#);
    let write =
        |id: &str, path: &str| format!(r#""{id}": (type: "io.write_markers", markers: "@in", path: "$out/{path}", size: (64, 48)),"#);
    let report = stage.run((1, 3), &[read("in", "m.csv", ""), write("csv", "a.csv"), write("json", "a.json")].concat());
    assert!(report.is_complete(), "{:#?}", report.failures);
    let text = std::fs::read_to_string(stage.path("out/a.csv")).unwrap();
    assert!(text.starts_with("frame,name,x [px],y [px]\r\n1,hip,10,20\r\n1,hand,30,40\r\n2,hip,,\r\n"), "{text}");
    let points = |path: &str, more: &str| {
        let found = all::<Markers2>(stage.values((1, 3), &read("in", path, more), "in").unwrap());
        found.iter().map(|m| m.points.clone()).collect::<Vec<_>>()
    };
    let same = |a: &[Vec<[f64; 2]>], b: &[Vec<[f64; 2]>], factor: f64| {
        let (a, b) = (a.concat().concat(), b.concat().concat());
        a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| a * factor == *b || a.is_nan() && b.is_nan())
    };
    let first = points("m.csv", "");
    assert!(same(&first, &points("out/a.csv", ""), 1.0) && same(&first, &points("out/a.json", ""), 1.0));
    assert!(same(&first, &points("out/a.json", ", size: (128, 96)"), 2.0), "brought to another size");
}

#[test]
fn a_perspective_camera_does_not_see_behind_itself() {
    let stage = Stage::new();
    stage.put("take.bvh", TAKE.as_bytes());
    let seen = |camera: &str| {
        let nodes = format!(
            r#""in": (type: "io.read_bvh", path: "take.bvh", skip: 1), "c": (type: "camera.{camera}, size: (200, 100), target: (0.0, 100.0, 0.0)),
            "m": (type: "markers.from_pose", skeleton: "@in.skeleton", pose: "@in.pose", naming: every),
            "s": (type: "markers.project", markers: "@m", camera: "@c"),"#
        );
        all::<Markers2>(stage.values((1, 1), &nodes, "s").unwrap())[0].clone()
    };
    let flat = seen(r#"orthographic", scale: 0.5, distance: -10.0"#);
    assert!(
        flat.points
            .iter()
            .zip([[100.0, 50.0], [100.0, 25.0], [115.0, 25.0]])
            .all(|(a, b)| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9)
    );
    assert_eq!(flat.names, ["Hips", "LeftArm", "LeftArm_end"]);
    // It stands on +x at 20 and looks along -x: the hand, at 30, is behind it.
    let deep = seen(r#"perspective", azimuth_deg: 90.0, distance: 20.0"#);
    assert_eq!(deep.points.iter().map(|p| p[0].is_nan() && p[1].is_nan()).collect::<Vec<_>>(), [false, false, true]);
    assert!((deep.points[0][0] - 100.0).abs() < 1e-9 && (deep.points[0][1] - 50.0).abs() < 1e-9);
}

#[test]
fn markers_on_twos_stay_on_twos_and_holds_stay() {
    let stage = Stage::new();
    let x = [0.0, 3.0, 2.0, 5.0, 5.0, 5.0, 7.0, 6.0, 9.0];
    let rows: Vec<String> = (1..=18).map(|f| format!("{f},a,{},0\n", x[(f - 1) / 2])).collect();
    stage.put("m.csv", format!("frame,name,x,y\n{}", rows.concat()).as_bytes());
    let smooth = |more: &str| {
        let nodes = format!(r#""in": (type: "io.read_markers", path: "m.csv"), "s": (type: "markers.smooth", markers: "@in"{more}),"#);
        stage.values((1, 18), &nodes, "s").map(|v| all::<Markers2>(v).iter().map(|m| m.points[0][0]).collect::<Vec<f64>>())
    };
    let before: Vec<f64> = (0..18).map(|f| x[f / 2]).collect();
    assert_eq!(smooth("").unwrap(), before, "off until it is asked for");
    let found = smooth(", window: 4").unwrap();
    assert!(found.chunks(2).all(|pair| pair[0] == pair[1]) && found[2] != before[2] && found[14] != before[14]);
    assert_eq!(found[6..12], before[6..12], "a drawing of six frames is a hold");
    assert_ne!(smooth(", window: 4, stand: 7").unwrap()[6], 5.0);
    assert!(smooth(", window: 4, cuts: [19]").unwrap_err().ends_with("cuts: expected frames of the markers, found 19"));
}
