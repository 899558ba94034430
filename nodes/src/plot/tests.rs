//! Plots in whole graphs.
