//! What `ron` accepts we accept, what it refuses we refuse, and no byte is ever lost.

use proptest::prelude::*;

use crate::syntax::Tree;

/// Whether both accept the text or both refuse it, with the tokens covering the text.
#[track_caller]
fn assert_agrees(text: &str) {
    let ron = ron::from_str::<ron::Value>(text);
    let tree = Tree::parse(text);
    assert_eq!(ron.is_ok(), tree.errors().is_empty(), "{text:?}: ron says {ron:?}, we say {:?}", tree.errors());
    assert_whole(&tree, text);
}

#[track_caller]
fn assert_whole(tree: &Tree, text: &str) {
    let joined: String = tree.tokens().map(|token| token.text()).collect();
    assert_eq!(joined, text);
    assert_eq!(tree.root().span().range(), 0..text.len());
    for node in tree.root().descendants() {
        let span = node.span();
        assert!(text.get(span.range()).is_some());
        if let Some(parent) = node.parent() {
            assert!(parent.span().start <= span.start && span.end <= parent.span().end, "{node:?} sticks out of {parent:?}");
        }
        let mut end = span.start;
        for child in node.children() {
            assert!(end <= child.span().start, "{child:?} overlaps its sibling");
            assert_eq!(child.parent(), Some(node));
            end = child.span().end;
        }
    }
    for error in tree.errors() {
        assert!(text.get(error.span.range()).is_some(), "{error:?}");
    }
}

/// One case a line; `␤` and `␍` stand for line feed and carriage return.
const CORNERS: &str = include_str!("corners.txt");

#[test]
fn corner_cases_agree() {
    for line in CORNERS.lines() {
        assert_agrees(&line.replace('␤', "\n").replace('␍', "\r"));
    }
}

#[test]
fn every_cut_of_a_document_agrees() {
    let text = "#![enable(implicit_some)]\n// c\nGraph(a: [1, -2.5e3, 0x_f], b: {\"k\\\"\": Some('x'), r#t: 1..=2}, c: br#\"x\"#, /* d */)";
    for end in 0..=text.len() {
        assert_agrees(&text[..end]);
        assert_agrees(&text[end..]);
    }
}

#[test]
fn nesting_is_bounded_as_in_ron() {
    for shape in [("[", "]"), ("(", ",)"), ("Some(", ")"), ("(a: ", ")"), ("{1: ", "}"), ("{", ": 1}"), ("N(", ")"), ("[{(a: Some(", ")}]")]
    {
        let (open, close) = shape;
        for depth in 20..70 {
            assert_agrees(&format!("{}1{}", open.repeat(depth), close.repeat(depth)));
            assert_agrees(&format!("{}(){}", open.repeat(depth), close.repeat(depth)));
            assert_agrees(&format!("{}[]{}", open.repeat(depth), close.repeat(depth)));
        }
        for depth in 120..135 {
            assert_agrees(&format!("{}1{}", open.repeat(depth), close.repeat(depth)));
        }
    }
}

#[test]
fn very_deep_nesting_overflows_no_stack() {
    for open in ["[", "(", "{", "Some(", "(a:", "{1:", "/*", "#![enable(unwrap_variant_newtypes)]Some("] {
        let text = open.repeat(100_000);
        let tree = Tree::parse(text.as_str());
        assert!(!tree.errors().is_empty());
        assert_whole(&tree, &text);
    }
}

fn leaf() -> impl Strategy<Value = String> {
    let fixed = [
        "1",
        "-2",
        "0x1F",
        "1_000u32",
        "2.5",
        ".5",
        "1e-3",
        "inf",
        "-NaN",
        "true",
        "None",
        "()",
        "'c'",
        "'\\n'",
        "b'a'",
        "\"s\"",
        "\"a\\\"b\\u{e9}\"",
        "r#\"raw\"#",
        "b\"bytes\"",
        "Foo",
        "r#type",
        "1..2",
        "..=3",
        "..",
        "_x",
        "\"two\\\n   lines\"",
        "0b11",
        "300u8",
        "1.2.3",
    ];
    prop::sample::select(fixed.map(str::to_owned).to_vec())
}

fn trivia() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec!["", "", "", " ", "\n", " // c\n", "/* /* x */ */", "\t\u{2028}"])
}

/// Documents, most of them valid.
pub(super) fn document() -> impl Strategy<Value = String> {
    let value = leaf().prop_recursive(4, 24, 4, |inner| {
        let item = (trivia(), inner, trivia()).prop_map(|(before, value, after)| format!("{before}{value}{after}")).boxed();
        let name = prop::sample::select(vec!["a", "b_c", "r#d-e", "Some", "true"]);
        let field = (name, trivia(), item.clone()).prop_map(|(name, gap, value)| format!("{name}{gap}:{value}"));
        let entry = (item.clone(), item.clone()).prop_map(|(key, value)| format!("{key}:{value}"));
        let list = |item: BoxedStrategy<String>| {
            (prop::collection::vec(item, 0..4), any::<bool>()).prop_map(|(items, trailing)| {
                let comma = if trailing && !items.is_empty() { "," } else { "" };
                format!("{}{comma}", items.join(","))
            })
        };
        let name = prop::sample::select(vec!["", "", "Foo", "Bar ", "r#x", "Some"]);
        prop_oneof![
            list(item.clone().boxed()).prop_map(|items| format!("[{items}]")),
            (name.clone(), list(item.clone().boxed())).prop_map(|(name, items)| format!("{name}({items})")),
            (name, list(field.boxed())).prop_map(|(name, items)| format!("{name}({items})")),
            list(entry.boxed()).prop_map(|items| format!("{{{items}}}")),
            item.prop_map(|value| format!("Some({value})")),
        ]
    });
    let attribute = prop::sample::select(vec![
        "",
        "",
        "#![enable(implicit_some)]",
        "#![enable(unwrap_variant_newtypes, unwrap_newtypes)]",
        "#![enable(unwrap_variant_newtypes)]\n#![enable(implicit_some,)]",
    ]);
    (attribute, trivia(), value, trivia()).prop_map(|(attribute, before, value, after)| format!("{attribute}{before}{value}{after}"))
}

/// What may be put into a document to break it.
fn fragment() -> impl Strategy<Value = String> {
    let pieces = [
        "(", ")", "[", "]", "{", "}", ",", ":", "\"", "'", "\\", "/", "*", "/*", "*/", "//", "\n", " ", ".", "..", "..=", "-", "+", "_",
        "#", "!", "=", "r#", "r\"", "b'", "br\"", "0", "1", "e", "x", "Some", "Some(", "None", "true", "inf", "f32", "u8", "a", "é",
        "\u{85}", "\u{feff}", "@", ";", "\\x", "\\u{",
    ];
    prop::sample::select(pieces.map(str::to_owned).to_vec())
}

fn floor(text: &str, at: usize) -> usize {
    (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn documents_agree(text in document()) {
        assert_agrees(&text);
    }

    #[test]
    fn broken_documents_agree(text in document(), edits in prop::collection::vec((any::<prop::sample::Index>(), 0..3_usize, fragment()), 1..4)) {
        let mut text = text;
        for (index, removed, inserted) in edits {
            let start = floor(&text, index.index(text.len() + 1));
            let end = floor(&text, start + removed).max(start);
            text.replace_range(start..end, &inserted);
        }
        assert_agrees(&text);
    }

    #[test]
    fn token_soup_agrees(pieces in prop::collection::vec(prop_oneof![fragment(), leaf()], 0..8)) {
        assert_agrees(&pieces.concat());
    }

    #[test]
    fn number_soup_agrees(text in "[-+]?(0[xbo])?[0-9a-f_.eEuif+-]{0,8}(u8|i8|i16|u64|f32|f64|u128)?") {
        assert_agrees(&text);
        assert_agrees(&format!("[{text}, {text}..{text}]"));
    }

    #[test]
    fn escape_soup_agrees(text in "(\\\\(x[0-9a-fA-F]{0,2}|u\\{[0-9a-fA-F]{0,7}\\}?|[nrt0'\"\\\\\n\r q])|[a é]){0,4}") {
        assert_agrees(&format!("\"{text}\""));
        assert_agrees(&format!("b\"{text}\""));
        assert_agrees(&format!("'{text}'"));
        assert_agrees(&format!("b'{text}'"));
    }

    #[test]
    fn any_text_is_kept(text in "\\PC{0,40}") {
        assert_agrees(&text);
    }

    #[test]
    fn string_values_are_those_of_ron(text in "(\\\\(x[0-7][0-9a-f]|xc3\\\\xa9|u\\{e9\\}|[nrt0'\"\\\\]|\n  )|[a é]){0,6}") {
        let source = format!(" \"{text}\"");
        let tree = Tree::parse(source.as_str());
        let value = tree.value().and_then(|node| node.as_str());
        let ours = value.as_ref().map(|value| value.value().to_owned());
        prop_assert_eq!(ours, ron::from_str::<String>(&source).ok());
        if let Some(value) = value {
            let offsets: Vec<usize> = (0..=value.value().len()).map(|at| value.source_offset(at)).collect();
            prop_assert!(offsets.is_sorted());
            prop_assert_eq!(offsets.last(), Some(&(source.len() - 1)));
            for (at, character) in value.value().char_indices().filter(|(_, character)| matches!(character, 'a' | 'é' | ' ')) {
                let rest = &source[value.source_offset(at)..];
                prop_assert!(rest.starts_with(character) || rest.starts_with('\\'), "{} at {}", character, rest);
            }
        }
    }
}
