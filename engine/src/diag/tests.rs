//! Tests of diagnostics: text, lines, JSON, positions, order, suggestions.

use super::*;

fn sample() -> (SourceMap, Diagnostic) {
    let mut map = SourceMap::new();
    map.add("other.ron", "x");
    let file = map.add("shots/é.ron", "Graph(\n  \"é\": (kind: \"Blurr\"),\n)\n");
    let span = Span::new(22, 29);
    assert_eq!(map.slice(file, span), "\"Blurr\"");
    let diagnostic = Diagnostic::error("PB0102", "unknown node type", Label::new(file, span))
        .expected("a node type")
        .found("`Blurr`")
        .did_you_mean("Blurr", ["Blend", "Blur"])
        .with_label(Label::secondary(file, Span::new(9, 13), "in this node"));
    (map, diagnostic)
}

#[test]
fn text_shows_the_place_and_the_source() {
    let (map, diagnostic) = sample();
    let expected = "\
error[PB0102]: unknown node type
 --> shots/é.ron:2:15
  |
2 |   \"é\": (kind: \"Blurr\"),
  |   ---         ^^^^^^^ expected a node type, found `Blurr`
  |   |
  |   in this node
  |
  = help: did you mean `Blur`?
";
    assert_eq!(map.render(&diagnostic, false), expected);
    let coloured = map.render(&diagnostic, true);
    assert!(coloured.contains("\u{1b}["), "{coloured}");
    assert_eq!(anstyle_free(&coloured), expected);
}

/// The text without its colour codes.
fn anstyle_free(text: &str) -> String {
    let mut parts = text.split('\u{1b}');
    let first = parts.next().unwrap_or("").to_owned();
    parts.fold(first, |all, part| all + part.split_once('m').map_or("", |(_, rest)| rest))
}

#[test]
fn one_line_for_logs() {
    let (map, diagnostic) = sample();
    let line = "shots/é.ron:2:15: error[PB0102]: unknown node type: expected a node type, found `Blurr`; did you mean `Blur`?";
    assert_eq!(map.line(&diagnostic), line);
    let nowhere = Diagnostic::new(Severity::Warning, "PB0900", "two\nlines");
    assert_eq!(map.line(&nowhere), "warning[PB0900]: two lines");
    assert_eq!(map.render(&nowhere, false).trim_end(), "warning[PB0900]: two\nlines".replace('\n', "\n                 "));
}

#[test]
fn json_has_all_fields() {
    let (map, diagnostic) = sample();
    let expected = serde_json::json!({
        "code": "PB0102", "severity": "error", "message": "unknown node type", "file": "shots/é.ron",
        "line": 2, "column": 15, "end_line": 2, "end_column": 22, "text": "\"Blurr\"",
        "expected": "a node type", "found": "`Blurr`", "help": ["did you mean `Blur`?"],
        "related": [{
            "file": "shots/é.ron", "line": 2, "column": 3, "end_line": 2, "end_column": 6, "text": "\"é\"", "label": "in this node",
        }],
    });
    assert_eq!(serde_json::to_value(map.to_json(&diagnostic)).unwrap(), expected);
    let nowhere = serde_json::to_value(map.to_json(&Diagnostic::new(Severity::Note, "PB0900", "m"))).unwrap();
    assert_eq!(
        nowhere,
        serde_json::json!({"code": "PB0900", "severity": "note", "message": "m", "expected": null, "found": null, "help": []})
    );
}

#[test]
fn positions_go_both_ways() {
    let mut map = SourceMap::new();
    let text = "a\r\né漢b\n\n";
    let file = map.add("f", text);
    for (offset, _) in text.char_indices().chain([(text.len(), ' ')]) {
        let position = map.position(file, offset);
        assert_eq!(map.offset(file, position), offset, "{position:?}");
    }
    assert_eq!(map.position(file, 8), LineColumn { line: 2, column: 3 });
    assert_eq!(map.position(file, 4), LineColumn { line: 2, column: 1 }, "inside a character");
    assert_eq!(map.position(file, 999), LineColumn { line: 4, column: 1 });
    assert_eq!(map.offset(file, LineColumn { line: 2, column: 99 }), 9);
    assert_eq!(map.offset(file, LineColumn { line: 99, column: 1 }), text.len());
    assert_eq!(map.offset(file, LineColumn { line: 0, column: 0 }), 0);
}

#[test]
fn odd_places_do_not_panic() {
    let mut map = SourceMap::new();
    let empty = map.add("empty", "");
    let file = map.add("f", "é\ttab\n");
    for (file, span) in
        [(empty, Span::new(0, 0)), (empty, Span::new(5, 9)), (file, Span::new(1, 1)), (file, Span::new(7, 7)), (FileId(9), Span::new(0, 1))]
    {
        let diagnostic = Diagnostic::error("PB0001", "m", Label::new(file, span)).found("x");
        assert!(map.render(&diagnostic, false).starts_with("error[PB0001]: m\n"));
        assert!(map.line(&diagnostic).ends_with("error[PB0001]: m: found x"));
        assert_eq!(map.to_json(&diagnostic).code, "PB0001");
    }
}

#[test]
fn several_files_are_shown() {
    let mut map = SourceMap::new();
    let (show, shot) = (map.add("show.ron", "(\n a: 1,\n)"), map.add("shot.ron", "(a: \"x\")"));
    let diagnostic = Diagnostic::error("PB0103", "wrong type", Label::new(shot, Span::new(4, 7))).with_label(Label::secondary(
        show,
        Span::new(3, 7),
        "declared here",
    ));
    let text = map.render(&diagnostic, false);
    assert!(text.find("shot.ron:1:5").unwrap() < text.find("show.ron:2:2").unwrap(), "{text}");
}

#[test]
fn order_is_by_file_and_position_without_doubles() {
    let mut map = SourceMap::new();
    let (one, two) = (map.add("1", "aaaaaaaa"), map.add("2", "b"));
    let at = |file, start, message: &str| Diagnostic::error("PB0001", message, Label::new(file, Span::new(start, start + 1)));
    let nowhere = Diagnostic::new(Severity::Error, "PB0001", "nowhere");
    let mut all = vec![nowhere.clone(), at(two, 0, "c"), at(one, 5, "b"), at(one, 2, "a"), at(one, 5, "b"), at(two, 0, "c"), nowhere];
    sort(&mut all);
    assert_eq!(all.iter().map(|diagnostic| diagnostic.message.as_str()).collect::<Vec<_>>(), ["a", "b", "c", "nowhere"]);
}

#[test]
fn did_you_mean_finds_slips_of_the_hand() {
    let names = ["image.blur", "image.blend", "track.affine", "comp.over", "fg", "bg", "matte"];
    for (word, expected) in [
        ("image.blurr", Some("image.blur")),
        ("image.bulr", Some("image.blur")),
        ("Image_Blur", Some("image.blur")),
        ("track.afine", Some("track.affine")),
        ("f", Some("fg")),
        ("gf", Some("fg")),
        ("mat", None),
        ("mate", Some("matte")),
        ("xyz", None),
        ("", None),
        ("zzzzzzzzzz", None),
        ("comp.over", None),
    ] {
        assert_eq!(did_you_mean(word, names), expected, "{word}");
    }
    assert_eq!(did_you_mean("a.c", ["a.b", "a.d"]), Some("a.b"), "the first among equals");
    assert_eq!(did_you_mean(&"x".repeat(10_000), ["x"]), None);
}

#[test]
fn distance_counts_edits() {
    let distance = |left: &str, right: &str| super::distance(&left.chars().collect::<Vec<_>>(), &right.chars().collect::<Vec<_>>());
    for (left, right, expected) in
        [("", "", 0), ("", "abc", 3), ("abc", "abc", 0), ("abc", "acb", 1), ("kitten", "sitting", 3), ("ca", "abc", 3), ("é", "e", 1)]
    {
        assert_eq!(distance(left, right), expected, "{left} {right}");
        assert_eq!(distance(right, left), expected, "{right} {left}");
    }
}
