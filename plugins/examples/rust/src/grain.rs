//! The grain of paper under a picture.

use pegbar_plugin::prelude::*;
use pegbar_plugin::types::Image;

/// Lays the grain of paper under a picture: one sheet for a whole scene, or a new one every few frames.
#[derive(Node)]
#[node(id = "paper.grain", version = 1, outputs = PaperGrainOutputs, uses_frame, example = r#""sheet": (type: "paper.grain", image: "@ink", strength: 0.2)"#)]
pub(crate) struct PaperGrain {
    /// The picture.
    image: In<Image>,
    /// How much darker the deepest grain is; 0 leaves the picture as it is, 1 makes black.
    #[input(default = 0.15, range = 0.0..=1.0)]
    strength: f64,
    /// Frames that one sheet lasts; 0 keeps it for the whole scene.
    #[input(default = 0, range = 0..=1000, unit = "frames")]
    hold: i64,
    /// Which sheets are taken.
    #[input(default = 1)]
    seed: i64,
}

/// What it makes.
#[derive(Outputs)]
pub(crate) struct PaperGrainOutputs {
    /// The picture on paper.
    image: Image,
}

/// A number from 0 to 1 that depends on all the bits of three others.
pub(crate) fn noise(x: u64, y: u64, sheet: u64) -> f32 {
    let mut h = x.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f) ^ sheet.wrapping_mul(0x1656_67b1_9e37_79f9);
    h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 32)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 40) as f32 / (1u64 << 24) as f32
}

/// Fibres: fine grain on coarse.
fn height(x: usize, y: usize, sheet: u64) -> f32 {
    let (x, y) = (x as u64, y as u64);
    0.6 * noise(x, y, sheet) + 0.25 * noise(x / 2, y / 3, sheet ^ 1) + 0.15 * noise(x / 5, y / 2, sheet ^ 2)
}

impl PerFrame for PaperGrain {
    fn run(self, cx: &Context) -> Result<PaperGrainOutputs, NodeError> {
        let sheet = if self.hold > 0 { cx.frame.div_euclid(self.hold) } else { 0 };
        let sheet = (self.seed as u64) << 32 ^ sheet as u64;
        let mut image = self.image.blank()?;
        let ([_, width, channels], alpha, strength) = (image.size(), image.alpha(), self.strength as f32);
        for (i, (to, from)) in image.pixels.chunks_mut(channels.max(1)).zip(self.image.pixels.chunks(channels.max(1))).enumerate() {
            let light = 1.0 - strength * height(i % width, i / width, sheet);
            for (c, (to, &from)) in to.iter_mut().zip(from).enumerate() {
                *to = if Some(c) == alpha { from } else { from * light };
            }
        }
        Ok(PaperGrainOutputs { image })
    }
}
