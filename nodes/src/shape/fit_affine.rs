//! `shape.fit_affine`: the affine motion from one contour to another.
//!
//! **Method** see [`crate::algo::fit_affine`]: least squares in closed form on centred contours.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, equations 1, 5 and 6.
//!
//! **Fails when** the contours have another number of points. Points on a line get a similarity and points in one place a translation;
//! `fitted` says so.
//!
//! **Cost** O(points) a frame.
//!
//! ```ron
//! "motion": (type: "shape.fit_affine", from: "@key", to: "@outline"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use crate::algo::fit_affine::{Fit, fit};
use crate::algo::track_affine::Model;
use crate::data::{Affine2, Shape};

/// The affine motion from one contour to another.
///
/// Both have the same points in the same order (`shape.resample`).
#[derive(Node)]
#[node(
    id = "shape.fit_affine",
    version = 1,
    outputs = ShapeFitAffineOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eqs. 1, 5, 6",
    example = "\"motion\": (type: \"shape.fit_affine\", from: \"@key\", to: \"@outline\")"
)]
pub(crate) struct ShapeFitAffine {
    /// The contour that is moved.
    from: In<Shape>,
    /// The contour that it is moved to: as many points in the same order.
    to: In<Shape>,
    /// Motions that are allowed.
    #[input(default = affine)]
    model: Model,
}

/// The motion, and how well it fits.
#[derive(Outputs)]
pub(crate) struct ShapeFitAffineOutputs {
    /// `to` from `from`, pixels.
    motion: Affine2,
    /// Root mean square distance of the moved points from where they should be, pixels.
    error: Curve,
    /// Parameters of the motion that was fitted: 6 affine, 4 similarity, 3 rigid, 2 translation. Fewer than asked for where the points do
    /// not determine it.
    fitted: Curve,
    /// Largest over least spread of `from`, from 1: how much less sure the motion is across the contour than along it. Infinite for points
    /// on a line.
    condition: Curve,
}

impl PerFrame for ShapeFitAffine {
    fn run(self, _cx: &Context) -> Result<ShapeFitAffineOutputs, NodeError> {
        let Fit { motion, rms, model, condition } =
            fit(&self.from.points, &self.to.points, self.model).map_err(|e| NodeError::input(e.to_string()))?;
        let fitted = match model {
            Model::Translation => 2.0,
            Model::Rigid => 3.0,
            Model::Similarity => 4.0,
            Model::Affine => 6.0,
        };
        let curve = |value| Curve { value };
        Ok(ShapeFitAffineOutputs { motion: motion.into(), error: curve(rms), fitted: curve(fitted), condition: curve(condition) })
    }
}
