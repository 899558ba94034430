//! Filled and stroked paths with exact area coverage.
