//! `io.write_value`: a value of any type to NumPy's `.npz` files.
//!
//! Every array of the value is an entry under its own name, texts are one JSON object in the `u8` array `meta`. A stream goes into one file, each
//! array stacked on a leading axis beside an `i64` array `frames`; or, with `####` in the path, into one file a frame, which frames of several shapes
//! need. `numpy.load` reads the files, and `io.read_value` gives back the same bits.
//!
//! **Source**: NumPy Enhancement Proposal 1 (Kern 2007). **Fails when** the frames of a stacked stream differ in shape, or the file cannot be written.
//! **Cost**: O(bytes); all frames are in memory.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "in": (type: "io.read_value", path: "weights.npz", as: "Weights"),
//!     "out": (type: "io.write_value", value: "@in", path: "$out/weights.npz", compress: true),
//! })
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnySequence, Context, Fault, NodeError, Problem, Whole};
use pegbar_engine::npz;
use pegbar_engine::setting::OutputPath;

use super::file;

/// Writes a value of any type to `.npz`.
#[derive(Node)]
#[node(
    id = "io.write_value",
    version = 1,
    kind = whole,
    source = "NumPy Enhancement Proposal 1",
    example = "\"saved\": (type: \"io.write_value\", value: \"@track.motion\", path: \"$out/motion.npz\")"
)]
pub(crate) struct IoWriteValue {
    /// The value, or the stream.
    value: AnySequence,
    /// The file, inside the output folder, ending in .npz; with `####` or `%04d` for one file a frame.
    path: OutputPath,
    /// True for smaller files that take longer, as of `numpy.savez_compressed`.
    #[input(default = false)]
    compress: bool,
}

impl Whole for IoWriteValue {
    fn check(&self) -> Vec<Problem> {
        let path = self.path.at(0);
        let message = || format!("expected a path ending in .npz, found {}", path.file_name().unwrap_or_default().to_string_lossy());
        let fine = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        if fine { Vec::new() } else { vec![Problem { input: "path", message: message() }] }
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let values = &self.value.gather()?;
        match (self.value.clock(), self.path.is_sequence()) {
            (Some(clock), true) => {
                for (frame, value) in clock.frames().zip(values) {
                    cx.check()?;
                    file::write(&self.path.at(frame), Fault::Io, |out| npz::write(value.as_ref(), self.compress, out))?;
                }
                Ok(())
            }
            (Some(clock), false) => {
                let frames: Vec<i64> = clock.frames().collect();
                file::write(&self.path.at(0), Fault::Input, |out| npz::write_stream(&frames, values, self.compress, out))
            }
            (None, true) => {
                Err(NodeError::new(Fault::Parameters, "expected one value a frame for a path with ####, found one for the whole graph"))
            }
            (None, false) => {
                let value = values.first().ok_or_else(|| NodeError::internal("expected a value, found none"))?;
                file::write(&self.path.at(0), Fault::Io, |out| npz::write(value.as_ref(), self.compress, out))
            }
        }
    }
}
