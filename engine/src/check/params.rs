//! Parameters of a graph: their declarations, what is given for them from outside, and which nobody reads.

use std::collections::{BTreeMap, BTreeSet};

use crate::diag::{Diagnostic, FileId, Severity, Span};
use crate::setting::Setting;
use crate::syntax::{Extensions, FieldRef, NodeKind, NodeRef, parse_slice};

use super::document::Given;
use super::layers::Layer;
use super::{At, Checker, code};

/// A parameter of a scope, with its value.
#[derive(Clone)]
pub(super) struct Param {
    pub(super) value: Option<Given>,
    pub(super) at: At,
    /// Type as declared; empty where it is not.
    pub(super) ty: String,
    /// True where its default is wrong, which was said.
    pub(super) broken: bool,
}

/// Types of parameters beside the value types.
const PLAIN: [&str; 6] = ["path", "text", "number", "whole", "bool", "any"];

impl Checker<'_> {
    /// Gives the parameters of the main graph what layers and the command line say of them.
    pub(super) fn set_variables(&mut self, scope: usize) {
        let mut set = Vec::new();
        for layer in &mut self.layers {
            for said in layer.params.iter_mut().filter(|s| self.scopes[scope].params.contains_key(&s.name)) {
                said.used = true;
                set.push((layer.layer, said.name.clone(), Given { scope, ..said.given.clone() }));
            }
        }
        for (name, value) in self.options.variables.clone() {
            let Some(ty) = self.scopes[scope].params.get(&name).map(|p| p.ty.clone()) else { continue };
            let given = self.outside_value(("--var", &name), &format!("${name}"), &value, matches!(ty.as_str(), "path" | "text"));
            self.used.insert(name.clone());
            set.push((Layer::CommandLine, name, Given { scope, ..given }));
        }
        for (layer, name, given) in set {
            self.note(format!("${name}"), layer, &given);
            if let Some(param) = self.scopes[scope].params.get_mut(&name) {
                param.value = Some(given);
                param.broken = false;
            }
        }
    }

    /// Something that was given from outside, where it is written, so that messages can point at it: a source of its own for the command line.
    /// What is no RON is a text.
    pub(super) fn outside_value(&mut self, (flag, name): (&str, &str), key: &str, value: &str, is_text: bool) -> Given {
        let is_literal = if is_text { String::parse(value).is_ok() } else { parse_slice::<ron::Value>(value, Extensions::empty()).is_ok() };
        let value = if is_literal { value.to_owned() } else { ron::to_string(value).unwrap_or_default() };
        let at = self.written_at(key).map(|(file, _, value)| At::new(file, value)).unwrap_or_else(|| {
            let before = format!("{flag} {name}=");
            let file = self.sources.add("command line", format!("{before}{value}"));
            At::new(file, Span::new(before.len(), before.len() + value.len()))
        });
        Given { scope: 0, text: value, at, base: self.options.base.clone() }
    }

    /// Where a value that is set from outside is written, where that is a file: its name and itself.
    fn written_at(&mut self, key: &str) -> Option<(FileId, Span, Span)> {
        let place = self.options.places.get(key)?;
        let known = self.sources.files().find(|f| self.sources.name(*f) == place.file && !self.sources.text(*f).is_empty());
        let file = known.unwrap_or_else(|| self.sources.add(place.file.clone(), place.text.clone()));
        Some((file, place.name, place.value))
    }

    pub(super) fn read_params(&mut self, scope: usize, field: FieldRef<'_>) {
        let file = self.scopes[scope].file;
        for (name, value, span) in self.map(file, field) {
            if value.kind() != NodeKind::Struct {
                let at = At::new(file, value.span());
                self.error(code::FORM, at, format!("expected (type: \"path\", default: ..., doc: \"...\"), found {}", value.describe()));
                continue;
            }
            let fields = self.fields(file, value, &["type", "default", "doc"], "a parameter");
            self.text_field(file, &fields, "doc");
            let base = self.scopes[scope].base.clone();
            let default = fields.get("default").and_then(|f| f.value());
            let given = default.map(|d| Given { scope, text: d.text().to_owned(), at: At::new(file, d.span()), base });
            // A misspelt `default` was said; that there is none follows from it.
            let misspelt = given.is_none() && value.fields().any(|f| resembles(f.name(), "default"));
            let (ty, fine) = self.param_type(file, &fields, default);
            if let Some(given) = &given {
                self.note(format!("{}${name}", self.scopes[scope].prefix), Layer::Graph, given);
            }
            let param = Param { value: given, at: At::new(file, span), ty, broken: misspelt || !fine };
            self.scopes[scope].params.insert(name, param);
        }
    }

    /// The type of a parameter; false where its default is not of it.
    fn param_type(&mut self, file: FileId, fields: &BTreeMap<&str, FieldRef<'_>>, default: Option<NodeRef<'_>>) -> (String, bool) {
        let Some(ty) = fields.get("type").and_then(|f| f.value()) else { return (String::new(), true) };
        let name = ty.as_str().map(|s| s.into_value().into_owned()).unwrap_or_else(|| ty.text().to_owned());
        let at = At::new(file, ty.span());
        if !PLAIN.contains(&name.as_str()) && self.registry.get_type(&name).is_none() {
            let message = format!("expected the type of a parameter, found `{name}`");
            let known = PLAIN.into_iter().chain(self.registry.types().map(|t| t.schema.name));
            let found = at.error(code::UNKNOWN_VALUE_TYPE, message).did_you_mean(&name, known);
            self.push(found.help("parameters are path, text, number, whole, bool, any, or a value type: `pegbar types`"));
            return (String::new(), true);
        }
        let Some(default) = default.filter(|d| !d.text().contains('$')) else { return (name, true) };
        let text = default.text();
        let (fine, expected) = match name.as_str() {
            "path" => (default.as_str().is_some(), "a path in quotes"),
            "text" => (default.as_str().is_some(), "a text in quotes"),
            "number" => (f64::parse(text).is_ok(), "a number"),
            "whole" => (i64::parse(text).is_ok(), "a whole number"),
            "bool" => (bool::parse(text).is_ok(), "true or false"),
            _ => (true, ""),
        };
        // A parameter that may be left out says so.
        let fine = fine || text == "None";
        if !fine {
            self.error(code::BAD_LITERAL, At::new(file, default.span()), format!("expected {expected}, found {text}"));
        }
        (name, fine)
    }

    pub(super) fn unused_params(&mut self) {
        let mut unused = BTreeMap::new();
        for scope in &self.scopes {
            let read = variables(self.sources.text(scope.file));
            for (name, param) in scope.params.iter().filter(|(name, _)| !read.contains(name.as_str())) {
                unused.insert((param.at.file, param.at.span), (name.clone(), param.at));
            }
        }
        // A misspelt variable was said, with what was meant.
        unused.retain(|_, (name, _)| !self.undefined.iter().any(|word| resembles(word, name)));
        for (name, at) in unused.into_values() {
            let message = format!("parameter `{name}` is never read");
            let found = Diagnostic::warning(code::UNUSED_PARAMETER, message, crate::diag::Label::new(at.file, at.span));
            self.push(found.help(format!("write \"${name}\" where it is meant, or take it away")));
        }
    }

    pub(super) fn unused_overrides(&mut self) {
        let variables = self.options.variables.iter().filter(|(k, _)| !self.used.contains(k));
        let names: Vec<String> = variables.map(|(k, _)| k.clone()).collect();
        let params: Vec<String> = self.scopes.first().iter().flat_map(|s| s.params.keys().cloned()).collect();
        for name in names {
            let help = "--var NAME=VALUE sets a parameter";
            self.unknown_override("expected a parameter of the graph", (&name, &format!("${name}")), &params, help);
        }
        let overrides = self.options.overrides.iter().filter(|(k, _)| !self.used.contains(k));
        let names: Vec<String> = overrides.map(|(k, _)| k.clone()).collect();
        let inputs = |n: &super::document::NodeSource| {
            let inputs = n.ty.iter().flat_map(|t| t.schema.inputs.iter().map(|i| i.name));
            inputs.map(|i| format!("{}.{i}", n.name)).collect::<Vec<_>>()
        };
        let known: Vec<String> = if names.is_empty() { Vec::new() } else { self.nodes.iter().flat_map(inputs).collect() };
        for name in names {
            let help = "--set node.input=VALUE sets an input";
            self.unknown_override("expected an input as node.input", (&name, &name), &known, help);
        }
    }

    fn unknown_override(&mut self, expected: &str, (name, key): (&str, &str), known: &[String], help: &str) {
        let message = format!("{expected}, found `{name}`");
        let known = known.iter().map(String::as_str);
        let found = match self.written_at(key) {
            Some((file, at, _)) => At::new(file, at).error(code::UNKNOWN_OVERRIDE, message).did_you_mean(name, known),
            None => Diagnostic::new(Severity::Error, code::UNKNOWN_OVERRIDE, message).did_you_mean(name, known).help(help),
        };
        self.push(found);
    }
}

/// True where `word` is so near to `meant` that it was most likely meant.
pub(super) fn resembles(word: &str, meant: &str) -> bool {
    word != meant && crate::diag::did_you_mean(word, [meant]).is_some()
}

/// Every `$name` of a file, wherever it stands.
fn variables(text: &str) -> BTreeSet<&str> {
    let name = |part| {
        let part: &str = part;
        &part[..part.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count()]
    };
    text.split('$').skip(1).map(name).collect()
}
