//! `motion.follow_through`: what is drawn along: it sets out late, overshoots and settles.
//!
//! **Method** see [`crate::algo::motion::cartoon::spring`]: a damped spring that follows each curve, solved exactly. For tails, hats, bellies: put it on the
//! motion of the part, with the pivot where the part is fixed.
//!
//! **Source** Thomas and Johnston, *The Illusion of Life*, 1981 (follow through and overlapping action).
//!
//! **Fails when** a frame is not finite, or an affine map loses an axis or starts to mirror.
//!
//! **Cost** O(frames · numbers).
//!
//! ```ron
//! "tail": (type: "motion.follow_through", motion: "@track.motion", period: 10, translation: 0),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnySequence, Context, In, NodeError, Whole};
use pegbar_engine::value::TimeMap;

use super::{Motion, Moved, drawings, filter};
use crate::algo::motion::Kind;
use crate::algo::motion::cartoon::spring;

/// What is drawn along: it sets out late, overshoots and settles.
///
/// Motions are affine motions, weights, curves, vectors or contours. Weights still add up to 1.
#[derive(Node)]
#[node(
    id = "motion.follow_through",
    version = 1,
    kind = whole,
    outputs = Moved,
    type_from = "motion",
    source = "Thomas, Johnston 1981",
    example = "\"tail\": (type: \"motion.follow_through\", motion: \"@track.motion\", period: 10, translation: 0)"
)]
pub(crate) struct MotionFollowThrough {
    /// The motion.
    motion: AnySequence,
    /// How much: 0 leaves the motion, 1 is the spring's own.
    #[input(default = 1.0, range = 0.0..=10.0)]
    amount: f64,
    /// Frames of one swing. Short is stiff, long is limp.
    #[input(default = 8.0, range = 1.0..=1000.0, unit = "frames")]
    period: f64,
    /// Share of critical damping: 0 swings for ever, 1 does not overshoot.
    #[input(default = 0.3, range = 0.0..=10.0)]
    damping: f64,
    /// Share of the amount that an affine motion's path takes: 0 where the part is fixed at the pivot.
    #[input(default = 1.0, range = 0.0..=10.0)]
    translation: f64,
    /// Share that its rotation takes.
    #[input(default = 1.0, range = 0.0..=10.0)]
    rotation: f64,
    /// Share that its squash takes, which keeps the area.
    #[input(default = 1.0, range = 0.0..=10.0)]
    squash: f64,
    /// Share that its size takes.
    #[input(default = 0.0, range = 0.0..=10.0)]
    size: f64,
    /// Drawings that are held: each is filtered once, and held on.
    holds: Option<In<TimeMap>>,
    /// The point of the reference where the part is fixed, about which it turns. The point that moves least where it is left out.
    #[input(default = None, unit = "px")]
    pivot: Option<[f64; 2]>,
}

impl Whole for MotionFollowThrough {
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
            let drawn = |c: &Vec<f64>| -> Vec<f64> {
                let followed = spring(c, times, self.period, self.damping);
                c.iter().zip(followed).map(|(x, y)| x + self.amount * share * (y - x)).collect()
            };
            curves.iter().map(drawn).collect()
        });
        Ok(motion.write(false))
    }
}
