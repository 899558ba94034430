//! Files that are there whole or not at all: written under another name in the same folder, then renamed.
//!
//! A process that is killed leaves the file under the other name behind. Its writer held a lock on it, which is gone with the process, so that whoever
//! writes the same file next can tell, and removes it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a file was not written. Nothing of it is left behind.
#[derive(Debug, Error)]
pub enum WriteError<E: Display> {
    /// The file system refused.
    #[error("{path}: {step} failed: {source}", path = .path.display())]
    File {
        /// The file that was to be written.
        path: PathBuf,
        /// What was being done.
        step: &'static str,
        /// Why it failed.
        source: io::Error,
    },
    /// Whoever makes the contents failed.
    #[error("{path}: {source}", path = .path.display())]
    Contents {
        /// The file that was to be written.
        path: PathBuf,
        /// Why.
        source: E,
    },
}

/// Writes the file `path` by `contents`: into a temporary file beside it, flushed to the disk, then renamed over whatever was there.
///
/// Folders that are not there are made. A reader sees the old file or the new one, never a part. The file's permissions are the usual ones of the
/// process. Cost: one flush to the disk a file.
///
/// # Errors
/// Where a folder or file cannot be made, the disk is full, or `contents` fails; `path` is then as it was, and no temporary file is left.
pub fn write<E: Display>(path: &Path, contents: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>) -> Result<(), WriteError<E>> {
    let failed = |step| move |source| WriteError::File { path: path.to_owned(), step, source };
    if path.is_dir() {
        return Err(failed("writing")(io::Error::new(io::ErrorKind::IsADirectory, "expected a file's name, found a folder")));
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder).map_err(failed("making its folder"))?;
    // Dropping the temporary file removes it, so every return before the rename leaves nothing.
    let temporary = temporary_in(folder, path).map_err(failed("making a file"))?;
    let mut out = BufWriter::with_capacity(1 << 16, temporary.as_file());
    let made = contents(&mut out);
    if let Err(source) = made {
        // What is still in the buffer is of no use, and writing it could fail again.
        let _ = out.into_parts();
        return Err(WriteError::Contents { path: path.to_owned(), source });
    }
    out.flush().map_err(failed("writing"))?;
    drop(out);
    temporary.as_file().sync_all().map_err(failed("flushing to the disk"))?;
    temporary.persist(path).map_err(|e| failed("renaming")(e.error))?;
    Ok(())
}

/// What the name of a temporary file ends with.
const PART: &str = ".part";
/// Letters and digits before that.
const RANDOM: usize = 6;

/// The part of a file's name that its temporary files share. A long name with the random part added could be longer than names may be.
fn stem(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().chars().take(40).collect()
}

/// Removes what processes that were killed left behind when they wrote `files`. What others are writing stays.
pub(crate) fn sweep<'a>(files: impl IntoIterator<Item = &'a Path>) {
    let mut folders: BTreeMap<&Path, BTreeSet<String>> = BTreeMap::new();
    for (folder, file) in files.into_iter().filter_map(|file| Some((file.parent()?, file))) {
        folders.entry(folder).or_default().insert(stem(file));
    }
    folders.iter().for_each(|(folder, stems)| sweep_folder(folder, |stem| stems.contains(stem)));
}

/// As [`sweep`], of all files in a folder for whose names `is_ours`.
pub(crate) fn sweep_folder(folder: &Path, is_ours: impl Fn(&str) -> bool) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let parts = name.to_str().and_then(|n| n.strip_prefix('.')?.strip_suffix(PART)?.rsplit_once('.'));
        if parts.is_some_and(|(stem, random)| random.len() == RANDOM && is_ours(stem)) {
            // Whoever writes it holds its lock. What cannot be looked at or removed harms nobody.
            let free = OpenOptions::new().append(true).open(entry.path()).ok().filter(|file| file.try_lock().is_ok());
            let _ = free.map(|_locked| std::fs::remove_file(entry.path()));
        }
    }
}

/// A file in `folder` with a name like that of `path`, gone with the value unless it is renamed, and locked, so that nobody takes it for left behind.
pub(crate) fn temporary_in(folder: &Path, path: &Path) -> io::Result<tempfile::NamedTempFile> {
    loop {
        let temporary = create_in(folder, path)?;
        let is_taken = matches!(temporary.as_file().try_lock(), Err(TryLockError::WouldBlock));
        // Between the making and the locking somebody may have swept it away.
        if !is_taken && temporary.path().exists() {
            return Ok(temporary);
        }
    }
}

fn create_in(folder: &Path, path: &Path) -> io::Result<tempfile::NamedTempFile> {
    let prefix = format!(".{}.", stem(path));
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).rand_bytes(RANDOM).suffix(PART);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's mask takes away from these what its user does not grant.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn put(path: &Path, text: &str) -> Result<(), WriteError<io::Error>> {
        write(path, |out| out.write_all(text.as_bytes()))
    }

    #[test]
    fn a_file_is_written_and_written_over_with_its_folders_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        put(&path, "one").unwrap();
        put(&path, "two").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(names(path.parent().unwrap()), ["c.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_has_the_permissions_of_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, usual) = (folder.path().join("ours"), folder.path().join("usual"));
        put(&ours, "x").unwrap();
        std::fs::write(&usual, "x").unwrap();
        let mode = |p: &Path| std::fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&usual));
    }

    #[test]
    fn contents_that_fail_leave_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.txt");
        put(&path, "old").unwrap();
        let error = write(&path, |out| {
            out.write_all(b"half").map_err(|e| e.to_string())?;
            Err::<(), String>("it broke".to_owned())
        });
        assert_eq!(error.unwrap_err().to_string(), format!("{}: it broke", path.display()));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["c.txt"]);
    }

    #[test]
    fn a_name_that_cannot_be_a_file_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = put(folder.path(), "x").unwrap_err().to_string();
        assert_eq!(error, format!("{}: writing failed: expected a file's name, found a folder", folder.path().display()));
        put(&folder.path().join("file"), "x").unwrap();
        let error = put(&folder.path().join("file/below.txt"), "x").unwrap_err().to_string();
        assert!(error.contains("making its folder failed"), "{error}");
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[test]
    fn what_killed_writers_left_is_swept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let (ours, long) = (folder.path().join("hat.1.png"), folder.path().join("x".repeat(200)));
        let living = temporary_in(folder.path(), &ours).unwrap();
        for path in [&ours, &long, &folder.path().join("other.png")] {
            // As it is left by a process that is gone: without a lock.
            let (file, path) = create_in(folder.path(), path).unwrap().keep().unwrap();
            drop((file, path));
        }
        std::fs::write(folder.path().join(".hat.1.png.part"), "of another program").unwrap();
        put(&ours, "whole").unwrap();
        assert_eq!(names(folder.path()).len(), 6);
        sweep([ours.as_path(), long.as_path()]);
        let left = names(folder.path());
        assert!(left.len() == 4 && living.path().exists(), "{left:?}");
        assert!(left.iter().any(|n| n.starts_with(".other.png.")) && left.contains(&".hat.1.png.part".to_owned()), "{left:?}");
        living.persist(&ours).unwrap();
        sweep_folder(folder.path(), |_| true);
        assert_eq!(names(folder.path()), [".hat.1.png.part", "hat.1.png"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_disk_that_is_full_leaves_no_part_of_a_file() {
        // Only a file system of its own can be full without harm to others.
        let folder = tempfile::tempdir().unwrap();
        let mounted = std::process::Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"]).arg(folder.path()).output();
        if !mounted.is_ok_and(|o| o.status.success()) {
            eprintln!("skipped: no file system may be mounted here");
            return;
        }
        let path = folder.path().join("big.bin");
        let error = write(&path, |out| out.write_all(&vec![7u8; 1 << 20])).unwrap_err().to_string();
        let left = names(folder.path());
        let unmounted = std::process::Command::new("umount").arg(folder.path()).status();
        assert!(error.contains("No space left on device"), "{error}");
        assert!(left.is_empty(), "{left:?}");
        assert!(unmounted.is_ok_and(|s| s.success()));
    }
}
