//! Files in and out: pictures, values and tables.

mod file;
mod picture;
mod read_image;
mod read_images;
mod read_value;
#[cfg(test)]
mod tests;
mod write_images;
mod write_table;
mod write_value;

pub(crate) use read_image::IoReadImage;
pub(crate) use read_images::IoReadImages;
pub(crate) use read_value::IoReadValue;
pub(crate) use write_images::IoWriteImages;
pub(crate) use write_table::IoWriteTable;
pub(crate) use write_value::IoWriteValue;
