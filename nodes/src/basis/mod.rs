//! Linear spaces.

mod pca;

pub(crate) use pca::{BasisPca, numbers};
