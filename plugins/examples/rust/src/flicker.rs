//! A lamp that flickers.

use pegbar_plugin::prelude::*;
use pegbar_plugin::value::Curve;

use crate::grain::noise;

/// A number that flickers, as a lamp over an animation stand does: to be wired to any number.
#[derive(Node)]
#[node(id = "paper.flicker", version = 1, kind = source, outputs = PaperFlickerOutputs, uses_frame, example = r#""lamp": (type: "paper.flicker", depth: 0.1, hold: 2)"#)]
pub(crate) struct PaperFlicker {
    /// The number where the lamp is brightest.
    #[input(default = 1.0, unit = "as what it is wired to")]
    brightest: f64,
    /// How much of it is lost where the lamp is darkest; 0 never flickers, 1 goes out.
    #[input(default = 0.2, range = 0.0..=1.0)]
    depth: f64,
    /// Frames that one brightness lasts.
    #[input(default = 1, range = 1..=1000, unit = "frames")]
    hold: i64,
    /// Which flicker is taken.
    #[input(default = 1)]
    seed: i64,
}

/// What it makes.
#[derive(Outputs)]
pub(crate) struct PaperFlickerOutputs {
    /// The number at this frame.
    number: Curve,
}

impl PerFrame for PaperFlicker {
    fn run(self, cx: &Context) -> Result<PaperFlickerOutputs, NodeError> {
        let lost = f64::from(noise(cx.frame.div_euclid(self.hold) as u64, 0, self.seed as u64));
        Ok(PaperFlickerOutputs { number: Curve { value: self.brightest * (1.0 - self.depth * lost) } })
    }
}
