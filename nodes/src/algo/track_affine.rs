//! Affine image registration.
