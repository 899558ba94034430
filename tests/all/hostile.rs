//! Damage of every kind at the command line: one clear error, an exit code, nothing half-written under a final name, and no panic.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use pegbar_nodes::algo::codec::{DecodeOptions, decode};

use crate::support::shot::{Ran, Shot, names};

const SCENE: &str = r#""scene": (type: "cel.scene", scene: ball, size: (64, 48)),"#;

/// One error and no more, with these words, and an exit code.
fn one_error(what: &str, ran: &Ran, code: u8, words: &[&str]) {
    let errors = ran.err.lines().filter(|l| l.starts_with("error")).count();
    assert!(
        ran.code == code && errors == 1,
        "{what}: expected one error and exit code {code}, found {errors} and {}:\n{}",
        ran.code,
        ran.err
    );
    assert!(!ran.err.contains("panicked"), "{what}: found a panic:\n{}", ran.err);
    words.iter().for_each(|w| assert!(ran.err.contains(w), "{what}: expected `{w}` in\n{}", ran.err));
}

/// Three frames of pictures and of values, in files beside the graph `g.ron`.
fn footage() -> Shot {
    let nodes = format!(
        r#"{SCENE} "png": (type: "io.write_images", image: "@scene", path: "$out/p.#.png"),
        "exr": (type: "io.write_images", image: "@scene", path: "$out/p.#.exr"), "npz": (type: "io.write_value", value: "@scene.matte", path: "$out/p.#.npz"),"#
    );
    let shot = Shot::new(3, &nodes);
    let ran = shot.run_to(&shot.path("."));
    assert_eq!(ran.code, 0, "{}", ran.err);
    shot
}

/// The graph that reads footage of a kind and writes it again.
fn copy(kind: &str) -> String {
    let read = match kind {
        "npz" => {
            r#""in": (type: "io.read_value", path: "p.#.npz", as: "Matte"), "image": (type: "image.from_matte", matte: "@in"),"#.to_owned()
        }
        _ => format!(r#""image": (type: "io.read_images", path: "p.#.{kind}"),"#),
    };
    read + r#" "out": (type: "io.write_images", image: "@image", path: "$out/o.#.png"),"#
}

/// A good file in every way in which it can be damaged that a reader must see.
fn damages(good: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let cut = |n: usize| good[..n].to_vec();
    let mut overwritten = good.to_vec();
    let middle = good.len() / 2;
    overwritten[middle..middle + 64].iter_mut().for_each(|b| *b ^= 0xA5);
    let mut wrong_start = good.to_vec();
    wrong_start[..8].fill(b'x');
    vec![
        ("empty", Vec::new()),
        ("three bytes", cut(3)),
        ("cut in the head", cut(40)),
        ("cut in half", cut(good.len() / 2)),
        ("cut before the end", cut(good.len() - 20)),
        ("overwritten", overwritten),
        ("of another kind", wrong_start),
        ("text", b"not a picture at all\n".repeat(40)),
    ]
}

#[test]
fn damaged_files_are_one_error_each_and_cost_their_own_frame_alone() {
    let shot = footage();
    for kind in ["png", "exr", "npz"] {
        let name = format!("p.2.{kind}");
        let good = shot.get(&name);
        shot.graph(3, &copy(kind));
        for (damage, bytes) in damages(&good) {
            let what = format!("{kind} {damage}");
            shot.put(&name, &bytes);
            let out = shot.path(&what);
            let ran = shot.run_to(&out);
            one_error(&what, &ran, 1, &["error[PB0500]", "at frame 2", &name]);
            assert_eq!(names(&out), ["o.1.png", "o.3.png"], "{what}");
        }
        shot.put(&name, &good);
    }
}

/// A chunk of a PNG file with its check sum.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut crc = !0u32;
    for byte in kind.iter().chain(data) {
        crc ^= u32::from(*byte);
        (0..8).for_each(|_| crc = if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 });
    }
    [&(data.len() as u32).to_be_bytes()[..], kind, data, &(!crc).to_be_bytes()].concat()
}

/// The head of a PNG file that says that it is so large.
fn png_of(width: u32, height: u32) -> Vec<u8> {
    let head = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 6, 0, 0, 0]].concat();
    let signature = b"\x89PNG\r\n\x1a\n".to_vec();
    [signature, chunk(b"IHDR", &head), chunk(b"IDAT", &[0x78, 0x9c, 0x03, 0, 0, 0, 0, 1]), chunk(b"IEND", &[])].concat()
}

/// An OpenEXR file whose windows end far away.
fn widened_exr(mut bytes: Vec<u8>, side: i32) -> Vec<u8> {
    for window in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len() + 4;
        bytes[at + 8..at + 12].copy_from_slice(&side.to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&side.to_le_bytes());
    }
    bytes
}

#[test]
fn pictures_that_say_they_are_huge_are_refused_before_anything_is_allocated() {
    let shot = footage();
    let exr = shot.get("p.2.exr");
    for (kind, bytes) in [("png", png_of(100_000, 100_000)), ("exr", widened_exr(exr, 99_999))] {
        shot.graph(3, &copy(kind));
        shot.put(&format!("p.2.{kind}"), &bytes);
        let ran = shot.run();
        one_error(kind, &ran, 1, &["error[PB0500]", "at frame 2", &format!("p.2.{kind}")]);
        assert_eq!(shot.names("out"), ["o.1.png", "o.3.png"], "{kind}");
    }
}

#[test]
fn a_small_picture_in_a_vast_frame_is_refused_where_the_frame_is_filled() {
    let shot = footage();
    let mut bytes = shot.get("p.2.exr");
    let window = b"displayWindow\0box2i\0";
    let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len() + 4;
    bytes[at + 8..at + 16].copy_from_slice(&[199_999i32.to_le_bytes(), 199_999i32.to_le_bytes()].concat());
    shot.put("p.2.exr", &bytes);
    shot.graph(3, &copy("exr"));
    one_error("written as PNG", &shot.run(), 1, &["error[PB0500]", "at frame 2", "200000 x 200000"]);
    assert_eq!(shot.names("out"), ["o.1.png", "o.3.png"]);
    shot.graph(
        3,
        r#""image": (type: "io.read_images", path: "p.#.exr"), "out": (type: "io.write_images", image: "@image", path: "$out/o.#.exr"),"#,
    );
    assert_eq!(shot.run().code, 0, "a file that says where its samples lie holds it");
}

#[test]
fn a_missing_frame_is_found_before_anything_runs() {
    let shot = footage();
    shot.graph(3, &copy("png"));
    std::fs::remove_file(shot.path("p.2.png")).unwrap();
    let ran = shot.run();
    one_error("missing", &ran, 2, &["error[PB0161]", "2"]);
    assert_eq!(shot.names("out"), [""; 0]);
}

#[test]
fn a_file_in_the_place_of_the_output_folder_is_left_alone() {
    let shot = Shot::new(2, &format!(r#"{SCENE} "out": (type: "io.write_images", image: "@scene", path: "$out/o.#.png"),"#));
    shot.put("out", b"precious");
    let ran = shot.run();
    one_error("a file", &ran, 2, &["error[PB0513]", "--out"]);
    assert_eq!(shot.get("out"), b"precious");
}

#[test]
fn a_folder_in_the_place_of_an_output_file_is_left_alone() {
    let shot = Shot::new(2, &format!(r#"{SCENE} "out": (type: "io.write_images", image: "@scene", path: "$out/o.#.png"),"#));
    std::fs::create_dir_all(shot.path("out/o.2.png")).unwrap();
    let ran = shot.run();
    one_error("a folder", &ran, 1, &["error[PB0500]", "at frame 2", "o.2.png"]);
    assert_eq!(shot.names("out"), ["o.1.png", "o.2.png"]);
    assert!(shot.path("out/o.2.png").is_dir());
}

/// A file system of its own, gone with the value.
struct Mount(PathBuf);

impl Mount {
    /// `None` where this process may not mount anything; the test then says that it was skipped.
    fn new(folder: &Path, options: &str) -> Option<Self> {
        std::fs::create_dir_all(folder).unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(folder).output();
        if mounted.is_ok_and(|o| o.status.success()) {
            return Some(Self(folder.to_owned()));
        }
        eprintln!("skipped: no file system may be mounted here");
        None
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_read_only_file_system_is_told_before_anything_runs() {
    let shot = Shot::new(2, &format!(r#"{SCENE} "out": (type: "io.write_images", image: "@scene", path: "$out/o.#.png"),"#));
    let Some(mount) = Mount::new(&shot.path("out"), "ro") else { return };
    let ran = shot.run();
    drop(mount);
    one_error("read-only", &ran, 2, &["error[PB0513]", "Read-only file system"]);
}

#[test]
fn a_full_disk_leaves_whole_files_only() {
    let nodes = r#""scene": (type: "cel.scene", scene: ball, size: (320, 180), grain: 4.0),
        "out": (type: "io.write_images", image: "@scene", path: "$out/o.#.png"),"#;
    let shot = Shot::new(4, nodes);
    let ran = shot.run_to(&shot.path("good"));
    assert_eq!(ran.code, 0, "{}", ran.err);
    let size = std::fs::metadata(shot.path("good/o.1.png")).unwrap().len() / 1024;
    // Room for two of the four.
    let Some(mount) = Mount::new(&shot.path("out"), &format!("size={}k", size * 5 / 2)) else { return };
    let ran = shot.run();
    let found: Vec<(String, Vec<u8>)> = shot.names("out").into_iter().map(|n| (n.clone(), shot.get(&format!("out/{n}")))).collect();
    drop(mount);
    assert_eq!(ran.code, 1, "{}", ran.err);
    assert!(ran.err.contains("No space left on device") && !ran.err.contains("panicked"), "{}", ran.err);
    assert!(!found.is_empty() && found.len() < 4, "{} files", found.len());
    for (name, bytes) in found {
        assert!(bytes == shot.get(&format!("good/{name}")), "{name}: expected a whole file, found {} bytes", bytes.len());
    }
}

fn pegbar() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pegbar"))
}

#[test]
fn the_process_ends_with_the_codes_that_the_help_promises() {
    let shot = footage();
    let run = |graph: &str| {
        let ran = pegbar().args(["run", graph, "--out"]).arg(shot.path("out")).current_dir(shot.path(".")).output().unwrap();
        (ran.status.code(), String::from_utf8_lossy(&ran.stderr).into_owned())
    };
    shot.graph(3, &copy("png"));
    let (code, err) = run("g.ron");
    assert_eq!(code, Some(0), "{err}");
    shot.put("p.3.png", b"no picture");
    let (code, err) = run("g.ron");
    assert_eq!(code, Some(1), "{err}");
    assert_eq!(err.matches("error[").count(), 1, "{err}");
    let (code, err) = run("nowhere.ron");
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("nowhere.ron"), "{err}");
    let ran = pegbar().arg("--frobnicate").output().unwrap();
    assert_eq!(ran.status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_run_with_whole_files_only() {
    // Far more than is made before the signal comes.
    let nodes = r#""scene": (type: "cel.scene", scene: ball, size: (640, 360), grain: 4.0), "soft": (type: "image.blur", image: "@scene", size: (20, 20)),
        "out": (type: "io.write_images", image: "@soft", path: "$out/o.####.png"),"#;
    let shot = Shot::new(5000, nodes);
    let mut command = pegbar();
    command.args(["run", "g.ron", "--progress", "json", "--threads", "2", "--out"]).arg(shot.path("out")).current_dir(shot.path("."));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    // Its first words say that it runs.
    assert!(lines.next().is_some_and(|l| l.is_ok()), "expected progress");
    while names(&shot.path("out")).iter().filter(|n| n.ends_with(".png") && !n.starts_with('.')).count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "expected a long run");
        std::thread::yield_now();
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    lines.for_each(drop);
    let ended = child.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(130), "{err}");
    assert!(err.contains("cancelled") && !err.contains("panicked"), "{err}");
    let left = shot.names("out");
    assert!((2..5000).contains(&left.len()), "{} files", left.len());
    for name in left {
        let whole = decode(&shot.get(&format!("out/{name}")), &DecodeOptions::default());
        assert!(whole.is_ok_and(|p| (p.width, p.height) == (640, 360)), "{name} is no whole picture");
    }
}
