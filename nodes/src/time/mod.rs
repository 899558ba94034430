//! Time: streams held, moved and played on other clocks.

mod dtw;
mod find_holds;
#[cfg(test)]
mod graph_tests;
mod hold;
mod offset;
mod pick;
mod resample;
mod retime;

pub(crate) use dtw::{RetimeDtw, position, series};
pub(crate) use find_holds::TimeFindHolds;
pub(crate) use hold::TimeHold;
pub(crate) use offset::TimeOffset;
pub(crate) use pick::TimePick;
pub(crate) use resample::TimeResample;
pub(crate) use retime::RetimeApply;

use pegbar_engine::Outputs;
use pegbar_engine::clock::Clock;
use pegbar_engine::value::ValueRef;

/// The stream on another clock.
#[derive(Outputs)]
pub(crate) struct Retimed {
    /// Of the same type as the stream that came in.
    stream: ValueRef,
}

/// The time of `frame` of one clock as a frame of another, both starting together; whole numbers are exact, fractions lie between frames.
fn frame_on(source: &Clock, target: &Clock, frame: i64) -> (i64, f64) {
    // Frames and rates are small whole numbers, so that the product fits and no rounding moves a frame.
    let (num, den) = (i128::from(source.fps.0) * i128::from(target.fps.1), i128::from(source.fps.1) * i128::from(target.fps.0));
    let ticks = i128::from(frame - target.first) * num;
    let whole = ticks.div_euclid(den);
    (source.first + whole as i64, ticks.rem_euclid(den) as f64 / den as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(first: i64, fps: (u32, u32)) -> Clock {
        Clock { name: "c".to_owned(), first, last: first + 1000, fps }
    }

    #[test]
    fn frames_of_one_clock_are_found_on_another_exactly() {
        assert_eq!(frame_on(&clock(1, (24, 1)), &clock(1, (24, 1)), 7), (7, 0.0));
        assert_eq!(frame_on(&clock(1, (120, 1)), &clock(1, (24, 1)), 3), (11, 0.0));
        assert_eq!(frame_on(&clock(0, (24, 1)), &clock(0, (120, 1)), 7), (1, 0.4));
        assert_eq!(frame_on(&clock(0, (24, 1)), &clock(10, (24_000, 1001)), 10 + 24_000), (24_024, 0.0));
        assert_eq!(frame_on(&clock(0, (24, 1)), &clock(10, (24, 1)), 8), (-2, 0.0));
    }
}
