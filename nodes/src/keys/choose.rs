//! `keys.choose`: the drawings of a sequence that make the best keys.
//!
//! **Method** see [`crate::algo::choose_keys`]: each next key is the drawing that the keys so far capture worst; then
//! keys are exchanged for worse captured drawings while that lowers the worst error.
//!
//! **Source** Gonzalez, *Clustering to Minimize the Maximum Intercluster Distance*, 1985; Bregler, Loeb, Chuang, Deshpande 2002, section
//! 1.4 (keys picked by eye).
//!
//! **Fails when** the contours have other numbers of points. A single bad contour is the worst captured and becomes a key.
//!
//! **Cost** O(count × frames) captures; all contours are in memory.
//!
//! ```ron
//! "keys": (type: "keys.choose", shape: "@points", count: 5),
//! ```

use pegbar_engine::node::{Context, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use super::{alike, named, refused};
use crate::algo::capture_contour::Options;
use crate::algo::choose_keys::choose;
use crate::algo::key_weights::{Limits, WeightsError};
use crate::algo::track_affine::Model;
use crate::data::{KeyShapes, Shape};
use crate::solve::bounds;

/// The drawings of a sequence that make the best keys.
#[derive(Node)]
#[node(
    id = "keys.choose",
    version = 1,
    kind = whole,
    outputs = KeysChooseOutputs,
    source = "Gonzalez 1985; Bregler, Loeb, Chuang, Deshpande 2002, section 1.4",
    example = "\"keys\": (type: \"keys.choose\", shape: \"@points\", count: 5)"
)]
pub(crate) struct KeysChoose {
    /// The contours: as many points in one order at every frame.
    shape: Sequence<Shape>,
    /// Most keys.
    #[input(default = 5, range = 1..=200)]
    count: u32,
    /// No more keys are taken once every drawing is captured to within this, root mean square. 0 takes all.
    #[input(default = 0.5, range = 0.0..=1000000.0, unit = "px")]
    enough: f64,
    /// Most keys that have a weight at one frame.
    #[input(default = 3, range = 1..=1000)]
    max_nonzero: u32,
    /// Least weight.
    #[input(default = -0.5, range = -1000.0..=0.0)]
    lower: f64,
    /// Largest weight.
    #[input(default = 1.5, range = 1.0..=1000.0)]
    upper: f64,
    /// Motions that are allowed.
    #[input(default = affine)]
    affine_model: Model,
}

/// The keys, and what they leave.
#[derive(Outputs)]
pub(crate) struct KeysChooseOutputs {
    /// Named by their frames; moved onto the first by a motion of the model.
    keys: KeyShapes,
    /// Their frames.
    frames: Vector,
    /// Largest error of any drawing with one key, with two and so on, the last after exchanges: root mean square, pixels. Shows how many
    /// keys are worth it.
    worst: Vector,
    /// Error of each drawing with all keys: root mean square, pixels.
    error: Stream<Curve>,
}

/// A choice stops for what is wrong with the contours, or because it is told to.
struct Stop(NodeError);

impl From<WeightsError> for Stop {
    fn from(error: WeightsError) -> Self {
        Self(refused(error))
    }
}

impl Whole for KeysChoose {
    fn run(self, cx: &Context) -> Result<KeysChooseOutputs, NodeError> {
        let shapes = (0..self.shape.len()).map(|at| self.shape.get(at)).collect::<Result<Vec<_>, _>>()?;
        let first = self.shape.clock().map_or(cx.clock.first, |c| c.first);
        alike(shapes.iter().enumerate().map(|(at, s)| (first + at as i64, &**s)))?;
        let points: Vec<Vec<[f64; 2]>> = shapes.iter().map(|s| s.points.clone()).collect();
        let limits = Limits { max_nonzero: self.max_nonzero as usize, lower: self.lower, upper: self.upper };
        let options = Options { model: self.affine_model, limits, ..Options::default() };
        let between = || cx.check().map_err(Stop);
        let found = choose(&points, self.count as usize, self.enough, options, between).map_err(|s| s.0)?;
        let frames: Vec<i64> = found.chosen.iter().map(|at| first + *at as i64).collect();
        let keys = named(&frames, &found.keys, shapes.first().is_some_and(|s| s.closed))?;
        let mut error: Vec<Curve> = found.errors.iter().map(|e| Curve { value: *e }).collect();
        // A single contour stands for every frame of the clock.
        if let Some(last) = error.last().cloned() {
            error.resize(cx.clock.len().max(error.len()), last);
        }
        let frames = Vector { values: frames.iter().map(|f| *f as f64).collect() };
        Ok(KeysChooseOutputs { keys, frames, worst: Vector { values: found.worst }, error: Stream(error) })
    }

    fn check(&self) -> Vec<Problem> {
        bounds(self.max_nonzero, self.upper)
    }
}
