//! `pegbar whose`: where a setting comes from.

use std::fmt::Write as _;

use pegbar_engine::check::{Layer, Loaded, Setting, load};
use pegbar_engine::diag::Label;
use pegbar_engine::registry::Registry;
use serde::Serialize;

use crate::args::{Format, WhoseArgs};
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

/// Who says something of one input or parameter, the strongest first.
#[derive(Serialize)]
struct Stack {
    name: String,
    settings: Vec<Line>,
    /// Of the variables that the strongest reads.
    variables: Vec<Stack>,
}

#[derive(Serialize)]
struct Line {
    layer: &'static str,
    text: String,
    /// File, line and column; none for a default and for the command line.
    place: Option<String>,
}

/// Variables that stand for variables, at most.
const DEPTH: usize = 16;

pub(crate) fn whose(args: &WhoseArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    let stacks = match &args.name {
        Some(name) => named(&loaded, name),
        None => from_outside(&loaded),
    };
    if let (true, Some(name)) = (stacks.is_empty(), &args.name) {
        return unknown(&loaded, name, console);
    }
    match args.format {
        Format::Json => console.json(&stacks),
        Format::Text => {
            let mut text = String::new();
            stacks.iter().for_each(|stack| write(stack, 0, &mut text));
            let none = "nothing is set from outside the graph\n";
            console.out(if text.is_empty() { none } else { &text });
            EXIT_OK
        }
    }
}

/// What is said of an input, of a parameter, or of every input of a node.
fn named(loaded: &Loaded, name: &str) -> Vec<Stack> {
    let inputs = |node: &str| -> Vec<String> {
        let graph = loaded.graph.iter();
        let inputs = graph.filter_map(|g| g.nodes.get(g.find(node)?)).flat_map(|n| n.ty.schema.inputs.iter().map(|i| i.name));
        inputs.map(|input| format!("{node}.{input}")).collect()
    };
    let exact = stack(loaded, name, 0);
    if exact.settings.is_empty() {
        inputs(name).iter().map(|n| stack(loaded, n, 0)).filter(|s| !s.settings.is_empty()).collect()
    } else {
        vec![exact]
    }
}

fn from_outside(loaded: &Loaded) -> Vec<Stack> {
    let outside = |name: &&str| loaded.settings.of(name).iter().any(|s| s.layer > Layer::Graph);
    loaded.settings.names().filter(outside).map(|name| stack(loaded, name, 0)).collect()
}

fn stack(loaded: &Loaded, name: &str, depth: usize) -> Stack {
    let said = loaded.settings.of(name);
    let place = |s: &Setting| (s.layer != Layer::CommandLine).then(|| loaded.sources.place(&Label::new(s.file, s.span)));
    let mut settings: Vec<Line> =
        said.iter().rev().map(|s| Line { layer: s.layer.name(), text: s.text.clone(), place: place(s) }).collect();
    settings.extend(default(loaded, name).map(|text| Line { layer: Layer::Default.name(), text, place: None }));
    let read = said.last().filter(|_| depth < DEPTH).map(|s| variables(&s.text).into_iter().map(|v| format!("{}${v}", s.within)));
    let variables = read.into_iter().flatten().map(|v| stack(loaded, &v, depth + 1)).filter(|s| !s.settings.is_empty()).collect();
    Stack { name: name.to_owned(), settings, variables }
}

/// The default of the node type.
fn default(loaded: &Loaded, name: &str) -> Option<String> {
    let (node, input) = name.rsplit_once('.')?;
    let graph = loaded.graph.as_ref()?;
    let (_, schema) = graph.nodes.get(graph.find(node)?)?.ty.schema.input(input)?;
    schema.default.map(str::to_owned).or_else(|| schema.optional.then(|| "None".to_owned()))
}

/// The variables that a text reads.
fn variables(text: &str) -> Vec<&str> {
    let plain = text.replace("$$", "  ");
    let names = plain.match_indices('$').map(|(at, _)| {
        let rest = &text[at + 1..];
        &rest[..rest.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count()]
    });
    names.filter(|name| !name.is_empty()).collect()
}

fn write(stack: &Stack, indent: usize, out: &mut String) {
    let _ = writeln!(out, "{:indent$}{}", "", stack.name);
    let widths = stack.settings.iter().map(|s| s.place.as_deref().unwrap_or("").chars().count());
    let width = widths.max().unwrap_or(0);
    for line in &stack.settings {
        let place = line.place.as_deref().unwrap_or("");
        let text: Vec<&str> = line.text.split_whitespace().collect();
        let _ = writeln!(out, "{:indent$}  {:<12}  {place:<width$}  {}", "", line.layer, text.join(" "));
    }
    stack.variables.iter().for_each(|inner| write(inner, indent + 4, out));
}

fn unknown(loaded: &Loaded, name: &str, console: &mut Console) -> u8 {
    let inputs =
        loaded.graph.iter().flat_map(|g| &g.nodes).flat_map(|n| n.ty.schema.inputs.iter().map(|i| format!("{}.{}", n.name, i.name)));
    let known: Vec<String> = inputs.chain(loaded.settings.names().map(str::to_owned)).collect();
    let near = pegbar_engine::diag::did_you_mean(name, known.iter().map(String::as_str));
    let hint = near.map(|n| format!("; did you mean `{n}`?")).unwrap_or_default();
    console
        .say(&format!("error: expected an input as NODE.INPUT or a parameter as $NAME of which something is said, found `{name}`{hint}\n"));
    EXIT_WRONG
}
