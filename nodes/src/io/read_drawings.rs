//! `io.read_drawings`: vector drawings from SVG.
//!
//! Every path that is seen, with its flat paint, in the order of the file, which is their depth; groups are parts, of which one can be picked. One
//! file for all frames, one a frame (`####` in the path), or one file with a layer a frame. Drawings that `io.write_drawings` wrote come back bit by bit.
//!
//! **Source**: W3C, Scalable Vector Graphics 1.1. **Fails when** the file is no SVG, an attribute has a mistake, or nothing is drawn. A gradient is the
//! mean of its colours; text, pictures, clips, masks, filters, markers and dashes are not read. **Cost**: O(bytes of the file + points) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, nodes: { "frog": (type: "io.read_drawings", path: "frog.svg", group: "head") }, outputs: { "frog": "@frog" })
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::{ClockName, InputPath, Missing};
use pegbar_engine::{Node, Outputs};

use super::read_shapes::{file_of, sampling};
use super::svg::{Pick, drawings, load};
use crate::data::Drawing;

/// The drawing.
#[derive(Outputs)]
pub(crate) struct IoReadDrawingsOutputs {
    /// Its paths, the first at the bottom; pixels of the picture's size.
    drawing: Drawing,
}

/// Reads vector drawings from SVG.
#[derive(Node)]
#[node(
    id = "io.read_drawings",
    version = 1,
    kind = source,
    outputs = IoReadDrawingsOutputs,
    source = "W3C, Scalable Vector Graphics 1.1",
    example = "\"frog\": (type: \"io.read_drawings\", path: \"frog.svg\", group: \"head\")"
)]
pub(crate) struct IoReadDrawings {
    /// The file, from the graph's folder; or one a frame, with `####` or `%04d` where the frame number stands.
    path: InputPath,
    /// Id or label of the group, or of the path, that is read. All that is drawn where it is left out.
    #[input(default = None)]
    group: Option<String>,
    /// True where the drawing has a layer a frame, the first one for the clock's first frame.
    #[input(default = false)]
    layers: bool,
    /// How far straight lines may be from curves. Small gives more points.
    #[input(default = 0.1, range = 0.0001..=1000.0, unit = "px")]
    tolerance: f64,
    /// Steps on each segment between two nodes, straight ones too. 0 takes as many as the tolerance asks for.
    #[input(default = 0, range = 0..=1000)]
    per_segment: u32,
    /// What stands at a frame whose file is not there.
    #[input(default = error)]
    missing: Missing,
    /// The clock whose frames are read; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
}

impl PerFrame for IoReadDrawings {
    fn is_per_frame(&self) -> bool {
        self.path.is_sequence() || self.layers
    }

    fn run(self, cx: &Context) -> Result<IoReadDrawingsOutputs, NodeError> {
        let sampling = sampling(self.tolerance, self.per_segment)?;
        let sheet = load(&file_of(&self.path, self.missing, cx.frame)?)?;
        let layer = if self.layers { Some(sheet.layer(cx.frame - cx.clock.first)?) } else { None };
        let pick = Pick { sheet: &sheet, layer, id: self.group.as_deref(), name: String::new() };
        let drawing = drawings(&[pick], sampling)?.pop();
        Ok(IoReadDrawingsOutputs { drawing: drawing.ok_or_else(|| NodeError::internal("no drawing of one"))? })
    }
}
