//! `io.write_value`: a value of any type to NumPy's `.npz` files.
//!
//! Every array of the value is an entry under its own name, texts are one JSON object in the `u8` array `meta`. A stream goes into one file, each
//! array stacked on a leading axis beside an `i64` array `frames`; or, with `####` in the path, into one file a frame, which frames of several shapes
//! need. `numpy.load` reads the files, and `io.read_value` gives back the same bits.
//!
//! **Source**: NumPy Enhancement Proposal 1 (Kern 2007). **Fails when** the frames of a stacked stream differ in shape, or the file cannot be written.
//! **Cost**: O(bytes); one frame is in memory, and for one file of a
//! stream each frame is read once for every array that it has.
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
        match (self.value.clock(), self.path.is_sequence()) {
            (Some(clock), true) => {
                for (k, frame) in clock.frames().enumerate() {
                    cx.check()?;
                    self.write(k, frame)?;
                }
                Ok(())
            }
            (Some(clock), false) => {
                let frames: Vec<i64> = clock.frames().collect();
                let value = |k| {
                    cx.check()?;
                    self.value.get(k)
                };
                file::write_read(&self.path.at(0), |out| npz::write_stream(&frames, value, self.compress, out))
            }
            (None, true) => {
                Err(NodeError::new(Fault::Parameters, "expected one value a frame for a path with ####, found one for the whole graph"))
            }
            (None, false) => self.write(0, 0),
        }
    }
}

impl IoWriteValue {
    /// The value at a position into the file of its frame.
    fn write(&self, idx: usize, frame: i64) -> Result<(), NodeError> {
        let value = self.value.get(idx)?;
        file::write(&self.path.at(frame), Fault::Io, |out| npz::write(value.as_ref(), self.compress, out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::{clock, counted};
    use crate::data::Image;
    use pegbar_engine::node::Cancel;
    use pegbar_engine::setting::{Place, Setting};

    /// Writes a stream of five pictures to a file of this name: the most that were alive at once, and how many were read.
    fn written(folder: &std::path::Path, name: &str) -> (usize, usize) {
        let place = Place { out: folder.to_owned(), ..Place::default() };
        let path = OutputPath::parse(&format!("\"{name}\"")).unwrap().bind(&place);
        let (value, count) = counted(5, |k| Image::new(2, 2, 1, vec![k as f32; 4]).unwrap());
        let clock = clock(5);
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
        IoWriteValue { value, path, compress: false }.run(&cx).unwrap();
        (count.peak(), count.reads())
    }

    #[test]
    fn one_frame_is_held_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        // The first is read once more, for what all are to be like.
        assert_eq!(written(folder.path(), "all.npz"), (1, 6));
        assert_eq!(written(folder.path(), "one.####.npz"), (1, 5));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 6);
    }
}
