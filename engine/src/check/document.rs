//! Graph files into scopes: what is written where, before anything is looked up.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::clock::Clock;
use crate::diag::{Diagnostic, FileId, Span};
use crate::registry::NodeType;
use crate::setting::Setting;
use crate::syntax::{EntryRef, FieldRef, NodeKind, NodeRef, Tree};

use super::{At, Checker, code};

/// One use of one graph file.
pub(super) struct Scope {
    pub(super) file: FileId,
    /// Name of the node that uses it, with a slash; empty for the main graph.
    pub(super) prefix: String,
    /// Folder of the file.
    pub(super) base: PathBuf,
    pub(super) params: BTreeMap<String, Param>,
    pub(super) entries: BTreeMap<String, Entry>,
    pub(super) outputs: Vec<Output>,
    /// Clocks by name; `frames` is the default one.
    pub(super) clocks: BTreeMap<String, Arc<Clock>>,
    /// The files that lead here, outermost first.
    pub(super) files: Vec<PathBuf>,
}

pub(super) struct Output {
    pub(super) name: String,
    pub(super) text: String,
    pub(super) at: At,
}

/// What a name of a scope stands for.
#[derive(Clone, Copy)]
pub(super) enum Entry {
    Node(usize),
    Graph(usize),
    /// Its type is not known; said already.
    Broken,
}

/// A parameter of a scope, with its value.
#[derive(Clone)]
pub(super) struct Param {
    pub(super) value: Option<Given>,
    pub(super) at: At,
    pub(super) read: bool,
}

/// Something that is written at an input or given for a parameter, in the scope whose names it means.
#[derive(Clone)]
pub(super) struct Given {
    pub(super) scope: usize,
    pub(super) text: String,
    pub(super) at: At,
    /// What relative paths in it are held against.
    pub(super) base: PathBuf,
}

/// A node as it is written.
pub(super) struct NodeSource {
    pub(super) name: String,
    pub(super) scope: usize,
    pub(super) ty: Option<NodeType>,
    pub(super) at: At,
    pub(super) given: BTreeMap<String, (Given, Span)>,
}

const FIELDS: [&str; 7] = ["pegbar", "doc", "frames", "clocks", "params", "nodes", "outputs"];
/// The format that this Pegbar reads.
const VERSION: i64 = 1;

impl Checker<'_> {
    pub(super) fn read_main(&mut self, path: &Path, text: String) -> Option<usize> {
        let file = self.sources.add(path.display().to_string(), text.clone());
        let scope = self.read_graph(path, file, text, String::new(), Vec::new(), BTreeMap::new())?;
        for (name, value) in self.options.variables.clone() {
            if self.scopes[scope].params.contains_key(&name) {
                let given = self.from_command_line(&format!("--var {name}="), &value, true);
                self.used.insert(name.clone());
                if let Some(param) = self.scopes[scope].params.get_mut(&name) {
                    param.value = Some(Given { scope, ..given });
                }
            }
        }
        Some(scope)
    }

    /// A source of its own for something that was given from outside, so that messages can point at it.
    fn from_command_line(&mut self, before: &str, value: &str, quote: bool) -> Given {
        let literal = quote && crate::syntax::parse_slice::<ron::Value>(value, crate::syntax::Extensions::empty()).is_err();
        let value = if literal { ron::to_string(value).unwrap_or_default() } else { value.to_owned() };
        let file = self.sources.add("command line", format!("{before}{value}"));
        let at = At { file, span: Span::new(before.len(), before.len() + value.len()) };
        Given { scope: 0, text: value, at, base: PathBuf::new() }
    }

    fn read_graph(
        &mut self,
        path: &Path,
        file: FileId,
        text: String,
        prefix: String,
        mut files: Vec<PathBuf>,
        clocks: BTreeMap<String, Arc<Clock>>,
    ) -> Option<usize> {
        files.push(path.canonicalize().unwrap_or_else(|_| path.to_owned()));
        let tree = Tree::parse(text);
        self.diagnostics.extend(tree.errors().iter().map(|e| e.to_diagnostic(file)));
        let root = tree.value()?;
        let whole = At { file, span: root.span() };
        if !matches!(root.kind(), NodeKind::Struct) || root.name().is_some_and(|n| n.name() != "Graph") {
            self.error(code::FORM, whole, format!("expected Graph(...), found {}", root.describe()));
            return None;
        }
        let base = path.parent().map(Path::to_owned).unwrap_or_default();
        let scope = self.scopes.len();
        self.scopes.push(Scope {
            file,
            prefix,
            base,
            params: BTreeMap::new(),
            entries: BTreeMap::new(),
            outputs: Vec::new(),
            clocks,
            files,
        });
        let fields = self.fields(file, root, &FIELDS, "a graph");
        match fields.get("pegbar") {
            Some(field) => self.version(file, *field),
            None => {
                let name = At { file, span: root.name().map_or(root.span(), |n| n.span()) };
                self.error(code::MISSING_FIELD, name, "expected `pegbar: 1`, the format version, found none");
            }
        }
        self.read_clocks(scope, fields.get("frames"), fields.get("clocks"));
        if let Some(params) = fields.get("params") {
            self.read_params(scope, *params);
        }
        if let Some(nodes) = fields.get("nodes") {
            self.read_nodes(scope, *nodes);
        }
        if let Some(outputs) = fields.get("outputs") {
            for (name, value, _) in self.map(file, *outputs) {
                self.scopes[scope].outputs.push(Output { name, text: value.text().to_owned(), at: At { file, span: value.span() } });
            }
        }
        Some(scope)
    }

    fn version(&mut self, file: FileId, field: FieldRef<'_>) {
        let Some(value) = field.value() else { return };
        let at = At { file, span: value.span() };
        match i64::parse(value.text()) {
            Ok(VERSION) => {}
            Ok(n) => {
                let help = if n > VERSION { "this graph was made for a newer Pegbar: update Pegbar" } else { "write `pegbar: 1`" };
                let found = self.error(code::FORMAT_VERSION, at, format!("expected format version {VERSION}, found {n}"));
                found.help.push(help.to_owned());
            }
            Err(_) => {
                self.error(code::FORM, at, format!("expected a whole number, found {}", value.describe()));
            }
        }
    }

    /// The fields of a record by name; says which are unknown or stand twice.
    fn fields<'t>(&mut self, file: FileId, record: NodeRef<'t>, known: &[&str], what: &str) -> BTreeMap<&'t str, FieldRef<'t>> {
        let mut out: BTreeMap<&'t str, FieldRef<'t>> = BTreeMap::new();
        for field in record.fields() {
            let at = At { file, span: field.name_span() };
            if !known.is_empty() && !known.contains(&field.name()) {
                let message = format!("expected a field of {what}, found `{}`", field.name());
                let found =
                    Diagnostic::error(code::UNKNOWN_FIELD, message, at.label()).help(format!("the fields are {}", known.join(", ")));
                self.push(found.did_you_mean(field.name(), known.iter().copied()));
            } else if let Some(first) = out.get(field.name()) {
                let first = At { file, span: first.name_span() };
                let twice = Diagnostic::error(code::DUPLICATE, format!("field `{}` stands twice", field.name()), at.label());
                self.push(twice.with_label(first.note("first here")));
            } else {
                out.insert(field.name(), field);
            }
        }
        out
    }

    /// The entries of a map with text keys; says which stand twice.
    fn map<'t>(&mut self, file: FileId, field: FieldRef<'t>) -> Vec<(String, NodeRef<'t>, Span)> {
        let Some(value) = field.value() else { return Vec::new() };
        if value.kind() != NodeKind::Map {
            let at = At { file, span: value.span() };
            self.error(code::FORM, at, format!("expected a map as {{ \"name\": ... }}, found {}", value.describe()));
            return Vec::new();
        }
        let mut out: Vec<(String, NodeRef<'t>, Span)> = Vec::new();
        for entry in value.entries() {
            if let Some((name, value, span)) = self.entry(file, entry) {
                match out.iter().find(|(n, _, _)| *n == name) {
                    Some((_, _, first)) => {
                        let first = At { file, span: *first };
                        let twice = Diagnostic::error(code::DUPLICATE, format!("`{name}` stands twice"), At { file, span }.label());
                        self.push(twice.with_label(first.note("first here")));
                    }
                    None => out.push((name, value, span)),
                }
            }
        }
        out
    }

    fn entry<'t>(&mut self, file: FileId, entry: EntryRef<'t>) -> Option<(String, NodeRef<'t>, Span)> {
        let key = entry.key()?;
        let at = At { file, span: key.span() };
        let Some(name) = key.as_str() else {
            self.error(code::FORM, at, format!("expected a name as \"name\", found {}", key.describe()));
            return None;
        };
        let name = name.into_value().into_owned();
        if name.is_empty() || name.contains(['.', '@', '$', '/']) {
            let found = self.error(code::BAD_NAME, at, format!("expected a name, found `{name}`"));
            found.help.push("a name has no `.`, `@`, `$` or `/` in it".to_owned());
            return None;
        }
        Some((name, entry.value()?, key.span()))
    }

    fn read_clocks(&mut self, scope: usize, frames: Option<&FieldRef<'_>>, clocks: Option<&FieldRef<'_>>) {
        let file = self.scopes[scope].file;
        let nested = !self.scopes[scope].prefix.is_empty();
        // A graph that is used as a node runs on the frames of the graph that uses it.
        if let Some(value) = frames.and_then(|f| f.value())
            && let Some(clock) = self.clock(file, "frames", value)
            && !(nested && self.scopes[scope].clocks.contains_key("frames"))
        {
            self.scopes[scope].clocks.insert("frames".to_owned(), Arc::new(clock));
        }
        for (name, value, _) in clocks.map(|f| self.map(file, *f)).unwrap_or_default() {
            if let Some(clock) = self.clock(file, &name, value) {
                self.scopes[scope].clocks.insert(name, Arc::new(clock));
            }
        }
    }

    fn clock(&mut self, file: FileId, name: &str, value: NodeRef<'_>) -> Option<Clock> {
        let at = At { file, span: value.span() };
        if value.kind() != NodeKind::Struct {
            self.error(code::FORM, at, format!("expected (first: 1, last: 48, fps: 24), found {}", value.describe()));
            return None;
        }
        let fields = self.fields(file, value, &["first", "last", "fps"], "a clock");
        let first = self.number(file, at, &fields, "first")?;
        let last = self.number(file, at, &fields, "last")?;
        let fps = match fields.get("fps").and_then(|f| f.value()) {
            None => (24, 1),
            Some(v) => self.fps(file, v)?,
        };
        if last < first || last - first >= 10_000_000 {
            let found = self.error(code::FRAMES, at, format!("expected 1 to 10000000 frames, found {first} to {last}"));
            found.help.push("the last frame is at least the first".to_owned());
            return None;
        }
        Some(Clock { name: name.to_owned(), first, last, fps })
    }

    fn number(&mut self, file: FileId, whole: At, fields: &BTreeMap<&str, FieldRef<'_>>, name: &str) -> Option<i64> {
        let Some(value) = fields.get(name).and_then(|f| f.value()) else {
            self.error(code::MISSING_FIELD, whole, format!("expected `{name}`, found none"));
            return None;
        };
        // A hundred million frames is more than a month of film; sums of two such numbers never overflow.
        let number = i64::parse(value.text()).ok().filter(|n| n.abs() <= 100_000_000);
        if number.is_none() {
            let at = At { file, span: value.span() };
            self.error(code::FORM, at, format!("expected a whole number up to 100000000, found {}", value.text()));
        }
        number
    }

    fn fps(&mut self, file: FileId, value: NodeRef<'_>) -> Option<(u32, u32)> {
        let pair = <[u32; 2]>::parse(value.text()).map(|[a, b]| (a, b));
        let rate = u32::parse(value.text()).map(|n| (n, 1)).or(pair).ok().filter(|&(a, b)| a > 0 && b > 0);
        if rate.is_none() {
            let at = At { file, span: value.span() };
            let found = self.error(code::FORM, at, format!("expected frames a second as 24 or (24000, 1001), found {}", value.text()));
            found.help.push("rates that are not whole are written as a fraction, so that they are exact".to_owned());
        }
        rate
    }

    fn read_params(&mut self, scope: usize, field: FieldRef<'_>) {
        let file = self.scopes[scope].file;
        for (name, value, span) in self.map(file, field) {
            if value.kind() != NodeKind::Struct {
                let at = At { file, span: value.span() };
                self.error(code::FORM, at, format!("expected (type: \"path\", default: ..., doc: \"...\"), found {}", value.describe()));
                continue;
            }
            let fields = self.fields(file, value, &["type", "default", "doc"], "a parameter");
            let base = self.scopes[scope].base.clone();
            let default = fields.get("default").and_then(|f| f.value());
            let given = default.map(|d| Given { scope, text: d.text().to_owned(), at: At { file, span: d.span() }, base });
            self.param_type(file, &fields, default);
            self.scopes[scope].params.insert(name, Param { value: given, at: At { file, span }, read: false });
        }
    }

    /// Holds a parameter's default against its type.
    fn param_type(&mut self, file: FileId, fields: &BTreeMap<&str, FieldRef<'_>>, default: Option<NodeRef<'_>>) {
        const PLAIN: [&str; 6] = ["path", "text", "number", "whole", "bool", "any"];
        let Some(ty) = fields.get("type").and_then(|f| f.value()) else { return };
        let name = ty.as_str().map(|s| s.into_value().into_owned()).unwrap_or_else(|| ty.text().to_owned());
        let at = At { file, span: ty.span() };
        if !PLAIN.contains(&name.as_str()) && self.registry.get_type(&name).is_none() {
            let message = format!("expected the type of a parameter, found `{name}`");
            let known = PLAIN.into_iter().chain(self.registry.types().map(|t| t.schema.name));
            let found = Diagnostic::error(code::UNKNOWN_VALUE_TYPE, message, at.label()).did_you_mean(&name, known);
            self.push(found.help("parameters are path, text, number, whole, bool, any, or a value type: `pegbar types`"));
            return;
        }
        let Some(default) = default else { return };
        let text = default.text();
        let fine = match name.as_str() {
            "path" | "text" => default.as_str().is_some(),
            "number" => f64::parse(text).is_ok(),
            "whole" => i64::parse(text).is_ok(),
            "bool" => bool::parse(text).is_ok(),
            _ => true,
        };
        if !fine && !text.contains('$') {
            let at = At { file, span: default.span() };
            self.error(code::BAD_LITERAL, at, format!("expected {name}, found {}", default.describe()));
        }
    }

    fn read_nodes(&mut self, scope: usize, field: FieldRef<'_>) {
        let file = self.scopes[scope].file;
        for (name, value, span) in self.map(file, field) {
            let entry = self.read_node(scope, &name, value, span);
            self.scopes[scope].entries.insert(name, entry);
        }
    }

    fn read_node(&mut self, scope: usize, name: &str, value: NodeRef<'_>, span: Span) -> Entry {
        let file = self.scopes[scope].file;
        let at = At { file, span };
        if value.kind() != NodeKind::Struct {
            let whole = At { file, span: value.span() };
            self.error(code::FORM, whole, format!("expected a node as (type: \"...\", ...), found {}", value.describe()));
            return Entry::Broken;
        }
        let fields = self.fields(file, value, &[], "a node");
        let Some(ty) = fields.get("type").and_then(|f| f.value()) else {
            self.error(code::MISSING_FIELD, at, format!("expected `type` in node `{name}`, found none"));
            return Entry::Broken;
        };
        let type_at = At { file, span: ty.span() };
        let Some(id) = ty.as_str().map(|s| s.into_value().into_owned()) else {
            self.error(code::FORM, type_at, format!("expected a node type as \"comp.over\", found {}", ty.describe()));
            return Entry::Broken;
        };
        let base = self.scopes[scope].base.clone();
        let mut given = BTreeMap::new();
        for (key, field) in fields.iter().filter(|(k, _)| **k != "type") {
            if let Some(v) = field.value() {
                let at = At { file, span: v.span() };
                given.insert((*key).to_owned(), (Given { scope, text: v.text().to_owned(), at, base: base.clone() }, field.name_span()));
            }
        }
        let full = format!("{}{name}", self.scopes[scope].prefix);
        self.apply_overrides(scope, &full, &mut given);
        match id.strip_prefix("graph:") {
            Some(path) => self.use_graph(scope, &full, path, type_at, given),
            None => self.plain_node(scope, full, &id, type_at, at, given),
        }
    }

    fn apply_overrides(&mut self, scope: usize, node: &str, given: &mut BTreeMap<String, (Given, Span)>) {
        for (key, value) in self.options.overrides.clone() {
            let Some((target, input)) = key.rsplit_once('.') else { continue };
            if target == node {
                let text = self.from_command_line(&format!("--set {key}="), &value, true);
                let span = text.at.span;
                given.insert(input.to_owned(), (Given { scope, ..text }, span));
                self.used.insert(key);
            }
        }
    }

    fn plain_node(&mut self, scope: usize, name: String, id: &str, type_at: At, at: At, given: BTreeMap<String, (Given, Span)>) -> Entry {
        let ty = self.registry.get(id).cloned();
        if ty.is_none() {
            let known: Vec<&str> = self.registry.nodes().map(|n| n.schema.id).collect();
            let found = Diagnostic::error(code::UNKNOWN_TYPE, format!("expected a node type, found `{id}`"), type_at.label());
            self.push(found.did_you_mean(id, known).help("`pegbar nodes` lists the node types"));
            return Entry::Broken;
        }
        self.nodes.push(NodeSource { name, scope, ty, at, given });
        Entry::Node(self.nodes.len() - 1)
    }

    fn use_graph(&mut self, scope: usize, name: &str, path: &str, at: At, given: BTreeMap<String, (Given, Span)>) -> Entry {
        let path = self.scopes[scope].base.join(path);
        let resolved = path.canonicalize().unwrap_or_else(|_| path.clone());
        let files = self.scopes[scope].files.clone();
        if files.contains(&resolved) {
            self.error(code::GRAPH_RECURSION, at, format!("expected another graph, found one that uses itself: {}", path.display()));
            return Entry::Broken;
        }
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) => {
                self.error(code::MISSING_FILE, at, format!("expected a graph file at {}, found none: {error}", path.display()));
                return Entry::Broken;
            }
        };
        let file = self.sources.add(path.display().to_string(), text.clone());
        let clocks = self.scopes[scope].clocks.clone();
        let Some(inner) = self.read_graph(&path, file, text, format!("{name}/"), files, clocks) else { return Entry::Broken };
        for (input, (value, span)) in given {
            match self.scopes[inner].params.get_mut(&input) {
                Some(param) => param.value = Some(value),
                None => {
                    let known: Vec<String> = self.scopes[inner].params.keys().cloned().collect();
                    let message = format!("expected a parameter of {}, found `{input}`", path.display());
                    let found = Diagnostic::error(code::UNKNOWN_INPUT, message, At { file: at.file, span }.label());
                    self.push(found.did_you_mean(&input, known.iter().map(String::as_str)));
                }
            }
        }
        let missing: Vec<String> = self.scopes[inner].params.iter().filter(|(_, p)| p.value.is_none()).map(|(n, _)| n.clone()).collect();
        for param in missing {
            self.error(code::MISSING_INPUT, at, format!("expected parameter `{param}` of {}, found none", path.display()));
        }
        Entry::Graph(inner)
    }
}
