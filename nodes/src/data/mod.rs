//! The types that travel along wires: ordinary structs, each of which can be taken apart into named arrays.

mod affine;
mod basis;
mod drawing;
mod image;
mod key_images;
mod matte;
mod shape;
mod weights;

pub use affine::Affine2;
pub use basis::{Basis, BasisKind};
pub use drawing::{Contour, Drawing, KeyDrawings};
pub use image::Image;
pub(crate) use image::LARGEST;
pub use key_images::KeyImages;
pub use matte::Matte;
pub use shape::{KeyShapes, Shape};
pub use weights::Weights;
