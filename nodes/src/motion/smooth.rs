//! `motion.smooth`: takes the jitter out of a motion, not its snap.
//!
//! **Method** see [`crate::algo::motion::smooth`]: least squares against third differences, so that parabolas stay and nothing lags; contacts and
//! accents, whose jerks stand out of the jitter, are left alone. An affine motion is filtered as path, rotation, size and squash.
//!
//! **Source** Whittaker 1923; Geman and McClure 1987 (weights). The jitter that Bregler, Loeb, Chuang, Deshpande 2002, section 5, leave open.
//!
//! **Fails when** a frame is not finite, or an affine map loses an axis or starts to mirror; drawings on twos without `holds` look like jitter.
//!
//! **Cost** O(frames · numbers).
//!
//! ```ron
//! "steady": (type: "motion.smooth", motion: "@track.motion", window: 6),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{AnySequence, Context, In, NodeError, Whole};
use pegbar_engine::value::TimeMap;

use super::{Motion, Moved, drawings, filter, refused};
use crate::algo::motion::Kind;
use crate::algo::motion::smooth::Smooth;

/// Takes the jitter out of a motion, not its snap.
///
/// Motions are affine motions, weights, curves, vectors or contours. Weights still add up to 1.
#[derive(Node)]
#[node(
    id = "motion.smooth",
    version = 1,
    kind = whole,
    outputs = Moved,
    type_from = "motion",
    source = "Whittaker 1923; Geman, McClure 1987",
    example = "\"steady\": (type: \"motion.smooth\", motion: \"@track.motion\", window: 6)"
)]
pub(crate) struct MotionSmooth {
    /// The motion.
    motion: AnySequence,
    /// How much of the jitter goes: 0 none, 1 all that the window tells.
    #[input(default = 1.0, range = 0.0..=1.0)]
    amount: f64,
    /// What swings faster than once in so many frames (drawings, with `holds`) is jitter. Small follows, large glides.
    #[input(default = 6.0, range = 2.0..=1000.0, unit = "frames")]
    window: f64,
    /// How many times the usual jerk one must be to be meant: small keeps every accent, large smooths over contacts.
    #[input(default = 3.0, range = 0.5..=1000000.0)]
    keep: f64,
    /// Frames that stay as they are.
    #[input(default = [])]
    pins: Vec<i64>,
    /// Drawings that are held: each is filtered once, and held on.
    holds: Option<In<TimeMap>>,
    /// The point of the reference about which an affine motion turns and squashes: a hip, a foot. The point that moves least where it is left out.
    #[input(default = None, unit = "px")]
    pivot: Option<[f64; 2]>,
}

impl Whole for MotionSmooth {
    fn run(self, cx: &Context) -> Result<Moved, NodeError> {
        let mut motion = Motion::read(&self.motion, self.pivot, cx)?;
        let holds = drawings(self.holds.as_deref(), motion.len())?;
        let mut pinned = vec![false; holds.first.len()];
        for frame in &self.pins {
            let at = usize::try_from(frame - cx.clock.first).ok().and_then(|k| holds.drawing.get(k));
            let at = at.ok_or_else(|| refused(format!("pins: expected frames of the motion, found {frame}")))?;
            pinned[*at] = true;
        }
        if self.amount == 0.0 {
            return Ok(motion.write(true));
        }
        let smooth = Smooth { window: self.window, keep: self.keep };
        filter(&mut motion, &holds, |kind, curves, times| {
            let mut found = smooth.apply(curves, times, &pinned);
            for (x, y) in found.iter_mut().zip(curves) {
                x.iter_mut().zip(y).for_each(|(x, y)| *x = y + self.amount * (*x - y));
            }
            if kind == Kind::Weights {
                resum(&mut found, curves);
            }
            found
        });
        Ok(motion.write(false))
    }
}

/// Brings weights back to the sums that they had, which rounding moves.
fn resum(found: &mut [Vec<f64>], before: &[Vec<f64>]) {
    let n = found.len() as f64;
    for k in 0..found.first().map_or(0, Vec::len) {
        let sum = |c: &[Vec<f64>]| c.iter().map(|c| c[k]).sum::<f64>();
        let off = (sum(found) - sum(before)) / n;
        found.iter_mut().for_each(|c| c[k] -= off);
    }
}
