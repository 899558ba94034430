//! Ink that bleeds into the paper.

use pegbar_plugin::prelude::*;
use pegbar_plugin::types::Image;

/// Lets dark ink bleed into the paper: each pixel takes the darkest of the frames around it and of its neighbours, as far as the wetness says.
#[derive(Node)]
#[node(id = "paper.bleed", version = 1, outputs = PaperBleedOutputs, example = r#""wet": (type: "paper.bleed", image: "@ink", wetness: 0.5)"#)]
pub(crate) struct PaperBleed {
    /// The pictures.
    #[input(window = ("-reach", "reach"))]
    image: Frames<Image>,
    /// Frames before and after that show through.
    #[input(default = 1, range = 0..=8, unit = "frames")]
    reach: i64,
    /// How much of what is darker comes through; 0 leaves the picture as it is, 1 takes the darkest.
    #[input(default = 0.5, range = 0.0..=1.0)]
    wetness: f64,
}

/// What it makes.
#[derive(Outputs)]
pub(crate) struct PaperBleedOutputs {
    /// The picture with the ink that came through.
    image: Image,
}

impl PerFrame for PaperBleed {
    fn reads(&self, input: &str, cx: &Context) -> Vec<i64> {
        let clock = cx.input_clock(input);
        let mut frames: Vec<i64> = (cx.frame - self.reach..=cx.frame + self.reach).map(|f| clock.clamp(f)).collect();
        frames.dedup();
        frames
    }

    fn run(self, cx: &Context) -> Result<PaperBleedOutputs, NodeError> {
        let own = self.image.at(cx.clock.clamp(cx.frame))?.clone();
        let mut image = own.blank()?;
        image.pixels.copy_from_slice(&own.pixels);
        for frame in self.reads("image", cx) {
            let other = self.image.at(frame)?;
            if other.size() != own.size() {
                return Err(NodeError::input(format!("expected pictures of one size, found {:?} and {:?}", own.size(), other.size())));
            }
            image.pixels.iter_mut().zip(other.pixels.iter()).for_each(|(to, &from)| *to = to.min(from));
        }
        let wetness = self.wetness as f32;
        image.pixels.iter_mut().zip(own.pixels.iter()).for_each(|(to, &from)| *to = from + (*to - from) * wetness);
        Ok(PaperBleedOutputs { image })
    }
}
