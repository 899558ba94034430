//! `retarget.shapes`: captured weights and motion put on other key shapes.
//!
//! **Method** the keys are moved onto each other where `align` says so, blended by the weights, as `interpolation` says ([`crate::algo::key_blend`]), then moved by the captured motion.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 and equations 2 and 3; Alexa, Cohen-Or, Levin 2000.
//!
//! **Fails when** there is not one weight for each key, or closed keys cross themselves where an inside is needed.
//!
//! **Cost** once as `keys.inbetween`, then O(n √n) a frame; frames run in parallel once the first is made.
//!
//! ```ron
//! "bunny": (type: "retarget.shapes", keys: "@bunny_keys", weights: "@capture.weights", motion: "@capture.motion", interpolation: arap),
//! ```

use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs};

use super::{How, Ready, moved, placed, ready, refused};
use crate::algo::key_blend::Interpolation;
use crate::algo::track_affine::Model;
use crate::data::{Affine2, KeyShapes, Shape, Weights};
use crate::keys::AlignTo;

/// Captured weights and motion put on other key shapes.
///
/// Each target key corresponds to the captured key at the same position: where one is more extreme, the other must be more so in the same way.
#[derive(Node)]
#[node(
    id = "retarget.shapes",
    version = 1,
    kind = recurrent,
    outputs = RetargetShapesOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4, eqs. 2 and 3",
    example = "\"bunny\": (type: \"retarget.shapes\", keys: \"@keys\", weights: \"@capture.weights\", motion: \"@capture.motion\")"
)]
pub(crate) struct RetargetShapes {
    /// The target's key shapes, one for each captured key.
    keys: In<KeyShapes>,
    /// How much of each key. `extended` also takes one for each in-between, in the order of `keys.inbetween`.
    weights: In<Weights>,
    /// The captured motion: frame from reference, pixels. None where it is left out.
    motion: Option<In<Affine2>>,
    /// Where the keys are put before the motion: reference from keys, pixels. As drawn where it is left out.
    place: Option<In<Affine2>>,
    /// What lies between the keys.
    #[input(default = linear)]
    interpolation: Interpolation,
    /// In-betweens of each pair for `extended`: those of the captured keys where weights are given for them.
    #[input(default = 5, range = 0..=1000)]
    inbetweens: u32,
    /// True prefers no key for `extended` and `arap`; false takes the first as the paper does.
    #[input(default = true)]
    symmetric: bool,
    /// The point of the contour that goes straight from key to key in `extended` and `arap`, as in the paper: a hip, a hand on a bar. The centroid
    /// where it is left out.
    #[input(default = None, range = 0..=1000000)]
    anchor: Option<u32>,
    /// What the keys are moved onto before they are blended, so that only the captured motion moves them (eq. 5).
    #[input(default = none)]
    align: AlignTo,
    /// Motions that `align` may use.
    #[input(default = affine)]
    align_model: Model,
}

/// The target's shape.
#[derive(Outputs)]
pub(crate) struct RetargetShapesOutputs {
    /// Its points in the keys' order, pixels.
    shape: Shape,
}

impl Recurrent for RetargetShapes {
    type State = Ready;

    fn run(self, state: Option<&Ready>, _cx: &Context) -> Result<(RetargetShapesOutputs, Ready), NodeError> {
        let how = How {
            interpolation: self.interpolation,
            inbetweens: self.inbetweens,
            symmetric: self.symmetric,
            anchor: self.anchor,
            align: self.align,
            align_model: self.align_model,
            mesh: false,
        };
        let (made, state) = ready(&self.keys, state, how)?;
        let mut points = made.blend.blend(&self.weights.weights).map_err(refused)?;
        points.truncate(made.blend.n_contour());
        let map = placed(self.place.as_deref(), self.motion.as_deref())?;
        Ok((RetargetShapesOutputs { shape: Shape { points: moved(&points, &map), closed: self.keys.closed } }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        // All frames start from the first, which makes the keys ready, so that they need not wait for each other.
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

#[cfg(test)]
mod tests;
