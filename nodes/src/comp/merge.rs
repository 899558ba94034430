//! `comp.merge`: merges two pictures by one of the usual formulas.
//!
//! **Method** see [`crate::algo::merge`]; A is the foreground, B the background, a and b their alphas.
//!
//! **Source** T. Porter, T. Duff, *Compositing Digital Images*, 1984; the other formulas as compositing programs have them.
//!
//! **Fails when** never for finite pictures.
//!
//! **Cost** O(samples), one pass.
//!
//! ```ron
//! "lit": (type: "comp.merge", fg: "@glow", bg: "@plate", operation: screen),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Merged, merged};
use crate::algo::merge::Operation;
use crate::data::Image;

/// Merges two pictures by one of the usual formulas.
///
/// Both are premultiplied. A picture without alpha is opaque inside its data window.
#[derive(Node)]
#[node(
    id = "comp.merge",
    version = 1,
    outputs = Merged,
    source = "Porter, Duff 1984",
    example = "\"lit\": (type: \"comp.merge\", fg: \"@glow\", bg: \"@plate\", operation: screen)"
)]
pub(crate) struct CompMerge {
    /// The picture in front: A of the formulas.
    fg: In<Image>,
    /// The picture behind: B of the formulas.
    bg: In<Image>,
    /// The formula.
    #[input(default = over)]
    operation: Operation,
    /// Weight of the result against the untouched background: 0 leaves the background alone.
    #[input(default = 1.0, range = 0.0..=1.0)]
    opacity: f64,
}

impl PerFrame for CompMerge {
    fn run(self, _cx: &Context) -> Result<Merged, NodeError> {
        merged(self.fg, self.bg, self.operation, self.opacity)
    }
}
