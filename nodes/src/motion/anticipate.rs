//! `motion.anticipate`: goes back before it goes, and past where it stops.
//!
//! **Method** see [`crate::algo::motion::cartoon::anticipate`]: the curve less its smoothed acceleration, the cartoon animation filter. An affine motion is filtered as
//! path, rotation, size and squash; a squash keeps its area.
//!
//! **Source** Wang, Drucker, Agrawala, Cohen, *The Cartoon Animation Filter*, SIGGRAPH 2006, equation 1.
//!
//! **Fails when** a frame is not finite, or an affine map loses an axis or starts to mirror.
//!
//! **Cost** O(frames · width · numbers).
//!
//! ```ron
//! "lively": (type: "motion.anticipate", motion: "@track.motion", amount: 1.0, width: 3),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnySequence, Context, In, NodeError, Problem, Whole};
use pegbar_engine::value::TimeMap;

use super::{Motion, Moved, drawings, filter};
use crate::algo::motion::Kind;
use crate::algo::motion::cartoon::anticipate;
use crate::algo::motion::exaggerate::rebound;

/// Goes back before it goes, and past where it stops.
///
/// Motions are affine motions, weights, curves, vectors or contours.
#[derive(Node)]
#[node(
    id = "motion.anticipate",
    version = 1,
    kind = whole,
    outputs = Moved,
    type_from = "motion",
    source = "Wang, Drucker, Agrawala, Cohen 2006, eq. 1",
    example = "\"lively\": (type: \"motion.anticipate\", motion: \"@track.motion\", amount: 1.0, width: 3)"
)]
pub(crate) struct MotionAnticipate {
    /// The motion.
    motion: AnySequence,
    /// How much: 0 leaves the motion; at 1 a move in no time swings back and over by a quarter of its way.
    #[input(default = 1.0, range = 0.0..=100.0)]
    amount: f64,
    /// How long it swings, as the standard deviation of the smoothing: about half of an anticipation. Small is nervous, large is heavy.
    #[input(default = 3.0, range = 0.25..=1000.0, unit = "frames")]
    width: f64,
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
    /// Drawings that are held: each is filtered once, and held on.
    holds: Option<In<TimeMap>>,
    /// Least and largest weight, which the weights are brought back to.
    #[input(default = (-0.5, 1.5), range = -1000.0..=1000.0)]
    weight_bounds: [f64; 2],
    /// The point of the reference about which an affine motion turns and squashes: a hip, a foot. The point that moves least where it is left out.
    #[input(default = None, unit = "px")]
    pivot: Option<[f64; 2]>,
}

impl Whole for MotionAnticipate {
    fn run(self, cx: &Context) -> Result<Moved, NodeError> {
        let mut motion = Motion::read(&self.motion, self.pivot, cx)?;
        let holds = drawings(self.holds.as_deref(), motion.len())?;
        if self.amount == 0.0 {
            return Ok(motion.write(true));
        }
        filter(&mut motion, &holds, |kind, curves, times| {
            let share = match kind {
                Kind::Translation => self.translation,
                Kind::Rotation => self.rotation,
                Kind::Squash => self.squash,
                Kind::Size => self.size,
                Kind::Weights | Kind::Values => 1.0,
            };
            let mut found: Vec<Vec<f64>> = curves.iter().map(|c| anticipate(c, times, self.amount * share, self.width)).collect();
            if kind == Kind::Weights {
                rebound(&mut found, self.weight_bounds);
            }
            found
        });
        Ok(motion.write(false))
    }

    fn check(&self) -> Vec<Problem> {
        let [lower, upper] = self.weight_bounds;
        let message = format!("expected a least weight of at most 0 and a largest above 0, found {lower} and {upper}");
        if lower <= 0.0 && upper > 0.0 { Vec::new() } else { vec![Problem { input: "weight_bounds", message }] }
    }
}
