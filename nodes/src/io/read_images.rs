//! `io.read_images`: one picture a frame, from numbered files.
//!
//! The file of a frame is the path with the frame's number in place of `####` (or `%04d`). Holes in the numbers are an error before anything runs,
//! or are filled with the frame before them (drawings shot on twos) or with the nearest. Files are read as `io.read_image` reads them.
//!
//! **Source**: as `io.read_image`. **Fails when** a frame's file is not there, damaged, larger than `max_samples`, or of a kind that is not read.
//! **Cost**: O(samples) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: { "plate": (type: "io.read_images", path: "plate/hat.####.png", missing: hold) }, outputs: { "plate": "@plate" })
//! ```

use pegbar_engine::node::{Context, Fault, NodeError, PerFrame, Problem};
use pegbar_engine::setting::{ClockName, InputPath, Missing};
use pegbar_engine::{Node, Outputs};

use crate::algo::codec::DecodeOptions;
use crate::data::Image;

use super::picture::{self, Color};

/// A picture a frame.
#[derive(Outputs)]
pub(crate) struct IoReadImagesOutputs {
    /// The picture of the frame: linear light, premultiplied alpha.
    image: Image,
}

/// Reads one picture a frame: PNG, JPEG, TIFF or OpenEXR.
#[derive(Node)]
#[node(
    id = "io.read_images",
    version = 1,
    kind = source,
    outputs = IoReadImagesOutputs,
    source = "PNG, JPEG, TIFF 6.0 and OpenEXR specifications",
    example = "\"plate\": (type: \"io.read_images\", path: \"plate/hat.####.png\", missing: hold)"
)]
pub(crate) struct IoReadImages {
    /// The files, from the graph's folder, with `####` or `%04d` where the frame number stands.
    path: InputPath,
    /// What their numbers mean.
    #[input(default = auto)]
    color: Color,
    /// What stands at a frame whose file is not there.
    #[input(default = error)]
    missing: Missing,
    /// The layer, part, view or channel of OpenEXR files, as `beauty` or `depth.Z`; `None` for their main colours, `*` for every channel.
    #[input(default = None)]
    layer: Option<String>,
    /// The clock whose frames are read; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
    /// The most samples (width x height x channels) that are read; more is an error before anything is allocated.
    #[input(default = 1073741824, range = 1..=68719476736u64)]
    max_samples: u64,
}

impl PerFrame for IoReadImages {
    fn check(&self) -> Vec<Problem> {
        let message = "expected a frame number as #### in the path, found none: `io.read_image` reads one picture";
        if self.path.is_sequence() { Vec::new() } else { vec![Problem { input: "path", message: message.to_owned() }] }
    }

    fn run(self, cx: &Context) -> Result<IoReadImagesOutputs, NodeError> {
        let found = self.path.resolve(cx.frame, self.missing);
        let path = found.ok_or_else(|| {
            let message = format!("expected a file of {} for frame {}, found none", self.path.pattern(), cx.frame);
            NodeError::new(Fault::Io, message).help("`missing: nearest` also takes later frames")
        })?;
        // Frames are read side by side, so each stays on its own thread.
        let options = DecodeOptions { color: self.color.into(), layer: self.layer, max_samples: self.max_samples, threads: 1 };
        Ok(IoReadImagesOutputs { image: picture::read(&path, &options)? })
    }
}
