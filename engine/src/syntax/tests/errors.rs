//! One slip gives one error, at the right place, and what follows is still understood.

use crate::diag::SourceMap;
use crate::syntax::{NodeKind, Tree, code};

/// The errors as `code line:column text`.
fn errors(text: &str) -> Vec<String> {
    let mut map = SourceMap::new();
    let file = map.add("", text);
    let tree = Tree::parse(text);
    let shown = tree.errors().iter().map(|error| {
        let at = map.position(file, error.span.start);
        format!("{} {}:{} {}", error.code, at.line, at.column, &text[error.span.range()]).trim_end().to_owned()
    });
    shown.collect()
}

/// The names of the fields of the value, and the keys of its map `nodes`.
fn outline(text: &str) -> (Vec<String>, Vec<String>) {
    let tree = Tree::parse(text);
    let Some(graph) = tree.value() else { return (Vec::new(), Vec::new()) };
    let fields = graph.fields().map(|field| field.name().to_owned()).collect();
    let nodes = graph.field("nodes").and_then(|field| field.value());
    let keys = nodes.into_iter().flat_map(|map| map.entries().collect::<Vec<_>>());
    (fields, keys.filter_map(|entry| Some(entry.key()?.as_str()?.value().to_owned())).collect())
}

fn graph(nodes: &str) -> String {
    format!("Graph(\n nodes: {{\n{nodes}\n }},\n outputs: {{}},\n)")
}

#[track_caller]
fn assert_one_slip(text: &str, expected: &[&str]) {
    assert_eq!(errors(text), expected, "{text}");
    let (fields, keys) = outline(text);
    assert_eq!(fields, ["nodes", "outputs"], "{text}");
    assert_eq!(keys, ["a", "b"], "{text}");
}

#[test]
fn missing_commas() {
    assert_one_slip(&graph("  \"a\": (x: 1, y: 2)\n  \"b\": (x: 1),"), &["PB0010 3:20"]);
    assert_one_slip(&graph("  \"a\": (x: 1 y: 2),\n  \"b\": (x: [1 2]),"), &["PB0010 3:13", "PB0010 4:14"]);
}

#[test]
fn missing_colons() {
    assert_one_slip(&graph("  \"a\" (x: 1, y: 2),\n  \"b\": (x 1),"), &["PB0011 3:6", "PB0011 4:10"]);
    assert_one_slip(&graph("  \"a\": (x = 1, y: 2),\n  \"b\": (x: 1, y \"s\"),"), &["PB0011 3:10", "PB0011 4:16"]);
}

#[test]
fn missing_values() {
    assert_one_slip(&graph("  \"a\": (x: , y: 2),\n  \"b\": (x: 1, y:),"), &["PB0015 3:11", "PB0015 4:17"]);
    assert_one_slip(&graph("  \"a\":\n  \"b\": (x: 1),"), &["PB0015 3:7"]);
}

#[test]
fn missing_brackets() {
    assert_one_slip(&graph("  \"a\": (x: 1, y: 2,\n  \"b\": (x: 1),"), &["PB0012 3:8 ("]);
    assert_one_slip(&graph("  \"a\": (x: 1, y: 2\n  \"b\": (x: 1),"), &["PB0012 3:8 ("]);
    assert_one_slip(&graph("  \"a\": (x: [1, 2, y: 2),\n  \"b\": (x: 1),"), &["PB0012 3:12 ["]);
    assert_one_slip(&graph("  \"a\": (x: 1),\n  \"b\": (x: {\"k\": 1),"), &["PB0012 4:12 {"]);
    assert_one_slip("Graph(\n nodes: {\n  \"a\": (),\n  \"b\": (),\n outputs: {},\n)", &["PB0012 2:9 {"]);
    assert_one_slip("Graph(\n nodes: {\n  \"a\": (),\n  \"b\": (),\n },\n outputs: {},\n", &["PB0012 1:6 ("]);
    assert_one_slip(
        "Graph(\n nodes: {\n  \"a\": (),\n  \"b\": (x: [(1, 2), (\n },\n outputs: {},\n)",
        &["PB0012 4:8 (", "PB0012 4:12 [", "PB0012 4:21 ("],
    );
}

#[test]
fn brackets_too_many() {
    assert_one_slip(&graph("  \"a\": (x: 1)),\n  \"b\": (x: 1),"), &["PB0013 3:14 )"]);
    assert_one_slip(&graph("  \"a\": (x: [1]]),\n  \"b\": (x: 1),"), &["PB0013 3:15 ]"]);
    assert_eq!(errors("Graph(a: 1))"), ["PB0017 1:12 )"]);
}

#[test]
fn missing_quotes() {
    assert_one_slip(&graph("  \"a\": (x: \"one, y: 2),\n  \"b\": (x: \"two\", y: 2),"), &["PB0003 3:12 \"one, y: 2"]);
    assert_one_slip(&graph("  \"a\": (x: \"long\n text\"),\n  \"b\": (x: two\"),"), &["PB0003 5:15 \""]);
}

#[test]
fn strays() {
    assert_one_slip(
        &graph("  \"a\": (x: @plate, y: 5px),\n  \"b\": (x: 1; y: 1),"),
        &["PB0001 3:12 @", "PB0005 3:23 5px", "PB0001 4:13 ;"],
    );
    assert_one_slip(&graph("  \"a\": (, x: 1),\n  \"b\": (x: 1,, y: 1),"), &["PB0014 3:9 ,", "PB0014 4:14 ,"]);
    assert_one_slip(
        &graph("  \"a\": (\"x\": 1, 5),\n  \"b\": (x: 1, \"y\"),"),
        &["PB0016 3:9 \"x\"", "PB0016 3:17 5", "PB0016 4:15 \"y\""],
    );
    assert_one_slip(&graph("  \"a\": (x: 1 # c\n  ),\n  \"b\": (x: ''),"), &["PB0014 3:14 #", "PB0006 5:12 ''"]);
}

#[test]
fn each_code_is_reached() {
    let cases = [
        (code::UNEXPECTED_CHARACTER, "(a: ?)"),
        (code::UNCLOSED_COMMENT, "1 /* x"),
        (code::UNTERMINATED_STRING, "\"x"),
        (code::UNTERMINATED_STRING, "r#\"x\""),
        (code::BAD_ESCAPE, "\"\\q\""),
        (code::BAD_NUMBER, "0b12"),
        (code::BAD_CHARACTER, "'ab'"),
        (code::BAD_IDENTIFIER, "r#"),
        (code::MISSING_COMMA, "[1 2]"),
        (code::MISSING_COLON, "{1}"),
        (code::UNCLOSED_BRACKET, "[1"),
        (code::STRAY_BRACKET, "[1)]"),
        (code::UNEXPECTED_TOKEN, "[1:2]"),
        (code::MISSING_VALUE, ""),
        (code::MISSING_FIELD_NAME, "(a: 1, 2)"),
        (code::TRAILING_TEXT, "1 2"),
        (code::BAD_ATTRIBUTE, "#![no] 1"),
        (code::UNKNOWN_EXTENSION, "#![enable(no)] 1"),
    ];
    for (expected, text) in cases {
        let tree = Tree::parse(text);
        assert_eq!(tree.errors().iter().map(|error| error.code).collect::<Vec<_>>(), [expected], "{text}");
    }
    let deep = Tree::parse("[".repeat(100) + &"]".repeat(100));
    assert_eq!(deep.errors().iter().map(|error| error.code).collect::<Vec<_>>(), [code::TOO_DEEP]);
}

#[test]
fn errors_say_what_was_expected_and_found() {
    let tree = Tree::parse("(type \"blur\")");
    let error = &tree.errors()[0];
    assert_eq!(error.message, "a colon is missing after the field's name");
    assert_eq!(error.expected.as_deref(), Some("`:` and a value after `type`"));
    assert_eq!(error.found.as_deref(), Some("the string \"blur\""));
    let value = tree.value().and_then(|value| value.field("type")).and_then(|field| field.value());
    assert_eq!(value.map(|value| (value.kind(), value.text())), Some((NodeKind::String, "\"blur\"")));
}
