//! Trackers: where a region of a reference frame is in every other, and which pose it shows.

mod affine;
mod eigen;
#[cfg(test)]
mod eigen_tests;

pub(crate) use affine::TrackAffine;
pub(crate) use eigen::TrackEigen;
