//! Pictures: made, moved, filtered, graded.

mod blur;
mod checkerboard;
mod clean_plate;
mod constant;
mod crop;
mod from_matte;
mod grade;
mod gradient;
mod grain;
mod invert;
mod premultiply;
mod resize;
mod sharpen;
mod shuffle;
mod statistics;
mod transform;
mod unpremultiply;
mod warp_affine;
mod warp_mesh;

pub(crate) use blur::ImageBlur;
pub(crate) use checkerboard::ImageCheckerboard;
pub(crate) use clean_plate::ImageCleanPlate;
pub(crate) use constant::ImageConstant;
pub(crate) use crop::ImageCrop;
pub(crate) use from_matte::ImageFromMatte;
pub(crate) use grade::ImageGrade;
pub(crate) use gradient::ImageGradient;
pub(crate) use grain::ImageGrain;
pub(crate) use invert::ImageInvert;
pub(crate) use premultiply::ImagePremultiply;
pub(crate) use resize::ImageResize;
pub(crate) use sharpen::ImageSharpen;
pub(crate) use shuffle::ImageShuffle;
pub(crate) use statistics::ImageStatistics;
pub(crate) use transform::ImageTransform;
pub(crate) use unpremultiply::ImageUnpremultiply;
pub(crate) use warp_affine::ImageWarpAffine;
pub(crate) use warp_mesh::ImageWarpMesh;

use pegbar_engine::Outputs;
use pegbar_engine::node::NodeError;

use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Outside, Source, WarpOptions, bounds, warp_affine as warp_samples};
use crate::algo::window::Window;
use crate::data::{Image, LARGEST};

/// The picture that comes out.
#[derive(Outputs)]
pub(crate) struct Picture {
    /// It: linear light, premultiplied.
    image: Image,
}

fn refused(error: impl std::fmt::Display) -> NodeError {
    NodeError::input(error.to_string())
}

/// Samples in a window, with the channels of the picture that they come from.
fn picture(from: &Image, data: Window, display: Window, samples: Vec<f32>) -> Result<Picture, NodeError> {
    let image = Image::new(data.width, data.height, from.n_channels(), samples);
    let image = image.ok_or_else(|| NodeError::internal("a picture of another size than its window"))?;
    Ok(Picture { image: image.with_channels(from.channels()).with_windows(data, display) })
}

/// A picture of `window` that `make` fills from `from`.
fn made(from: &Image, window: Window, make: impl FnOnce(Source<'_>, &mut [f32]) -> Result<(), NodeError>) -> Result<Picture, NodeError> {
    let own = from.data_window();
    let len = window.samples(from.n_channels()).filter(|n| *n <= LARGEST).ok_or_else(too_large)?;
    let mut samples = vec![0.0; len];
    make(Source::new(from.raster(), [own.x, own.y]), &mut samples)?;
    picture(from, window, from.display_window(), samples)
}

fn too_large() -> NodeError {
    NodeError::new(pegbar_engine::node::Fault::Limit, "expected a picture of at most 16 GiB, found a larger one")
}

/// The picture under a motion, all of it or cut at its display window.
fn warped(image: &Image, motion: &Affine, options: WarpOptions, expand: bool) -> Result<Picture, NodeError> {
    let display = image.display_window();
    let target = match (options.outside, expand) {
        (Outside::Clamp, _) => display,
        (_, true) => bounds(image.data_window(), motion, options).map_err(refused)?,
        (_, false) => bounds(image.data_window(), motion, options).map_err(refused)?.intersect(&display),
    };
    made(image, target, |source, samples| warp_samples(source, motion, options, samples, target).map_err(refused))
}

/// A colour as pictures hold it.
fn premultiplied([r, g, b, a]: [f64; 4]) -> [f32; 4] {
    [r * a, g * a, b * a, a].map(|v| v as f32)
}

/// A picture of a size, in four channels.
fn generated([width, height]: [i64; 2], make: impl FnOnce(&mut [f32], Window)) -> Result<Picture, NodeError> {
    let window = Window::from_bounds(0, 0, width, height);
    let mut samples = vec![0.0; window.samples(4).filter(|n| *n <= LARGEST).ok_or_else(too_large)?];
    make(&mut samples, window);
    let image = Image::new(window.width, window.height, 4, samples)
        .ok_or_else(|| NodeError::internal("a picture of another size than its window"))?;
    Ok(Picture { image })
}
