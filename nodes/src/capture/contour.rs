//! `capture.contour`: a drawn contour as an affine motion of mixed keys.
//!
//! **Method** see [`crate::algo::capture_contour`]: motion and weights by turns, each exact, then both together; started from all keys at
//! once and from the nearest ones; over time smoothed on request without leaving the constraints ([`crate::algo::smoothness`]).
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, section 3.2, equations 2 and 4
//! to 7; smoothness is beyond it.
//!
//! **Fails when** a contour has another number of points than the keys. A contour or keys on a line get a similarity; motions and weights
//! that do the same thing cannot be told apart, and `condition` says so.
//!
//! **Cost** O(keys² × points) a round, some ten rounds a frame; with smoothness, again for each of some twenty sweeps.
//!
//! ```ron
//! "capture": (type: "capture.contour", shape: "@points", keys: "@keys"),
//! ```

use pegbar_engine::node::{Context, Frames, In, NodeError, Problem, Stream, Whole};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::capture_contour::{Capture, Capturer, Options, smooth};
use crate::algo::fit_affine::area;
use crate::algo::key_weights::Limits;
use crate::algo::smoothness::Smoothing;
use crate::algo::track_affine::Model;
use crate::data::{Affine2, KeyShapes, Shape, Weights};
use crate::keys::refused;
use crate::solve::{bounds, in_frame};

/// A drawn contour as an affine motion of mixed keys.
///
/// contour = motion (weights × keys). `retarget` nodes put motion and weights on other keys.
#[derive(Node)]
#[node(
    id = "capture.contour",
    version = 1,
    kind = whole,
    outputs = CaptureContourOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.2, eqs. 2, 4-7",
    example = "\"capture\": (type: \"capture.contour\", shape: \"@points\", keys: \"@keys\")"
)]
pub(crate) struct CaptureContour {
    /// The contour: the keys' points in the keys' order (`shape.resample`).
    shape: Frames<Shape>,
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
    /// How much bends over time cost: 0 captures each frame alone, 1 weighs squared second differences of the captured points and of the
    /// weights as much as squared errors. Steadies drawings that tremble; large ones leave straight lines.
    #[input(default = 0.0, range = 0.0..=1000000.0)]
    smoothness: f64,
    /// Bends that are so many times the usual ones are accents, which smoothness leaves: contacts, pops. They stay in the sum of all bends, which
    /// for a bounce sinks by half where its tremble sinks to an eighth. 0 smooths all alike.
    #[input(default = 3.0, range = 0.0..=1000000.0)]
    accents: f64,
}

/// The capture, and how sure it is.
#[derive(Outputs)]
pub(crate) struct CaptureContourOutputs {
    /// Frame from keys, pixels.
    motion: Stream<Affine2>,
    /// One a key; they add up to 1.
    weights: Stream<Weights>,
    /// Root mean square distance between the contour and what the capture makes of it, pixels.
    error: Stream<Curve>,
    /// What the capture makes of the contour: the mixed keys, moved.
    shape: Stream<Shape>,
    /// Area of that, square pixels; meant for closed contours.
    area: Stream<Curve>,
    /// Rounds from the start that was best.
    rounds: Stream<Curve>,
    /// 1 where the last round changed next to nothing, and the last sweep of the smoothing where there is one; else 0.
    converged: Stream<Curve>,
    /// Proof of the weights: largest violation of their optimality conditions, relative to the gradient.
    kkt: Stream<Curve>,
    /// No weights on another set of keys, under this motion, give a smaller root mean square distance than this, pixels; near `error` the
    /// choice of keys is a toss-up. With smoothness its price counts as well.
    runner_up: Stream<Curve>,
    /// How much less sure the least sure mix of motion and weights is than the surest, from 1. Infinite where keys and motion cannot be
    /// told apart.
    condition: Stream<Curve>,
    /// Standard deviations of a1, a2, a3, a4, of the contour's centre in x and y, and of each weight, from the error that is left.
    deviation: Stream<Vector>,
}

impl CaptureContour {
    fn options(&self) -> Options {
        Options {
            model: self.affine_model,
            limits: Limits { max_nonzero: self.max_nonzero as usize, lower: self.lower, upper: self.upper },
            tolerance: self.tolerance,
            max_rounds: self.max_rounds as usize,
            starts: self.starts as usize,
        }
    }

    fn captures(&self, shapes: &[&Shape], cx: &Context) -> Result<Vec<Capture>, NodeError> {
        let [k, ..] = self.keys.points.shape();
        let mut capturer = Capturer::new(k, self.keys.by_point(), self.options()).map_err(refused)?;
        let mut captures = Vec::with_capacity(shapes.len());
        for (frame, shape) in (cx.clock.first..).zip(shapes) {
            cx.check()?;
            captures.push(capturer.capture(&shape.points).map_err(|e| in_frame(refused(e), frame))?);
        }
        if self.smoothness > 0.0 {
            let points: Vec<&[[f64; 2]]> = shapes.iter().map(|s| &s.points[..]).collect();
            let smoothing = Smoothing { strength: self.smoothness, accents: self.accents };
            smooth(&mut capturer, &points, &mut captures, smoothing, || cx.check())?;
        }
        Ok(captures)
    }
}

impl Whole for CaptureContour {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        (cx.clock.first..=cx.clock.last).collect()
    }

    fn run(self, cx: &Context) -> Result<CaptureContourOutputs, NodeError> {
        let shapes = (cx.clock.first..=cx.clock.last).map(|f| self.shape.at(f).map(|s| &**s)).collect::<Result<Vec<_>, _>>()?;
        let captures = self.captures(&shapes, cx)?;
        let curves = |of: &dyn Fn(&Capture) -> f64| Stream(captures.iter().map(|c| Curve { value: of(c) }).collect());
        let n = self.keys.by_point().len() as f64 / self.keys.points.shape()[0] as f64;
        Ok(CaptureContourOutputs {
            motion: Stream(captures.iter().map(|c| c.motion.into()).collect()),
            weights: Stream(captures.iter().map(|c| Weights { weights: c.weights.clone() }).collect()),
            error: curves(&|c| c.rms),
            shape: Stream(captures.iter().zip(&shapes).map(|(c, s)| Shape { points: c.shape.clone(), closed: s.closed }).collect()),
            area: curves(&|c| area(&c.shape)),
            rounds: curves(&|c| (c.errors.len() - 1) as f64),
            converged: curves(&|c| f64::from(u8::from(c.converged))),
            kkt: curves(&|c| c.certificate.kkt),
            runner_up: curves(&|c| (c.certificate.runner_up / n).sqrt()),
            condition: curves(&|c| c.condition),
            deviation: Stream(captures.iter().map(|c| Vector { values: c.deviations.clone() }).collect()),
        })
    }

    fn check(&self) -> Vec<Problem> {
        bounds(self.max_nonzero, self.upper)
    }
}
