//! `solve.key_weights`: how much of each key a contour is made of.
//!
//! **Method** see [`crate::algo::key_weights`]: the quadratic program under all three constraints, exact in the number of keys, with its
//! proof.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, equation 7 and constraints 1 to
//! 3; smoothness is beyond it.
//!
//! **Fails when** a contour has another number of points than the keys, or no weights within the bounds add up to 1.
//!
//! **Cost** O(keys × points) a frame and a few operations for each set of `max_nonzero` keys; with smoothness, again for each of up to 400
//! sweeps.
//!
//! ```ron
//! "weights": (type: "solve.key_weights", shape: "@outline", keys: "@keys", motion: "@motion"),
//! ```

use pegbar_engine::node::{Context, Frames, In, NodeError, Problem as InputProblem, Stream, Whole};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::key_weights::{Certificate, KeySpace, Limits, Problem, Solver, smooth, spread};
use crate::algo::raster::{Affine, identity};
use crate::algo::smoothness::Smoothing;
use crate::data::{Affine2, KeyShapes, Shape, Weights};
use crate::keys::refused;

/// How much of each key a contour is made of.
#[derive(Node)]
#[node(
    id = "solve.key_weights",
    version = 1,
    kind = whole,
    outputs = SolveKeyWeightsOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eq. 7",
    example = "\"weights\": (type: \"solve.key_weights\", shape: \"@outline\", keys: \"@keys\", motion: \"@motion\")"
)]
pub(crate) struct SolveKeyWeights {
    /// The contours: the keys' points in the keys' order.
    shape: Frames<Shape>,
    /// The key shapes.
    keys: In<KeyShapes>,
    /// Where the keys are moved before they are mixed: frame from keys. Nowhere where it is left out.
    motion: Option<Frames<Affine2>>,
    /// Most keys that have a weight. 1 picks the nearest key, 3 is usual; as many as there are keys sets no limit.
    #[input(default = 3, range = 1..=1000)]
    max_nonzero: u32,
    /// Least weight. 0 mixes only; below, keys may be exaggerated away from.
    #[input(default = -0.5, range = -1000.0..=0.0)]
    lower: f64,
    /// Largest weight. 1 mixes only; above, keys may be exaggerated.
    #[input(default = 1.5, range = 0.001..=1000.0)]
    upper: f64,
    /// How much bends of the weights over time cost: 0 solves each frame alone, 1 weighs squared second differences of the weights as much
    /// as squared errors of the shape in units of the keys' differences; large ones leave straight lines.
    #[input(default = 0.0, range = 0.0..=1000000.0)]
    smoothness: f64,
    /// Bends that are so many times the usual ones are accents, which smoothness leaves: contacts, pops. 0 smooths all alike.
    #[input(default = 3.0, range = 0.0..=1000000.0)]
    accents: f64,
}

/// The weights, and their proof.
#[derive(Outputs)]
pub(crate) struct SolveKeyWeightsOutputs {
    /// One a key; they add up to 1.
    weights: Stream<Weights>,
    /// Squared distance of the mixed keys from the contour, summed over its points, square pixels.
    cost: Stream<Curve>,
    /// Largest violation of the optimality conditions (Karush, Kuhn, Tucker) relative to the gradient: rounding alone.
    kkt: Stream<Curve>,
    /// No weights within the constraints cost less than this; below `cost` by more than rounding only where a search was too large to
    /// finish.
    lower_bound: Stream<Curve>,
    /// No weights on another set of keys cost less than this; near `cost` the choice of keys is a toss-up.
    runner_up: Stream<Curve>,
    /// How much less sure the least sure mix of the free weights is than the surest, from 1; infinite where free keys do the same thing.
    condition: Stream<Curve>,
    /// Standard deviation of each weight from the error that is left; 0 for weights at nought or at a bound.
    deviation: Stream<Vector>,
}

impl SolveKeyWeights {
    fn problems(&self, cx: &Context) -> Result<Vec<Problem>, NodeError> {
        let [k, ..] = self.keys.points.shape();
        let mut space = KeySpace::new(k, self.keys.by_point()).map_err(refused)?;
        (cx.clock.first..=cx.clock.last)
            .map(|frame| {
                cx.check()?;
                let named = |e| in_frame(refused(e), frame);
                let shape = self.shape.at(frame)?;
                space.check(&shape.points).map_err(named)?;
                let motion = self.motion.as_ref().map(|m| m.at(frame)).transpose()?.map_or_else(identity, |m| Affine::from(&**m));
                finite(&motion).map_err(named)?;
                let mut problem = Problem::default();
                space.problem(&motion, &shape.points, &mut problem);
                Ok(problem)
            })
            .collect()
    }
}

fn finite(motion: &Affine) -> Result<(), crate::algo::key_weights::WeightsError> {
    let m = motion;
    let all = [m[(0, 0)], m[(0, 1)], m[(1, 0)], m[(1, 1)], m[(0, 2)], m[(1, 2)]];
    if all.iter().all(|v| v.is_finite()) { Ok(()) } else { Err(crate::algo::key_weights::WeightsError::Motion(all)) }
}

/// An error, with the frame in which it is.
pub(crate) fn in_frame(error: NodeError, frame: i64) -> NodeError {
    NodeError { message: format!("frame {frame}: {}", error.message), ..error }
}

impl Whole for SolveKeyWeights {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        (cx.clock.first..=cx.clock.last).collect()
    }

    fn run(self, cx: &Context) -> Result<SolveKeyWeightsOutputs, NodeError> {
        let problems = self.problems(cx)?;
        let [k, ..] = self.keys.points.shape();
        let limits = Limits { max_nonzero: self.max_nonzero as usize, lower: self.lower, upper: self.upper };
        let mut solver = Solver::new(k, limits).map_err(refused)?;
        let (mut weights, mut proofs) = (vec![vec![0.0; k]; problems.len()], vec![Certificate::default(); problems.len()]);
        for ((problem, weights), proof) in problems.iter().zip(&mut weights).zip(&mut proofs) {
            cx.check()?;
            *proof = solver.solve(problem, weights);
        }
        if self.smoothness > 0.0 {
            let smoothing = Smoothing { strength: self.smoothness, accents: self.accents };
            smooth(&mut solver, &problems, smoothing, &mut weights, &mut proofs, || cx.check())?;
        }
        let coordinates = self.keys.by_point().len() / k * 2;
        let sure: Vec<_> = problems.iter().zip(&weights).map(|(p, w)| spread(p, w, limits, coordinates)).collect();
        let curves = |of: fn(&Certificate) -> f64| Stream(proofs.iter().map(|p| Curve { value: of(p) }).collect());
        Ok(SolveKeyWeightsOutputs {
            cost: curves(|p| p.cost),
            kkt: curves(|p| p.kkt),
            lower_bound: curves(|p| p.lower_bound),
            runner_up: curves(|p| p.runner_up),
            condition: Stream(sure.iter().map(|s| Curve { value: s.0 }).collect()),
            deviation: Stream(sure.into_iter().map(|s| Vector { values: s.1 }).collect()),
            weights: Stream(weights.into_iter().map(|weights| Weights { weights }).collect()),
        })
    }

    fn check(&self) -> Vec<InputProblem> {
        bounds(self.max_nonzero, self.upper)
    }
}

/// What is wrong with the bounds, whatever the number of keys.
pub(crate) fn bounds(max_nonzero: u32, upper: f64) -> Vec<InputProblem> {
    let possible = f64::from(max_nonzero) * upper >= 1.0;
    let message = format!("expected at least 1 / max_nonzero, so that the weights can add up to 1, found {upper} for {max_nonzero}");
    if possible { Vec::new() } else { vec![InputProblem { input: "upper", message }] }
}
