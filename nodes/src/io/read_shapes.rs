//! `io.read_shapes`: a contour from SVG drawings.
//!
//! One file for all frames, one a frame (`####` in the path), or one file with a layer a frame. Curves become straight lines at even steps of their
//! parameter; with `per_segment` drawings of the same nodes have the same points at every frame. Pixels are those of the picture's size.
//!
//! **Source**: W3C, Scalable Vector Graphics 1.1. **Fails when** the file is no SVG, an outline has a mistake, or the choice is not one contour.
//! **Cost**: O(bytes of the file + points) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: { "arm": (type: "io.read_shapes", path: "arm.####.svg", id: "arm", missing: hold) }, outputs: { "arm": "@arm" })
//! ```

use pegbar_engine::node::{Context, Fault, NodeError, PerFrame};
use pegbar_engine::setting::{ClockName, InputPath, Missing};
use pegbar_engine::{Node, Outputs};

use super::svg::{Pick, contours, load};
use crate::algo::svg::Sampling;
use crate::data::Shape;

/// The contour.
#[derive(Outputs)]
pub(crate) struct IoReadShapesOutputs {
    /// Points, pixels; closed where the drawing closes it.
    shape: Shape,
}

/// Reads a contour from SVG drawings.
#[derive(Node)]
#[node(
    id = "io.read_shapes",
    version = 1,
    kind = source,
    outputs = IoReadShapesOutputs,
    source = "W3C, Scalable Vector Graphics 1.1",
    example = "\"arm\": (type: \"io.read_shapes\", path: \"arm.####.svg\", id: \"arm\", missing: hold)"
)]
pub(crate) struct IoReadShapes {
    /// The file, from the graph's folder; or one a frame, with `####` or `%04d` where the frame number stands.
    path: InputPath,
    /// Id or label of the path, or of a group that it is in. Any where it is left out.
    #[input(default = None)]
    id: Option<String>,
    /// Which contour of those that are left, from 1 in the order of the drawing. The only one where it is left out.
    #[input(default = None, range = 1..=1000000)]
    which: Option<u32>,
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

impl PerFrame for IoReadShapes {
    fn is_per_frame(&self) -> bool {
        self.path.is_sequence() || self.layers
    }

    fn run(self, cx: &Context) -> Result<IoReadShapesOutputs, NodeError> {
        let sampling = sampling(self.tolerance, self.per_segment)?;
        let sheet = load(&file_of(&self.path, self.missing, cx.frame)?)?;
        let layer = if self.layers { Some(sheet.layer(cx.frame - cx.clock.first)?) } else { None };
        let pick = Pick { sheet: &sheet, layer, id: self.id.as_deref(), name: String::new() };
        let (element, line) = pick.contour(self.which)?;
        let points = contours(&[(pick, element, line)], sampling)?.pop().unwrap_or_default();
        Ok(IoReadShapesOutputs { shape: Shape { points, closed: line.closed } })
    }
}

/// The file of a frame.
pub(super) fn file_of(path: &InputPath, missing: Missing, frame: i64) -> Result<std::path::PathBuf, NodeError> {
    path.resolve(frame, missing).ok_or_else(|| {
        let message = format!("expected a file of {} for frame {frame}, found none", path.pattern());
        NodeError::new(Fault::Io, message).help("`missing: nearest` also takes later frames")
    })
}

/// How outlines become points; a tolerance may be wired, so that its range is held here too.
pub(super) fn sampling(tolerance: f64, per_segment: u32) -> Result<Sampling, NodeError> {
    if (1e-4..=1e3).contains(&tolerance) {
        return Ok(Sampling { tolerance, per_segment: per_segment as usize });
    }
    Err(NodeError::new(Fault::Parameters, format!("expected `tolerance` from 0.0001 to 1000, found {tolerance}")))
}
