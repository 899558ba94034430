//! Curves of drawings, and what of a mesh they show.

mod anchors;
#[cfg(test)]
mod character_tests;
mod correspond;
#[cfg(test)]
mod tests;
mod trace;

pub(crate) use correspond::CorrespondCurves;
pub(crate) use trace::{CurveTrace, ink_of};
