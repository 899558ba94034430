//! Pictures in and out.

use std::sync::Arc;

use pegbar_engine::value::downcast;

use super::{Stage, only_failure};
use crate::algo::codec::{self, EncodeOptions, Format, Picture};
use crate::data::Image;

/// A small picture; without alpha for JPEG, which has none.
fn bytes(format: Format, value: f32) -> Vec<u8> {
    let channels: &[&str] = if format == Format::Jpeg { &["R", "G", "B"] } else { &["R", "G", "B", "A"] };
    let n = channels.len();
    let sample = |i: usize| if i % n == 3 { 1.0 } else { (i % 7) as f32 / 8.0 * value };
    let picture = Picture::new((0..4 * 3 * n).map(sample).collect(), 4, 3, channels).unwrap();
    codec::encode_to_vec(&picture, &EncodeOptions::new(format)).unwrap()
}

fn images(stage: &Stage, frames: (i64, i64), nodes: &str, node: &str) -> Result<Vec<Arc<Image>>, String> {
    Ok(stage.values(frames, nodes, node)?.into_iter().map(|v| downcast(v).unwrap()).collect())
}

#[test]
fn pictures_that_are_written_read_back() {
    let stage = Stage::new();
    for n in 1..=3 {
        stage.put(&format!("p.{n:04}.exr"), &bytes(Format::Exr, n as f32));
    }
    for (extension, settings, tolerance) in [
        ("exr", ", depth: float, compression: none", 0.0),
        ("exr", "", 0.0),
        ("tif", ", depth: float", 0.0),
        ("png", ", color: linear, depth: u16", 1.0),
    ] {
        let report = stage.run((1, 3), &format!(
            r#""in": (type: "io.read_images", path: "p.####.exr"), "w": (type: "io.write_images", image: "@in", path: "back.####.{extension}"{settings})"#
        ));
        assert!(report.is_complete(), "{:#?}", report.failures);
        let read = r#""in": (type: "io.read_images", path: "p.####.exr"),"#;
        let color = if extension == "png" { "linear" } else { "auto" };
        let back = format!(r#"{read} "back": (type: "io.read_images", path: "out/back.####.{extension}", color: {color})"#);
        let (a, b) = (images(&stage, (1, 3), &back, "in").unwrap(), images(&stage, (1, 3), &back, "back").unwrap());
        assert_eq!((a.len(), b.len()), (3, 3));
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((a.channels(), a.data_window()), (b.channels(), b.data_window()));
            // Integers clamp what is above one, so a PNG keeps but the darker half.
            let near = |(x, y): (&f32, &f32)| (x.min(1.0) - y.min(1.0)).abs() <= if tolerance > 0.0 { 1.0 / 65535.0 } else { 0.0 };
            assert!(a.samples().iter().zip(b.samples()).all(near));
        }
    }
}

#[test]
fn one_picture_is_read_and_written_once() {
    let stage = Stage::new();
    stage.put("hat.png", &bytes(Format::Png, 1.0));
    let report = stage
        .run((1, 8), r#""in": (type: "io.read_image", path: "hat.png"), "w": (type: "io.write_images", image: "@in", path: "a/hat.png")"#);
    assert!(report.is_complete());
    assert_eq!(report.stats.iter().map(|s| s.tasks).collect::<Vec<_>>(), [1, 1]);
    assert!(stage.path("out/a/hat.png").is_file());
}

#[test]
fn missing_frames_are_errors_or_filled() {
    let stage = Stage::new();
    for n in [2, 3, 6] {
        stage.put(&format!("p.{n}.exr"), &bytes(Format::Exr, n as f32));
    }
    let nodes = |missing: &str| format!(r#""in": (type: "io.read_images", path: "p.#.exr", missing: {missing})"#);
    let level = |missing: &str| -> Vec<f32> {
        images(&stage, (2, 7), &nodes(missing), "in").unwrap().iter().map(|i| i.samples()[1] * 8.0).collect()
    };
    assert_eq!(level("hold"), [2.0, 3.0, 3.0, 3.0, 6.0, 6.0]);
    assert_eq!(level("nearest"), [2.0, 3.0, 3.0, 6.0, 6.0, 6.0]);
    let errors = stage.load((2, 7), &nodes("error")).err().unwrap();
    assert_eq!(errors.len(), 1);
    assert!(errors[0].ends_with("found no 4-5, 7"), "{errors:?}");
    // A file that goes away after the check.
    let graph = stage.graph((2, 3), &nodes("error"));
    std::fs::remove_file(stage.path("p.3.exr")).unwrap();
    let sinkless = pegbar_engine::plan::Target { node: graph.find("in").unwrap(), frames: None };
    let report = pegbar_engine::exec::execute(&graph, &[sinkless], &[], &pegbar_engine::exec::Options::default()).unwrap();
    let message = only_failure(&report, &stage.path("p.3.exr"));
    assert!(message.contains("No such file"), "{message}");
    assert_eq!(report.failures[0].frame, Some(3));
}

#[test]
fn settings_that_cannot_be_are_found_before_anything_runs() {
    let stage = Stage::new();
    stage.put("hat.png", &bytes(Format::Png, 1.0));
    stage.put("hat.1.png", &bytes(Format::Png, 1.0));
    let error = |node: &str| {
        let nodes = format!(r#""in": (type: "io.read_image", path: "hat.png"), "x": {node}"#);
        let mut errors = stage.load((1, 1), &nodes).err().unwrap();
        assert_eq!(errors.len(), 1, "{errors:?}");
        errors.remove(0)
    };
    let write = |rest: &str| error(&format!(r#"(type: "io.write_images", image: "@in", {rest})"#));
    assert_eq!(write(r#"path: "a.gif""#), "expected a path ending in .png, .jpg, .tif or .exr, found .gif");
    assert_eq!(write(r#"path: "a""#), "expected a path ending in .png, .jpg, .tif or .exr, found no extension");
    assert_eq!(write(r#"path: "a.png", depth: half"#), "expected one of u8, u16 for png, found half");
    assert_eq!(write(r#"path: "a.jpg", compression: piz"#), "expected one of auto for jpeg, found piz");
    let out_of_range = write(r#"path: "a.jpg", quality: 0"#);
    assert!(out_of_range.contains("expected from 1 to 100, found 0"), "{out_of_range}");
    let single = error(r#"(type: "io.read_image", path: "hat.#.png")"#);
    assert!(single.contains("`io.read_images` reads one picture a frame"), "{single}");
    let many = error(r#"(type: "io.read_images", path: "hat.png")"#);
    assert!(many.contains("`io.read_image` reads one picture"), "{many}");
}

#[test]
fn a_damaged_picture_is_one_error_that_names_it_and_nothing_is_written() {
    let stage = Stage::new();
    let mut cases: Vec<(String, Vec<u8>)> = Vec::new();
    for format in [Format::Png, Format::Exr, Format::Tiff, Format::Jpeg] {
        let whole = bytes(format, 1.0);
        cases.push((format!("cut.{}", format.name()), whole[..whole.len() * 3 / 5].to_vec()));
        cases.push((format!("head.{}", format.name()), whole[..12].to_vec()));
    }
    let mut flipped = bytes(Format::Png, 1.0);
    flipped[20] ^= 0x55;
    cases.push(("flip.png".to_owned(), flipped));
    cases.push(("empty.png".to_owned(), Vec::new()));
    cases.push(("text.png".to_owned(), b"<svg/>".to_vec()));
    for (name, bytes) in cases {
        stage.put(&name, &bytes);
        let report = stage.run(
            (1, 2),
            &format!(r#""in": (type: "io.read_image", path: "{name}"), "w": (type: "io.write_images", image: "@in", path: "x.png")"#),
        );
        let message = only_failure(&report, &stage.path(&name));
        assert!(message.contains("expected") && !message.contains("panicked"), "{message}");
        assert!(stage.written().is_empty());
    }
}

#[test]
fn a_picture_of_ten_gigapixels_is_refused_by_its_header() {
    let stage = Stage::new();
    let mut png = bytes(Format::Png, 1.0);
    for (at, side) in [(16, 100_000u32), (20, 100_000)] {
        png[at..at + 4].copy_from_slice(&side.to_be_bytes());
    }
    // The checksum of the header, so that it is the size alone that is wrong.
    let mut crc = flate2::Crc::new();
    crc.update(&png[12..29]);
    png[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    stage.put("huge.png", &png);
    let error = stage.values((1, 1), r#""in": (type: "io.read_image", path: "huge.png")"#, "in").unwrap_err();
    assert!(error.contains("100000 x 100000"), "{error}");
}

#[test]
fn a_picture_above_the_limit_that_is_set_is_refused() {
    let stage = Stage::new();
    stage.put("hat.png", &bytes(Format::Png, 1.0));
    let nodes = |limit: u32| format!(r#""in": (type: "io.read_image", path: "hat.png", max_samples: {limit})"#);
    assert!(stage.values((1, 1), &nodes(48), "in").is_ok());
    let error = stage.values((1, 1), &nodes(47), "in").unwrap_err();
    assert!(error.contains("expected at most 47 samples"), "{error}");
}

#[test]
fn a_place_that_cannot_be_written_is_one_error_and_no_file() {
    let stage = Stage::new();
    stage.put("hat.png", &bytes(Format::Png, 1.0));
    stage.put("out/file", b"");
    std::fs::create_dir(stage.path("out/folder.png")).unwrap();
    let run = |path: &str| {
        stage.run(
            (1, 1),
            &format!(r#""in": (type: "io.read_image", path: "hat.png"), "w": (type: "io.write_images", image: "@in", path: "{path}")"#),
        )
    };
    let message = only_failure(&run("folder.png"), &stage.path("folder.png"));
    assert!(message.contains("found a folder"), "{message}");
    let message = only_failure(&run("file/a.png"), &stage.path("a.png"));
    assert!(message.contains("making its folder failed"), "{message}");
    assert_eq!(stage.written(), ["file", "folder.png"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_or_read_only_disk_is_one_error_and_no_file() {
    let stage = Stage::new();
    stage.put("hat.png", &bytes(Format::Png, 1.0));
    let mount = |how: &str| {
        std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", how, "tmpfs"])
            .arg(stage.path("out"))
            .output()
            .is_ok_and(|o| o.status.success())
    };
    let unmount = || std::process::Command::new("umount").arg(stage.path("out")).status().is_ok_and(|s| s.success());
    let run = || {
        stage.run((1, 1), r#""in": (type: "io.read_image", path: "hat.png"), "w": (type: "io.write_images", image: "@in", path: "a.png")"#)
    };
    if !mount("size=4k") {
        eprintln!("skipped: no file system may be mounted here");
        return;
    }
    let filled = std::fs::write(stage.path("out/filler"), [0u8; 4096]);
    let (full, left) = (run(), stage.written());
    assert!(unmount() && filled.is_ok());
    let message = only_failure(&full, &stage.path("a.png"));
    assert!(message.contains("No space left on device"), "{message}");
    assert_eq!(left, ["filler"]);
    assert!(mount("ro"));
    let (read_only, left) = (run(), stage.written());
    assert!(unmount());
    let message = only_failure(&read_only, &stage.path("a.png"));
    assert!(message.contains("Read-only file system"), "{message}");
    assert!(left.is_empty());
}

/// Drawings and OpenEXR files of other programs, where they lie beside the workspace.
#[test]
fn pictures_of_other_programs_go_through_a_graph() {
    let roots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().skip(1).map(|up| up.join("../shared/data"));
    let Some(data) = roots.into_iter().find(|d| d.is_dir()).and_then(|d| d.canonicalize().ok()) else {
        println!("skipped: no ../shared/data beside the workspace");
        return;
    };
    let stage = Stage::new();
    let (dog, exr) = (data.join("cartoons/dog_walk/dog.####.png"), data.join("exr/DisplayWindow/t10.exr"));
    let nodes = format!(
        r#""dog": (type: "io.read_images", path: {dog:?}), "ball": (type: "io.read_image", path: {exr:?}),
           "a": (type: "io.write_images", image: "@dog", path: "dog.####.png", effort: balanced),
           "b": (type: "io.write_images", image: "@ball", path: "ball.exr", compression: piz),
           "c": (type: "io.write_value", value: "@dog", path: "dog.npz")"#
    );
    let report = stage.run((1, 3), &nodes);
    assert!(report.is_complete(), "{:#?}", report.failures);
    assert_eq!(stage.written().len(), 5);
    let back = format!(
        r#""dog": (type: "io.read_images", path: {dog:?}), "png": (type: "io.read_images", path: "out/dog.####.png"),
           "npz": (type: "io.read_value", path: "out/dog.npz", as: "Image"),
           "ball": (type: "io.read_image", path: {exr:?}), "exr": (type: "io.read_image", path: "out/ball.exr")"#
    );
    let of = |node| images(&stage, (1, 3), &back, node).unwrap();
    assert_eq!(of("dog"), of("npz"));
    assert_eq!(of("ball"), of("exr"), "half floats and both windows are kept");
    for (a, b) in of("dog").iter().zip(&of("png")) {
        // Premultiplied colours under a low alpha are rounded once more by the 8 bits of the file.
        let worst = a.samples().iter().zip(b.samples()).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        assert!(worst < 1.0 / 255.0, "{worst}");
    }
}
