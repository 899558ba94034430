//! Pictures under an affine map.
