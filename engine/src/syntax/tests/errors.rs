use crate::diag::*;
use crate::syntax::Tree;
#[test]
fn zz_show() {
    for text in [
        "Graph(\n nodes: {\n  \"a\": (type: \"x\", path: 5px),\n  \"b\" (type: \"y\"),\n  \"c\": (type \"z\", a = 1 b: 2),\n  d: (k: @plate, z: ;),\n },\n",
        "Graph(\n nodes: {\n  \"a\": (type: \"x\", list: [1, 2, path: 5),\n  \"b\": (type: \"y\"),\n },\n outputs: {},\n)",
        "Graph(\n nodes: {\n  \"a\": (type: \"x),\n  \"b\": (type: \"y\"),\n },\n outputs: {\"a\": \"b\"},\n)",
        "Graph(\n nodes: {\n  \"a\": (type: \"x\")\n  \"b\": (type: \"y\")),\n },\n outputs: {\"a\": \"b\"},\n)",
        "Graph(\n nodes: {\n  \"a\": (type: \"x\"),\n outputs: {\"a\": \"b\"},\n)",
        "Graph(\n nodes: {\n  \"a\": (\"type\": \"x\", 5, \"C:\\dir\"),\n },\n doc:\n outputs: {\"a\": \"b\"},\n)",
        "Graph(\n nodes: {\n  \"a\": (type: \"x\",\n   image: \"b\"\n  \"b\": (type: \"x\"),\n },\n frames: (first: 1, last: 2,\n outputs: {\"a\": \"b\"},\n)",
        "Graph(\n nodes: {\n  \"a\": (type: \"x\", size: [1, 2\n   image: \"b\"),\n  \"b\": (type: \"x\"),\n },\n frames: (first: 1, last: 2),\n outputs: {\"a\": \"b\"},\n)",
        "Graph(a: 1))\n extra",
        "Graph(é: 'ab', b: \u{201C}x\u{201D}, c: \"ü\\q\")",
        "Graph(\n a: 1 # comment\n b: 2,\n)",
        "",
    ] {
        println!("=======\n{text}\n-------");
        let mut map = SourceMap::new();
        let file = map.add("shot.ron", text);
        for error in Tree::parse(text).errors() {
            print!("{}", map.render(&error.to_diagnostic(file), false));
        }
    }
}
