//! Markers: taken from figures, projected, smoothed.

mod from_pose;
mod project;

pub(crate) use from_pose::MarkersFromPose;
pub(crate) use project::MarkersProject;
