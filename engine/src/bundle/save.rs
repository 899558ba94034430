//! Writing a bundle.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use crate::exec::Failure;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Arg, InputSchema, Literal};
use crate::npz;
use crate::setting::{FileUse, InputPath, InputPaths, Missing, OutputPath};
use crate::value::AnyValue;

use super::{BundleError, FORMAT, Given, RECORD, Record, SavedInput, SavedValue, SavedWire, digest, file_error, setting};

/// Name of the folder of a failure: `NODE@FRAME`, or `NODE` for a node that runs once. No two tasks of a graph have the same.
pub fn folder_name(node: &str, frame: Option<i64>) -> String {
    let frame = frame.map(|f| format!("@{f}")).unwrap_or_default();
    format!("{}{frame}", file_name(node))
}

/// A name of a graph as part of a file's name; another name is another part.
fn file_name(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        match c {
            // No name in a graph holds a dot, and those of nodes inside graph nodes hold slashes.
            '/' => out.push('.'),
            c if c.is_alphanumeric() || "_- ".contains(c) => out.push(c),
            c => c.encode_utf8(&mut [0; 4]).bytes().for_each(|b| out.push_str(&format!("%{b:02X}"))),
        }
    }
    out
}

/// Saves what a failed task was given as a folder of `folder`, whole or not at all; gives that folder. An older bundle of the same task is replaced.
///
/// Cost: O(bytes of the inputs), each written and read once; of a sequence one value is held at a time.
///
/// # Errors
/// Where the observer of the run did not keep the inputs, or the bundle cannot be written; nothing of it is left then.
pub fn save(graph: &Graph, failure: &Failure, folder: &Path) -> Result<PathBuf, BundleError> {
    let spec = &graph.nodes[failure.node];
    std::fs::create_dir_all(folder).map_err(file_error(folder, "making the folder"))?;
    let target = folder.join(folder_name(&spec.name, failure.frame));
    let temporary = temporary_in(folder).map_err(file_error(folder, "making a folder"))?;
    let mut saver =
        Saver { folder: temporary.path(), spec, frame: failure.frame.unwrap_or(spec.clock.first), folders: Vec::new(), out: None };
    let record = saver.record(graph, failure)?;
    let path = temporary.path().join(RECORD);
    let text = serde_json::to_string_pretty(&record).map_err(|e| file_error(&path, "writing")(e.into()))?;
    std::fs::write(&path, text + "\n").map_err(file_error(&path, "writing"))?;
    put_in_place(temporary, &target)?;
    Ok(target)
}

fn temporary_in(folder: &Path) -> std::io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".bundle.").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's mask takes away from these what its user does not grant.
        builder.permissions(std::fs::Permissions::from_mode(0o777));
    }
    builder.tempdir_in(folder)
}

/// Renames a finished folder to its own name; what stood there before is removed only then.
fn put_in_place(temporary: tempfile::TempDir, target: &Path) -> Result<(), BundleError> {
    let rename = |from: &Path, to: &Path| std::fs::rename(from, to).map_err(file_error(target, "renaming"));
    if target.exists() {
        if !target.join(RECORD).is_file() {
            return Err(BundleError::Occupied { path: target.to_owned() });
        }
        let aside = temporary_in(target.parent().unwrap_or(Path::new("."))).map_err(file_error(target, "replacing"))?;
        let older = aside.path().join("older");
        rename(target, &older)?;
        if let Err(error) = rename(temporary.path(), target) {
            // The older bundle is better than none.
            let _ = std::fs::rename(&older, target);
            return Err(error);
        }
    } else {
        rename(temporary.path(), target)?;
    }
    // Of its old name there is nothing left to remove.
    let _ = temporary.keep();
    Ok(())
}

struct Saver<'a> {
    folder: &'a Path,
    spec: &'a GraphNode,
    /// The frame that the node was told.
    frame: i64,
    folders: Vec<(String, String)>,
    out: Option<String>,
}

impl Saver<'_> {
    fn record(&mut self, graph: &Graph, failure: &Failure) -> Result<Record, BundleError> {
        let (spec, schema) = (self.spec, &self.spec.ty.schema);
        let given = failure.given.as_ref().ok_or_else(|| BundleError::NotKept { node: spec.name.clone() })?;
        let mut inputs = Vec::with_capacity(schema.inputs.len());
        for ((input, binding), arg) in schema.inputs.iter().zip(&spec.inputs).zip(&given.args) {
            let wires = match binding {
                Binding::Wire(port) => vec![wire(graph, *port)],
                Binding::List(ports) => ports.iter().map(|p| wire(graph, *p)).collect(),
                _ => Vec::new(),
            };
            let given = match (binding, arg) {
                (Binding::Literal { text, .. }, Arg::Literal(value)) => Given::Literal(self.literal(input, value, text)?),
                _ => self.given(input.name, &format!("inputs/{}", file_name(input.name)), arg)?,
            };
            inputs.push(SavedInput { name: input.name.to_owned(), wires, given });
        }
        let state = given.state.as_ref().map(|s| self.value(s.as_ref(), "state".to_owned())).transpose()?;
        Ok(Record {
            format: FORMAT,
            pegbar: env!("CARGO_PKG_VERSION").to_owned(),
            node: spec.name.clone(),
            ty: schema.id.to_owned(),
            version: schema.version,
            frame: failure.frame,
            error: failure.error.clone(),
            shapes: failure.inputs.clone(),
            clock: spec.clock.as_ref().clone(),
            input_clocks: spec.input_clocks.iter().map(|(name, clock)| ((*name).to_owned(), clock.as_ref().clone())).collect(),
            inputs,
            state,
            folders: std::mem::take(&mut self.folders),
            out: self.out.take(),
            origin: spec.written_paths().find_map(|path| path.origin().map(|origin| origin.to_string())),
            digests: digests(self.folder)?,
        })
    }

    /// What stands at an input, its values in files whose names begin with `stem`.
    fn given(&self, input: &str, stem: &str, arg: &Arg) -> Result<Given, BundleError> {
        Ok(match arg {
            Arg::None => Given::Nothing,
            Arg::Literal(_) => {
                return Err(BundleError::Input {
                    input: input.to_owned(),
                    reason: "expected a value, found a literal without text".to_owned(),
                });
            }
            Arg::Value(value) => Given::Value(self.value(value.as_ref(), stem.to_owned())?),
            Arg::Frames(list) => {
                let values = list.iter().map(|(frame, value)| Ok((*frame, self.value(value.as_ref(), format!("{stem}@{frame}"))?)));
                Given::Frames(values.collect::<Result<_, BundleError>>()?)
            }
            Arg::Sequence(sequence) => {
                let first = sequence.clock.as_ref().map_or(0, |c| c.first);
                let one = |idx: usize| {
                    let value = sequence.get(idx).map_err(|source| BundleError::Sequence { input: input.to_owned(), source })?;
                    self.value(value.as_ref(), format!("{stem}@{}", first + idx as i64))
                };
                let values = (0..sequence.len()).map(one).collect::<Result<_, _>>()?;
                Given::Sequence { clock: sequence.clock.as_deref().cloned(), values }
            }
            Arg::List(args) => {
                let one = |(i, arg): (usize, &Arg)| self.given(input, &format!("{stem}.{i}"), arg);
                Given::List(args.iter().enumerate().map(one).collect::<Result<_, _>>()?)
            }
        })
    }

    fn value(&self, value: &dyn AnyValue, stem: String) -> Result<SavedValue, BundleError> {
        let file = format!("{stem}.npz");
        let path = self.folder.join(&file);
        make_parent(&path)?;
        let mut out = BufWriter::new(File::create(&path).map_err(file_error(&path, "making"))?);
        npz::write(value, false, &mut out).map_err(|source| BundleError::Value { path: path.clone(), source: source.into() })?;
        out.flush().map_err(file_error(&path, "writing"))?;
        Ok(SavedValue { ty: value.type_name().to_owned(), file })
    }

    /// The text of a setting, such that a path in it points into the bundle, or below the output folder of a replay.
    fn literal(&mut self, input: &InputSchema, value: &Literal, text: &str) -> Result<String, BundleError> {
        let unwritten =
            |e: ron::Error| BundleError::Input { input: input.name.to_owned(), reason: format!("its path cannot be written: {e}") };
        if let Some(InputPaths(paths)) = setting::<InputPaths>(value) {
            // Each in a folder of its own, as files of several folders may have the same name.
            let copies = paths.iter().enumerate().map(|(i, path)| self.copy(&format!("{}-{i}", input.name), path));
            return ron::to_string(&copies.collect::<Result<Vec<_>, _>>()?).map_err(unwritten);
        }
        let path = match input.files {
            FileUse::None => None,
            FileUse::Read => setting::<InputPath>(value).map(|path| self.copy(input.name, &path)).transpose()?,
            FileUse::Write => setting::<OutputPath>(value).map(|path| self.written(&path)),
        };
        match path {
            None => Ok(text.to_owned()),
            Some(path) => ron::to_string(&path).map_err(unwritten),
        }
    }

    /// Copies the file that is read at this frame, and what its contents name in its folder or below; one that is not there is no file of the bundle
    /// either, so that the same is missed.
    fn copy(&mut self, input: &str, path: &InputPath) -> Result<String, BundleError> {
        let here = format!("files/{}", file_name(input));
        let parent = |p: &Path| p.parent().map(Path::to_owned).unwrap_or_default();
        self.folders.push((here.clone(), parent(&path.at(self.frame)).display().to_string()));
        if let Some(file) = path.resolve(self.frame, missing(self.spec)).filter(|f| f.is_file()) {
            let from = parent(&file);
            let beside = self.spec.ty.schema.beside.map_or_else(Vec::new, |beside| beside(&file));
            for file in std::iter::once(&file).chain(beside.iter().filter(|f| f.is_file())) {
                let Some(below) = file.strip_prefix(&from).ok().filter(|p| p.components().all(|c| matches!(c, Component::Normal(_))))
                else {
                    continue;
                };
                let copy = self.folder.join(&here).join(below);
                make_parent(&copy)?;
                std::fs::copy(file, &copy).map_err(file_error(file, "copying"))?;
            }
        }
        let pattern = path.pattern();
        let name = pattern.rsplit(['/', std::path::MAIN_SEPARATOR]).next().unwrap_or_default();
        Ok(format!("{here}/{name}"))
    }

    fn written(&mut self, path: &OutputPath) -> String {
        self.out = Some(path.root().display().to_string());
        let pattern = PathBuf::from(path.pattern());
        // A path that the root does not begin is one that checking refuses; its last part stays inside whatever it is.
        let below = pattern.strip_prefix(path.root()).ok().or(pattern.file_name().map(Path::new)).unwrap_or(Path::new("file"));
        below.to_string_lossy().into_owned()
    }
}

fn wire(graph: &Graph, port: Port) -> SavedWire {
    let ty = graph.nodes[port.node].output_types.get(port.output).cloned().unwrap_or_default();
    SavedWire { port: graph.port_name(port), ty }
}

fn missing(spec: &GraphNode) -> Missing {
    let literals = spec.inputs.iter().filter_map(|b| if let Binding::Literal { value, .. } = b { Some(value) } else { None });
    literals.filter_map(|v| v.downcast_ref::<Missing>()).next().copied().unwrap_or_default()
}

fn make_parent(path: &Path) -> Result<(), BundleError> {
    match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder).map_err(file_error(folder, "making the folder")),
        None => Ok(()),
    }
}

/// The digest of each file below a folder, by its name from there with slashes.
fn digests(root: &Path) -> Result<BTreeMap<String, String>, BundleError> {
    let mut found = BTreeMap::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(below) = folders.pop() {
        let folder = root.join(&below);
        for entry in std::fs::read_dir(&folder).map_err(file_error(&folder, "listing"))? {
            let name = entry.map_err(file_error(&folder, "listing"))?.file_name();
            let (name, path) = (below.join(&name), folder.join(&name));
            if path.is_dir() {
                folders.push(name);
            } else {
                let parts: Vec<_> = name.iter().map(|p| p.to_string_lossy()).collect();
                found.insert(parts.join("/"), digest(&path).map_err(file_error(&path, "reading"))?);
            }
        }
    }
    Ok(found)
}
