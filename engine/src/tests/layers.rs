//! Layers: who wins, what relative paths in them are held against, and what is told of where a setting comes from.

use std::path::Path;

use crate::check::{Layer, LoadOptions, Loaded, load};

use super::check_nodes::registry;

/// A show with one sequence and one shot around a graph of two nodes.
fn show() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, body: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, body).unwrap();
    };
    put(
        "graphs/sum.ron",
        r#"Graph(
            pegbar: 1,
            frames: (first: "$first", last: "$last", fps: 24),
            params: { "first": (type: "whole", default: 1), "last": (type: "whole", default: 4), "b": (type: "number", default: 1) },
            nodes: {
                "f": (type: "test.frame"),
                "x": (type: "test.add", a: "@f", b: "$b"),
                "y": (type: "graph:half.ron@1.1", input: "@f", b: "$b"),
            },
            outputs: { "x": "@x", "y": "@y" },
        )"#,
    );
    put(
        "library/half.ron",
        r#"Graph(
            pegbar: 1,
            version: "1.2.0",
            params: { "input": (type: "Curve"), "b": (type: "number", default: 9), "label": (type: "text", default: "$show $shot") },
            nodes: { "add": (type: "test.add", a: "$input", b: "$b"), "mix": (type: "test.blend", mode: linear, knots: [(1, 2)], label: "$label", more: "@add") },
            outputs: { "sum": "@add" },
        )"#,
    );
    put("site.ron", r#"Layer(pegbar: 1, params: { "b": 2, "last": 5 })"#);
    put("show/show.ron", r#"Layer(pegbar: 1, library: ["../library"], params: { "b": 3, "last": 6 }, set: { "x.b": 30 })"#);
    put("show/sq/sequence.ron", r#"Layer(pegbar: 1, params: { "b": 4 }, graphs: { "other": (params: { "b": 400 }) })"#);
    put("show/sq/sh/shot.ron", r#"Layer(pegbar: 1, graphs: { "sum": (params: { "b": 5 }, set: { "y/add.b": 50 }) })"#);
    folder
}

fn loaded(folder: &Path, shot: Option<&str>, more: LoadOptions) -> Loaded {
    let options = LoadOptions {
        site: Some(folder.join("site.ron")),
        shot: shot.map(|s| folder.join(s)),
        library: vec![folder.join("library")],
        ..more
    };
    let loaded = load(&folder.join("graphs/sum.ron"), &registry(), &options);
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded
}

/// The text of what stands at an input.
fn literal(loaded: &Loaded, node: &str, input: &str) -> String {
    let graph = loaded.graph.as_ref().unwrap();
    let node = &graph.nodes[graph.find(node).unwrap()];
    match &node.inputs[node.ty.schema.input(input).unwrap().0] {
        crate::graph::Binding::Literal { text, .. } => text.clone(),
        _ => "no literal".to_owned(),
    }
}

#[test]
fn the_nearer_layer_wins_and_the_command_line_over_all() {
    let folder = show();
    let at = |shot: Option<&str>, more: LoadOptions| {
        let loaded = loaded(folder.path(), shot, more);
        let texts = [("x", "b"), ("y/add", "b")].map(|(n, i)| literal(&loaded, n, i));
        (texts, loaded.graph.unwrap().clocks[0].last)
    };
    let set = |name: &str, value: &str| vec![(name.to_owned(), value.to_owned())];
    let plain = LoadOptions::default;
    let expect = |x: &str, y: &str, last: i64| ([x.to_owned(), y.to_owned()], last);
    // `$show` and `$shot` have no meaning without a shot, and half.ron reads them: each case names one.
    assert_eq!(at(Some("show/sq/sh"), plain()), expect("30", "50", 6));
    let over = LoadOptions { overrides: set("y/add.b", "7"), variables: set("last", "9"), ..plain() };
    assert_eq!(at(Some("show/sq/sh"), over), expect("30", "7", 9));
    std::fs::remove_file(folder.path().join("show/sq/sh/shot.ron")).unwrap();
    std::fs::write(folder.path().join("show/sq/sh/shot.ron"), "Layer(pegbar: 1, set: { \"x.b\": \"$b\" })").unwrap();
    assert_eq!(at(Some("show/sq/sh"), plain()), expect("4", "4", 6));
}

#[test]
fn it_is_told_where_a_setting_comes_from() {
    let folder = show();
    let over = LoadOptions { variables: vec![("b".to_owned(), "8".to_owned())], ..LoadOptions::default() };
    let loaded = loaded(folder.path(), Some("show/sq/sh"), over);
    let stack = |name: &str| loaded.settings.of(name).iter().map(|s| (s.layer, s.text.as_str())).collect::<Vec<_>>();
    assert_eq!(
        stack("$b"),
        [
            (Layer::Graph, "1"),
            (Layer::Site, "2"),
            (Layer::Show, "3"),
            (Layer::Sequence, "4"),
            (Layer::Shot, "5"),
            (Layer::CommandLine, "8")
        ]
    );
    assert_eq!(stack("x.b"), [(Layer::Graph, "\"$b\""), (Layer::Show, "30")]);
    assert_eq!(stack("y/$b"), [(Layer::Graph, "9"), (Layer::Graph, "\"$b\"")]);
    assert_eq!(stack("y/add.b"), [(Layer::Graph, "\"$b\""), (Layer::Shot, "50")]);
    let shot = loaded.settings.of("y/add.b").last().unwrap();
    assert!(loaded.sources.name(shot.file).ends_with("show/sq/sh/shot.ron") && loaded.sources.slice(shot.file, shot.span) == "50");
    assert_eq!(loaded.settings.of("y/$b").iter().map(|s| s.within.as_str()).collect::<Vec<_>>(), ["y/", ""]);
}

#[test]
fn names_of_the_shot_and_variables_of_layers_are_known_everywhere() {
    let folder = show();
    let shot = folder.path().join("show/sq/sh/shot.ron");
    std::fs::write(&shot, r#"Layer(pegbar: 1, variables: { "plates": "plates/$shot" }, set: { "y/mix.label": "$plates of $show" })"#)
        .unwrap();
    let loaded = loaded(folder.path(), Some("show/sq/sh"), LoadOptions::default());
    assert_eq!(literal(&loaded, "y/mix", "label"), "\"plates/sh of show\"");
}
