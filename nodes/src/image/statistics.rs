//! `image.statistics`: mean, least and greatest sample of a picture, channel by channel.
//!
//! **Method** over the display window, outside of its samples a picture being 0; see [`crate::algo::statistics`].
//!
//! **Source** usual practice.
//!
//! **Fails when** nothing of the picture is shown. Where a sample is no number the mean is none either, and the other two pass it over.
//!
//! **Cost** O(samples), one pass.
//!
//! ```ron
//! "levels": (type: "image.statistics", image: "@plate"),
//! ```

use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Vector;
use pegbar_engine::{Node, Outputs};

use crate::algo::statistics::{Statistics, statistics};
use crate::algo::warp_affine::Source;
use crate::data::Image;

/// Mean, least and greatest sample of a picture, channel by channel.
///
/// To see flicker or a clipped channel in a plot, to grade by, or to check that a render is not black.
#[derive(Node)]
#[node(
    id = "image.statistics",
    version = 1,
    outputs = ImageStatisticsOutputs,
    example = "\"levels\": (type: \"image.statistics\", image: \"@plate\")"
)]
pub(crate) struct ImageStatistics {
    /// The picture.
    image: In<Image>,
}

/// One number a channel, in the picture's own order: linear light, premultiplied.
#[derive(Outputs)]
pub(crate) struct ImageStatisticsOutputs {
    /// The mean.
    mean: Vector,
    /// The least sample.
    minimum: Vector,
    /// The greatest sample.
    maximum: Vector,
}

impl PerFrame for ImageStatistics {
    fn run(self, _cx: &Context) -> Result<ImageStatisticsOutputs, NodeError> {
        let (own, shown) = (self.image.data_window(), self.image.display_window());
        let found = statistics(Source::new(self.image.raster(), [own.x, own.y]), shown).ok_or_else(|| {
            NodeError::input(format!(
                "expected a picture of which something is shown, found a display window of {} x {}",
                shown.width, shown.height
            ))
        })?;
        let each = |of: fn(&Statistics) -> f64| Vector { values: found.iter().map(of).collect() };
        Ok(ImageStatisticsOutputs {
            mean: each(|s| s.mean),
            minimum: each(|s| f64::from(s.minimum)),
            maximum: each(|s| f64::from(s.maximum)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::window::Window;
    use crate::counted::clock;
    use pegbar_engine::node::Cancel;

    fn run(image: Image) -> Result<ImageStatisticsOutputs, NodeError> {
        let (clock, cancel) = (clock(1), Cancel::default());
        ImageStatistics { image: In::new(image) }.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
    }

    #[test]
    fn a_picture_that_fills_a_quarter_of_what_is_shown() {
        let image = Image::new(1, 1, 2, vec![0.5, 1.0]).unwrap().with_windows(Window::new(1, 1, 1, 1), Window::at_origin(2, 2));
        let found = run(image).unwrap();
        assert_eq!(found.mean.values, [0.125, 0.25]);
        assert_eq!((found.minimum.values, found.maximum.values), (vec![0.0, 0.0], vec![0.5, 1.0]));
    }

    #[test]
    fn a_picture_of_which_nothing_is_shown_is_refused() {
        let error = run(Image::new(0, 3, 1, Vec::new()).unwrap()).err().unwrap();
        assert_eq!(error.message, "expected a picture of which something is shown, found a display window of 0 x 3");
    }
}
