//! Files in and out: pictures, values and tables.

mod capture;
mod file;
mod gltf;
mod picture;
mod read_amc;
mod read_bvh;
mod read_drawings;
mod read_gltf;
mod read_image;
mod read_images;
mod read_key_drawings;
mod read_key_shapes;
mod read_markers;
mod read_shapes;
mod read_value;
mod search_bvh;
mod svg;
#[cfg(test)]
mod tests;
mod write_bvh;
mod write_drawings;
mod write_gltf;
mod write_images;
mod write_markers;
mod write_table;
mod write_value;

pub(crate) use read_amc::IoReadAmc;
pub(crate) use read_bvh::IoReadBvh;
pub(crate) use read_drawings::IoReadDrawings;
pub(crate) use read_gltf::IoReadGltf;
pub(crate) use read_image::IoReadImage;
pub(crate) use read_images::IoReadImages;
pub(crate) use read_key_drawings::IoReadKeyDrawings;
pub(crate) use read_key_shapes::IoReadKeyShapes;
pub(crate) use read_markers::IoReadMarkers;
pub(crate) use read_shapes::IoReadShapes;
pub(crate) use read_value::IoReadValue;
pub(crate) use search_bvh::IoSearchBvh;
pub(crate) use write_bvh::IoWriteBvh;
pub(crate) use write_drawings::IoWriteDrawings;
pub(crate) use write_gltf::IoWriteGltf;
pub(crate) use write_images::IoWriteImages;
pub(crate) use write_markers::IoWriteMarkers;
pub(crate) use write_table::IoWriteTable;
pub(crate) use write_value::IoWriteValue;
