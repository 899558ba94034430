//! Clocks: named time domains with a frame range and a rational rate.

use serde::{Deserialize, Serialize};

/// A time domain: drawings at 24 frames a second and motion capture at 120 are two.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Clock {
    /// Its name; the default clock is `frames`.
    pub name: String,
    /// First frame.
    pub first: i64,
    /// Last frame, at least `first`.
    pub last: i64,
    /// Frames a second, as numerator and denominator.
    pub fps: (u32, u32),
}

impl Clock {
    /// Number of frames.
    pub fn len(&self) -> usize {
        usize::try_from(self.last - self.first + 1).unwrap_or(0)
    }

    /// True where the clock has no frame.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Frames a second.
    pub fn rate(&self) -> f64 {
        f64::from(self.fps.0) / f64::from(self.fps.1)
    }

    /// The nearest frame that the clock has.
    pub fn clamp(&self, frame: i64) -> i64 {
        frame.clamp(self.first, self.last)
    }

    /// Position of a frame in the clock's range; `None` outside.
    pub fn index(&self, frame: i64) -> Option<usize> {
        (self.first..=self.last).contains(&frame).then(|| (frame - self.first) as usize)
    }

    /// Every frame, in order.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = i64> + use<> {
        let first = self.first;
        (0..self.len()).map(move |i| first + i as i64)
    }
}
