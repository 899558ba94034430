//! Point operations: grading, premultiplication, channel shuffles, cropping.
