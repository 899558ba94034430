//! `time.find_holds`: which film frames show one drawing.
//!
//! **Method** see [`crate::algo::holds`]: block means of neighbouring frames against the grain.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002 (drawings held for two frames).
//!
//! **Fails when** nothing in the footage is ever still: with a moving camera every frame is a drawing of its own.
//!
//! **Cost** O(samples) a frame; one frame is in memory.
//!
//! ```ron
//! "holds": (type: "time.find_holds", image: "@plate"),
//! ```

use pegbar_engine::node::{Context, NodeError, Sequence, Stream, Whole};
use pegbar_engine::value::{Curve, TimeMap};
use pegbar_engine::{Node, Outputs};

use crate::algo::holds::{Finder, Options, block_means};
use crate::data::Image;

/// Which film frames show one drawing.
#[derive(Node)]
#[node(
    id = "time.find_holds",
    version = 1,
    kind = whole,
    outputs = TimeFindHoldsOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 1.1",
    example = "\"holds\": (type: \"time.find_holds\", image: \"@plate\")"
)]
pub(crate) struct TimeFindHolds {
    /// The footage.
    image: Sequence<Image>,
    /// How much more than the grain two frames differ for a new drawing. Small sees slight moves, large forgives dirt and flicker.
    #[input(default = 3.0, range = 1.0..=100.0)]
    sensitivity: f64,
    /// Share of the picture that must change at the least for a new drawing: 0 for a single blink in a wide shot.
    #[input(default = 0.0005, range = 0.0..=1.0)]
    min_area: f64,
}

/// The holds.
#[derive(Outputs)]
pub(crate) struct TimeFindHoldsOutputs {
    /// For each frame the first frame of its hold: `retime.apply` with it shows each drawing's first frame throughout.
    holds: TimeMap,
    /// Number of the drawing that each frame shows, from 1.
    drawing: Stream<Curve>,
    /// Number of drawings.
    count: Curve,
}

impl Whole for TimeFindHolds {
    fn run(self, cx: &Context) -> Result<TimeFindHoldsOutputs, NodeError> {
        let mut finder = Finder::new(Options { sensitivity: self.sensitivity, min_area: self.min_area });
        for k in 0..self.image.len() {
            cx.check()?;
            finder.push(block_means(self.image.get(k)?.in_display()?.raster()));
        }
        let holds = finder.finish();
        let mut count = 0;
        let mut drawing = Vec::with_capacity(holds.len());
        for (k, &first) in holds.iter().enumerate() {
            count += usize::from(first == k);
            drawing.push(Curve { value: count as f64 });
        }
        // A single picture stands for every frame of the clock.
        drawing.resize(cx.clock.len().max(drawing.len()), Curve { value: count as f64 });
        let first = self.image.clock().map_or(cx.clock.first, |c| c.first);
        let mut source_frames: Vec<f64> = holds.iter().map(|&k| (first + k as i64) as f64).collect();
        source_frames.resize(drawing.len(), first as f64);
        Ok(TimeFindHoldsOutputs { holds: TimeMap { source_frames }, drawing: Stream(drawing), count: Curve { value: count as f64 } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::{clock, counted};
    use pegbar_engine::node::Cancel;

    #[test]
    fn one_frame_is_held_at_a_time_and_read_once() {
        let (image, count) = counted(12, |k| Image::new(32, 32, 1, vec![(k / 2 % 2) as f32; 1024]).unwrap());
        let clock = clock(12);
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
        let found = TimeFindHolds { image, sensitivity: 3.0, min_area: 0.0005 }.run(&cx).unwrap();
        assert_eq!(found.count.value, 6.0);
        assert_eq!((count.peak(), count.reads()), (1, 12));
    }
}
