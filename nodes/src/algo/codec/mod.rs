//! Picture files to samples and back, as bytes: PNG, JPEG, TIFF and OpenEXR.
//!
//! Every picture inside Pegbar is `f32`, linear light, premultiplied by its alpha. These functions carry files there and back; they never touch a
//! disk. What a file is, is told by its first bytes, never by its name.
//!
//! - Integer files hold sRGB codes unless they say otherwise, float files hold linear light; [`ColorMode`] overrules either.
//! - Straight alpha of a file is multiplied in after its colours are linear. A colour under an alpha of nought is therefore lost on reading.
//! - Sizes are checked against [`DecodeOptions::max_samples`], and against what the bytes at hand could possibly hold, before anything is allocated.
//! - The bytes written depend on the picture and the options alone, not on threads or the clock.

mod curve;
mod error;
mod exr;
mod jpeg;
mod png;
mod samples;
mod threads;
mod tiff;

#[cfg(test)]
mod tests;

pub use error::CodecError;

use std::io::{BufRead, Cursor, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

/// The kinds of picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Format {
    /// Portable Network Graphics (W3C PNG, third edition).
    Png,
    /// JPEG (ITU-T T.81), baseline and progressive.
    Jpeg,
    /// Tagged Image File Format 6.0 and BigTIFF.
    Tiff,
    /// OpenEXR 2.
    Exr,
}

impl Format {
    /// All formats, in the order in which messages list them.
    pub const ALL: [Format; 4] = [Format::Png, Format::Jpeg, Format::Tiff, Format::Exr];

    /// The name used in messages and as the usual file extension: `png`, `jpeg`, `tiff`, `exr`.
    pub fn name(self) -> &'static str {
        match self {
            Format::Png => "png",
            Format::Jpeg => "jpeg",
            Format::Tiff => "tiff",
            Format::Exr => "exr",
        }
    }

    /// The format that a file extension (without the dot, in any case) asks for.
    pub fn from_extension(extension: &str) -> Option<Format> {
        match extension.to_ascii_lowercase().as_str() {
            "png" => Some(Format::Png),
            "jpg" | "jpeg" | "jpe" => Some(Format::Jpeg),
            "tif" | "tiff" => Some(Format::Tiff),
            "exr" => Some(Format::Exr),
            _ => None,
        }
    }

    /// The depths that the format holds; the first is the one that [`EncodeOptions::depth`] `None` means.
    pub fn depths(self) -> &'static [Depth] {
        match self {
            Format::Png => &[Depth::U8, Depth::U16],
            Format::Jpeg => &[Depth::U8],
            Format::Tiff => &[Depth::U16, Depth::U8, Depth::Half, Depth::Float],
            Format::Exr => &[Depth::Half, Depth::Float],
        }
    }

    /// The compressions that the format knows; `Auto` stands for the second.
    pub fn compressions(self) -> &'static [Compression] {
        use Compression::*;
        match self {
            Format::Png => &[Auto, Zip, None],
            Format::Jpeg => &[Auto],
            Format::Tiff => &[Auto, Zip, None],
            Format::Exr => &[Auto, Zip, None, Rle, Zips, Piz, Pxr24, B44, B44a],
        }
    }
}

/// How one sample is stored in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Depth {
    /// Unsigned integers of 8 bits or fewer; 255 is one.
    U8,
    /// Unsigned integers of 16 bits; 65535 is one.
    U16,
    /// IEEE 754 floats of 16 bits.
    Half,
    /// IEEE 754 floats of 32 bits.
    Float,
    /// Unsigned integers of 32 bits: only read (object identifiers in EXR files), each taken as its value.
    U32,
}

impl Depth {
    /// The name used in messages.
    pub fn name(self) -> &'static str {
        match self {
            Depth::U8 => "u8",
            Depth::U16 => "u16",
            Depth::Half => "half",
            Depth::Float => "float",
            Depth::U32 => "u32",
        }
    }

    fn is_integer(self) -> bool {
        matches!(self, Depth::U8 | Depth::U16)
    }
}

/// What the numbers in a file mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ColorMode {
    /// Integer files: what they declare (PNG `gAMA`), else sRGB. Float files: linear light.
    #[default]
    Auto,
    /// sRGB codes (IEC 61966-2-1), whatever the file says.
    Srgb,
    /// Linear light, whatever the file says.
    Linear,
    /// Numbers, not colours: no curve, and alpha neither multiplied in nor divided out. Integers are scaled so that the largest code is one.
    Data,
}

/// How the bytes are packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Compression {
    /// The format's usual one: deflate for PNG and TIFF, `Zip` for EXR.
    #[default]
    Auto,
    /// Stored as they are.
    None,
    /// Run lengths (EXR).
    Rle,
    /// Deflate; in EXR in blocks of sixteen rows.
    Zip,
    /// Deflate of single rows (EXR): quicker to reach one row.
    Zips,
    /// Wavelets and Huffman codes (EXR): the smallest for grainy pictures.
    Piz,
    /// Deflate after rounding floats to 24 bits (EXR); exact for half, lossy for float.
    Pxr24,
    /// Blocks of 4 by 4 at a fixed rate (EXR); lossy for half, stores float as it is.
    B44,
    /// As `B44`, but flat blocks take less.
    B44a,
}

impl Compression {
    /// The name used in messages.
    pub fn name(self) -> &'static str {
        match self {
            Compression::Auto => "auto",
            Compression::None => "none",
            Compression::Rle => "rle",
            Compression::Zip => "zip",
            Compression::Zips => "zips",
            Compression::Piz => "piz",
            Compression::Pxr24 => "pxr24",
            Compression::B44 => "b44",
            Compression::B44a => "b44a",
        }
    }
}

/// How much time deflate may take (PNG, and TIFF with `Zip`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Level {
    /// Quick: files about a quarter larger than `Balanced`.
    #[default]
    Fast,
    /// What most programs write.
    Balanced,
    /// Slow and small.
    High,
}

/// How integer codes are rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Dither {
    /// To the nearest code.
    #[default]
    None,
    /// Up or down by an 8 by 8 Bayer matrix, so that smooth gradients show no bands; pictures that came from 8 bits are unchanged. 8-bit depths only.
    Ordered,
}

/// What to do with NaN and infinities where the depth is an integer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NonFinite {
    /// NaN becomes 0, infinity the largest code, minus infinity 0, as every value out of range is clamped.
    #[default]
    Clamp,
    /// [`CodecError::NotFinite`], naming the first pixel.
    Refuse,
}

/// A decoded picture, or one to be written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Samples, `[height, width, channels]` interleaved, rows from the top; linear light premultiplied by alpha (or plain numbers in `Data` mode).
    pub pixels: Vec<f32>,
    /// Columns of the data window.
    pub width: usize,
    /// Rows of the data window.
    pub height: usize,
    /// One name a channel, in the order of the samples: `R`, `G`, `B`, `A`, `Y`, `Z`, `forward.left.u`. Names are unique.
    pub channels: Vec<String>,
    /// The rectangle that `pixels` covers, `[x0, y0, x1, y1]` in pixels, half open, y down.
    pub data_window: [i32; 4],
    /// The rectangle that is shown, likewise; the origin and size of the frame.
    pub display_window: [i32; 4],
    /// What was read past, each a sentence for the user: an ICC profile, further frames.
    pub notes: Vec<String>,
}

impl Picture {
    /// A picture whose data window is its display window, at the origin; `None` where the lengths disagree or a side exceeds `i32`.
    pub fn new(pixels: Vec<f32>, width: usize, height: usize, channels: &[&str]) -> Option<Picture> {
        let window = [0, 0, i32::try_from(width).ok()?, i32::try_from(height).ok()?];
        let len = width.checked_mul(height)?.checked_mul(channels.len())?;
        let channels = channels.iter().map(|name| (*name).to_string()).collect();
        (len == pixels.len()).then_some(Picture {
            pixels,
            width,
            height,
            channels,
            data_window: window,
            display_window: window,
            notes: Vec::new(),
        })
    }
}

/// What a file says of itself before its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// The kind of file.
    pub format: Format,
    /// Columns of the data window.
    pub width: usize,
    /// Rows of the data window.
    pub height: usize,
    /// The channels that [`decode`] with the same options would give.
    pub channels: Vec<String>,
    /// How the first of these channels is stored.
    pub depth: Depth,
    /// The rectangle that the pixels cover, `[x0, y0, x1, y1]`, half open.
    pub data_window: [i32; 4],
    /// The rectangle that is shown.
    pub display_window: [i32; 4],
    /// The names that [`DecodeOptions::layer`] takes; empty where there is but one layer.
    pub layers: Vec<String>,
    /// What reading will pass over.
    pub notes: Vec<String>,
}

/// How to read.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// What the numbers mean.
    pub color: ColorMode,
    /// EXR: the layer, part, view or single channel to read; `None` for the main colour layer. The layer's prefix is cut from the channel names.
    /// `*` reads every channel of the first part under its full name.
    pub layer: Option<String>,
    /// The most samples (width × height × channels) that may be allocated; default 2³⁰, that is 4 GiB of floats or 16384² RGBA.
    pub max_samples: u64,
    /// Threads to use; 0 for one a processor. The samples are the same for any number.
    pub threads: usize,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        DecodeOptions { color: ColorMode::Auto, layer: None, max_samples: 1 << 30, threads: 0 }
    }
}

/// The text that a PNG or OpenEXR file holds under `name`; see [`EncodeOptions::text`].
pub fn text(bytes: &[u8], name: &str) -> Option<String> {
    png::text(bytes, name).or_else(|| exr::text(bytes, name))
}

/// How to write.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeOptions {
    /// The kind of file.
    pub format: Format,
    /// How samples are stored; `None` for the format's usual one, the first of [`Format::depths`].
    pub depth: Option<Depth>,
    /// What the numbers in the file shall mean; `Auto` is sRGB for integers and linear light for floats.
    pub color: ColorMode,
    /// How bytes are packed.
    pub compression: Compression,
    /// Permits compressions that change the samples (`Pxr24` with float, `B44` with half).
    pub lossy: bool,
    /// Time for deflate.
    pub level: Level,
    /// JPEG quality, 1 to 100.
    pub quality: u8,
    /// Rounding of 8-bit codes.
    pub dither: Dither,
    /// NaN and infinities in integer depths.
    pub non_finite: NonFinite,
    /// Threads to use; 0 for one a processor. The bytes are the same for any number.
    pub threads: usize,
    /// A text about the picture, under a name: a chunk in PNG, an attribute in OpenEXR. JPEG and TIFF files go without.
    pub text: Option<(&'static str, Arc<str>)>,
}

impl EncodeOptions {
    /// The format's usual choices.
    pub fn new(format: Format) -> Self {
        EncodeOptions {
            format,
            depth: None,
            color: ColorMode::Auto,
            compression: Compression::Auto,
            lossy: false,
            level: Level::Fast,
            quality: 90,
            dither: Dither::None,
            non_finite: NonFinite::Clamp,
            threads: 0,
            text: None,
        }
    }

    fn depth(&self) -> Result<Depth, CodecError> {
        let choices = self.format.depths();
        let depth = self.depth.unwrap_or(choices[0]);
        if choices.contains(&depth) {
            return Ok(depth);
        }
        let names: Vec<_> = choices.iter().map(|d| d.name()).collect();
        Err(CodecError::Combination { format: self.format.name(), found: format!("depth {}", depth.name()), choices: names.join(", ") })
    }

    fn compression(&self) -> Result<Compression, CodecError> {
        let choices = self.format.compressions();
        if choices.contains(&self.compression) {
            return Ok(self.compression);
        }
        let names: Vec<_> = choices.iter().map(|c| c.name()).collect();
        let found = format!("compression {}", self.compression.name());
        Err(CodecError::Combination { format: self.format.name(), found, choices: names.join(", ") })
    }
}

/// The format of a file that starts with `prefix` (16 bytes are enough); `None` where it is not one of ours.
pub fn sniff(prefix: &[u8]) -> Option<Format> {
    match prefix {
        [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Format::Png),
        [0xff, 0xd8, 0xff, ..] => Some(Format::Jpeg),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Some(Format::Tiff),
        [0x76, 0x2f, 0x31, 0x01, ..] => Some(Format::Exr),
        _ => None,
    }
}

/// Reads the picture in `bytes`.
///
/// Errors: [`CodecError::UnknownFormat`], `Corrupt` (also truncated), `Unsupported`, `TooLarge`, `NoLayer`. Cost: O(bytes + samples).
pub fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Picture, CodecError> {
    match known(bytes)? {
        Format::Png => png::decode(bytes, options),
        Format::Jpeg => jpeg::decode(bytes, options),
        Format::Tiff => tiff::decode(bytes, options),
        Format::Exr => exr::decode(bytes, options),
    }
}

/// Reads what a file says of itself, not its pixels; the reader is left anywhere.
///
/// Errors as of [`decode`], as far as the header tells, and [`CodecError::Io`]. Cost: a few reads.
pub fn probe(mut reader: impl BufRead + Seek, options: &DecodeOptions) -> Result<Header, CodecError> {
    let mut prefix = Vec::new();
    reader.by_ref().take(16).read_to_end(&mut prefix)?;
    reader.seek(SeekFrom::Start(0))?;
    match known(&prefix)? {
        Format::Png => png::probe(reader, options),
        Format::Jpeg => jpeg::probe(reader, options),
        Format::Tiff => tiff::probe(reader, options),
        Format::Exr => exr::probe(reader, options),
    }
}

/// Writes `picture`. What was written before an error is incomplete: write to memory or to a temporary file.
///
/// Errors: [`CodecError::BadPicture`], `Combination`, `NotFinite`, `Io`. Cost: O(samples).
pub fn encode(picture: &Picture, options: &EncodeOptions, out: &mut (impl Write + Seek)) -> Result<(), CodecError> {
    check_picture(picture, options)?;
    match options.format {
        Format::Png => png::encode(picture, options, out),
        Format::Jpeg => jpeg::encode(picture, options, out),
        Format::Tiff => tiff::encode(picture, options, out),
        Format::Exr => exr::encode(picture, options, out),
    }
}

/// [`encode`] into a new buffer.
pub fn encode_to_vec(picture: &Picture, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    let mut out = Cursor::new(Vec::new());
    encode(picture, options, &mut out)?;
    Ok(out.into_inner())
}

fn known(prefix: &[u8]) -> Result<Format, CodecError> {
    sniff(prefix).ok_or_else(|| CodecError::UnknownFormat { found: error::describe_prefix(prefix) })
}

fn check_picture(picture: &Picture, options: &EncodeOptions) -> Result<(), CodecError> {
    let (w, h, c) = (picture.width, picture.height, picture.channels.len());
    let bad = |what: String| Err(CodecError::BadPicture { what });
    if w == 0 || h == 0 || c == 0 {
        return bad(format!("at least one pixel and one channel, found {w}x{h} with {c} channels"));
    }
    if w.checked_mul(h).and_then(|n| n.checked_mul(c)) != Some(picture.pixels.len()) {
        return bad(format!("{w} x {h} x {c} samples, found {}", picture.pixels.len()));
    }
    let [x0, y0, x1, y1] = picture.data_window.map(i64::from);
    if (x1 - x0, y1 - y0) != (w as i64, h as i64) {
        return bad(format!("a data window of {w}x{h}, found {}x{}", x1 - x0, y1 - y0));
    }
    let mut names: Vec<_> = picture.channels.iter().collect();
    names.sort();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return bad(format!("unique channel names, found {} twice", pair[0]));
    }
    options.depth()?;
    options.compression()?;
    if options.dither != Dither::None && options.depth()? != Depth::U8 {
        let found = format!("ordered dither with depth {}", options.depth()?.name());
        return Err(CodecError::Combination { format: options.format.name(), found, choices: "dither none, or depth u8".into() });
    }
    Ok(())
}

/// Errors where the picture would take more than the permitted samples.
fn check_size(format: Format, width: u64, height: u64, channels: u64, options: &DecodeOptions) -> Result<(), CodecError> {
    let samples = width.checked_mul(height).and_then(|n| n.checked_mul(channels));
    let fits = samples.is_some_and(|n| n <= options.max_samples && usize::try_from(n).is_ok_and(|n| n <= isize::MAX as usize / 4));
    if fits {
        return Ok(());
    }
    Err(CodecError::TooLarge { format: format.name(), width, height, channels, limit: options.max_samples })
}

/// The channel names of a picture of 1 to 4 channels whose last may be alpha.
fn usual_channels(count: usize) -> Vec<String> {
    let names: &[&str] = match count {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        4 => &["R", "G", "B", "A"],
        _ => &[],
    };
    names.iter().map(|name| (*name).to_string()).collect()
}

/// A window of the given size at the origin; sides are capped by the callers' formats well below `i32::MAX` or else saturate.
fn window_at_origin(width: usize, height: usize) -> [i32; 4] {
    let side = |n: usize| i32::try_from(n).unwrap_or(i32::MAX);
    [0, 0, side(width), side(height)]
}
