//! Reading a bundle, and running its task.

use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use crate::atomic::{self, WriteError};
use crate::clock::Clock;
use crate::exec::panicked;
use crate::node::{Arg, Cancel, Computed, Context, InputSchema, NodeError, OutValue, SequenceRef, Values};
use crate::npz::{self, Archive, MAX_BYTES, NpzError};
use crate::registry::{NodeType, Registry, Types};
use crate::setting::{FileUse, OutputPath, Place};
use crate::value::{ValueRef, ValueType};

use super::{BundleError, FORMAT, Given, RECORD, Record, SavedValue, digest, file_error, setting};

/// A bundle that was read: sound, and of a node type that is here in the version of the run.
pub struct Bundle {
    folder: PathBuf,
    record: Record,
    ty: NodeType,
    types: Types,
}

/// What came of a replay.
pub enum Replayed {
    /// The failure of the bundle.
    Same,
    /// Another failure. Files and folders in it are called as in the run.
    Other(NodeError),
    /// No failure.
    Fine(Computed),
}

impl Bundle {
    /// Reads the bundle in `folder`.
    ///
    /// Cost: each file is read once, for its digest; values are read when it is replayed.
    ///
    /// # Errors
    /// Where there is none, files of it are missing or are not as they were saved, or the registry does not have its node type in the same version.
    pub fn open(folder: &Path, registry: &Registry) -> Result<Self, BundleError> {
        let record = read_record(folder)?;
        for (name, saved) in &record.digests {
            let path = inside(folder, name)?;
            let damaged = |found| BundleError::Damaged { path: path.clone(), found };
            match digest(&path) {
                Ok(found) if found == *saved => {}
                Ok(_) => return Err(damaged("other contents")),
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Err(damaged("none")),
                Err(e) => return Err(file_error(&path, "reading")(e)),
            }
        }
        let Some(ty) = registry.get(&record.ty).cloned() else {
            return Err(BundleError::UnknownNode { id: record.ty, saved_by: record.pegbar });
        };
        let here = ty.schema.version;
        if here != record.version {
            return Err(BundleError::OtherVersion { id: record.ty, saved: record.version, here, saved_by: record.pegbar });
        }
        Ok(Self { folder: folder.to_owned(), record, ty, types: registry.shared_types().clone() })
    }

    /// The node's name in the graph of the run.
    pub fn node(&self) -> &str {
        &self.record.node
    }

    /// The node type.
    pub fn node_type(&self) -> &NodeType {
        &self.ty
    }

    /// The frame; `None` for a node that runs once.
    pub fn frame(&self) -> Option<i64> {
        self.record.frame
    }

    /// The failure of the run.
    pub fn error(&self) -> &NodeError {
        &self.record.error
    }

    /// Each wired input: name, type, and extents of its first array.
    pub fn shapes(&self) -> &[String] {
        &self.record.shapes
    }

    /// Runs the task with what it was given. What it writes goes below `out`; where `None`, below a folder that goes away again.
    ///
    /// # Errors
    /// Where what it was given cannot be read, or the folder cannot be made. A failure of the node is none.
    pub fn replay(&self, out: Option<&Path>, cancel: &Cancel) -> Result<Replayed, BundleError> {
        let Some(out) = out else {
            let out = tempfile::tempdir().map_err(file_error(&std::env::temp_dir(), "making a folder"))?;
            return self.run(out.path(), cancel);
        };
        std::fs::create_dir_all(out).map_err(file_error(out, "making the folder"))?;
        self.run(out, cancel)
    }

    fn run(&self, out: &Path, cancel: &Cancel) -> Result<Replayed, BundleError> {
        let schema = &self.ty.schema;
        let origin = self.record.origin.as_deref().map(Arc::from);
        let place = Place { base: self.folder.clone(), out: out.to_owned(), types: self.types.clone(), origin };
        let args = schema.inputs.iter().map(|input| self.input(input, &place)).collect::<Result<Vec<Arg>, _>>()?;
        let state_type = || self.ty.operator.state_type().ok_or_else(|| self.no_record("a state, of a node that has none"));
        let state = self.record.state.as_ref().map(|saved| self.read(saved, &state_type()?)).transpose()?;
        let known = |(name, clock): &(String, Clock)| schema.input(name).map(|(_, input)| (input.name, Arc::new(clock.clone())));
        let input_clocks: Vec<_> = self.record.input_clocks.iter().filter_map(known).collect();
        let frame = self.record.frame.unwrap_or(self.record.clock.first);
        let cx = Context { frame, clock: &self.record.clock, input_clocks: &input_clocks, cancel };
        let computed = catch_unwind(AssertUnwindSafe(|| self.ty.operator.compute(args, state, &cx)));
        let computed = computed.unwrap_or_else(|p| Err(panicked(p.as_ref()))).and_then(|computed| self.whole(computed));
        Ok(match computed {
            Ok(computed) => Replayed::Fine(computed),
            Err(error) => {
                let error = self.as_in_the_run(error, out);
                if error == self.record.error { Replayed::Same } else { Replayed::Other(error) }
            }
        })
    }

    /// Writes the outputs of a replay into `out`: `OUTPUT.npz`, or `OUTPUT@FRAME.npz` for a stream whose values differ in extents; gives the files.
    ///
    /// # Errors
    /// Where a file cannot be written; those before it are there.
    pub fn write_outputs(&self, computed: &Computed, out: &Path) -> Result<Vec<PathBuf>, BundleError> {
        let mut files = Vec::new();
        for (schema, value) in self.ty.schema.outputs.iter().zip(&computed.outputs) {
            let path = |tail: String| out.join(format!("{}{tail}.npz", schema.name));
            let one = |value: &ValueRef, path: PathBuf| {
                atomic::write(&path, |to| npz::write(value.as_ref(), false, to)).map(|()| path).map_err(Box::new)
            };
            match value {
                OutValue::One(value) => files.push(one(value, path(String::new()))?),
                OutValue::Stream(values) => {
                    let frames: Vec<i64> = self.record.clock.frames().collect();
                    let whole = path(String::new());
                    match atomic::write(&whole, |to| npz::write_stream(&frames, |idx| Ok(values[idx].clone()), false, to)) {
                        Ok(()) => files.push(whole),
                        Err(WriteError::Contents { source: NpzError::Uneven { .. }, .. }) => {
                            for (frame, value) in frames.iter().zip(values) {
                                files.push(one(value, path(format!("@{frame}")))?);
                            }
                        }
                        Err(error) => return Err(Box::new(error).into()),
                    }
                }
            }
        }
        Ok(files)
    }

    /// What the executor refuses to take from a node.
    fn whole(&self, computed: Computed) -> Result<Computed, NodeError> {
        let (outputs, frames) = (&self.ty.schema.outputs, self.record.clock.len());
        if computed.outputs.len() != outputs.len() {
            return Err(NodeError::internal("a node gave another number of outputs than it declares"));
        }
        for (schema, value) in outputs.iter().zip(&computed.outputs) {
            if let OutValue::Stream(values) = value
                && (values.len() != frames || !schema.stream)
            {
                return Err(NodeError::internal(format!("expected {frames} frames of `{}`, found {}", schema.name, values.len())));
            }
        }
        Ok(computed)
    }

    fn no_record(&self, found: &str) -> BundleError {
        BundleError::Record { path: self.folder.clone(), found: found.to_owned() }
    }

    fn input(&self, input: &InputSchema, place: &Place) -> Result<Arg, BundleError> {
        let refused = |reason: String| BundleError::Input { input: input.name.to_owned(), reason };
        let saved = self.record.inputs.iter().find(|i| i.name == input.name);
        match &saved.ok_or_else(|| refused(format!("expected it in {RECORD}, found none")))?.given {
            Given::Literal(text) => {
                let (value, _) = (input.parse)(text, place).map_err(|e| refused(e.message))?;
                // A record may have been written by anybody.
                let outside = input.files == FileUse::Write && setting::<OutputPath>(&value).is_some_and(|p| !p.is_inside());
                if outside {
                    Err(refused(format!("expected a path inside the output folder, found {text}")))
                } else {
                    Ok(Arg::Literal(value))
                }
            }
            given => self.arg(input.name, given),
        }
    }

    fn arg(&self, input: &str, given: &Given) -> Result<Arg, BundleError> {
        Ok(match given {
            Given::Nothing => Arg::None,
            Given::Literal(_) => return Err(self.no_record(&format!("a literal in the list at input `{input}`"))),
            Given::Value(saved) => Arg::Value(self.value(saved)?),
            Given::Frames(list) => {
                Arg::Frames(list.iter().map(|(frame, saved)| Ok((*frame, self.value(saved)?))).collect::<Result<_, BundleError>>()?)
            }
            Given::Sequence { clock, values } => {
                let values =
                    values.iter().map(|s| Ok((inside(&self.folder, &s.file)?, self.type_of(s)?))).collect::<Result<_, BundleError>>()?;
                Arg::Sequence(SequenceRef::new(clock.clone().map(Arc::new), OnDisk(values)))
            }
            Given::List(list) => Arg::List(list.iter().map(|g| self.arg(input, g)).collect::<Result<_, _>>()?),
        })
    }

    fn type_of(&self, saved: &SavedValue) -> Result<ValueType, BundleError> {
        self.types
            .get(&saved.ty)
            .cloned()
            .ok_or_else(|| self.no_record(&format!("{} of the unknown value type `{}`", saved.file, saved.ty)))
    }

    fn value(&self, saved: &SavedValue) -> Result<ValueRef, BundleError> {
        self.read(saved, &self.type_of(saved)?)
    }

    fn read(&self, saved: &SavedValue, ty: &ValueType) -> Result<ValueRef, BundleError> {
        let path = inside(&self.folder, &saved.file)?;
        read_value(&path, ty).map_err(|source| BundleError::Value { path, source: source.into() })
    }

    /// An error with the paths that the run had in place of those of the bundle and the replay, so that it can be held against that of the run.
    fn as_in_the_run(&self, error: NodeError, out: &Path) -> NodeError {
        let separator = std::path::MAIN_SEPARATOR;
        let below = |folder: &str| {
            if folder.is_empty() || folder.ends_with(separator) { folder.to_owned() } else { format!("{folder}{separator}") }
        };
        let folders = self.record.folders.iter().map(|(here, there)| (self.folder.join(here), there));
        let written = self.record.out.iter().map(|there| (out.to_owned(), there));
        let moved: Vec<(String, String)> =
            folders.chain(written).map(|(here, there)| (below(&here.display().to_string()), below(there))).collect();
        let told = |text: String| moved.iter().fold(text, |text, (here, there)| text.replace(here, there));
        NodeError { message: told(error.message), help: error.help.map(told), ..error }
    }
}

/// Values of a sequence, each read when it is asked for.
struct OnDisk(Vec<(PathBuf, ValueType)>);

impl Values for OnDisk {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        let past = || NodeError::internal(format!("frame {idx} of a sequence of {} was read", self.0.len()));
        let (path, ty) = self.0.get(idx).ok_or_else(past)?;
        read_value(path, ty).map_err(|e| NodeError::io(path, e))
    }
}

fn read_value(path: &Path, ty: &ValueType) -> Result<ValueRef, NpzError> {
    Archive::open(BufReader::new(File::open(path)?), MAX_BYTES)?.value(ty)
}

fn read_record(folder: &Path) -> Result<Record, BundleError> {
    let refused = |found: String| BundleError::Record { path: folder.to_owned(), found };
    let path = folder.join(RECORD);
    let text = std::fs::read_to_string(&path).map_err(|e| refused(format!("no {RECORD} that can be read: {e}")))?;
    let damaged = |e: serde_json::Error| refused(format!("a {RECORD} that cannot be read: {e}"));
    let json: serde_json::Value = serde_json::from_str(&text).map_err(damaged)?;
    match json.get("format").and_then(serde_json::Value::as_u64) {
        Some(format) if format == u64::from(FORMAT) => serde_json::from_value(json).map_err(damaged),
        Some(format) => Err(refused(format!("one of format {format} where this Pegbar reads format {FORMAT}"))),
        None => Err(refused(format!("a {RECORD} without a format"))),
    }
}

/// The file `name` of a bundle; a record that was written by anybody may name others.
fn inside(folder: &Path, name: &str) -> Result<PathBuf, BundleError> {
    if !name.is_empty() && Path::new(name).components().all(|c| matches!(c, Component::Normal(_))) {
        return Ok(folder.join(name));
    }
    Err(BundleError::Record { path: folder.to_owned(), found: format!("`{name}`, a file outside of it") })
}
