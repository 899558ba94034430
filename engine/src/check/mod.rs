//! From a graph file to a [`Graph`] that can run: reads the file and the graphs that it uses, and collects *all* problems on the way.
//!
//! Three steps. [`document`] reads each file into a scope: its parameters, nodes and outputs, as spans of the source. [`resolve`] follows
//! variables and references through the scopes. [`typing`] holds types, rates, clocks and files against what the node types say of themselves.

mod document;
mod files;
mod inferred;
mod layers;
mod params;
mod plugins;
mod rates;
mod resolve;
mod typing;
pub mod version;
mod words;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::diag::{Diagnostic, FileId, Label, Severity, SourceMap, Span};
use crate::graph::Graph;
use crate::plugin::Lock;
use crate::registry::Registry;

pub use inferred::{Inferred, InferredOutput};
pub use layers::{Layer, Setting, Settings};

/// The codes of what can be wrong with a graph.
pub mod code {
    /// A file cannot be read.
    pub const UNREADABLE: &str = "PB0100";
    /// A field that a record does not have.
    pub const UNKNOWN_FIELD: &str = "PB0101";
    /// A format version that this Pegbar does not read.
    pub const FORMAT_VERSION: &str = "PB0102";
    /// Something of another form than it must have.
    pub const FORM: &str = "PB0103";
    /// A frame range that has no frames, or none at all where there must be one.
    pub const FRAMES: &str = "PB0104";
    /// A field that must be there is not.
    pub const MISSING_FIELD: &str = "PB0105";
    /// A name that stands twice.
    pub const DUPLICATE: &str = "PB0110";
    /// A name that cannot be one.
    pub const BAD_NAME: &str = "PB0111";
    /// A node type that there is not.
    pub const UNKNOWN_TYPE: &str = "PB0120";
    /// An input that the node type does not have.
    pub const UNKNOWN_INPUT: &str = "PB0121";
    /// An input that must be given is not.
    pub const MISSING_INPUT: &str = "PB0122";
    /// A graph that uses itself.
    pub const GRAPH_RECURSION: &str = "PB0123";
    /// A graph of another version than the one that is asked for.
    pub const GRAPH_VERSION: &str = "PB0124";
    /// A literal that is not what the input takes.
    pub const BAD_LITERAL: &str = "PB0130";
    /// A number outside the input's range.
    pub const OUT_OF_RANGE: &str = "PB0131";
    /// A value type that there is not.
    pub const UNKNOWN_VALUE_TYPE: &str = "PB0132";
    /// A reference to a node that there is not.
    pub const UNKNOWN_NODE: &str = "PB0140";
    /// A reference to an output that the node does not have.
    pub const UNKNOWN_OUTPUT: &str = "PB0141";
    /// A wire between two types.
    pub const TYPE_MISMATCH: &str = "PB0142";
    /// One value a frame where one for the whole graph is needed.
    pub const RATE_MISMATCH: &str = "PB0143";
    /// A wire between two clocks.
    pub const CLOCK_MISMATCH: &str = "PB0144";
    /// Nodes that wait for each other.
    pub const CYCLE: &str = "PB0145";
    /// A clock that there is not.
    pub const UNKNOWN_CLOCK: &str = "PB0146";
    /// A variable that nothing defines.
    pub const UNDEFINED_VARIABLE: &str = "PB0150";
    /// A parameter that nothing reads.
    pub const UNUSED_PARAMETER: &str = "PB0151";
    /// An override of something that there is not.
    pub const UNKNOWN_OVERRIDE: &str = "PB0152";
    /// A layer that sets what the graph does not have.
    pub const STALE_LAYER: &str = "PB0153";
    /// A file that there is not.
    pub const MISSING_FILE: &str = "PB0160";
    /// Frames of a sequence that there are not.
    pub const FRAME_HOLES: &str = "PB0161";
    /// A path that leads out of the output folder.
    pub const OUTSIDE_OUTPUT: &str = "PB0162";
    /// Two nodes that write one file.
    pub const WRITTEN_TWICE: &str = "PB0163";
    /// A stream written to one file name.
    pub const NO_FRAME_NUMBER: &str = "PB0164";
    /// Settings that do not go together.
    pub const SETTINGS: &str = "PB0170";
    /// A plugin that is not where it is said to be, or cannot be used.
    pub const PLUGIN: &str = "PB0180";
    /// A plugin of which several versions are there.
    pub const PLUGIN_VERSION: &str = "PB0181";
    /// A plugin that is not the one that the lock pins.
    pub const PLUGIN_LOCK: &str = "PB0182";

    /// All of them.
    pub const ALL: [&str; 36] = [
        UNREADABLE,
        UNKNOWN_FIELD,
        FORMAT_VERSION,
        FORM,
        FRAMES,
        MISSING_FIELD,
        DUPLICATE,
        BAD_NAME,
        UNKNOWN_TYPE,
        UNKNOWN_INPUT,
        MISSING_INPUT,
        GRAPH_RECURSION,
        GRAPH_VERSION,
        BAD_LITERAL,
        OUT_OF_RANGE,
        UNKNOWN_VALUE_TYPE,
        UNKNOWN_NODE,
        UNKNOWN_OUTPUT,
        TYPE_MISMATCH,
        RATE_MISMATCH,
        CLOCK_MISMATCH,
        CYCLE,
        UNKNOWN_CLOCK,
        UNDEFINED_VARIABLE,
        UNUSED_PARAMETER,
        UNKNOWN_OVERRIDE,
        STALE_LAYER,
        MISSING_FILE,
        FRAME_HOLES,
        OUTSIDE_OUTPUT,
        WRITTEN_TWICE,
        NO_FRAME_NUMBER,
        SETTINGS,
        PLUGIN,
        PLUGIN_VERSION,
        PLUGIN_LOCK,
    ];
}

/// What the caller sets from outside.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Folder that outputs go to: `$out`.
    pub out: PathBuf,
    /// `NAME=VALUE` pairs for the graph's parameters.
    pub variables: Vec<(String, String)>,
    /// `node.input=RON` pairs.
    pub overrides: Vec<(String, String)>,
    /// Folder of the shot that the graph is run for; its layers, and those of the folders above, are read.
    pub shot: Option<PathBuf>,
    /// The layer of every show.
    pub site: Option<PathBuf>,
    /// Folders in which graphs that are used are looked for, besides that of the file that uses them.
    pub library: Vec<PathBuf>,
    /// True where `pegbar.lock` beside the graph does not count, as it is about to be written.
    pub unlocked: bool,
    /// Folder that paths in `variables` and `overrides` are held against; the working folder where empty.
    pub base: PathBuf,
    /// Where `variables` (`$NAME`) and `overrides` (`node.input`) are written, where that is a file: messages point there.
    pub places: BTreeMap<String, Place>,
    /// Texts that count instead of those on disk, by canonical path: graph files that are being edited.
    pub texts: BTreeMap<PathBuf, Arc<str>>,
}

/// Where a value that is set from outside is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Name of the file.
    pub file: String,
    /// Its text.
    pub text: Arc<str>,
    /// The name that is set.
    pub name: Span,
    /// Its value.
    pub value: Span,
}

/// A graph file that was read, with all that is wrong with it.
pub struct Loaded {
    /// Every file that was read.
    pub sources: SourceMap,
    /// What is wrong, in the order of the files.
    pub diagnostics: Vec<Diagnostic>,
    /// What was found out about each node, whether or not something is wrong; in the order in which nodes are written.
    pub inferred: Vec<Inferred>,
    /// The graph; `None` where something is wrong.
    pub graph: Option<Graph>,
    /// Where each setting comes from.
    pub settings: Settings,
    /// Folders in which graphs that are used were looked for, besides those of the files that use them.
    pub library: Vec<PathBuf>,
    /// Variables that layers define, and the names and paths of their folders, with their values as RON.
    pub variables: BTreeMap<String, String>,
    /// The registry with the plugins that the graph names; `None` where it names none.
    pub registry: Option<Registry>,
}

impl Loaded {
    /// Number of errors, warnings not counted.
    pub fn errors(&self) -> usize {
        self.diagnostics.iter().filter(|d| d.severity == Severity::Error).count()
    }
}

/// Reads and checks a graph file. Runs no node.
pub fn load(path: &Path, registry: &Registry, options: &LoadOptions) -> Loaded {
    let mut checker = Checker::new(registry, options);
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) => {
            checker.diagnostics.push(Diagnostic::new(Severity::Error, code::UNREADABLE, format!("{}: {error}", path.display())));
            String::new()
        }
    };
    if checker.diagnostics.is_empty() { checker.check(path, text) } else { checker.finish(None) }
}

/// Checks the text of a graph file as if it stood at `path`.
pub fn load_text(path: &Path, text: &str, registry: &Registry, options: &LoadOptions) -> Loaded {
    Checker::new(registry, options).check(path, text.to_owned())
}

/// The path without links and detours, as far as the file is there.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| crate::setting::normalise(path))
}

struct Checker<'a> {
    /// What there is, and what plugins add to it.
    registry: Cow<'a, Registry>,
    lock: Option<Lock>,
    options: &'a LoadOptions,
    sources: SourceMap,
    diagnostics: Vec<Diagnostic>,
    scopes: Vec<document::Scope>,
    /// Nodes of all scopes, in the order in which they are written.
    nodes: Vec<document::NodeSource>,
    /// Overrides and variables that were used.
    used: BTreeSet<String>,
    /// Every graph file that was read: a graph that is used twice is one source.
    files: BTreeMap<PathBuf, FileId>,
    /// Where the text is no RON; what is wrong there or missing because of it is not said again.
    torn: Vec<At>,
    /// Clocks that are declared, but wrongly.
    broken_clocks: BTreeSet<String>,
    /// Nodes that need `frames` in a graph that has none.
    frameless: Vec<(String, At)>,
    /// Variables that nothing defines.
    undefined: BTreeSet<String>,
    /// Variables that are being replaced, outermost first.
    expanding: Vec<(usize, String)>,
    /// Variables replaced for one input so far.
    lookups: usize,
    /// What layers say, the weakest first.
    layers: Vec<layers::LayerFile>,
    /// Variables that layers define, and the names of their folders.
    context: BTreeMap<String, document::Given>,
    /// Folders in which graphs are looked for, the nearest first.
    library: Vec<PathBuf>,
    settings: Settings,
    /// What files that the graph writes say of it.
    origin: Option<Arc<str>>,
    /// What was found out about each node.
    inferred: Vec<Inferred>,
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct At {
    pub(crate) file: FileId,
    pub(crate) span: Span,
    /// Where what is written here is used through a variable.
    via: Option<(FileId, Span)>,
}

impl At {
    fn new(file: FileId, span: Span) -> Self {
        Self { file, span, via: None }
    }

    /// This place, for what is used at `at` through a variable; where variables are handed on, the place nearest to the node counts.
    fn used_at(self, at: At) -> Self {
        let via = at.via.unwrap_or((at.file, at.span));
        Self { via: (via != (self.file, self.span)).then_some(via), ..self }
    }

    /// An error here.
    fn error(self, code: &'static str, message: impl Into<String>) -> Diagnostic {
        let error = Diagnostic::error(code, message, Label::new(self.file, self.span));
        match self.via {
            Some((file, span)) => error.with_label(Label::secondary(file, span, "used here")),
            None => error,
        }
    }

    fn note(self, text: impl Into<String>) -> Label {
        Label::secondary(self.file, self.span, text)
    }
}

impl<'a> Checker<'a> {
    fn new(registry: &'a Registry, options: &'a LoadOptions) -> Self {
        Self {
            registry: Cow::Borrowed(registry),
            lock: None,
            options,
            sources: SourceMap::new(),
            diagnostics: Vec::new(),
            scopes: Vec::new(),
            nodes: Vec::new(),
            used: BTreeSet::new(),
            files: BTreeMap::new(),
            torn: Vec::new(),
            broken_clocks: BTreeSet::new(),
            frameless: Vec::new(),
            undefined: BTreeSet::new(),
            expanding: Vec::new(),
            lookups: 0,
            layers: Vec::new(),
            context: BTreeMap::new(),
            library: options.library.clone(),
            settings: Settings::default(),
            origin: None,
            inferred: Vec::new(),
        }
    }

    fn check(mut self, path: &Path, text: String) -> Loaded {
        self.read_layers(path);
        self.read_lock(path);
        let scope = self.read_main(path, text);
        self.origin = crate::origin::text(path, &self.sources, self.options);
        let graph = scope.and_then(|s| self.resolve_all(s));
        if scope.is_some() {
            self.unused_overrides();
            self.unused_layers();
        }
        self.finish(graph)
    }

    fn finish(mut self, graph: Option<Graph>) -> Loaded {
        let torn = std::mem::take(&mut self.torn);
        self.diagnostics.retain(|d| torn.is_empty() || !follows_from(d, &torn));
        crate::diag::sort(&mut self.diagnostics);
        let failed = self.diagnostics.iter().any(|d| d.severity == Severity::Error);
        Loaded {
            sources: self.sources,
            diagnostics: self.diagnostics,
            inferred: self.inferred,
            graph: graph.filter(|_| !failed),
            settings: self.settings,
            library: self.library,
            variables: self.context.into_iter().map(|(name, given)| (name, given.text)).collect(),
            registry: if let Cow::Owned(registry) = self.registry { Some(registry) } else { None },
        }
    }

    fn error(&mut self, code: &'static str, at: At, message: impl Into<String>) -> &mut Diagnostic {
        self.diagnostics.push(at.error(code, message));
        let last = self.diagnostics.len() - 1;
        &mut self.diagnostics[last]
    }

    /// The text of a file: as it is being edited, else as it is on disk.
    fn read(&self, path: &Path) -> std::io::Result<String> {
        match self.options.texts.get(&canonical(path)) {
            Some(text) => Ok(text.to_string()),
            None => std::fs::read_to_string(path),
        }
    }

    fn push(&mut self, diagnostic: Diagnostic) {
        self.diagnostics.push(diagnostic);
    }

    /// True where `text` stands at `at` letter for letter, so that a part of it can be pointed at.
    fn is_verbatim(&self, at: At, text: &str) -> bool {
        self.sources.slice(at.file, at.span) == text
    }
}

/// True where two paths lead to one place.
fn same_file(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// Codes of what is missing: it may stand in the text that could not be read.
const MISSING: [&str; 10] = [
    code::MISSING_FIELD,
    code::MISSING_INPUT,
    code::UNKNOWN_NODE,
    code::UNKNOWN_OUTPUT,
    code::UNKNOWN_CLOCK,
    code::UNDEFINED_VARIABLE,
    code::UNUSED_PARAMETER,
    code::UNKNOWN_OVERRIDE,
    code::STALE_LAYER,
    code::FRAMES,
];

/// True for a problem that is there only because some text could not be read.
fn follows_from(diagnostic: &Diagnostic, torn: &[At]) -> bool {
    let Some(label) = diagnostic.primary() else { return MISSING.contains(&diagnostic.code) };
    let is_syntax = diagnostic.code < code::UNREADABLE;
    let overlaps = |at: &At| at.file == label.file && at.span.start < label.span.end && label.span.start < at.span.end;
    !is_syntax && (MISSING.contains(&diagnostic.code) || torn.iter().any(overlaps))
}
