//! `image.crop`: cuts a picture to a window, or adds to it.
//!
//! **Method** samples are copied; outside the picture it is transparent.
//!
//! **Source** usual practice.
//!
//! **Fails when** the window is larger than memory.
//!
//! **Cost** O(samples of the window).
//!
//! ```ron
//! "cut": (type: "image.crop", image: "@plate", window: (0, 0, 640, 360)),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame, Problem};

use super::{Picture, made, refused};
use crate::algo::grade::crop;
use crate::algo::window::Window;
use crate::data::Image;

/// Cuts a picture to a window, or adds to it.
#[derive(Node)]
#[node(
    id = "image.crop",
    version = 1,
    outputs = Picture,
    example = "\"cut\": (type: \"image.crop\", image: \"@plate\", window: (0, 0, 640, 360))"
)]
pub(crate) struct ImageCrop {
    /// The picture.
    image: In<Image>,
    /// Left, top, right, bottom, the ends exclusive, in the pixel grid of the format.
    #[input(unit = "px", range = -1000000..=1000000)]
    window: [i64; 4],
    /// True makes the window the display window too; false keeps the format.
    #[input(default = true)]
    reformat: bool,
}

impl PerFrame for ImageCrop {
    fn run(self, _cx: &Context) -> Result<Picture, NodeError> {
        let window = Window::from(self.window);
        let display = self.image.display_window();
        let out = made(&self.image, window, |source, target| crop(source, target, window).map_err(refused))?;
        let image = out.image.with_windows(window, if self.reformat { window } else { display });
        Ok(Picture { image })
    }

    fn check(&self) -> Vec<Problem> {
        let [left, top, right, bottom] = self.window;
        let fine = left < right && top < bottom;
        let message = || "expected left < right and top < bottom, found a window without pixels".to_owned();
        if fine { Vec::new() } else { vec![Problem { input: "window", message: message() }] }
    }
}
