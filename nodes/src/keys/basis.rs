//! `keys.basis`: the linear space that key shapes span.
//!
//! **Method** principal components ([`crate::algo::pca`]), as few as leave no example off by more than `max_error`. With the in-betweens of
//! `keys.inbetween` any two-way interpolation becomes a linear space of all keys.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3, equation 3.
//!
//! **Fails when** a point is not finite. Keys that differ by an affine motion spend components on it: draw them in one place, or `align` them.
//!
//! **Cost** O(m² n) for m shapes of n points.
//!
//! ```ron
//! "space": (type: "keys.basis", keys: "@all", max_error: 0.25),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use super::{contours, key_shapes};
use crate::algo::pca::{Keep, Space, pca};
use crate::data::{Basis, KeyShapes};

/// The linear space that key shapes span.
///
/// `keys` are its L + 1 shapes whose weights add up to 1 (eq. 3): the mean plus each component, then the mean itself. A component is so long
/// that the example farthest along it has weight 1 or -1.
#[derive(Node)]
#[node(
    id = "keys.basis",
    version = 1,
    outputs = KeysBasisOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3, eq. 3",
    example = "\"space\": (type: \"keys.basis\", keys: \"@all\", max_error: 0.25)"
)]
pub(crate) struct KeysBasis {
    /// The examples: keys and in-betweens.
    keys: In<KeyShapes>,
    /// The worst example may be off by so much, root mean square over its points. 0 keeps all components.
    #[input(default = 0.25, range = 0.0.., unit = "px")]
    max_error: f64,
    /// Number of components, whatever the error. As many as `max_error` needs where it is left out.
    #[input(default = None, range = 0..=10000)]
    components: Option<u32>,
}

/// The space, and how well it holds the examples.
#[derive(Outputs)]
pub(crate) struct KeysBasisOutputs {
    /// Mean and orthonormal components: x and y of each point in turn, pixels.
    basis: Basis,
    /// The mean plus each component, then the mean.
    keys: KeyShapes,
    /// Error of the worst example with 0, 1, 2, ... components, root mean square over its points, pixels.
    errors: Vector,
    /// Share of the variance that 0, 1, 2, ... components hold, up to those that were kept.
    explained: Vector,
    /// Number of components.
    count: Curve,
}

/// The shapes of equation 3.
fn spanning(space: &Space, closed: bool) -> Result<KeyShapes, NodeError> {
    let points = |flat: Vec<f64>| flat.as_chunks().0.to_vec();
    let along = |(c, reach): (&Vec<f64>, &f64)| points(space.mean.iter().zip(c).map(|(m, v)| m + reach * v).collect());
    let mut shapes: Vec<Vec<[f64; 2]>> = space.components.iter().zip(&space.reach).map(along).collect();
    shapes.push(points(space.mean.clone()));
    let names = (1..shapes.len()).map(|l| format!("component {l}")).chain(["mean".to_owned()]).collect();
    key_shapes(&shapes, names, closed)
}

fn explained(space: &Space, examples: &[&[f64]]) -> Vec<f64> {
    let squares = |e: &&[f64]| e.iter().zip(&space.mean).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let total = examples.iter().map(squares).sum::<f64>() / examples.len() as f64;
    let mut sum = 0.0;
    let mut shares = vec![if total > 0.0 { 0.0 } else { 1.0 }];
    for v in &space.variances {
        sum += v;
        shares.push((sum / total).min(1.0));
    }
    shares
}

impl PerFrame for KeysBasis {
    fn run(self, _cx: &Context) -> Result<KeysBasisOutputs, NodeError> {
        let shapes = contours(&self.keys);
        let examples: Vec<&[f64]> = shapes.iter().map(|s| s.as_flattened()).collect();
        let keep = self.components.map_or(Keep::MaxError(self.max_error), |n| Keep::Components(n as usize));
        let n = self.keys.points.shape()[1];
        let space = pca(&examples, n, keep).map_err(|e| NodeError::input(e.to_string()))?;
        let l = space.components.len();
        let components =
            NdArray::new([l, 2 * n], space.components.concat()).ok_or_else(|| NodeError::internal("components of another length"))?;
        Ok(KeysBasisOutputs {
            keys: spanning(&space, self.keys.closed)?,
            explained: Vector { values: explained(&space, &examples) },
            count: Curve { value: l as f64 },
            errors: Vector { values: space.errors },
            basis: Basis { mean: space.mean, components, variances: space.variances },
        })
    }
}

#[cfg(test)]
mod tests;
