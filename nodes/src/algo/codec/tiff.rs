//! TIFF 6.0 and BigTIFF: read by the `tiff` crate, written here (little-endian strips).

use std::io::{BufRead, Cursor, Read, Seek, Write};

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::curve::Curve;
use super::samples::{Alpha, Coded, Stored, bytes_of_u16, to_floats, to_u8, to_u16, usual_order};
use super::threads::{for_bands, map_ordered};
use super::{CodecError, Compression, DecodeOptions, Depth, EncodeOptions, Format, Header, Level, Picture};
use super::{check_size, usual_channels, window_at_origin};

const NAME: &str = "tiff";

pub(super) fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Picture, CodecError> {
    let (mut decoder, head) = open(Cursor::new(bytes), options)?;
    check_complete(&mut decoder, bytes.len() as u64)?;
    let mut result = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut result).map_err(failed)?;
    let samples = head.width * head.height * head.channels;
    let (stored, curve) = match result {
        DecodingResult::U8(codes) if head.bits < 8 => (Stored::U8(unpack(&codes, &head)), Curve::Srgb),
        DecodingResult::U8(codes) => (Stored::U8(codes), Curve::Srgb),
        DecodingResult::U16(codes) => (Stored::U16(codes), Curve::Srgb),
        DecodingResult::F16(values) => (Stored::F32(values.into_iter().map(f32::from).collect()), Curve::Linear),
        DecodingResult::F32(values) => (Stored::F32(values), Curve::Linear),
        DecodingResult::F64(values) => (Stored::F32(values.into_iter().map(|v| v as f32).collect()), Curve::Linear),
        _ => return Err(unsupported(format!("samples of {} bits", head.bits))),
    };
    let stored = match stored {
        Stored::U8(codes) => Stored::U8(interleave(codes, &head, layout.planes)),
        Stored::U16(codes) => Stored::U16(interleave(codes, &head, layout.planes)),
        Stored::F32(values) => Stored::F32(interleave(values, &head, layout.planes)),
    };
    if stored.len() != samples {
        return Err(CodecError::Corrupt { format: NAME, what: format!("{} samples for {samples}", stored.len()) });
    }
    let coded = Coded { stored, width: head.width, channels: head.channels, alpha: head.alpha, curve };
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
        format: Format::Tiff,
        width: head.width,
        height: head.height,
        channels: usual_channels(head.channels),
        depth: head.depth,
        data_window: window,
        display_window: window,
        layers: Vec::new(),
        notes: head.notes,
    })
}

/// Every strip or tile must lie within the file; the decoder itself would not miss the last bytes of a deflated one.
fn check_complete<R: Read + Seek>(decoder: &mut Decoder<R>, len: u64) -> Result<(), CodecError> {
    for (offsets, counts) in [(Tag::StripOffsets, Tag::StripByteCounts), (Tag::TileOffsets, Tag::TileByteCounts)] {
        let offsets: Vec<u64> = decoder.find_tag_unsigned_vec(offsets).map_err(failed)?.unwrap_or_default();
        let counts: Vec<u64> = decoder.find_tag_unsigned_vec(counts).map_err(failed)?.unwrap_or_default();
        if offsets.iter().zip(&counts).any(|(at, count)| at.saturating_add(*count) > len) {
            return Err(CodecError::Corrupt { format: NAME, what: "its end too early".into() });
        }
    }
    Ok(())
}

struct Head {
    width: usize,
    height: usize,
    channels: usize,
    bits: u8,
    depth: Depth,
    alpha: Alpha,
    notes: Vec<String>,
}

fn open<R: Read + Seek>(reader: R, options: &DecodeOptions) -> Result<(Decoder<R>, Head), CodecError> {
    if options.layer.is_some() {
        return Err(super::error::no_layers(NAME, options));
    }
    let mut limits = Limits::default();
    let bytes = usize::try_from(options.max_samples).unwrap_or(usize::MAX).saturating_mul(8);
    limits.decoding_buffer_size = bytes;
    limits.intermediate_buffer_size = bytes;
    limits.ifd_value_size = 1 << 26;
    let mut decoder = Decoder::new(reader).map_err(failed)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let color = decoder.colortype().map_err(failed)?;
    let channels = match color {
        ColorType::Gray(_) => 1,
        ColorType::RGB(_) => 3,
        ColorType::RGBA(_) => 4,
        ColorType::GrayA(_) | ColorType::Multiband { num_samples: 2, .. } => 2,
        other => return Err(unsupported(format!("{other:?} colours"))),
    };
    check_size(Format::Tiff, u64::from(width), u64::from(height), channels as u64, options)?;
    let bits = color.bit_depth();
    let (depth, linear) = depth_of(&mut decoder, bits)?;
    let mut notes = Vec::new();
    let alpha = alpha_of(&mut decoder, channels, &mut notes)?;
    if !linear && decoder.find_tag(Tag::IccProfile).map_err(failed)?.is_some() {
        notes.push("an icc profile is embedded and not applied: colours are read as sRGB".to_string());
    }
    let stored: Option<u16> = decoder.find_tag_unsigned(Tag::SamplesPerPixel).map_err(failed)?;
    if stored.is_some_and(|n| usize::from(n) > channels) {
        notes.push("channels that are not declared as alpha are left out".to_string());
    }
    if decoder.more_images() {
        notes.push("several pages: the first is read, the others are not".to_string());
    }
    let head = Head { width: width as usize, height: height as usize, channels, bits, depth, alpha, notes };
    Ok((decoder, head))
}

/// The depth, and whether the samples are floats.
fn depth_of<R: Read + Seek>(decoder: &mut Decoder<R>, bits: u8) -> Result<(Depth, bool), CodecError> {
    let formats: Option<Vec<u16>> = decoder.find_tag_unsigned_vec(Tag::SampleFormat).map_err(failed)?;
    match (formats.and_then(|f| f.first().copied()).unwrap_or(1), bits) {
        (1, 1 | 2 | 4 | 8) => Ok((Depth::U8, false)),
        (1, 16) => Ok((Depth::U16, false)),
        (3, 16) => Ok((Depth::Half, true)),
        (3, 32 | 64) => Ok((Depth::Float, true)),
        (2, _) => Err(unsupported(format!("signed integers of {bits} bits"))),
        (3, _) => Err(unsupported(format!("floats of {bits} bits"))),
        _ => Err(unsupported(format!("integers of {bits} bits"))),
    }
}

/// TIFF 6.0, section 18. Unspecified extra samples are taken for associated alpha, as libtiff does.
fn alpha_of<R: Read + Seek>(decoder: &mut Decoder<R>, channels: usize, notes: &mut Vec<String>) -> Result<Alpha, CodecError> {
    if channels % 2 == 1 {
        return Ok(Alpha::None);
    }
    let extra: Option<Vec<u16>> = decoder.find_tag_unsigned_vec(Tag::ExtraSamples).map_err(failed)?;
    match extra.and_then(|e| e.first().copied()) {
        Some(2) => Ok(Alpha::Straight),
        Some(1) => Ok(Alpha::Associated),
        _ => {
            notes.push("the last channel is not declared: read as premultiplied alpha".to_string());
            Ok(Alpha::Associated)
        }
    }
}

impl Stored {
    fn len(&self) -> usize {
        match self {
            Stored::U8(codes) => codes.len(),
            Stored::U16(codes) => codes.len(),
            Stored::F32(values) => values.len(),
        }
    }
}

/// Codes of 1, 2 or 4 bits, each row from a whole byte, scaled to 8 bits.
fn unpack(bytes: &[u8], head: &Head) -> Vec<u8> {
    let (bits, row) = (usize::from(head.bits), head.width * head.channels);
    let (per_byte, mask) = (8 / bits, (1u8 << bits) - 1);
    let scale = 255 / mask;
    let mut out = Vec::with_capacity(row * head.height);
    for row_bytes in bytes.chunks_exact((row * bits).div_ceil(8)) {
        out.extend((0..row).map(|i| {
            let shift = 8 - bits * (i % per_byte + 1);
            ((row_bytes[i / per_byte] >> shift) & mask) * scale
        }));
    }
    out
}

/// Whole planes one after another, as pixels.
fn interleave<T: Copy>(values: Vec<T>, head: &Head, planes: usize) -> Vec<T> {
    let size = head.width * head.height;
    if planes < 2 || values.len() != size * head.channels {
        return values;
    }
    (0..size).flat_map(|i| (0..head.channels).map(move |c| c * size + i)).map(|at| values[at]).collect()
}

fn unsupported(what: String) -> CodecError {
    CodecError::Unsupported { format: NAME, what, hint: "save it as grey or rgb of 8 or 16 bits or floats of 16 or 32 bits".into() }
}

fn failed(error: TiffError) -> CodecError {
    match error {
        TiffError::UnsupportedError(what) => unsupported(format!("a feature that is not read ({what})")),
        TiffError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            CodecError::Corrupt { format: NAME, what: "its end too early".into() }
        }
        // The crate reports damaged compressed data as errors of reading.
        other => CodecError::Corrupt { format: NAME, what: other.to_string() },
    }
}

pub(super) fn encode(picture: &Picture, options: &EncodeOptions, out: &mut impl Write) -> Result<(), CodecError> {
    let order = usual_order(picture, NAME, true)?;
    let depth = options.depth()?;
    let bytes = match depth {
        Depth::U8 => to_u8(picture, &order, options)?,
        Depth::U16 => bytes_of_u16(&to_u16(picture, &order, options)?, u16::to_le_bytes),
        Depth::Half => float_bytes(picture, &order, options, |v| half::f16::from_f32(v).to_le_bytes()),
        _ => float_bytes(picture, &order, options, f32::to_le_bytes),
    };
    let plan = Plan::new(picture, order.len(), depth, options)?;
    let rows: Vec<&[u8]> = bytes.chunks(plan.row_bytes() * plan.rows_per_strip).collect();
    let packed: Option<Vec<_>> = map_ordered(rows, options.threads, |strip| plan.pack(strip)).into_iter().collect();
    let strips = packed.ok_or_else(|| CodecError::BadPicture { what: "strips that deflate can pack".into() })?;
    let strips = strips.into_iter().collect::<Result<Vec<_>, _>>()?;
    out.write_all(&plan.directory(&strips)?)?;
    strips.iter().try_for_each(|strip| out.write_all(strip))?;
    Ok(())
}

fn float_bytes<const B: usize>(
    picture: &Picture,
    order: &[usize],
    options: &EncodeOptions,
    bytes: impl Fn(f32) -> [u8; B] + Sync,
) -> Vec<u8> {
    let n = order.len();
    let values = to_floats(picture, options);
    let mut out = vec![0u8; values.len() * B];
    let row = picture.width * n;
    for_bands(&mut out, row * B, options.threads, |first, out| {
        let pixels = values[first * row..].chunks_exact(n);
        for (to, from) in out.chunks_exact_mut(n * B).zip(pixels) {
            for (to, c) in to.as_chunks_mut::<B>().0.iter_mut().zip(order) {
                *to = bytes(from[*c]);
            }
        }
    });
    out
}

/// Everything about the file but its samples.
struct Plan {
    width: u32,
    height: u32,
    channels: usize,
    depth: Depth,
    deflate: Option<flate2::Compression>,
    rows_per_strip: usize,
}

/// A directory entry: tag, type (3 SHORT, 4 LONG, 5 RATIONAL as pairs of LONG), values.
type Entry = (u16, u16, Vec<u32>);

impl Plan {
    fn new(picture: &Picture, channels: usize, depth: Depth, options: &EncodeOptions) -> Result<Plan, CodecError> {
        let (Ok(width), Ok(height)) = (u32::try_from(picture.width), u32::try_from(picture.height)) else {
            return Err(too_big());
        };
        let level = match options.level {
            Level::Fast => flate2::Compression::new(1),
            Level::Balanced => flate2::Compression::new(6),
            Level::High => flate2::Compression::new(9),
        };
        let deflate = (options.compression()? != Compression::None).then_some(level);
        let mut plan = Plan { width, height, channels, depth, deflate, rows_per_strip: 1 };
        plan.rows_per_strip = ((1 << 18) / plan.row_bytes()).clamp(1, picture.height);
        Ok(plan)
    }

    fn sample_bytes(&self) -> usize {
        match self.depth {
            Depth::U8 => 1,
            Depth::U16 | Depth::Half => 2,
            _ => 4,
        }
    }

    fn row_bytes(&self) -> usize {
        self.width as usize * self.channels * self.sample_bytes()
    }

    /// 1 none, 2 horizontal differences, 3 of floats.
    fn predictor(&self) -> u32 {
        match (&self.deflate, self.depth.is_integer()) {
            (None, _) => 1,
            (Some(_), true) => 2,
            (Some(_), false) => 3,
        }
    }

    fn pack(&self, strip: &[u8]) -> Result<Vec<u8>, CodecError> {
        let Some(level) = self.deflate else { return Ok(strip.to_vec()) };
        let mut predicted = Vec::with_capacity(strip.len());
        for row in strip.chunks_exact(self.row_bytes()) {
            match (self.predictor(), self.sample_bytes()) {
                (3, size) => float_differences(row, size, self.channels, &mut predicted),
                (_, 2) => wide_differences(row, self.channels, &mut predicted),
                _ => byte_differences(row, self.channels, &mut predicted),
            }
        }
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
        encoder.write_all(&predicted)?;
        Ok(encoder.finish()?)
    }

    fn entries(&self, offsets: Vec<u32>, counts: Vec<u32>) -> Vec<Entry> {
        let n = self.channels;
        let bits = 8 * self.sample_bytes() as u32;
        let format = if self.depth.is_integer() { 1 } else { 3 };
        let mut entries: Vec<Entry> = vec![
            (256, 4, vec![self.width]),
            (257, 4, vec![self.height]),
            (258, 3, vec![bits; n]),
            (259, 3, vec![if self.deflate.is_some() { 8 } else { 1 }]),
            (262, 3, vec![if n < 3 { 1 } else { 2 }]),
            (273, 4, offsets),
            (277, 3, vec![n as u32]),
            (278, 4, vec![self.rows_per_strip as u32]),
            (279, 4, counts),
            (282, 5, vec![72, 1]),
            (283, 5, vec![72, 1]),
            (284, 3, vec![1]),
            (296, 3, vec![2]),
            (317, 3, vec![self.predictor()]),
        ];
        if n.is_multiple_of(2) {
            // Float samples are premultiplied, integer codes are not.
            entries.push((338, 3, vec![if self.depth.is_integer() { 2 } else { 1 }]));
        }
        entries.push((339, 3, vec![format; n]));
        entries
    }

    /// The header, the directory and its long values, after which the strips follow.
    fn directory(&self, strips: &[Vec<u8>]) -> Result<Vec<u8>, CodecError> {
        let blank = self.entries(vec![0; strips.len()], vec![0; strips.len()]);
        let table_end = 8 + 2 + 12 * blank.len() + 4;
        let start = table_end + blank.iter().map(out_of_line).sum::<usize>();
        let (mut offsets, mut counts, mut at) = (Vec::new(), Vec::new(), start);
        for strip in strips {
            offsets.push(u32::try_from(at).map_err(|_| too_big())?);
            counts.push(u32::try_from(strip.len()).map_err(|_| too_big())?);
            at += strip.len();
        }
        u32::try_from(at).map_err(|_| too_big())?;
        Ok(write_directory(&self.entries(offsets, counts), table_end))
    }
}

fn too_big() -> CodecError {
    CodecError::Combination { format: NAME, found: "4 GiB or more".into(), choices: "less: write exr instead".into() }
}

fn value_bytes((_, kind, values): &Entry) -> Vec<u8> {
    let short = *kind == 3;
    values.iter().flat_map(|v| v.to_le_bytes().into_iter().take(if short { 2 } else { 4 })).collect()
}

/// The bytes of an entry's values that do not fit into the entry, padded to whole words.
fn out_of_line(entry: &Entry) -> usize {
    let len = value_bytes(entry).len();
    if len > 4 { len.next_multiple_of(2) } else { 0 }
}

fn write_directory(entries: &[Entry], table_end: usize) -> Vec<u8> {
    let mut table = b"II\x2a\0\x08\0\0\0".to_vec();
    let mut long = Vec::new();
    table.extend((entries.len() as u16).to_le_bytes());
    for entry in entries {
        let mut bytes = value_bytes(entry);
        let count = if entry.1 == 5 { entry.2.len() / 2 } else { entry.2.len() };
        table.extend(entry.0.to_le_bytes());
        table.extend(entry.1.to_le_bytes());
        table.extend((count as u32).to_le_bytes());
        if bytes.len() <= 4 {
            bytes.resize(4, 0);
            table.extend(bytes);
        } else {
            table.extend(((table_end + long.len()) as u32).to_le_bytes());
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            long.extend(bytes);
        }
    }
    table.extend([0; 4]);
    table.extend(long);
    table
}

fn byte_differences(row: &[u8], stride: usize, out: &mut Vec<u8>) {
    out.extend_from_slice(&row[..stride.min(row.len())]);
    out.extend(row.iter().zip(row.iter().skip(stride)).map(|(before, now)| now.wrapping_sub(*before)));
}

fn wide_differences(row: &[u8], stride: usize, out: &mut Vec<u8>) {
    let value = |i: usize| u16::from_le_bytes([row[2 * i], row[2 * i + 1]]);
    let start = out.len();
    out.extend_from_slice(row);
    for (i, to) in out[start..].as_chunks_mut::<2>().0.iter_mut().enumerate().skip(stride) {
        *to = value(i).wrapping_sub(value(i - stride)).to_le_bytes();
    }
}

/// Adobe Photoshop TIFF Technical Note 3: the bytes of the floats by significance, most significant first, then differences.
fn float_differences(row: &[u8], size: usize, stride: usize, out: &mut Vec<u8>) {
    let count = row.len() / size;
    let shuffled: Vec<u8> = (0..size).rev().flat_map(|b| (0..count).map(move |i| i * size + b)).map(|at| row[at]).collect();
    byte_differences(&shuffled, stride, out);
}
