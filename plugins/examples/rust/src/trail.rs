//! Trails of earlier drawings.

use pegbar_plugin::prelude::*;
use pegbar_plugin::types::Image;

/// Leaves a fading trail of earlier frames on the paper, as an onion skin does: what was darker before shows through.
#[derive(Node)]
#[node(id = "paper.trail", version = 1, kind = recurrent, outputs = PaperTrailOutputs, example = r#""skin": (type: "paper.trail", image: "@ink", fade: 0.3)"#)]
pub(crate) struct PaperTrail {
    /// The picture.
    image: In<Image>,
    /// How much of the trail is gone a frame later; 0 keeps it for ever, 1 leaves none.
    #[input(default = 0.3, range = 0.0..=1.0)]
    fade: f64,
}

/// What it makes.
#[derive(Outputs)]
pub(crate) struct PaperTrailOutputs {
    /// The picture on its trail.
    image: Image,
}

/// The trail so far.
#[derive(Debug, Value)]
pub(crate) struct Trail {
    /// Darkest light of each sample, faded.
    #[value(shape = "[h, w, c]")]
    light: Buffer<f32, 3>,
}

impl Recurrent for PaperTrail {
    type State = Trail;

    fn run(self, state: Option<&Trail>, _cx: &Context) -> Result<(PaperTrailOutputs, Trail), NodeError> {
        let mut image = self.image.map(|sample| sample)?;
        if let Some(trail) = state.filter(|s| s.light.shape() == self.image.size()) {
            let (kept, alpha, channels) = (1.0 - self.fade as f32, self.image.alpha(), self.image.size()[2].max(1));
            for (i, (to, &before)) in image.pixels.iter_mut().zip(trail.light.iter()).enumerate() {
                let through = *to + (before - *to) * kept;
                *to = if Some(i % channels) == alpha { to.max(through) } else { to.min(through) };
            }
        }
        let light = image.pixels.clone();
        Ok((PaperTrailOutputs { image }, Trail { light }))
    }
}
