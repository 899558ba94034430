//! What holds for every node type and value type of the registry, without a line of test for any of them.

mod keys;
mod replay;
mod rough;
mod standin;

use pegbar_engine::check::code;
use pegbar_engine::diag::Severity;
use pegbar_engine::node::NodeSchema;
use pegbar_engine::setting::Place;
use pegbar_nodes::registry;
use serde_json::Value as Json;

use crate::support::shot::cli;
use crate::support::{files_below, root};

/// Fails with all complaints at once.
fn none(wrong: &[String]) {
    assert!(wrong.is_empty(), "{} complaints:\n{}\n", wrong.len(), wrong.join("\n"));
}

/// A doc comment whose first paragraph is a sentence.
fn is_documented(doc: &str) -> bool {
    let first = doc.split("\n\n").next().unwrap_or_default().trim();
    first.ends_with(['.', '!', '?']) && first.chars().count() > 3
}

#[test]
fn every_node_and_type_is_documented() {
    let registry = registry();
    let mut wrong = Vec::new();
    let mut expect = |what: String, doc: &str| {
        if !is_documented(doc) {
            wrong.push(format!("{what}: expected a sentence with a full stop, found {doc:?}"));
        }
    };
    for node in registry.nodes() {
        let schema = &node.schema;
        expect(schema.id.to_owned(), schema.doc);
        schema.inputs.iter().for_each(|i| expect(format!("{} input {}", schema.id, i.name), i.doc));
        schema.inputs.iter().for_each(|i| i.choices.iter().for_each(|c| expect(format!("{} {} {}", schema.id, i.name, c.name), c.doc)));
        schema.outputs.iter().for_each(|o| expect(format!("{} output {}", schema.id, o.name), o.doc));
    }
    for ty in registry.types() {
        expect(ty.schema.name.to_owned(), ty.schema.doc);
        ty.schema.arrays.iter().for_each(|a| expect(format!("{} array {}", ty.schema.name, a.name), a.doc));
        ty.schema.texts.iter().for_each(|t| expect(format!("{} text {}", ty.schema.name, t.name), t.doc));
    }
    none(&wrong);
}

/// Lower case words with underscores.
fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_lowercase()) && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

#[test]
fn names_are_family_and_word() {
    let mut wrong = Vec::new();
    for node in registry().nodes() {
        let schema = &node.schema;
        let fine = schema.id.split_once('.').is_some_and(|(family, tail)| is_word(family) && is_word(tail));
        if !fine || schema.version == 0 {
            wrong.push(format!("{}: expected an id as family.word and a version from 1 on", schema.id));
        }
        let names = schema.inputs.iter().map(|i| i.name).chain(schema.outputs.iter().map(|o| o.name));
        wrong.extend(names.filter(|n| !is_word(n)).map(|n| format!("{}: expected a lower case word, found {n}", schema.id)));
    }
    none(&wrong);
}

#[test]
fn defaults_are_what_their_inputs_take() {
    let mut wrong = Vec::new();
    for node in registry().nodes() {
        for input in &node.schema.inputs {
            let Some(default) = input.default else { continue };
            let at = format!("{} {} = {default}", node.schema.id, input.name);
            match ((input.parse)(default, &Place::default()), input.range) {
                (Err(error), _) => wrong.push(format!("{at}: {}", error.message)),
                (Ok((_, numbers)), Some((least, greatest))) => {
                    let outside = numbers.iter().filter(|n| !(least..=greatest).contains(*n));
                    wrong.extend(outside.map(|n| format!("{at}: expected {least} to {greatest}, found {n}")));
                }
                _ => {}
            }
        }
    }
    none(&wrong);
}

/// What is wrong with an excerpt of a graph, but for what lies outside the excerpt.
fn wrong_with(excerpt: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let excerpt = excerpt.trim().trim_end_matches(',');
    let text = if excerpt.contains("Graph(") {
        excerpt.to_owned()
    } else {
        format!("Graph(pegbar: 1, frames: (first: 1, last: 48, fps: 24), nodes: {{ {excerpt} }})")
    };
    let loaded = standin::check(folder.path(), &text, &registry());
    let outside = [code::UNKNOWN_NODE, code::MISSING_FILE, code::FRAME_HOLES, code::UNKNOWN_CLOCK, code::UNDEFINED_VARIABLE];
    let inside = loaded.diagnostics.iter().filter(|d| d.severity == Severity::Error && !outside.contains(&d.code));
    inside.map(|d| loaded.sources.render(d, false)).collect()
}

#[test]
fn examples_of_all_nodes_are_graphs() {
    let mut wrong = Vec::new();
    for node in registry().nodes() {
        match node.schema.example {
            Some(example) if example.contains(&format!("\"{}\"", node.schema.id)) => wrong.extend(wrong_with(example)),
            Some(example) => wrong.push(format!("{}: expected an example of itself, found {example}", node.schema.id)),
            None => wrong.push(format!("{}: expected an example, found none", node.schema.id)),
        }
    }
    none(&wrong);
}

#[test]
fn graphs_in_the_documentation_are_graphs() {
    let mut wrong = Vec::new();
    let mut seen = 0;
    for file in files_below("nodes/src", ".rs") {
        let text = std::fs::read_to_string(root().join(&file)).unwrap();
        let doc: String =
            text.lines().filter_map(|l| l.strip_prefix("//!")).map(|l| format!("{}\n", l.strip_prefix(' ').unwrap_or(l))).collect();
        for block in doc.split("```ron\n").skip(1).filter_map(|b| b.split("```").next()) {
            seen += 1;
            wrong.extend(wrong_with(block).into_iter().map(|w| format!("{file}:\n{w}")));
        }
    }
    assert!(seen > 30, "expected a graph in the documentation of each node, found {seen}");
    none(&wrong);
}

#[test]
fn a_misspelt_input_is_refused_with_the_name_that_was_meant() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    let mut wrong = Vec::new();
    for node in registry.nodes() {
        let schema: &NodeSchema = &node.schema;
        for input in &schema.inputs {
            let misspelt = format!("{}{}", input.name, input.name.chars().last().unwrap());
            if schema.input(&misspelt).is_some() {
                continue;
            }
            let text = standin::text(schema.id, &[(misspelt.clone(), "1".to_owned())]);
            let loaded = standin::check(folder.path(), &text, &registry);
            let refused = loaded.diagnostics.iter().find(|d| d.code == code::UNKNOWN_INPUT);
            let shown = refused.map(|d| loaded.sources.render(d, false)).unwrap_or_default();
            if !shown.contains(&format!("did you mean `{}`", input.name)) {
                wrong.push(format!("{} {misspelt}: expected `did you mean `{}``, found:\n{shown}", schema.id, input.name));
            }
        }
    }
    none(&wrong);
}

#[test]
fn the_command_line_explains_every_node_and_type() {
    let registry = registry();
    for node in registry.nodes() {
        let ran = cli(&["explain", node.schema.id]);
        assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{}", node.schema.id);
        let names = node.schema.inputs.iter().map(|i| i.name).chain(node.schema.outputs.iter().map(|o| o.name));
        names.for_each(|name| assert!(ran.out.contains(name), "{}: expected `{name}` in\n{}", node.schema.id, ran.out));
    }
    for ty in registry.types() {
        let ran = cli(&["explain", ty.schema.name]);
        assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{}", ty.schema.name);
    }
}

#[test]
fn the_command_line_lists_every_node_and_type() {
    let ids = |out: &str, key: &str| {
        let json: Json = serde_json::from_str(out).unwrap();
        json.as_array().unwrap().iter().map(|n| n[key].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let registry = registry();
    let nodes = cli(&["nodes", "--format", "json"]);
    assert_eq!(ids(&nodes.out, "id"), registry.nodes().map(|n| n.schema.id.to_owned()).collect::<Vec<_>>());
    let types = cli(&["types", "--format", "json"]);
    assert_eq!(ids(&types.out, "name"), registry.types().map(|t| t.schema.name.to_owned()).collect::<Vec<_>>());
    let plain = cli(&["nodes"]).out;
    registry.nodes().for_each(|n| assert!(plain.contains(n.schema.id), "{}", n.schema.id));
}
