//! What the file nodes share: bytes read with a limit, files written whole, and whose fault a failure is.

use std::fs::File;
use std::io::{BufWriter, Read};
use std::path::Path;

use pegbar_engine::atomic;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::codec::CodecError;

/// The most bytes that one file may have: more is a mistake, as a device or a disk image in place of a picture.
const MAX_FILE: u64 = 16 << 30;

/// Opens a file to be read.
pub(super) fn open(path: &Path) -> Result<File, NodeError> {
    // Before it is opened: that of a pipe waits for somebody who writes.
    let about = std::fs::metadata(path).map_err(|e| NodeError::io(path, e))?;
    if !about.is_file() {
        return Err(NodeError::io(path, "expected a file, found a folder, a pipe or a device"));
    }
    let file = File::open(path).map_err(|e| NodeError::io(path, e))?;
    if about.len() > MAX_FILE {
        return Err(NodeError::new(Fault::Limit, format!("{}: expected at most {MAX_FILE} bytes, found {}", path.display(), about.len())));
    }
    Ok(file)
}

/// All bytes of a file, as they were at one time.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, NodeError> {
    let io = |error| NodeError::io(path, error);
    let mut file = open(path)?;
    let before = file.metadata().map_err(io)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(io)?;
    let after = file.metadata().map_err(io)?;
    // Half of what it was and half of what it becomes is neither.
    if bytes.len() as u64 != after.len() || before.modified().ok() != after.modified().ok() {
        let message = format!("expected {} to stay as it was while it is read, found it changed", path.display());
        return Err(NodeError::new(Fault::Io, message).help("run again once nothing writes to it"));
    }
    Ok(bytes)
}

/// Writes a file whole or not at all.
pub(super) fn write<E: std::fmt::Display>(
    path: &Path,
    fault: Fault,
    contents: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), NodeError> {
    write_read(path, |out| contents(out).map_err(|error| NodeError::new(fault, error.to_string())))
}

/// As [`write`], of contents that are read meanwhile: what fails there keeps its fault and its help.
pub(super) fn write_read(path: &Path, contents: impl FnOnce(&mut BufWriter<&File>) -> Result<(), NodeError>) -> Result<(), NodeError> {
    atomic::write(path, contents).map_err(|error| match error {
        atomic::WriteError::File { .. } => NodeError::new(Fault::Io, error.to_string()),
        atomic::WriteError::Contents { path, source } => NodeError { message: format!("{}: {source}", path.display()), ..source },
    })
}

/// A codec's failure at a file.
pub(super) fn codec_error(path: &Path, error: &CodecError) -> NodeError {
    let fault = match error {
        CodecError::UnknownFormat { .. } | CodecError::Corrupt { .. } | CodecError::BadPicture { .. } => Fault::Input,
        CodecError::Unsupported { .. } => Fault::Unsupported,
        CodecError::TooLarge { .. } => Fault::Limit,
        CodecError::NoLayer { .. } | CodecError::Combination { .. } => Fault::Parameters,
        CodecError::NotFinite { .. } => Fault::Numeric,
        CodecError::Io(_) => Fault::Io,
    };
    NodeError::new(fault, format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_file_is_refused_without_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success());
        if !made {
            eprintln!("skipped in part: there is no mkfifo");
        }
        for path in [folder.path(), &pipe].into_iter().take(1 + usize::from(made)) {
            let error = read(path).unwrap_err().to_string();
            assert!(error.contains("expected a file, found a folder, a pipe or a device"), "{error}");
        }
    }
}
