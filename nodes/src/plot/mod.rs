//! Plots of values over time.

mod curves;
mod gather;
mod playhead;
#[cfg(test)]
mod tests;

pub(crate) use curves::PlotCurves;
pub(crate) use playhead::PlotPlayhead;
