//! Mattes: how much of each pixel belongs to a layer.

mod color_clusters;
mod from_image;

pub(crate) use color_clusters::MatteColorClusters;
pub(crate) use from_image::MatteFromImage;
