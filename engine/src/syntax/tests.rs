//! Tests of the tree: round trip, errors, and agreement with `ron`.

use super::Tree;

fn codes(text: &str) -> Vec<&'static str> {
    Tree::parse(text).errors().iter().map(|error| error.code).collect()
}

/// Whether both accept the text or both refuse it.
#[track_caller]
fn assert_agrees(text: &str) {
    let ron = ron::from_str::<ron::Value>(text);
    let tree = Tree::parse(text);
    assert_eq!(ron.is_ok(), tree.errors().is_empty(), "{text:?}: ron says {ron:?}, we say {:?}", tree.errors());
    let joined: String = tree.tokens().map(|token| token.text()).collect();
    assert_eq!(joined, text);
}

const CORNERS: &str = include_str!("corners.txt");

#[test]
fn agrees_with_ron_on_corner_cases() {
    for line in CORNERS.lines() {
        let text = line.replace("␤", "\n").replace("␍", "\r");
        assert_agrees(&text);
    }
}

#[test]
fn a_missing_bracket_is_one_error() {
    assert_eq!(codes("Graph(\n nodes: {\n  \"a\": (type: \"x\",\n  \"b\": (type: \"y\"),\n },\n)"), ["PB0012"]);
}
