//! `comp.mask`: cuts a picture out with a matte.
//!
//! **Method** every channel times the matte (or what is left of it), which keeps premultiplied pictures premultiplied; a picture without alpha gets the matte as its alpha.
//!
//! **Source** usual practice.
//!
//! **Fails when** the matte is not of the picture's format.
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
    /// What is kept: a matte of the picture's format. Nothing outside it.
    matte: In<Matte>,
    /// Keeps what the matte leaves out instead.
    #[input(default = false)]
    invert: bool,
}

impl PerFrame for CompMask {
    fn run(self, _cx: &Context) -> Result<Merged, NodeError> {
        let mut image = with_alpha(self.image)?;
        let (window, display, channels) = (image.data_window(), image.display_window(), image.n_channels());
        let (width, height) = (self.matte.width() as i64, self.matte.height() as i64);
        if (width, height) != (display.width as i64, display.height as i64) {
            return Err(NodeError::input(format!(
                "expected a matte of {} x {}, the picture's format, found {width} x {height}",
                display.width, display.height
            )));
        }
        for (j, row) in image.samples_mut().chunks_exact_mut((window.width * channels).max(1)).enumerate() {
            let y = window.y - display.y + j as i64;
            for (i, pixel) in row.chunks_exact_mut(channels).enumerate() {
                let x = window.x - display.x + i as i64;
                let inside = (0..width).contains(&x) && (0..height).contains(&y);
                let alpha = if inside { self.matte.alpha()[(y * width + x) as usize] } else { 0.0 };
                let keep = if self.invert { 1.0 - alpha } else { alpha };
                pixel.iter_mut().for_each(|v| *v *= keep);
            }
        }
        Ok(Merged { image })
    }
}
