//! `image.shuffle`: picks, orders and drops channels.
//!
//! **Method** each channel of the result is one of the picture by name, or `0` or `1`.
//!
//! **Source** usual practice.
//!
//! **Fails when** the picture has no channel of a name.
//!
//! **Cost** O(samples).
//!
//! ```ron
//! "red": (type: "image.shuffle", image: "@plate", channels: ["R", "R", "R", "A"]),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame, Problem};

use super::{Picture, refused};
use crate::algo::grade::{Channel, shuffle};
use crate::data::Image;

/// Picks, orders and drops channels.
#[derive(Node)]
#[node(
    id = "image.shuffle",
    version = 1,
    outputs = Picture,
    example = "\"red\": (type: \"image.shuffle\", image: \"@plate\", channels: [\"R\", \"R\", \"R\", \"A\"])"
)]
pub(crate) struct ImageShuffle {
    /// The picture.
    image: In<Image>,
    /// Channels of the result by their names in the picture; `"0"` and `"1"` stand for those values: `["R", "G", "B", "1"]`.
    channels: Vec<String>,
    /// Their names in the result. By their number (Y, YA, RGB, RGBA) where it is left out.
    #[input(default = [])]
    names: Vec<String>,
}

impl PerFrame for ImageShuffle {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let own = self.image.channels();
        let pick = |name: &String| match name.as_str() {
            "0" => Ok(Channel::Value(0.0)),
            "1" => Ok(Channel::Value(1.0)),
            _ => own.iter().position(|c| c == name).map(Channel::From).ok_or_else(|| absent(name, &own)),
        };
        let picks = self.channels.iter().map(pick).collect::<Result<Vec<_>, _>>()?;
        let (width, height) = (self.image.width(), self.image.height());
        let mut samples = vec![0.0; width * height * picks.len()];
        shuffle(self.image.samples(), own.len(), &picks, &mut samples).map_err(refused)?;
        let image = Image::new(width, height, picks.len(), samples)
            .ok_or_else(|| NodeError::internal("a picture of another size than its samples"))?;
        let image = image.with_windows(self.image.data_window(), self.image.display_window()).with_channels(self.names);
        Ok(Picture { image })
    }

    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        if self.channels.is_empty() {
            problems.push(Problem { input: "channels", message: "expected at least one channel, found none".to_owned() });
        }
        if !self.names.is_empty() && self.names.len() != self.channels.len() {
            let message = format!("expected {} names, one a channel, found {}", self.channels.len(), self.names.len());
            problems.push(Problem { input: "names", message });
        }
        problems
    }
}

fn absent(name: &str, own: &[String]) -> NodeError {
    NodeError::input(format!("expected one of the channels {}, found `{name}`", own.join(", ")))
}
