//! Meshes: their lines, and what makes them fair.

mod silhouette;
mod smooth;
#[cfg(test)]
mod tests;

pub(crate) use silhouette::MeshSilhouette;
pub(crate) use smooth::MeshSmooth;
