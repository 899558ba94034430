//! The commonest value types of the host, ready to be read and made. Others are declared in the same way: `pegbar types --format json` lists their arrays.

use pegbar_engine::array::Buffer;
use pegbar_engine::node::{Fault, NodeError};

use crate::Value;

/// A picture: linear light, premultiplied alpha.
#[derive(Clone, Debug, Default, PartialEq, Value)]
pub struct Image {
    /// Samples, rows from the top, channels interleaved: linear light, premultiplied by alpha where there is one.
    #[value(shape = "[h, w, c]")]
    pub pixels: Buffer<f32, 3>,
    /// Channel names. Default by their number: Y, YA, RGB, RGBA.
    #[value(text)]
    pub channels: Option<Vec<String>>,
    /// The rectangle that the samples fill, `[x0, y0, x1, y1]`, ends exclusive. Default: from the origin.
    #[value(text)]
    pub data_window: Option<[i64; 4]>,
    /// The rectangle that is shown. Default: the data window.
    #[value(text)]
    pub display_window: Option<[i64; 4]>,
}

impl Image {
    /// Rows, columns and channels.
    pub fn size(&self) -> [usize; 3] {
        self.pixels.shape()
    }

    /// A black picture of the same size, channels and windows.
    ///
    /// # Errors
    /// Where there is no memory for it.
    pub fn blank(&self) -> Result<Self, NodeError> {
        let pixels =
            Buffer::zeroed(self.size()).ok_or_else(|| NodeError::new(Fault::Limit, "expected memory for a picture, found none"))?;
        Ok(Self { pixels, channels: self.channels.clone(), data_window: self.data_window, display_window: self.display_window })
    }

    /// The picture with each sample changed.
    ///
    /// # Errors
    /// Where there is no memory for it.
    pub fn map(&self, mut change: impl FnMut(f32) -> f32) -> Result<Self, NodeError> {
        let mut out = self.blank()?;
        out.pixels.iter_mut().zip(self.pixels.iter()).for_each(|(to, &from)| *to = change(from));
        Ok(out)
    }

    /// Position of the alpha channel, where there is one.
    pub fn alpha(&self) -> Option<usize> {
        match &self.channels {
            Some(names) => names.iter().position(|n| n == "A"),
            None => [None, None, Some(1), None, Some(3)].get(self.size()[2]).copied().flatten(),
        }
    }
}

/// How much of each pixel is covered, 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, Value)]
pub struct Matte {
    /// Coverage, rows from the top: 0 outside, 1 inside.
    #[value(shape = "[h, w]")]
    pub alpha: Buffer<f32, 2>,
}
