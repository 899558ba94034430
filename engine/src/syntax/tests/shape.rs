//! What the tree looks like, and the accessors on it.

use crate::syntax::{Extensions, NodeKind, NodeRef, TokenKind, Tree};

/// The tree as nested kinds, without the document.
fn shape(text: &str) -> String {
    fn show(node: NodeRef<'_>) -> String {
        let children: Vec<String> = node.children().map(show).collect();
        if children.is_empty() { format!("{:?}", node.kind()) } else { format!("{:?}({})", node.kind(), children.join(" ")) }
    }
    let tree = Tree::parse(text);
    assert_eq!(tree.errors(), [], "{text}");
    tree.root().children().map(show).collect::<Vec<_>>().join(" ")
}

#[test]
fn kinds_of_values() {
    assert_eq!(shape("(a: 1, b: -inf)"), "Struct(Field(Number) Field(Number))");
    assert_eq!(shape("Foo(1, NaN, b'x')"), "Tuple(Number Number Byte)");
    assert_eq!(shape("[(), ( ), Foo, Foo()]"), "List(Unit Tuple Ident Tuple)");
    assert_eq!(shape("{\"k\": 'c', x: true}"), "Map(Entry(String Char) Entry(Ident Bool))");
    assert_eq!(shape("Some(Some(None))"), "Some(Some(None))");
    assert_eq!(
        shape("[1..2, ..=b'z', inf.., .., r\"\", b\"\"]"),
        "List(Range(Number Number) Range(Byte) Range(Number) Range String ByteString)"
    );
    assert_eq!(shape("#![enable(implicit_some)] #![type = \"T\"] 1"), "Attribute Attribute Number");
}

#[test]
fn names_fields_entries_and_spans() {
    let text = "Graph(r#a-b: [1, 2], /* c */ n: {\"k\": 3, 4: 5})";
    let tree = Tree::parse(text);
    let graph = tree.value().unwrap();
    assert_eq!(graph.name().unwrap().text(), "Graph");
    assert_eq!(graph.span().range(), 0..text.len());
    let fields: Vec<_> = graph.fields().map(|field| (field.name(), field.name_span().range(), field.value().unwrap().text())).collect();
    assert_eq!(fields, [("a-b", 6..11, "[1, 2]"), ("n", 29..30, "{\"k\": 3, 4: 5}")]);
    let map = graph.field("n").unwrap().value().unwrap();
    let entries: Vec<_> = map.entries().map(|entry| (entry.key().unwrap().text(), entry.value().unwrap().text())).collect();
    assert_eq!(entries, [("\"k\"", "3"), ("4", "5")]);
    assert_eq!(
        graph.field("a-b").unwrap().value().unwrap().elements().map(|node| node.span().range()).collect::<Vec<_>>(),
        [14..15, 17..18]
    );
    assert_eq!(graph.field("z").map(|field| field.name()), None);
    assert_eq!(Tree::parse("(1)").value().unwrap().name().map(|name| name.text()), None);
}

#[test]
fn incomplete_fields_and_entries_have_no_value() {
    let tree = Tree::parse("(a: {\"k\": , \"j\"}, b:)");
    let value = tree.value().unwrap();
    assert!(value.field("b").unwrap().value().is_none());
    let map = value.field("a").unwrap().value().unwrap();
    let entries: Vec<_> = map.entries().map(|entry| (entry.key().unwrap().text(), entry.value().is_some())).collect();
    assert_eq!(entries, [("\"k\"", false), ("\"j\"", false)]);
}

#[test]
fn strings_map_back_to_the_source() {
    let text = r##"["a\u{e9}b@x.y", r#"@raw"#, "\\\
        z"]"##;
    let tree = Tree::parse(text);
    let strings: Vec<_> = tree.value().unwrap().elements().map(|node| node.as_str().unwrap()).collect();
    assert_eq!(strings.iter().map(|string| string.value()).collect::<Vec<_>>(), ["aéb@x.y", "@raw", "\\z"]);
    assert_eq!(&text[strings[0].source_span(4..8).range()], "@x.y");
    assert_eq!(&text[strings[0].source_span(1..3).range()], "\\u{e9}");
    assert_eq!(&text[strings[1].source_span(0..4).range()], "@raw");
    assert_eq!(&text[strings[2].source_span(1..2).range()], "z");
    assert_eq!(Tree::parse("b\"x\"").value().unwrap().as_str(), None);
    assert_eq!(Tree::parse("(\"open").value().unwrap().elements().next().unwrap().as_str().unwrap().value(), "open");
}

#[test]
fn comments_belong_to_what_they_stand_by() {
    let text = "(\n    // First.\n    // Second.\n    a: 1, // behind a\n    b: 2,\n\n    // detached\n\n    /* before c */ c: 3, /* x */ d: 4,\n)";
    let tree = Tree::parse(text);
    let node = |name: &str| tree.value().unwrap().field(name).unwrap().node();
    let before = |name: &str| node(name).comments_before().iter().map(|token| token.text()).collect::<Vec<_>>();
    assert_eq!(node("a").doc(), "First.\nSecond.");
    assert_eq!(node("a").comment_after().unwrap().text(), "// behind a");
    assert_eq!(before("b"), [""; 0]);
    assert_eq!(before("c"), ["/* before c */"]);
    assert_eq!(before("d"), ["/* x */"]);
    assert_eq!(node("d").comment_after().map(|token| token.text()), None);
}

#[test]
fn positions_find_tokens_and_nodes() {
    let text = "(a: [10, 20])";
    let tree = Tree::parse(text);
    assert_eq!(tree.token_at(9).unwrap().text(), "20");
    assert_eq!(tree.token_at(9).unwrap().prev().unwrap().kind(), TokenKind::Whitespace);
    assert_eq!(tree.node_at(9).text(), "20");
    assert_eq!(tree.node_at(9).parent().unwrap().kind(), NodeKind::List);
    assert_eq!(tree.node_at(1).kind(), NodeKind::Field);
    assert!(Tree::parse("").token_at(0).is_none());
}

#[test]
fn extensions_are_known() {
    let tree = Tree::parse("#![enable(implicit_some, unwrap_newtypes)]\n1");
    assert_eq!(tree.extensions(), Extensions::IMPLICIT_SOME | Extensions::UNWRAP_NEWTYPES);
}
