//! `comp.mask`: cuts a picture out with a matte.
//!
//! **Method** every channel times the matte (or what is left of it), which keeps premultiplied pictures premultiplied; a picture without alpha gets the matte as its alpha.
//!
//! **Source** usual practice.
//!
//! **Fails when** picture and matte have different sizes.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "layer": (type: "comp.mask", image: "@plate", matte: "@matte"),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{Merged, with_alpha};
use crate::data::{Image, Matte};

/// Cuts a picture out with a matte.
#[derive(Node)]
#[node(
    id = "comp.mask",
    version = 1,
    outputs = Merged,
    example = "\"layer\": (type: \"comp.mask\", image: \"@plate\", matte: \"@matte\")"
)]
pub(crate) struct CompMask {
    /// The picture.
    image: In<Image>,
    /// What is kept, in the picture's data window.
    matte: In<Matte>,
    /// Keeps what the matte leaves out instead.
    #[input(default = false)]
    invert: bool,
}

impl PerFrame for CompMask {
    fn run(self, _cx: &Context) -> Result<Merged, NodeError> {
        let mut image = with_alpha(self.image)?;
        let (size, found) = ((image.width(), image.height()), (self.matte.width(), self.matte.height()));
        if size != found {
            return Err(NodeError::input(format!("expected a matte of {} x {}, found {} x {}", size.0, size.1, found.0, found.1)));
        }
        let channels = image.n_channels();
        for (pixel, &alpha) in image.samples_mut().chunks_exact_mut(channels).zip(self.matte.alpha()) {
            let keep = if self.invert { 1.0 - alpha } else { alpha };
            pixel.iter_mut().for_each(|v| *v *= keep);
        }
        Ok(Merged { image })
    }
}
