//! Variables and references: from what is written at an input to the literal or the node that it means.

use crate::diag::Diagnostic;
use crate::graph::Port;
use crate::syntax::{NodeKind, NodeRef, Tree};

use super::document::{Entry, Given};
use super::{At, Checker, code};

/// What is written at an input, with every variable replaced.
pub(super) enum Written {
    /// A literal.
    Literal(Given),
    /// A reference: `@node.port` in a scope.
    Reference(Given),
    /// References.
    References(Vec<Given>),
    /// Wrong; said already.
    Broken,
}

/// Deeper than any sane chain of graphs that hand a reference on.
const MAX_DEPTH: usize = 64;

impl Checker<'_> {
    /// Replaces the variables of what is written at an input, and tells literals from references.
    pub(super) fn written(&mut self, given: Given) -> Written {
        self.written_at(given, 0)
    }

    fn written_at(&mut self, given: Given, depth: usize) -> Written {
        let tree = Tree::parse(given.text.clone());
        let Some(value) = tree.value() else { return Written::Broken };
        if let Some(text) = value.as_str().map(|s| s.into_value().into_owned()) {
            if let Some(name) = whole_variable(&text) {
                return self.variable(&given, name, depth);
            }
            if let Some(reference) = text.strip_prefix('@') {
                return Written::Reference(Given { text: reference.to_owned(), ..given });
            }
        }
        if value.kind() == NodeKind::List && value.elements().any(is_reference) {
            return self.list(&given, value, depth);
        }
        match self.expand(&given, value, depth) {
            Some(given) => Written::Literal(given),
            None => Written::Broken,
        }
    }

    /// `"$name"` alone: all that the variable stands for, a reference as well as a literal.
    fn variable(&mut self, given: &Given, name: &str, depth: usize) -> Written {
        match self.lookup(given, name, depth) {
            Some(value) => {
                // The message points at where the variable is used; what it is held against stays where its value is written.
                let text_at = if value.at.file == given.at.file { given.at } else { value.at };
                self.written_at(Given { at: text_at, ..value }, depth + 1)
            }
            None => Written::Broken,
        }
    }

    fn lookup(&mut self, given: &Given, name: &str, depth: usize) -> Option<Given> {
        if depth > MAX_DEPTH {
            self.error(code::CYCLE, given.at, format!("expected a variable with an end, found `${name}` that stands for itself"));
            return None;
        }
        if name == "out" {
            let out = std::path::absolute(&self.options.out).unwrap_or_else(|_| self.options.out.clone());
            let text = ron::to_string(&out.to_string_lossy()).ok()?;
            return Some(Given { text, ..given.clone() });
        }
        if let Some(param) = self.scopes[given.scope].params.get_mut(name) {
            param.read = true;
            let (value, at) = (param.value.clone(), param.at);
            if value.is_none() && self.scopes[given.scope].prefix.is_empty() {
                let found = Diagnostic::error(
                    code::MISSING_INPUT,
                    format!("expected a value for parameter `{name}`, found none"),
                    given.at.label(),
                );
                self.push(found.with_label(at.note("declared without a default")).help(format!("give it: --var {name}=VALUE")));
            }
            return value;
        }
        let known: Vec<String> = self.scopes[given.scope].params.keys().cloned().chain(["out".to_owned()]).collect();
        let message = format!("expected a parameter of the graph, found `${name}`");
        let found = Diagnostic::error(code::UNDEFINED_VARIABLE, message, given.at.label());
        self.push(
            found
                .did_you_mean(name, known.iter().map(String::as_str))
                .help("parameters are declared under `params`; a plain dollar sign is `$$`"),
        );
        None
    }

    fn list(&mut self, given: &Given, value: NodeRef<'_>, depth: usize) -> Written {
        let mut out = Vec::new();
        for element in value.elements() {
            let at = inner(given, element);
            match self.written_at(Given { text: element.text().to_owned(), at, ..given.clone() }, depth) {
                Written::Reference(r) => out.push(r),
                Written::References(r) => out.extend(r),
                Written::Literal(_) => {
                    self.error(code::FORM, at, format!("expected a list of references, found {} among them", element.describe()));
                    return Written::Broken;
                }
                Written::Broken => return Written::Broken,
            }
        }
        Written::References(out)
    }

    /// Replaces `$name` inside the strings of a literal.
    fn expand(&mut self, given: &Given, value: NodeRef<'_>, depth: usize) -> Option<Given> {
        if !given.text.contains('$') {
            return Some(given.clone());
        }
        let mut out = given.clone();
        out.text.clear();
        let mut from = 0;
        let strings = value.descendants().chain(std::iter::once(value)).filter(|n| n.kind() == NodeKind::String);
        let mut strings: Vec<NodeRef<'_>> = strings.collect();
        strings.sort_by_key(|n| n.span().start);
        strings.dedup_by_key(|n| n.span().start);
        for string in strings {
            let span = string.span();
            let text = string.as_str()?.into_value().into_owned();
            out.text.push_str(&given.text[from..span.start]);
            let whole = whole_variable(&text).map(|name| self.lookup(given, name, depth));
            match whole {
                Some(value) => {
                    let value = value?;
                    out.text.push_str(&value.text);
                }
                None => {
                    let (text, base) = self.interpolate(given, &text, depth)?;
                    if let Some(base) = base {
                        out.base = base;
                    }
                    out.text.push_str(&ron::to_string(&text).ok()?);
                }
            }
            from = span.end;
        }
        out.text.push_str(&given.text[from..]);
        Some(out)
    }

    /// `text` with each `$name` in it replaced by that variable's text, and where a path that starts with a variable is held against.
    fn interpolate(&mut self, given: &Given, text: &str, depth: usize) -> Option<(String, Option<std::path::PathBuf>)> {
        let mut out = String::new();
        let mut base = None;
        let mut rest = text;
        while let Some(dollar) = rest.find('$') {
            out.push_str(&rest[..dollar]);
            let after = &rest[dollar + 1..];
            let n = after.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
            if after.starts_with('$') {
                out.push('$');
                rest = &after[1..];
                continue;
            }
            if n == 0 {
                self.error(code::UNDEFINED_VARIABLE, given.at, "expected a name after `$`, found none")
                    .help
                    .push("a plain dollar sign is `$$`".to_owned());
                return None;
            }
            let value = self.lookup(given, &after[..n], depth)?;
            if out.is_empty() {
                base = Some(value.base.clone());
            }
            out.push_str(&self.plain_text(&value, depth + 1)?);
            rest = &after[n..];
        }
        out.push_str(rest);
        Some((out, base))
    }

    /// What a variable reads like inside a text.
    fn plain_text(&mut self, value: &Given, depth: usize) -> Option<String> {
        let tree = Tree::parse(value.text.clone());
        match tree.value()?.as_str() {
            Some(text) => self.interpolate(value, text.value(), depth).map(|(text, _)| text),
            None => Some(value.text.trim().to_owned()),
        }
    }

    /// The node and output that a reference means.
    pub(super) fn port(&mut self, reference: &Given) -> Option<Port> {
        self.port_at(reference, 0)
    }

    fn port_at(&mut self, reference: &Given, depth: usize) -> Option<Port> {
        let (name, output) = match reference.text.split_once('.') {
            Some((n, o)) => (n, Some(o)),
            None => (reference.text.as_str(), None),
        };
        match self.scopes[reference.scope].entries.get(name).copied() {
            Some(Entry::Node(node)) => self.output_of(reference, node, output),
            Some(Entry::Graph(scope)) => self.graph_output(reference, scope, output, depth),
            Some(Entry::Broken) => None,
            None => {
                let known: Vec<String> = self.scopes[reference.scope].entries.keys().cloned().collect();
                let found =
                    Diagnostic::error(code::UNKNOWN_NODE, format!("expected a node of the graph, found `{name}`"), reference.at.label());
                self.push(found.did_you_mean(name, known.iter().map(String::as_str)));
                None
            }
        }
    }

    fn output_of(&mut self, reference: &Given, node: usize, output: Option<&str>) -> Option<Port> {
        let schema = self.nodes[node].ty.as_ref()?.schema.clone();
        let at = self.nodes[node].at;
        if schema.outputs.is_empty() {
            let message = format!("expected a node with outputs, found `{}`, a {} node", self.nodes[node].name, schema.id);
            self.push(Diagnostic::error(code::UNKNOWN_OUTPUT, message, reference.at.label()).with_label(at.note("it has none")));
            return None;
        }
        let Some(output) = output else { return Some(Port { node, output: 0 }) };
        if let Some((output, _)) = schema.output(output) {
            return Some(Port { node, output });
        }
        let known: Vec<&str> = schema.outputs.iter().map(|o| o.name).collect();
        let message = format!("expected an output of {}, found `{output}`", schema.id);
        let found = Diagnostic::error(code::UNKNOWN_OUTPUT, message, reference.at.label()).did_you_mean(output, known.iter().copied());
        self.push(found.help(format!("its outputs are {}", known.join(", "))));
        None
    }

    fn graph_output(&mut self, reference: &Given, scope: usize, output: Option<&str>, depth: usize) -> Option<Port> {
        let outputs = &self.scopes[scope].outputs;
        let found = outputs.iter().find(|o| output.is_none_or(|name| o.name == name));
        let Some(found) = found else {
            let known: Vec<String> = outputs.iter().map(|o| o.name.clone()).collect();
            let name = output.unwrap_or_default();
            let message = format!("expected an output of the graph, found `{name}`");
            let error =
                Diagnostic::error(code::UNKNOWN_OUTPUT, message, reference.at.label()).did_you_mean(name, known.iter().map(String::as_str));
            self.push(error.help(format!("its outputs are {}", known.join(", "))));
            return None;
        };
        let given = Given { scope, text: found.text.clone(), at: found.at, base: std::path::PathBuf::new() };
        if depth > MAX_DEPTH {
            self.error(code::CYCLE, reference.at, "expected a reference with an end, found one that leads to itself");
            return None;
        }
        match self.written_at(given.clone(), depth + 1) {
            Written::Reference(inner) => self.port_at(&inner, depth + 1),
            Written::Broken => None,
            _ => {
                self.error(code::FORM, given.at, "expected a reference as \"@node.port\", found a literal");
                None
            }
        }
    }
}

/// The name in a text that is one variable and nothing else.
fn whole_variable(text: &str) -> Option<&str> {
    let name = text.strip_prefix('$')?;
    let is_name = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    is_name.then_some(name)
}

fn is_reference(node: NodeRef<'_>) -> bool {
    node.as_str().is_some_and(|s| s.value().starts_with('@'))
}

/// The place of a part of what is given; the whole where variables were replaced in it.
fn inner(given: &Given, node: NodeRef<'_>) -> At {
    if given.at.span.len() == given.text.len() {
        At { file: given.at.file, span: node.span().shifted(given.at.span.start) }
    } else {
        given.at
    }
}
