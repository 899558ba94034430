//! Failure bundles: a task that failed, with all that it was given, in a folder from which it can be run alone on another machine.
//!
//! A bundle is a folder `NODE@FRAME`, or `NODE` for a node that runs once. In it are `failure.json` (this module's record of the task), each value that
//! stood at an input as `inputs/INPUT.npz`, the state that a recurrent node starts from as `state.npz`, and copies of the files that the node
//! reads below `files/`. Of a list of references the values are `INPUT.0.npz`, `INPUT.1.npz`; of several frames `INPUT@FRAME.npz`, one file each, so
//! that a sequence need not fit into memory. Settings that name files are written anew, so that nothing points out of the folder; the names that
//! they had are kept for messages alone. The record holds a digest of every file, so that a bundle that was damaged on its way is refused.

mod replay;
mod save;

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::atomic::WriteError;
use crate::clock::Clock;
use crate::node::{Literal, NodeError};
use crate::npz::NpzError;

pub use replay::{Bundle, Replayed};
pub use save::{folder_name, save};

/// The form of `failure.json`.
const FORMAT: u32 = 1;
/// The record's name.
const RECORD: &str = "failure.json";

/// Why a bundle is not saved, or not replayed.
#[derive(Debug, Error)]
pub enum BundleError {
    /// The run kept no inputs.
    #[error("expected what node `{node}` was given, found that the run did not keep it")]
    NotKept {
        /// The node's name.
        node: String,
    },
    /// The file system refused.
    #[error("{path}: {step} failed: {source}", path = .path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What was being done.
        step: &'static str,
        /// Why it failed.
        source: io::Error,
    },
    /// Something stands where the bundle is to be.
    #[error("expected an older bundle or nothing at {path}, found something else; choose another folder", path = .path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// A value cannot be written or read.
    #[error("{path}: {source}", path = .path.display())]
    Value {
        /// Its file.
        path: PathBuf,
        /// Why not.
        source: Box<NpzError>,
    },
    /// A value of a sequence could not be had.
    #[error("input `{input}`: {source}")]
    Sequence {
        /// The input.
        input: String,
        /// Why not.
        source: NodeError,
    },
    /// The folder is no bundle, or its record cannot be read.
    #[error("expected a failure bundle at {path}, found {found}", path = .path.display())]
    Record {
        /// The folder.
        path: PathBuf,
        /// What was found.
        found: String,
    },
    /// A file of the bundle is not as it was saved.
    #[error("expected {path} as it was saved, found {found}; copy the bundle again", path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: &'static str,
    },
    /// The node type is not in the registry.
    #[error("expected a node type of this Pegbar, found `{id}`, saved by Pegbar {saved_by}; replay the bundle with the plugins of the run")]
    UnknownNode {
        /// The type's id.
        id: String,
        /// The version of Pegbar that saved the bundle.
        saved_by: String,
    },
    /// The node type behaves in another way than that of the run.
    #[error("expected version {saved} of `{id}`, as saved by Pegbar {saved_by}, found version {here}; replay the bundle with that Pegbar")]
    OtherVersion {
        /// The type's id.
        id: String,
        /// The version of the run.
        saved: u32,
        /// The version in the registry.
        here: u32,
        /// The version of Pegbar that saved the bundle.
        saved_by: String,
    },
    /// An output of a replay cannot be written.
    #[error(transparent)]
    Output(#[from] Box<WriteError<NpzError>>),
    /// An input cannot be put together again.
    #[error("input `{input}`: {reason}")]
    Input {
        /// The input.
        input: String,
        /// Why not.
        reason: String,
    },
}

fn file_error(path: &Path, step: &'static str) -> impl FnOnce(io::Error) -> BundleError {
    move |source| BundleError::File { path: path.to_owned(), step, source }
}

/// `failure.json`.
#[derive(Debug, Deserialize, Serialize)]
struct Record {
    format: u32,
    /// Version of Pegbar.
    pegbar: String,
    node: String,
    #[serde(rename = "type")]
    ty: String,
    version: u32,
    /// `None` for a node that runs once.
    frame: Option<i64>,
    error: NodeError,
    /// Each wired input: name, type, and extents of its first array.
    shapes: Vec<String>,
    clock: Clock,
    input_clocks: Vec<(String, Clock)>,
    inputs: Vec<SavedInput>,
    state: Option<SavedValue>,
    /// Where the files that are read lay: the folder in the bundle, and that of the run.
    folders: Vec<(String, String)>,
    /// The output folder of the run, for a node that writes.
    out: Option<String>,
    /// What the files that it writes say of their making.
    #[serde(default)]
    origin: Option<String>,
    /// Of each file beside this one, by name.
    digests: BTreeMap<String, String>,
}

#[derive(Debug, Deserialize, Serialize)]
struct SavedInput {
    name: String,
    /// What is wired to it.
    wires: Vec<SavedWire>,
    given: Given,
}

#[derive(Debug, Deserialize, Serialize)]
struct SavedWire {
    port: String,
    #[serde(rename = "type")]
    ty: String,
}

/// What stood at an input.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum Given {
    Nothing,
    Literal(String),
    Value(SavedValue),
    Frames(Vec<(i64, SavedValue)>),
    Sequence { clock: Option<Clock>, values: Vec<SavedValue> },
    List(Vec<Given>),
}

/// A value in a file of its own.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct SavedValue {
    #[serde(rename = "type")]
    ty: String,
    file: String,
}

/// A setting of type `T`, or one that may be left out and is not.
fn setting<T: Clone + 'static>(value: &Literal) -> Option<T> {
    value.downcast_ref::<T>().cloned().or_else(|| value.downcast_ref::<Option<T>>().cloned().flatten())
}

fn digest(path: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(hasher.finalize().to_hex().to_string())
}
