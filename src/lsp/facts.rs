//! What there is to know of nodes, inputs, outputs and parameters, in Markdown.

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Access, InputSchema, InputType, NodeSchema};

use crate::codes::CODES;
use crate::explain::{kind_text, range_text, type_of};

use super::sheet::{ParamDecl, Sheet};
use super::state::PortFacts;

/// The first paragraph of a doc comment.
pub(super) fn summary(doc: &str) -> &str {
    doc.split("\n\n").next().unwrap_or_default().trim()
}

/// What must be given, and what comes out: `Image, Matte -> Affine2`.
pub(super) fn signature(schema: &NodeSchema) -> String {
    let wired = |i: &&InputSchema| !matches!(i.ty, InputType::Setting { .. }) && !i.optional;
    let takes: Vec<String> = schema.inputs.iter().filter(wired).map(type_of).collect();
    let makes: Vec<&str> = schema.outputs.iter().map(|o| o.ty.unwrap_or("any type")).collect();
    match (takes.is_empty(), makes.is_empty()) {
        (true, _) => makes.join(", "),
        (false, true) => takes.join(", "),
        (false, false) => format!("{} -> {}", takes.join(", "), makes.join(", ")),
    }
}

/// A node type.
pub(super) fn node(schema: &NodeSchema) -> String {
    let mut out = format!("**{}** — {}\n\n{}\n", schema.id, kind_text(schema.kind), schema.doc.trim());
    let inputs: Vec<String> = schema.inputs.iter().map(|i| format!("- `{}`: {}", i.name, facts(i))).collect();
    if !inputs.is_empty() {
        out.push_str(&format!("\nInputs\n{}\n", inputs.join("\n")));
    }
    let outputs: Vec<String> = schema.outputs.iter().map(|o| format!("- `{}`: {}", o.name, o.ty.unwrap_or("any type"))).collect();
    if !outputs.is_empty() {
        out.push_str(&format!("\nOutputs\n{}\n", outputs.join("\n")));
    }
    if let Some(source) = schema.source {
        out.push_str(&format!("\nSource: {source}\n"));
    }
    out.push_str(&format!("\n`pegbar explain {}` says more", schema.id));
    out
}

/// Type, unit, range and default of an input, on one line.
pub(super) fn facts(input: &InputSchema) -> String {
    let mut facts = vec![type_of(input)];
    facts.extend(input.unit.map(|u| format!("in {u}")));
    facts.extend(input.range.map(range_text));
    facts.push(match (input.default, input.optional) {
        (Some(default), _) => format!("default `{default}`"),
        (None, true) => "may be left out".to_owned(),
        (None, false) => "must be given".to_owned(),
    });
    facts.join("; ")
}

/// An input.
pub(super) fn input(input: &InputSchema, schema: &NodeSchema) -> String {
    let mut out = format!("**{}** of {}: {}\n\n{}\n", input.name, schema.id, facts(input), input.doc.trim());
    if !matches!(input.ty, InputType::Setting { wire: None, .. }) {
        let clock = if input.any_clock { "; its clock may differ from the node's" } else { "" };
        out.push_str(&format!("\nTakes {}{clock}\n", taken(input.access)));
    }
    if let Some(form) = input.literal {
        out.push_str(&format!("\nOr a literal: {form}\n"));
    }
    let choices: Vec<String> = input.choices.iter().map(|c| format!("- `{}`: {}", c.name, c.doc.replace('\n', " "))).collect();
    if !choices.is_empty() {
        out.push_str(&format!("\n{}\n", choices.join("\n")));
    }
    out
}

fn taken(access: Access) -> &'static str {
    match access {
        Access::Frame => "a stream, read at the same frame, or one value, held",
        Access::Frames => "a stream, read at the frames that the node asks for, or one value, held",
        Access::Sequence => "a stream, read whole",
        Access::Picked => "a stream, of which the node reads the frames that it asks for, or one value",
        Access::Constant => "one value for the whole graph",
    }
}

/// `frames`, 1 to 48 at 24 fps.
pub(super) fn clock(clock: &Clock) -> String {
    let (count, of) = clock.fps;
    let rate = if of == 1 { count.to_string() } else { format!("{count}/{of}") };
    format!("clock `{}`, {} to {} at {rate} fps", clock.name, clock.first, clock.last)
}

/// An output with its type, rate and clock as they were found out.
pub(super) fn port(port: &PortFacts, on: Option<&Clock>) -> String {
    let ty = if port.ty.is_empty() { "type not known" } else { &port.ty };
    let rate = match (port.per_frame, on) {
        (true, Some(on)) => format!("one value a frame; {}", clock(on)),
        (true, None) => "one value a frame".to_owned(),
        (false, _) => "one value for the whole graph".to_owned(),
    };
    format!("`{}`: {ty}; {rate}", port.name)
}

/// Type and default of a parameter, on one line.
pub(super) fn param_facts(param: &ParamDecl) -> String {
    let ty = if param.ty.is_empty() { "any" } else { &param.ty };
    match &param.default {
        Some(default) => format!("{ty}; default `{}`", shortened(default)),
        None => format!("{ty}; must be given"),
    }
}

/// A parameter.
pub(super) fn param(param: &ParamDecl) -> String {
    format!("**${}**: {}\n\n{}\n", param.decl.name, param_facts(param), param.doc)
}

/// A graph file as a node.
pub(super) fn graph(sheet: &Sheet) -> String {
    let name = sheet.path.file_name().unwrap_or_default().to_string_lossy();
    let mut out = format!("**graph:{name}**\n\n{}\n", sheet.doc);
    let params: Vec<String> = sheet.params.iter().map(|p| format!("- `{}`: {}", p.decl.name, param_facts(p))).collect();
    if !params.is_empty() {
        out.push_str(&format!("\nInputs\n{}\n", params.join("\n")));
    }
    let outputs: Vec<String> = sheet.outputs.iter().map(|o| format!("- `{}`", o.decl.name)).collect();
    if !outputs.is_empty() {
        out.push_str(&format!("\nOutputs\n{}\n", outputs.join("\n")));
    }
    out
}

/// A diagnostic code, with the mistake mended.
pub(super) fn code(code: &str) -> Option<String> {
    let known = CODES.iter().find(|c| c.code == code)?;
    let mended = if known.mended.is_empty() { String::new() } else { format!("\n```ron\n{}\n```\n", known.mended) };
    Some(format!("**{code}**: {}\n\n{}\n{mended}", known.title, known.meaning))
}

/// A literal that fits on a line.
fn shortened(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= 60 { line } else { line.chars().take(57).chain("...".chars()).collect() }
}

/// The fields of a graph, each with what a completion writes behind the colon.
pub(super) const GRAPH_FIELDS: [(&str, &str, &str); 9] = [
    ("pegbar", "Version of the graph format.", "1"),
    ("doc", "What the graph does, for people.", "\"$1\""),
    ("version", "Version of this graph, for those who use it: `graph:this.ron@1.4`.", "\"${1:1.0.0}\""),
    ("plugins", "Plugins with further node types, by the paths of their manifests or folders.", "[\"$1\"]"),
    (
        "frames",
        "The default clock: its first and last frame, and how many there are a second.",
        "(first: ${1:1}, last: ${2:48}, fps: ${3:24})",
    ),
    ("clocks", "Further clocks, by name.", "{ \"$1\": (first: ${2:1}, last: ${3:48}, fps: ${4:24}) }"),
    ("params", "What is given from outside: by --var, or by the graph that uses this one. `$name` stands for the value.", "{\n    $0\n}"),
    ("nodes", "The nodes, by name.", "{\n    $0\n}"),
    ("outputs", "What another graph may take from this one, by name.", "{ \"$1\": \"@$2\" }"),
];

/// The fields of a clock.
pub(super) const CLOCK_FIELDS: [(&str, &str, &str); 3] = [
    ("first", "The first frame.", "${1:1}"),
    ("last", "The last frame, at least the first.", "${1:48}"),
    ("fps", "Frames a second: 24, or as a fraction (24000, 1001).", "${1:24}"),
];

/// The fields of a parameter.
pub(super) const PARAM_FIELDS: [(&str, &str, &str); 3] = [
    ("type", "path, text, number, whole, bool, any, or a value type.", "\"$1\""),
    ("default", "Its value where none is given.", "$1"),
    ("doc", "What it means, for people.", "\"$1\""),
];

/// The types of parameters beside the value types.
pub(super) const PARAM_TYPES: [(&str, &str); 6] = [
    ("path", "A file, or one a frame; held against the folder of the graph in which it is written."),
    ("text", "A text in quotes."),
    ("number", "A number."),
    ("whole", "A whole number."),
    ("bool", "true or false."),
    ("any", "Whatever the inputs take at which it stands."),
];
