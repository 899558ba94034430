//! Compositing: pictures laid over each other.

mod mask;
mod merge;
mod over;

pub(crate) use mask::CompMask;
pub(crate) use merge::CompMerge;
pub(crate) use over::CompOver;

use std::sync::Arc;

use pegbar_engine::Outputs;
use pegbar_engine::node::{Fault, In, NodeError};

use crate::algo::merge::{MergeError, MergeOptions, Operation, merge, merge_in_place, merge_into_foreground};
use crate::algo::warp_affine::Source;
use crate::algo::window::Window;
use crate::data::{Image, LARGEST};

/// The merged picture.
#[derive(Outputs)]
pub(crate) struct Merged {
    /// It, premultiplied.
    image: Image,
}

/// Channels that two pictures are merged in: both alpha, and colour where either has colour.
fn common_channels(fg: &Image, bg: &Image) -> usize {
    let colour = |i: &Image| i.n_channels() >= 3;
    if colour(fg) || colour(bg) { 4 } else { 2 }
}

/// The picture in two channels (Y, A) or four (R, G, B, A), opaque where it has no alpha of its own.
fn in_channels(image: Arc<Image>, channels: usize) -> Result<Arc<Image>, NodeError> {
    let own = image.n_channels();
    if own == channels && image.alpha() == Some(channels - 1) {
        return Ok(image);
    }
    if !(1..=4).contains(&own) {
        return Err(NodeError::input(format!("expected one to four channels, found {}", image.channels().join(", ")))
            .help("pick the layer to read, or shuffle the channels"));
    }
    let alpha = image.alpha();
    let mut samples = Vec::with_capacity(image.samples().len() / own * channels);
    for pixel in image.samples().chunks_exact(own) {
        let colour = |c: usize| if own < 3 { pixel[0] } else { pixel[c] };
        samples.extend((0..channels - 1).map(colour));
        samples.push(alpha.map_or(1.0, |a| pixel[a]));
    }
    let out = Image::new(image.width(), image.height(), channels, samples)
        .ok_or_else(|| NodeError::internal("a picture of another size than its samples"))?;
    Ok(Arc::new(out.with_windows(image.data_window(), image.display_window())))
}

/// The picture with an alpha channel, to be changed.
fn with_alpha(image: In<Image>) -> Result<Image, NodeError> {
    let image = image.shared()?;
    let channels = if image.n_channels() >= 3 { 4 } else { 2 };
    in_channels(image, channels).map(Arc::unwrap_or_clone)
}

fn merged(fg: In<Image>, bg: In<Image>, operation: Operation, opacity: f64) -> Result<Merged, NodeError> {
    let (fg, bg) = (fg.shared()?, bg.shared()?);
    let channels = common_channels(&fg, &bg);
    let (fg, bg) = (in_channels(fg, channels)?, in_channels(bg, channels)?);
    let options = MergeOptions { operation, opacity: opacity as f32, alpha: Some(channels - 1) };
    let (own, display) = (bg.data_window(), bg.display_window());
    let window = operation.bounds(fg.data_window(), own, options.opacity).intersect(&display.union(&own));
    let refused = |e: MergeError| NodeError::input(e.to_string());
    let made = |samples| {
        let image = Image::new(window.width, window.height, channels, samples);
        let image = image.ok_or_else(|| NodeError::internal("a picture of another size than its window"))?;
        Ok(Merged { image: image.with_windows(window, display) })
    };
    // What covers the same window can be merged into, where nobody else reads it.
    let bg = match alone(bg, window) {
        Ok(mut samples) => {
            merge_in_place(source(&fg), &mut samples, channels, window, options).map_err(refused)?;
            return made(samples);
        }
        Err(shared) => shared,
    };
    let fg = match alone(fg, window) {
        Ok(mut samples) => {
            merge_into_foreground(&mut samples, source(&bg), options, window).map_err(refused)?;
            return made(samples);
        }
        Err(shared) => shared,
    };
    let len = window.samples(channels).filter(|n| *n <= LARGEST).ok_or_else(|| {
        let message = format!("expected a picture of at most 16 GiB of samples, found {} x {}", window.width, window.height);
        NodeError::new(Fault::Limit, message)
    })?;
    let mut samples = vec![0.0; len];
    merge(source(&fg), source(&bg), options, &mut samples, window).map_err(refused)?;
    made(samples)
}

fn source(image: &Image) -> Source<'_> {
    let own = image.data_window();
    Source::new(image.raster(), [own.x, own.y])
}

/// The samples of a picture that covers `window` and that nobody else reads; else the picture.
fn alone(image: Arc<Image>, window: Window) -> Result<Vec<f32>, Arc<Image>> {
    match Arc::try_unwrap(image) {
        Ok(image) if image.data_window() == window => Ok(image.into_samples()),
        Ok(image) => Err(Arc::new(image)),
        Err(shared) => Err(shared),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pegbar_engine::node::{Arg, Input};

    fn flat(width: usize, height: usize, pixel: &[f32]) -> Image {
        Image::new(width, height, pixel.len(), pixel.repeat(width * height)).unwrap()
    }

    #[test]
    fn half_red_lies_over_a_picture_without_alpha() {
        let out = merged(In::new(flat(2, 1, &[0.5, 0.0, 0.0, 0.5])), In::new(flat(2, 1, &[0.0, 0.0, 1.0])), Operation::Over, 1.0).unwrap();
        assert_eq!(out.image.samples(), [0.5, 0.0, 0.5, 1.0, 0.5, 0.0, 0.5, 1.0]);
    }

    #[test]
    fn a_small_foreground_changes_what_it_covers_and_nothing_else() {
        let fg = flat(1, 1, &[1.0, 1.0, 1.0, 1.0]).with_windows(Window::new(2, 1, 1, 1), Window::at_origin(4, 2));
        let bg = Arc::new(flat(4, 2, &[0.25; 4]));
        let out = merged(In::new(fg), In::new((*bg).clone()), Operation::Over, 1.0).unwrap();
        assert_eq!(out.image.data_window(), Window::at_origin(4, 2));
        let white = out.image.samples().chunks_exact(4).position(|p| p == [1.0; 4]);
        assert_eq!(white, Some(6));
        assert_eq!(out.image.samples().iter().filter(|v| **v == 0.25).count(), 28);
    }

    #[test]
    fn what_is_merged_into_does_not_show() {
        let wave =
            |w: usize, h: usize, seed: f32| Image::new(w, h, 4, (0..w * h * 4).map(|i| libm::sinf(i as f32 * seed)).collect()).unwrap();
        let shared = |image: &Arc<Image>| <In<Image>>::from_arg(Arg::Value(image.clone())).unwrap();
        let pairs = [
            (wave(5, 4, 0.7), wave(5, 4, 1.3)),
            (wave(5, 4, 0.7), wave(3, 2, 1.3).with_windows(Window::new(1, 1, 3, 2), Window::at_origin(5, 4))),
            (wave(2, 3, 0.7).with_windows(Window::new(-1, 2, 2, 3), Window::at_origin(5, 4)), wave(5, 4, 1.3)),
        ];
        for (operation, (fg, bg)) in Operation::ALL.into_iter().flat_map(|o| pairs.iter().map(move |p| (o, p))) {
            let (fg, bg) = (Arc::new(fg.clone()), Arc::new(bg.clone()));
            let own = |image: &Arc<Image>| In::new(Image::clone(image));
            let neither = merged(shared(&fg), shared(&bg), operation, 0.75).unwrap().image;
            assert_eq!(merged(own(&fg), shared(&bg), operation, 0.75).unwrap().image, neither, "{operation:?} into the foreground");
            assert_eq!(merged(shared(&fg), own(&bg), operation, 0.75).unwrap().image, neither, "{operation:?} into the background");
        }
    }

    #[test]
    fn grey_over_grey_stays_grey() {
        let out = merged(In::new(flat(1, 1, &[0.25, 0.5])), In::new(flat(1, 1, &[1.0])), Operation::Over, 1.0).unwrap();
        assert_eq!(out.image.samples(), [0.75, 1.0]);
        assert_eq!(out.image.channels(), ["Y", "A"]);
    }
}
