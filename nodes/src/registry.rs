//! The list of all node types and value types, in the order of their names.

use pegbar_engine::registry::Registry;

use crate::data::{Affine2, Image, KeyShapes, Matte, Shape, Weights};

/// Every node type and value type that Pegbar comes with.
pub fn registry() -> Registry {
    Registry::new().value::<Affine2>().value::<Image>().value::<KeyShapes>().value::<Matte>().value::<Shape>().value::<Weights>()
}
