//! `io.write_images`: pictures to files, one a frame or one in all.
//!
//! The kind of file follows from the path's extension: `png`, `jpg`, `tif` or `exr`. A file is written beside its place and renamed, so that it is
//! there whole or not at all. The bytes depend on the picture and the settings alone.
//!
//! **Source**: as `io.read_image`. **Fails when** the file cannot be written, the disk is full, or the picture has channels that the format cannot
//! hold. **Cost**: O(samples) a frame and one flush to the disk.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "plate": (type: "io.read_images", path: "plate/hat.####.png"),
//!     "out": (type: "io.write_images", image: "@plate", path: "$out/hat.####.exr", depth: half, compression: piz),
//! })
//! ```

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::node::{Context, Fault, In, NodeError, PerFrame, Problem};
use pegbar_engine::setting::OutputPath;
use pegbar_engine::{Node, Setting};

use crate::algo::codec::{self, Compression, Depth, Dither, EncodeOptions, Format, Level};
use crate::data::Image;

use super::file;
use super::picture::{self, Color};

/// How a sample is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Storage {
    /// The format's usual one: 8 bits in PNG and JPEG, 16 in TIFF, half in OpenEXR.
    Auto,
    /// Integers of 8 bits.
    U8,
    /// Integers of 16 bits.
    U16,
    /// Floating point of 16 bits.
    Half,
    /// Floating point of 32 bits.
    Float,
}

impl Storage {
    fn depth(self) -> Option<Depth> {
        match self {
            Storage::Auto => None,
            Storage::U8 => Some(Depth::U8),
            Storage::U16 => Some(Depth::U16),
            Storage::Half => Some(Depth::Half),
            Storage::Float => Some(Depth::Float),
        }
    }
}

/// How the bytes are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Packing {
    /// The format's usual one: deflate.
    Auto,
    /// Not at all.
    None,
    /// Run lengths (OpenEXR).
    Rle,
    /// Deflate; in OpenEXR in blocks of sixteen rows.
    Zip,
    /// Deflate of single rows (OpenEXR).
    Zips,
    /// Wavelets (OpenEXR): the smallest for grainy pictures.
    Piz,
    /// Floats of 24 bits (OpenEXR): exact for half, else `lossy` must allow it.
    Pxr24,
    /// Blocks at a fixed rate (OpenEXR): for half, `lossy` must allow it.
    B44,
    /// As `b44`, flat blocks smaller.
    B44a,
}

impl From<Packing> for Compression {
    fn from(packing: Packing) -> Self {
        match packing {
            Packing::Auto => Compression::Auto,
            Packing::None => Compression::None,
            Packing::Rle => Compression::Rle,
            Packing::Zip => Compression::Zip,
            Packing::Zips => Compression::Zips,
            Packing::Piz => Compression::Piz,
            Packing::Pxr24 => Compression::Pxr24,
            Packing::B44 => Compression::B44,
            Packing::B44a => Compression::B44a,
        }
    }
}

/// How much time packing may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Effort {
    /// Quick: files about a quarter larger than `balanced`.
    Fast,
    /// What most programs write.
    Balanced,
    /// Slow and small.
    High,
}

impl From<Effort> for Level {
    fn from(effort: Effort) -> Self {
        match effort {
            Effort::Fast => Level::Fast,
            Effort::Balanced => Level::Balanced,
            Effort::High => Level::High,
        }
    }
}

/// Writes pictures: PNG, JPEG, TIFF or OpenEXR, by the path's extension.
#[derive(Node)]
#[node(
    id = "io.write_images",
    version = 1,
    kind = sink,
    source = "PNG, JPEG, TIFF 6.0 and OpenEXR specifications",
    example = "\"out\": (type: \"io.write_images\", image: \"@comp\", path: \"$out/hat.####.exr\", compression: piz)"
)]
pub(crate) struct IoWriteImages {
    /// The picture: linear light, premultiplied alpha.
    image: In<Image>,
    /// The file, inside the output folder, with `####` or `%04d` where the frame number stands; it ends in .png, .jpg, .tif or .exr.
    path: OutputPath,
    /// What the numbers in the file shall mean: `auto` is sRGB for integers and linear light for floating point.
    #[input(default = auto)]
    color: Color,
    /// How a sample is stored.
    #[input(default = auto)]
    depth: Storage,
    /// How the bytes are packed.
    #[input(default = auto)]
    compression: Packing,
    /// Time for packing.
    #[input(default = fast)]
    effort: Effort,
    /// True where a compression may change the samples.
    #[input(default = false)]
    lossy: bool,
    /// JPEG quality: 1 the smallest file, 100 the best picture.
    #[input(default = 90, range = 1..=100)]
    quality: u32,
    /// True to round 8-bit codes by a fixed pattern, so that smooth gradients show no bands.
    #[input(default = false)]
    dither: bool,
}

fn format_of(path: &Path) -> Result<Format, String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    Format::from_extension(&extension).ok_or_else(|| match extension.as_ref() {
        "" => "expected a path ending in .png, .jpg, .tif or .exr, found no extension".to_owned(),
        other => format!("expected a path ending in .png, .jpg, .tif or .exr, found .{other}"),
    })
}

fn names<T: Copy>(choices: &[T], name: fn(T) -> &'static str) -> String {
    choices.iter().map(|c| name(*c)).collect::<Vec<_>>().join(", ")
}

impl IoWriteImages {
    fn options(&self, format: Format) -> EncodeOptions {
        EncodeOptions {
            depth: self.depth.depth(),
            color: self.color.into(),
            compression: self.compression.into(),
            lossy: self.lossy,
            level: self.effort.into(),
            quality: u8::try_from(self.quality).unwrap_or(100),
            dither: if self.dither { Dither::Ordered } else { Dither::None },
            text: self.path.origin().map(|origin| (pegbar_engine::origin::KEY, origin.clone())),
            threads: if self.path.is_sequence() { 1 } else { 0 },
            ..EncodeOptions::new(format)
        }
    }
}

impl PerFrame for IoWriteImages {
    fn check(&self) -> Vec<Problem> {
        let format = match format_of(&self.path.at(0)) {
            Ok(format) => format,
            Err(message) => return vec![Problem { input: "path", message }],
        };
        let options = self.options(format);
        let mut problems = Vec::new();
        let mut refuse = |input, choices: String, found: &str| {
            problems.push(Problem { input, message: format!("expected one of {choices} for {}, found {found}", format.name()) })
        };
        if let Some(depth) = options.depth.filter(|d| !format.depths().contains(d)) {
            refuse("depth", names(format.depths(), Depth::name), depth.name());
        }
        if !format.compressions().contains(&options.compression) {
            refuse("compression", names(format.compressions(), Compression::name), options.compression.name());
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let path = self.path.at(cx.frame);
        let format = format_of(&path).map_err(|m| NodeError::new(Fault::Parameters, m))?;
        let options = self.options(format);
        let mut image = self.image.shared()?;
        // Only OpenEXR says where its samples lie; every other format holds the display window.
        if format != Format::Exr && image.data_window() != image.display_window() {
            image = Arc::new(image.in_display()?.into_owned());
        }
        let picture = picture::to_picture(Arc::unwrap_or_clone(image))?;
        // Packed in memory first, so that a picture that the format cannot hold touches no disk.
        let bytes = codec::encode_to_vec(&picture, &options).map_err(|e| file::codec_error(&path, &e))?;
        drop(picture);
        file::write(&path, Fault::Io, |out| std::io::Write::write_all(out, &bytes))
    }
}
