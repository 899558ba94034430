//! Soft mattes from Gaussian mixtures of colour.
