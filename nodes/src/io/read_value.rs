//! `io.read_value`: a value of any type from NumPy's `.npz` files.
//!
//! The arrays of the file are those of the value type named by `as`; texts stand in the `u8` array `meta`, a JSON object, and may be left out. A file
//! with an `i64` array `frames` is a stream: every array is stacked on a leading axis, and the node has one value a frame. With `####` in the path
//! every frame has a file of its own. Whole numbers and narrower floats become the type's own numbers where none changes its value.
//!
//! **Source**: NumPy Enhancement Proposal 1 (Kern 2007). **Fails when** the file is damaged or too large, or its arrays do not make such a value.
//! **Cost**: O(bytes of the value); a frame of a packed stream costs O(bytes of the stream).
//!
//! ```ron
//! Graph(pegbar: 1, nodes: { "keys": (type: "io.read_value", path: "hat.npz", as: "KeyShapes") }, outputs: { "keys": "@keys" })
//! ```

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use pegbar_engine::node::{Context, Fault, NodeError, PerFrame};
use pegbar_engine::npz::{Archive, MAX_BYTES, NpzError};
use pegbar_engine::setting::{ClockName, InputPath, Missing, TypeName};
use pegbar_engine::value::ValueRef;
use pegbar_engine::{Node, Outputs};

use super::file;

/// A value of the type that was asked for.
#[derive(Outputs)]
pub(crate) struct IoReadValueOutputs {
    /// The value; one a frame where the file is a stream, or the path has a frame number.
    value: ValueRef,
}

/// Reads a value of any type from `.npz`.
#[derive(Node)]
#[node(
    id = "io.read_value",
    version = 1,
    kind = source,
    outputs = IoReadValueOutputs,
    type_from = "as",
    source = "NumPy Enhancement Proposal 1",
    example = "\"keys\": (type: \"io.read_value\", path: \"hat.npz\", as: \"KeyShapes\")"
)]
pub(crate) struct IoReadValue {
    /// The file, from the graph's folder; or one a frame, with `####` or `%04d` where the frame number stands.
    path: InputPath,
    /// The value type, as `"KeyShapes"`; `pegbar types` lists them with their arrays.
    #[input(name = "as")]
    ty: TypeName,
    /// What stands at a frame that is not there.
    #[input(default = error)]
    missing: Missing,
    /// The clock whose frames are read; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
}

fn npz_error(path: &Path, error: NpzError) -> NodeError {
    let error = NodeError::from(error);
    NodeError { message: format!("{}: {error}", path.display()), ..error }
}

fn open(path: &Path) -> Result<Archive<BufReader<File>>, NodeError> {
    Archive::open(BufReader::new(file::open(path)?), MAX_BYTES).map_err(|e| npz_error(path, e))
}

/// The position of what stands at `frame` among `frames`, which may be in any order.
fn position(frames: &[i64], frame: i64, missing: Missing) -> Option<usize> {
    let held = |f: i64| (f <= frame).then(|| frame.abs_diff(f));
    let distance = |f: i64| match missing {
        Missing::Error => (f == frame).then_some(0),
        Missing::Hold => held(f),
        Missing::Nearest => Some(frame.abs_diff(f)),
    };
    // Of two as near, the earlier frame.
    let near = frames.iter().enumerate().filter_map(|(i, &f)| distance(f).map(|d| (d, f, i)));
    near.min().map(|(_, _, i)| i)
}

impl PerFrame for IoReadValue {
    fn is_per_frame(&self) -> bool {
        // A file that cannot be read is told when it is needed; here it says nothing of the rate.
        self.path.is_sequence() || open(&self.path.at(0)).ok().and_then(|mut a| a.frames().ok()).flatten().is_some()
    }

    fn run(self, cx: &Context) -> Result<IoReadValueOutputs, NodeError> {
        let ty =
            self.ty.get().ok_or_else(|| NodeError::new(Fault::Parameters, format!("expected a value type, found `{}`", self.ty.name())))?;
        let found = self.path.resolve(cx.frame, self.missing);
        let path = found.ok_or_else(|| {
            NodeError::new(Fault::Io, format!("expected a file of {} for frame {}, found none", self.path.pattern(), cx.frame))
        })?;
        let mut archive = open(&path)?;
        let failed = |e: NpzError| npz_error(&path, e);
        let value = match archive.frames().map_err(failed)? {
            Some(frames) if !self.path.is_sequence() => {
                let at = position(&frames, cx.frame, self.missing);
                let at = at.ok_or_else(|| {
                    let (first, last) = (frames.iter().min().copied().unwrap_or(0), frames.iter().max().copied().unwrap_or(0));
                    let message =
                        format!("{}: expected frame {}, found {} frames from {first} to {last}", path.display(), cx.frame, frames.len());
                    NodeError::new(Fault::Io, message).help("say what stands for a missing frame: `missing: hold` or `missing: nearest`")
                })?;
                archive.frame(ty, at, frames.len()).map_err(failed)?
            }
            _ => archive.value(ty).map_err(failed)?,
        };
        Ok(IoReadValueOutputs { value })
    }
}
