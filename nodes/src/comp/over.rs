//! `comp.over`: lays one picture over another.
//!
//! **Method** premultiplied over, A + B (1 - a), see [`crate::algo::merge`]; in place where nobody else reads the background, or the foreground.
//!
//! **Source** T. Porter, T. Duff, *Compositing Digital Images*, 1984.
//!
//! **Fails when** never for finite pictures.
//!
//! **Cost** O(samples), one pass.
//!
//! ```ron
//! "comp": (type: "comp.over", fg: "@swap", bg: "@plate"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Merged, merged};
use crate::algo::merge::Operation;
use crate::data::Image;

/// Lays one picture over another.
///
/// Both are premultiplied. A picture without alpha is opaque inside its data window. The result has the background's display window.
#[derive(Node)]
#[node(
    id = "comp.over",
    version = 1,
    outputs = Merged,
    source = "Porter, Duff 1984",
    example = "\"comp\": (type: \"comp.over\", fg: \"@swap\", bg: \"@plate\")"
)]
pub(crate) struct CompOver {
    /// What lies on top.
    fg: In<Image>,
    /// What lies below.
    bg: In<Image>,
    /// Opacity of the foreground: 0 leaves the background alone, 1 lays all of it on.
    #[input(default = 1.0, range = 0.0..=1.0)]
    opacity: f64,
}

impl PerFrame for CompOver {
    fn run(self, _cx: &Context) -> Result<Merged, NodeError> {
        merged(self.fg, self.bg, Operation::Over, self.opacity)
    }
}
