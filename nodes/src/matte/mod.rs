//! Mattes: how much of each pixel belongs to a layer.

mod color_clusters;

pub(crate) use color_clusters::MatteColorClusters;
