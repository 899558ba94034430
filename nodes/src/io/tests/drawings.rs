//! Vector drawings in whole graphs.

use std::sync::Arc;

use pegbar_engine::value::{Value, downcast};

use super::Stage;
use crate::algo::color::srgb_from_linear;
use crate::data::{Drawing, Image, KeyDrawings, KeyShapes, Shape};

const HEAD: &str = "<svg xmlns='http://www.w3.org/2000/svg' width='64' height='48'>";

/// A character of three paths in two groups, whose pose is a number.
fn character(pose: f64) -> String {
    format!(
        "<g id='body'><path id='belly' fill='#80c040' stroke='#123456' stroke-width='1.7' d='M{pose} 10C20 {pose} 30 20 40 30S20 40 10 30Z'/>
         <g id='eyes' opacity='.7'><circle id='eye' cx='{pose}' cy='20.3' r='3'/></g></g>
         <path id='mouth' fill='none' stroke='red' fill-rule='evenodd' d='M5 5Q{pose} 9 15 5M1 1L{pose} 2Z'/>"
    )
}

fn drawn(body: &str) -> Vec<u8> {
    format!("{HEAD}{body}</svg>").into_bytes()
}

fn one<T: Value>(stage: &Stage, node: &str) -> Result<Arc<T>, String> {
    stage.values((1, 1), &format!("\"x\": {node}"), "x").map(|mut v| downcast::<T>(v.remove(0)).unwrap())
}

#[test]
fn what_is_written_is_read_again_bit_by_bit() {
    let stage = Stage::new();
    for frame in 1..=3 {
        stage.put(&format!("in.{frame:04}.svg"), &drawn(&character(11.1 + f64::from(frame) / 3.0)));
    }
    let nodes = r#""in": (type: "io.read_drawings", path: "in.####.svg"),
        "files": (type: "io.write_drawings", drawing: "@in", path: "$out/f.####.svg"),
        "layers": (type: "io.write_drawings", drawing: "@in", path: "$out/l.svg")"#;
    assert!(stage.run((1, 3), nodes).is_complete());
    assert_eq!(stage.written(), ["f.0001.svg", "f.0002.svg", "f.0003.svg", "l.svg"]);
    let read = |path: &str, more: &str| {
        let values = stage.values((1, 3), &format!("\"x\": (type: \"io.read_drawings\", path: \"{path}\"{more})"), "x").unwrap();
        values.into_iter().map(|v| downcast::<Drawing>(v).unwrap()).collect::<Vec<_>>()
    };
    let before = read("in.####.svg", "");
    assert_eq!(read("out/f.####.svg", ", tolerance: 7.0"), before);
    assert_eq!(read("out/l.svg", ", layers: true")[2], before[2]);
    let d = &before[0];
    assert_eq!(
        (&d.names[..], &d.groups[1][..], d.size),
        (&["belly", "eye", "mouth"].map(String::from)[..], &["body", "eyes"].map(String::from)[..], [64.0, 48.0])
    );
    assert_eq!((d.paths.clone(), d.closed.clone(), d.depth.clone()), (vec![1, 1, 2], vec![1, 1, 0, 1], vec![0.0, 1.0, 2.0]));
    assert!((d.fill[1][3] - 0.7).abs() < 1e-15);
    // Browsers play the layers.
    let text = std::fs::read_to_string(stage.path("out/l.svg")).unwrap();
    assert_eq!((text.matches("<animate ").count(), text.matches("groupmode=\"layer\"").count()), (3, 3));
    assert!(
        text.contains(
            r#"dur="0.125s" repeatCount="indefinite" values="none;inline;none" keyTimes="0;0.3333333333333333;0.6666666666666666""#
        )
    );
}

#[test]
fn odd_drawings_are_written_and_read_again() {
    let stage = Stage::new();
    let odd = Drawing {
        points: vec![[0.1, 0.2], [3.0, 4.0], [0.1, 0.2], [1e-9, -1e21], [5.0, 5.0]],
        contours: vec![3, 1, 1],
        closed: vec![1, 0, 1],
        paths: vec![2, 0, 1],
        fill: vec![[0.2, 0.4, 0.6, 0.123], [1.0, 1.0, 1.0, 1.0], [0.0; 4]],
        stroke: vec![[0.0; 4], [0.0, 0.0, 0.0, 1.0], [1.0; 4]],
        width: vec![0.0, 0.1, 33.0],
        rule: vec![1, 0, 0],
        depth: vec![5.0, 0.5, 2.0],
        size: [12.5, 7.0],
        names: vec!["a \"<&>' \n".into(), String::new(), "b".into()],
        groups: vec![vec!["one".into(), "two & three".into()], vec!["one".into()], vec![]],
    };
    let npz = std::fs::File::create(stage.path("odd.npz")).unwrap();
    pegbar_engine::npz::write(&odd, false, npz).unwrap();
    let nodes = r#""in": (type: "io.read_value", path: "odd.npz", as: "Drawing"),
        "out": (type: "io.write_drawings", drawing: "@in", path: "$out/odd.svg")"#;
    assert!(stage.run((1, 1), nodes).is_complete());
    assert_eq!(*one::<Drawing>(&stage, r#"(type: "io.read_drawings", path: "out/odd.svg")"#).unwrap(), odd);
}

#[test]
fn shapes_and_keys_are_written_and_read_again() {
    let stage = Stage::new();
    stage.put("a.svg", &drawn(&character(12.0)));
    stage.put("b.svg", &drawn(&character(14.5)));
    let nodes = r#""shape": (type: "io.read_shapes", path: "a.svg", id: "belly"),
        "keys": (type: "io.read_key_shapes", path: ["a.svg", "b.svg"], ids: ["belly"]),
        "poses": (type: "io.read_key_drawings", path: ["a.svg", "b.svg"]),
        "s": (type: "io.write_drawings", drawing: "@shape", path: "$out/s.svg", fill_color: (1.0, 0.0, 0.0)),
        "k": (type: "io.write_drawings", drawing: "@keys", path: "$out/k.svg"),
        "p": (type: "io.write_drawings", drawing: "@poses", path: "$out/p.svg")"#;
    let report = stage.run((1, 1), nodes);
    assert!(report.is_complete(), "{:?}", report.failures);
    let shape = one::<Shape>(&stage, r#"(type: "io.read_shapes", path: "a.svg", id: "belly")"#).unwrap();
    assert_eq!(one::<Shape>(&stage, r#"(type: "io.read_shapes", path: "out/s.svg")"#).unwrap(), shape);
    let keys = one::<KeyShapes>(&stage, r#"(type: "io.read_key_shapes", path: ["a.svg", "b.svg"], ids: ["belly"])"#).unwrap();
    assert_eq!(one::<KeyShapes>(&stage, r#"(type: "io.read_key_shapes", path: "out/k.svg", keys_from: layers)"#).unwrap(), keys);
    assert_eq!((keys.names.concat(), keys.closed, keys.points.shape()[0]), ("ab".to_owned(), true, 2));
    let poses = one::<KeyDrawings>(&stage, r#"(type: "io.read_key_drawings", path: ["a.svg", "b.svg"])"#).unwrap();
    assert_eq!(one::<KeyDrawings>(&stage, r#"(type: "io.read_key_drawings", path: "out/p.svg", keys_from: layers)"#).unwrap(), poses);
    // A group is picked with the depth that it has among all.
    let eyes = one::<Drawing>(&stage, r#"(type: "io.read_drawings", path: "a.svg", group: "eyes")"#).unwrap();
    assert_eq!((eyes.names.concat(), eyes.depth.clone()), ("eye".to_owned(), vec![1.0]));
}

#[test]
fn keys_are_files_ids_or_layers() {
    let stage = Stage::new();
    let line = |id: &str, x: u32| format!("<path id='{id}' d='M0 0L{x} 5L9 9'/>");
    stage.put("two.svg", &drawn(&format!("{}{}", line("a", 1), line("b", 2))));
    stage.put("layers.svg", &drawn(&format!("<g id='up'>{}</g><g id='down' display='none'>{}</g>", line("p", 1), line("q", 7))));
    let keys = |node: &str| one::<KeyShapes>(&stage, &format!("(type: \"io.read_key_shapes\", {node})"));
    let found = keys(r#"path: "two.svg", ids: ["b", "a"]"#).unwrap();
    assert_eq!((found.names.concat(), found.points.data()[2]), ("ba".to_owned(), 2.0));
    assert_eq!(keys(r#"path: ["two.svg", "two.svg"], ids: ["a", "b"], per_segment: 3"#).unwrap().points.shape(), [2, 7, 2]);
    let found = keys(r#"path: "layers.svg", keys_from: layers"#).unwrap();
    assert_eq!((found.names.concat(), found.points.data()[8]), ("updown".to_owned(), 7.0));
    let shapes = stage.values((1, 2), r#""x": (type: "io.read_shapes", path: "layers.svg", layers: true)"#, "x").unwrap();
    let shapes: Vec<_> = shapes.into_iter().map(|v| downcast::<Shape>(v).unwrap().points[1][0]).collect();
    assert_eq!(shapes, [1.0, 7.0]);
}

#[test]
fn what_is_not_there_or_does_not_correspond_is_said_with_its_place() {
    let stage = Stage::new();
    stage.put("a.svg", &drawn("\n<path id='body' d='M0 0L5 5L9 9Z'/>\n<path id='leg' d='M0 0L1 1'/>"));
    stage.put("b.svg", &drawn("\n\n<path id='body' d='M0 0L5 5Z'/>"));
    stage.put("broken.svg", b"<svg xmlns='http://www.w3.org/2000/svg'>\n\n<path d='M0 0 wat'/></svg>");
    stage.put("latin.svg", b"<svg>\n\xE9</svg>");
    let plain = |e: String| e.replace(&format!("{}/", stage.path("").display().to_string().trim_end_matches('/')), "");
    let shape = |node: &str| plain(one::<Shape>(&stage, &format!("(type: \"io.read_shapes\", {node})")).unwrap_err());
    assert_eq!(shape(r#"path: "a.svg""#), "a.svg: expected one contour, found 2");
    assert_eq!(shape(r#"path: "a.svg", which: 3"#), "a.svg: expected `which` from 1 to 2, the number of contours, found 3");
    assert_eq!(shape(r#"path: "a.svg", id: "arm""#), "a.svg: expected a path or group `arm`, found none");
    stage.put("hidden.svg", &drawn("<g id='arm' display='none'><path d='M0 0L5 5L9 9Z'/></g>"));
    assert_eq!(shape(r#"path: "hidden.svg", id: "arm""#), "hidden.svg: expected a path or group `arm` that is drawn, found it hidden");
    assert_eq!(shape(r#"path: "a.svg", layers: true"#), "a.svg: expected a layer 1, found 0 layers");
    assert_eq!(
        shape(r#"path: "broken.svg""#),
        "broken.svg: line 3: expected path data as `M0 0 L10 0 L10 10 Z` in `d` of `path`, found `M0 0 wat`"
    );
    assert_eq!(shape(r#"path: "latin.svg""#), "latin.svg: line 2: expected text in UTF-8, found other bytes");
    let keys = |node: &str| plain(one::<KeyShapes>(&stage, &format!("(type: \"io.read_key_shapes\", {node})")).unwrap_err());
    assert_eq!(
        keys(r#"path: ["a.svg", "b.svg"], ids: ["body"]"#),
        "b.svg: line 3: expected a path `body` of the same nodes as a.svg: line 2, found 2 segments in one and 1 in the other"
    );
    assert_eq!(keys(r#"path: ["a.svg", "b.svg"], ids: ["a", "b", "c"]"#), "expected one id, or one for each of 2 files, found 3");
    assert_eq!(keys(r#"path: "a.svg", keys_from: layers"#), "a.svg: expected layers, found no group");
    let poses = plain(one::<KeyDrawings>(&stage, r#"(type: "io.read_key_drawings", path: ["a.svg", "b.svg"])"#).unwrap_err());
    assert_eq!(poses, "b.svg: expected 2 paths as in a.svg, found 1");
    let checked = stage.load((1, 1), r#""x": (type: "io.read_key_shapes", path: ["a.svg", "gone.svg"])"#).err().unwrap();
    assert!(checked.len() == 1 && checked[0].starts_with("expected a file at ") && checked[0].contains("gone.svg"), "{checked:?}");
}

#[test]
fn what_cannot_be_written_leaves_no_file() {
    let stage = Stage::new();
    let bad = Shape { points: vec![[0.0, f64::NAN]], closed: false };
    pegbar_engine::npz::write(&bad, false, std::fs::File::create(stage.path("bad.npz")).unwrap()).unwrap();
    let nodes = r#""in": (type: "io.read_value", path: "bad.npz", as: "Shape"),
        "out": (type: "io.write_drawings", drawing: "@in", path: "$out/bad.svg")"#;
    let report = stage.run((1, 1), nodes);
    assert_eq!(report.failures[0].error.message, "path 0: expected finite numbers, found NaN");
    assert!(stage.written().is_empty());
}

/// Drawings of other people, which are not part of the project: where `shared/data/drawings` does not lie next to it the test says so and passes.
#[test]
fn clip_art_looks_as_its_own_rasters() {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/drawings/openclipart"));
    if !folder.is_dir() {
        eprintln!("skipped: no folder of drawings");
        return;
    }
    // The mean difference on white, as seen on screen. Gradients are flat here; the rasters are of another renderer.
    for (name, most) in [
        ("bunny_01", 0.02),
        ("dancer_sketch_erich_schu_01", 0.02),
        ("red-eye_frog_mirko_maisc_01", 0.02),
        ("red_fedora", 0.06),
        ("tophat_benji_park_01", 0.07),
    ] {
        let file = |kind: &str| folder.join(format!("{name}.{kind}")).display().to_string();
        let nodes = format!(
            r#""in": (type: "io.read_drawings", path: "{}"), "x": (type: "render.drawings", drawing: "@in"), "r": (type: "io.read_image", path: "{}")"#,
            file("svg"),
            file("png")
        );
        let stage = Stage::new();
        let picture = |node: &str| downcast::<Image>(stage.values((1, 1), &nodes, node).unwrap().remove(0)).unwrap();
        let (ours, theirs) = (picture("x"), picture("r"));
        assert_eq!((ours.width(), ours.height()), (theirs.width(), theirs.height()), "{name}");
        let seen = |image: &Image| -> Vec<f64> {
            let (c, names) = (image.n_channels(), image.channels());
            let at = |name: &str| names.iter().position(|n| n == name);
            let rgb = ["R", "G", "B"].map(|n| at(n).or(at("Y")).unwrap());
            let on_white = |p: &[f32], k: usize| p[k] + 1.0 - image.alpha().map_or(1.0, |a| p[a]);
            image.samples().chunks_exact(c).flat_map(|p| rgb.map(|k| srgb_from_linear(f64::from(on_white(p, k))))).collect()
        };
        let (a, b) = (seen(&ours), seen(&theirs));
        let mean = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64;
        assert!(mean < most, "{name}: {mean}");
    }
}
