//! Contours: from mattes, in one order over time, and the motion between them.

mod fit_affine;
mod resample;
#[cfg(test)]
mod tests;
mod trace;

pub(crate) use fit_affine::ShapeFitAffine;
pub(crate) use resample::ShapeResample;
pub(crate) use trace::ShapeTrace;
