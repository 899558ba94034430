//! JPEG (ITU-T T.81): read by the `zune-jpeg` crate, written by the `image` crate.

use std::io::{BufRead, Cursor, Seek, Write};

use zune_jpeg::zune_core::bytestream::{ZByteReaderTrait, ZCursor};
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;
use zune_jpeg::{JpegDecoder, errors::DecodeErrors};

use super::curve::Curve;
use super::samples::{Alpha, Coded, Stored, to_u8, usual_order};
use super::{CodecError, DecodeOptions, Depth, EncodeOptions, Format, Header, Picture};
use super::{check_size, usual_channels, window_at_origin};

const NAME: &str = "jpeg";

pub(super) fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Picture, CodecError> {
    let (mut decoder, head) = open(ZCursor::new(bytes), options)?;
    let size = decoder.output_buffer_size().unwrap_or(0);
    if size != head.width * head.height * head.channels {
        return Err(CodecError::Corrupt { format: NAME, what: format!("{size} bytes for {} x {}", head.width, head.height) });
    }
    check_plausible(&head, bytes.len())?;
    let mut codes = vec![0u8; size];
    decoder.decode_into(&mut codes).map_err(corrupt)?;
    if !ends_properly(bytes) {
        return Err(corrupt(DecodeErrors::ExhaustedData));
    }
    let coded = Coded { stored: Stored::U8(codes), width: head.width, channels: head.channels, alpha: Alpha::None, curve: Curve::Srgb };
    let window = window_at_origin(head.width, head.height);
    Ok(Picture {
        pixels: coded.into_pixels(options.color, options.threads),
        width: head.width,
        height: head.height,
        channels: usual_channels(head.channels),
        data_window: window,
        display_window: window,
        notes: head.notes,
    })
}

pub(super) fn probe(reader: impl BufRead + Seek, options: &DecodeOptions) -> Result<Header, CodecError> {
    let (_, head) = open(reader, options)?;
    let window = window_at_origin(head.width, head.height);
    Ok(Header {
        format: Format::Jpeg,
        width: head.width,
        height: head.height,
        channels: usual_channels(head.channels),
        depth: Depth::U8,
        data_window: window,
        display_window: window,
        layers: Vec::new(),
        notes: head.notes,
    })
}

struct Head {
    width: usize,
    height: usize,
    channels: usize,
    notes: Vec<String>,
}

/// A decoder past the headers. It is strict: a file that ends early is an error, not a picture that turns grey.
fn open<R: ZByteReaderTrait>(reader: R, options: &DecodeOptions) -> Result<(JpegDecoder<R>, Head), CodecError> {
    if options.layer.is_some() {
        return Err(super::error::no_layers(NAME, options));
    }
    let strict = DecoderOptions::default().set_strict_mode(true).set_max_width(usize::MAX).set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(reader, strict);
    decoder.decode_headers().map_err(corrupt)?;
    let missing = || CodecError::Corrupt { format: NAME, what: "no frame header".into() };
    let (width, height) = decoder.dimensions().ok_or_else(missing)?;
    let (channels, space) = match decoder.input_colorspace().ok_or_else(missing)? {
        ColorSpace::Luma => (1, ColorSpace::Luma),
        ColorSpace::YCbCr | ColorSpace::RGB => (3, ColorSpace::RGB),
        other => return Err(unsupported(format!("{other:?} colours"), "convert it to rgb")),
    };
    check_size(Format::Jpeg, width as u64, height as u64, channels as u64, options)?;
    decoder.set_options(strict.jpeg_set_out_colorspace(space));
    let mut notes = Vec::new();
    if decoder.icc_profile().is_some() {
        notes.push("an icc profile is embedded and not applied: colours are read as sRGB".to_string());
    }
    Ok((decoder, Head { width, height, channels, notes }))
}

/// Even a progressive file spends a bit on every 2¹⁵ blocks of 64 pixels, so a short file cannot hold a large picture.
fn check_plausible(head: &Head, len: usize) -> Result<(), CodecError> {
    let least = head.width * head.height / (64 * 8 * 32_768);
    if len >= least {
        return Ok(());
    }
    Err(CodecError::Corrupt { format: NAME, what: format!("{len} bytes for {} x {} pixels", head.width, head.height) })
}

/// Whether the markers (T.81, annex B) lead to the end of the image: the decoder fills what is missing of the last rows without a word.
fn ends_properly(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        match (bytes.get(at), bytes.get(at + 1)) {
            (Some(0xff), Some(0xd9)) => return true,
            // Stuffed bytes and restarts within a scan, and fill bytes before a marker.
            (Some(0xff), Some(0x00 | 0xd0..=0xd7)) => at += 2,
            (Some(0xff), Some(0xff)) => at += 1,
            (Some(0xff), Some(_)) => {
                let (Some(high), Some(low)) = (bytes.get(at + 2), bytes.get(at + 3)) else { return false };
                at += 2 + usize::from(u16::from_be_bytes([*high, *low])).max(2);
            }
            // Bytes of a scan; elsewhere, what the decoder passes over, too.
            (Some(_), Some(_)) => at += 1,
            _ => return false,
        }
    }
}

fn unsupported(what: String, hint: &str) -> CodecError {
    CodecError::Unsupported { format: NAME, what, hint: hint.into() }
}

fn corrupt(error: DecodeErrors) -> CodecError {
    match error {
        DecodeErrors::Unsupported(scheme) => unsupported(format!("{scheme:?}"), "save it as baseline or progressive"),
        DecodeErrors::ExhaustedData => CodecError::Corrupt { format: NAME, what: "its end too early".into() },
        // The crate's messages are sentences over several lines; the first says what is wrong.
        other => {
            let text = format!("{other:?}");
            CodecError::Corrupt { format: NAME, what: text.lines().next().unwrap_or_default().to_string() }
        }
    }
}

pub(super) fn encode(picture: &Picture, options: &EncodeOptions, out: &mut impl Write) -> Result<(), CodecError> {
    let order = usual_order(picture, NAME, false)?;
    let combination = |found: String, choices: &str| CodecError::Combination { format: NAME, found, choices: choices.into() };
    let (Ok(width), Ok(height)) = (u16::try_from(picture.width), u16::try_from(picture.height)) else {
        return Err(combination(format!("{} x {} pixels", picture.width, picture.height), "sides of 1 to 65535"));
    };
    if !(1..=100).contains(&options.quality) {
        return Err(combination(format!("quality {}", options.quality), "1 to 100"));
    }
    let codes = to_u8(picture, &order, options)?;
    let kind = if order.len() == 1 { image::ExtendedColorType::L8 } else { image::ExtendedColorType::Rgb8 };
    // The encoder makes many small writes.
    let mut buffer = Cursor::new(Vec::new());
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut buffer, options.quality);
    encoder.encode(&codes, u32::from(width), u32::from(height), kind).map_err(|error| match error {
        image::ImageError::IoError(error) => CodecError::Io(error),
        other => CodecError::BadPicture { what: format!("sides that a jpeg can hold ({other})") },
    })?;
    out.write_all(buffer.get_ref())?;
    Ok(())
}
