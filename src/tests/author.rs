//! Commands that lay out, compare, edit and upgrade graph files, and say who sets what.

use super::{FINE, Shot, cli};

#[test]
fn graphs_are_laid_out_in_one_way_and_what_is_broken_is_left_alone() {
    let shot = Shot::new("\"f\":(type:\"test.frame\",),// a comment");
    std::fs::write(shot.path("broken.ron"), "Graph(nodes: {").unwrap();
    let folder = shot.0.path().to_string_lossy().into_owned();
    let before = shot.read("g.ron");
    let ran = cli(&["fmt", "--check", &folder]);
    assert_eq!((ran.code, shot.plain(&ran.out).as_str()), (2, "g.ron\n"), "{}", ran.err);
    assert!(
        ran.err.contains("broken.ron:1:14") && ran.err.ends_with("2 files, 1 not canonical, 1 left alone because of errors\n"),
        "{}",
        ran.err
    );
    assert_eq!(shot.read("g.ron"), before);
    assert_eq!(cli(&["fmt", &shot.path("g.ron")]).code, 0);
    assert!(shot.read("g.ron").unwrap().contains("        \"f\": (type: \"test.frame\"), // a comment\n"));
    assert_eq!(cli(&["fmt", "--check", &shot.path("g.ron")]).code, 0);
    assert_eq!(shot.read("broken.ron").as_deref(), Some("Graph(nodes: {"));
}

#[test]
fn every_layer_that_says_something_of_a_setting_is_named() {
    let shot = Shot::new(FINE);
    let folder = |name: &str| shot.path(name);
    std::fs::create_dir_all(folder("show/sh")).unwrap();
    std::fs::write(folder("show/show.ron"), "Layer(pegbar: 1, set: { \"g.gain\": 3 })").unwrap();
    std::fs::write(folder("show/sh/shot.ron"), "Layer(\n    pegbar: 1,\n    set: { \"g.gain\": 4 },\n)").unwrap();
    let (graph, sh) = (folder("g.ron"), folder("show/sh"));
    let ran = cli(&["whose", &graph, "g.gain", "--shot", &sh, "--set", "g.gain=5"]);
    let columns = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>().join(" ");
    let said: Vec<String> = shot.plain(&ran.out).lines().map(columns).collect();
    let expected =
        ["g.gain", "command line 5", "shot show/sh/shot.ron:3:22 4", "show show/show.ron:1:35 3", "graph g.ron:6:49 2.0", "default 1.0"];
    assert_eq!((ran.code, said), (0, expected.map(str::to_owned).to_vec()), "{}", ran.err);
    let all = cli(&["whose", &graph, "--shot", &sh, "--format", "json"]);
    let json: serde_json::Value = serde_json::from_str(&all.out).unwrap();
    assert_eq!((json.as_array().map(Vec::len), &json[0]["settings"][0]["text"]), (Some(1), &"4".into()));
    let wrong = cli(&["whose", &graph, "g.gian"]);
    assert!(wrong.code == 2 && wrong.err.contains("did you mean `g.gain`?"), "{}", wrong.err);
    assert_eq!(shot.run(&["--shot", &sh, "--frames", "2"]).code, 0);
    assert_eq!(shot.read("out/n.02.txt").as_deref(), Some("8\n"));
}

#[test]
fn two_graphs_are_compared_by_meaning() {
    let (one, other) = (Shot::new(FINE), Shot::new(&FINE.replace("2.0", "3.0").replace("\"out\"", "\"written\"")));
    let (a, b) = (one.path("g.ron"), other.path("g.ron"));
    let ran = cli(&["diff", &a, &b]);
    assert_eq!((ran.code, ran.out.as_str()), (1, "> nodes.out is now nodes.written\n~ nodes.g.gain: 2.0 is now 3.0\n"), "{}", ran.err);
    cli(&["fmt", &a]);
    assert_eq!(cli(&["diff", &a, &one.path("g.ron")]).code, 0);
    std::fs::write(&b, "Graph(nodes: {").unwrap();
    assert_eq!(cli(&["diff", &a, &b]).code, 2);
}

#[test]
fn a_graph_is_edited_from_a_script() {
    let shot = Shot::new(FINE);
    let (graph, before) = (shot.path("g.ron"), shot.read("g.ron").unwrap());
    assert_eq!(cli(&["edit", &graph, "--set", "g.gain=3.5", "--rename", "f=first", "--unset", "out.lies"]).code, 2);
    assert_eq!(shot.read("g.ron").as_ref(), Some(&before), "nothing changed: `out` has no `lies`");
    let ran = cli(&["edit", &graph, "--set", "g.gain=3.5", "--rename", "f=first"]);
    assert_eq!((ran.code, ran.err.as_str()), (0, ""));
    let expected = before.replace("2.0", "3.5").replace("\"f\":", "\"first\":").replace("\"@f\"", "\"@first\"");
    assert_eq!(shot.read("g.ron"), Some(expected));
    assert!(cli(&["edit", &graph, "--remove", "first"]).err.contains("which `g` reads"));
}

#[test]
fn graphs_of_older_nodes_are_brought_up_to_date() {
    let shot = Shot::new(&FINE.replace("test.gain", "test.amplify").replace("gain: 2.0", "factor: 2.0"));
    std::fs::write(
        shot.path("list.txt"),
        r#"[(node: "test.amplify", to: "test.gain", inputs: {"factor": "gain"}, note: "one name for both")]"#,
    )
    .unwrap();
    let (graph, list) = (shot.path("g.ron"), shot.path("list.txt"));
    assert_eq!(cli(&["check", &graph]).code, 2);
    assert_eq!(cli(&["upgrade", &graph]).code, 0, "nothing is known of it");
    assert_eq!(cli(&["upgrade", &graph, "--check", "--migrations", &list]).code, 1);
    let ran = cli(&["upgrade", &graph, "--migrations", &list]);
    assert_eq!(shot.plain(&ran.out), "g.ron: node `g`: `factor` is now `gain`; test.amplify is now test.gain (one name for both)\n");
    assert_eq!((ran.code, shot.run(&[]).code), (0, 0));
    std::fs::write(&list, "[(nodes: 1)]").unwrap();
    assert_eq!(cli(&["upgrade", &graph, "--migrations", &list]).code, 2);
}
