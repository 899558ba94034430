//! Settings, and where each comes from.

use std::fmt::Write as _;

use pegbar_engine::check::{Layer, Loaded, Setting};
use pegbar_engine::diag::Label;
use pegbar_engine::graph::{Binding, Graph, GraphNode};

use super::html::{escape, shortened};

/// Characters of a value that are shown.
const MOST: usize = 240;

/// Where a setting is written; nothing for the command line and for defaults.
fn place(loaded: &Loaded, setting: &Setting) -> String {
    match setting.layer {
        Layer::CommandLine | Layer::Default => String::new(),
        _ => format!(" <span class=\"mono\">{}</span>", escape(&loaded.sources.place(&Label::new(setting.file, setting.span)))),
    }
}

/// The inputs of a node: what stands there, and who says so; those at their defaults apart.
pub(super) fn of_node(loaded: &Loaded, graph: &Graph, node: &GraphNode, link: impl Fn(usize) -> String) -> String {
    let (mut given, mut defaults, mut n_defaults) = (String::new(), String::new(), 0);
    for (binding, schema) in node.inputs.iter().zip(&node.ty.schema.inputs) {
        let said = loaded.settings.of(&format!("{}.{}", node.name, schema.name));
        let stands = match binding {
            Binding::None => "<span class=\"soft\">nothing</span>".to_owned(),
            Binding::Literal { text, .. } => literal(text, said.last()),
            Binding::Wire(port) => format!("@{}", link(port.node).replace("{}", &escape(&graph.port_name(*port)))),
            Binding::List(ports) => {
                let links = ports.iter().map(|port| format!("@{}", link(port.node).replace("{}", &escape(&graph.port_name(*port)))));
                links.collect::<Vec<_>>().join(", ")
            }
        };
        let unit = schema.unit.map(|u| format!(" <span class=\"soft\">{}</span>", escape(u))).unwrap_or_default();
        let (name, doc) = (escape(schema.name), escape(schema.doc));
        let (who, class) = match said.last() {
            Some(last) => (format!("{}{}{}", last.layer.name(), place(loaded, last), before(loaded, said, schema.default)), ""),
            None => ("default".to_owned(), " class=\"default\""),
        };
        let row = format!(
            "<tr{class}><td title=\"{doc}\">{name}</td><td class=\"value\">{stands}{unit}</td><td class=\"place\">{who}</td></tr>\n"
        );
        if said.is_empty() {
            n_defaults += 1;
            defaults.push_str(&row);
        } else {
            given.push_str(&row);
        }
    }
    let mut out = String::new();
    if !given.is_empty() {
        let _ = write!(out, "<h4>Inputs</h4><div class=\"wide\"><table>{given}</table></div>");
    }
    if n_defaults > 0 {
        let count = crate::console::count(n_defaults, "input");
        let _ = write!(
            out,
            "<details><summary>{count} as the node type has it</summary><div class=\"wide\"><table>{defaults}</table></div></details>"
        );
    }
    out
}

/// A literal as it is read, and as it is written where that is by variables.
fn literal(text: &str, said: Option<&Setting>) -> String {
    let written = said.map(|s| s.text.trim()).filter(|s| s.contains('$'));
    let from = written.map(|s| format!(" <span class=\"soft\">written {}</span>", escape(&shortened(s, 80)))).unwrap_or_default();
    format!("{}{from}", escape(&shortened(text, MOST)))
}

/// What the layers below said, and the default.
fn before(loaded: &Loaded, said: &[Setting], default: Option<&str>) -> String {
    let mut out = String::new();
    for below in said.iter().rev().skip(1) {
        let _ =
            write!(out, "<br>in place of {} <s>{}</s>{}", below.layer.name(), escape(&shortened(&below.text, 80)), place(loaded, below));
    }
    if let Some(default) = default {
        let _ = write!(out, "; default {}", escape(&shortened(default, 60)));
    }
    out
}

/// Parameters of the graph and of the graphs that it uses.
pub(super) fn parameters(loaded: &Loaded) -> String {
    let mut rows = String::new();
    for name in loaded.settings.names().filter(|name| name.starts_with('$') || name.contains("/$")) {
        let said = loaded.settings.of(name);
        let Some(last) = said.last() else { continue };
        let who = format!("{}{}{}", last.layer.name(), place(loaded, last), before(loaded, said, None));
        let value = escape(&shortened(&last.text, MOST));
        let _ = write!(rows, "<tr><td>{}</td><td class=\"value\">{value}</td><td class=\"place\">{who}</td></tr>\n", escape(name));
    }
    if rows.is_empty() { rows } else { format!("<h2 id=\"parameters\">Parameters</h2><div class=\"wide\"><table>{rows}</table></div>") }
}
