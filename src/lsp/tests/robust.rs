//! Every place of every beginning of a graph, and of a large one: asked about everything, the server always answers.

use serde_json::{Value, json};

use super::client::position;
use super::{Client, MAIN, SOFT, shown};

const AT: [&str; 6] = ["completion", "hover", "definition", "references", "documentHighlight", "prepareRename"];
const WHOLE: [&str; 3] = ["documentSymbol", "foldingRange", "formatting"];

#[test]
fn a_graph_may_break_off_anywhere() {
    let mut client = shown();
    for end in (0..=MAIN.len()).step_by(3) {
        let text = &MAIN[..end];
        client.open("main.ron", text);
        let here = position(text, end);
        for method in AT {
            client.at(method, "main.ron", &here, json!({})).unwrap_or_else(|e| panic!("{method} at {end}: {e}"));
        }
        for method in WHOLE {
            client.whole(method, "main.ron", json!({}));
        }
        let range = json!({ "start": { "line": 0, "character": 0 }, "end": here });
        client.whole("codeAction", "main.ron", json!({ "range": range, "context": {} }));
    }
}

#[test]
fn every_place_of_a_graph_may_be_asked_about() {
    let mut client = shown();
    // Line ends of another kind, and characters of several bytes.
    let text = SOFT.replace('\n', "\r\n").replace("What is", "Was 𝄞 heißt").replace("softened", "\\u{e9}\\\"");
    client.open("main.ron", &text);
    for offset in (0..=text.len()).filter(|o| text.is_char_boundary(*o)) {
        let here = position(&text, offset);
        for method in AT {
            client.at(method, "main.ron", &here, json!({})).unwrap_or_else(|e| panic!("{method} at {offset}: {e}"));
        }
    }
}

#[test]
fn a_graph_that_uses_itself_or_what_is_not_there_is_answered_for() {
    let mut client = Client::started();
    let text = r#"Graph(pegbar: 1, nodes: { "a": (type: "graph:main.ron", x: "@a.b"), "c": (type: "graph:none.ron", y: 1), "": (), 5: () }, outputs: { "b": "@a.b" })"#;
    client.write("main.ron", text);
    client.open("main.ron", text);
    for offset in 0..=text.len() {
        for method in AT {
            client.at(method, "main.ron", &position(text, offset), json!({})).unwrap_or_else(|e| panic!("{method} at {offset}: {e}"));
        }
    }
    assert!(client.said("main.ron").contains(&"PB0123".to_owned()));
}

#[test]
fn a_graph_of_a_thousand_nodes_is_answered_for() {
    let mut client = Client::started();
    let node = |i: usize| format!("        \"n{i}\": (type: \"comp.over\", fg: \"@n{}\", bg: \"@n{}\"),\n", (i - 1) / 2, i - 1);
    let nodes: String = (1..1000).map(node).collect();
    let text = format!(
        "Graph(\n    pegbar: 1,\n    nodes: {{\n        \"n0\": (type: \"image.constant\"),\n{nodes}    }},\n    outputs: {{ \"o\": \"@n999\" }},\n)\n"
    );
    client.open("main.ron", &text);
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
    let last = text.rfind("@n").unwrap() + 1;
    let list = client.at("completion", "main.ron", &position(&text, last), json!({})).unwrap();
    assert_eq!(list["items"].as_array().unwrap().len(), 1000);
    let more = json!({ "newName": "first" });
    let edit = client.at("rename", "main.ron", &position(&text, text.find("n0").unwrap()), more).unwrap();
    let edits: Vec<&Value> = edit["changes"].as_object().unwrap().values().collect();
    assert_eq!(edits[0].as_array().unwrap().len(), 4, "its entry, and three references");
}
