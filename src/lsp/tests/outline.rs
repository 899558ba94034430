//! Symbols, folding, layout.

use serde_json::{Value, json};

use super::client::{edited, slice};
use super::{Client, MAIN, shown};

#[test]
fn symbols_are_what_a_graph_declares() {
    let mut client = shown();
    let symbols = client.whole("documentSymbol", "main.ron", json!({}));
    let line = |s: &Value| format!("{} {}", s["name"].as_str().unwrap(), s["detail"].as_str().unwrap_or_default());
    let children = |name: &str| {
        let field = symbols.as_array().unwrap().iter().find(|s| s["name"] == name).unwrap();
        field["children"].as_array().unwrap().iter().map(line).collect::<Vec<_>>()
    };
    let fields: Vec<&str> = symbols.as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(fields, ["pegbar", "frames", "clocks", "params", "nodes", "outputs"]);
    assert_eq!(children("nodes")[..2], ["sky image.constant", "hat graph:lib/soft.ron"]);
    assert_eq!(
        (children("params"), children("outputs")),
        (vec!["softness number; default `0.25`".to_owned()], vec!["image @comp".to_owned()])
    );
    let node = &symbols[4]["children"][0];
    assert_eq!(slice(MAIN, &node["selectionRange"]), "sky");
    assert_eq!(slice(MAIN, &node["range"]), "\"sky\": (type: \"image.constant\", size: (64, 32))");
}

#[test]
fn brackets_over_several_lines_fold() {
    let mut client = shown();
    let folds = client.whole("foldingRange", "main.ron", json!({}));
    let params = MAIN.lines().position(|l| l.contains("params:")).unwrap();
    let nodes = MAIN.lines().position(|l| l.contains("nodes:")).unwrap();
    let expected = [(1, MAIN.lines().count() - 2), (params, params + 1), (nodes, nodes + 6)];
    assert_eq!(folds, json!(expected.map(|(start, end)| json!({ "startLine": start, "endLine": end }))));
}

#[test]
fn formatting_is_that_of_the_command_line_in_one_small_edit() {
    let mut client = Client::started();
    let options = json!({ "options": { "tabSize": 2, "insertSpaces": true } });
    let odd = MAIN.replace("opacity: 0.5", "opacity:0.5,");
    client.open("main.ron", &odd);
    let edits = client.whole("formatting", "main.ron", options.clone());
    assert_eq!(edited(&odd, &edits), MAIN);
    assert!(edits[0]["newText"].as_str().unwrap().len() < 10, "{edits}");
    client.open("main.ron", MAIN);
    assert_eq!(client.whole("formatting", "main.ron", options.clone()), json!([]));
    client.open("main.ron", "Graph(pegbar: 1");
    assert_eq!(client.whole("formatting", "main.ron", options), json!([]), "what is no RON is left alone");
}
