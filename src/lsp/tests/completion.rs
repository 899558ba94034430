//! Completion, in texts as they are while somebody types.

use pegbar_engine::check::LoadOptions;
use serde_json::{Value, json};

use super::client::{edited, marked, slice};
use super::{Client, MAIN, SOFT, shown};

/// The completions at the mark of a text, in the order in which an editor shows them.
fn completions(client: &mut Client, text: &str) -> Vec<Value> {
    let list = client.at_mark("completion", "main.ron", text, json!({})).unwrap();
    let mut items = list["items"].as_array().unwrap().clone();
    items.sort_by_key(|i| i["sortText"].as_str().unwrap().to_owned());
    items
}

fn labels(items: &[Value]) -> Vec<&str> {
    items.iter().map(|i| i["label"].as_str().unwrap()).collect()
}

/// `MAIN` with another record for a node of its own.
fn with_node(record: &str) -> String {
    MAIN.replace("        \"out\":", &format!("        \"new\": {record},\n        \"out\":"))
}

/// The text after the completion `label` at the mark, the first stop of a snippet being `^`.
fn completed(client: &mut Client, text: &str, label: &str) -> String {
    let items = completions(client, text);
    let item = items.iter().find(|i| i["label"] == label).unwrap_or_else(|| panic!("no {label} among {:?}", labels(&items)));
    let (text, _) = marked(text);
    edited(&text, &json!([item["textEdit"]]))
}

/// The line with the node `new` of what a completion makes of its record.
fn record(client: &mut Client, given: &str, label: &str) -> String {
    let text = completed(client, &with_node(given), label);
    let line = text.lines().find_map(|l| l.trim().strip_prefix("\"new\": ")).unwrap();
    line.strip_suffix(',').unwrap_or(line).to_owned()
}

#[test]
fn variables_of_layers_are_completed() {
    let folder = tempfile::tempdir().unwrap();
    let shot = folder.path().join("sh010");
    let mut client = Client::with(folder, LoadOptions { shot: Some(shot), ..LoadOptions::default() });
    client.initialize(json!({}));
    client.write("show.ron", "Layer(pegbar: 1, variables: { \"plates\": \"$show_dir/plates\" })");
    client.write("sh010/shot.ron", "Layer(pegbar: 1)");
    let items = completions(&mut client, &with_node("(type: \"io.read_images\", path: \"$|\")"));
    let found: Vec<&str> =
        labels(&items).into_iter().filter(|l| ["$plates", "$shot", "$shot_dir", "$show", "$show_dir"].contains(l)).collect();
    assert_eq!(found, ["$shot_dir", "$show_dir", "$plates", "$shot", "$show"]);
    let plates = items.iter().find(|i| i["label"] == "$plates").unwrap();
    assert_eq!(plates["detail"], "\"$show_dir/plates\"");
}

#[test]
fn node_types_of_a_graphs_own_plugins_are_completed() {
    let mut client = shown();
    let library = |platform: &str| format!("\"{platform}\": (file: \"x\", digest: \"{}\")", "1".repeat(64));
    let libraries = ["linux-x86_64", "linux-aarch64", "macos-aarch64", "macos-x86_64", "windows-x86_64"].map(library).join(", ");
    let node = "(id: \"paint.dry\", version: 1, kind: per_frame, doc: \"Dries.\", inputs: [], outputs: [(name: \"value\", doc: \"One.\", type: \"Curve\")])";
    let plugin = format!("plugin: (name: \"paint\", version: \"1.3.0\", doc: \"Paint.\", abi: (1, 0), nodes: [{node}])");
    let manifest = format!("PluginManifest(libraries: {{{libraries}}}, {plugin})");
    client.write("plugins/paint.plugin.ron", &manifest);
    let own = |text: &str| text.replacen("pegbar: 1,", "pegbar: 1,\n    plugins: [\"plugins/paint\"],", 1);
    let items = completions(&mut client, &own(&with_node("(type: \"paint|\")")));
    assert!(labels(&items).contains(&"paint.dry"), "{:?}", labels(&items));
    let items = completions(&mut client, &own(&with_node("(type: \"comp.over\", opacity: \"@new|\")")));
    assert!(!labels(&items).is_empty());
    assert!(!labels(&completions(&mut client, &with_node("(type: \"paint|\")"))).contains(&"paint.dry"), "of no other graph");
}

#[test]
fn names_are_completed_whatever_is_there_of_them() {
    let mut client = shown();
    for (given, label, expected) in [
        ("(|)", "type", "(type: \"$1\")"),
        ("(ty|)", "type", "(type: \"$1\")"),
        ("(type: |)", "track.affine", "(type: \"track.affine\")"),
        ("(type: \"tr|\")", "track.affine", "(type: \"track.affine\")"),
        ("(type: \"tr|.affin\")", "track.affine", "(type: \"track.affine\")"),
        ("(type: \"gr|\")", "graph:", "(type: \"graph:\")"),
        ("(type: \"graph:l|\")", "graph:lib/", "(type: \"graph:lib/\")"),
        ("(type: \"graph:lib/|\")", "graph:lib/soft.ron", "(type: \"graph:lib/soft.ron\")"),
        ("(type: \"comp.over\", |)", "fg", "(type: \"comp.over\", fg: \"@$1\")"),
        ("(type: \"comp.over\", o|)", "opacity", "(type: \"comp.over\", opacity: ${1:1.0})"),
        ("(type: \"comp.over\", f| bg: \"@sky\")", "fg", "(type: \"comp.over\", fg: \"@$1\", bg: \"@sky\")"),
        ("(|, type: \"comp.over\")", "fg", "(fg: \"@$1\", type: \"comp.over\")"),
        ("(type: \"comp.over\", o|: 0.5)", "opacity", "(type: \"comp.over\", opacity: 0.5)"),
        ("(type: \"graph:lib/soft.ron\", |)", "image", "(type: \"graph:lib/soft.ron\", image: \"@$1\")"),
        ("(type: \"comp.over\", fg: |)", "@hat", "(type: \"comp.over\", fg: \"@hat\")"),
        ("(type: \"comp.over\", fg: h|)", "@hat", "(type: \"comp.over\", fg: \"@hat\")"),
        ("(type: \"comp.over\", fg: \"@h|\")", "@hat", "(type: \"comp.over\", fg: \"@hat\")"),
        ("(type: \"comp.over\", fg: \"@h|\n", "@hat", "(type: \"comp.over\", fg: \"@hat\""),
        ("(type: \"comp.over\", fg: \"@hat.|\")", "@hat.sharp", "(type: \"comp.over\", fg: \"@hat.sharp\")"),
        (
            "(type: \"image.blur\", image: \"@sky\", size: \"$|\")",
            "$softness",
            "(type: \"image.blur\", image: \"@sky\", size: \"$softness\")",
        ),
        ("(type: \"image.blur\", kernel: |)", "box", "(type: \"image.blur\", kernel: box)"),
        ("(type: \"image.blur\", kernel: b|)", "box", "(type: \"image.blur\", kernel: box)"),
        ("(type: \"image.blur\", expand: |)", "false", "(type: \"image.blur\", expand: false)"),
        (
            "(type: \"time.resample\", stream: \"@sky\", clock: \"|\")",
            "film",
            "(type: \"time.resample\", stream: \"@sky\", clock: \"film\")",
        ),
        ("(type: \"io.write_table\", values: [\"@sky\", \"@gr|\"])", "@grey", "(type: \"io.write_table\", values: [\"@sky\", \"@grey\"])"),
        (
            "(type: \"io.write_images\", image: \"@sky\", path: \"|\")",
            "$out",
            "(type: \"io.write_images\", image: \"@sky\", path: \"$out\")",
        ),
    ] {
        assert_eq!(record(&mut client, given, label), expected, "{given}");
    }
}

#[test]
fn what_fits_comes_first() {
    let mut client = shown();
    let items = completions(&mut client, &with_node("(type: \"comp.over\", bg: \"@sky\", fg: |)"));
    let labels = labels(&items);
    let at = |label: &str| labels.iter().position(|l| *l == label).unwrap_or_else(|| panic!("no {label} among {labels:?}"));
    assert!(at("@hat") < at("@grey") && at("@hat.sharp") < at("@grey") && at("@comp") < at("@grey"), "{labels:?}");
    assert!(!labels.contains(&"@new") && !labels.contains(&"@out") && !labels.contains(&"@grey.minimum"), "{labels:?}");
    assert_eq!(items[at("@grey")]["detail"], "Vector of image.statistics");
    let doc = items[at("@sky")]["documentation"]["value"].as_str().unwrap();
    assert!(doc.contains("The sky behind all.") && doc.contains("one value for the whole graph"), "{doc}");
}

#[test]
fn inputs_that_must_be_given_come_first_and_given_ones_not_at_all() {
    let mut client = shown();
    let items = completions(&mut client, &with_node("(type: \"comp.over\", bg: \"@sky\", |)"));
    assert_eq!(labels(&items), ["fg", "opacity"]);
    assert_eq!(items[0]["detail"], "Image; must be given");
    assert_eq!(items[1]["detail"], "number, or a Curve; 0 to 1; default `1.0`");
    assert!(items[1]["documentation"]["value"].as_str().unwrap().contains("Opacity of the foreground"));
    assert_eq!(items[1]["insertTextFormat"], 2);
}

#[test]
fn node_types_come_with_what_they_are() {
    let mut client = shown();
    let items = completions(&mut client, &with_node("(type: \"|\")"));
    let over = items.iter().find(|i| i["label"] == "comp.over").unwrap();
    assert_eq!(over["detail"], "Image, Image -> Image");
    let doc = over["documentation"]["value"].as_str().unwrap();
    assert!(doc.contains("Lays one picture over another") && doc.contains("Porter, Duff 1984"), "{doc}");
    assert_eq!(items.iter().filter(|i| i["kind"] == 3).count(), pegbar_nodes::registry().nodes().count());
}

#[test]
fn the_rest_of_a_graph_is_completed_too() {
    let mut client = shown();
    let mut offered = |text: &str| labels(&completions(&mut client, text)).join(" ");
    assert_eq!(offered("|"), "Graph");
    assert_eq!(offered("Graph(pegbar: 1, nodes: {}, |)"), "doc version plugins frames clocks params outputs");
    assert_eq!(offered("Graph(frames: (first: 1, |))"), "last fps");
    assert_eq!(offered("Graph(clocks: {\"a\": (|)})"), "first last fps");
    assert_eq!(offered("Graph(params: {\"last\": (type: \"whole\")}, frames: (first: 1, last: \"$|\"))"), "$last");
    assert_eq!(offered("Graph(nodes: {|})"), "node");
    assert_eq!(offered("Graph(params: {\"a\": (type: \"path\", |)})"), "default doc");
    assert_eq!(offered("Graph(params: {\"a\": (type: \"bool\", default: |)})"), "true false");
    assert!(offered("Graph(params: {\"a\": (type: \"|\")})").starts_with("path text number whole bool any Affine2"));
    assert_eq!(offered("Graph(nodes: {\"a\": (type: \"image.constant\")}, outputs: {\"o\": \"@|\"})"), "@a");
    assert_eq!(offered("Graph(pegbar: 1, // a comment |"), "");
    assert_eq!(offered("Graph(doc: \"a text|\")"), "");
    assert_eq!(offered("Graph(nodes: {\"a\": (type: \"image.constant\" |)})"), "");
}

#[test]
fn files_are_completed_with_numbered_ones_as_one() {
    let mut client = shown();
    ["plate/a.0001.png", "plate/a.0002.png", "plate/one_07.png", "plate/deep/x.png"].iter().for_each(|f| client.write(f, ""));
    let read = |path: &str| with_node(&format!("(type: \"io.read_images\", path: {path})"));
    let items = completions(&mut client, &read("\"pl|\""));
    assert!(labels(&items).contains(&"plate/"), "{:?}", labels(&items));
    let items = completions(&mut client, &read("\"plate/|\""));
    let files: Vec<&str> = labels(&items).into_iter().filter(|l| l.starts_with("plate")).collect();
    assert_eq!(files, ["plate/a.####.png", "plate/one_07.png", "plate/deep/"]);
    assert_eq!(items.iter().find(|i| i["label"] == "plate/a.####.png").unwrap()["detail"], "2 files");
    assert_eq!(
        record(&mut client, "(type: \"io.read_images\", path: \"plate/|\")", "plate/a.####.png"),
        "(type: \"io.read_images\", path: \"plate/a.####.png\")"
    );
}

#[test]
fn an_editor_without_snippets_gets_none() {
    let mut client = Client::new();
    client.initialize(json!({}));
    client.write("lib/soft.ron", SOFT);
    let items = completions(&mut client, &with_node("(type: \"comp.over\", |)"));
    let texts: Vec<&str> = items.iter().map(|i| i["textEdit"]["newText"].as_str().unwrap()).collect();
    assert_eq!(texts, ["fg: \"@\"", "bg: \"@\"", "opacity: 1.0"]);
    assert!(items.iter().all(|i| i["insertTextFormat"] == 1));
}

#[test]
fn what_a_completion_takes_the_place_of_holds_the_cursor() {
    let mut client = shown();
    let given = with_node("(type: \"comp.over\", fg: \"@s|ky\", bg: \"@sky\")");
    let items = completions(&mut client, &given);
    let (text, position) = marked(&given);
    for item in &items {
        let range = &item["textEdit"]["range"];
        assert_eq!(slice(&text, range), "@sky");
        assert!(range["start"]["line"] == position["line"] && range["end"]["line"] == position["line"]);
        assert!(item["filterText"].as_str().unwrap().starts_with('@'), "{item}");
    }
}
