//! The spill file: where values go that do not fit into memory, and come back from. It has no name, so that a killed run leaves nothing.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::array::{Array, DType, Data};
use crate::value::{AnyValue, Meta, OwnedParts};

/// A value that lies in the file: where each array starts, and what is small enough to stay.
#[derive(Debug)]
pub(super) struct Spilled {
    type_name: &'static str,
    arrays: Vec<(&'static str, DType, Vec<usize>, u64)>,
    meta: Meta,
    at: u64,
    len: u64,
}

impl Spilled {
    pub(super) fn type_name(&self) -> &'static str {
        self.type_name
    }
}

/// A file that is made when it is first needed, and the parts of it that are free.
#[derive(Debug)]
pub(super) struct Spill {
    folder: PathBuf,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    file: Option<std::sync::Arc<File>>,
    end: u64,
    /// Start and length of what was freed, by start.
    free: std::collections::BTreeMap<u64, u64>,
}

impl Spill {
    /// A file in `folder`.
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), state: Mutex::default() }
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes the arrays of a value. They go straight to the file: there is no second copy in memory.
    pub(super) fn write(&self, value: &dyn AnyValue) -> io::Result<Spilled> {
        let parts = value.parts();
        let len: u64 = parts.arrays.iter().map(|(_, a)| a.bytes.len() as u64).sum();
        let (file, at) = self.claim(len)?;
        let mut arrays = Vec::with_capacity(parts.arrays.len());
        let mut offset = at;
        for (name, array) in &parts.arrays {
            if let Err(error) = write_at(&file, array.bytes, offset) {
                self.give_back(at, len);
                return Err(error);
            }
            arrays.push((*name, array.dtype, array.shape.to_vec(), offset));
            offset += array.bytes.len() as u64;
        }
        Ok(Spilled { type_name: value.type_name(), arrays, meta: parts.meta, at, len })
    }

    /// Reads the arrays again.
    pub(super) fn read(&self, spilled: &Spilled) -> io::Result<OwnedParts> {
        let file = self.lock().file.clone().ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))?;
        let array = |(name, dtype, shape, offset): &(&'static str, DType, Vec<usize>, u64)| {
            let mut array = zeros(*dtype, shape.clone());
            read_at(&file, bytes_mut(&mut array), *offset)?;
            Ok(((*name).into(), array))
        };
        let arrays = spilled.arrays.iter().map(array).collect::<io::Result<_>>()?;
        Ok(OwnedParts { arrays, meta: spilled.meta.clone() })
    }

    /// Frees what a value had.
    pub(super) fn free(&self, spilled: &Spilled) {
        self.give_back(spilled.at, spilled.len);
    }

    fn claim(&self, len: u64) -> io::Result<(std::sync::Arc<File>, u64)> {
        let mut state = self.lock();
        let file = match &state.file {
            Some(file) => file.clone(),
            None => {
                std::fs::create_dir_all(&self.folder)?;
                let file = std::sync::Arc::new(tempfile::tempfile_in(&self.folder)?);
                state.file = Some(file.clone());
                file
            }
        };
        let found = state.free.iter().filter(|(_, free)| **free >= len).min_by_key(|(_, free)| **free).map(|(at, free)| (*at, *free));
        let at = match found {
            Some((at, free)) => {
                state.free.remove(&at);
                if free > len {
                    state.free.insert(at + len, free - len);
                }
                at
            }
            None => {
                let at = state.end;
                state.end += len;
                at
            }
        };
        Ok((file, at))
    }

    fn give_back(&self, at: u64, len: u64) {
        if len == 0 {
            return;
        }
        let mut state = self.lock();
        let (mut at, mut len) = (at, len);
        if let Some(next) = state.free.remove(&(at + len)) {
            len += next;
        }
        if let Some((&before, &free)) = state.free.range(..at).next_back()
            && before + free == at
        {
            state.free.remove(&before);
            (at, len) = (before, len + free);
        }
        state.free.insert(at, len);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn write_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            n => (bytes, offset) = (&bytes[n..], offset + n as u64),
        }
    }
    Ok(())
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            n => (bytes, offset) = (&mut bytes[n..], offset + n as u64),
        }
    }
    Ok(())
}

fn zeros(dtype: DType, shape: Vec<usize>) -> Array {
    let len = shape.iter().product();
    let data = match dtype {
        DType::F32 => Data::F32(vec![0.0; len]),
        DType::F64 => Data::F64(vec![0.0; len]),
        DType::I64 => Data::I64(vec![0; len]),
        DType::U32 => Data::U32(vec![0; len]),
        DType::U8 => Data::U8(vec![0; len]),
    };
    Array { shape, data }
}

fn bytes_mut(array: &mut Array) -> &mut [u8] {
    match &mut array.data {
        Data::F32(v) => bytemuck::cast_slice_mut(v),
        Data::F64(v) => bytemuck::cast_slice_mut(v),
        Data::I64(v) => bytemuck::cast_slice_mut(v),
        Data::U32(v) => bytemuck::cast_slice_mut(v),
        Data::U8(v) => v,
        // What was just made lies in memory of its own.
        Data::Shared(_) => &mut [],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::{TimeMap, Value, Vector};

    fn back(spill: &Spill, spilled: &Spilled) -> Vector {
        Vector::from_parts(spill.read(spilled).unwrap()).unwrap()
    }

    #[test]
    fn values_come_back_and_their_room_is_used_again() {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::new(folder.path());
        let values: Vec<Vector> = (0..20).map(|i| Vector { values: (0..i * 100).map(|k| f64::from(k) / 3.0).collect() }).collect();
        let mut spilled: Vec<Spilled> = values.iter().map(|v| spill.write(v).unwrap()).collect();
        assert!(spilled.iter().zip(&values).all(|(s, v)| back(&spill, s) == *v));
        let end = spill.lock().end;
        for i in [3, 4, 5, 11, 10, 12] {
            spill.free(&spilled[i]);
        }
        // Neighbours grow together, in whatever order they are freed.
        assert_eq!(spill.lock().free.len(), 2);
        for i in [12, 11, 10, 3, 5, 4] {
            spilled[i] = spill.write(&values[i]).unwrap();
        }
        assert_eq!(spill.lock().end, end, "no more room than before");
        assert!(spilled.iter().zip(&values).all(|(s, v)| back(&spill, s) == *v));
    }

    #[test]
    fn a_file_that_cannot_be_made_is_an_error() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let spill = Spill::new(&file.path().join("below"));
        assert!(spill.write(&TimeMap { source_frames: vec![1.0] }).is_err());
    }
}
