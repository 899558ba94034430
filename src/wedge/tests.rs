//! Wedges of nodes of numbers and of pictures.

use std::path::Path;

use pegbar_engine::node::Cancel;
use pegbar_engine::registry::Registry;

use crate::{Console, run_cli};

/// `f` is common, `a` differs by its gain, `b` by its own as well.
const NUMBERS: &str = r#""f": (type: "test.frame"),
        "c": (type: "test.gain", a: "@f", gain: 2.0),
        "a": (type: "test.gain", a: "@c"),
        "b": (type: "test.gain", a: "@a", gain: 1.0),
        "out": (type: "test.write", value: "@b", path: "$out/n.##.txt"),"#;

fn wedge(folder: &Path, registry: &Registry, nodes: &str, more: &[&str]) -> (u8, String, Vec<String>) {
    let params = if nodes.contains("$size") { ", params: { \"size\": (type: \"any\", default: (32, 16)) }" } else { "" };
    let head = format!("pegbar: 1, frames: (first: 1, last: 4, fps: 24){params}");
    std::fs::write(folder.join("g.ron"), format!("Graph({head}, nodes: {{\n{nodes}\n}})\n")).unwrap();
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (graph, out, cache) = (path("g.ron"), path("out"), path("cache"));
    let args = ["pegbar", "wedge", &graph, "--out", &out, "--cache", &cache, "-j", "2"];
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let mut console = Console { stdout: &mut stdout, stderr: &mut stderr, is_terminal: false, colour: false, cancel: Cancel::default() };
    let code = run_cli(args.iter().chain(more), registry, &mut console);
    let csv = std::fs::read_to_string(folder.join("out/wedge.csv")).unwrap_or_default();
    (code, String::from_utf8(stderr).unwrap(), csv.lines().map(str::to_owned).collect())
}

/// A column of a table.
fn column(csv: &[String], name: &str) -> Vec<String> {
    let at = csv[0].split(',').position(|c| c == name).unwrap_or_else(|| panic!("{name} in {}", csv[0]));
    csv[1..].iter().map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
}

#[test]
fn what_is_common_runs_once_and_every_variant_has_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let registry = crate::tests::registry();
    let (code, err, csv) = wedge(folder.path(), &registry, NUMBERS, &["--set", "a.gain=3..10x7", "--set", "b.gain=5.0,7.0"]);
    assert_eq!((code, csv.len()), (0, 5), "{err}");
    assert_eq!(
        (column(&csv, "a.gain"), column(&csv, "b.gain")),
        (["3", "3", "10", "10"].map(str::to_owned).to_vec(), ["5.0", "7.0", "5.0", "7.0"].map(str::to_owned).to_vec())
    );
    // Four frames of five nodes; then `c` is there and `f` not looked at; then, with another gain of `a`, `c` again.
    assert_eq!(column(&csv, "tasks"), ["20", "8", "12", "8"].map(str::to_owned));
    assert_eq!(column(&csv, "b.value max"), ["120", "168", "400", "560"].map(str::to_owned));
    assert_eq!(column(&csv, "b.value mean"), ["75", "105", "250", "350"].map(str::to_owned));
    assert!(!csv[0].contains("c.value"), "what is the same in all is not compared");
    let read = |name: &str| std::fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    assert_eq!(
        (read("wedge_a.gain=3,b.gain=7.0/n.02.txt"), read("wedge_a.gain=10,b.gain=7.0/n.04.txt")),
        ("84\n".to_owned(), "560\n".to_owned())
    );
    assert!(err.contains("1/4  a.gain=3, b.gain=5.0: 20 tasks ran, 0 from the cache, "), "{err}");
    let (code, _, again) = wedge(folder.path(), &registry, NUMBERS, &["--set", "a.gain=3..10x7", "--set", "b.gain=5.0,7.0", "--zip"]);
    assert_eq!((code, column(&again, "tasks")), (0, ["0", "0"].map(str::to_owned).to_vec()), "all of it is there");
    assert_eq!(column(&again, "b.value max"), ["120", "560"].map(str::to_owned), "numbers are read back");
}

#[test]
fn a_variant_that_fails_says_so_and_stops_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let (code, err, csv) = wedge(folder.path(), &crate::tests::registry(), NUMBERS, &["--set", "a.fails=2,100", "--set", "b.gain=1,99"]);
    assert_eq!(code, 1, "{err}");
    let states = column(&csv, "state");
    assert!(csv[1].contains("failed: node `a` failed at frames 2-4: expected an early frame"), "{}", csv[1]);
    assert!(csv[2].contains("expected from 0 to 10, found 99"), "out of range: {}", csv[2]);
    assert_eq!((states[2].as_str(), err.ends_with("failed: 3 of 4 variants\n")), ("done", true), "{err}");
    let (code, err, _) = wedge(folder.path(), &crate::tests::registry(), NUMBERS, &["--set", "x.gain=1,2"]);
    assert!(code == 2 && err.contains("PB0152"), "{err}");
    let (code, err, _) = wedge(folder.path(), &crate::tests::registry(), NUMBERS, &["--set", "a.gain=1"]);
    assert_eq!((code, err.lines().count()), (2, 1), "{err}");
}

#[test]
fn the_sheet_has_a_picture_of_each() {
    let nodes = r#""a": (type: "image.checkerboard", size: "$size", first: (1, 0, 0, 1), second: (1, 0, 0, 1)),
        "w": (type: "io.write_images", image: "@a", path: "$out/b.png"),"#;
    let folder = tempfile::tempdir().unwrap();
    let more = ["--var", "size=(200, 100),(100, 100)", "--set", "a.first=(1, 0, 0, 1),(0, 0, 1, 1)", "--set", "a.squares=(1000, 1000)"];
    for _ in 0..2 {
        let (code, err, csv) = wedge(folder.path(), &pegbar_nodes::registry(), nodes, &more);
        assert_eq!((code, csv.len()), (0, 5), "{err}");
        let png = std::fs::read(folder.path().join("out/wedge.png")).unwrap();
        let sheet = pegbar_nodes::algo::codec::decode(&png, &Default::default()).unwrap();
        assert_eq!((sheet.width, sheet.height), (12 + 2 * 212, 12 + 2 * (100 + 60 + 12)));
        let at = |x: usize, y: usize| sheet.pixels[(y * sheet.width + x) * 3..][..3].iter().map(|v| v.round() as i32).collect::<Vec<_>>();
        assert_eq!((at(50, 50), at(50 + 212, 50)), (vec![1, 0, 0], vec![1, 0, 0]), "sizes stand in a row, sets come before variables");
        assert_eq!((at(50, 50 + 172), at(50 + 212, 50 + 172)), (vec![0, 0, 1], vec![0, 0, 1]));
    }
}
