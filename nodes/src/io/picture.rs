//! Between picture files and [`Image`] values.

use std::path::Path;

use pegbar_engine::Setting;
use pegbar_engine::node::NodeError;

use crate::algo::codec::{self, ColorMode, DecodeOptions, Picture};
use crate::algo::window::Window;
use crate::data::Image;

use super::file;

/// What the numbers in a picture file mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(super) enum Color {
    /// Integer samples hold sRGB codes unless the file says otherwise, floating-point samples hold linear light.
    Auto,
    /// sRGB codes, whatever the file says.
    Srgb,
    /// Linear light, whatever the file says.
    Linear,
    /// Numbers rather than colours, as normals or a matte: no curve, and alpha stands apart.
    Data,
}

impl From<Color> for ColorMode {
    fn from(color: Color) -> Self {
        match color {
            Color::Auto => ColorMode::Auto,
            Color::Srgb => ColorMode::Srgb,
            Color::Linear => ColorMode::Linear,
            Color::Data => ColorMode::Data,
        }
    }
}

/// Reads the picture in a file.
pub(super) fn read(path: &Path, options: &DecodeOptions) -> Result<Image, NodeError> {
    let picture = codec::decode(&file::read(path)?, options).map_err(|e| file::codec_error(path, &e))?;
    to_image(picture).ok_or_else(|| NodeError::internal(format!("{}: a picture was decoded to another size than it has", path.display())))
}

fn window(edges: [i32; 4]) -> Window {
    Window::from(edges.map(i64::from))
}

/// A decoded picture as a value; `None` where its number of samples is not what its sides say.
pub(super) fn to_image(picture: Picture) -> Option<Image> {
    let image = Image::new(picture.width, picture.height, picture.channels.len(), picture.pixels)?;
    Some(image.with_windows(window(picture.data_window), window(picture.display_window)).with_channels(picture.channels))
}

/// A value as a picture to be encoded.
pub(super) fn to_picture(image: Image) -> Result<Picture, NodeError> {
    let side = |v: i64| i32::try_from(v).map_err(|_| NodeError::input(format!("expected windows within 32 bits, found an edge at {v}")));
    let edges = |w: Window| {
        let [x0, y0, x1, y1] = w.into();
        Ok::<_, NodeError>([side(x0)?, side(y0)?, side(x1)?, side(y1)?])
    };
    Ok(Picture {
        width: image.width(),
        height: image.height(),
        channels: image.channels(),
        data_window: edges(image.data_window())?,
        display_window: edges(image.display_window())?,
        notes: Vec::new(),
        pixels: image.into_samples(),
    })
}
