//! How a server begins and ends, and that nothing else ends it.

use serde_json::{Value, json};

use super::Client;

fn code(answer: &Result<Value, Value>) -> i64 {
    answer.as_ref().unwrap_err()["code"].as_i64().unwrap()
}

#[test]
fn a_server_that_was_told_to_end_ends_well() {
    let mut client = Client::started();
    assert_eq!(client.ask("shutdown", Value::Null), Ok(Value::Null));
    assert_eq!(code(&client.ask("textDocument/hover", json!({}))), -32600, "nothing is answered between shutdown and exit");
    client.tell("exit", Value::Null);
    assert_eq!(client.end(), 0);
}

#[test]
fn a_server_whose_editor_goes_away_ends() {
    assert_eq!(Client::started().end(), 1);
    let mut client = Client::new();
    client.tell("exit", Value::Null);
    assert_eq!(client.end(), 1, "without shutdown");
}

#[test]
fn nothing_is_answered_before_the_two_know_each_other() {
    let mut client = Client::new();
    assert_eq!(code(&client.ask("textDocument/hover", json!({}))), -32002);
    client.tell("textDocument/didOpen", json!({ "textDocument": { "uri": "file:///x.ron", "version": 1, "text": "" } }));
    let result = client.initialize(json!({ "general": { "positionEncodings": ["utf-16"] } }));
    assert_eq!(result["capabilities"]["positionEncoding"], "utf-16");
    assert_eq!(result["serverInfo"]["name"], "pegbar");
    assert_eq!(code(&client.ask("initialize", json!({}))), -32600, "once is enough");
}

#[test]
fn what_cannot_be_understood_does_not_end_the_server() {
    let mut client = Client::started();
    client.raw("Content-Length: 5\r\n\r\n{oops");
    assert_eq!(code(&client.answer(&Value::Null)), -32700);
    client.raw("Content-Length: 4\r\n\r\n[17]");
    assert_eq!(code(&client.answer(&Value::Null)), -32600);
    client.raw("Content-Length: 2\r\n\r\n{}");
    assert_eq!(code(&client.answer(&Value::Null)), -32600);
    client.raw("nonsense\r\n\r\n");
    assert_eq!(code(&client.answer(&Value::Null)), -32700);
    assert_eq!(code(&client.ask("textDocument/levitate", json!({}))), -32601);
    assert_eq!(code(&client.ask("textDocument/hover", json!({ "position": "here" }))), -32602);
    client.tell("textDocument/didChange", json!({ "textDocument": 5 }));
    client.tell("textDocument/unheard", json!({}));
    client.tell("$/cancelRequest", json!({ "id": 999 }));
    let nowhere = json!({ "textDocument": { "uri": "file:///not/open.ron" }, "position": { "line": 0, "character": 0 } });
    assert_eq!(client.ask("textDocument/hover", nowhere), Ok(Value::Null), "a file that is not open");
    // Numbers of requests may be texts too.
    client.send(&json!({ "jsonrpc": "2.0", "id": "a", "method": "shutdown" }));
    assert_eq!(client.answer(&json!("a")), Ok(Value::Null));
}

#[test]
fn what_is_taken_back_while_it_waits_is_not_answered() {
    let mut client = Client::started();
    // Whether the request is still waiting when its cancellation comes is a matter of time: it is answered once in any case.
    let id = client.request("textDocument/foldingRange", json!({ "textDocument": { "uri": "file:///x.ron" } }));
    client.tell("$/cancelRequest", json!({ "id": id }));
    let answer = client.answer(&json!(id));
    assert!(answer == Ok(Value::Null) || code(&answer) == -32800, "{answer:?}");
    assert_eq!(client.ask("shutdown", Value::Null), Ok(Value::Null), "and no second answer stands between");
}

#[test]
fn files_are_watched_where_the_editor_can() {
    let mut client = Client::new();
    client.initialize(json!({ "workspace": { "didChangeWatchedFiles": { "dynamicRegistration": true } } }));
    let asked = client.note("client/registerCapability");
    assert_eq!(asked["registrations"][0]["method"], "workspace/didChangeWatchedFiles");
    client.send(&json!({ "jsonrpc": "2.0", "id": "files", "result": null }));
    assert_eq!(client.ask("shutdown", Value::Null), Ok(Value::Null), "an answer is no request");
}
