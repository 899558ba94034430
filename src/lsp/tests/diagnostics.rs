//! What is wrong, told to the editor; and the quick fixes.

use serde_json::{Value, json};

use super::client::{edited, position, slice};
use super::{Client, MAIN, SOFT, shown};

fn replaced(old: &str, new: &str) -> Value {
    let at = MAIN.find(old).unwrap();
    json!({ "range": { "start": position(MAIN, at), "end": position(MAIN, at + old.len()) }, "text": new })
}

#[test]
fn a_change_is_checked_as_the_command_line_would() {
    let mut client = shown();
    client.change("main.ron", json!([replaced("bg: \"@sky\"", "bg: \"@grey\"")]));
    let said = client.diagnostics("main.ron");
    assert_eq!(said.len(), 1);
    let text = MAIN.replace("bg: \"@sky\"", "bg: \"@grey\"");
    assert_eq!(slice(&text, &said[0]["range"]), "\"@grey\"");
    assert_eq!(
        (said[0]["code"].as_str(), said[0]["severity"].as_u64(), said[0]["source"].as_str()),
        (Some("PB0142"), Some(1), Some("pegbar"))
    );
    let message = said[0]["message"].as_str().unwrap();
    assert!(message.starts_with("input `bg`: expected Image, found Vector") && message.contains("pegbar explain PB0142"), "{message}");
    let related = &said[0]["relatedInformation"][0];
    assert_eq!(slice(&text, &related["location"]["range"]), "\"grey\"");
    assert_eq!(related["message"], "`grey.mean` is a Vector");
    client.change("main.ron", json!([{ "text": MAIN }]));
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
}

#[test]
fn several_changes_at_once_are_applied_in_order() {
    let mut client = shown();
    let at = |line, character| json!({ "line": line, "character": character });
    let insert =
        |line, character, text: &str| json!({ "range": { "start": at(line, character), "end": at(line, character) }, "text": text });
    client.change("main.ron", json!([insert(0, 0, "// 𝄞\n"), insert(0, 5, "x"), insert(1, 0, "?")]));
    let said = client.diagnostics("main.ron");
    assert_eq!(said[0]["code"], "PB0001");
    assert_eq!(said[0]["range"]["start"], at(1, 0));
}

#[test]
fn unsaved_sub_graphs_count_and_have_diagnostics_of_their_own() {
    let mut client = shown();
    let without = SOFT.replace("\"soft\": \"@blur\", ", "");
    client.open("lib/soft.ron", &without);
    // By itself it has neither frames nor a picture: worth knowing, no more.
    let own = client.diagnostics("lib/soft.ron");
    assert!(own.iter().all(|d| d["severity"] == 3), "{own:?}");
    client.close("lib/soft.ron");
    assert_eq!(client.said("lib/soft.ron"), Vec::<String>::new());

    client.open("lib/soft.ron", &SOFT.replace("image.blur", "image.blurr"));
    let own = client.diagnostics("lib/soft.ron");
    let errors: Vec<&Value> = own.iter().filter(|d| d["severity"] == 1).collect();
    assert_eq!((errors.len(), errors[0]["code"].as_str()), (1, Some("PB0120")), "said once, though two graphs have it");
}

#[test]
fn a_caller_is_told_what_a_change_of_its_sub_graph_breaks() {
    let mut client = shown();
    client.open("lib/soft.ron", SOFT);
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
    client.change("lib/soft.ron", json!([{ "text": SOFT.replace("\"soft\": \"@blur\", ", "") }]));
    assert_eq!(client.said("main.ron"), ["PB0141"]);
    client.close("lib/soft.ron");
    assert_eq!(client.said("main.ron"), Vec::<String>::new(), "the file on disk counts again");
}

#[test]
fn a_closed_sub_graph_is_shown_what_is_wrong_in_it() {
    let mut client = shown();
    client.write("lib/soft.ron", &SOFT.replace("image.blur", "image.blurr"));
    let uri = client.uri("main.ron");
    client.tell("textDocument/didSave", json!({ "textDocument": { "uri": uri } }));
    assert_eq!(client.said("lib/soft.ron"), ["PB0120"]);
    client.write("lib/soft.ron", SOFT);
    client.tell("workspace/didChangeWatchedFiles", json!({ "changes": [] }));
    assert_eq!(client.said("lib/soft.ron"), Vec::<String>::new());
}

#[test]
fn other_files_of_the_same_language_are_left_in_peace() {
    let mut client = Client::started();
    client.open("scene.ron", "Scene(entities: [(id: 1)])");
    assert_eq!(client.said("scene.ron"), Vec::<String>::new());
    client.open("scene.ron", "Scene(entities: [(id: 1])");
    assert_eq!(client.said("scene.ron").len(), 1, "what is no RON is no RON");
    client.open("scene.ron", "Grpah(pegbar: 1)");
    assert_eq!(client.said("scene.ron"), ["PB0103"], "a graph with a slip");
    client.open("notes.ron", "");
    assert_eq!(client.said("notes.ron").len(), 1);
}

/// What a file is after all its quick fixes.
fn mended(client: &mut Client, text: &str) -> String {
    client.open("main.ron", text);
    let all = json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 999, "character": 0 } });
    let actions = client.whole("codeAction", "main.ron", json!({ "range": all, "context": { "diagnostics": [] } }));
    let uri = client.uri("main.ron");
    let edits: Vec<Value> =
        actions.as_array().unwrap().iter().flat_map(|a| a["edit"]["changes"][&uri].as_array().unwrap().clone()).collect();
    edited(text, &json!(edits))
}

#[test]
fn quick_fixes_mend_slips() {
    let mut client = shown();
    for (whole, slip) in [
        ("type: \"comp.over\"", "type: \"comp.ovre\""),
        ("fg: \"@hat\"", "fg: \"@hta\""),
        ("\"@hat.soft\"", "\"@hat.sotf\""),
        ("opacity: 0.5", "opacty: 0.5"),
        ("\"$softness\"", "\"$sofness\""),
        ("outputs:", "output:"),
        ("type: \"number\"", "type: \"nubmer\""),
        ("graph:lib/soft.ron", "graph:lib/sotf.ron"),
        ("fg: \"@hat\", bg", "fg: \"@hat\" bg"),
        ("image: \"@comp\"", "image: \"comp\""),
    ] {
        let broken = MAIN.replacen(whole, slip, 1);
        assert_ne!(broken, MAIN);
        assert_eq!(mended(&mut client, &broken), MAIN, "{slip}");
    }
}

#[test]
fn a_quick_fix_says_what_it_does_and_to_what_it_belongs() {
    let mut client = shown();
    let text = MAIN.replace("comp.over", "comp.ovre");
    client.open("main.ron", &text);
    let here = position(&text, text.find("ovre").unwrap());
    let actions = client.whole("codeAction", "main.ron", json!({ "range": { "start": here, "end": here }, "context": {} }));
    assert_eq!(actions.as_array().unwrap().len(), 1);
    assert_eq!(actions[0]["title"], "write `comp.over` instead of `comp.ovre`");
    assert_eq!((&actions[0]["kind"], &actions[0]["diagnostics"][0]["code"]), (&json!("quickfix"), &json!("PB0120")));
    let elsewhere = position(&text, 0);
    let actions = client.whole("codeAction", "main.ron", json!({ "range": { "start": elsewhere, "end": elsewhere }, "context": {} }));
    assert_eq!(actions, json!([]));
}

#[test]
fn columns_are_counted_as_agreed() {
    for (encodings, column) in [(json!(["utf-8", "utf-16"]), 32), (json!(["utf-16"]), 30), (Value::Null, 30)] {
        let mut client = Client::new();
        let general = if encodings.is_null() { json!({}) } else { json!({ "positionEncodings": encodings }) };
        client.initialize(json!({ "general": general }));
        client.open("main.ron", "Graph(pegbar: 1,\n/* 𝄞 */ nodes: { \"n\": (type: \"x.y\") })");
        let said = client.diagnostics("main.ron");
        let start = said[0]["range"]["start"]["character"].as_u64().unwrap();
        assert_eq!(start, column, "{encodings}");
        let change = json!([{ "range": said[0]["range"], "text": "\"image.constant\"" }]);
        client.change("main.ron", change);
        assert_eq!(client.said("main.ron"), Vec::<String>::new(), "{encodings}");
    }
}
