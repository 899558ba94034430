//! Values in NumPy's `.npz` files, and back: every array as an entry `name.npy`, the text fields as one JSON object in the `u8` array `meta`.
//!
//! A stream is one file too: each array stacked on a leading axis beside an `i64` array `frames`. Its `meta` stands once where it is the same at
//! every frame, else as a list under the key `per_frame`. `numpy.load` reads what is written here, and what `numpy.savez` and
//! `numpy.savez_compressed` write is read here: arrays in either byte order, by rows or by columns, of any number type whose values the wanted type
//! holds exactly.
//!
//! **Source**: NumPy Enhancement Proposal 1 (Kern 2007); ZIP File Format Specification 6.3.10 (PKWARE).

mod npy;

#[cfg(test)]
mod tests;

use std::io::{self, Read, Seek, SeekFrom, Write};

use thiserror::Error;
use zip::CompressionMethod;
use zip::result::ZipError;
use zip::write::SimpleFileOptions;

use crate::array::{Array, DType, Data, Shape, describe};
use crate::node::{Fault, NodeError};
use crate::value::{AnyValue, Meta, OwnedParts, ValueError, ValueRef, ValueType};

use npy::Header;

/// The array of text fields.
const META: &str = "meta";
/// The array of frame numbers.
const FRAMES: &str = "frames";
/// The key of a list of text fields, one a frame.
const PER_FRAME: &str = "per_frame";

/// Why a file is not read or written.
#[derive(Debug, Error)]
pub enum NpzError {
    /// The reader or writer failed.
    #[error("reading or writing failed: {0}")]
    Io(#[from] io::Error),
    /// The file is damaged, cut short or no `.npz` at all.
    #[error("expected a sound npz file, found {what}; it may have been cut short or damaged: copy or write it again")]
    Corrupt {
        /// What was found.
        what: String,
    },
    /// The file asks for more memory than permitted.
    #[error("expected at most {limit} bytes in the arrays of one value, found array `{name}` of {shape}")]
    TooLarge {
        /// The array.
        name: String,
        /// Its extents.
        shape: String,
        /// The limit in bytes.
        limit: u64,
    },
    /// An array is not there.
    #[error("expected an array `{name}`, found {present}")]
    Missing {
        /// The array.
        name: String,
        /// The arrays that are there.
        present: String,
    },
    /// The elements or the packing of an array are of a kind that is not read.
    #[error("array `{name}`: expected numbers, found {what}; save it with a number type, as `array.astype(numpy.float64)`")]
    Unsupported {
        /// The array.
        name: String,
        /// What it holds.
        what: String,
    },
    /// The arrays do not make a value of the type.
    #[error("{ty}: {source}; the file has {present}")]
    Value {
        /// The value type.
        ty: &'static str,
        /// Why not.
        source: ValueError,
        /// The arrays that are there.
        present: String,
    },
    /// The frames of a stream are not alike.
    #[error("expected {expected} at every frame, found {found} at frame {frame}; write one file a frame, with #### in the path")]
    Uneven {
        /// Array and extents of the first frame.
        expected: String,
        /// Those of the other.
        found: String,
        /// The first frame that differs.
        frame: i64,
    },
    /// A stream's arrays do not go together.
    #[error("expected {expected} frames in array `{name}`, found {found}")]
    Length {
        /// The array.
        name: String,
        /// Frames.
        expected: usize,
        /// What its leading axis has.
        found: String,
    },
}

impl NpzError {
    fn unsupported(name: &str, what: &str) -> Self {
        NpzError::Unsupported { name: name.to_owned(), what: what.to_owned() }
    }

    /// A failure while reading an entry: damage, unless the disk itself fails.
    fn entry(name: &str, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => NpzError::Corrupt { what: format!("array `{name}` that ends too soon") },
            _ => NpzError::Corrupt { what: format!("array `{name}` that cannot be read: {error}") },
        }
    }
}

impl From<NpzError> for NodeError {
    fn from(error: NpzError) -> Self {
        let fault = match error {
            NpzError::Io(_) => Fault::Io,
            NpzError::TooLarge { .. } => Fault::Limit,
            NpzError::Unsupported { .. } => Fault::Unsupported,
            _ => Fault::Input,
        };
        NodeError::new(fault, error.to_string())
    }
}

fn zip_error(error: ZipError) -> NpzError {
    match error {
        ZipError::Io(e) if e.kind() != io::ErrorKind::UnexpectedEof && e.raw_os_error().is_some() => NpzError::Io(e),
        ZipError::Io(e) => NpzError::Corrupt { what: format!("an archive that cannot be read: {e}") },
        other => NpzError::Corrupt { what: format!("an archive that cannot be read: {other}") },
    }
}

/// Writes one value. The bytes depend on the value and `compress` alone.
///
/// Cost: O(bytes).
///
/// # Errors
/// Where the writer fails.
pub fn write(value: &dyn AnyValue, compress: bool, out: impl Write + Seek) -> Result<(), NpzError> {
    let parts = value.parts();
    let mut zip = Writer::new(compress, out);
    for (name, array) in &parts.arrays {
        zip.array(name, array.dtype, &array.shape, array.bytes)?;
    }
    zip.meta(parts.meta)?;
    zip.finish()
}

/// Writes a stream as one file: `value(i)` is that of the frame `frames[i]`.
///
/// One value is held at a time. Each is asked for once for every array that the type has, first to last, so that a value which was moved to disk
/// meanwhile is fetched in the order in which it is written.
///
/// Cost: O(bytes).
///
/// # Errors
/// Where the frames' arrays differ in extents, the writer fails, or `value` does.
pub fn write_stream<E: From<NpzError>>(
    frames: &[i64],
    mut value: impl FnMut(usize) -> Result<ValueRef, E>,
    compress: bool,
    out: impl Write + Seek,
) -> Result<(), E> {
    let mut zip = Writer::new(compress, out);
    zip.array(FRAMES, DType::I64, &[frames.len()], bytemuck::cast_slice(frames))?;
    let mut metas = Vec::with_capacity(frames.len());
    let layout = if frames.is_empty() { Vec::new() } else { layout(value(0)?.as_ref()) };
    for (i, (name, dtype, shape)) in layout.iter().enumerate() {
        let stacked: Vec<usize> = std::iter::once(frames.len()).chain(shape.iter().copied()).collect();
        zip.begin(name, *dtype, &stacked)?;
        for (at, frame) in frames.iter().enumerate() {
            let value = value(at)?;
            let parts = value.parts();
            match parts.arrays.get(i) {
                Some((_, array)) if array.dtype == *dtype && array.shape == *shape => zip.more(array.bytes)?,
                other => {
                    let told = |dtype, shape: &[usize]| format!("`{name}` as {}", describe(dtype, shape));
                    let found = other.map_or_else(|| "another type".to_owned(), |(_, a)| told(a.dtype, &a.shape));
                    return Err(NpzError::Uneven { expected: told(*dtype, shape), found, frame: *frame }.into());
                }
            }
            if i == 0 {
                metas.push(parts.meta);
            }
        }
    }
    // A type of texts alone has no array whose turn the texts could be read at.
    for at in metas.len()..frames.len() {
        metas.push(value(at)?.parts().meta);
    }
    zip.meta(stacked_meta(metas))?;
    Ok(zip.finish()?)
}

/// Name, element type and extents of each array.
fn layout(value: &dyn AnyValue) -> Vec<(&'static str, DType, Shape)> {
    value.parts().arrays.into_iter().map(|(name, a)| (name, a.dtype, a.shape)).collect()
}

/// Text fields once where they are the same at every frame, else as a list.
fn stacked_meta(mut metas: Vec<Meta>) -> Meta {
    let alike = metas.windows(2).all(|w| w[0] == w[1]) && metas.iter().all(|m| !m.contains_key(PER_FRAME));
    if alike {
        return metas.pop().unwrap_or_default();
    }
    let list = metas.into_iter().map(serde_json::Value::Object).collect();
    std::iter::once((PER_FRAME.to_owned(), serde_json::Value::Array(list))).collect()
}

/// Hands on what is written until something fails, then swallows the rest: an archive finishes itself when it is dropped, and complains on stderr
/// where it cannot.
struct Fused<W> {
    out: W,
    at: u64,
    end: u64,
    has_failed: bool,
}

impl<W> Fused<W> {
    /// Does something, unless something failed before, which then was the last thing done.
    fn pass<T>(&mut self, otherwise: T, act: impl FnOnce(&mut W) -> io::Result<T>) -> io::Result<T> {
        if self.has_failed {
            return Ok(otherwise);
        }
        let done = act(&mut self.out);
        self.has_failed = done.as_ref().is_err_and(|e| e.kind() != io::ErrorKind::Interrupted);
        done
    }
}

impl<W: Write> Write for Fused<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.pass(bytes.len(), |out| out.write(bytes))?;
        self.at += written as u64;
        self.end = self.end.max(self.at);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.pass((), W::flush)
    }
}

impl<W: Seek> Seek for Fused<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let place = match to {
            SeekFrom::Start(n) => n,
            SeekFrom::Current(n) => self.at.saturating_add_signed(n),
            SeekFrom::End(n) => self.end.saturating_add_signed(n),
        };
        self.at = self.pass(place, |out| out.seek(to))?;
        Ok(self.at)
    }
}

struct Writer<W: Write + Seek> {
    zip: zip::ZipWriter<Fused<W>>,
    options: SimpleFileOptions,
}

impl<W: Write + Seek> Writer<W> {
    fn new(compress: bool, out: W) -> Self {
        let method = if compress { CompressionMethod::Deflated } else { CompressionMethod::Stored };
        // A fixed time, so that the same value has the same bytes.
        let options = SimpleFileOptions::default().compression_method(method).last_modified_time(zip::DateTime::default());
        Self { zip: zip::ZipWriter::new(Fused { out, at: 0, end: 0, has_failed: false }), options }
    }

    /// An array whose bytes follow by [`Writer::more`].
    fn begin(&mut self, name: &str, dtype: DType, shape: &[usize]) -> Result<(), NpzError> {
        let bytes = shape.iter().fold(dtype.size() as u64, |n, &d| n.saturating_mul(d as u64));
        let options = self.options.large_file(bytes > u64::from(u32::MAX) / 2);
        self.zip.start_file(format!("{name}.npy"), options).map_err(written)?;
        Ok(npy::write_header(dtype, shape, &mut self.zip)?)
    }

    fn more(&mut self, bytes: &[u8]) -> Result<(), NpzError> {
        Ok(self.zip.write_all(bytes)?)
    }

    fn array(&mut self, name: &str, dtype: DType, shape: &[usize], bytes: &[u8]) -> Result<(), NpzError> {
        self.begin(name, dtype, shape)?;
        self.more(bytes)
    }

    fn meta(&mut self, meta: Meta) -> Result<(), NpzError> {
        if meta.is_empty() {
            return Ok(());
        }
        let text = serde_json::Value::Object(meta).to_string();
        self.array(META, DType::U8, &[text.len()], text.as_bytes())
    }

    fn finish(self) -> Result<(), NpzError> {
        self.zip.finish().map_err(written)?.flush()?;
        Ok(())
    }
}

fn written(error: ZipError) -> NpzError {
    match error {
        ZipError::Io(e) => NpzError::Io(e),
        other => NpzError::Io(io::Error::other(other.to_string())),
    }
}

/// The most bytes that the arrays of one value may have unless the caller says otherwise.
pub const MAX_BYTES: u64 = 8 << 30;

/// Entries up to this size are read whole for one frame, so that their checksum is checked.
const CHECKED: u64 = 4 << 20;

/// An `.npz` file that is read, array by array.
pub struct Archive<R> {
    zip: zip::ZipArchive<R>,
    names: Vec<String>,
    limit: u64,
}

impl<R: Read + Seek> Archive<R> {
    /// Opens a file whose values may have `limit` bytes of arrays each.
    ///
    /// # Errors
    /// Where it is no archive.
    pub fn open(reader: R, limit: u64) -> Result<Self, NpzError> {
        let zip = zip::ZipArchive::new(reader).map_err(zip_error)?;
        let names = zip.file_names().filter_map(Result::ok).filter_map(|n| n.strip_suffix(".npy").map(str::to_owned)).collect();
        Ok(Self { zip, names, limit })
    }

    /// Names of the arrays, in the order of the file.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    fn present(&self) -> String {
        match self.names.len() {
            0 => "no arrays".to_owned(),
            n if n > 12 => format!("{} and {} more", self.names[..12].join(", "), n - 12),
            _ => self.names.join(", "),
        }
    }

    /// The frames of a stream; `None` for a file of one value.
    ///
    /// # Errors
    /// Where `frames` is there and is no list of whole numbers, or the file is damaged.
    pub fn frames(&mut self) -> Result<Option<Vec<i64>>, NpzError> {
        if !self.has(FRAMES) {
            return Ok(None);
        }
        let array = npy::convert(self.array(FRAMES)?, DType::I64);
        match (array.shape.len(), array.data) {
            (1, Data::I64(frames)) => Ok(Some(frames)),
            (_, data) => {
                let found = describe(Array { shape: Vec::new(), data }.dtype(), &array.shape);
                Err(NpzError::Corrupt { what: format!("array `{FRAMES}` as {found} in place of i64 [t]") })
            }
        }
    }

    /// Every array and the text fields, as they are.
    ///
    /// # Errors
    /// Where the file is damaged, too large, or holds anything but numbers.
    pub fn parts(&mut self) -> Result<OwnedParts, NpzError> {
        let mut left = self.limit;
        let mut arrays = Vec::new();
        for name in self.names.clone() {
            if name != META {
                let array = self.read(&name, None, &mut left)?;
                arrays.push((name.into(), array));
            }
        }
        Ok(OwnedParts { arrays, meta: self.meta()? })
    }

    /// The one value of the type `ty`. Arrays that the type does not have are passed over.
    ///
    /// # Errors
    /// As of [`Archive::parts`], or where the arrays do not make such a value.
    pub fn value(&mut self, ty: &ValueType) -> Result<ValueRef, NpzError> {
        let meta = self.meta()?;
        self.assemble(ty, None, meta)
    }

    /// The value at the position `idx` of a stream of `frames` values.
    ///
    /// Cost: O(bytes of the frame) for large arrays that are stored as they are; O(bytes of the stream up to it) for packed ones.
    ///
    /// # Errors
    /// As of [`Archive::value`], or where an array has another number of frames.
    pub fn frame(&mut self, ty: &ValueType, idx: usize, frames: usize) -> Result<ValueRef, NpzError> {
        let mut meta = self.meta()?;
        match meta.remove(PER_FRAME) {
            Some(serde_json::Value::Array(mut list)) if list.len() == frames && idx < frames => match list.swap_remove(idx) {
                serde_json::Value::Object(own) => meta.extend(own),
                _ => return Err(NpzError::Corrupt { what: format!("texts in `{META}` that are no objects") }),
            },
            Some(_) => {
                return Err(NpzError::Length { name: META.to_owned(), expected: frames, found: "another number of texts".to_owned() });
            }
            None => {}
        }
        self.assemble(ty, Some((idx, frames)), meta)
    }

    fn assemble(&mut self, ty: &ValueType, frame: Option<(usize, usize)>, meta: Meta) -> Result<ValueRef, NpzError> {
        let mut left = self.limit;
        let mut arrays = Vec::new();
        for wanted in &ty.schema.arrays {
            if wanted.optional && !self.has(wanted.name) {
                continue;
            }
            let array = self.read(wanted.name, frame, &mut left)?;
            arrays.push((wanted.name.into(), npy::convert(array, wanted.dtype)));
        }
        let made = (ty.from_parts)(OwnedParts { arrays, meta });
        made.map_err(|source| NpzError::Value { ty: ty.schema.name, source, present: self.present() })
    }

    fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    fn array(&mut self, name: &str) -> Result<Array, NpzError> {
        let mut left = self.limit;
        self.read(name, None, &mut left)
    }

    fn meta(&mut self) -> Result<Meta, NpzError> {
        if !self.has(META) {
            return Ok(Meta::new());
        }
        let Data::U8(bytes) = npy::convert(self.array(META)?, DType::U8).data else {
            return Err(NpzError::Corrupt { what: format!("array `{META}` that is not of bytes") });
        };
        serde_json::from_slice(&bytes).map_err(|e| NpzError::Corrupt { what: format!("array `{META}` that is no JSON object: {e}") })
    }

    /// Reads an array, or one frame of it: position and number of frames.
    fn read(&mut self, name: &str, frame: Option<(usize, usize)>, left: &mut u64) -> Result<Array, NpzError> {
        let file = format!("{name}.npy");
        let Some(at) = self.zip.index_for_name(&file) else {
            return Err(NpzError::Missing { name: name.to_owned(), present: self.present() });
        };
        let limit = self.limit;
        let (header, size, stored) = {
            let mut entry = self.zip.by_index(at).map_err(|e| zip_entry(name, e))?;
            let stored = entry.compression() == CompressionMethod::Stored;
            (npy::read_header(name, &mut entry)?, entry.size(), stored)
        };
        let frame = frame.map(|(idx, frames)| match header.shape.first() {
            Some(&n) if n == frames && idx < n => Ok(idx),
            other => Err(NpzError::Length {
                name: name.to_owned(),
                expected: frames,
                found: other.map_or_else(|| "a single value".to_owned(), usize::to_string),
            }),
        });
        let frame = frame.transpose()?;
        let too_large = || NpzError::TooLarge { name: name.to_owned(), shape: crate::array::describe_shape(&header.shape), limit };
        let (_, all) = header.extent().ok_or_else(too_large)?;
        let seekable = stored && !header.fortran_order && size > CHECKED;
        let (skip, wanted) = match frame {
            Some(idx) if seekable => {
                let each = all / header.shape[0];
                (each * idx, each)
            }
            _ => (0, all),
        };
        *left = left.checked_sub(wanted as u64).ok_or_else(too_large)?;
        if (size as u128) < all as u128 {
            return Err(NpzError::Corrupt { what: format!("array `{name}` of {size} bytes in place of {all}") });
        }
        let bytes = if seekable && frame.is_some() { self.seek(name, at, skip, wanted)? } else { self.stream(name, at, wanted)? };
        finish(name, header, bytes, frame, seekable)
    }

    /// The elements of an entry, to its end, where the checksum is held against them.
    fn stream(&mut self, name: &str, at: usize, wanted: usize) -> Result<Vec<u8>, NpzError> {
        let mut entry = self.zip.by_index(at).map_err(|e| zip_entry(name, e))?;
        npy::read_header(name, &mut entry)?;
        let mut bytes = Vec::new();
        // What the header claims is allocated as it comes, so that a lie costs nothing.
        entry.by_ref().take(wanted as u64).read_to_end(&mut bytes).map_err(|e| NpzError::entry(name, &e))?;
        if bytes.len() != wanted {
            return Err(NpzError::Corrupt { what: format!("array `{name}` of {} bytes in place of {wanted}", bytes.len()) });
        }
        match entry.read(&mut [0]) {
            Ok(0) => Ok(bytes),
            Ok(_) => Err(NpzError::Corrupt { what: format!("array `{name}` with more than {wanted} bytes") }),
            Err(e) => Err(NpzError::entry(name, &e)),
        }
    }

    /// Some of the elements of an entry that is stored as it is.
    fn seek(&mut self, name: &str, at: usize, skip: usize, wanted: usize) -> Result<Vec<u8>, NpzError> {
        let mut entry = self.zip.by_index_seek(at).map_err(|e| zip_entry(name, e))?;
        npy::read_header(name, &mut entry)?;
        entry.seek(SeekFrom::Current(i64::try_from(skip).unwrap_or(i64::MAX)))?;
        let mut bytes = Vec::new();
        entry.take(wanted as u64).read_to_end(&mut bytes).map_err(|e| NpzError::entry(name, &e))?;
        if bytes.len() == wanted { Ok(bytes) } else { Err(NpzError::Corrupt { what: format!("array `{name}` that ends too soon") }) }
    }
}

fn zip_entry(name: &str, error: ZipError) -> NpzError {
    match error {
        ZipError::CompressionMethodNotSupported(_) | ZipError::UnsupportedArchive(_) | ZipError::InvalidPassword => {
            NpzError::unsupported(name, "a packing other than deflate, or a password")
        }
        other => zip_error(other),
    }
}

/// Bytes to elements; where all frames were read, the one that is wanted.
fn finish(name: &str, mut header: Header, bytes: Vec<u8>, frame: Option<usize>, sliced: bool) -> Result<Array, NpzError> {
    if let (Some(_), true) = (frame, sliced) {
        header.shape.remove(0);
    }
    let beyond = || NpzError::unsupported(name, "whole numbers beyond 63 bits");
    let array = npy::decode(&header, bytes).ok_or_else(beyond)?;
    match frame {
        Some(idx) if !sliced => Ok(slice(array, idx)),
        _ => Ok(array),
    }
}

/// The part of an array at a position of its leading axis, which is there.
fn slice(mut array: Array, idx: usize) -> Array {
    fn part<T: Clone>(data: &[T], idx: usize, frames: usize) -> Vec<T> {
        let each = data.len() / frames.max(1);
        data[each * idx..each * (idx + 1)].to_vec()
    }
    let frames = array.shape.remove(0);
    let data = match &array.data {
        Data::F32(v) => Data::F32(part(v, idx, frames)),
        Data::F64(v) => Data::F64(part(v, idx, frames)),
        Data::I64(v) => Data::I64(part(v, idx, frames)),
        Data::U32(v) => Data::U32(part(v, idx, frames)),
        Data::U8(v) => Data::U8(part(v, idx, frames)),
        Data::Shared(_) => {
            let mut own = array.view().to_array();
            own.shape.insert(0, frames);
            return slice(own, idx);
        }
    };
    Array { data, ..array }
}
