//! Graphs that were written for older nodes, brought up to date: migrations are data, and a graph means afterwards what it meant before.
//!
//! A list of migrations is a RON file. Each tells of one node type what it is called now, how its inputs are called now, and which inputs have to be
//! written down because their default changed:
//!
//! ```ron
//! [
//!     (node: "matte.keyer", to: "matte.color_clusters", inputs: { "colors": "foreground" }, set: { "clusters": "4" }, note: "it learns its colours"),
//! ]
//! ```

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::edit::{Edit, EditError, apply};
use crate::syntax::{NodeRef, Tree};

/// What became of one node type.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Migration {
    /// The type as it was called.
    pub node: String,
    /// As it is called now; as before where left out.
    #[serde(default)]
    pub to: Option<String>,
    /// Inputs that are called otherwise now: old name to new one.
    #[serde(default)]
    pub inputs: BTreeMap<String, String>,
    /// Inputs whose default changed: by its new name, the old default in RON, written where nothing stands.
    #[serde(default)]
    pub set: BTreeMap<String, String>,
    /// What a TD should know of it.
    #[serde(default)]
    pub note: String,
}

/// What was done to one node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Done {
    /// The node's name in the graph.
    pub node: String,
    /// What was changed, in words.
    pub changes: Vec<String>,
    /// As of the migration.
    pub note: String,
}

/// Reads a list of migrations.
///
/// # Errors
/// Where it is none, with line and column.
pub fn read(text: &str) -> Result<Vec<Migration>, String> {
    let options = ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    options.from_str(text).map_err(|e| e.to_string())
}

/// A graph after all migrations that concern it, and what was done. Everything else, unknown nodes among it, stays byte for byte. A second time changes
/// nothing where the new names are not old ones of the list again.
///
/// # Errors
/// Where the text is no RON, or a migration would put two inputs under one name.
pub fn upgrade(text: &str, migrations: &[Migration]) -> Result<(String, Vec<Done>), EditError> {
    let mut text = text.to_owned();
    let mut done = Vec::new();
    for (name, ty) in typed(&text) {
        let Some(migration) = migrations.iter().find(|m| m.node == ty) else { continue };
        let mut changes = Vec::new();
        for (edit, what) in edits(&text, &name, migration) {
            text = apply(&text, &edit)?;
            changes.push(what);
        }
        if !changes.is_empty() {
            done.push(Done { node: name, changes, note: migration.note.clone() });
        }
    }
    Ok((text, done))
}

/// The node of that name.
fn found<'t>(tree: &'t Tree, name: &str) -> Option<NodeRef<'t>> {
    let nodes = tree.value()?.field("nodes")?.value()?;
    nodes.entries().find(|e| e.key().and_then(NodeRef::as_str).is_some_and(|k| k.value() == name))?.value()
}

/// Every node and its type.
fn typed(text: &str) -> Vec<(String, String)> {
    let tree = Tree::parse(text);
    let nodes = tree.value().and_then(|root| root.field("nodes")).and_then(|f| f.value());
    let one = |entry: crate::syntax::EntryRef<'_>| {
        let name = entry.key()?.as_str()?.into_value().into_owned();
        let ty = entry.value()?.field("type")?.value()?.as_str()?.into_value().into_owned();
        Some((name, ty))
    };
    nodes.into_iter().flat_map(NodeRef::entries).filter_map(one).collect()
}

/// What a migration changes in a node, each with its words.
fn edits(text: &str, name: &str, migration: &Migration) -> Vec<(Edit, String)> {
    let path = |field: &str| ["nodes".to_owned(), name.to_owned(), field.to_owned()];
    let tree = Tree::parse(text);
    let has = |field: &str| found(&tree, name).is_some_and(|record| record.field(field).is_some());
    let mut out = Vec::new();
    for (old, new) in migration.inputs.iter().filter(|(old, _)| has(old)) {
        out.push((Edit::RenameInput { path: path(old), to: new.clone() }, format!("`{old}` is now `{new}`")));
    }
    let renamed = |field: &str| migration.inputs.iter().any(|(old, new)| new == field && has(old));
    for (input, value) in migration.set.iter().filter(|(input, _)| !has(input) && !renamed(input)) {
        out.push((Edit::Set { path: path(input), value: value.clone() }, format!("`{input}: {value}`, which was the default")));
    }
    if let Some(to) = migration.to.as_ref().filter(|to| **to != migration.node) {
        let value = ron::to_string(to).unwrap_or_default();
        out.push((Edit::Set { path: path("type"), value }, format!("{} is now {to}", migration.node)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_nodes_get_their_new_names_and_keep_what_they_meant() {
        let migrations = read(
            r#"[(node: "matte.keyer", to: "matte.color_clusters", inputs: {"colors": "foreground", "k": "clusters"}, set: {"clusters": "4", "adapt": "0.5"}, note: "n")]"#,
        )
        .unwrap();
        let text = "Graph(\n    nodes: {\n        \"a\": (type: \"matte.keyer\", colors: [1 , 2]), // keep\n        \"b\":(type:\"plugin.odd\" ,x:1),\n        \
                    \"c\": (\n            type: \"matte.keyer\",\n            k: 7, // seven\n            adapt: 0,\n        ),\n    },\n)\n";
        let (after, done) = upgrade(text, &migrations).unwrap();
        let expected = "Graph(\n    nodes: {\n        \"a\": (type: \"matte.color_clusters\", foreground: [1 , 2], adapt: 0.5, clusters: 4), // keep\n        \
                        \"b\":(type:\"plugin.odd\" ,x:1),\n        \"c\": (\n            type: \"matte.color_clusters\",\n            clusters: 7, // seven\n            \
                        adapt: 0,\n        ),\n    },\n)\n";
        assert_eq!(after, expected);
        assert_eq!(done.iter().map(|d| (d.node.as_str(), d.changes.len())).collect::<Vec<_>>(), [("a", 4), ("c", 2)]);
        assert_eq!(upgrade(&after, &migrations).unwrap(), (after.clone(), Vec::new()));
    }

    #[test]
    fn a_wrong_list_is_refused() {
        assert!(read(r#"[(node: "a", two: "b")]"#).unwrap_err().contains("two"));
    }
}
