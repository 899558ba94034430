//! The page as a whole, of runs on nodes of numbers and of pictures.

use std::path::Path;

use pegbar_engine::node::Cancel;
use pegbar_engine::registry::Registry;

use crate::{Console, run_cli};

/// Runs a graph, and gives exit code and standard error; with a report at `pages/r.html` where one is wanted.
fn run(folder: &Path, registry: &Registry, nodes: &str, has_report: bool, more: &[&str]) -> (u8, String) {
    let params = if nodes.contains("$size") { ", params: { \"size\": (type: \"any\", default: (32, 16)) }" } else { "" };
    let head = format!("pegbar: 1, frames: (first: 1, last: 8, fps: 24){params}");
    std::fs::write(folder.join("g.ron"), format!("Graph({head}, nodes: {{\n{nodes}\n}})\n")).unwrap();
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (graph, out, cache, page) = (path("g.ron"), path("out"), path("cache"), path("pages/r.html"));
    let mut args = vec!["pegbar", "run", &graph, "--out", &out, "--cache", &cache, "--progress", "none"];
    args.extend(more);
    if has_report {
        args.extend(["--report", &page]);
    }
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let mut console = Console { stdout: &mut stdout, stderr: &mut stderr, is_terminal: false, colour: false, cancel: Cancel::default() };
    let code = run_cli(args, registry, &mut console);
    (code, String::from_utf8(stderr).unwrap())
}

/// As [`run`], with the page.
fn report(folder: &Path, registry: &Registry, nodes: &str, more: &[&str]) -> (u8, String, String) {
    let (code, err) = run(folder, registry, nodes, true, more);
    (code, std::fs::read_to_string(folder.join("pages/r.html")).unwrap_or_default(), err)
}

/// Panics where tags are not closed in the order in which they were opened; gives the number of elements.
fn balanced(page: &str) -> usize {
    const VOID: [&str; 4] = ["meta", "img", "br", "!DOCTYPE"];
    let script = page.find("<script>").unwrap()..page.find("</script>").unwrap();
    let style = page.find("<style>").unwrap()..page.find("</style>").unwrap();
    let mut page = page.to_owned();
    page.replace_range(script.start + 8..script.end, "");
    page.replace_range(style.start + 7..style.end, "");
    let (mut open, mut n): (Vec<&str>, usize) = (Vec::new(), 0);
    for tag in page.split('<').skip(1) {
        let (inside, _) = tag.split_once('>').expect("a tag that ends");
        let name = inside.split([' ', '\n', '/']).find(|s| !s.is_empty()).unwrap();
        match inside.strip_prefix('/') {
            Some(closed) => assert_eq!(open.pop(), Some(closed), "in <{inside}>"),
            None if VOID.contains(&name) || inside.ends_with('/') => n += 1,
            None => {
                n += 1;
                open.push(name);
            }
        }
    }
    assert!(open.is_empty(), "{open:?}");
    n
}

/// Panics where the page names anything outside itself.
fn self_contained(page: &str) {
    for attribute in ["src=\"", "href=\"", "url(", "@import"] {
        for (at, _) in page.match_indices(attribute) {
            let target = &page[at + attribute.len()..];
            assert!(target.starts_with('#') || target.starts_with("data:image/"), "{attribute}{}", &target[..40]);
        }
    }
    let outside = page.match_indices("://").filter(|(at, _)| !page[..*at].ends_with("xmlns=\"http")).count();
    assert_eq!(outside, 0);
}

const NUMBERS: &str = r#""f": (type: "test.frame"),
        "g": (type: "test.gain", a: "@f", gain: 2.0),
        "out": (type: "test.write", value: "@g", path: "$out/n.##.txt"),"#;

#[test]
fn every_node_is_there_with_what_it_made_and_who_set_it() {
    let folder = tempfile::tempdir().unwrap();
    let (code, page, err) = report(folder.path(), &crate::tests::registry(), NUMBERS, &["--set", "g.gain=3.0"]);
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(balanced(&page) > 100);
    self_contained(&page);
    for (i, name) in ["f", "g", "out"].iter().enumerate() {
        assert!(page.contains(&format!("id=\"n{i}\"")) && page.contains(&format!("id=\"node-{i}\"><header><h3>{name}</h3>")), "{name}");
        assert!(page.contains(&format!("<a href=\"#node-{i}\">{name}</a>")), "{name}");
    }
    assert!(page.contains("value: 3 to 24, mean 13.5"), "the gain's numbers over all frames");
    assert!(page.contains(">3.0 <span class=\"soft\">px</span></td><td class=\"place\">command line<br>in place of graph <s>2.0</s>"));
    assert!(page.contains("g.ron:3:49") && page.contains("default 1.0"), "where the graph says it");
    assert!(page.contains("8 files") && page.contains("n.01.txt") && page.contains("<span class=\"state complete\">complete</span>"));
}

#[test]
fn a_failure_is_told_where_it_happened() {
    let folder = tempfile::tempdir().unwrap();
    let (code, page, _) = report(folder.path(), &crate::tests::registry(), NUMBERS, &["--set", "g.fails=4"]);
    assert_eq!(code, 1);
    balanced(&page);
    assert!(page.contains("<span class=\"state failed\">failed</span>"));
    assert!(page.contains("node `g` failed at frames 4-8: expected an early frame, found a late one"));
    assert!(page.contains("frame 4: expected an early frame, found a late one"));
    assert!(page.contains("3 ran, 5 failed") && page.contains("3 ran, 5 not reached"), "at the feet of `g` and of `out`");
}

const PICTURES: &str = r#""a": (type: "image.checkerboard", size: "$size"),
        "b": (type: "image.blur", image: "@a", expand: false),
        "out": (type: "io.write_images", image: "@b", path: "$out/b.png"),"#;

#[test]
fn what_is_made_and_kept_is_the_same_with_a_report_and_without() {
    let made = |has_report: bool| {
        let folder = tempfile::tempdir().unwrap();
        let ran = run(folder.path(), &pegbar_nodes::registry(), PICTURES, has_report, &["--keep", "always"]);
        assert_eq!(ran, (0, String::new()));
        let cache = pegbar_engine::cache::Cache::open(&folder.path().join("cache"), 1 << 30).unwrap().stats();
        (std::fs::read(folder.path().join("out/b.png")).unwrap(), cache.keys, cache.types)
    };
    assert_eq!(made(true), made(false));
}

#[test]
fn what_the_cache_has_is_read_back_and_what_it_has_not_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = |more: &[&str]| {
        let (code, page, err) = report(folder.path(), &pegbar_nodes::registry(), PICTURES, more);
        assert_eq!((code, err.as_str()), (0, ""));
        balanced(&page);
        self_contained(&page);
        (page.matches("\"data:image/jpeg;base64,").count(), page.contains("--no-cache makes it"))
    };
    assert_eq!(pictures(&["--keep", "never", "--keep", "b=always"]), (2, false));
    assert_eq!(pictures(&[]), (1, true), "the one that was kept");
}

#[test]
fn a_page_that_cannot_be_written_is_known_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("pages"), "").unwrap();
    let (code, _, err) = report(folder.path(), &crate::tests::registry(), NUMBERS, &[]);
    assert_eq!((code, folder.path().join("out/n.01.txt").exists()), (2, false));
    assert!(err.starts_with("error: the report cannot be written: "), "{err}");
}
