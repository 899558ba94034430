//! OpenEXR by the `exr` crate, block by block: one layer of one part at full resolution.
//!
//! The crate holds assertions where damaged files contradict themselves, so its calls stand behind `catch_unwind`: such a file is an error here, too.

use std::io::{BufRead, Cursor, Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::reader::{ChunksReader, Reader};
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression as Packing;
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, ChannelDescription, IntegerBounds, LineOrder, SampleType, Text};
use exr::meta::header::{Header as PartHeader, ImageAttributes, LayerAttributes};
use exr::meta::{BlockDescription, MetaData};
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

use super::error::no_layer;
use super::samples::to_floats;
use super::threads::map_ordered;
use super::{CodecError, Compression, DecodeOptions, Depth, EncodeOptions, Format, Header, Level, Picture, check_size};

const NAME: &str = "exr";

pub(super) fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Picture, CodecError> {
    let reader = open(Cursor::new(bytes))?;
    let choice = choose(reader.headers(), options)?;
    let part = &reader.headers()[choice.part];
    check_readable(part, &choice, options)?;
    check_plausible(reader.headers(), bytes.len())?;
    let (width, height) = (part.layer_size.0, part.layer_size.1);
    let (data_window, display_window) = windows(part);
    let pixels = guarded(|| read_blocks(reader, &choice, options))??;
    let coded = super::samples::Coded {
        stored: super::samples::Stored::F32(pixels),
        width,
        channels: choice.channels.len(),
        alpha: super::samples::Alpha::None,
        curve: super::curve::Curve::Linear,
    };
    let pixels =
        if options.color == super::ColorMode::Srgb { undo_srgb(coded, &choice, options) } else { coded.into_pixels(options.color, 1) };
    let channels = choice.channels.into_iter().map(|(_, name)| name).collect();
    Ok(Picture { pixels, width, height, channels, data_window, display_window, notes: choice.notes })
}

pub(super) fn probe(reader: impl BufRead + Seek, options: &DecodeOptions) -> Result<Header, CodecError> {
    let reader = open(reader)?;
    let choice = choose(reader.headers(), options)?;
    let part = &reader.headers()[choice.part];
    check_readable(part, &choice, options)?;
    let (data_window, display_window) = windows(part);
    let names = listed(&layers(reader.headers()), reader.headers());
    Ok(Header {
        format: Format::Exr,
        width: part.layer_size.0,
        height: part.layer_size.1,
        depth: match choice.channels.first().map(|(index, _)| part.channels.list[*index].sample_type) {
            Some(SampleType::F32) => Depth::Float,
            Some(SampleType::U32) => Depth::U32,
            _ => Depth::Half,
        },
        channels: choice.channels.into_iter().map(|(_, name)| name).collect(),
        data_window,
        display_window,
        layers: names,
        notes: choice.notes,
    })
}

fn undo_srgb(mut coded: super::samples::Coded, choice: &Choice, options: &DecodeOptions) -> Vec<f32> {
    coded.curve = super::curve::Curve::Srgb;
    if choice.channels.last().is_some_and(|(_, name)| name == "A") && coded.channels > 1 {
        coded.alpha = super::samples::Alpha::Associated;
    }
    coded.into_pixels(options.color, options.threads)
}

fn guarded<T>(f: impl FnOnce() -> T) -> Result<T, CodecError> {
    catch_unwind(AssertUnwindSafe(f)).map_err(|_| corrupt_text("contradictions in its header or blocks"))
}

fn corrupt_text(what: impl Into<String>) -> CodecError {
    CodecError::Corrupt { format: NAME, what: what.into() }
}

fn unsupported(what: impl Into<String>, hint: &str) -> CodecError {
    CodecError::Unsupported { format: NAME, what: what.into(), hint: hint.into() }
}

fn failed(error: exr::error::Error) -> CodecError {
    match error {
        exr::error::Error::NotSupported(what) if what.contains("deep") => deep(),
        exr::error::Error::NotSupported(what) if what.contains("subsampling") => luminance_chroma(),
        exr::error::Error::NotSupported(what) => {
            unsupported(format!("a feature that is not read ({what})"), "save it with another compression")
        }
        exr::error::Error::Io(error) => CodecError::Io(error),
        other => corrupt_text(other.to_string()),
    }
}

fn open<R: BufRead + Seek>(reader: R) -> Result<Reader<R>, CodecError> {
    guarded(|| Reader::read_from_buffered(reader, false))?.map_err(failed)
}

/// The channels to read: a part, and the index and short name of each channel.
struct Choice {
    part: usize,
    channels: Vec<(usize, String)>,
    notes: Vec<String>,
}

/// A group of channels with a common prefix in one part.
struct Layer {
    part: usize,
    /// All names by which it may be asked for; the first is the one that is listed. Empty for the main layer of a single part.
    names: Vec<String>,
    channels: Vec<(usize, String)>,
}

/// The layers of a file: the channels of each part by what stands before the last dot of their names.
fn layers(parts: &[PartHeader]) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for (part, header) in parts.iter().enumerate() {
        let mut groups: std::collections::BTreeMap<String, Vec<(usize, String)>> = Default::default();
        for (index, channel) in header.channels.list.iter().enumerate() {
            let name = channel.name.to_string();
            let (prefix, short) = name.rsplit_once('.').unwrap_or(("", &name));
            groups.entry(prefix.to_string()).or_default().push((index, short.to_string()));
        }
        let alone = groups.len() == 1;
        for (prefix, mut channels) in groups {
            channels.sort_by_key(|(_, name)| (rank(name), name.clone()));
            let names = if parts.len() > 1 { names_in_part(header, &prefix, alone) } else { Vec::new() };
            let prefix = (!prefix.is_empty()).then_some(prefix);
            layers.push(Layer { part, names: names.into_iter().chain(prefix).collect(), channels });
        }
    }
    layers
}

/// A part's name stands for its main layer, or for its only one; so does its view.
fn names_in_part(header: &PartHeader, prefix: &str, alone: bool) -> Vec<String> {
    let attributes = &header.own_attributes;
    let mut names = Vec::new();
    for text in attributes.layer_name.iter().chain(&attributes.view_name) {
        if alone || prefix.is_empty() {
            names.push(text.to_string());
        }
        if !prefix.is_empty() {
            names.push(format!("{text}.{prefix}"));
        }
    }
    names
}

/// Colours come in their usual order, then everything else by name.
fn rank(name: &str) -> usize {
    ["R", "G", "B", "Y", "A"].iter().position(|n| *n == name).unwrap_or(OTHER)
}

const OTHER: usize = 5;

/// What may be asked for beside the main colours: layers by their first name, and the single channels of a file of one part.
fn listed(layers: &[Layer], parts: &[PartHeader]) -> Vec<String> {
    let mut names: Vec<String> = layers.iter().filter_map(|layer| layer.names.first().cloned()).collect();
    let main = layers.iter().filter(|layer| parts.len() == 1 && layer.names.is_empty());
    names.extend(main.flat_map(|layer| &layer.channels).map(|(_, name)| name.clone()).filter(|name| rank(name) == OTHER));
    names
}

fn choose(parts: &[PartHeader], options: &DecodeOptions) -> Result<Choice, CodecError> {
    let all = layers(parts);
    match options.layer.as_deref() {
        None => choose_main(&all, parts),
        Some("*") => choose_all(parts),
        Some(name) => choose_named(name, &all, parts),
    }
}

/// The first main layer with colours, else with luminance, else the first main layer, else the first layer of all.
fn choose_main(all: &[Layer], parts: &[PartHeader]) -> Result<Choice, CodecError> {
    let has = |layer: &Layer, wanted: &[&str]| wanted.iter().all(|w| layer.channels.iter().any(|(_, n)| n == w));
    let main = || all.iter().filter(|layer| parts.len() > 1 || layer.names.is_empty());
    let layer = (main().find(|l| has(l, &["R", "G", "B"])))
        .or_else(|| main().find(|l| has(l, &["Y"])))
        .or_else(|| main().next())
        .or_else(|| all.iter().find(|l| has(l, &["R", "G", "B"])))
        .or_else(|| all.first())
        .ok_or_else(|| corrupt_text("no channels"))?;
    let mut channels = layer.channels.clone();
    let colours: &[&str] = if has(layer, &["R", "G", "B"]) { &["R", "G", "B", "A"] } else { &["Y", "A"] };
    if has(layer, &colours[..1]) {
        channels.retain(|(_, name)| colours.contains(&name.as_str()));
    }
    let mut names = listed(all, parts);
    names.retain(|name| layer.names.first() != Some(name) && channels.iter().all(|(_, channel)| channel != name));
    let notes = if names.is_empty() { Vec::new() } else { vec![format!("further layers: {}", names.join(", "))] };
    Ok(Choice { part: layer.part, channels, notes })
}

fn choose_all(parts: &[PartHeader]) -> Result<Choice, CodecError> {
    let part = parts.first().ok_or_else(|| corrupt_text("no parts"))?;
    let channels = part.channels.list.iter().enumerate().map(|(index, c)| (index, c.name.to_string())).collect();
    Ok(Choice { part: 0, channels, notes: Vec::new() })
}

fn choose_named(name: &str, all: &[Layer], parts: &[PartHeader]) -> Result<Choice, CodecError> {
    // A part's own name comes before a view's or a prefix that another part shares.
    let depth = all.iter().map(|layer| layer.names.len()).max().unwrap_or(0);
    for at in 0..depth {
        if let Some(layer) = all.iter().find(|layer| layer.names.get(at).is_some_and(|n| n == name)) {
            return Ok(Choice { part: layer.part, channels: layer.channels.clone(), notes: Vec::new() });
        }
    }
    for (part, header) in parts.iter().enumerate() {
        if let Some(index) = header.channels.list.iter().position(|c| c.name.to_string() == name) {
            let short = name.rsplit_once('.').map_or(name, |(_, short)| short);
            return Ok(Choice { part, channels: vec![(index, short.to_string())], notes: Vec::new() });
        }
    }
    let names = listed(all, parts);
    Err(no_layer(name, &names))
}

fn deep() -> CodecError {
    unsupported("deep data", "flatten it first")
}

fn luminance_chroma() -> CodecError {
    unsupported("subsampled channels (luminance and chroma: Y, RY, BY)", "convert it to RGB first")
}

fn check_readable(part: &PartHeader, choice: &Choice, options: &DecodeOptions) -> Result<(), CodecError> {
    if part.deep {
        return Err(deep());
    }
    // A block interleaves the rows of all channels, so one subsampled channel is enough to make the others unreadable.
    if part.channels.list.iter().any(|c| c.sampling != Vec2(1, 1)) {
        return Err(luminance_chroma());
    }
    if matches!(part.compression, Packing::HTJ2K32 | Packing::HTJ2K256) {
        return Err(unsupported(part.compression.to_string(), "save it with another compression"));
    }
    let (width, height) = (part.layer_size.0 as u64, part.layer_size.1 as u64);
    if width == 0 || height == 0 {
        return Err(corrupt_text("an empty data window"));
    }
    check_size(Format::Exr, width, height, choice.channels.len() as u64, options)
}

/// Every block takes eight bytes in the offset table and eight more of its own, so a short file cannot hold many.
fn check_plausible(parts: &[PartHeader], len: usize) -> Result<(), CodecError> {
    let blocks = parts.iter().fold(0usize, |sum, part| sum.saturating_add(part.chunk_count));
    if blocks.saturating_mul(16) <= len {
        return Ok(());
    }
    Err(corrupt_text(format!("{len} bytes for {blocks} blocks, which take at least {}", blocks.saturating_mul(16))))
}

fn windows(part: &PartHeader) -> ([i32; 4], [i32; 4]) {
    let half_open = |position: Vec2<i32>, size: Vec2<usize>| {
        let end = |at: i32, n: usize| i32::try_from(i64::from(at) + n as i64).unwrap_or(i32::MAX);
        [position.0, position.1, end(position.0, size.0), end(position.1, size.1)]
    };
    let display = part.shared_attributes.display_window;
    (half_open(part.own_attributes.layer_position, part.layer_size), half_open(display.position, display.size))
}

/// Where a channel's samples stand in a row of a block, and where they go in a pixel.
struct Plane {
    offset: usize,
    kind: SampleType,
    to: usize,
}

fn planes(part: &PartHeader, choice: &Choice) -> Vec<Plane> {
    let offsets: Vec<usize> = part.channels.channels_with_byte_offset().map(|(offset, _)| offset).collect();
    let plane =
        |(to, (index, _)): (usize, &(usize, String))| Plane { offset: offsets[*index], kind: part.channels.list[*index].sample_type, to };
    choice.channels.iter().enumerate().map(plane).collect()
}

fn read_blocks<R: BufRead + Seek>(reader: Reader<R>, choice: &Choice, options: &DecodeOptions) -> Result<Vec<f32>, CodecError> {
    let part = choice.part;
    let wanted = |_: &MetaData, _, block: BlockIndex| block.layer == part && block.level == Vec2(0, 0);
    let mut chunks = reader.filter_chunks(false, wanted).map_err(failed)?;
    let meta = chunks.meta_data().clone();
    let header = &meta.headers[part];
    let (n, width) = (choice.channels.len(), header.layer_size.0);
    let block = header.max_block_pixel_size();
    if block.0 == 0 || block.1 == 0 {
        return Err(corrupt_text("blocks without size"));
    }
    let band_rows = block.1.min(header.layer_size.1);
    let mut bands: Vec<Vec<Chunk>> = Vec::new();
    bands.resize_with(header.layer_size.1.div_ceil(band_rows), Vec::new);
    let mut seen = std::collections::BTreeSet::new();
    for chunk in chunks.by_ref() {
        let chunk = chunk.map_err(failed)?;
        let at = header.get_block_data_indices(&chunk.compressed_block).map_err(failed)?;
        let fits = chunk.layer_index == part && at.level_index == Vec2(0, 0) && seen.insert((at.tile_index.0, at.tile_index.1));
        let band = bands.get_mut(at.tile_index.1).filter(|_| fits);
        band.ok_or_else(|| corrupt_text("a block table that points to the wrong blocks"))?.push(chunk);
    }
    if seen.len() != bands.len() * width.div_ceil(block.0) {
        return Err(corrupt_text("too few blocks"));
    }
    let planes = planes(header, choice);
    let mut pixels = vec![0.0f32; width * header.layer_size.1 * n];
    let jobs: Vec<_> = bands.into_iter().zip(pixels.chunks_mut(band_rows * width * n)).collect();
    let unpacked = map_ordered(jobs, options.threads, |(chunks, out)| {
        chunks.into_iter().try_for_each(|chunk| {
            let block = unpack(chunk, &meta)?;
            scatter(&block, header, &planes, band_rows, n, out)
        })
    });
    unpacked.into_iter().try_for_each(|result| result.unwrap_or_else(|| Err(corrupt_text("contradictions in a block"))))?;
    Ok(pixels)
}

/// The bytes of a block: row by row, within a row channel after channel.
enum Block {
    /// In the machine's order.
    Plain(Vec<u8>),
    /// As deflate gave them once their differences are summed: the bytes at even places, then those at odd places, in the file's order.
    Split(Vec<u8>),
}

/// Unpacks a chunk; deflate here, so that no pass puts the bytes in order that are then taken apart again, everything else by the crate.
fn unpack(chunk: Chunk, meta: &MetaData) -> Result<(Block, BlockIndex), CodecError> {
    let header = &meta.headers[chunk.layer_index];
    if !matches!(header.compression, Packing::ZIP1 | Packing::ZIP16) {
        let block = UncompressedBlock::decompress_chunk(chunk, meta, false).map_err(failed)?;
        return Ok((Block::Plain(block.data), block.index));
    }
    let at = header.get_block_data_indices(&chunk.compressed_block).map_err(failed)?;
    let area = header.get_absolute_block_pixel_coordinates(at).map_err(failed)?;
    let size = header.channels.bytes_per_pixel * area.size.area();
    let packed = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Err(deep()),
    };
    if packed.len() >= size {
        // Stored, for it would not get smaller.
        let block = UncompressedBlock::decompress_chunk(chunk, meta, false).map_err(failed)?;
        return Ok((Block::Plain(block.data), block.index));
    }
    let limit = zune_inflate::DeflateOptions::default().set_limit(size).set_size_hint(size);
    let mut split = zune_inflate::DeflateDecoder::new_with_options(packed, limit)
        .decode_zlib()
        .map_err(|_| corrupt_text("a block that deflate cannot unpack"))?;
    if split.len() != size {
        return Err(corrupt_text("a block of the wrong size"));
    }
    sum_differences(&mut split);
    let position = Vec2(area.position.0.max(0) as usize, area.position.1.max(0) as usize);
    Ok((
        Block::Split(split),
        BlockIndex { layer: chunk.layer_index, pixel_position: position, pixel_size: area.size, level: at.level_index },
    ))
}

/// The inverse of what [`zip_differences`] does last.
fn sum_differences(bytes: &mut [u8]) {
    let mut before = 128u8;
    for byte in bytes {
        before = before.wrapping_add(*byte).wrapping_sub(128);
        *byte = before;
    }
}

impl Block {
    fn len(&self) -> usize {
        match self {
            Block::Plain(bytes) | Block::Split(bytes) => bytes.len(),
        }
    }

    /// The samples of one channel's row that start at byte `at`.
    fn read_line(&self, at: usize, kind: SampleType, line: &mut [f32], scratch: &mut Vec<u8>) {
        let split = match self {
            Block::Plain(bytes) => return read_line(&bytes[at..], kind, line),
            Block::Split(bytes) => bytes,
        };
        let count = line.len() * kind.bytes_per_sample();
        let (even, odd) = split.split_at(split.len().div_ceil(2));
        scratch.resize(count, 0);
        // All samples are of even size, so rows start at even places.
        let (even, odd) = (&even[at / 2..][..count / 2], &odd[at / 2..][..count / 2]);
        for (pair, (even, odd)) in scratch.as_chunks_mut::<2>().0.iter_mut().zip(even.iter().zip(odd)) {
            *pair = [*even, *odd];
        }
        if cfg!(target_endian = "big") {
            scratch.chunks_exact_mut(kind.bytes_per_sample()).for_each(<[u8]>::reverse);
        }
        read_line(scratch, kind, line);
    }
}

/// Copies the wanted channels of one block into its band of rows.
fn scatter(
    (block, index): &(Block, BlockIndex),
    header: &PartHeader,
    planes: &[Plane],
    band_rows: usize,
    n: usize,
    out: &mut [f32],
) -> Result<(), CodecError> {
    let (size, at, width) = (index.pixel_size, index.pixel_position, header.layer_size.0);
    let row_bytes = header.channels.bytes_per_pixel * size.0;
    let first = at.1 % band_rows;
    let fits = at.0 + size.0 <= width && (first + size.1) * width * n <= out.len() && block.len() == row_bytes * size.1;
    if !fits {
        return Err(corrupt_text("a block outside the data window"));
    }
    let (mut lines, mut scratch) = (vec![0.0f32; size.0 * n], Vec::new());
    for y in 0..size.1 {
        for plane in planes {
            let line = &mut lines[plane.to * size.0..(plane.to + 1) * size.0];
            block.read_line(y * row_bytes + plane.offset * size.0, plane.kind, line, &mut scratch);
        }
        let start = ((first + y) * width + at.0) * n;
        interleave(&lines, &mut out[start..start + size.0 * n], n);
    }
    Ok(())
}

/// `n` lines one after another, as pixels.
fn interleave(lines: &[f32], out: &mut [f32], n: usize) {
    match n {
        1 => out.copy_from_slice(lines),
        3 => interleave_exactly::<3>(lines, out),
        4 => interleave_exactly::<4>(lines, out),
        _ => {
            let width = lines.len() / n;
            for (x, pixel) in out.chunks_exact_mut(n).enumerate() {
                pixel.iter_mut().enumerate().for_each(|(c, value)| *value = lines[c * width + x]);
            }
        }
    }
}

fn interleave_exactly<const N: usize>(lines: &[f32], out: &mut [f32]) {
    let pixels = out.as_chunks_mut::<N>().0;
    let width = pixels.len();
    let lines: [&[f32]; N] = std::array::from_fn(|c| &lines[c * width..(c + 1) * width]);
    for (x, pixel) in pixels.iter_mut().enumerate() {
        *pixel = std::array::from_fn(|c| lines[c][x]);
    }
}

/// Samples of one channel, in the machine's byte order, as floats; unsigned integers beyond 2²⁴ are rounded.
fn read_line(bytes: &[u8], kind: SampleType, line: &mut [f32]) {
    match kind {
        SampleType::F16 => match bytemuck::try_cast_slice::<u8, u16>(&bytes[..2 * line.len()]) {
            Ok(halves) => halves.reinterpret_cast::<half::f16>().convert_to_f32_slice(line),
            // A block at an odd address.
            Err(_) => line.iter_mut().zip(bytes.as_chunks::<2>().0).for_each(|(to, b)| *to = half::f16::from_ne_bytes(*b).to_f32()),
        },
        SampleType::F32 => line.iter_mut().zip(bytes.as_chunks::<4>().0).for_each(|(to, b)| *to = f32::from_ne_bytes(*b)),
        SampleType::U32 => line.iter_mut().zip(bytes.as_chunks::<4>().0).for_each(|(to, b)| *to = u32::from_ne_bytes(*b) as f32),
    }
}

pub(super) fn encode(picture: &Picture, options: &EncodeOptions, out: &mut (impl Write + Seek)) -> Result<(), CodecError> {
    let depth = options.depth()?;
    let header = part_header(picture, depth, options)?;
    // The file's channels are in the order of their names' bytes.
    let mut order: Vec<usize> = (0..picture.channels.len()).collect();
    order.sort_by(|a, b| picture.channels[*a].cmp(&picture.channels[*b]));
    let values = to_floats(picture, options);
    let write = || {
        exr::block::write(out, smallvec_of(header), true, |meta, writer| {
            let blocks: Vec<_> = exr::block::enumerate_ordered_header_block_indices(&meta.headers).collect();
            let packed = map_ordered(blocks, options.threads, |(at, block)| {
                let data = gather(&values, picture.width, &order, depth, block);
                (at, pack(data, block, &meta, options))
            });
            for packed in packed {
                let (at, chunk) = packed.ok_or(exr::error::Error::Invalid("a block that could not be packed".into()))?;
                writer.write_chunk(at, chunk?)?;
            }
            Ok(())
        })
    };
    guarded(write)?.map_err(|error| match error {
        exr::error::Error::Io(error) => CodecError::Io(error),
        other => CodecError::BadPicture { what: format!("windows and channel names that an exr can hold ({other})") },
    })
}

/// A block as it is written. Deflate is done here, where its level can be chosen; everything else by the crate.
fn pack(data: Vec<u8>, block: BlockIndex, meta: &MetaData, options: &EncodeOptions) -> Result<Chunk, exr::error::Error> {
    let header = &meta.headers[block.layer];
    if !matches!(header.compression, Packing::ZIP1 | Packing::ZIP16) || cfg!(target_endian = "big") {
        return UncompressedBlock { index: block, data }.compress_to_chunk(&meta.headers);
    }
    let level = match options.level {
        Level::Fast => 1,
        Level::Balanced => 4,
        Level::High => 9,
    };
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::with_capacity(data.len() / 2), flate2::Compression::new(level));
    encoder.write_all(&zip_differences(&data))?;
    let packed = encoder.finish()?;
    let y_coordinate = header.own_attributes.layer_position.1 + block.pixel_position.1 as i32;
    // What does not get smaller is stored as it is; readers tell by the size.
    let compressed_pixels_le = if packed.len() < data.len() { packed } else { data };
    Ok(Chunk {
        layer_index: block.layer,
        compressed_block: CompressedBlock::ScanLine(CompressedScanLineBlock { y_coordinate, compressed_pixels_le }),
    })
}

/// OpenEXR's preparation for deflate: the bytes at even places, then those at odd ones; then each byte's difference from the one before, plus 128.
fn zip_differences(data: &[u8]) -> Vec<u8> {
    let half = data.len().div_ceil(2);
    let mut out = vec![0u8; data.len()];
    let (even, odd) = out.split_at_mut(half);
    for (pair, (even, odd)) in data.as_chunks::<2>().0.iter().zip(even.iter_mut().zip(odd.iter_mut())) {
        (*even, *odd) = (pair[0], pair[1]);
    }
    if let [.., last] = data
        && data.len() % 2 == 1
    {
        out[half - 1] = *last;
    }
    let mut before = out.first().copied().unwrap_or(0);
    for byte in out.iter_mut().skip(1) {
        let difference = byte.wrapping_sub(before).wrapping_add(128);
        before = std::mem::replace(byte, difference);
    }
    out
}

fn smallvec_of(header: PartHeader) -> exr::meta::Headers {
    std::iter::once(header).collect()
}

fn packing(depth: Depth, options: &EncodeOptions) -> Result<Packing, CodecError> {
    let compression = options.compression()?;
    let loses = match compression {
        Compression::Pxr24 => depth == Depth::Float,
        Compression::B44 | Compression::B44a => depth == Depth::Half,
        _ => false,
    };
    if loses && !options.lossy {
        let found = format!("{} samples exactly with {} compression", depth.name(), compression.name());
        return Err(CodecError::Combination {
            format: NAME,
            found,
            choices: "none, rle, zip, zips or piz, or any with `lossy` set".into(),
        });
    }
    Ok(match compression {
        Compression::None => Packing::Uncompressed,
        Compression::Rle => Packing::RLE,
        Compression::Zips => Packing::ZIP1,
        Compression::Piz => Packing::PIZ,
        Compression::Pxr24 => Packing::PXR24,
        Compression::B44 => Packing::B44,
        Compression::B44a => Packing::B44A,
        Compression::Zip | Compression::Auto => Packing::ZIP16,
    })
}

/// The text under `name` in a file, where there is one.
pub(super) fn text(bytes: &[u8], name: &str) -> Option<String> {
    let meta = MetaData::read_from_buffered(std::io::Cursor::new(bytes), false).ok()?;
    let value = meta.headers.iter().find_map(|h| h.own_attributes.other.get(&Text::from(name)));
    if let Some(AttributeValue::Text(text)) = value { String::from_utf8(text.bytes().to_vec()).ok() } else { None }
}

fn part_header(picture: &Picture, depth: Depth, options: &EncodeOptions) -> Result<PartHeader, CodecError> {
    let kind = if depth == Depth::Float { SampleType::F32 } else { SampleType::F16 };
    let mut names: Vec<&String> = picture.channels.iter().collect();
    names.sort();
    let mut channels = Vec::new();
    for name in names {
        let text = Text::new_or_none(name).filter(|_| !name.is_empty() && name.len() <= 255 && !name.contains('\0'));
        let text =
            text.ok_or_else(|| CodecError::BadPicture { what: format!("channel names of 1 to 255 latin letters, found `{name}`") })?;
        channels.push(ChannelDescription { name: text, sample_type: kind, quantize_linearly: name == "A", sampling: Vec2(1, 1) });
    }
    let [x0, y0, x1, y1] = picture.display_window.map(i64::from);
    let (Ok(w), Ok(h)) = (usize::try_from(x1 - x0), usize::try_from(y1 - y0)) else {
        return Err(CodecError::BadPicture { what: format!("a display window of positive size, found {:?}", picture.display_window) });
    };
    let [x, y, ..] = picture.data_window;
    let mut attributes = LayerAttributes::named("");
    attributes.layer_name = None;
    if let Some((name, text)) = &options.text {
        attributes.other.insert(Text::from(*name), AttributeValue::Text(Text::from_slice_unchecked(text.as_bytes())));
    }
    let display = IntegerBounds::new(Vec2(picture.display_window[0], picture.display_window[1]), Vec2(w, h));
    Ok(PartHeader::new(Text::default(), Vec2(picture.width, picture.height), channels.into_iter().collect())
        .with_encoding(packing(depth, options)?, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(attributes)
        .with_position(Vec2(x, y))
        .with_shared_attributes(ImageAttributes::new(display)))
}

/// The bytes of one block: row by row, channel after channel.
fn gather(values: &[f32], width: usize, order: &[usize], depth: Depth, block: BlockIndex) -> Vec<u8> {
    let n = order.len();
    let size = if depth == Depth::Float { 4 } else { 2 };
    let mut data = Vec::with_capacity(block.pixel_size.0 * block.pixel_size.1 * n * size);
    let mut line = vec![0.0f32; block.pixel_size.0];
    let mut halves = vec![half::f16::ZERO; block.pixel_size.0];
    for y in block.pixel_position.1..block.pixel_position.1 + block.pixel_size.1 {
        let row = &values[y * width * n..(y + 1) * width * n];
        for &c in order {
            for (to, pixel) in line.iter_mut().zip(row.chunks_exact(n)) {
                *to = pixel[c];
            }
            if depth == Depth::Float {
                data.extend_from_slice(bytemuck::cast_slice(&line));
            } else {
                halves.convert_from_f32_slice(&line);
                data.extend_from_slice(bytemuck::cast_slice(halves.reinterpret_cast()));
            }
        }
    }
    data
}
