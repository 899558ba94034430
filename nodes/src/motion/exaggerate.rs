//! `motion.exaggerate`: carries every pose further from rest.
//!
//! **Method** see [`crate::algo::motion::exaggerate`]: a path, a rotation, a squash and a size about a pivot each grow by their own amount; a squash keeps its area.
//!
//! **Source** Thomas and Johnston, *The Illusion of Life*, 1981 (exaggeration); Bregler, Loeb, Chuang, Deshpande 2002, section 5.
//!
//! **Fails when** a frame is not finite, or an affine map loses an axis or starts to mirror.
//!
//! **Cost** O(frames · numbers).
//!
//! ```ron
//! "broad": (type: "motion.exaggerate", motion: "@track.motion", amount: 0.4),
//! ```

use pegbar_engine::node::{AnySequence, Context, NodeError, Problem, Whole};
use pegbar_engine::{Node, Setting};

use super::{Motion, Moved, refused};
use crate::algo::motion::exaggerate::{Amounts, Rest, exaggerate};

/// What poses are measured from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum About {
    /// The mean of all frames.
    Mean,
    /// The frame `rest`.
    Frame,
    /// The straight line through all frames, so that a walk keeps its way.
    Trend,
}

/// Carries every pose further from rest.
///
/// Motions are affine motions, weights, curves, vectors or contours.
#[derive(Node)]
#[node(
    id = "motion.exaggerate",
    version = 1,
    kind = whole,
    outputs = Moved,
    type_from = "motion",
    source = "Thomas, Johnston 1981; Bregler, Loeb, Chuang, Deshpande 2002, section 5",
    example = "\"broad\": (type: \"motion.exaggerate\", motion: \"@track.motion\", amount: 0.4)"
)]
pub(crate) struct MotionExaggerate {
    /// The motion.
    motion: AnySequence,
    /// How much further: 0 leaves the motion, 1 doubles it, -1 brings it to rest.
    #[input(default = 0.3, range = -1.0..=100.0)]
    amount: f64,
    /// Share of the amount that an affine motion's path takes.
    #[input(default = 1.0, range = 0.0..=100.0)]
    translation: f64,
    /// Share that its rotation takes.
    #[input(default = 1.0, range = 0.0..=100.0)]
    rotation: f64,
    /// Share that its squash takes, which keeps the area.
    #[input(default = 1.0, range = 0.0..=100.0)]
    squash: f64,
    /// Share that its size takes. 0 keeps each frame's area.
    #[input(default = 0.0, range = 0.0..=100.0)]
    size: f64,
    /// What poses are measured from.
    #[input(default = mean)]
    about: About,
    /// The frame of `about: frame`. The clock's first where it is left out.
    #[input(default = None)]
    rest: Option<i64>,
    /// Least and largest weight, which exaggerated weights are brought back to.
    #[input(default = (-0.5, 1.5), range = -1000.0..=1000.0)]
    weight_bounds: [f64; 2],
    /// The point of the reference about which an affine motion turns and squashes: a hip, a foot. The point that moves least where it is left out.
    #[input(default = None, unit = "px")]
    pivot: Option<[f64; 2]>,
}

impl Whole for MotionExaggerate {
    fn run(self, cx: &Context) -> Result<Moved, NodeError> {
        let mut motion = Motion::read(&self.motion, self.pivot, cx)?;
        if self.amount == 0.0 {
            return Ok(motion.write(true));
        }
        let a = self.amount;
        let amounts = Amounts {
            translation: a * self.translation,
            rotation: a * self.rotation,
            squash: a * self.squash,
            size: a * self.size,
            values: a,
        };
        let rest = match self.about {
            About::Mean => Rest::Mean,
            About::Trend => Rest::Trend,
            About::Frame => {
                let frame = self.rest.unwrap_or(cx.clock.first);
                let at = usize::try_from(frame - cx.clock.first).ok().filter(|k| *k < motion.len());
                Rest::Frame(at.ok_or_else(|| refused(format!("rest: expected a frame of the motion, found {frame}")))?)
            }
        };
        exaggerate(&mut motion.groups, &amounts, rest, self.weight_bounds);
        Ok(motion.write(false))
    }

    fn check(&self) -> Vec<Problem> {
        let [lower, upper] = self.weight_bounds;
        let message = format!("expected a least weight of at most 0 and a largest above 0, found {lower} and {upper}");
        if lower <= 0.0 && upper > 0.0 { Vec::new() } else { vec![Problem { input: "weight_bounds", message }] }
    }
}
