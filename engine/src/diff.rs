//! What differs between two graph files, by meaning: layout, comments and the order of nodes do not count, and a node that was renamed is one change.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::check::version;
use crate::syntax::{NodeKind, NodeRef, TokenKind, Tree, canonical};

/// One difference.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Change {
    /// What differs: `doc`, `frames.last`, `params.gain.default`, `nodes.track.levels`, `outputs.image`.
    pub path: String,
    /// As it was; none for what is new.
    pub before: Option<String>,
    /// As it is; none for what is gone.
    pub after: Option<String>,
    /// For a node that was renamed, its new name.
    pub renamed: Option<String>,
    /// Why graphs that use this one break; none where they do not.
    pub breaks: Option<String>,
}

/// Everything that differs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Diff {
    /// In the order of a graph file: fields, clocks, parameters, nodes, outputs.
    pub changes: Vec<Change>,
    /// What is wrong with the new version number, given what changed.
    pub version: Option<String>,
}

/// Values in canonical text by name, of a record or a map.
type Fields = BTreeMap<String, String>;

/// A graph file taken apart.
#[derive(Default)]
struct Parts {
    fields: Fields,
    params: BTreeMap<String, Fields>,
    nodes: BTreeMap<String, Fields>,
    outputs: Fields,
}

/// What a map or a record holds, by name.
fn members(value: NodeRef<'_>) -> Vec<(String, NodeRef<'_>)> {
    let fields = value.fields().filter_map(|f| Some((f.name().to_owned(), f.value()?)));
    let entries = value.entries().filter_map(|e| {
        let key = e.key()?;
        let name = key.as_str().map_or_else(|| key.text().to_owned(), |s| s.into_value().into_owned());
        Some((name, e.value()?))
    });
    fields.chain(entries).collect()
}

fn texts(value: NodeRef<'_>) -> Fields {
    members(value).into_iter().map(|(name, v)| (name, canonical(v.text()))).collect()
}

fn records(value: NodeRef<'_>) -> BTreeMap<String, Fields> {
    members(value)
        .into_iter()
        .map(|(name, v)| (name, if v.kind() == NodeKind::Struct { texts(v) } else { Fields::from([(String::new(), canonical(v.text()))]) }))
        .collect()
}

fn parts(tree: &Tree) -> Parts {
    let mut parts = Parts::default();
    for (name, value) in tree.value().map(members).unwrap_or_default() {
        match name.as_str() {
            "params" => parts.params = records(value),
            "nodes" => parts.nodes = records(value),
            "outputs" => parts.outputs = texts(value),
            "frames" => parts.fields.extend(texts(value).into_iter().map(|(k, v)| (format!("frames.{k}"), v))),
            "clocks" => {
                let clocks = records(value).into_iter();
                parts
                    .fields
                    .extend(clocks.flat_map(|(clock, fields)| fields.into_iter().map(move |(k, v)| (format!("clocks.{clock}.{k}"), v))));
            }
            _ => drop(parts.fields.insert(name, canonical(value.text()))),
        }
    }
    parts
}

/// A text with the nodes of its references renamed.
fn renamed(text: &str, names: &BTreeMap<String, String>) -> String {
    if names.is_empty() || !text.contains('@') {
        return text.to_owned();
    }
    let tree = Tree::parse(text);
    let one = |token: crate::syntax::TokenRef<'_>| {
        let inner = (token.kind() == TokenKind::String).then(|| token.text().strip_prefix("\"@")).flatten();
        let split = inner.map(|i| i.split_at(i.find(['.', '"']).unwrap_or(i.len())));
        match split.and_then(|(node, rest)| Some((names.get(node)?, rest))) {
            Some((new, rest)) => format!("\"@{new}{rest}"),
            None => token.text().to_owned(),
        }
    };
    tree.tokens().map(one).collect()
}

/// Nodes that are gone, each with the new node that is the same under another name.
fn renames(old: &Parts, new: &Parts) -> BTreeMap<String, String> {
    let gone: Vec<_> = old.nodes.iter().filter(|(name, _)| !new.nodes.contains_key(*name)).collect();
    let mut names = BTreeMap::new();
    // What a renamed node reads may be renamed as well: again until nothing more is found.
    loop {
        let taken: BTreeSet<&String> = names.values().collect();
        let found = gone.iter().filter(|(name, _)| !names.contains_key(*name)).find_map(|(name, fields)| {
            let moved: Fields = fields.iter().map(|(k, v)| (k.clone(), renamed(v, &names))).collect();
            let mut alike = new.nodes.iter().filter(|(n, f)| !old.nodes.contains_key(*n) && !taken.contains(n) && **f == moved);
            alike.next().map(|(to, _)| ((*name).clone(), to.clone()))
        });
        match found {
            Some((from, to)) => drop(names.insert(from, to)),
            None => return names,
        }
    }
}

/// What differs between `old` and `new`, and whether the version number of `new` says so. Texts that are no RON are compared as far as they go.
pub fn diff(old: &Tree, new: &Tree) -> Diff {
    let (before, after) = (parts(old), parts(new));
    let names = renames(&before, &after);
    let mut changes = Vec::new();
    let (old_fields, new_fields) = (before.fields.clone(), after.fields.clone());
    compare("", &old_fields, &new_fields, &mut changes, |_, _, _| None);
    changes.retain(|c| c.path != "version");
    compare_records("params", &before.params, &after.params, &mut changes);
    for (from, to) in &names {
        changes.push(Change { path: format!("nodes.{from}"), before: None, after: None, renamed: Some(to.clone()), breaks: None });
    }
    let moved = |nodes: &BTreeMap<String, Fields>| -> BTreeMap<String, Fields> {
        let one = |(name, fields): (&String, &Fields)| {
            let fields = fields.iter().map(|(k, v)| (k.clone(), renamed(v, &names))).collect();
            (names.get(name).unwrap_or(name).clone(), fields)
        };
        nodes.iter().map(one).collect()
    };
    compare_records("nodes", &moved(&before.nodes), &after.nodes, &mut changes);
    let outputs: Fields = before.outputs.iter().map(|(k, v)| (k.clone(), renamed(v, &names))).collect();
    compare("outputs.", &outputs, &after.outputs, &mut changes, |_, _, after| after.is_none().then(|| "callers may read it".to_owned()));
    let version = version_trouble(old_fields.get("version"), new_fields.get("version"), &changes);
    Diff { changes, version }
}

type Breaks = fn(&str, Option<&String>, Option<&String>) -> Option<String>;

fn compare(prefix: &str, old: &Fields, new: &Fields, out: &mut Vec<Change>, breaks: Breaks) {
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let (before, after) = (old.get(name), new.get(name));
        if before != after {
            let breaks = breaks(name, before, after);
            out.push(Change { path: format!("{prefix}{name}"), before: before.cloned(), after: after.cloned(), renamed: None, breaks });
        }
    }
}

/// Why the change of a parameter breaks callers.
fn param_breaks(field: &str, before: Option<&String>, after: Option<&String>) -> Option<String> {
    match (field, before, after) {
        ("type", Some(_), Some(_)) => Some("callers give it values of the old type".to_owned()),
        ("default", Some(_), None) => Some("callers that leave it out no longer may".to_owned()),
        _ => None,
    }
}

fn compare_records(what: &str, old: &BTreeMap<String, Fields>, new: &BTreeMap<String, Fields>, out: &mut Vec<Change>) {
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let whole = |fields: &Fields| {
            fields.iter().map(|(k, v)| if k.is_empty() { v.clone() } else { format!("{k}: {v}") }).collect::<Vec<_>>().join(", ")
        };
        let path = format!("{what}.{name}");
        match (old.get(name), new.get(name)) {
            (Some(before), Some(after)) => {
                let breaks: Breaks = if what == "params" { param_breaks } else { |_, _, _| None };
                compare(&format!("{path}."), before, after, out, breaks);
            }
            (before, after) => {
                let required = after.is_some_and(|a| !a.contains_key("default"));
                let breaks = match (what, before, after) {
                    ("params", Some(_), None) => Some("callers may give it".to_owned()),
                    ("params", None, Some(_)) if required => Some("callers do not give it, and it has no default".to_owned()),
                    _ => None,
                };
                out.push(Change { path, before: before.map(whole), after: after.map(whole), renamed: None, breaks });
            }
        }
    }
}

/// What is wrong with the number of the new version: too low for what changed.
fn version_trouble(old: Option<&String>, new: Option<&String>, changes: &[Change]) -> Option<String> {
    let number = |text: Option<&String>| text.and_then(|t| version::parse(t.trim_matches('"')));
    let before = number(old)?;
    let show = |[a, b, c]: [u32; 3]| format!("{a}.{b}.{c}");
    let Some(after) = number(new) else { return Some(format!("expected a version above {}, found none", show(before))) };
    let is_broken = changes.iter().any(|c| c.breaks.is_some());
    let is_new = changes.iter().any(|c| c.before.is_none() && (c.path.starts_with("outputs.") || is_whole_param(&c.path)));
    let [major, minor, patch] = before;
    let least = match (changes.is_empty(), is_broken, is_new, major) {
        (true, ..) => before,
        (_, true, _, 0) => [0, minor + 1, 0],
        (_, true, ..) => [major + 1, 0, 0],
        (_, _, true, 1..) => [major, minor + 1, 0],
        _ => [major, minor, patch + 1],
    };
    (after < least).then(|| format!("expected version {} or above after these changes, found {}", show(least), show(after)))
}

fn is_whole_param(path: &str) -> bool {
    path.strip_prefix("params.").is_some_and(|rest| !rest.contains('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(old: &str, new: &str) -> Vec<String> {
        let found = diff(&Tree::parse(old), &Tree::parse(new));
        let line = |c: &Change| match (&c.renamed, &c.before, &c.after) {
            (Some(to), ..) => format!("{} -> {to}", c.path),
            (_, Some(a), Some(b)) => format!("{}: {a} -> {b}", c.path),
            (_, Some(_), None) => format!("- {}", c.path),
            _ => format!("+ {}", c.path),
        };
        found.changes.iter().map(|c| line(c) + if c.breaks.is_some() { " !" } else { "" }).chain(found.version).collect()
    }

    #[test]
    fn layout_comments_and_order_do_not_count() {
        let old = r#"Graph(pegbar: 1, nodes: { "a": (type: "x", n: [1, 2]), "b": (type: "y") })"#;
        let new =
            "Graph(\n  pegbar: 1, // one\n  nodes: {\n    \"b\": (type: \"y\"),\n    \"a\": (n: [\n 1,\n 2,\n ], type: \"x\"),\n  },\n)\n";
        assert!(changes(old, new).is_empty());
    }

    #[test]
    fn a_renamed_node_is_one_change_with_all_that_reads_it() {
        let old = r#"Graph(nodes: { "a": (type: "x"), "b": (type: "y", in: "@a.out", more: ["@a", "@c"]), "c": (type: "z", n: 1) }, outputs: { "o": "@b" })"#;
        let new = r#"Graph(nodes: { "first": (type: "x"), "second": (type: "y", in: "@first.out", more: ["@first", "@c"]), "c": (type: "z", n: 2) }, outputs: { "o": "@second" })"#;
        assert_eq!(changes(old, new), ["nodes.a -> first", "nodes.b -> second", "nodes.c.n: 1 -> 2"]);
    }

    #[test]
    fn what_breaks_callers_asks_for_another_interface() {
        let old = r#"Graph(version: "1.4.2", params: { "a": (type: "number", default: 1), "b": (type: "path", default: "x") }, outputs: { "o": "@n", "p": "@n" })"#;
        let new = |version: &str| {
            format!(
                r#"Graph(version: "{version}", params: {{ "a": (type: "whole"), "c": (type: "text") }}, outputs: {{ "o": "@m", "q": "@n" }})"#
            )
        };
        let expected = [
            "- params.a.default !",
            "params.a.type: \"number\" -> \"whole\" !",
            "- params.b !",
            "+ params.c !",
            "outputs.o: \"@n\" -> \"@m\"",
            "- outputs.p !",
            "+ outputs.q",
        ];
        assert_eq!(changes(old, &new("2.0.0")), expected);
        let last = changes(old, &new("1.5.0")).pop();
        assert_eq!(last.as_deref(), Some("expected version 2.0.0 or above after these changes, found 1.5.0"));
    }

    #[test]
    fn what_is_new_asks_for_a_higher_second_number() {
        let graph = |version: &str, more: &str| format!(r#"Graph(version: "{version}", doc: "d", outputs: {{ "o": "@n"{more} }})"#);
        let trouble = |new: String| diff(&Tree::parse(graph("1.4.2", "")), &Tree::parse(new)).version;
        assert_eq!(trouble(graph("1.4.2", "")), None);
        assert_eq!(trouble(graph("1.5.0", r#", "p": "@n""#)), None);
        assert!(trouble(graph("1.4.3", r#", "p": "@n""#)).is_some());
        assert!(trouble(graph("1.4.2", "").replace("\"d\"", "\"e\"")).is_some());
    }
}
