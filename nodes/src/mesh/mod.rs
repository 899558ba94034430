//! Meshes: their lines and yours on them, and what makes them fair.

mod features;
mod silhouette;
mod smooth;
#[cfg(test)]
mod tests;

pub(crate) use features::MeshFeatures;
pub(crate) use silhouette::MeshSilhouette;
pub(crate) use smooth::MeshSmooth;
