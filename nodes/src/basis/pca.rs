//! `basis.pca`: the linear space that the frames of a stream span.
//!
//! **Method** principal components ([`crate::algo::pca`]). Poses of markers are freed from where the figure stands and which way it looks first.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.5, equations 12 and 13 (an activity's poses); Bregler, Loeb, Chuang, Deshpande 2002, equation 3.
//!
//! **Fails when** frames have different lengths, or numbers that are not finite. A space out of few clips leaves out what they do not do.
//!
//! **Cost** O(m d min(m, d)) for m frames of d numbers.
//!
//! ```ron
//! "walks": (type: "basis.pca", values: "@captured", components: 20),
//! ```

use nalgebra::Vector3;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::{AnySequence, Context, NodeError, Whole};
use pegbar_engine::value::{Curve, ValueRef, Vector, downcast};
use pegbar_engine::{Node, Outputs};

use crate::algo::lift::Framing;
use crate::algo::pca::{Keep, pca};
use crate::data::{Basis, Markers3};
use crate::lift::framed;

/// The linear space that the frames of a stream span.
#[derive(Node)]
#[node(
    id = "basis.pca",
    version = 1,
    kind = whole,
    outputs = BasisPcaOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.5, eqs. 12 and 13",
    example = "\"walks\": (type: \"basis.pca\", values: \"@captured\", components: 20)"
)]
pub(crate) struct BasisPca {
    /// The examples: markers, vectors, poses, or anything else that is made of numbers.
    #[input(any_clock)]
    values: AnySequence,
    /// How many components are kept; fewer where the examples do not span them. All that `max_error` asks for where it is left out.
    #[input(default = None, range = 0..=100000)]
    components: Option<u32>,
    /// The worst example may be off by so much, root mean square over its points (numbers, unless they are markers). 0 keeps all components.
    #[input(default = 0.0, range = 0.0..=1e9)]
    max_error: f64,
    /// What poses of markers are relative to; other values are as they are.
    #[input(default = heading)]
    framing: Framing,
    /// The marker that poses are relative to.
    #[input(default = "pelvis")]
    root: String,
    /// The markers that tell the heading, left and right.
    #[input(default = ["left_hip", "right_hip"])]
    hips: Vec<String>,
}

/// The space.
#[derive(Outputs)]
pub(crate) struct BasisPcaOutputs {
    /// Mean, orthonormal components and variances.
    basis: Basis,
    /// For 0, 1, 2, ... components the share of all variance that they explain.
    explained: Vector,
    /// For 0, 1, 2, ... components the error of the worst example.
    errors: Vector,
    /// Number of components.
    count: Curve,
}

/// All numbers of a value, array by array.
pub(crate) fn numbers(value: &ValueRef) -> Vec<f64> {
    value.parts().arrays.iter().flat_map(|(_, view)| view.numbers()).collect()
}

impl BasisPca {
    fn example(&self, value: &ValueRef) -> Result<(Vec<f64>, usize), NodeError> {
        let Some(markers) = downcast::<Markers3>(value.clone()) else {
            let all = numbers(value);
            let n = all.len();
            return Ok((all, n));
        };
        let stand = framed(&markers, self.framing, &self.root, &self.hips)?;
        let local = markers.points.iter().flat_map(|p| <[f64; 3]>::from(stand.local(Vector3::from(*p))));
        Ok((local.collect(), markers.points.len()))
    }
}

impl Whole for BasisPca {
    fn run(self, cx: &Context) -> Result<BasisPcaOutputs, NodeError> {
        let first = self.values.clock().map_or(cx.clock.first, |c| c.first);
        let (mut rows, mut points) = (Vec::with_capacity(self.values.len()), 1);
        for k in 0..self.values.len() {
            cx.check()?;
            let (row, n) = self
                .example(&self.values.get(k)?)
                .map_err(|e| NodeError { message: format!("values at frame {}: {}", first + k as i64, e.message), ..e })?;
            rows.push(row);
            points = n;
        }
        let keep = self.components.map_or(Keep::MaxError(self.max_error), |n| Keep::Components(n as usize));
        let views: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
        let space = pca(&views, points, keep).map_err(|e| NodeError::input(format!("values: {e}")))?;
        let total: f64 = rows.iter().flat_map(|r| r.iter().zip(&space.mean)).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / rows.len() as f64;
        let mut explained = vec![0.0];
        for v in &space.variances {
            explained.push(explained.last().copied().unwrap_or_default() + if total > 0.0 { v / total } else { 0.0 });
        }
        let (l, d) = (space.components.len(), space.mean.len());
        let components =
            NdArray::new([l, d], space.components.concat()).ok_or_else(|| NodeError::internal("components of another length"))?;
        Ok(BasisPcaOutputs {
            basis: Basis { coordinates: space.coordinates, ..Basis::new(space.mean, components, space.variances) },
            explained: Vector { values: explained },
            errors: Vector { values: space.errors },
            count: Curve { value: l as f64 },
        })
    }
}

#[cfg(test)]
mod tests;
