//! `pegbar explain`: all that there is to know of a node type, a value type or a diagnostic code.

use pegbar_engine::diag::did_you_mean;
use pegbar_engine::node::{Access, InputSchema, InputType, Kind, NodeSchema, OutputSchema};
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_engine::value::TypeSchema;

use crate::args::{ExplainArgs, Format};
use crate::codes::{self, Code};
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

/// Columns of running text.
const WIDTH: usize = 96;

pub(crate) fn explain(args: &ExplainArgs, registry: &Registry, console: &mut Console) -> u8 {
    let name = args.name.as_str();
    let json = args.format == Format::Json;
    let code = name.to_ascii_uppercase();
    if let Some(node) = registry.get(name) {
        return if json { console.json(node.schema.as_ref()) } else { show(console, &(node_text(&node.schema) + &plugin_text(node))) };
    }
    if let Some(ty) = registry.get_type(name) {
        return if json { console.json(&ty.schema) } else { show(console, &type_text(&ty.schema, registry)) };
    }
    if let Some(code) = codes::CODES.iter().find(|c| c.code == code) {
        return if json { console.json(code) } else { show(console, &code_text(code)) };
    }
    console.say(&format!("error: expected a node type, a value type or a code such as PB0142, found `{name}`\n"));
    match did_you_mean(name, known(registry)) {
        Some(near) => console.say(&format!("  help: did you mean `{near}`?\n")),
        None => console.say("  help: `pegbar nodes` lists the node types, `pegbar types` the value types\n"),
    }
    EXIT_WRONG
}

fn known(registry: &Registry) -> impl Iterator<Item = &'static str> {
    let nodes = registry.nodes().map(|n| n.schema.id);
    nodes.chain(registry.types().map(|t| t.schema.name)).chain(codes::CODES.iter().map(|c| c.code))
}

fn show(console: &mut Console, text: &str) -> u8 {
    console.out(text);
    EXIT_OK
}

/// Text in lines of at most [`WIDTH`] columns behind an indent; paragraphs stay apart, and lists and code keep their lines.
pub(crate) fn wrap(text: &str, indent: usize) -> String {
    let mut out = String::new();
    let mut line = String::new();
    let mut in_code = false;
    let room = WIDTH.saturating_sub(indent).max(20);
    let mut flush = |line: &mut String| {
        if !line.is_empty() {
            out.push_str(&format!("{:indent$}{line}\n", ""));
            line.clear();
        }
    };
    for source in text.lines() {
        let fence = source.trim_start().starts_with("```");
        in_code ^= fence;
        if fence || in_code || source.trim().is_empty() || source.trim_start().starts_with(['-', '|', '*']) {
            flush(&mut line);
        }
        if fence {
            continue;
        }
        if in_code {
            flush(&mut source.to_owned());
            continue;
        }
        if source.trim().is_empty() {
            flush(&mut " ".to_owned());
        }
        for word in source.split_whitespace() {
            if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > room {
                flush(&mut line);
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    flush(&mut line);
    out.lines().map(|l| format!("{}\n", l.trim_end())).collect()
}

pub(crate) fn kind_text(kind: Kind) -> &'static str {
    match kind {
        Kind::PerFrame => "per frame: any frame by itself",
        Kind::Recurrent => "recurrent: frame after frame, each from the state of another",
        Kind::Whole => "whole: runs once, over whole sequences",
        Kind::Source => "source: brings values in",
        Kind::Sink => "sink: leaves files behind; what `pegbar run` makes",
    }
}

fn node_text(schema: &NodeSchema) -> String {
    let mut text = format!("{}  (version {}; {})\n\n{}", schema.id, schema.version, kind_text(schema.kind), wrap(schema.doc, 0));
    if !schema.inputs.is_empty() {
        text.push_str("\nInputs\n");
        text.push_str(&schema.inputs.iter().map(input_text).collect::<Vec<_>>().join("\n"));
    }
    if !schema.outputs.is_empty() {
        text.push_str("\nOutputs\n");
        text.push_str(&schema.outputs.iter().map(|o| output_text(o, schema)).collect::<Vec<_>>().join("\n"));
    }
    if let Some(source) = schema.source {
        text.push_str(&format!("\nSource\n{}", wrap(source, 2)));
    }
    if let Some(example) = schema.example {
        text.push_str("\nExample\n");
        text.extend(example.lines().map(|l| format!("  {l}\n")));
    }
    text
}

/// The plugin that a node type comes from.
fn plugin_text(node: &NodeType) -> String {
    match node.operator.plugin() {
        Some(plugin) => format!("\nPlugin\n  {} {}, library {}\n", plugin.name, plugin.version, plugin.digest),
        None => String::new(),
    }
}

/// `0 to 10`, `at least 0`, `at most 10`.
pub(crate) fn range_text((least, greatest): (f64, f64)) -> String {
    match (least.is_finite(), greatest.is_finite()) {
        (true, true) => format!("{least} to {greatest}"),
        (true, false) => format!("at least {least}"),
        (false, true) => format!("at most {greatest}"),
        (false, false) => "any".to_owned(),
    }
}

pub(crate) fn type_of(input: &InputSchema) -> String {
    let base = match &input.ty {
        InputType::Value(name) => (*name).to_owned(),
        InputType::Any => "any type".to_owned(),
        InputType::Setting { name, wire: None } => name.clone(),
        InputType::Setting { name, wire: Some(wire) } => format!("{name}, or a {wire}"),
    };
    if input.list { format!("list of {base}") } else { base }
}

fn input_text(input: &InputSchema) -> String {
    let mut facts = vec![type_of(input)];
    facts.extend(input.unit.map(|u| format!("in {u}")));
    facts.extend(input.range.map(range_text));
    match (input.default, input.optional) {
        (Some(default), _) => facts.push(format!("default {default}")),
        (None, true) => facts.push("may be left out".to_owned()),
        (None, false) => facts.push("must be given".to_owned()),
    }
    let mut text = format!("  {}: {}\n{}", input.name, facts.join("; "), wrap(input.doc, 6));
    let wired = !matches!(input.ty, InputType::Setting { wire: None, .. });
    let read = match input.access {
        Access::Frame => "a stream, read at the same frame, or one value, held",
        Access::Frames => "a stream, read at the frames that the node asks for, or one value, held",
        Access::Sequence => "a stream, read whole",
        Access::Picked => "a stream, of which the node reads the frames that it asks for, or one value",
        Access::Constant => "one value for the whole graph",
    };
    if wired {
        let clock = if input.any_clock { "; its clock may differ from the node's" } else { "" };
        text.push_str(&format!("      takes: {read}{clock}\n"));
    }
    text.extend(input.literal.map(|form| format!("      or a literal: {form}\n")));
    let width = input.choices.iter().map(|c| c.name.chars().count()).max().unwrap_or(0);
    text.extend(input.choices.iter().map(|c| format!("      {:<width$}  {}\n", c.name, c.doc.replace('\n', " "))));
    text
}

fn output_text(output: &OutputSchema, schema: &NodeSchema) -> String {
    let ty = match (output.ty, schema.type_from) {
        (Some(ty), _) => ty.to_owned(),
        (None, Some(input)) => format!("the type of `{input}`"),
        (None, None) => "any type".to_owned(),
    };
    let rate = match (schema.kind, output.stream) {
        (Kind::Whole, true) => "one value a frame",
        (Kind::Whole, false) => "one value for the whole graph",
        _ => "one value a frame if any of its inputs is a stream",
    };
    let rate = if schema.uses_frame { "one value a frame" } else { rate };
    format!("  {}: {ty}; {rate}\n{}", output.name, wrap(output.doc, 6))
}

fn type_text(schema: &TypeSchema, registry: &Registry) -> String {
    let mut text = format!("{}  (value type)\n\n{}", schema.name, wrap(schema.doc, 0));
    if !schema.arrays.is_empty() {
        text.push_str("\nArrays, as in .npz files\n");
        text.extend(schema.arrays.iter().map(|a| {
            let optional = if a.optional { ", may be left out" } else { "" };
            format!("  {}: {} {}{optional}\n{}", a.name, dtype(a), a.shape, wrap(a.doc, 6))
        }));
    }
    if !schema.texts.is_empty() {
        text.push_str("\nText, in the JSON object `meta`\n");
        text.extend(schema.texts.iter().map(|t| format!("  {}\n{}", t.name, wrap(t.doc, 6))));
    }
    let makes = |n: &NodeSchema| n.outputs.iter().any(|o| o.ty == Some(schema.name));
    let takes = |n: &NodeSchema| {
        n.inputs.iter().any(|i| {
            i.ty == InputType::Value(schema.name) || matches!(&i.ty, InputType::Setting { wire: Some(w), .. } if *w == schema.name)
        })
    };
    let ids =
        |f: &dyn Fn(&NodeSchema) -> bool| registry.nodes().filter(|n| f(&n.schema)).map(|n| n.schema.id).collect::<Vec<_>>().join(", ");
    for (title, ids) in [("Made by", ids(&makes)), ("Taken by", ids(&takes))] {
        if !ids.is_empty() {
            text.push_str(&format!("\n{title}\n{}", wrap(&ids, 2)));
        }
    }
    text
}

/// The element type as its own JSON word.
fn dtype(array: &pegbar_engine::value::ArraySchema) -> String {
    serde_json::to_value(array.dtype).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

fn code_text(code: &Code) -> String {
    let block = |text: &str| text.lines().map(|l| format!("  {l}\n")).collect::<String>();
    let mended = if code.mended.is_empty() { String::new() } else { format!("\nMended\n{}", block(code.mended)) };
    format!("{}: {}\n\n{}\nBroken\n{}{mended}", code.code, code.title, wrap(code.meaning, 0), block(code.broken))
}
