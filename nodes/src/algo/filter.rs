//! Blur and resampling.
