//! Pictures of a graph: Graphviz source, and SVG by a layered layout of our own. The same graph is always drawn the same.

mod layout;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::Kind;

use layout::{HEADER, Layout, NOTE, ROW, layout};

/// A wire that ends at a row of a node: an input, or one reference of a list.
pub(crate) struct Socket {
    /// Name of the input, with a number where it is a list.
    pub(crate) name: String,
    pub(crate) port: Port,
}

/// The wired inputs of a node, a row each.
pub(crate) fn sockets(node: &GraphNode) -> Vec<Socket> {
    let mut sockets = Vec::new();
    for (binding, schema) in node.inputs.iter().zip(&node.ty.schema.inputs) {
        match binding {
            Binding::Wire(port) => sockets.push(Socket { name: schema.name.to_owned(), port: *port }),
            Binding::List(ports) => {
                sockets.extend(ports.iter().enumerate().map(|(i, p)| Socket { name: format!("{}[{i}]", schema.name), port: *p }))
            }
            _ => {}
        }
    }
    sockets
}

/// The value type of an output, with a `*` where it has one value a frame.
pub(crate) fn type_label(graph: &Graph, port: Port) -> String {
    let name = graph.nodes[port.node].output_types.get(port.output).map_or("", String::as_str);
    if graph.is_single(port) { name.to_owned() } else { format!("{name}*") }
}

/// The name of a node within its sub-graph.
pub(crate) fn short_name(node: &GraphNode) -> &str {
    node.name.rsplit('/').next().unwrap_or(&node.name)
}

/// The sub-graph that a node is in; empty for the main graph.
pub(crate) fn folder(node: &GraphNode) -> &str {
    node.name.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Every sub-graph with all that are around it, outermost first.
pub(crate) fn folders(graph: &Graph) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for node in &graph.nodes {
        let own = folder(node);
        all.extend(own.match_indices('/').map(|(at, _)| own[..at].to_owned()));
        all.extend((!own.is_empty()).then(|| own.to_owned()));
    }
    all.sort();
    all.dedup();
    all
}

fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // XML 1.0 has no such characters, not even escaped.
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// The literals of a node, a line each.
fn literals(node: &GraphNode) -> Vec<String> {
    let pairs = node.inputs.iter().zip(&node.ty.schema.inputs);
    let line = |(binding, schema): (&Binding, &crate::node::InputSchema)| match binding {
        Binding::Literal { text, .. } => Some(format!("{}: {text}", schema.name)),
        _ => None,
    };
    pairs.filter_map(line).collect()
}

fn colour(kind: Kind) -> &'static str {
    match kind {
        Kind::PerFrame => "#dbe7f5",
        Kind::Recurrent => "#e6def4",
        Kind::Whole => "#f6e3c9",
        Kind::Source => "#d9efdb",
        Kind::Sink => "#f5dada",
    }
}

/// The graph as source for Graphviz, sub-graphs as clusters. O(nodes + wires).
pub fn dot(graph: &Graph) -> String {
    let mut out = String::from(
        "digraph pegbar {\n  rankdir=LR;\n  node [shape=plain, fontname=\"Helvetica\", fontsize=11];\n  edge [fontname=\"Helvetica\", fontsize=9];\n",
    );
    dot_folder(graph, "", &folders(graph), &mut out);
    for (i, node) in graph.nodes.iter().enumerate() {
        for (row, socket) in sockets(node).iter().enumerate() {
            let label = escape(&type_label(graph, socket.port));
            let _ = writeln!(out, "  n{}:o{}:e -> n{i}:i{row}:w [label=\"{label}\"];", socket.port.node, socket.port.output);
        }
    }
    out.push_str("}\n");
    out
}

/// Nodes of one sub-graph, and the sub-graphs right inside it.
fn dot_folder(graph: &Graph, own: &str, all: &[String], out: &mut String) {
    for (i, node) in graph.nodes.iter().enumerate().filter(|(_, n)| folder(n) == own) {
        dot_node(i, node, out);
    }
    let prefix = if own.is_empty() { String::new() } else { format!("{own}/") };
    for inner in
        all.iter().filter(|f| f.strip_prefix(&prefix).is_some_and(|rest| !rest.is_empty() && !rest.contains('/')) && f.as_str() != own)
    {
        let id = all.iter().position(|f| f == inner).unwrap_or(0);
        let _ = writeln!(
            out,
            "  subgraph cluster_{id} {{\n  label=\"{}\"; style=rounded; fontname=\"Helvetica\";",
            escape(inner).replace('\\', "\\\\")
        );
        dot_folder(graph, inner, all, out);
        out.push_str("  }\n");
    }
}

fn dot_node(i: usize, node: &GraphNode, out: &mut String) {
    let (sockets, outputs) = (sockets(node), &node.ty.schema.outputs);
    let _ = write!(
        out,
        "  n{i} [label=<<TABLE BORDER=\"1\" CELLBORDER=\"0\" CELLSPACING=\"0\" STYLE=\"ROUNDED\" BGCOLOR=\"{}\">",
        colour(node.ty.schema.kind)
    );
    let _ = write!(out, "<TR><TD COLSPAN=\"2\"><B>{}</B><BR/>{}</TD></TR>", escape(short_name(node)), escape(node.ty.schema.id));
    for row in 0..sockets.len().max(outputs.len()) {
        let left =
            sockets.get(row).map_or("<TD></TD>".to_owned(), |s| format!("<TD PORT=\"i{row}\" ALIGN=\"LEFT\">{}</TD>", escape(&s.name)));
        let right =
            outputs.get(row).map_or("<TD></TD>".to_owned(), |o| format!("<TD PORT=\"o{row}\" ALIGN=\"RIGHT\">{}</TD>", escape(o.name)));
        let _ = write!(out, "<TR>{left}{right}</TR>");
    }
    out.push_str("</TABLE>>];\n");
}

/// Colours of wires, a type each.
const WIRES: [&str; 8] = ["#3b6ea8", "#b0532b", "#3c8d57", "#8551a3", "#a8862b", "#2b8a93", "#a83b62", "#666666"];

/// The graph as a picture: layers from left to right, each node right of what it reads, sub-graphs in boxes.
pub fn svg(graph: &Graph) -> String {
    svg_noted(graph, &[])
}

/// As [`svg`], with lines of text at the foot of each node: `notes` has a list for each, or none at all. Parts have classes (`ground`, `cluster`,
/// `wire`, `type`, `node`, `note`) and nodes the ids `n0`, `n1` and so on, for the style sheet of a page that holds it.
pub fn svg_noted(graph: &Graph, notes: &[Vec<String>]) -> String {
    let layout = layout(graph, notes);
    let types: BTreeMap<String, usize> = type_colours(graph);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w:.0}\" height=\"{h:.0}\" viewBox=\"0 0 {w:.0} {h:.0}\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"11\">\n<rect class=\"ground\" width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n",
        w = layout.width,
        h = layout.height
    );
    for cluster in &layout.clusters {
        let [x, y, w, h] = cluster.rect;
        let _ = writeln!(
            out,
            "<rect class=\"cluster\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" rx=\"10\" fill=\"#f4f4f2\" fill-opacity=\"0.7\" stroke=\"#b9b9b3\" stroke-dasharray=\"5 3\"/>"
        );
        let _ = writeln!(
            out,
            "<text class=\"note\" x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\" fill=\"#77776f\">{}</text>",
            x + 10.0,
            y + 14.0,
            escape(&cluster.name)
        );
    }
    for (i, node) in graph.nodes.iter().enumerate() {
        for (row, socket) in sockets(node).iter().enumerate() {
            svg_wire(graph, &layout, i, row, socket, &types, &mut out);
        }
    }
    for (i, node) in graph.nodes.iter().enumerate() {
        svg_node(&layout, i, node, notes.get(i).map_or(&[], Vec::as_slice), &mut out);
    }
    let _ = writeln!(
        out,
        "<text class=\"note\" x=\"12\" y=\"{:.1}\" font-size=\"10\" fill=\"#888888\">* one value a frame</text>",
        layout.height - 8.0
    );
    out.push_str("</svg>\n");
    out
}

fn type_colours(graph: &Graph) -> BTreeMap<String, usize> {
    let mut names: Vec<&String> = graph.nodes.iter().flat_map(|n| &n.output_types).collect();
    names.sort();
    names.dedup();
    names.into_iter().enumerate().map(|(i, name)| (name.clone(), i % WIRES.len())).collect()
}

fn svg_wire(graph: &Graph, layout: &Layout, node: usize, row: usize, socket: &Socket, types: &BTreeMap<String, usize>, out: &mut String) {
    let points = layout.path(node, row, socket.port);
    let ty = graph.nodes[socket.port.node].output_types.get(socket.port.output);
    let colour = WIRES[ty.and_then(|t| types.get(t)).copied().unwrap_or(0)];
    let mut path = String::new();
    for (k, pair) in points.chunks_exact(2).enumerate() {
        let ([x0, y0], [x1, y1]) = (pair[0], pair[1]);
        let middle = (x0 + x1) / 2.0;
        let start = if k == 0 { format!("M{x0:.1} {y0:.1}") } else { format!(" L{x0:.1} {y0:.1}") };
        let _ = write!(path, "{start} C{middle:.1} {y0:.1} {middle:.1} {y1:.1} {x1:.1} {y1:.1}");
    }
    let from = escape(&graph.port_name(socket.port));
    let to = escape(&format!("{}.{}", graph.nodes[node].name, socket.name));
    let _ = writeln!(
        out,
        "<path class=\"wire\" d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"><title>{from} to {to}</title></path>"
    );
    if let Some([x, y]) = points.last() {
        let label = escape(&type_label(graph, socket.port));
        let _ = writeln!(
            out,
            "<text class=\"type\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"9\" fill=\"{colour}\" stroke=\"#ffffff\" stroke-width=\"3\" paint-order=\"stroke\">{label}</text>",
            x - 7.0,
            y - 3.0
        );
    }
}

fn svg_node(layout: &Layout, i: usize, node: &GraphNode, notes: &[String], out: &mut String) {
    let [x, y, w, h] = layout.nodes[i];
    let fill = colour(node.ty.schema.kind);
    let mut title = vec![format!("{} ({})", node.name, node.ty.schema.id)];
    title.extend(literals(node));
    let _ =
        writeln!(out, "<g class=\"node\" id=\"n{i}\"><title>{}</title>", title.iter().map(|t| escape(t)).collect::<Vec<_>>().join("\n"));
    let _ =
        writeln!(out, "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" rx=\"7\" fill=\"{fill}\" stroke=\"#55606b\"/>");
    let middle = x + w / 2.0;
    let _ = writeln!(
        out,
        "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-weight=\"bold\" font-size=\"12\">{}</text>",
        y + 16.0,
        escape(short_name(node))
    );
    let _ = writeln!(
        out,
        "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"10\" class=\"note\" fill=\"#55606b\">{}</text>",
        y + 30.0,
        escape(node.ty.schema.id)
    );
    let row_y = |row: usize| y + HEADER + (row as f64 + 0.5) * ROW;
    for (row, socket) in sockets(node).iter().enumerate() {
        let cy = row_y(row);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.1}\" cy=\"{cy:.1}\" r=\"3\" fill=\"#55606b\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            x + 8.0,
            cy + 4.0,
            escape(&socket.name)
        );
    }
    for (row, output) in node.ty.schema.outputs.iter().enumerate() {
        let (cx, cy) = (x + w, row_y(row));
        let _ = writeln!(
            out,
            "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"3\" fill=\"#55606b\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            cx - 8.0,
            cy + 4.0,
            escape(output.name)
        );
    }
    let foot = y + h - 4.0 - notes.len() as f64 * NOTE;
    for (row, note) in notes.iter().enumerate() {
        let _ = writeln!(
            out,
            "<text class=\"note\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"10\" fill=\"#55606b\">{}</text>",
            foot + (row as f64 + 0.75) * NOTE,
            escape(note)
        );
    }
    out.push_str("</g>\n");
}
