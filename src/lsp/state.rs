//! What the editor has open, and what checking says of it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use pegbar_engine::check::{Inferred, LoadOptions, Loaded, load_text, version};
use pegbar_engine::diag::FileId;
use pegbar_engine::registry::Registry;

use super::sheet::{Sheet, reference};
use super::text::{Change, Encoding, changed, path_of, uri_of};

/// Graphs within each other that are followed for the type of an output.
const MAX_NESTED: usize = 16;

/// A file that the editor has open.
pub(super) struct Document {
    pub(super) uri: String,
    /// Canonical if the file is on disk.
    pub(super) path: PathBuf,
    pub(super) text: Arc<str>,
    pub(super) version: i64,
    sheet: Option<Rc<Sheet>>,
    checked: Option<Rc<Checked>>,
}

/// What checking says of a file and of the graphs that it uses.
pub(super) struct Checked {
    pub(super) loaded: Loaded,
    /// The path of each file that was read.
    paths: BTreeMap<FileId, PathBuf>,
    /// Positions in `loaded.inferred`, by name.
    by_name: BTreeMap<String, usize>,
}

impl Checked {
    fn new(loaded: Loaded) -> Self {
        let paths = loaded.sources.files().map(|f| (f, canonical(Path::new(loaded.sources.name(f))))).collect();
        let by_name = loaded.inferred.iter().enumerate().map(|(i, n)| (n.name.clone(), i)).collect();
        Self { loaded, paths, by_name }
    }

    /// What is known of the node `name`; one inside a graph node `a` is `a/name`.
    pub(super) fn node(&self, name: &str) -> Option<&Inferred> {
        self.by_name.get(name).and_then(|i| self.loaded.inferred.get(*i))
    }

    pub(super) fn path(&self, file: FileId) -> Option<&Path> {
        self.paths.get(&file).map(PathBuf::as_path)
    }

    pub(super) fn reads(&self, path: &Path) -> bool {
        self.paths.values().any(|p| p == path)
    }
}

/// An output that may be referred to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PortFacts {
    pub(super) name: String,
    /// Value type; empty where it is not known.
    pub(super) ty: String,
    pub(super) per_frame: bool,
    pub(super) doc: String,
}

/// All that the server knows between two messages.
pub(super) struct State<'r> {
    registry: &'r Registry,
    pub(super) encoding: Encoding,
    /// The editor fills in `${1:...}`.
    pub(super) has_snippets: bool,
    /// What graphs are checked with.
    pub(super) options: LoadOptions,
    /// What was looked at last: its library and its plugins are those that count.
    current: Option<Rc<Checked>>,
    documents: BTreeMap<String, Document>,
    /// Documents whose diagnostics are to be sent anew.
    pub(super) stale: BTreeSet<String>,
}

impl<'r> State<'r> {
    pub(super) fn new(registry: &'r Registry, options: LoadOptions) -> Self {
        Self {
            registry,
            encoding: Encoding::default(),
            has_snippets: false,
            current: None,
            options,
            documents: BTreeMap::new(),
            stale: BTreeSet::new(),
        }
    }

    /// What there is: with the plugins of the graph that was looked at last.
    pub(super) fn registry(&self) -> &Registry {
        self.current.as_ref().and_then(|c| c.loaded.registry.as_ref()).unwrap_or(self.registry)
    }

    pub(super) fn open(&mut self, uri: String, text: String, version: i64) {
        let path = match path_of(&uri) {
            Some(path) => canonical(&path),
            None => PathBuf::from(uri.rsplit(['/', ':']).next().unwrap_or_default()),
        };
        let document = Document { uri: uri.clone(), path, text: text.into(), version, sheet: None, checked: None };
        self.documents.insert(uri.clone(), document);
        self.touched(&uri);
    }

    pub(super) fn change(&mut self, uri: &str, version: i64, changes: Vec<Change>) {
        let encoding = self.encoding;
        let Some(document) = self.documents.get_mut(uri) else { return };
        for change in changes {
            document.text = changed(&document.text, change, encoding).into();
        }
        (document.version, document.sheet) = (version, None);
        self.touched(uri);
    }

    pub(super) fn close(&mut self, uri: &str) {
        self.touched(uri);
        self.documents.remove(uri);
    }

    /// Everything is to be checked anew: a file changed that may not be open.
    pub(super) fn all_stale(&mut self) {
        for document in self.documents.values_mut() {
            document.checked = None;
            self.stale.insert(document.uri.clone());
        }
    }

    /// A document changed: it is to be checked anew, and so is every other that uses it, or would if it had been there.
    fn touched(&mut self, uri: &str) {
        let Some(path) = self.documents.get(uri).map(|d| d.path.clone()) else { return };
        let is_new = self.documents.get(uri).is_some_and(|d| d.checked.is_none());
        for document in self.documents.values_mut() {
            let uses = document.checked.as_ref().is_none_or(|c| c.reads(&path) || (is_new && c.loaded.errors() > 0));
            if document.uri == uri || uses {
                document.checked = None;
                self.stale.insert(document.uri.clone());
            }
        }
    }

    pub(super) fn document(&self, uri: &str) -> Option<&Document> {
        self.documents.get(uri)
    }

    pub(super) fn documents(&self) -> impl Iterator<Item = &Document> {
        self.documents.values()
    }

    /// The URI of a file: as the editor wrote it if it has it open.
    pub(super) fn uri(&self, path: &Path) -> String {
        self.documents.values().find(|d| d.path == path).map_or_else(|| uri_of(path), |d| d.uri.clone())
    }

    /// An open document, taken apart.
    pub(super) fn sheet(&mut self, uri: &str) -> Option<Rc<Sheet>> {
        let document = self.documents.get_mut(uri)?;
        let read = || Rc::new(Sheet::read(document.path.clone(), document.uri.clone(), Arc::clone(&document.text)));
        Some(Rc::clone(document.sheet.get_or_insert_with(read)))
    }

    /// Where the graph lies that `path` means in `base`: beside it, or in the library.
    pub(super) fn graph_path(&self, base: &Sheet, path: &str) -> Option<PathBuf> {
        let (path, _) = version::split(path);
        let is_there = |path: &PathBuf| path.is_file() || self.documents.values().any(|d| d.path == *path);
        let beside = canonical(&base.path.parent()?.join(path));
        let library = self.current.as_ref().map_or(&self.options.library, |c| &c.loaded.library);
        let in_library = || library.iter().map(|folder| canonical(&folder.join(path))).find(is_there);
        if is_there(&beside) { Some(beside) } else { in_library() }
    }

    /// The graph that `path` means in `base`, open or not, taken apart.
    pub(super) fn sheet_at(&mut self, base: &Sheet, path: &str) -> Option<Rc<Sheet>> {
        let path = self.graph_path(base, path)?;
        let uri = self.uri(&path);
        if let Some(sheet) = self.sheet(&uri) {
            return Some(sheet);
        }
        let text = std::fs::read_to_string(&path).ok()?;
        Some(Rc::new(Sheet::read(path, uri, text.into())))
    }

    /// What checking says of an open document.
    pub(super) fn checked(&mut self, uri: &str) -> Option<Rc<Checked>> {
        let document = self.documents.get(uri)?;
        if let Some(checked) = &document.checked {
            self.current = Some(Rc::clone(checked));
            return self.current.clone();
        }
        let texts = self.documents.values().map(|d| (d.path.clone(), Arc::clone(&d.text))).collect();
        let options = LoadOptions { texts, ..self.options.clone() };
        let checked = Rc::new(Checked::new(load_text(&document.path, &document.text, self.registry, &options)));
        self.current = Some(Rc::clone(&checked));
        let document = self.documents.get_mut(uri)?;
        document.checked = Some(Rc::clone(&checked));
        Some(checked)
    }

    /// The outputs of a node of `sheet`, which is the graph of the graph node `prefix` (with a slash at its end) if it is not the main one.
    pub(super) fn ports(&mut self, sheet: &Sheet, node: usize, prefix: &str, checked: &Checked) -> Vec<PortFacts> {
        self.ports_within(sheet, node, prefix, checked, 0)
    }

    fn ports_within(&mut self, sheet: &Sheet, node: usize, prefix: &str, checked: &Checked, depth: usize) -> Vec<PortFacts> {
        let Some(decl) = sheet.nodes.get(node) else { return Vec::new() };
        let name = format!("{prefix}{}", decl.decl.name);
        let Some(path) = decl.graph() else { return self.plain_ports(&decl.ty, checked.node(&name)) };
        let Some(inner) = self.sheet_at(sheet, path).filter(|_| depth < MAX_NESTED) else { return Vec::new() };
        let prefix = format!("{name}/");
        let outputs = inner.outputs.iter().map(|output| {
            let found = self.port_of(&inner, &output.of, &prefix, checked, depth + 1);
            let known = found.unwrap_or(PortFacts { name: String::new(), ty: String::new(), per_frame: false, doc: String::new() });
            PortFacts { name: output.decl.name.clone(), ..known }
        });
        outputs.collect()
    }

    fn port_of(&mut self, sheet: &Sheet, of: &str, prefix: &str, checked: &Checked, depth: usize) -> Option<PortFacts> {
        let of = format!("@{of}");
        let (node, port) = reference(&of)?;
        let node = sheet.nodes.iter().position(|n| n.decl.name == node)?;
        let ports = self.ports_within(sheet, node, prefix, checked, depth);
        ports.into_iter().find(|p| port.is_none_or(|port| p.name == port))
    }

    fn plain_ports(&self, ty: &str, inferred: Option<&Inferred>) -> Vec<PortFacts> {
        let Some(schema) = self.registry().get(ty).map(|t| &t.schema) else { return Vec::new() };
        let known = |name: &str| inferred.and_then(|i| i.outputs.iter().find(|o| o.name == name));
        let facts = schema.outputs.iter().map(|o| PortFacts {
            name: o.name.to_owned(),
            ty: known(o.name).map_or_else(|| o.ty.unwrap_or_default().to_owned(), |k| k.ty.clone()),
            per_frame: known(o.name).is_some_and(|k| k.per_frame),
            doc: o.doc.to_owned(),
        });
        facts.collect()
    }
}

/// The path without links and detours; of a file that is not there, of its folder.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| match (path.parent().map(Path::canonicalize), path.file_name()) {
        (Some(Ok(folder)), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    })
}
