//! Frame ranges as the trade writes them: `5`, `1-48`, `1-48x2`, `-10--5`, and lists of them.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::clock::Clock;

/// Frames from one to another in steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    /// First frame.
    pub first: i64,
    /// Last frame, at least `first`; left out where no step meets it.
    pub last: i64,
    /// Step, at least 1.
    pub step: u64,
}

/// One or more ranges, in the order in which they are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameSet(pub Vec<FrameRange>);

/// Why frames are none.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FramesError {
    /// Not a range.
    #[error("expected frames as 5, 1-48, 1-48x2 or 1-10,20, found `{0}`")]
    Form(String),
    /// The last frame is before the first.
    #[error("expected a range that goes up, found `{0}`")]
    Backward(String),
    /// A step of nought.
    #[error("expected a step of at least 1, found `{0}`")]
    Step(String),
    /// A frame that the clock does not have.
    #[error("expected frames from {first} to {last} on clock `{clock}`, found {found}")]
    Outside {
        /// Name of the clock.
        clock: String,
        /// Its first frame.
        first: i64,
        /// Its last frame.
        last: i64,
        /// The range that leaves it.
        found: FrameRange,
    },
}

/// A number with its sign from the start of the text, and the rest.
fn number(text: &str) -> Option<(i64, &str)> {
    let sign = usize::from(text.starts_with('-'));
    let digits = text[sign..].bytes().take_while(u8::is_ascii_digit).count();
    let (head, rest) = text.split_at(sign + digits);
    Some((head.parse().ok()?, rest))
}

impl FromStr for FrameRange {
    type Err = FramesError;

    fn from_str(text: &str) -> Result<Self, FramesError> {
        let text = text.trim();
        let form = || FramesError::Form(text.to_owned());
        let (first, rest) = number(text).ok_or_else(form)?;
        let (last, rest) = match rest.strip_prefix('-') {
            Some(rest) => number(rest).ok_or_else(form)?,
            None => (first, rest),
        };
        let step = match rest.strip_prefix('x') {
            Some(step) if step.bytes().all(|b| b.is_ascii_digit()) => step.parse().map_err(|_| form())?,
            None if rest.is_empty() => 1,
            _ => return Err(form()),
        };
        if last < first {
            return Err(FramesError::Backward(text.to_owned()));
        }
        if step == 0 {
            return Err(FramesError::Step(text.to_owned()));
        }
        Ok(Self { first, last, step })
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.first == self.last, self.step) {
            (true, _) => write!(f, "{}", self.first),
            (false, 1) => write!(f, "{}-{}", self.first, self.last),
            (false, step) => write!(f, "{}-{}x{step}", self.first, self.last),
        }
    }
}

impl FrameRange {
    /// The frames of the range on a clock, ascending.
    fn on(&self, clock: &Clock) -> Result<impl Iterator<Item = i64> + use<>, FramesError> {
        if self.first < clock.first || self.last > clock.last {
            return Err(FramesError::Outside { clock: clock.name.clone(), first: clock.first, last: clock.last, found: *self });
        }
        let step = usize::try_from(self.step).unwrap_or(usize::MAX);
        Ok((self.first..=self.last).step_by(step))
    }
}

impl FromStr for FrameSet {
    type Err = FramesError;

    fn from_str(text: &str) -> Result<Self, FramesError> {
        text.split(',').map(str::parse).collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for FrameSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&parts.join(","))
    }
}

impl FrameSet {
    /// The frames on a clock, ascending, each once. Never more than the clock has, whatever the ranges say.
    ///
    /// # Errors
    /// Where a range leaves the clock.
    pub fn on(&self, clock: &Clock) -> Result<Vec<i64>, FramesError> {
        let mut frames = Vec::new();
        for range in &self.0 {
            frames.extend(range.on(clock)?);
        }
        frames.sort_unstable();
        frames.dedup();
        Ok(frames)
    }
}

/// Ascending frames as ranges, `3-48` or `1-3, 7`; those beyond the eighth range are counted.
pub fn frame_ranges(frames: &[i64]) -> String {
    let mut ranges: Vec<FrameRange> = Vec::new();
    for &frame in frames {
        match ranges.last_mut() {
            Some(range) if range.last.checked_add(1) == Some(frame) => range.last = frame,
            _ => ranges.push(FrameRange { first: frame, last: frame, step: 1 }),
        }
    }
    let shown: Vec<String> = ranges.iter().take(8).map(ToString::to_string).collect();
    let more = ranges.len().saturating_sub(8);
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn clock(first: i64, last: i64) -> Clock {
        Clock { name: "frames".to_owned(), first, last, fps: (24, 1) }
    }

    fn on(text: &str, first: i64, last: i64) -> Result<Vec<i64>, String> {
        let set: FrameSet = text.parse().map_err(|e: FramesError| e.to_string())?;
        set.on(&clock(first, last)).map_err(|e| e.to_string())
    }

    #[test]
    fn ranges_read_as_the_trade_writes_them() {
        assert_eq!(on("5", 1, 9), Ok(vec![5]));
        assert_eq!(on("1-4", 1, 9), Ok(vec![1, 2, 3, 4]));
        assert_eq!(on("1-8x3", 1, 9), Ok(vec![1, 4, 7]));
        assert_eq!(on("7, 1-3,2", 1, 9), Ok(vec![1, 2, 3, 7]));
        assert_eq!(on("-3--1", -5, 9), Ok(vec![-3, -2, -1]));
        assert_eq!(on("-1-1", -5, 9), Ok(vec![-1, 0, 1]));
    }

    #[test]
    fn what_is_no_range_is_said() {
        for bad in ["", "a", "1-", "-", "1-2x", "1x", "1--", "1-2-3", "1,,2", "1.5", "1-2x-1", "99999999999999999999", "1-2y2"] {
            assert_eq!(on(bad, 1, 9).unwrap_err().split(',').next(), Some("expected frames as 5"), "{bad}");
        }
        assert_eq!(on("4-1", 1, 9).unwrap_err(), "expected a range that goes up, found `4-1`");
        assert_eq!(on("1-4x0", 1, 9).unwrap_err(), "expected a step of at least 1, found `1-4x0`");
        assert_eq!(on("3-12", 1, 9).unwrap_err(), "expected frames from 1 to 9 on clock `frames`, found 3-12");
        assert_eq!(
            on("1-9223372036854775807", 1, 9).unwrap_err(),
            "expected frames from 1 to 9 on clock `frames`, found 1-9223372036854775807"
        );
    }

    proptest! {
        #[test]
        fn a_range_reads_back_as_it_is_shown(first in -500i64..500, length in 0i64..500, step in 1u64..50) {
            let last = first + length;
            let range = FrameRange { first, last, step: if length == 0 { 1 } else { step } };
            prop_assert_eq!(range.to_string().parse::<FrameRange>(), Ok(range));
            let frames = FrameSet(vec![range]).on(&clock(-1000, 1000)).unwrap();
            let expected: Vec<i64> = (first..=last).filter(|f| (f - first) as u64 % range.step == 0).collect();
            prop_assert_eq!(frames, expected);
        }

        #[test]
        fn no_text_panics(text in "[-0-9x, ]{0,12}") {
            let _ = text.parse::<FrameSet>().map(|s| s.on(&clock(0, 100)));
        }

        #[test]
        fn frames_read_back_from_their_ranges(mask in proptest::collection::vec(any::<bool>(), 1..12)) {
            let frames: Vec<i64> = mask.iter().enumerate().filter(|(_, m)| **m).map(|(i, _)| i as i64 - 4).collect();
            prop_assume!(!frames.is_empty());
            let set: FrameSet = frame_ranges(&frames).parse().unwrap();
            prop_assert_eq!(set.on(&clock(-4, 20)), Ok(frames));
        }
    }
}
