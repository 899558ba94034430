//! `cel.art`: art that takes the place of a cel.
//!
//! **Method** see [`crate::algo::cel`]: vector drawings, and one picture that looks photographed, in register with the reference drawing.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, figures 3 and 10 (a donut, a photograph and a witch's hat in the place of the drawing).
//!
//! **Fails when** a side is not from 1 to 16384 pixels.
//!
//! **Cost** O(pixels).
//!
//! ```ron
//! "witch": (type: "cel.art", art: witch_hat, size: (640, 360)),
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::{image, scene};
use crate::algo::cel::{Art, CelSpec, SceneKind};
use crate::data::Image;

/// Art that takes the place of a cel, in register with its reference drawing.
#[derive(Node)]
#[node(
    id = "cel.art",
    version = 1,
    kind = source,
    outputs = CelArtOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, figs. 3, 10",
    example = "\"witch\": (type: \"cel.art\", art: witch_hat, size: (640, 360))"
)]
pub(crate) struct CelArt {
    /// What is drawn.
    art: Art,
    /// Width and height of the frame that it is registered to.
    #[input(default = (640, 360), range = 1..=16384, unit = "px")]
    size: [u32; 2],
    /// Chooses the wander of the hand.
    #[input(default = 1)]
    seed: u64,
}

/// The art.
#[derive(Outputs)]
pub(crate) struct CelArtOutputs {
    /// It, on nothing.
    image: Image,
}

impl PerFrame for CelArt {
    fn run(self, _cx: &Context) -> Result<CelArtOutputs, NodeError> {
        let kind = match self.art {
            Art::WitchHat => SceneKind::Hat,
            Art::Donut | Art::Orange => SceneKind::Ball,
        };
        let (width, height) = (self.size[0] as usize, self.size[1] as usize);
        let spec = CelSpec { scene: kind, width, height, seed: self.seed, ..CelSpec::default() };
        Ok(CelArtOutputs { image: image(&spec, scene(spec)?.art(self.art))? })
    }
}
