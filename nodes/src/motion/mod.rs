//! Motion set by hand.

mod keys;
pub(crate) mod timing;

pub(crate) use keys::MotionKeys;
