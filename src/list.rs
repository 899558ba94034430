//! `pegbar nodes` and `pegbar types`: what there is, one line each.

use pegbar_engine::node::NodeSchema;
use pegbar_engine::registry::Registry;
use pegbar_engine::value::TypeSchema;

use crate::args::{Format, ListArgs};
use crate::console::{Console, EXIT_OK};

pub(crate) fn nodes(args: &ListArgs, registry: &Registry, console: &mut Console) -> u8 {
    let schemas: Vec<&NodeSchema> = registry.nodes().map(|n| n.schema.as_ref()).collect();
    if args.format == Format::Json {
        return console.json(&schemas);
    }
    let width = schemas.iter().map(|s| s.id.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    let mut family = "";
    for schema in schemas {
        let own = schema.id.split('.').next().unwrap_or_default();
        if own != family {
            let gap = if family.is_empty() { "" } else { "\n" };
            text.push_str(&format!("{gap}{own}\n"));
            family = own;
        }
        text.push_str(&format!("  {:<width$}  {}\n", schema.id, summary(schema.doc)));
    }
    console.out(&text);
    EXIT_OK
}

pub(crate) fn types(args: &ListArgs, registry: &Registry, console: &mut Console) -> u8 {
    let schemas: Vec<&TypeSchema> = registry.types().map(|t| &t.schema).collect();
    if args.format == Format::Json {
        return console.json(&schemas);
    }
    let width = schemas.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
    let lines = schemas.iter().map(|s| format!("{:<width$}  {}\n", s.name, summary(s.doc)));
    console.out(&lines.collect::<String>());
    EXIT_OK
}

/// The first sentence, or the first paragraph of a text.
pub(crate) fn summary(doc: &str) -> String {
    let paragraph: Vec<&str> = doc.lines().take_while(|l| !l.trim().is_empty()).map(str::trim).collect();
    let paragraph = paragraph.join(" ");
    match paragraph.find(". ") {
        Some(end) => paragraph[..=end].to_owned(),
        None => paragraph,
    }
}
