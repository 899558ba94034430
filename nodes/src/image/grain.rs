//! `image.grain`: film grain.
//!
//! **Method** bell-shaped noise on the display's scale, two thirds of its variance common to red, green and blue as in a projected print; new on every
//! frame, the same for the same seed and frame. Where the picture is transparent there is none.
//!
//! **Source** usual practice.
//!
//! **Fails when** the picture has no colours.
//!
//! **Cost** O(pixels).
//!
//! ```ron
//! "plate": (type: "image.grain", image: "@comp", sigma: 2.0),
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::Picture;
use crate::algo::cel::add_grain;
use crate::data::Image;
use crate::render::{rgba, within};

/// Film grain.
#[derive(Node)]
#[node(id = "image.grain", version = 1, outputs = Picture, example = "\"plate\": (type: \"image.grain\", image: \"@comp\", sigma: 2.0)")]
pub(crate) struct ImageGrain {
    /// The picture.
    image: In<Image>,
    /// Standard deviation of the grain, in 1/255 of the display range. 0 is clean.
    #[input(default = 2.0, range = 0.0..=255.0)]
    sigma: f64,
    /// Chooses the grain.
    #[input(default = 1)]
    seed: u64,
}

impl PerFrame for ImageGrain {
    fn run(self, cx: &Context) -> Result<Picture, NodeError> {
        within("sigma", self.sigma, 0.0, 255.0)?;
        let window = self.image.data_window();
        let clean = rgba(&self.image, window)?;
        let mut samples = clean.clone();
        add_grain(&mut samples, window.width, self.sigma, self.seed, cx.frame as u64);
        for (pixel, clean) in samples.chunks_exact_mut(4).zip(clean.chunks_exact(4)).filter(|(_, clean)| clean[3] <= 0.0) {
            pixel.copy_from_slice(clean);
        }
        let image = Image::new(window.width, window.height, 4, samples);
        let image = image.ok_or_else(|| NodeError::internal("a picture of another size than its window"))?;
        Ok(Picture { image: image.with_windows(window, self.image.display_window()) })
    }
}

#[cfg(test)]
mod tests {
    use pegbar_engine::node::Cancel;

    use super::*;
    use crate::counted::clock;

    fn grained(value: [f32; 4], frame: i64, sigma: f64) -> Vec<f32> {
        let clock = clock(2);
        let cx = Context { frame, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
        let image = Image::new(64, 64, 4, value.repeat(64 * 64)).unwrap();
        ImageGrain { image: In::new(image), sigma, seed: 1 }.run(&cx).unwrap().image.samples().to_vec()
    }

    #[test]
    fn grain_is_as_strong_as_asked_and_new_on_every_frame() {
        let grey = [0.214, 0.214, 0.214, 1.0];
        let (first, second) = (grained(grey, 1, 4.0), grained(grey, 2, 4.0));
        assert_eq!(first, grained(grey, 1, 4.0));
        assert_ne!(first, second);
        let display = |v: f32| crate::algo::color::srgb_from_linear(f64::from(v)) * 255.0;
        let mean = 255.0 * crate::algo::color::srgb_from_linear(0.214);
        let variance = first.chunks_exact(4).map(|p| (display(p[0]) - mean).powi(2)).sum::<f64>() / 4096.0;
        assert!((variance.sqrt() - 4.0).abs() < 0.2, "{}", variance.sqrt());
    }

    #[test]
    fn nothing_grows_where_nothing_is() {
        assert!(grained([0.0; 4], 1, 8.0).iter().all(|v| *v == 0.0));
        assert_eq!(grained([0.5, 0.2, 0.1, 1.0], 1, 0.0), [0.5, 0.2, 0.1, 1.0].repeat(64 * 64));
    }
}
