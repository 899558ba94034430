//! Files that come with Pegbar, and what `pegbar new` writes: in the layout that `pegbar fmt` gives, and running as they are.

use crate::support::root;
use crate::support::shot::cli;

#[test]
fn every_graph_file_is_laid_out_as_it_should_be() {
    let paths: Vec<String> = ["graphs", "examples", "tests/golden", "src/new"].map(|f| root().join(f).display().to_string()).into();
    let args: Vec<&str> = ["fmt", "--check"].into_iter().chain(paths.iter().map(String::as_str)).collect();
    let ran = cli(&args);
    assert_eq!(ran.code, 0, "lay them out by `pegbar fmt graphs examples tests/golden src/new`:\n{}{}", ran.out, ran.err);
}

#[test]
fn a_new_show_runs_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (show, shot, graph) = (path("frogs"), path("frogs/sq010/sh020"), path("frogs/graphs/comp.ron"));
    for args in [&["new", "show", &show][..], &["new", "shot", &shot], &["new", "graph", &graph], &["fmt", "--check", &show]] {
        let ran = cli(args);
        assert_eq!(ran.code, 0, "{args:?}: {}", ran.err);
    }
    assert_eq!(cli(&["new", "shot", &shot]).code, 2, "nothing is overwritten");
    let ran = cli(&["run", &path("frogs/graphs/example.ron"), "--shot", &shot, "--out", &path("out"), "--no-cache"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(folder.path().join("out/example/example.png").is_file());
    let png = path("out/example/example.png");
    let whence = cli(&["whence", &png]);
    let expected = "// pegbar 0.1.0: pegbar run example.ron --shot ../sq010/sh020\n// with ../show.ron, ../sq010/sequence.ron, ../sq010/sh020/shot.ron;";
    assert!(whence.code == 0 && whence.out.starts_with(expected), "{} {}", whence.out, whence.err);
    assert_eq!(cli(&["whence", &png, "--extract", &path("old")]).code, 0);
    assert_eq!(cli(&["diff", &path("frogs/graphs/example.ron"), &path("old/graph/example.ron")]).code, 0);
    assert_eq!(cli(&["whence", &path("frogs/show.ron")]).code, 1);
    let whose = cli(&["whose", &path("frogs/graphs/example.ron"), "soft.size", "--shot", &shot]);
    assert!(whose.code == 0 && whose.out.contains("$radius") && whose.out.contains("show.ron"), "{} {}", whose.out, whose.err);
}
