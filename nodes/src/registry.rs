//! The list of all node types and value types, in the order of their names.

use pegbar_engine::registry::Registry;

use crate::data::{Affine2, Image, KeyShapes, Matte, Shape, Weights};
use crate::image::ImageWarpAffine;
use crate::matte::MatteColorClusters;
use crate::time::{RetimeApply, TimeFindHolds, TimeHold, TimeOffset, TimeResample};
use crate::track::TrackAffine;

/// Every node type and value type that Pegbar comes with.
pub fn registry() -> Registry {
    nodes(types(Registry::new()))
}

#[rustfmt::skip]
fn types(registry: Registry) -> Registry {
    registry
        .value::<Affine2>()
        .value::<Image>()
        .value::<KeyShapes>()
        .value::<Matte>()
        .value::<Shape>()
        .value::<Weights>()
}

#[rustfmt::skip]
fn nodes(registry: Registry) -> Registry {
    registry
        .per_frame::<ImageWarpAffine>()
        .recurrent::<MatteColorClusters>()
        .per_frame::<RetimeApply>()
        .whole::<TimeFindHolds>()
        .per_frame::<TimeHold>()
        .per_frame::<TimeOffset>()
        .per_frame::<TimeResample>()
        .recurrent::<TrackAffine>()
}
