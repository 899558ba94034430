//! Linear spaces of values.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// A linear space around a mean: what principal component analysis finds.
#[derive(Clone, Debug, PartialEq, Value)]
#[value(check = "validate")]
pub struct Basis {
    /// The mean; of shapes x and y of each point in turn, pixels.
    #[value(shape = "[d]")]
    pub mean: Vec<f64>,
    /// Orthonormal directions, the widest first.
    #[value(shape = "[l, d]")]
    pub components: NdArray<f64, 2>,
    /// Variance of the examples along each direction.
    #[value(shape = "[l]")]
    pub variances: Vec<f64>,
}

impl Basis {
    fn validate(&self) -> Result<(), String> {
        let ([l, d], n, v) = (self.components.shape(), self.mean.len(), self.variances.len());
        if d != n && l > 0 || l != v {
            return Err(format!("expected components of {v} by {n} as variances and mean say, found {l} by {d}"));
        }
        Ok(())
    }
}
