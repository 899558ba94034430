//! What may stand at an input: references, variables, words, files.

use pegbar_engine::node::{InputSchema, InputType};
use pegbar_engine::setting::{Choice, FileUse};

use super::super::cursor::{Cursor, Frame, given_fields};
use super::super::facts;
use super::super::state::PortFacts;
use super::items::{Item, Kind, escaped};
use super::{Asked, given, type_of};

/// What an input takes.
#[derive(Clone, Debug)]
struct Expected {
    /// The value type that may be wired; any for `None`.
    wire: Option<&'static str>,
    is_wired: bool,
    /// True where one value for the whole graph is needed.
    is_constant: bool,
    choices: Vec<Choice>,
    /// Name for people of what may be written.
    literal: String,
    default: Option<&'static str>,
    files: FileUse,
}

impl Expected {
    fn of(input: &InputSchema) -> Self {
        let (wire, is_wired, literal) = match &input.ty {
            InputType::Value(ty) => (Some(*ty), true, String::new()),
            InputType::Any => (None, true, String::new()),
            InputType::Setting { name, wire } => (*wire, wire.is_some(), name.clone()),
        };
        let is_constant = input.access == pegbar_engine::node::Access::Constant;
        let (choices, default, files) = (input.choices.clone(), input.default, input.files);
        Self { wire, is_wired, is_constant, choices, literal, default, files }
    }

    /// By the type that a parameter declares.
    fn of_param(ty: &str, types: &[&'static str]) -> Self {
        let wire = types.iter().find(|t| **t == ty).copied();
        let is_any = matches!(ty, "" | "any");
        let literal = if ty == "bool" { "true or false" } else { "" };
        let files = if ty == "path" { FileUse::Read } else { FileUse::None };
        Self {
            wire,
            is_wired: wire.is_some() || is_any,
            is_constant: false,
            choices: Vec::new(),
            literal: literal.to_owned(),
            default: None,
            files,
        }
    }

    /// The better a port fits, the less.
    fn rank(&self, port: &PortFacts) -> u8 {
        let fits = match self.wire {
            _ if port.ty.is_empty() => 1,
            Some(ty) if ty != port.ty => return 3,
            _ => 0,
        };
        fits + u8::from(self.is_constant && port.per_frame)
    }
}

/// What a completion of an input's name writes behind the colon.
pub(super) fn template(input: &InputSchema) -> String {
    match (&input.ty, input.default) {
        (InputType::Value(_) | InputType::Any, _) if input.list => "[\"@$1\"]".to_owned(),
        (InputType::Value(_) | InputType::Any, _) => "\"@$1\"".to_owned(),
        (_, Some(default)) => format!("${{1:{}}}", escaped(default)),
        _ if input.files != FileUse::None || matches!(&input.ty, InputType::Setting { name, .. } if name == "text") => "\"$1\"".to_owned(),
        _ => "$1".to_owned(),
    }
}

/// The same for a parameter of a graph.
pub(super) fn param_template(ty: &str) -> &'static str {
    match ty {
        "path" | "text" => "\"$1\"",
        "number" | "whole" | "bool" | "any" | "" => "$1",
        _ => "\"@$1\"",
    }
}

impl Asked<'_, '_> {
    /// The value of an input of the node whose record opens at `open`.
    pub(super) fn input_value(&mut self, node: &str, open: Frame<'_>, input: &str, cursor: &Cursor<'_>) {
        let given = given(open, cursor);
        let Some(ty) = type_of(&given) else { return };
        let expected = match ty.strip_prefix("graph:") {
            Some(path) => {
                let inner = self.state.sheet_at(&self.sheet, path);
                let Some(ty) = inner.and_then(|i| i.find_param(input).map(|p| p.ty.clone())) else { return };
                Expected::of_param(&ty, &self.value_types())
            }
            None => {
                let Some(ty) = self.state.registry().get(ty) else { return };
                let Some((_, input)) = ty.schema.input(input) else { return };
                Expected::of(input)
            }
        };
        self.value(&expected, Some(node), cursor);
    }

    pub(super) fn output_value(&mut self, cursor: &Cursor<'_>) {
        let expected = Expected { is_wired: true, ..Expected::of_param("any", &[]) };
        self.references(&expected, None, cursor);
    }

    pub(super) fn clock_value(&mut self, cursor: &Cursor<'_>) {
        let expected = Expected { is_wired: false, ..Expected::of_param("whole", &[]) };
        self.value(&expected, None, cursor);
    }

    pub(super) fn param_default(&mut self, name: &str, open: Frame<'_>, cursor: &Cursor<'_>) {
        let given = given_fields(open.open);
        let Some(ty) = type_of(&given) else { return };
        let expected = Expected { is_wired: false, ..Expected::of_param(ty, &[]) };
        self.value(&expected, None, cursor);
        let own = format!("${name}");
        self.items.retain(|item| item.label() != own);
    }

    fn value_types(&self) -> Vec<&'static str> {
        self.state.registry().types().map(|t| t.schema.name).collect()
    }

    fn value(&mut self, expected: &Expected, node: Option<&str>, cursor: &Cursor<'_>) {
        let word = cursor.word;
        if let Some(dollar) = variable_start(word.before).filter(|_| word.is_quoted) {
            return self.variables(expected, dollar, cursor);
        }
        if expected.is_wired {
            self.references(expected, node, cursor);
        }
        if word.is_quoted && word.before.starts_with('@') {
            return;
        }
        self.words(expected, cursor);
        if expected.files != FileUse::None {
            self.files(expected.files, cursor);
        }
        if word.before.is_empty() || !word.is_quoted {
            self.variables(expected, 0, cursor);
        }
    }

    /// Words of an enumeration, true and false, clocks, value types, and the default.
    fn words(&mut self, expected: &Expected, cursor: &Cursor<'_>) {
        for choice in &expected.choices {
            let is_default = expected.default == Some(choice.name);
            let item = Item::new(choice.name, Kind::Choice).doc(choice.doc).detail(if is_default { "default" } else { "" });
            self.items.extend(if cursor.word.is_quoted { Some(item.quoted(cursor)) } else { item.bare(cursor) });
        }
        match expected.literal.as_str() {
            "true or false" => ["true", "false"].into_iter().for_each(|word| {
                let detail = if expected.default == Some(word) { "default" } else { "" };
                self.items.extend(Item::new(word, Kind::Value).detail(detail).bare(cursor));
            }),
            "clock" => {
                let clocks = self.sheet.clocks.iter().map(|c| c.name.clone()).chain(["frames".to_owned()]);
                self.items.extend(clocks.map(|c| Item::new(c, Kind::Value).detail("clock").quoted(cursor)));
            }
            "value type" => {
                let types = self.value_types().into_iter().map(|t| Item::new(t, Kind::Type).quoted(cursor));
                self.items.extend(types);
            }
            _ if expected.choices.is_empty() => {
                let default = expected.default.map(|d| Item::new(d, Kind::Value).detail("default"));
                self.items.extend(default.and_then(|item| item.bare(cursor)));
            }
            _ => (),
        }
    }

    /// `@node`, and `@node.port` where another output than the first is the one that fits, or where the point is written.
    fn references(&mut self, expected: &Expected, own: Option<&str>, cursor: &Cursor<'_>) {
        let typed = cursor.word.before.strip_prefix('@').unwrap_or_default();
        let asked = typed.split_once('.').map(|(node, _)| node);
        let sheet = std::rc::Rc::clone(&self.sheet);
        let checked = std::rc::Rc::clone(&self.checked);
        for (i, node) in sheet.nodes.iter().enumerate() {
            let name = node.decl.name.as_str();
            if own == Some(name) || asked.is_some_and(|asked| asked != name) {
                continue;
            }
            let ports = self.state.ports(&sheet, i, "", &checked);
            for (p, port) in ports.iter().enumerate() {
                let rank = expected.rank(port);
                if asked.is_none() && p > 0 && (rank > 1 || expected.wire.is_none()) {
                    continue;
                }
                let label = if asked.is_none() && p == 0 { format!("@{name}") } else { format!("@{name}.{}", port.name) };
                let detail = format!("{} of {}", if port.ty.is_empty() { "value" } else { &port.ty }, node.ty);
                let item = Item::new(label, Kind::Reference).detail(detail).doc(doc(port, &node.doc)).rank(rank);
                self.items.push(item.quoted(cursor));
            }
        }
    }

    /// `$name`, from byte `from` of the text on.
    fn variables(&mut self, expected: &Expected, from: usize, cursor: &Cursor<'_>) {
        let sheet = std::rc::Rc::clone(&self.sheet);
        for param in &sheet.params {
            let is_fitting = expected.wire.is_some_and(|w| w == param.ty) || (expected.files != FileUse::None && param.ty == "path");
            let item = Item::new(format!("${}", param.decl.name), Kind::Variable).detail(facts::param_facts(param));
            self.items.push(item.doc(param.doc.as_str()).rank(if is_fitting { 0 } else { 2 }).ending(from, cursor));
        }
        let checked = std::rc::Rc::clone(&self.checked);
        for (name, value) in checked.loaded.variables.iter().filter(|(name, _)| sheet.find_param(name).is_none()) {
            let is_folder = expected.files != FileUse::None && name.ends_with("_dir");
            let item = Item::new(format!("${name}"), Kind::Variable).detail(value.as_str()).doc("Of a layer.");
            self.items.push(item.rank(if is_folder { 0 } else { 2 }).ending(from, cursor));
        }
        if expected.files != FileUse::None || expected.literal == "text" {
            let item = Item::new("$out", Kind::Variable).detail("the output folder").rank(u8::from(expected.files != FileUse::Write) * 2);
            self.items.push(item.ending(from, cursor));
        }
    }
}

/// What an output is, with the comment above its node.
fn doc(port: &PortFacts, comment: &str) -> String {
    let rate = if port.per_frame { "one value a frame" } else { "one value for the whole graph" };
    let comment = if comment.is_empty() { String::new() } else { format!("\n\n{comment}") };
    format!("`{}`: {rate}\n\n{}{comment}", port.name, port.doc)
}

/// Where the variable starts that is being typed at the end of a text.
fn variable_start(before: &str) -> Option<usize> {
    let dollar = before.rfind('$')?;
    let is_name = before[dollar + 1..].bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    let is_escaped = before[..dollar].bytes().rev().take_while(|b| *b == b'$').count() % 2 == 1;
    (is_name && !is_escaped).then_some(dollar)
}
