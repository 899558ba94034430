//! The canonical layout: what it looks like, that nothing but blanks and commas changes, and that it is stable.

use proptest::prelude::*;

use super::agreement::document;
use crate::syntax::{TokenKind, Tree, format};

fn formatted(text: &str) -> String {
    format(&Tree::parse(text)).expect("a sound document")
}

/// Every token that means something or is read by people, sorted comments apart: comments around a colon move before their item.
fn tokens(text: &str) -> (Vec<String>, Vec<String>) {
    let tree = Tree::parse(text);
    let words = |is_comment: bool| {
        let kept = tree.tokens().filter(|t| t.kind() != TokenKind::Whitespace && t.kind() != TokenKind::Comma);
        kept.filter(|t| t.kind().is_comment() == is_comment).map(|t| t.text().trim_end().to_owned()).collect::<Vec<_>>()
    };
    let mut comments = words(true);
    comments.sort();
    (words(false), comments)
}

#[test]
fn a_graph_has_a_line_for_each_node() {
    let text = "// What it does.\n\nGraph(pegbar:1,frames:(first:1,last:9,fps:24),\n\n\nnodes:{\"a\":(type:\"x.y\",path:\"p\"),// why\n// next\n\
        \"b\":(type:\"z\",image:\"@a\" /* odd */,),\n\n// end\n},outputs:{\"o\":\"@b\"})";
    let expected = "// What it does.\n\nGraph(\n    pegbar: 1,\n    frames: (first: 1, last: 9, fps: 24),\n\n    nodes: {\n        \
        \"a\": (type: \"x.y\", path: \"p\"), // why\n        // next\n        \"b\": (\n            type: \"z\",\n            \
        image: \"@a\", /* odd */\n        ),\n\n        // end\n    },\n    outputs: { \"o\": \"@b\" },\n)\n";
    assert_eq!(formatted(text), expected);
}

#[test]
fn what_does_not_fit_on_a_line_has_lines() {
    let numbers = (0..60).map(|i| (i * 7).to_string()).collect::<Vec<_>>().join(",");
    let out = formatted(&format!("(a:[{numbers}],b:[[1,2],[3,4]],c:(1,),d:Some(x))"));
    assert!(out.lines().all(|line| line.len() <= 140), "{out}");
    assert!(out.starts_with("(\n    a: [\n        0, 7, 14,"), "{out}");
    assert!(out.ends_with("    ],\n    b: [[1, 2], [3, 4]],\n    c: (1,),\n    d: Some(x),\n)\n"), "{out}");
}

#[test]
fn short_values_share_lines_and_records_do_not() {
    let list = |item: &str| formatted(&format!("(a:[{}])", vec![item; 30].join(",")));
    assert_eq!(list("(0.25,1)").lines().nth(2), Some(format!("        {}", ["(0.25, 1),"; 12].join(" ")).as_str()));
    assert_eq!(list("\"@track.motion\"").lines().count(), 9);
    assert_eq!(list("[1,2,3]").lines().nth(2), Some("        [1, 2, 3],"));
    assert_eq!(list("(a:1)").lines().nth(2), Some("        (a: 1),"));
    let long = format!("\"{}\"", "x".repeat(50));
    assert_eq!(list(&long).lines().nth(2), Some(format!("        {long},").as_str()));
}

#[test]
fn a_golden_is_a_line_where_it_fits() {
    let text = "// Why.\nGolden(pegbar: 1, frames: \"1,2\", params: { \"size\": (192, 192) })\n";
    assert_eq!(formatted(text), text);
    assert_eq!(formatted("Golden(pegbar: 1, // the first\n)"), "Golden(\n    pegbar: 1, // the first\n)\n");
    assert_eq!(formatted("Layer(pegbar: 1)"), "Layer(\n    pegbar: 1,\n)\n");
}

#[test]
fn what_is_no_ron_is_left_alone() {
    assert_eq!(format(&Tree::parse("Graph(a: )")), None);
}

proptest! {
    #[test]
    fn tokens_and_comments_are_kept_and_the_second_time_changes_nothing(text in document()) {
        let tree = Tree::parse(text.as_str());
        if let Some(once) = format(&tree) {
            prop_assert_eq!(tokens(&text), tokens(&once), "{}", once);
            prop_assert_eq!(ron::from_str::<ron::Value>(&text).ok(), ron::from_str::<ron::Value>(&once).ok(), "{}", once);
            let again = format(&Tree::parse(once.as_str()));
            prop_assert_eq!(Some(&once), again.as_ref());
        }
    }
}
