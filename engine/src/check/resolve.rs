//! Variables and references: from what is written at an input to the literal or the node that it means.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::diag::Span;
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

/// Deeper than any sane chain of variables, or of graphs that hand a reference on.
const MAX_DEPTH: usize = 64;
/// Variables replaced for one input, and bytes of the text that comes of it.
const MAX_LOOKUPS: usize = 4096;
const MAX_TEXT: usize = 1 << 20;

impl Checker<'_> {
    /// Replaces the variables of what is written at an input, and tells literals from references.
    pub(super) fn written(&mut self, given: Given) -> Written {
        self.lookups = 0;
        self.expanding.clear();
        self.written_part(given)
    }

    fn written_part(&mut self, given: Given) -> Written {
        let tree = Tree::parse(given.text.clone());
        let Some(value) = tree.value() else { return Written::Broken };
        if let Some(text) = value.as_str().map(|s| s.into_value().into_owned()) {
            if let Some(name) = whole_variable(&text) {
                let at = given.at;
                let value = self.within(&given, name, |checker, value| {
                    // The message points at where the value is written, and notes where it is used.
                    Some(checker.written_part(Given { at: value.at.used_at(at), ..value }))
                });
                return value.unwrap_or(Written::Broken);
            }
            if let Some(reference) = text.strip_prefix('@') {
                return self.reference(given, reference);
            }
        }
        if value.kind() == NodeKind::List && value.elements().any(|e| self.leads_to_reference(given.scope, e.text(), &mut BTreeSet::new()))
        {
            return self.list(&given, value);
        }
        match self.expand(&given, value) {
            Some(given) => Written::Literal(given),
            None => Written::Broken,
        }
    }

    fn reference(&mut self, given: Given, reference: &str) -> Written {
        let (node, output) = reference.split_once('.').unwrap_or((reference, "first"));
        if node.is_empty() || output.is_empty() {
            self.error(code::FORM, given.at, format!("expected a reference as \"@node.port\", found \"@{reference}\""));
            return Written::Broken;
        }
        Written::Reference(Given { text: reference.to_owned(), ..given })
    }

    /// Does something with the value of a variable; nothing where it has none or stands for itself.
    fn within<R>(&mut self, given: &Given, name: &str, work: impl FnOnce(&mut Self, Given) -> Option<R>) -> Option<R> {
        let key = (given.scope, name.to_owned());
        self.lookups += 1;
        if self.expanding.contains(&key) || self.expanding.len() >= MAX_DEPTH || self.lookups > MAX_LOOKUPS {
            let message = match self.expanding.contains(&key) {
                true => format!("expected a value for `${name}`, found one that leads back to itself"),
                false => format!("expected at most {MAX_LOOKUPS} variables, {MAX_DEPTH} within each other, found more at `${name}`"),
            };
            // Said once: whatever else the same input holds is not looked at.
            if self.lookups <= MAX_LOOKUPS + 1 {
                self.error(code::CYCLE, given.at, message);
            }
            self.lookups = MAX_LOOKUPS + 1;
            return None;
        }
        let value = self.lookup(given, name)?;
        self.expanding.push(key);
        let out = work(self, value);
        self.expanding.pop();
        out
    }

    fn lookup(&mut self, given: &Given, name: &str) -> Option<Given> {
        if name == "out" {
            let folder = if self.options.out.as_os_str().is_empty() { Path::new(".") } else { &self.options.out };
            let out = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
            let text = ron::to_string(&out.to_string_lossy()).ok()?;
            return Some(Given { text, ..given.clone() });
        }
        if let Some(param) = self.scopes[given.scope].params.get(name) {
            if param.broken {
                return None;
            }
            if param.value.is_none() && self.scopes[given.scope].prefix.is_empty() {
                let message = format!("expected a value for parameter `{name}`, found none");
                let found = param.at.error(code::MISSING_INPUT, message).help(format!("give it a default, or --var {name}=VALUE"));
                self.push(found);
                return None;
            }
            return param.value.clone();
        }
        if let Some(value) = self.context.get(name) {
            return Some(Given { scope: 0, ..value.clone() });
        }
        self.undefined.insert(name.to_owned());
        let own = self.scopes[given.scope].params.keys().chain(self.context.keys()).cloned();
        let known: Vec<String> = own.chain(["out".to_owned()]).collect();
        let found =
            self.variable_at(given, name).error(code::UNDEFINED_VARIABLE, format!("expected a parameter of the graph, found `${name}`"));
        let of_shot = ["shot", "sequence", "show"].iter().any(|word| name.strip_suffix("_dir").unwrap_or(name) == *word);
        let help = match of_shot {
            true => "the names of a shot's folders are known where a shot is named: `--shot DIR`",
            false => "parameters are declared under `params`; a plain dollar sign is `$$`",
        };
        self.push(found.did_you_mean(name, known.iter().map(String::as_str)).help(help));
        None
    }

    /// True where an element of a list is a reference, or a variable that stands for one or for a list of them.
    fn leads_to_reference(&self, scope: usize, text: &str, seen: &mut BTreeSet<(usize, String)>) -> bool {
        let tree = Tree::parse(text.to_owned());
        let Some(value) = tree.value() else { return false };
        if value.kind() == NodeKind::List {
            return value.elements().any(|e| self.leads_to_reference(scope, e.text(), seen));
        }
        let Some(text) = value.as_str().map(|s| s.into_value().into_owned()) else { return false };
        let Some(name) = whole_variable(&text) else { return text.starts_with('@') };
        let value = self.scopes[scope].params.get(name).and_then(|p| p.value.as_ref());
        let is_new = seen.len() < MAX_DEPTH && seen.insert((scope, name.to_owned()));
        value.is_some_and(|v| is_new && self.leads_to_reference(v.scope, &v.text, seen))
    }

    fn list(&mut self, given: &Given, value: NodeRef<'_>) -> Written {
        let mut out = Vec::new();
        for element in value.elements() {
            let at = self.inner(given, element);
            match self.written_part(Given { text: element.text().to_owned(), at, ..given.clone() }) {
                Written::Reference(r) => out.push(r),
                Written::References(r) => out.extend(r),
                Written::Literal(_) => {
                    self.error(code::FORM, at, format!("expected a list of references, found {} among them", element.text()));
                    return Written::Broken;
                }
                Written::Broken => return Written::Broken,
            }
        }
        Written::References(out)
    }

    /// Replaces `$name` inside the strings of a literal.
    fn expand(&mut self, given: &Given, value: NodeRef<'_>) -> Option<Given> {
        if !given.text.contains('$') {
            return Some(given.clone());
        }
        let mut out = given.clone();
        out.text.clear();
        let mut from = 0;
        // Nodes come in the order in which they stand.
        for string in value.descendants().filter(|n| n.kind() == NodeKind::String) {
            let span = string.span();
            let text = string.as_str()?.into_value().into_owned();
            out.text.push_str(&given.text[from..span.start]);
            let at = self.inner(given, string);
            let here = Given { at, text: string.text().to_owned(), ..given.clone() };
            match whole_variable(&text) {
                Some(name) => out.text.push_str(&self.whole(&here, name)?),
                None => {
                    let (text, base) = self.interpolate(&here, &text)?;
                    out.base = base.unwrap_or(out.base);
                    out.text.push_str(&ron::to_string(&text).ok()?);
                }
            }
            self.bounded(given, &out.text)?;
            from = span.end;
        }
        out.text.push_str(&given.text[from..]);
        Some(out)
    }

    /// What a variable that is a whole part of a literal stands for.
    fn whole(&mut self, given: &Given, name: &str) -> Option<String> {
        let at = given.at;
        self.within(given, name, |checker, value| match checker.written_part(Given { at: value.at.used_at(at), ..value }) {
            Written::Literal(value) => Some(value.text),
            Written::Broken => None,
            Written::Reference(_) | Written::References(_) => {
                checker.error(code::FORM, at, format!("expected a literal inside a literal, found `${name}`, a reference"));
                None
            }
        })
    }

    fn bounded(&mut self, given: &Given, text: &str) -> Option<()> {
        if text.len() <= MAX_TEXT {
            return Some(());
        }
        self.error(
            code::CYCLE,
            given.at,
            format!("expected a text of at most {MAX_TEXT} bytes, found more, as its variables are replaced"),
        );
        None
    }

    /// `text` with each `$name` in it replaced by that variable's text, and what a path that starts with a variable is held against.
    fn interpolate(&mut self, given: &Given, text: &str) -> Option<(String, Option<PathBuf>)> {
        let mut out = String::new();
        let mut base = None;
        let mut rest = text;
        while let Some(dollar) = rest.find('$') {
            out.push_str(&rest[..dollar]);
            let after = &rest[dollar + 1..];
            let n = after.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
            if let Some(after) = after.strip_prefix('$') {
                out.push('$');
                rest = after;
                continue;
            }
            if n == 0 {
                self.error(code::UNDEFINED_VARIABLE, given.at, "expected a name after `$`, found none")
                    .help
                    .push("a plain dollar sign is `$$`".to_owned());
                return None;
            }
            let (value, from) = self.within(given, &after[..n], |checker, value| checker.plain_text(&value))?;
            if dollar == 0 && rest.len() == text.len() {
                base = Some(from);
            }
            out.push_str(&value);
            self.bounded(given, &out)?;
            rest = &after[n..];
        }
        out.push_str(rest);
        Some((out, base))
    }

    /// What a variable reads like inside a text, and what it is held against as a path.
    fn plain_text(&mut self, value: &Given) -> Option<(String, PathBuf)> {
        let tree = Tree::parse(value.text.clone());
        match tree.value()?.as_str() {
            Some(text) => {
                let (text, base) = self.interpolate(value, text.value())?;
                Some((text, base.unwrap_or_else(|| value.base.clone())))
            }
            None => Some((value.text.trim().to_owned(), value.base.clone())),
        }
    }

    /// The place of `$name` in what is given; the whole where that cannot be told.
    fn variable_at(&self, given: &Given, name: &str) -> At {
        let variable = format!("${name}");
        match given.text.find(&variable) {
            Some(start) if self.is_verbatim(given.at, &given.text) => {
                At { span: Span::new(start, start + variable.len()).shifted(given.at.span.start), ..given.at }
            }
            _ => given.at,
        }
    }

    /// The place of a part of what is given; the whole where variables were replaced in it.
    fn inner(&self, given: &Given, node: NodeRef<'_>) -> At {
        if self.is_verbatim(given.at, &given.text) { At { span: node.span().shifted(given.at.span.start), ..given.at } } else { given.at }
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
                let found = reference.at.error(code::UNKNOWN_NODE, format!("expected a node of the graph, found `{name}`"));
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
            self.push(reference.at.error(code::UNKNOWN_OUTPUT, message).with_label(at.note("it has none")));
            return None;
        }
        let Some(output) = output else { return Some(Port { node, output: 0 }) };
        if let Some((output, _)) = schema.output(output) {
            return Some(Port { node, output });
        }
        let known: Vec<&str> = schema.outputs.iter().map(|o| o.name).collect();
        let message = format!("expected an output of {}, found `{output}`", schema.id);
        let found = reference.at.error(code::UNKNOWN_OUTPUT, message).did_you_mean(output, known.iter().copied());
        self.push(found.help(format!("its outputs are {}", known.join(", "))));
        None
    }

    fn graph_output(&mut self, reference: &Given, scope: usize, output: Option<&str>, depth: usize) -> Option<Port> {
        let outputs = &self.scopes[scope].outputs;
        let Some(found) = outputs.iter().find(|o| output.is_none_or(|name| o.name == name)) else {
            self.no_graph_output(reference, scope, output);
            return None;
        };
        let given = Given { scope, text: found.text.clone(), at: found.at, base: PathBuf::new() };
        if depth > MAX_DEPTH {
            self.error(code::CYCLE, reference.at, "expected a reference to a node, found one that leads back to itself");
            return None;
        }
        match self.written(given.clone()) {
            Written::Reference(inner) => self.port_at(&inner, depth + 1),
            Written::Broken => None,
            _ => {
                self.error(code::FORM, given.at, format!("expected a reference as \"@node.port\", found {}", given.text));
                None
            }
        }
    }

    fn no_graph_output(&mut self, reference: &Given, scope: usize, output: Option<&str>) {
        let known: Vec<String> = self.scopes[scope].outputs.iter().map(|o| o.name.clone()).collect();
        let name = self.scopes[scope].prefix.trim_end_matches('/').to_owned();
        if known.is_empty() {
            let found = reference.at.error(code::UNKNOWN_OUTPUT, format!("expected a graph with outputs, found `{name}`, which has none"));
            self.push(found.help("a graph declares them: `outputs: { \"image\": \"@node\" }`"));
            return;
        }
        let output = output.unwrap_or_default();
        let found = reference.at.error(code::UNKNOWN_OUTPUT, format!("expected an output of the graph `{name}`, found `{output}`"));
        self.push(found.did_you_mean(output, known.iter().map(String::as_str)).help(format!("its outputs are {}", known.join(", "))));
    }
}

/// The name in a text that is one variable and nothing else.
fn whole_variable(text: &str) -> Option<&str> {
    let name = text.strip_prefix('$')?;
    let is_name = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    is_name.then_some(name)
}
