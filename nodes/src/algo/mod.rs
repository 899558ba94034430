//! The mathematics of the stages: pure functions on slices and matrices, each citing its equation. Nothing here knows the engine.

pub mod arap;
pub mod cel;
pub mod codec;
pub mod color;
pub mod color_clusters;
pub mod compatible;
pub mod filter;
pub mod fit_affine;
pub mod generate;
pub mod grade;
pub mod grid;
pub mod holds;
pub mod key_blend;
pub mod merge;
pub mod paint;
pub mod pca;
pub mod plot;
pub mod raster;
pub mod statistics;
pub mod table;
pub mod track_affine;
pub mod warp_affine;
mod warp_area;
pub mod warp_mesh;
mod warp_points;
mod warp_slant;
pub mod window;
