//! Meshes warped in the picture.

mod layered;

pub(crate) use layered::WarpLayered;
