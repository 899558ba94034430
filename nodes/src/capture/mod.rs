//! Captures: drawn motion as numbers.

mod contour;

pub(crate) use contour::CaptureContour;
