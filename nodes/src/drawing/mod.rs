//! Vector drawings put together.

mod merge;

pub(crate) use merge::DrawingMerge;
