//! The types that travel along wires: ordinary structs, each of which can be taken apart into named arrays.

mod affine;
mod basis;
mod camera;
mod curves;
mod drawing;
mod field;
mod image;
mod key_images;
mod markers;
mod matte;
mod mesh;
mod shape;
mod skeleton;
mod table;
mod warp_path;
mod weights;

pub use affine::Affine2;
pub use basis::{Basis, BasisKind};
pub use camera::Camera;
pub use curves::{CurveRef, Curves};
pub use drawing::{Contour, Drawing, KeyDrawings};
pub use field::{Correspondences, Field2, Field3};
pub use image::Image;
pub(crate) use image::LARGEST;
pub use key_images::KeyImages;
pub use markers::{Markers2, Markers3};
pub use matte::Matte;
pub use mesh::{Mesh, MorphTargets, SkinnedMesh};
pub use shape::{KeyShapes, Shape};
pub use skeleton::{Pose, Skeleton};
pub use table::Table;
pub use warp_path::WarpPath;
pub use weights::Weights;
