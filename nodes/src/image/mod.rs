//! Pictures: moved, filtered, graded.

mod warp_affine;

pub(crate) use warp_affine::ImageWarpAffine;
