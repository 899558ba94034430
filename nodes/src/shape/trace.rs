//! `shape.trace`: the outline of a matte.
//!
//! **Method** see [`crate::algo::trace`]: marching squares, to a fraction of a pixel.
//!
//! **Source** Lorensen, Cline, *Marching Cubes*, 1987, in the plane.
//!
//! **Fails when** nothing of the matte is above the threshold, unless `empty: nothing`.
//!
//! **Cost** O(pixels) a frame.
//!
//! ```ron
//! "outline": (type: "shape.trace", alpha: "@matte"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::trace::{Outline, on_border, trace};
use crate::data::{Matte, Shape};

/// What an empty matte gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Empty {
    /// An error.
    Error,
    /// A contour without points.
    Nothing,
}

/// The outline of a matte.
///
/// On screen it runs clockwise around the layer and anticlockwise around a hole. Where the layer leaves the picture it follows the border.
#[derive(Node)]
#[node(
    id = "shape.trace",
    version = 1,
    outputs = ShapeTraceOutputs,
    source = "Lorensen, Cline 1987",
    example = "\"outline\": (type: \"shape.trace\", alpha: \"@matte\")"
)]
pub(crate) struct ShapeTrace {
    /// The matte.
    alpha: In<Matte>,
    /// The coverage at which the outline lies. 0.5 is where a drawn edge is; less takes soft edges in.
    #[input(default = 0.5, range = 0.001..=0.999)]
    threshold: f64,
    /// Which outline, the largest by area being 1.
    #[input(default = 1, range = 1..=1000000)]
    rank: u32,
    /// Count the outlines of holes as well.
    #[input(default = false)]
    holes: bool,
    /// What a matte without such an outline gives.
    #[input(default = error)]
    empty: Empty,
}

/// The outline.
#[derive(Outputs)]
pub(crate) struct ShapeTraceOutputs {
    /// Closed; about one point for each pixel that it passes.
    shape: Shape,
    /// Area within, square pixels; negative for a hole.
    area: Curve,
    /// Outlines of the matte.
    count: Curve,
    /// Share of the outline that lies on the border of the picture, 0 to 1: above 0 the layer leaves the picture.
    on_border: Curve,
}

impl ShapeTrace {
    fn none(&self, found: usize) -> NodeError {
        let most = self.alpha.alpha().iter().fold(0.0f32, |m, a| m.max(*a));
        let message = format!(
            "expected at least {} outlines at coverage {}, found {found}; the largest coverage is {most}",
            self.rank, self.threshold
        );
        NodeError::input(message).help("`empty: nothing` gives a contour without points there")
    }
}

impl PerFrame for ShapeTrace {
    fn run(self, _cx: &Context) -> Result<ShapeTraceOutputs, NodeError> {
        let (width, height) = (self.alpha.width(), self.alpha.height());
        let mut found = trace(self.alpha.alpha(), width, height, self.threshold).map_err(|e| NodeError::input(e.to_string()))?;
        found.retain(|o| self.holes || o.area > 0.0);
        let count = found.len();
        let at = self.rank as usize - 1;
        let outline = match self.empty {
            _ if at < count => found.swap_remove(at),
            Empty::Nothing => Outline { points: Vec::new(), area: 0.0 },
            Empty::Error => return Err(self.none(count)),
        };
        let curve = |value| Curve { value };
        let on_border = curve(on_border(&outline.points, width, height));
        let shape = Shape { points: outline.points, closed: true };
        Ok(ShapeTraceOutputs { shape, area: curve(outline.area), count: curve(count as f64), on_border })
    }
}
