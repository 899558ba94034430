//! Graph files into scopes: what is written where, before anything is looked up.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::clock::Clock;
use crate::diag::{Diagnostic, FileId, Label, Span};
use crate::registry::NodeType;
use crate::setting::Setting;
use crate::syntax::{EntryRef, FieldRef, NodeKind, NodeRef, Tree};

use super::layers::Layer;
use super::params::{Param, resembles};
use super::resolve::Written;
use super::{At, Checker, canonical, code, version};

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

const FIELDS: [&str; 9] = ["pegbar", "doc", "version", "plugins", "frames", "clocks", "params", "nodes", "outputs"];
/// Graphs within each other.
const MAX_NESTED: usize = 64;
/// Graphs in all: more is a graph that uses itself in ever new ways.
const MAX_GRAPHS: usize = 4096;
/// The format that this Pegbar reads.
const VERSION: i64 = 1;

impl Checker<'_> {
    pub(super) fn read_main(&mut self, path: &Path, text: String) -> Option<usize> {
        let file = self.source(path, &text);
        self.read_graph(path, file, text, String::new(), Vec::new(), BTreeMap::new())
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
        self.torn.extend(tree.errors().iter().map(|e| At::new(file, e.span)));
        let root = tree.value()?;
        let whole = At::new(file, root.span());
        if !matches!(root.kind(), NodeKind::Struct) || root.name().is_some_and(|n| n.name() != "Graph") {
            let found = root.name().map_or(root.describe().to_owned(), |n| format!("{}(...)", n.name()));
            self.error(code::FORM, root.name().map_or(whole, |n| At::new(file, n.span())), format!("expected Graph(...), found {found}"));
            return None;
        }
        if !self.version(file, root) {
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
        self.text_field(file, &fields, "doc");
        self.text_field(file, &fields, "version");
        if let Some(plugins) = fields.get("plugins") {
            self.read_plugins(scope, *plugins);
        }
        if let Some(params) = fields.get("params") {
            self.read_params(scope, *params);
        }
        if self.scopes[scope].prefix.is_empty() {
            self.set_variables(scope);
        }
        // After the parameters, which may say what the frames are.
        self.read_clocks(scope, fields.get("frames"), fields.get("clocks"));
        if let Some(nodes) = fields.get("nodes") {
            self.read_nodes(scope, *nodes);
        }
        if let Some(outputs) = fields.get("outputs") {
            for (name, value, _) in self.map(file, *outputs) {
                self.scopes[scope].outputs.push(Output { name, text: value.text().to_owned(), at: At::new(file, value.span()) });
            }
        }
        Some(scope)
    }

    /// Says what is wrong with the format version; false where a file of that version cannot be read here.
    pub(super) fn version(&mut self, file: FileId, root: NodeRef<'_>) -> bool {
        let Some(field) = root.field("pegbar") else {
            let name = At::new(file, root.name().map_or(root.span(), |n| n.span()));
            self.error(code::MISSING_FIELD, name, "expected `pegbar: 1`, the format version, found none");
            return true;
        };
        let Some(value) = field.value() else { return true };
        let at = At::new(file, value.span());
        match i64::parse(value.text()) {
            Ok(VERSION) => true,
            Ok(n) => {
                let help = if n > VERSION { "this graph was made for a newer Pegbar: update Pegbar" } else { "write `pegbar: 1`" };
                let found = self.error(code::FORMAT_VERSION, at, format!("expected format version {VERSION}, found {n}"));
                found.help.push(help.to_owned());
                n <= VERSION
            }
            Err(_) => {
                self.error(code::FORM, at, format!("expected a whole number as `pegbar: 1`, found {}", value.text()));
                true
            }
        }
    }

    /// Says where a field that is read by people only is no text.
    pub(super) fn text_field(&mut self, file: FileId, fields: &BTreeMap<&str, FieldRef<'_>>, name: &str) {
        if let Some(value) = fields.get(name).and_then(|f| f.value())
            && value.as_str().is_none()
        {
            let message = format!("expected a text in quotes at `{name}`, found {}", value.describe());
            self.error(code::FORM, At::new(file, value.span()), message);
        }
    }

    /// The source of a graph file, under the name by which it is first used.
    pub(super) fn source(&mut self, path: &Path, text: &str) -> FileId {
        let key = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        if let Some(file) = self.files.get(&key) {
            return *file;
        }
        let file = self.sources.add(path.display().to_string(), text.to_owned());
        self.files.insert(key, file);
        file
    }

    /// The fields of a record by name; says which are unknown or stand twice.
    pub(super) fn fields<'t>(&mut self, file: FileId, record: NodeRef<'t>, known: &[&str], what: &str) -> BTreeMap<&'t str, FieldRef<'t>> {
        let mut out: BTreeMap<&'t str, FieldRef<'t>> = BTreeMap::new();
        for field in record.fields().filter(|f| !f.name().is_empty()) {
            let at = At::new(file, field.name_span());
            if !known.is_empty() && !known.contains(&field.name()) {
                let message = format!("expected a field of {what}, found `{}`", field.name());
                let found = at.error(code::UNKNOWN_FIELD, message).help(format!("the fields are {}", known.join(", ")));
                self.push(found.did_you_mean(field.name(), known.iter().copied()));
            } else if let Some(first) = out.get(field.name()) {
                let first = At::new(file, first.name_span());
                let twice = at.error(code::DUPLICATE, format!("field `{}` stands twice", field.name()));
                self.push(twice.with_label(first.note("first here")));
            } else {
                out.insert(field.name(), field);
            }
        }
        out
    }

    /// The entries of a map with text keys; says which stand twice.
    pub(super) fn map<'t>(&mut self, file: FileId, field: FieldRef<'t>) -> Vec<(String, NodeRef<'t>, Span)> {
        let Some(value) = field.value() else { return Vec::new() };
        if value.kind() != NodeKind::Map {
            let at = At::new(file, value.span());
            self.error(code::FORM, at, format!("expected a map as {{ \"name\": ... }}, found {}", value.describe()));
            return Vec::new();
        }
        let mut out: Vec<(String, NodeRef<'t>, Span)> = Vec::new();
        for entry in value.entries() {
            if let Some((name, value, span)) = self.entry(file, entry) {
                match out.iter().find(|(n, _, _)| *n == name) {
                    Some((_, _, first)) => {
                        let first = At::new(file, *first);
                        let twice = At::new(file, span).error(code::DUPLICATE, format!("`{name}` stands twice"));
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
        let at = At::new(file, key.span());
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
        if let Some(value) = frames.and_then(|f| f.value()) {
            let clock = self.declared_clock(scope, "frames", value);
            if !(nested && self.scopes[scope].clocks.contains_key("frames")) {
                self.scopes[scope].clocks.insert("frames".to_owned(), Arc::new(clock));
            }
        }
        for (name, value, _) in clocks.map(|f| self.map(file, *f)).unwrap_or_default() {
            let clock = self.declared_clock(scope, &name, value);
            self.scopes[scope].clocks.insert(name, Arc::new(clock));
        }
    }

    /// A clock that is declared; where it is wrong one that stands for it, of which nothing more is said.
    fn declared_clock(&mut self, scope: usize, name: &str, value: NodeRef<'_>) -> Clock {
        self.clock(scope, name, value).unwrap_or_else(|| {
            self.broken_clocks.insert(name.to_owned());
            Clock { name: name.to_owned(), first: 1, last: 1, fps: (24, 1) }
        })
    }

    fn clock(&mut self, scope: usize, name: &str, value: NodeRef<'_>) -> Option<Clock> {
        let file = self.scopes[scope].file;
        let at = At::new(file, value.span());
        if value.kind() != NodeKind::Struct {
            self.error(code::FORM, at, format!("expected (first: 1, last: 48, fps: 24), found {}", value.describe()));
            return None;
        }
        let fields = self.fields(file, value, &["first", "last", "fps"], "a clock");
        let (first, last) = (self.number(scope, at, &fields, "first"), self.number(scope, at, &fields, "last"));
        let fps = fields.get("fps").and_then(|f| f.value()).map_or(Some((24, 1)), |v| self.fps(file, v));
        let (first, last, fps) = (first?, last?, fps?);
        if last < first || last - first >= 10_000_000 {
            let message = format!("expected 1 to 10000000 frames, found first {first} and last {last}");
            self.error(code::FRAMES, at, message).help.push("the last frame is at least the first".to_owned());
            return None;
        }
        Some(Clock { name: name.to_owned(), first, last, fps })
    }

    fn number(&mut self, scope: usize, whole: At, fields: &BTreeMap<&str, FieldRef<'_>>, name: &str) -> Option<i64> {
        let Some(value) = fields.get(name).and_then(|f| f.value()) else {
            self.error(code::MISSING_FIELD, whole, format!("expected `{name}`, as in (first: 1, last: 48, fps: 24), found none"));
            return None;
        };
        let at = At::new(whole.file, value.span());
        let given = Given { scope, text: value.text().to_owned(), at, base: PathBuf::new() };
        let text = match self.written(given) {
            Written::Literal(given) => given.text,
            Written::Broken => return None,
            _ => value.text().to_owned(),
        };
        // A hundred million frames is more than a month of film; sums of two such numbers never overflow.
        let number = i64::parse(&text).ok().filter(|n| n.abs() <= 100_000_000);
        if number.is_none() {
            self.error(code::FORM, at, format!("expected a whole number up to 100000000, found {text}"));
        }
        number
    }

    fn fps(&mut self, file: FileId, value: NodeRef<'_>) -> Option<(u32, u32)> {
        let pair = <[u32; 2]>::parse(value.text()).map(|[a, b]| (a, b));
        let rate = u32::parse(value.text()).map(|n| (n, 1)).or(pair).ok().filter(|&(a, b)| a > 0 && b > 0);
        if rate.is_none() {
            let at = At::new(file, value.span());
            let found = self.error(code::FORM, at, format!("expected frames a second as 24 or (24000, 1001), found {}", value.text()));
            found.help.push("rates that are not whole are written as a fraction, so that they are exact".to_owned());
        }
        rate
    }

    fn read_nodes(&mut self, scope: usize, field: FieldRef<'_>) {
        let file = self.scopes[scope].file;
        for (name, value, span) in self.map(file, field) {
            let entry = self.read_node(scope, &name, value, span);
            self.scopes[scope].entries.insert(name, entry);
        }
        // What refers to a node whose name is refused is not refused as well.
        for key in field.value().into_iter().flat_map(NodeRef::entries).filter_map(EntryRef::key) {
            let name = key.as_str().map_or_else(|| key.text().to_owned(), |s| s.into_value().into_owned());
            let start = name.split('.').next().unwrap_or_default().to_owned();
            self.scopes[scope].entries.entry(start).or_insert(Entry::Broken);
        }
    }

    fn read_node(&mut self, scope: usize, name: &str, value: NodeRef<'_>, span: Span) -> Entry {
        let file = self.scopes[scope].file;
        let at = At::new(file, span);
        if value.kind() != NodeKind::Struct {
            let whole = At::new(file, value.span());
            self.error(code::FORM, whole, format!("expected a node as (type: \"...\", ...), found {}", value.describe()));
            return Entry::Broken;
        }
        let fields = self.fields(file, value, &[], "a node");
        let Some(ty) = fields.get("type").and_then(|f| f.value()) else {
            let near = value.fields().find(|f| resembles(f.name(), "type"));
            let found = at.error(code::MISSING_FIELD, format!("expected `type` in node `{name}`, found none"));
            self.push(match near {
                Some(field) => found.help(format!("write `type` instead of `{}`", field.name())),
                None => found.help("a node is written (type: \"comp.over\", ...)"),
            });
            return Entry::Broken;
        };
        let type_at = At::new(file, ty.span());
        let Some(id) = ty.as_str().map(|s| s.into_value().into_owned()) else {
            self.error(code::FORM, type_at, format!("expected a node type as \"comp.over\", found {}", ty.describe()));
            return Entry::Broken;
        };
        let base = self.scopes[scope].base.clone();
        let mut given = BTreeMap::new();
        for (key, field) in fields.iter().filter(|(k, _)| **k != "type") {
            if let Some(v) = field.value() {
                let at = At::new(file, v.span());
                given.insert((*key).to_owned(), (Given { scope, text: v.text().to_owned(), at, base: base.clone() }, field.name_span()));
            }
        }
        let full = format!("{}{name}", self.scopes[scope].prefix);
        for (input, (given, _)) in &given {
            self.note(format!("{full}.{input}"), Layer::Graph, given);
        }
        self.apply_overrides(scope, &full, &id, &mut given);
        match id.strip_prefix("graph:") {
            Some(path) => self.use_graph(scope, &full, path, (at, type_at), given),
            None => self.plain_node(scope, full, &id, type_at, at, given),
        }
    }

    /// What layers and the command line say of a node's inputs, in place of what stands in the graph.
    fn apply_overrides(&mut self, scope: usize, node: &str, id: &str, given: &mut BTreeMap<String, (Given, Span)>) {
        let inside = |key: &str| key.rsplit_once('.').filter(|(target, _)| *target == node).map(|(_, input)| input.to_owned());
        let schema = self.registry.get(id).map(|t| t.schema.clone());
        let mut set = Vec::new();
        for layer in &mut self.layers {
            for said in &mut layer.inputs {
                let Some(input) = inside(&said.name) else { continue };
                said.strict = true;
                // An input that there is no more is no reason to refuse the graph.
                if schema.as_ref().is_some_and(|s| s.input(&input).is_none()) {
                    continue;
                }
                said.used = true;
                set.push((layer.layer, input, Given { scope, ..said.given.clone() }, said.name_at.span));
            }
        }
        for (key, value) in self.options.overrides.clone() {
            let Some(input) = inside(&key) else { continue };
            let text = self.outside_value(("--set", &key), &key, &value, false);
            let span = text.at.span;
            set.push((Layer::CommandLine, input, Given { scope, ..text }, span));
            self.used.insert(key);
        }
        for (layer, input, value, span) in set {
            self.note(format!("{node}.{input}"), layer, &value);
            given.insert(input, (value, span));
        }
    }

    fn plain_node(&mut self, scope: usize, name: String, id: &str, type_at: At, at: At, given: BTreeMap<String, (Given, Span)>) -> Entry {
        let ty = self.registry.get(id).cloned();
        if ty.is_none() {
            let found = self.unknown_type(id, type_at);
            self.push(found);
            // It stays among the nodes, so that its references are held against the graph.
            self.nodes.push(NodeSource { name, scope, ty, at, given });
            return Entry::Broken;
        }
        if let Some(ty) = &ty {
            self.pinned(ty, type_at);
        }
        self.nodes.push(NodeSource { name, scope, ty, at, given });
        Entry::Node(self.nodes.len() - 1)
    }

    fn use_graph(
        &mut self,
        scope: usize,
        name: &str,
        path: &str,
        (at, type_at): (At, At),
        given: BTreeMap<String, (Given, Span)>,
    ) -> Entry {
        let (path, version) = version::split(path);
        let path = self.find_graph(scope, path);
        let resolved = canonical(&path);
        let files = self.scopes[scope].files.clone();
        if files.contains(&resolved) {
            self.error(code::GRAPH_RECURSION, type_at, format!("expected another graph, found one that uses itself: {}", path.display()));
            return Entry::Broken;
        }
        if files.len() >= MAX_NESTED || self.scopes.len() >= MAX_GRAPHS {
            let message = format!("expected at most {MAX_NESTED} graphs within each other and {MAX_GRAPHS} in all, found more");
            self.error(code::GRAPH_RECURSION, type_at, message);
            return Entry::Broken;
        }
        let text = match self.read(&path) {
            Ok(text) => text,
            Err(error) => {
                self.no_graph_file(&path, type_at, &error);
                return Entry::Broken;
            }
        };
        let file = self.source(&path, &text);
        if let Some(wanted) = version {
            self.check_version(&path, &text, wanted, type_at);
        }
        let clocks = self.scopes[scope].clocks.clone();
        let Some(inner) = self.read_graph(&path, file, text, format!("{name}/"), files, clocks) else { return Entry::Broken };
        self.give_params(inner, &path, at, given);
        Entry::Graph(inner)
    }

    /// Where a graph that is used lies: beside the file that uses it, or in the library.
    fn find_graph(&self, scope: usize, path: &str) -> PathBuf {
        let beside = self.scopes[scope].base.join(path);
        let in_library = || self.library.iter().map(|folder| folder.join(path)).find(|p| p.is_file());
        if beside.is_file() || self.options.texts.contains_key(&canonical(&beside)) { beside } else { in_library().unwrap_or(beside) }
    }

    /// Says where a graph is of another version than the one that is asked for.
    fn check_version(&mut self, path: &Path, text: &str, wanted: &str, at: At) {
        let tree = Tree::parse(text);
        let field = tree.value().and_then(|root| root.field("version")).and_then(|f| f.value());
        let found = field.and_then(|v| v.as_str().map(|s| s.into_value().into_owned()));
        let (message, help) = match version::serves(wanted, found.as_deref()) {
            Ok(()) => return,
            Err(wrong) => wrong,
        };
        let error = at.error(code::GRAPH_VERSION, format!("{message}: {}", path.display()));
        self.push(error.help(help));
    }

    fn no_graph_file(&mut self, path: &Path, at: At, error: &std::io::Error) {
        let found = match error.kind() {
            std::io::ErrorKind::NotFound => "none".to_owned(),
            _ => error.to_string(),
        };
        let found = at.error(code::MISSING_FILE, format!("expected a graph file at {}, found {found}", path.display()));
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let near = super::files::neighbours(path);
        self.push(found.did_you_mean(&name, near.iter().map(String::as_str)));
    }

    /// Hands what a graph node is given to the parameters of its graph.
    fn give_params(&mut self, inner: usize, path: &Path, at: At, given: BTreeMap<String, (Given, Span)>) {
        let known: Vec<String> = self.scopes[inner].params.keys().cloned().collect();
        let is_torn = self.torn.iter().any(|t| t.file == self.scopes[inner].file);
        let mut misspelt = Vec::new();
        for (input, (value, span)) in given {
            let prefix = &self.scopes[inner].prefix;
            let layer = self.settings.of(&format!("{}.{input}", prefix.trim_end_matches('/'))).last().map_or(Layer::Graph, |s| s.layer);
            let inside = format!("{prefix}${input}");
            if self.scopes[inner].params.contains_key(&input) {
                self.note(inside, layer, &value);
            }
            if let Some(param) = self.scopes[inner].params.get_mut(&input) {
                param.value = Some(value);
                param.broken = false;
            } else if !is_torn {
                let message = format!("expected a parameter of {}, found `{input}`", path.display());
                let at = At::new(value.at.file, span);
                let found = match layer {
                    Layer::Site | Layer::Show | Layer::Sequence | Layer::Shot => {
                        Diagnostic::warning(code::STALE_LAYER, message, Label::new(at.file, at.span))
                    }
                    _ => at.error(code::UNKNOWN_INPUT, message),
                };
                let list =
                    if known.is_empty() { "it has no parameters".to_owned() } else { format!("its parameters are {}", known.join(", ")) };
                self.push(found.did_you_mean(&input, known.iter().map(String::as_str)).help(list));
                misspelt.push(input);
            }
        }
        let missing = self.scopes[inner].params.iter_mut().filter(|(_, p)| p.value.is_none() && !p.broken);
        let mut unnamed = Vec::new();
        for (name, param) in missing {
            param.broken = true;
            // A misspelt name was said, with this one as what was meant.
            if !misspelt.iter().any(|m| resembles(m, name)) {
                unnamed.push((name.clone(), param.at));
            }
        }
        for (name, declared) in unnamed {
            let found = at.error(code::MISSING_INPUT, format!("expected parameter `{name}` of {}, found none", path.display()));
            self.push(found.with_label(declared.note("declared without a default")));
        }
    }
}
