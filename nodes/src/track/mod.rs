//! Trackers: where a region of a reference frame is in every other.

mod affine;

pub(crate) use affine::TrackAffine;
