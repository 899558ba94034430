//! `lift.linear`: drawn markers lifted into space, near capture and with limbs of their lengths.
//!
//! **Method** see [`crate::algo::lift`]: linear least squares of each frame, limb by limb in O(markers); in a linear space of poses where there is a
//! `basis`. As it stands this is the paper's; `relinearize`, `length_mode`, `depth_weight`, `smooth_weight`, `accents` and `stretch` go beyond it.
//!
//! **Source** Jain, Sheikh, Hodgins, *Leveraging the Talent of Hand Animators to Create Three-Dimensional Animation*, 2009, section 3.5, equations 5 to 16.
//!
//! **Fails when** the capture is not finite, drawing and capture have no marker in common, either is in another unit (`sizes`), or, in perspective, a marker
//! lies behind the camera. With a hard basis out of few clips, and a style outside them, the result is worse than the capture: make it soft, or leave it out.
//!
//! **Cost** O(frames · rounds · markers), with P directions of a basis times P².
//!
//! ```ron
//! "lifted": (type: "lift.linear", markers: "@aligned", prior: "@captured", camera: "@camera"),
//! ```

use std::sync::Arc;

use nalgebra::Vector3;
use pegbar_engine::node::{Context, In, NodeError, Sequence, Stream, Whole};
use pegbar_engine::value::{Curve, Value, Vector};
use pegbar_engine::{Node, Outputs, Setting};

use super::{Limbs, Sizes, framed};
use crate::algo::camera;
use crate::algo::lift::{BasisMode, Frame, Framing, Lift, LimbRows, Options, Subspace, Tree, Weighting};
use crate::algo::markers::standard;
use crate::data::{Basis, Camera, Markers2, Markers3};
use crate::markers::seen;

/// How limbs keep their lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum LengthMode {
    /// As `length_weight` says, once linearised at the capture (eq. 8), and `relinearize` times more.
    Soft,
    /// To the last digits; `relinearize` says in how many rounds at most.
    Exact,
}

/// Drawn markers lifted into space, near capture and with limbs of their lengths.
#[derive(Node)]
#[node(
    id = "lift.linear",
    version = 3,
    kind = whole,
    outputs = LiftLinearOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.5, eqs. 5 to 16",
    example = "\"lifted\": (type: \"lift.linear\", markers: \"@aligned\", prior: \"@captured\", camera: \"@camera\")"
)]
pub(crate) struct LiftLinear {
    /// Where markers are drawn, as `pose.align_2d` leaves them. What is not seen is left out.
    markers: Sequence<Markers2>,
    /// The capture, in time with the drawing.
    prior: Sequence<Markers3>,
    /// What draws it; it may move.
    camera: Sequence<Camera>,
    /// Limbs, each by the names of the markers where it begins and ends. Those of the standard figure where it is left out.
    #[input(default = None)]
    limbs: Option<Limbs>,
    /// Length of each limb, metres. Those of the capture where it is left out.
    lengths: Option<Sequence<Vector>>,
    /// How much lengths count (λ1).
    #[input(default = 0.001, range = 0.0..=1e9)]
    length_weight: f64,
    /// How much the capture counts (λ2). Small follows the drawing in depth too, where only lengths tell of it; large stays with the capture.
    #[input(default = 0.1, range = 0.0..=1e9)]
    prior_weight: f64,
    /// How the weights enter.
    #[input(default = sqrt)]
    weighting: Weighting,
    /// How rows of lengths are scaled: `unscaled` is the paper's.
    #[input(default = unscaled)]
    limb_rows: LimbRows,
    /// How lengths are kept.
    #[input(default = soft)]
    length_mode: LengthMode,
    /// How often, at most, lengths and perspective are linearised again. 0 is the paper's; perspective and changed lengths want 5 to 30.
    #[input(default = 0, range = 0..=10000)]
    relinearize: u32,
    /// Share of a drawn limb's change of length that the figure takes: 0 is a rigid figure, 1 stretches as it is drawn.
    #[input(default = 0.0, range = 0.0..=1.0)]
    stretch: f64,
    /// How much the depth counts that a drawn limb's foreshortening tells, to the side where the capture has it. For markers with their drawn lengths.
    #[input(default = 0.0, range = 0.0..=1e9)]
    depth_weight: f64,
    /// How much second differences over time count, of what the lift adds to the capture: the tremble of drawn markers goes, the capture's snap stays.
    #[input(default = 0.0, range = 0.0..=1e9)]
    smooth_weight: f64,
    /// Second differences that are so many times the usual ones are accents, which `smooth_weight` leaves: contacts and snaps that are drawn, though not
    /// captured. 3 is a good start; 0 smooths all alike.
    #[input(default = 0.0, range = 0.0..=1000.0)]
    accents: f64,
    /// A linear space of poses of the same markers, as of `basis.pca`.
    basis: Option<In<Basis>>,
    /// What the space does.
    #[input(default = hard)]
    basis_mode: BasisMode,
    /// How much a soft space counts.
    #[input(default = 0.1, range = 0.0..=1e9)]
    basis_weight: f64,
    /// What the poses of the space are relative to: as in `basis.pca`.
    #[input(default = heading)]
    framing: Framing,
    /// The marker that poses of the space are relative to.
    #[input(default = "pelvis")]
    root: String,
    /// The markers that tell the heading, left and right.
    #[input(default = ["left_hip", "right_hip"])]
    hips: Vec<String>,
    /// What is made of a capture whose longest limb is not 2 cm to 5 m, and of limbs drawn more than three times longer or shorter than it has them.
    #[input(default = checked)]
    sizes: Sizes,
}

/// The figure.
#[derive(Outputs)]
pub(crate) struct LiftLinearOutputs {
    /// Its markers, in the order of the capture's: metres.
    markers: Stream<Markers3>,
    /// Root of the mean squared distance of drawn and lifted markers, as the camera sees them: pixels.
    residual: Stream<Curve>,
    /// How far the worst limb is from its length, as a share of it.
    length_error: Stream<Curve>,
    /// Of each marker the standard deviation of its place for a drawn error of 1, at most: large where only the capture tells its depth.
    uncertainty: Stream<Vector>,
}

/// The value of a frame; a single one stands for all.
fn at<T: Value>(values: &Sequence<T>, k: usize) -> Result<Arc<T>, NodeError> {
    values.get(if values.len() == 1 { 0 } else { k })
}

impl LiftLinear {
    fn options(&self) -> Options {
        Options {
            length_weight: if self.length_mode == LengthMode::Exact { f64::INFINITY } else { self.length_weight },
            prior_weight: self.prior_weight,
            depth_weight: self.depth_weight,
            smooth_weight: self.smooth_weight,
            accents: self.accents,
            basis_weight: self.basis_weight,
            weighting: self.weighting,
            rows: self.limb_rows,
            relinearize: self.relinearize as usize,
            stretch: self.stretch,
        }
    }

    fn pairs(&self, names: &[String]) -> Result<Vec<[usize; 2]>, NodeError> {
        match &self.limbs {
            Some(limbs) => limbs.find(names, "limbs"),
            None => Ok(standard::limbs(names)),
        }
    }

    fn tree(limbs: &[[usize; 2]], n: usize) -> Result<Tree, NodeError> {
        Tree::new(n, limbs).ok_or_else(|| NodeError::input("limbs: expected two different markers for each, found one"))
    }

    fn subspace(&self, prior: &Markers3) -> Result<Option<Subspace>, NodeError> {
        let Some(basis) = self.basis.as_deref().filter(|_| self.basis_mode != BasisMode::Off) else { return Ok(None) };
        let d = 3 * prior.points.len();
        if basis.mean.len() != d {
            let message = format!("basis: expected {d} values, three of each marker, found {}", basis.mean.len());
            return Err(NodeError::input(message).help("`basis.pca` makes one of a stream of the same markers"));
        }
        let stand = framed(prior, self.framing, &self.root, &self.hips)?;
        let components: Vec<&[f64]> = basis.components.data().chunks_exact(d.max(1)).collect();
        Ok(Some(Subspace::placed(&basis.mean, &components, self.framing, &stand)))
    }

    fn frame(&self, k: usize, names: &[String], limbs: &[[usize; 2]]) -> Result<Frame, NodeError> {
        let (drawn, prior) = (at(&self.markers, k)?, at(&self.prior, k)?);
        if prior.names != names {
            return Err(NodeError::input("prior: expected the same markers as at the first frame, found others"));
        }
        let markers = match (names.is_empty(), drawn.names.is_empty()) {
            (true, true) => drawn.points.clone(),
            _ => names.iter().map(|n| drawn.find(n).map_or([f64::NAN; 2], |m| drawn.points[m])).collect(),
        };
        if !names.is_empty() && !names.iter().any(|n| drawn.find(n).is_some()) {
            let error = NodeError::input("markers: expected some of those of `prior` by name, found none");
            return Err(
                error.help(format!("the capture's are {}", names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ")))
            );
        }
        let camera = camera::Camera::try_from(&*at(&self.camera, k)?).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let seen: Vec<[f64; 2]> = prior.points.iter().map(|p| seen(&camera, *p)).collect();
        self.sizes.expect_metres(&prior.points, limbs)?;
        self.sizes.expect_alike(&markers, &seen, limbs)?;
        Ok(Frame {
            markers,
            prior: prior.points.iter().copied().map(Vector3::from).collect(),
            lengths: self.lengths.as_ref().map(|l| at(l, k).map(|v| v.values.clone())).transpose()?,
            camera,
            subspace: self.subspace(&prior)?,
        })
    }
}

impl Whole for LiftLinear {
    fn run(self, cx: &Context) -> Result<LiftLinearOutputs, NodeError> {
        let n = [self.markers.len(), self.prior.len(), self.camera.len()].into_iter().max().unwrap_or(0);
        let first = cx.clock.first;
        let located = |k: usize| move |e: NodeError| NodeError { message: format!("frame {}: {}", first + k as i64, e.message), ..e };
        let names = at(&self.prior, 0)?.names.clone();
        let limbs = self.pairs(&names)?;
        let tree = Self::tree(&limbs, at(&self.prior, 0)?.points.len())?;
        let frames = (0..n).map(|k| self.frame(k, &names, &limbs).map_err(located(k))).collect::<Result<Vec<_>, _>>()?;
        cx.check()?;
        let lift = Lift { tree: &tree, options: self.options(), basis_mode: self.basis_mode };
        let mut lifted = lift.run(&frames).map_err(|(k, e)| located(k)(NodeError::input(e.to_string())))?;
        // Single values stand for every frame of the clock.
        while let (true, Some(last)) = (lifted.len() < cx.clock.len(), lifted.last()) {
            lifted.push(last.clone());
        }
        let curve = |value: f64| Curve { value };
        Ok(LiftLinearOutputs {
            markers: Stream(
                lifted.iter().map(|l| Markers3 { points: l.markers.iter().map(|p| (*p).into()).collect(), names: names.clone() }).collect(),
            ),
            residual: Stream(lifted.iter().map(|l| curve(l.residual)).collect()),
            length_error: Stream(lifted.iter().map(|l| curve(l.length_error)).collect()),
            uncertainty: Stream(lifted.into_iter().map(|l| Vector { values: l.uncertainty }).collect()),
        })
    }
}

#[cfg(test)]
#[path = "linear_tests.rs"]
mod tests;
