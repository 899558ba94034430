//! The disk cache: results by key, kept from run to run, shared by every process that names the folder, and never trusted.
//!
//! A key names a digest, and a digest names bytes. Values of [`BLOB`] bytes and more are `.npz` files of their own, named by their digest; smaller
//! ones lie in one file beside the log of the process that stored them. Nothing is flushed to the disk: whatever a crash tears is found by its
//! checksum or its digest, dropped, and computed again.
//!
//! ```text
//! DIR/v1/CACHEDIR.TAG         tells backup programs to pass it over
//! DIR/v1/blobs/ab/ab12...npz  a value, by the digest of its arrays and texts
//! DIR/v1/index/x.log          records: key to digest, notes, uses, removals
//! DIR/v1/index/x.data         small values, as .npz
//! DIR/v1/index/x.lock         held by the process that writes both
//! DIR/v1/users                a lock that all who use the folder share
//! DIR/v1/lock                 held by the process that takes over or removes logs
//! DIR/v1/tmp                  blobs that are being written
//! ```
//!
//! **Age** is counted in generations, never in time: a run's is one more than the highest in the folder when it opened it. The size is kept below a
//! limit by removing what was not used for the most generations, and never what this run stored or used. Each further process that writes at the same
//! time may pass the limit by a thirty-second part before it hears of the others.
//!
//! **Several processes** need no agreement: the facts of all logs give the same index in any order, as a value is there if it was stored in a later
//! generation than the last in which it was removed. What one removes while another wants it, the other computes again.

mod evict;
mod index;
mod log;
mod record;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};

use serde::Serialize;
use thiserror::Error;

use crate::npz::{self, Archive, NpzError};
use crate::registry::Types;
use crate::value::{AnyValue, OwnedParts, ValueRef, ValueType, digest_parts};

use evict::Victim;
use index::{Index, Place, mark};
use log::{Folder, Known, Log};
use record::{Held, Record};

pub use evict::Freed;

/// Name of a result, made elsewhere: any 32 bytes that are as good as random.
pub type Key = [u8; 32];
/// What [`value::digest`](crate::value::digest) says of a value.
pub type Digest = [u8; 32];

/// Values whose arrays have so many bytes have files of their own.
pub const BLOB: u64 = 64 << 10;
/// The limit where none is given, in bytes.
pub const DEFAULT_LIMIT: u64 = 20 << 30;
/// What a value costs beside its arrays, at most, in nearly all cases.
const OVERHEAD: u64 = 2048;
/// Troubles that are told one by one.
const MAX_TROUBLES: usize = 20;

/// A value that the cache has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its digest.
    pub digest: Digest,
    /// Bytes of its arrays.
    pub bytes: u64,
}

/// Why a folder cannot be a cache.
#[derive(Debug, Error)]
#[error("{path}: {step} failed: {source}; name another folder for the cache, or run without one", path = .path.display())]
pub struct CacheError {
    /// The folder.
    pub path: PathBuf,
    /// What was being done.
    pub step: &'static str,
    /// Why it failed.
    pub source: io::Error,
}

/// What went wrong with the cache in a run that went on without it.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Trouble {
    /// A value was not what was stored.
    #[error("{folder}: expected the {ty} {digest}, found {found}; it was dropped, and is computed again", folder = .folder.display())]
    Damaged {
        /// The cache folder.
        folder: PathBuf,
        /// The value's type.
        ty: String,
        /// The value's digest in hexadecimal.
        digest: String,
        /// What was found.
        found: String,
    },
    /// Part of a log is damaged.
    #[error("{file}: expected records of the cache, found {bytes} bytes that are none; what they told of is computed again", file = .file.display())]
    Index {
        /// The log.
        file: PathBuf,
        /// Bytes that are no record.
        bytes: usize,
    },
    /// A file cannot be read.
    #[error("{file}: expected to read it, found {reason}; what it holds is computed again", file = .file.display())]
    Unread {
        /// The file.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A value is beyond the limit by itself.
    #[error("{folder}: expected values below the cache's limit of {limit} bytes, found one of {bytes}; raise the limit to keep such values", folder = .folder.display())]
    TooLarge {
        /// The cache folder.
        folder: PathBuf,
        /// The limit in bytes.
        limit: u64,
        /// Bytes of the value's arrays.
        bytes: u64,
    },
    /// This run alone fills the cache.
    #[error("{folder}: expected this run to need less than the cache's limit of {limit} bytes, found it full; the rest is not kept: raise the limit", folder = .folder.display())]
    Full {
        /// The cache folder.
        folder: PathBuf,
        /// The limit in bytes.
        limit: u64,
    },
    /// The folder cannot be written any more.
    #[error("{folder}: {step} failed: {reason}; the rest of this run is not kept in the cache", folder = .folder.display())]
    Stopped {
        /// The cache folder.
        folder: PathBuf,
        /// What was being done.
        step: &'static str,
        /// Why it failed.
        reason: String,
    },
    /// There were more troubles than are told one by one.
    #[error("{count} more troubles with the cache were passed over")]
    More {
        /// How many.
        count: usize,
    },
}

/// What a cache was good for in this run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Keys that were found.
    pub found: u64,
    /// Values read back.
    pub loaded: u64,
    /// Values stored.
    pub stored: u64,
    /// Values that were not what was stored.
    pub damaged: u64,
    /// Values that were gone when they were wanted: removed by another process, or lost with the machine's power.
    pub lost: u64,
    /// Bytes on the disk now, those of other processes included as far as they are known.
    pub bytes: u64,
    /// The limit in bytes.
    pub limit: u64,
}

/// What is in a cache folder.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stats {
    /// Values.
    pub values: u64,
    /// Keys, of which several may name one value.
    pub keys: u64,
    /// Notes.
    pub notes: u64,
    /// Bytes on the disk.
    pub bytes: u64,
    /// Generation of the value that was not used for longest; 0 where there is none.
    pub oldest: u64,
    /// Generation of the value that was used last.
    pub newest: u64,
    /// By value type.
    pub types: BTreeMap<String, TypeStats>,
}

/// What is in a cache folder of one value type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TypeStats {
    /// Values.
    pub values: u64,
    /// Bytes on the disk.
    pub bytes: u64,
}

/// Why a value is not read back.
enum Miss {
    Gone,
    Unreadable(io::Error),
    Damaged(String),
}

#[derive(Debug, Default)]
struct Counts {
    found: [Padded; 16],
    loaded: AtomicU64,
    stored: AtomicU64,
    damaged: AtomicU64,
    lost: AtomicU64,
}

/// A counter on a cache line of its own, so that threads that count do not wait for each other.
#[derive(Debug, Default)]
#[repr(align(64))]
struct Padded(AtomicU64);

/// An open cache folder, for many threads at once. What was used is written down when it is dropped.
#[derive(Debug)]
pub struct Cache {
    folder: Folder,
    limit: u64,
    /// Logs above this size are left for new ones, so that what is dead in them can be given back.
    segment: u64,
    generation: u64,
    /// Tells other processes that this one is there. Read while a value is stored, so that nothing half stored is taken for left behind.
    presence: RwLock<Option<File>>,
    index: Index,
    known: Mutex<BTreeMap<String, Known>>,
    writer: Mutex<Option<Log>>,
    own_log: AtomicU64,
    other_logs: AtomicU64,
    /// Bytes stored since other processes were last heard.
    unheard: AtomicU64,
    victims: Mutex<VecDeque<Victim>>,
    /// Whether eviction is on its way below the limit.
    is_draining: AtomicBool,
    /// Whether all that is left is of this run.
    is_full: AtomicBool,
    is_stopped: AtomicBool,
    /// Whether room was made on a full disk already.
    rescued: Mutex<bool>,
    troubles: Mutex<(Vec<Trouble>, usize)>,
    counts: Counts,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing panics under these locks.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The user's own cache folder: what `PEGBAR_CACHE` says, else `pegbar` in the place that the system has for caches; `None` where there is none.
pub fn default_dir() -> Option<PathBuf> {
    default_dir_in(|name| std::env::var_os(name))
}

fn default_dir_in(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let folder = |name: &str| variable(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let home = |below: &str| folder("HOME").map(|home| home.join(below));
    folder("PEGBAR_CACHE").or_else(|| {
        let caches = if cfg!(windows) {
            folder("LOCALAPPDATA")
        } else if cfg!(target_os = "macos") {
            home("Library/Caches")
        } else {
            // A relative path here is to be ignored, says the XDG base directory specification.
            folder("XDG_CACHE_HOME").filter(|p| p.is_absolute()).or_else(|| home(".cache"))
        };
        caches.map(|c| c.join("pegbar"))
    })
}

/// Whether there is a cache in `dir`.
pub fn exists(dir: &Path) -> bool {
    dir.join("v1").is_dir()
}

impl Cache {
    /// Opens the cache in the folder `dir`, which is made if need be, and keeps it below `limit` bytes.
    ///
    /// Cost: reads the index, about 0.3 us an entry.
    ///
    /// # Errors
    /// Where the folder cannot be made. One that can be read alone is no error: what it has is used.
    pub fn open(dir: &Path, limit: u64) -> Result<Self, CacheError> {
        let failed = |step| move |source| CacheError { path: dir.to_owned(), step, source };
        if dir.exists() && !dir.is_dir() {
            return Err(failed("opening")(io::Error::new(io::ErrorKind::NotADirectory, "expected a folder, found a file")));
        }
        let folder = Folder(dir.join("v1"));
        for path in [folder.index(), folder.blobs(), folder.temporary()] {
            std::fs::create_dir_all(path).map_err(failed("making the folder"))?;
        }
        folder.logs().map_err(failed("reading the index"))?;
        tag(&folder);
        crate::atomic::sweep_folder(&folder.temporary(), |_| true);
        let mut cache = Self {
            presence: RwLock::new(folder.presence()),
            folder,
            limit,
            segment: (limit / 16).clamp(4 << 10, 256 << 20),
            generation: 0,
            index: Index::default(),
            known: Mutex::default(),
            writer: Mutex::default(),
            own_log: AtomicU64::default(),
            other_logs: AtomicU64::default(),
            unheard: AtomicU64::default(),
            victims: Mutex::default(),
            is_draining: AtomicBool::default(),
            is_full: AtomicBool::default(),
            is_stopped: AtomicBool::default(),
            rescued: Mutex::default(),
            troubles: Mutex::default(),
            counts: Counts::default(),
        };
        cache.refresh();
        cache.generation = cache.index.newest().saturating_add(1);
        Ok(cache)
    }

    /// What is there under a key, by the index alone. Marks it as used in this run.
    ///
    /// Cost: two look-ups in memory.
    pub fn find(&self, key: &Key) -> Option<Entry> {
        let entry = self.index.find(key, self.generation)?;
        self.counts.found[usize::from(key[0]) % 16].0.fetch_add(1, Relaxed);
        Some(entry)
    }

    /// The value of a key, its bits held against its digest. `extra` is a value type that `types` may not have, and goes before those of its name.
    ///
    /// `None` where there is none, where its type is not known, and where it is damaged or gone: it is then forgotten, and damage is told by
    /// [`Cache::trouble`].
    ///
    /// Cost: O(bytes).
    pub fn load(&self, key: &Key, extra: Option<&ValueType>, types: &Types) -> Option<ValueRef> {
        let digest = *self.index.keys.read(key).get(key)?;
        let (ty, place, stored, born) = {
            let contents = self.index.contents.read(&digest);
            let content = contents.get(&digest)?;
            mark(&content.used, self.generation);
            (content.ty.clone(), content.place.clone(), content.stored, content.born)
        };
        let make = &extra.filter(|t| t.schema.name == &*ty).or_else(|| types.get(&ty))?.from_parts;
        let made = self.read(&digest, &ty, &place, stored).and_then(|parts| make(parts).map_err(|e| Miss::Damaged(e.to_string())));
        match made {
            Ok(value) => {
                self.counts.loaded.fetch_add(1, Relaxed);
                Some(value)
            }
            Err(miss) => {
                self.missed(&digest, &ty, born, miss);
                None
            }
        }
    }

    /// Keeps a value under a key. A failure is told once by [`Cache::trouble`], and nothing more is then stored.
    ///
    /// Cost: O(bytes); one or two system calls below [`BLOB`] bytes, a file above.
    pub fn store(&self, key: &Key, digest: &Digest, value: &dyn AnyValue) {
        if self.is_stopped.load(Relaxed) || self.link(key, digest) {
            return;
        }
        let bytes = value.size() as u64;
        if bytes > self.limit {
            let is_told = lock(&self.troubles).0.iter().any(|t| matches!(t, Trouble::TooLarge { .. }));
            if !is_told {
                self.tell(Trouble::TooLarge { folder: self.folder.0.clone(), limit: self.limit, bytes });
            }
            return;
        }
        if self.reserve(bytes + OVERHEAD) {
            let stored = self.attempt("storing a value", || self.put(key, digest, value, bytes));
            self.counts.stored.fetch_add(u64::from(stored), Relaxed);
        }
    }

    /// A further key for the value of a digest. False where the value is not there.
    ///
    /// Cost: one write to a file, unless the key is there already.
    pub fn link(&self, key: &Key, digest: &Digest) -> bool {
        {
            let contents = self.index.contents.read(digest);
            let Some(content) = contents.get(digest) else { return false };
            mark(&content.used, self.generation);
        }
        let known = self.index.keys.write(key).insert(*key, *digest);
        if known != Some(*digest) && !self.is_stopped.load(Relaxed) {
            self.attempt("writing the index", || self.append(&[Record::Link { key: *key, digest: *digest }]));
        }
        true
    }

    /// Keeps a small record, below a megabyte, under a key of its own. The latest of a key is the one that is recalled.
    pub fn note(&self, key: &Key, text: &[u8]) {
        let is_same = self.index.notes.read(key).get(key).is_some_and(|note| {
            mark(&note.used, self.generation);
            *note.text == *text
        });
        if is_same || self.is_stopped.load(Relaxed) {
            return;
        }
        self.index.put_note(self.generation, key, text);
        self.attempt("writing the index", || self.append(&[Record::Note { born: self.generation, key: *key, text }]));
    }

    /// The latest note of a key.
    pub fn recall(&self, key: &Key) -> Option<Vec<u8>> {
        let notes = self.index.notes.read(key);
        let note = notes.get(key)?;
        mark(&note.used, self.generation);
        Some(note.text.to_vec())
    }

    /// What went wrong since it was last asked, to be shown as warnings. Each is told once.
    pub fn trouble(&self) -> Vec<Trouble> {
        // Small values go on into a log that was removed under this process, and nobody would hear of it.
        if !self.folder.index().is_dir() {
            self.stop("storing a value", &io::Error::new(io::ErrorKind::NotFound, "the folder is gone"));
        }
        let (mut told, more) = std::mem::take(&mut *lock(&self.troubles));
        if more > 0 {
            told.push(Trouble::More { count: more });
        }
        told
    }

    /// What it was good for so far.
    pub fn usage(&self) -> Usage {
        let counts = &self.counts;
        Usage {
            found: counts.found.iter().map(|c| c.0.load(Relaxed)).sum(),
            loaded: counts.loaded.load(Relaxed),
            stored: counts.stored.load(Relaxed),
            damaged: counts.damaged.load(Relaxed),
            lost: counts.lost.load(Relaxed),
            bytes: self.bytes(),
            limit: self.limit,
        }
    }

    /// What is in the folder.
    pub fn stats(&self) -> Stats {
        self.refresh();
        self.index.prune();
        let index = &self.index;
        let mut stats = Stats { keys: index.keys.len(), notes: index.notes.len(), bytes: self.bytes(), ..Stats::default() };
        index.contents.each(|_, content| {
            let used = content.used.load(Relaxed);
            stats.oldest = if stats.values == 0 { used } else { stats.oldest.min(used) };
            stats.newest = stats.newest.max(used);
            stats.values += 1;
            let of_type = stats.types.entry(content.ty.to_string()).or_default();
            of_type.values += 1;
            of_type.bytes += content.stored;
        });
        stats
    }

    /// Reads every value, and forgets those that are not what was stored. Says how many were sound; the others are told, one by one and each of them,
    /// to `damaged`.
    ///
    /// Cost: O(bytes of the cache).
    pub fn verify(&self, mut damaged: impl FnMut(&Trouble)) -> u64 {
        let mut all = Vec::new();
        self.index.contents.each(|digest, c| all.push((*digest, c.ty.clone(), c.place.clone(), c.stored, c.born)));
        all.sort_unstable_by_key(|v| v.0);
        let mut sound = 0;
        for (digest, ty, place, stored, born) in all {
            let found = match self.read(&digest, &ty, &place, stored) {
                Ok(_) => {
                    sound += 1;
                    continue;
                }
                Err(Miss::Gone) => "nothing".to_owned(),
                Err(Miss::Unreadable(error)) => error.to_string(),
                Err(Miss::Damaged(found)) => found,
            };
            self.forget(&digest, born);
            damaged(&self.damage(&digest, &ty, found));
        }
        sound
    }

    /// Bytes on the disk, as far as is known.
    fn bytes(&self) -> u64 {
        self.index.blob_bytes.load(Relaxed) + self.own_log.load(Relaxed) + self.other_logs.load(Relaxed)
    }

    /// The parts of a value, whose digest is what it has to be.
    fn read(&self, digest: &Digest, ty: &str, place: &Place, stored: u64) -> Result<OwnedParts, Miss> {
        let io = |error: io::Error| match error.kind() {
            // A file may stand where the folder was.
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Miss::Gone,
            _ => Miss::Unreadable(error),
        };
        let parts = match place {
            Place::Inline(data, at) => parts(Cursor::new(data.read(*at, stored).map_err(io)?), stored),
            Place::Blob => {
                let file = File::open(self.folder.blob(digest)).map_err(io)?;
                let length = file.metadata().map_err(io)?.len();
                parts(BufReader::with_capacity(1 << 16, file), length)
            }
        };
        let parts = parts.map_err(|e| match e {
            NpzError::Io(error) => Miss::Unreadable(error),
            other => Miss::Damaged(other.to_string()),
        })?;
        let arrays = parts.arrays.iter().map(|(name, array)| (name.as_ref(), array.view()));
        if digest_parts(ty, arrays, parts.meta.clone()).as_bytes() == digest {
            Ok(parts)
        } else {
            Err(Miss::Damaged("other bits".to_owned()))
        }
    }

    fn missed(&self, digest: &Digest, ty: &str, born: u64, miss: Miss) {
        match miss {
            // Another process may have removed it, as it may at any time.
            Miss::Gone => {
                self.counts.lost.fetch_add(1, Relaxed);
                self.forget(digest, born);
            }
            // Too many open files, say: that is no fault of the value.
            Miss::Unreadable(error) => self.tell(Trouble::Unread { file: self.folder.blob(digest), reason: error.to_string() }),
            Miss::Damaged(found) => {
                self.counts.damaged.fetch_add(1, Relaxed);
                self.forget(digest, born);
                self.tell(self.damage(digest, ty, found));
            }
        }
    }

    fn damage(&self, digest: &Digest, ty: &str, found: String) -> Trouble {
        let digest = blake3::Hash::from_bytes(*digest).to_hex().to_string();
        Trouble::Damaged { folder: self.folder.0.clone(), ty: ty.to_owned(), digest, found }
    }

    /// Forgets a value as far as it was stored up to the generation `born`, and removes its bytes.
    fn forget(&self, digest: &Digest, born: u64) {
        // Somebody else may have found the damage at the same time, and stored it anew since.
        if self.index.remove(digest, born) {
            let _ = std::fs::remove_file(self.folder.blob(digest));
            if !self.is_stopped.load(Relaxed) {
                // A record that is not written costs that it is found missing once more.
                let _ = self.append(&[Record::Removed { upto: born, digest: *digest }]);
            }
        }
    }

    /// Writes a value, and then the record that tells of it.
    fn put(&self, key: &Key, digest: &Digest, value: &dyn AnyValue, bytes: u64) -> io::Result<()> {
        let _present = self.presence.read().unwrap_or_else(PoisonError::into_inner);
        let born = self.index.next_born(digest, self.generation);
        let held = Held { born, key: *key, digest: *digest, bytes, stored: 0, at: None, ty: value.type_name() };
        if bytes >= BLOB {
            let held = Held { stored: self.write_blob(digest, value)?, ..held };
            self.with_log(|log| log.append(&whole(&held)))?;
            self.index.put(&held, Place::Blob);
        } else {
            let mut out = Cursor::new(Vec::with_capacity((bytes + OVERHEAD) as usize));
            npz::write(value, false, &mut out).map_err(not_written)?;
            let out = out.into_inner();
            self.with_log(|log| {
                let at = log.append_data(&out)?;
                let held = Held { stored: out.len() as u64, at: Some(at), ..held };
                log.append(&whole(&held))?;
                self.index.put(&held, Place::Inline(log.source.clone(), at));
                Ok(())
            })?;
        }
        self.index.keys.write(key).insert(*key, *digest);
        Ok(())
    }

    /// Writes a value into a file of its own, and says how long it is.
    fn write_blob(&self, digest: &Digest, value: &dyn AnyValue) -> io::Result<u64> {
        let temporary = crate::atomic::temporary_in(&self.folder.temporary(), Path::new("value"))?;
        let mut out = BufWriter::with_capacity(1 << 16, temporary.as_file());
        npz::write(value, false, &mut out).map_err(not_written)?;
        out.flush()?;
        let stored = out.stream_position()?;
        drop(out);
        let path = self.folder.blob(digest);
        let Err(error) = temporary.persist(&path) else { return Ok(stored) };
        if let Some(folder) = path.parent() {
            // Not those above: a cache that is gone is not to come back by half.
            let _ = std::fs::create_dir(folder);
        }
        match error.file.persist(&path) {
            // Some systems do not rename onto a file that somebody reads.
            Err(error) if !path.exists() => Err(error.error),
            _ => Ok(stored),
        }
    }

    /// Does something that writes; on a full disk again after room was made, which is done once. Any other failure ends storing.
    fn attempt(&self, step: &'static str, act: impl Fn() -> io::Result<()>) -> bool {
        let mut done = act();
        if done.as_ref().is_err_and(is_full_disk) {
            let mut rescued = lock(&self.rescued);
            if !std::mem::replace(&mut *rescued, true) {
                self.rescue();
            }
            drop(rescued);
            done = act();
        }
        match done {
            Ok(()) => true,
            // The value has no form as a file.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => false,
            // Another process took it for left behind.
            Err(error) if error.kind() == io::ErrorKind::NotFound && self.folder.is_whole() => false,
            Err(error) => {
                self.stop(step, &error);
                false
            }
        }
    }

    fn stop(&self, step: &'static str, error: &io::Error) {
        if !self.is_stopped.swap(true, Relaxed) {
            self.tell(Trouble::Stopped { folder: self.folder.0.clone(), step, reason: error.to_string() });
        }
    }

    fn tell(&self, trouble: Trouble) {
        let mut troubles = lock(&self.troubles);
        if troubles.0.len() < MAX_TROUBLES { troubles.0.push(trouble) } else { troubles.1 += 1 }
    }
}

impl Drop for Cache {
    fn drop(&mut self) {
        self.close();
    }
}

/// The parts of the value in an archive, which are in the order in which they were written.
fn parts(reader: impl Read + Seek, limit: u64) -> Result<OwnedParts, NpzError> {
    Archive::open(reader, limit)?.parts()
}

fn whole(held: &Held) -> Vec<u8> {
    let mut bytes = Vec::new();
    Record::Value(*held).write(&mut bytes);
    bytes
}

fn not_written(error: NpzError) -> io::Error {
    match error {
        NpzError::Io(error) if error.kind() != io::ErrorKind::Other => error,
        other => io::Error::new(io::ErrorKind::InvalidInput, other.to_string()),
    }
}

fn is_full_disk(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

/// Marks the folder as one that backups need not hold. Where that fails nothing is lost.
fn tag(folder: &Folder) {
    let path = folder.0.join("CACHEDIR.TAG");
    if !path.exists() {
        let text = "Signature: 8a477f597d28d172789f06886806bc55\n# Results of Pegbar, which computes them again if they are removed.\n";
        let _ = std::fs::write(path, text);
    }
}

/// Removes all that is in the cache folder `dir`, and says how many bytes that were. Runs that use it go on without.
///
/// # Errors
/// Where the folder cannot be opened or removed.
pub fn clear(dir: &Path) -> Result<Freed, CacheError> {
    if !exists(dir) {
        return Ok(Freed::default());
    }
    let stats = Cache::open(dir, u64::MAX)?.stats();
    // Only what is of this version: the folder may be one that somebody keeps other things in.
    std::fs::remove_dir_all(dir.join("v1")).map_err(|source| CacheError { path: dir.to_owned(), step: "removing the cache", source })?;
    Ok(Freed { values: stats.values, bytes: stats.bytes, left: 0 })
}
