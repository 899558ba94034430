//! Hover: what the name under the pointer means, and what checking found out about it.

use std::rc::Rc;

use serde_json::{Value, json};

use super::facts;
use super::sheet::{NodeDecl, Sheet, What};
use super::state::{Checked, State};
use super::text::Position;

/// What to show at a position; `None` where there is nothing to say.
pub(super) fn hover(state: &mut State<'_>, uri: &str, position: Position) -> Option<Value> {
    let (sheet, checked) = (state.sheet(uri)?, state.checked(uri)?);
    let offset = sheet.offset(position, state.encoding);
    let mention = sheet.mention_at(offset).cloned();
    let mut parts: Vec<String> = Vec::new();
    parts.extend(mention.as_ref().and_then(|m| describe(state, &sheet, &checked, &m.what)));
    let own = |d: &&pegbar_engine::diag::Diagnostic| {
        d.primary().is_some_and(|l| l.span.touches(offset) && checked.path(l.file) == Some(sheet.path.as_path()))
    };
    let mut codes: Vec<&str> = checked.loaded.diagnostics.iter().filter(own).map(|d| d.code).collect();
    codes.dedup();
    parts.extend(codes.into_iter().filter_map(facts::code));
    if parts.is_empty() {
        return None;
    }
    let mut out = json!({ "contents": { "kind": "markdown", "value": parts.join("\n\n---\n\n") } });
    if let Some(mention) = mention {
        out["range"] = json!(sheet.range(mention.span, state.encoding));
    }
    Some(out)
}

fn describe(state: &mut State<'_>, sheet: &Rc<Sheet>, checked: &Checked, what: &What) -> Option<String> {
    match what {
        What::Node(name) => {
            let node = sheet.nodes.iter().position(|n| n.decl.name == *name)?;
            Some(node_text(state, sheet, checked, node))
        }
        What::Port { node, port } => port_text(state, sheet, checked, node, port),
        What::Param(name) if name == "out" && sheet.find_param(name).is_none() => {
            Some(format!("**$out**: the output folder, `--out`; here {}", state.options.out.display()))
        }
        What::Param(name) => sheet.find_param(name).map(facts::param),
        What::Output(name) => {
            let output = sheet.find_output(Some(name))?;
            Some(format!("**{name}**: an output of this graph, of `@{}`", output.of))
        }
        What::Type(node) => type_text(state, sheet, sheet.nodes.get(*node)?),
        What::Input { node, input } => input_text(state, sheet, *node, input),
        What::Value { node, input } => {
            let text = input_text(state, sheet, *node, input)?;
            Some(choice_text(state, sheet, *node, input).map_or_else(|| text.clone(), |choice| format!("{choice}\n\n{text}")))
        }
        What::ParamType(name) => {
            let plain = facts::PARAM_TYPES.iter().find(|(n, _)| n == name).map(|(_, doc)| (*doc).to_owned());
            let doc = plain.or_else(|| state.registry().get_type(name).map(|t| t.schema.doc.trim().to_owned()))?;
            Some(format!("**{name}**\n\n{doc}"))
        }
        What::Field(name) => {
            let (_, doc, _) = facts::GRAPH_FIELDS.iter().find(|(n, _, _)| n == name)?;
            Some(format!("**{name}**\n\n{doc}"))
        }
    }
}

/// A node: its type, what its comment says, and its outputs as they were found out.
fn node_text(state: &mut State<'_>, sheet: &Sheet, checked: &Checked, node: usize) -> String {
    let decl = &sheet.nodes[node];
    let name = &decl.decl.name;
    let mut out = format!("**{name}**: {}\n", decl.ty);
    if !decl.doc.is_empty() {
        out.push_str(&format!("\n{}\n", decl.doc));
    }
    let inferred = checked.node(name);
    let clock = inferred.and_then(|i| i.clock.as_deref());
    let ports = state.ports(sheet, node, "", checked);
    let lines: Vec<String> = ports.iter().map(|p| format!("- {}", facts::port(p, clock))).collect();
    if !lines.is_empty() {
        out.push_str(&format!("\n{}\n", lines.join("\n")));
    }
    if inferred.is_some_and(|i| !i.is_certain) {
        out.push_str("\nRate and clock are not sure, as something that it hangs on is wrong.\n");
    }
    let about = match decl.graph() {
        Some(path) => state.sheet_at(sheet, path).map(|inner| inner.doc.clone()),
        None => state.registry().get(&decl.ty).map(|t| facts::summary(t.schema.doc).to_owned()),
    };
    out.push_str(&about.map(|about| format!("\n{about}\n")).unwrap_or_default());
    out
}

fn port_text(state: &mut State<'_>, sheet: &Sheet, checked: &Checked, node: &str, port: &str) -> Option<String> {
    let at = sheet.nodes.iter().position(|n| n.decl.name == node)?;
    let found = state.ports(sheet, at, "", checked).into_iter().find(|p| p.name == port)?;
    let clock = checked.node(node).and_then(|i| i.clock.clone());
    Some(format!("**@{node}.{port}**\n\n{}\n\n{}\n", facts::port(&found, clock.as_deref()), found.doc))
}

fn type_text(state: &mut State<'_>, sheet: &Sheet, node: &NodeDecl) -> Option<String> {
    match node.graph() {
        Some(path) => state.sheet_at(sheet, path).map(|inner| facts::graph(&inner)),
        None => state.registry().get(&node.ty).map(|t| facts::node(&t.schema)),
    }
}

fn input_text(state: &mut State<'_>, sheet: &Sheet, node: usize, input: &str) -> Option<String> {
    let node = sheet.nodes.get(node)?;
    match node.graph() {
        Some(path) => state.sheet_at(sheet, path)?.find_param(input).map(facts::param),
        None => {
            let schema = state.registry().get(&node.ty)?.schema.clone();
            schema.input(input).map(|(_, i)| facts::input(i, &schema))
        }
    }
}

/// What the word means that stands at an input.
fn choice_text(state: &State<'_>, sheet: &Sheet, node: usize, input: &str) -> Option<String> {
    let schema = &state.registry().get(&sheet.nodes.get(node)?.ty)?.schema;
    let word = sheet.value(node, input)?.text().trim_matches('"');
    let choice = schema.input(input)?.1.choices.iter().find(|c| c.name == word)?;
    Some(format!("`{}`: {}", choice.name, choice.doc))
}
