//! Layers: files of a site, a show, a sequence and a shot that set parameters and inputs of graphs from outside, and where each setting comes from.
//!
//! A shot is a folder with a `shot.ron` in it; `sequence.ron` and `show.ron` stand in the folders above. Later layers win: site, show, sequence,
//! shot, command line. Layers set, and do nothing else: no node and no wire comes or goes with them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::diag::{Diagnostic, FileId, Label, Severity, Span};
use crate::syntax::{FieldRef, NodeKind, NodeRef, Tree};

use super::document::Given;
use super::{At, Checker, code};

/// Which layer a file is, the lowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// The node type's own default.
    Default,
    /// The graph file.
    Graph,
    /// For every show.
    Site,
    /// `show.ron`.
    Show,
    /// `sequence.ron`.
    Sequence,
    /// `shot.ron`.
    Shot,
    /// `--set` and `--var`.
    CommandLine,
}

impl Layer {
    /// Its name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Graph => "graph",
            Self::Site => "site",
            Self::Show => "show",
            Self::Sequence => "sequence",
            Self::Shot => "shot",
            Self::CommandLine => "command line",
        }
    }
}

/// One place that says what stands at an input or what a parameter is.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Which layer.
    pub layer: Layer,
    /// What it says, as it is written.
    pub text: String,
    /// File in which it is written.
    pub file: FileId,
    /// Where.
    pub span: Span,
    /// The graph node in which its variables are meant, with a slash behind; empty for the graph itself.
    pub within: String,
}

/// Who says what of each input (`node.input`) and each parameter (`$name`, `node/$name` inside a graph node), the weakest first.
#[derive(Clone, Debug, Default)]
pub struct Settings(BTreeMap<String, Vec<Setting>>);

impl Settings {
    /// All that is said of `name`; the last one counts.
    pub fn of(&self, name: &str) -> &[Setting] {
        self.0.get(name).map_or(&[], Vec::as_slice)
    }

    /// Names of which something is said.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

/// What one layer file says, of all graphs or of this one.
pub(super) struct LayerFile {
    pub(super) layer: Layer,
    pub(super) params: Vec<Said>,
    pub(super) inputs: Vec<Said>,
}

/// One setting of a layer.
pub(super) struct Said {
    pub(super) name: String,
    pub(super) name_at: At,
    pub(super) given: Given,
    /// True where it is said of this graph alone, which then has to have it.
    pub(super) strict: bool,
    pub(super) used: bool,
}

const FIELDS: [&str; 7] = ["pegbar", "doc", "variables", "library", "params", "set", "graphs"];

/// The layers' files above a folder, and names for the folders that they stand in.
fn above(folder: &Path) -> Vec<(Layer, PathBuf)> {
    const KINDS: [(Layer, &str); 3] = [(Layer::Shot, "shot.ron"), (Layer::Sequence, "sequence.ron"), (Layer::Show, "show.ron")];
    let mut found = Vec::new();
    let mut kinds = &KINDS[..];
    for folder in folder.ancestors() {
        let here = kinds.iter().position(|(_, name)| folder.join(name).is_file());
        if let Some(at) = here {
            let (layer, name) = kinds[at];
            found.push((layer, folder.join(name)));
            kinds = &kinds[at + 1..];
        }
    }
    found.reverse();
    found
}

impl Checker<'_> {
    /// Notes who says what of an input or a parameter.
    pub(super) fn note(&mut self, name: String, layer: Layer, given: &Given) {
        let within = self.scopes.get(given.scope).map(|s| s.prefix.clone()).unwrap_or_default();
        let setting = Setting { layer, text: given.text.clone(), file: given.at.file, span: given.at.span, within };
        self.settings.0.entry(name).or_default().push(setting);
    }

    /// Reads the layers of the options: of a site, and of the folders that a shot lies in.
    pub(super) fn read_layers(&mut self, graph: &Path) {
        let stem = graph.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut files: Vec<(Layer, PathBuf)> = self.options.site.iter().map(|path| (Layer::Site, path.clone())).collect();
        if let Some(shot) = &self.options.shot {
            let folder = std::path::absolute(shot).unwrap_or_else(|_| shot.clone());
            let found = above(&folder);
            let here = found.last().is_some_and(|(_, path)| path.parent().is_some_and(|p| super::same_file(p, &folder)));
            if !here {
                let message = format!("expected a shot.ron, sequence.ron or show.ron in {}, found none", shot.display());
                let error = Diagnostic::new(Severity::Error, code::MISSING_FILE, message);
                self.push(error.help("a shot is a folder with a shot.ron in it: `pegbar new shot DIR` makes one"));
            }
            files.extend(found);
        }
        for (layer, path) in files {
            self.folder_variables(layer, &path);
            match self.read(&path) {
                Ok(text) => self.read_layer(layer, &path, text, &stem),
                Err(error) => {
                    let message = format!("expected the {} layer at {}, found {error}", layer.name(), path.display());
                    self.push(Diagnostic::new(Severity::Error, code::UNREADABLE, message));
                }
            }
        }
    }

    /// `$shot` and `$shot_dir`, and the like: a folder's name, and its path.
    fn folder_variables(&mut self, layer: Layer, path: &Path) {
        let Some(folder) = path.parent().filter(|_| layer != Layer::Site) else { return };
        let file = self.sources.add(path.display().to_string(), "");
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for (name, text) in [(layer.name().to_owned(), name), (format!("{}_dir", layer.name()), folder.to_string_lossy().into_owned())] {
            let text = ron::to_string(&text).unwrap_or_default();
            let at = At::new(file, Span::new(0, 0));
            self.context.insert(name, Given { scope: 0, text, at, base: PathBuf::new() });
        }
    }

    fn read_layer(&mut self, layer: Layer, path: &Path, text: String, stem: &str) {
        let file = self.source(path, &text);
        let tree = Tree::parse(text);
        self.diagnostics.extend(tree.errors().iter().map(|e| e.to_diagnostic(file)));
        let Some(root) = tree.value() else { return };
        if root.kind() != NodeKind::Struct || root.name().is_none_or(|n| n.name() != "Layer") {
            let at = At::new(file, root.name().map_or(root.span(), |n| n.span()));
            let found = root.name().map_or(root.describe().to_owned(), |n| format!("{}(...)", n.name()));
            self.error(code::FORM, at, format!("expected Layer(...), found {found}"));
            return;
        }
        if !self.version(file, root) {
            return;
        }
        let base = path.parent().map(Path::to_owned).unwrap_or_default();
        let fields = self.fields(file, root, &FIELDS, "a layer");
        self.text_field(file, &fields, "doc");
        if let Some(field) = fields.get("library") {
            self.read_library(file, *field, &base);
        }
        for said in self.said(file, fields.get("variables"), &base, false) {
            self.context.insert(said.name, said.given);
        }
        let mut params = self.said(file, fields.get("params"), &base, false);
        let mut inputs = self.said(file, fields.get("set"), &base, false);
        for (name, value, span) in fields.get("graphs").map(|f| self.map(file, *f)).unwrap_or_default() {
            if value.kind() != NodeKind::Struct && value.kind() != NodeKind::Unit {
                let at = At::new(file, span);
                self.error(code::FORM, at, format!("expected (params: {{...}}, set: {{...}}), found {}", value.describe()));
            } else if name == stem {
                let fields = self.fields(file, value, &["params", "set"], "a graph's layer");
                params.extend(self.said(file, fields.get("params"), &base, true));
                inputs.extend(self.said(file, fields.get("set"), &base, true));
            }
        }
        self.layers.push(LayerFile { layer, params, inputs });
    }

    /// What a map of a layer says; keys of inputs have dots and slashes in them, unlike names.
    fn said(&mut self, file: FileId, field: Option<&FieldRef<'_>>, base: &Path, strict: bool) -> Vec<Said> {
        let Some(value) = field.and_then(|f| f.value()) else { return Vec::new() };
        if value.kind() != NodeKind::Map {
            let at = At::new(file, value.span());
            self.error(code::FORM, at, format!("expected a map as {{ \"name\": ... }}, found {}", value.describe()));
            return Vec::new();
        }
        let mut out: Vec<Said> = Vec::new();
        for entry in value.entries() {
            let (Some(key), Some(value)) = (entry.key(), entry.value()) else { continue };
            let name_at = At::new(file, key.span());
            let Some(name) = key.as_str().map(|s| s.into_value().into_owned()) else {
                self.error(code::FORM, name_at, format!("expected a name as \"name\", found {}", key.describe()));
                continue;
            };
            if let Some(first) = out.iter().find(|s| s.name == name) {
                let first = first.name_at;
                let twice = name_at.error(code::DUPLICATE, format!("`{name}` stands twice"));
                self.push(twice.with_label(first.note("first here")));
                continue;
            }
            let given = Given { scope: 0, text: value.text().to_owned(), at: At::new(file, value.span()), base: base.to_owned() };
            out.push(Said { name, name_at, given, strict, used: false });
        }
        out
    }

    /// Folders in which graphs that are used are looked for.
    fn read_library(&mut self, file: FileId, field: FieldRef<'_>, base: &Path) {
        let Some(value) = field.value() else { return };
        let one = |node: NodeRef<'_>| node.as_str().map(|s| base.join(s.into_value().as_ref()));
        let folders: Option<Vec<PathBuf>> = match value.kind() {
            NodeKind::List => value.elements().map(one).collect(),
            _ => one(value).map(|f| vec![f]),
        };
        match folders {
            Some(folders) => self.library.splice(0..0, folders).for_each(drop),
            None => {
                let at = At::new(file, value.span());
                self.error(code::FORM, at, format!("expected folders as [\"../library\"], found {}", value.describe()));
            }
        }
    }

    /// Warns of what layers set that this graph does not have.
    pub(super) fn unused_layers(&mut self) {
        let params: Vec<String> = self.scopes.first().iter().flat_map(|s| s.params.keys().cloned()).collect();
        let inputs = |n: &super::document::NodeSource| {
            let inputs = n.ty.iter().flat_map(|t| t.schema.inputs.iter().map(|i| i.name));
            inputs.map(|i| format!("{}.{i}", n.name)).collect::<Vec<_>>()
        };
        let inputs: Vec<String> = self.nodes.iter().flat_map(inputs).collect();
        let mut found = Vec::new();
        for layer in &self.layers {
            let sets = layer.params.iter().map(|s| (s, &params, "a parameter of the graph"));
            for (said, known, what) in sets.chain(layer.inputs.iter().map(|s| (s, &inputs, "an input of the graph"))) {
                let near = crate::diag::did_you_mean(&said.name, known.iter().map(String::as_str));
                // What is said of every graph is missed only where it was most likely meant for this one.
                if said.used || !(said.strict || near.is_some()) {
                    continue;
                }
                let message = format!("expected {what}, found `{}`, which it does not have", said.name);
                let warning = Diagnostic::warning(code::STALE_LAYER, message, Label::new(said.name_at.file, said.name_at.span));
                let help = format!("the {} layer sets it in vain: rename it, or take it away", layer.layer.name());
                found.push(warning.did_you_mean(&said.name, known.iter().map(String::as_str)).help(help));
            }
        }
        self.diagnostics.extend(found);
    }
}
