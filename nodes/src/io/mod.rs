//! Files in and out: pictures, values and tables.

mod file;
mod picture;
mod read_image;
mod read_images;
#[cfg(test)]
mod tests;
mod write_images;

pub(crate) use read_image::IoReadImage;
pub(crate) use read_images::IoReadImages;
pub(crate) use write_images::IoWriteImages;
