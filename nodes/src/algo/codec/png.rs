//! PNG, by the `png` crate (W3C Portable Network Graphics, third edition).

use std::io::{BufRead, Cursor, Seek, Write};

use super::curve::Curve;
use super::samples::{Alpha, Coded, Stored, bytes_of_u16, depth_of_bits, to_u8, to_u16, usual_order};
use super::{CodecError, ColorMode, Compression, DecodeOptions, Depth, EncodeOptions, Format, Header, Level, Picture};
use super::{check_size, usual_channels, window_at_origin};

const NAME: &str = "png";

pub(super) fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Picture, CodecError> {
    let mut reader = open(Cursor::new(bytes), options)?;
    let meaning = meaning(reader.info(), options)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_plausible(reader.info(), bytes.len())?;
    let size = reader.output_buffer_size().ok_or_else(|| too_large(reader.info(), options))?;
    let mut buffer = vec![0u8; size];
    reader.next_frame(&mut buffer).map_err(corrupt)?;
    if reader.info().animation_control.is_none() {
        reader.finish().map_err(corrupt)?;
    }
    let (color, depth) = reader.output_color_type();
    let stored = if depth == png::BitDepth::Sixteen { Stored::U16(big_endian(&buffer)) } else { Stored::U8(buffer) };
    let channels = color.samples();
    let alpha = if channels.is_multiple_of(2) { Alpha::Straight } else { Alpha::None };
    let coded = Coded { stored, width, channels, alpha, curve: meaning.curve };
    let window = window_at_origin(width, height);
    Ok(Picture {
        pixels: coded.into_pixels(options.color, options.threads),
        width,
        height,
        channels: usual_channels(channels),
        data_window: window,
        display_window: window,
        notes: meaning.notes,
    })
}

pub(super) fn probe(reader: impl BufRead + Seek, options: &DecodeOptions) -> Result<Header, CodecError> {
    let reader = open(reader, options)?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    let window = window_at_origin(width, height);
    let (color, depth) = reader.output_color_type();
    Ok(Header {
        format: Format::Png,
        width,
        height,
        channels: usual_channels(color.samples()),
        depth: depth_of_bits(depth as u8),
        data_window: window,
        display_window: window,
        layers: Vec::new(),
        notes: meaning(info, options)?.notes,
    })
}

fn open<R: BufRead + Seek>(reader: R, options: &DecodeOptions) -> Result<png::Reader<R>, CodecError> {
    let bytes = usize::try_from(options.max_samples).unwrap_or(usize::MAX).saturating_mul(4);
    let mut decoder = png::Decoder::new_with_limits(reader, png::Limits { bytes });
    decoder.set_transformations(png::Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    let info = decoder.read_header_info().map_err(corrupt)?;
    check_size(Format::Png, u64::from(info.width), u64::from(info.height), info.color_type.samples() as u64, options)?;
    let reader = decoder.read_info().map_err(corrupt)?;
    let (info, (color, _)) = (reader.info(), reader.output_color_type());
    check_size(Format::Png, u64::from(info.width), u64::from(info.height), color.samples() as u64, options)?;
    if options.layer.is_some() {
        return Err(super::error::no_layers(NAME, options));
    }
    Ok(reader)
}

/// Deflate packs at most 1032 bytes into one, so a short file cannot hold a large picture, and memory is not spent on one that says it does.
fn check_plausible(info: &png::Info, len: usize) -> Result<(), CodecError> {
    let raw = info.raw_bytes() as u64;
    if raw / 1032 <= len as u64 {
        return Ok(());
    }
    let what = format!("{len} bytes for {} x {} pixels, which take at least {}", info.width, info.height, raw / 1032);
    Err(CodecError::Corrupt { format: NAME, what })
}

fn too_large(info: &png::Info, options: &DecodeOptions) -> CodecError {
    let (width, height, limit) = (u64::from(info.width), u64::from(info.height), options.max_samples);
    CodecError::TooLarge { format: NAME, width, height, channels: info.color_type.samples() as u64, limit }
}

struct Meaning {
    curve: Curve,
    notes: Vec<String>,
}

/// What the chunks declare, by their precedence in section 4.3 of the standard: cICP, iCCP, sRGB, gAMA.
fn meaning(info: &png::Info, options: &DecodeOptions) -> Result<Meaning, CodecError> {
    let mut notes = Vec::new();
    if info.is_animated() {
        notes.push("an animated png: the first picture is read, the others are not".to_string());
    }
    let mut curve = Curve::Srgb;
    if options.color != ColorMode::Auto {
        return Ok(Meaning { curve, notes });
    }
    if let Some(cicp) = &info.coding_independent_code_points {
        curve = cicp_curve(cicp.transfer_function)?;
        if cicp.color_primaries != 1 {
            notes.push(format!("colour primaries {} are declared: read as those of sRGB", cicp.color_primaries));
        }
    } else if info.icc_profile.is_some() {
        notes.push("an icc profile is embedded and not applied: colours are read as sRGB".to_string());
    } else if let (None, Some(gamma)) = (info.srgb, info.gama_chunk) {
        curve = gama_curve(gamma.into_scaled());
    }
    Ok(Meaning { curve, notes })
}

/// A `gAMA` within a hundredth of 1/2.2 is what the standard has sRGB files declare for old readers, so it means sRGB.
fn gama_curve(scaled: u32) -> Curve {
    match scaled {
        // Nought has no meaning; the standard has readers ignore it.
        0 | 45_000..=45_909 => Curve::Srgb,
        100_000 => Curve::Linear,
        _ => Curve::Gamma(f64::from(scaled) / 100_000.0),
    }
}

/// The transfer characteristics of ITU-T H.273, table 3, that a still picture for animation can have.
fn cicp_curve(code: u8) -> Result<Curve, CodecError> {
    match code {
        4 => Ok(Curve::Gamma(1.0 / 2.2)),
        5 => Ok(Curve::Gamma(1.0 / 2.8)),
        8 => Ok(Curve::Linear),
        2 | 13 => Ok(Curve::Srgb),
        _ => Err(CodecError::Unsupported {
            format: NAME,
            what: format!("transfer characteristics {code} (video or high dynamic range codes)"),
            hint: "convert it to exr, or say which colour mode to read it in".into(),
        }),
    }
}

fn big_endian(bytes: &[u8]) -> Vec<u16> {
    let mut codes = vec![0u16; bytes.len() / 2];
    codes.iter_mut().zip(bytes.as_chunks::<2>().0).for_each(|(code, pair)| *code = u16::from_be_bytes(*pair));
    codes
}

pub(super) fn corrupt(error: png::DecodingError) -> CodecError {
    match error {
        png::DecodingError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            CodecError::Corrupt { format: NAME, what: "its end too early".into() }
        }
        png::DecodingError::IoError(error) => CodecError::Io(error),
        other => CodecError::Corrupt { format: NAME, what: other.to_string() },
    }
}

pub(super) fn encode(picture: &Picture, options: &EncodeOptions, out: &mut impl Write) -> Result<(), CodecError> {
    let order = usual_order(picture, NAME, true)?;
    let side = |n: usize| u32::try_from(n).ok().filter(|n| *n < 1 << 31);
    let (Some(width), Some(height)) = (side(picture.width), side(picture.height)) else {
        let found = format!("{} x {} pixels", picture.width, picture.height);
        return Err(CodecError::Combination { format: NAME, found, choices: "sides below 2147483648".into() });
    };
    let depth = options.depth()?;
    let data = if depth == Depth::U8 {
        to_u8(picture, &order, options)?
    } else {
        bytes_of_u16(&to_u16(picture, &order, options)?, u16::to_be_bytes)
    };
    let mut info = png::Info::with_size(width, height);
    if let Some((name, text)) = &options.text {
        let mut chunk = png::text_metadata::ITXtChunk::new(*name, text.as_ref());
        chunk.compressed = true;
        chunk.compress_text().map_err(failed)?;
        info.utf8_text.push(chunk);
    }
    let mut encoder = png::Encoder::with_info(out, info).map_err(failed)?;
    encoder.set_color(match order.len() {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    encoder.set_depth(if depth == Depth::U8 { png::BitDepth::Eight } else { png::BitDepth::Sixteen });
    declare(&mut encoder, options.color);
    encoder.set_compression(compression(options)?);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&data).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// The text under `name` in a file, where there is one: what [`EncodeOptions::text`] put there.
pub(super) fn text(bytes: &[u8], name: &str) -> Option<String> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 64 << 20 });
    decoder.set_ignore_text_chunk(false);
    let reader = decoder.read_info().ok()?;
    reader.info().utf8_text.iter().find(|chunk| chunk.keyword == name)?.get_text().ok()
}

fn declare<W: Write>(encoder: &mut png::Encoder<'_, W>, color: ColorMode) {
    match color {
        ColorMode::Auto | ColorMode::Srgb => encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric),
        ColorMode::Linear => encoder.set_source_gamma(png::ScaledFloat::from_scaled(100_000)),
        ColorMode::Data => {}
    }
}

fn compression(options: &EncodeOptions) -> Result<png::Compression, CodecError> {
    Ok(match (options.compression()?, options.level) {
        (Compression::None, _) => png::Compression::NoCompression,
        (_, Level::Fast) => png::Compression::Fast,
        (_, Level::Balanced) => png::Compression::Balanced,
        (_, Level::High) => png::Compression::High,
    })
}

fn failed(error: png::EncodingError) -> CodecError {
    match error {
        png::EncodingError::IoError(error) => CodecError::Io(error),
        other => CodecError::BadPicture { what: format!("sides and depth that a png can hold ({other})") },
    }
}
