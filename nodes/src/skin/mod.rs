//! Surfaces that joints move.

mod linear_blend;

pub(crate) use linear_blend::{SkinLinearBlend, morph, motions};
