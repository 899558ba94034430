//! Drawings of results: contours and grids on footage, sheets of frames.

mod correspondences;
mod drawings;
mod markers;
mod scene;
mod shadow;
mod shapes;
mod strip;
#[cfg(test)]
pub(crate) mod tests;
mod toon;

pub(crate) use correspondences::RenderCorrespondences;
pub(crate) use drawings::{Pen, RenderDrawings};
pub(crate) use markers::RenderMarkers;
pub(crate) use scene::seen_by;
pub(crate) use shadow::RenderShadow;
pub(crate) use shapes::RenderShapes;
pub(crate) use strip::RenderStrip;
pub(crate) use toon::RenderToon;

use pegbar_engine::Outputs;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::color::linear_from_srgb;
use crate::algo::paint::hex;
use crate::algo::window::Window;
use crate::data::Image;

/// The drawing.
#[derive(Outputs)]
pub(crate) struct Drawing {
    /// It: four channels, linear light, premultiplied.
    pub(crate) image: Image,
}

/// Samples of the largest drawing: 4 GiB.
const LARGEST: usize = 1 << 30;

/// Zeros for a picture of four channels in `window`.
pub(crate) fn blank(window: Window) -> Result<Vec<f32>, NodeError> {
    match window.samples(4).filter(|n| *n <= LARGEST) {
        Some(n) => Ok(vec![0.0; n]),
        None => {
            let found = format!("expected a drawing of at most 4 GiB, found {} x {}", window.width, window.height);
            Err(NodeError::new(Fault::Limit, found).help("make the size smaller"))
        }
    }
}

/// Refuses a picture that is larger than any drawing.
pub(crate) fn limited(width: usize, height: usize) -> Result<(), NodeError> {
    match Window::new(0, 0, width, height).samples(4).filter(|n| *n <= LARGEST) {
        Some(_) => Ok(()),
        None => {
            let found = format!("expected a drawing of at most 4 GiB, found {width} x {height}");
            Err(NodeError::new(Fault::Limit, found).help("make the size smaller"))
        }
    }
}

/// A drawing from its samples.
pub(crate) fn drawing(window: Window, display: Window, samples: Vec<f32>) -> Result<Drawing, NodeError> {
    match Image::new(window.width, window.height, 4, samples) {
        Some(image) => Ok(Drawing { image: image.with_windows(window, display) }),
        None => Err(NodeError::internal("a picture of another size than its samples")),
    }
}

/// A colour as seen on screen in linear light, opaque.
pub(crate) fn screen(rgb: [f64; 3]) -> [f32; 4] {
    let [r, g, b] = rgb.map(|v| linear_from_srgb(v) as f32);
    [r, g, b, 1.0]
}

/// A linear, premultiplied colour with an opacity laid on.
pub(crate) fn faded(colour: [f32; 4], opacity: f64) -> [f32; 4] {
    colour.map(|v| v * opacity as f32)
}

/// Lays a picture over another, with an opacity.
pub(crate) fn laid(below: &mut [f32], above: &[f32], opacity: f64) {
    for (below, above) in below.chunks_exact_mut(4).zip(above.chunks_exact(4)) {
        let above = [above[0], above[1], above[2], above[3]].map(|v| v * opacity as f32);
        let keep = 1.0 - above[3];
        below.iter_mut().zip(above).for_each(|(b, a)| *b = *b * keep + a);
    }
}

/// The colour number `i`: of those that are given, or else of the palette, again from the start after the last.
pub(crate) fn cycled(given: &[[f64; 3]], palette: &[u32], i: usize) -> [f32; 4] {
    match (given.len(), palette.len()) {
        (0, 0) => [0.0, 0.0, 0.0, 1.0],
        (0, n) => hex(palette[i % n]),
        (n, _) => screen(given[i % n]),
    }
}

/// A setting that may be wired, where it is a number from `least` to `most`.
pub(crate) fn within(name: &str, value: f64, least: f64, most: f64) -> Result<f64, NodeError> {
    if value >= least && value <= most {
        return Ok(value);
    }
    Err(NodeError::new(Fault::Parameters, format!("expected `{name}` from {least} to {most}, found {value}")))
}

/// Where red, green, blue and alpha are among a picture's channels; grey stands for all three.
fn colour_channels(image: &Image) -> Result<([usize; 3], Option<usize>), NodeError> {
    let names = image.channels();
    let find = |name: &str| names.iter().position(|n| n == name);
    match (find("R"), find("G"), find("B"), find("Y")) {
        (Some(r), Some(g), Some(b), _) => Ok(([r, g, b], image.alpha())),
        (_, _, _, Some(y)) => Ok(([y; 3], image.alpha())),
        _ if names.len() == 1 => Ok(([0; 3], None)),
        _ => {
            let found = format!("expected channels R, G, B or Y, found {}", names.join(", "));
            Err(NodeError::input(found).help("pick the layer to read, or shuffle the channels"))
        }
    }
}

/// The picture's samples as RGBA in `window`, transparent outside its own; opaque where it has no alpha.
pub(crate) fn rgba(image: &Image, window: Window) -> Result<Vec<f32>, NodeError> {
    let ([r, g, b], alpha) = colour_channels(image)?;
    let mut out = blank(window)?;
    let own = image.data_window();
    let common = own.intersect(&window);
    let channels = image.n_channels();
    for row in 0..common.height {
        // The common window lies within both, so that these differences are not negative.
        let y = common.y + row as i64;
        let from = ((y - own.y) as usize * own.width + (common.x - own.x) as usize) * channels;
        let to = ((y - window.y) as usize * window.width + (common.x - window.x) as usize) * 4;
        let source = image.samples()[from..].chunks_exact(channels);
        for (target, pixel) in out[to..to + common.width * 4].chunks_exact_mut(4).zip(source) {
            target.copy_from_slice(&[pixel[r], pixel[g], pixel[b], alpha.map_or(1.0, |a| pixel[a])]);
        }
    }
    Ok(out)
}
