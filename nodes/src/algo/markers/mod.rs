//! Markers on the joints of a figure: their standard names, and how rigs of many makers call those joints.

pub mod naming;
pub mod standard;
