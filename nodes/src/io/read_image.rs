//! `io.read_image`: one picture from a file.
//!
//! PNG, JPEG, TIFF and OpenEXR are told apart by their first bytes, not by their names. Whatever the file holds becomes linear light with
//! premultiplied alpha in 32-bit floating point; a layer of an OpenEXR file is chosen by its name.
//!
//! **Source**: W3C PNG (third edition), ITU-T T.81, TIFF 6.0, OpenEXR 2 file layout; IEC 61966-2-1 for sRGB.
//! **Fails when** the file is not there, damaged, larger than `max_samples`, or of a kind that is not read. **Cost**: O(samples).
//!
//! ```ron
//! Graph(pegbar: 1, nodes: { "hat": (type: "io.read_image", path: "art/hat.png") }, outputs: { "hat": "@hat" })
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame, Problem};
use pegbar_engine::setting::InputPath;
use pegbar_engine::{Node, Outputs};

use crate::algo::codec::DecodeOptions;
use crate::data::Image;

use super::picture::{self, Color};

/// A picture.
#[derive(Outputs)]
pub(crate) struct IoReadImageOutputs {
    /// The picture: linear light, premultiplied alpha.
    image: Image,
}

/// Reads one picture: PNG, JPEG, TIFF or OpenEXR.
#[derive(Node)]
#[node(
    id = "io.read_image",
    version = 1,
    kind = source,
    outputs = IoReadImageOutputs,
    source = "PNG, JPEG, TIFF 6.0 and OpenEXR specifications",
    example = "\"art\": (type: \"io.read_image\", path: \"art/witch_hat.png\")"
)]
pub(crate) struct IoReadImage {
    /// The file, from the graph's folder.
    path: InputPath,
    /// What its numbers mean.
    #[input(default = auto)]
    color: Color,
    /// The layer, part, view or channel of an OpenEXR file, as `beauty` or `depth.Z`; `None` for its main colours, `*` for every channel.
    #[input(default = None)]
    layer: Option<String>,
    /// The most samples (width x height x channels) that are read; more is an error before anything is allocated.
    #[input(default = 1073741824, range = 1..=68719476736u64)]
    max_samples: u64,
}

impl PerFrame for IoReadImage {
    fn check(&self) -> Vec<Problem> {
        let message = "expected one file, found a frame number in the path: `io.read_images` reads one picture a frame";
        if self.path.is_sequence() { vec![Problem { input: "path", message: message.to_owned() }] } else { Vec::new() }
    }

    fn run(self, cx: &Context) -> Result<IoReadImageOutputs, NodeError> {
        let options = DecodeOptions { color: self.color.into(), layer: self.layer, max_samples: self.max_samples, threads: 0 };
        Ok(IoReadImageOutputs { image: picture::read(&self.path.at(cx.frame), &options)? })
    }
}
