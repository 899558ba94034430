//! Whole mattes against exact truth.
