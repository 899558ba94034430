//! Pictures.

use std::borrow::Cow;

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::raster::Raster;
use crate::algo::window::Window;

/// A picture: linear light, premultiplied alpha.
#[derive(Clone, Debug, PartialEq, Value)]
#[value(check = "validate")]
pub struct Image {
    /// Samples, rows from the top, channels interleaved: linear light, premultiplied by alpha where there is one.
    #[value(shape = "[h, w, c]")]
    pixels: NdArray<f32, 3>,
    /// Channel names. Default by their number: Y, YA, RGB, RGBA.
    #[value(text)]
    channels: Option<Vec<String>>,
    /// The rectangle that the samples fill, `[x0, y0, x1, y1]`, ends exclusive. Default: from the origin.
    #[value(text)]
    data_window: Option<Window>,
    /// The rectangle that is shown. Default: the data window.
    #[value(text)]
    display_window: Option<Window>,
}

/// Samples of the largest picture that is made: 16 GiB.
pub(crate) const LARGEST: usize = 1 << 32;

const NAMES: [&[&str]; 5] = [&[], &["Y"], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]];

impl Image {
    /// A picture of `[height, width, channels]` samples with the usual channels and windows; `None` where the number of samples is another.
    pub fn new(width: usize, height: usize, channels: usize, samples: Vec<f32>) -> Option<Self> {
        let pixels = NdArray::new([height, width, channels], samples)?;
        Some(Self { pixels, channels: None, data_window: None, display_window: None })
    }

    /// With the rectangle that the samples fill, and the one that is shown. Windows of another size than the samples' are not taken.
    #[must_use]
    pub fn with_windows(mut self, data: Window, display: Window) -> Self {
        if (data.width, data.height) == (self.width(), self.height()) {
            let own = Window::at_origin(self.width(), self.height());
            self.data_window = (data != own).then_some(data);
            self.display_window = (display != data).then_some(display);
        }
        self
    }

    /// With names for the channels, as many as there are.
    #[must_use]
    pub fn with_channels(mut self, names: Vec<String>) -> Self {
        let usual = NAMES.get(names.len()).is_some_and(|n| *n == names.iter().map(String::as_str).collect::<Vec<_>>());
        if names.len() == self.n_channels() {
            self.channels = (!usual).then_some(names);
        }
        self
    }

    /// Samples that keep this picture's channels and windows; `None` where the number of samples is another.
    pub fn with_samples(&self, samples: Vec<f32>) -> Option<Self> {
        Some(Self { pixels: NdArray::new(self.pixels.shape(), samples)?, ..self.clone_frame() })
    }

    fn clone_frame(&self) -> Self {
        let pixels = NdArray::new([0, 0, 0], Vec::new()).unwrap_or_else(|| self.pixels.clone());
        Self { pixels, channels: self.channels.clone(), data_window: self.data_window, display_window: self.display_window }
    }

    /// Columns of the data window.
    pub fn width(&self) -> usize {
        self.pixels.shape()[1]
    }

    /// Rows of the data window.
    pub fn height(&self) -> usize {
        self.pixels.shape()[0]
    }

    /// Samples a pixel.
    pub fn n_channels(&self) -> usize {
        self.pixels.shape()[2]
    }

    /// Name of each channel.
    pub fn channels(&self) -> Vec<String> {
        match &self.channels {
            Some(names) => names.clone(),
            None => match NAMES.get(self.n_channels()) {
                Some(names) => names.iter().map(|n| (*n).to_owned()).collect(),
                None => (0..self.n_channels()).map(|i| format!("C{i}")).collect(),
            },
        }
    }

    /// Position of the alpha channel, where there is one.
    pub fn alpha(&self) -> Option<usize> {
        match &self.channels {
            Some(names) => names.iter().position(|n| n == "A"),
            None => [None, None, Some(1), None, Some(3)].get(self.n_channels()).copied().flatten(),
        }
    }

    /// The rectangle that the samples fill.
    pub fn data_window(&self) -> Window {
        self.data_window.unwrap_or_else(|| Window::at_origin(self.width(), self.height()))
    }

    /// The rectangle that is shown.
    pub fn display_window(&self) -> Window {
        self.display_window.unwrap_or_else(|| self.data_window())
    }

    /// The samples.
    pub fn samples(&self) -> &[f32] {
        self.pixels.data()
    }

    /// The samples, to be changed in place.
    pub fn samples_mut(&mut self) -> &mut [f32] {
        self.pixels.data_mut()
    }

    /// The samples by themselves.
    pub fn into_samples(self) -> Vec<f32> {
        self.pixels.into_data()
    }

    /// The samples as the algorithms read them.
    pub fn raster(&self) -> Raster<'_> {
        Raster { data: self.pixels.data(), width: self.width(), height: self.height(), channels: self.n_channels() }
    }

    /// The picture in all of its display window and nothing else, transparent where it has no samples; itself where it fills that already.
    ///
    /// # Errors
    /// Where the display window is larger than any picture that is made: a small file can say so.
    pub fn in_display(&self) -> Result<Cow<'_, Self>, NodeError> {
        let (own, display) = (self.data_window(), self.display_window());
        if own == display {
            return Ok(Cow::Borrowed(self));
        }
        let (channels, common) = (self.n_channels(), own.intersect(&display));
        let len = display.samples(channels).filter(|n| *n <= LARGEST).ok_or_else(|| {
            let message = format!("expected a display window of at most 16 GiB of samples, found {} x {}", display.width, display.height);
            NodeError::new(Fault::Limit, message).help("crop the picture first")
        })?;
        let mut samples = vec![0.0; len];
        for y in common.y..common.y + common.height as i64 {
            let from = ((y - own.y) as usize * own.width + (common.x - own.x) as usize) * channels;
            let into = ((y - display.y) as usize * display.width + (common.x - display.x) as usize) * channels;
            let n = common.width * channels;
            samples[into..into + n].copy_from_slice(&self.samples()[from..from + n]);
        }
        Ok(match NdArray::new([display.height, display.width, channels], samples) {
            Some(pixels) => Cow::Owned(Self { pixels, data_window: Some(display), ..self.clone_frame() }),
            None => Cow::Borrowed(self),
        })
    }

    fn validate(&self) -> Result<(), String> {
        let [h, w, c] = self.pixels.shape();
        if let Some(names) = &self.channels
            && names.len() != c
        {
            return Err(format!("expected {c} channel names, found {}", names.len()));
        }
        match self.data_window {
            Some(d) if (d.width, d.height) != (w, h) => {
                Err(format!("expected a data window of {w} x {h}, found {} x {}", d.width, d.height))
            }
            _ => Ok(()),
        }
    }
}
