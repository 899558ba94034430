//! Plots: values over time, time warps, measures.

mod bars;
mod cost_matrix;
mod curves;
mod gather;
mod playhead;
#[cfg(test)]
mod tests;

pub(crate) use bars::PlotBars;
pub(crate) use cost_matrix::PlotCostMatrix;
pub(crate) use curves::PlotCurves;
pub(crate) use playhead::PlotPlayhead;
