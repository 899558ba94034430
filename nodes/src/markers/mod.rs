//! Markers: taken from figures, projected, smoothed.

mod from_pose;
mod project;
mod smooth;

pub(crate) use from_pose::{Chosen, JointNames, MarkersFromPose, Names, Unmatched};
pub(crate) use project::{MarkersProject, seen};
pub(crate) use smooth::MarkersSmooth;
