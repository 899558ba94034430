//! The list of all node types and value types, in the order of their names.

use pegbar_engine::registry::Registry;

use crate::data::{Affine2, Image, KeyShapes, Matte, Shape, Weights};
use crate::image::ImageWarpAffine;
use crate::io::{IoReadImage, IoReadImages, IoReadValue, IoWriteImages, IoWriteTable, IoWriteValue};
use crate::matte::MatteColorClusters;
use crate::track::TrackAffine;

/// Every node type and value type that Pegbar comes with.
pub fn registry() -> Registry {
    let types =
        Registry::new().value::<Affine2>().value::<Image>().value::<KeyShapes>().value::<Matte>().value::<Shape>().value::<Weights>();
    types
        .per_frame::<ImageWarpAffine>()
        .per_frame::<IoReadImage>()
        .per_frame::<IoReadImages>()
        .per_frame::<IoReadValue>()
        .per_frame::<IoWriteImages>()
        .whole::<IoWriteTable>()
        .whole::<IoWriteValue>()
        .recurrent::<MatteColorClusters>()
        .recurrent::<TrackAffine>()
}
