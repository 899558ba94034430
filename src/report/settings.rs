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
        _ => format!(" <span class=\"mono\">{}</span>", escape(&tidy(&loaded.sources.place(&Label::new(setting.file, setting.span))))),
    }
}

/// A path without the folders that it goes into and out of again.
fn tidy(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match parts.last() {
            Some(last) if part == ".." && !["", "..", "."].contains(last) => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.join("/")
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
            "<details><summary>{count} at the default of the node type</summary><div class=\"wide\"><table>{defaults}</table></div></details>"
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

/// Parameters of the graph; those of the graphs that it uses apart.
pub(super) fn parameters(loaded: &Loaded) -> String {
    let (mut own, mut inner, mut n_inner) = (String::new(), String::new(), 0);
    for name in loaded.settings.names().filter(|name| name.starts_with('$') || name.contains("/$")) {
        let said = loaded.settings.of(name);
        let Some(last) = said.last() else { continue };
        let who = format!("{}{}{}", last.layer.name(), place(loaded, last), before(loaded, said, None));
        let value = escape(&shortened(&last.text, MOST));
        let rows = if name.starts_with('$') { &mut own } else { &mut inner };
        n_inner += usize::from(!name.starts_with('$'));
        let _ = writeln!(rows, "<tr><td>{}</td><td class=\"value\">{value}</td><td class=\"place\">{who}</td></tr>", escape(name));
    }
    let mut out = String::new();
    if !own.is_empty() || n_inner > 0 {
        let _ = write!(out, "<h2 id=\"parameters\">Parameters</h2><div class=\"wide\"><table>{own}</table></div>");
    }
    if n_inner > 0 {
        let _ = write!(
            out,
            "<details><summary>{n_inner} of the graphs that it uses</summary><div class=\"wide\"><table>{inner}</table></div></details>"
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::tidy;

    #[test]
    fn paths_go_straight() {
        let cases = [
            ("a/b/../../c/d.ron:1:2", "c/d.ron:1:2"),
            ("../a/../b", "../b"),
            ("/a/./b", "/a/./b"),
            ("../../a", "../../a"),
            ("/../a", "/../a"),
        ];
        for (path, straight) in cases {
            assert_eq!(tidy(path), straight);
        }
    }
}
