//! `capture.contour`: a drawn contour as an affine motion of mixed keys.
//!
//! **Method** see [`crate::algo::capture_contour`]: motion and weights by turns, each exact, then both together; started from all keys at once and from the nearest ones.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, section 3.2, equations 2 and 4 to 7.
//!
//! **Fails when** a contour has another number of points than the keys. A contour or keys on a line get a similarity; motions and weights that do the same
//! thing cannot be told apart, and `condition` says so.
//!
//! **Cost** O(keys² × points) a round, some ten rounds a frame. Frames run in parallel.
//!
//! ```ron
//! "capture": (type: "capture.contour", shape: "@points", keys: "@keys"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame, Problem};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::capture_contour::{Capture, Capturer, Options};
use crate::algo::fit_affine::area;
use crate::algo::key_weights::Limits;
use crate::algo::track_affine::Model;
use crate::data::{Affine2, KeyShapes, Shape, Weights};
use crate::keys::refused;
use crate::solve::bounds;

/// A drawn contour as an affine motion of mixed keys.
///
/// contour = motion (weights × keys). `retarget` nodes put motion and weights on other keys.
#[derive(Node)]
#[node(
    id = "capture.contour",
    version = 1,
    outputs = CaptureContourOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.2, eqs. 2, 4-7",
    example = "\"capture\": (type: \"capture.contour\", shape: \"@points\", keys: \"@keys\")"
)]
pub(crate) struct CaptureContour {
    /// The contour: the keys' points in the keys' order (`shape.resample`).
    shape: In<Shape>,
    /// The key shapes.
    keys: In<KeyShapes>,
    /// Most keys that have a weight. 1 picks one key, 3 is usual; as many as there are keys sets no limit.
    #[input(default = 3, range = 1..=1000)]
    max_nonzero: u32,
    /// Least weight. 0 mixes only; below, keys may be exaggerated away from.
    #[input(default = -0.5, range = -1000.0..=0.0)]
    lower: f64,
    /// Largest weight. 1 mixes only; above, keys may be exaggerated.
    #[input(default = 1.5, range = 0.001..=1000.0)]
    upper: f64,
    /// Motions that are allowed. With `rigid` and keys of one area the weights nearly keep the area.
    #[input(default = affine)]
    affine_model: Model,
    /// A round that lowers the squared error by a smaller share than this is the last. 0 runs until nothing changes.
    #[input(default = 1e-10, range = 0.0..=1.0)]
    tolerance: f64,
    /// Most rounds from each start.
    #[input(default = 100, range = 1..=100000)]
    max_rounds: u32,
    /// Nearest single keys that are started from as well. 0 trusts the start from all keys together.
    #[input(default = 2, range = 0..=1000)]
    starts: u32,
}

/// The capture, and how sure it is.
#[derive(Outputs)]
pub(crate) struct CaptureContourOutputs {
    /// Frame from keys, pixels.
    motion: Affine2,
    /// One a key; they add up to 1.
    weights: Weights,
    /// Root mean square distance between the contour and what the capture makes of it, pixels.
    error: Curve,
    /// What the capture makes of the contour: the mixed keys, moved.
    shape: Shape,
    /// Area of that, square pixels; meant for closed contours.
    area: Curve,
    /// Rounds from the start that was best.
    rounds: Curve,
    /// 1 where the last round changed next to nothing, else 0.
    converged: Curve,
    /// Proof of the weights: largest violation of their optimality conditions, relative to the gradient.
    kkt: Curve,
    /// No weights on another set of keys, under this motion, give a smaller root mean square distance than this, pixels; near `error` the choice of keys is a toss-up.
    runner_up: Curve,
    /// How much less sure the least sure mix of motion and weights is than the surest, from 1. Infinite where keys and motion cannot be told apart.
    condition: Curve,
    /// Standard deviations of a1, a2, a3, a4, of the contour's centre in x and y, and of each weight, from the error that is left.
    deviation: Vector,
}

impl PerFrame for CaptureContour {
    fn run(self, _cx: &Context) -> Result<CaptureContourOutputs, NodeError> {
        let options = Options {
            model: self.affine_model,
            limits: Limits { max_nonzero: self.max_nonzero as usize, lower: self.lower, upper: self.upper },
            tolerance: self.tolerance,
            max_rounds: self.max_rounds as usize,
            starts: self.starts as usize,
        };
        let [k, n, _] = self.keys.points.shape();
        let mut capturer = Capturer::new(k, self.keys.by_point(), options).map_err(refused)?;
        let Capture { motion, weights, shape, rms, certificate, errors, converged, condition, deviations } =
            capturer.capture(&self.shape.points).map_err(refused)?;
        let curve = |value| Curve { value };
        Ok(CaptureContourOutputs {
            motion: motion.into(),
            weights: Weights { weights },
            error: curve(rms),
            area: curve(area(&shape)),
            shape: Shape { points: shape, closed: self.shape.closed },
            rounds: curve((errors.len() - 1) as f64),
            converged: curve(f64::from(u8::from(converged))),
            kkt: curve(certificate.kkt),
            runner_up: curve((certificate.runner_up / n as f64).sqrt()),
            condition: curve(condition),
            deviation: Vector { values: deviations },
        })
    }

    fn check(&self) -> Vec<Problem> {
        bounds(self.max_nonzero, self.upper)
    }
}
