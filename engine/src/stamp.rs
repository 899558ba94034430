//! Contents of input files: each file's digest, and a memory of stamps, so that a second run does not read a thousand images again.
//!
//! A stamp is what the file system says of a file: length, times of its last changes to the nanosecond, inode and device. Nothing is concluded from
//! a newer or an older one: a digest is taken from memory only where the stamp is equal, and it is put there only where the file was last changed
//! more than two seconds before it was read. A later change could else happen within one tick of the file system's clock and leave the same stamp
//! (what git calls racy). Where there are no such times, as outside Unix, every file is read.

use std::collections::BTreeMap;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use blake3::Hasher;

use crate::cache::Cache;
use crate::node::{Fault, NodeError};

/// Changes with what a memory of stamps is made of.
const SALT: &[u8] = b"pegbar stamp 1";

/// A clock's coarsest tick, that of FAT.
const TICK: Duration = Duration::from_secs(2);

/// How often a file that changes while it is read is read again.
const TRIES: usize = 3;

/// A memory from run to run. It may forget anything at any time, and must never give back what was not noted under that key.
pub trait Memo: Sync {
    /// What was noted under `key`.
    fn recall(&self, key: &[u8; 32]) -> Option<Vec<u8>>;
    /// Notes `text` under `key`, in place of what stood there.
    fn note(&self, key: &[u8; 32], text: &[u8]);
}

impl Memo for Cache {
    fn recall(&self, key: &[u8; 32]) -> Option<Vec<u8>> {
        Cache::recall(self, key)
    }
    fn note(&self, key: &[u8; 32], text: &[u8]) {
        Cache::note(self, key, text);
    }
}

/// Digests of the contents of files, each found once a run.
pub struct Files<'a> {
    memo: Option<&'a dyn Memo>,
    now: fn() -> SystemTime,
    seen: Mutex<BTreeMap<PathBuf, Seen>>,
}

/// A file as it was when its digest was found.
#[derive(Clone, Copy)]
struct Seen {
    stamp: Stamp,
    digest: [u8; 32],
    /// True where no later change can leave the same stamp.
    is_settled: bool,
}

/// What a file system says of a file; times in nanoseconds since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    length: u64,
    modified: i128,
    changed: i128,
    inode: u64,
    device: u64,
}

impl Stamp {
    #[cfg(unix)]
    fn of(meta: &Metadata) -> Self {
        use std::os::unix::fs::MetadataExt;
        let nanos = |seconds: i64, nanos: i64| i128::from(seconds) * 1_000_000_000 + i128::from(nanos);
        Self {
            length: meta.len(),
            modified: nanos(meta.mtime(), meta.mtime_nsec()),
            changed: nanos(meta.ctime(), meta.ctime_nsec()),
            inode: meta.ino(),
            device: meta.dev(),
        }
    }

    /// Without the time of the last change, which no program can set, a stamp never settles.
    #[cfg(not(unix))]
    fn of(meta: &Metadata) -> Self {
        let modified = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok()).map_or(0, |d| d.as_nanos() as i128);
        Self { length: meta.len(), modified, changed: i128::MAX, inode: 0, device: 0 }
    }

    /// True where the file was last changed well before `now`.
    fn is_settled(&self, now: SystemTime) -> bool {
        let limit = now.duration_since(UNIX_EPOCH).unwrap_or_default().saturating_sub(TICK).as_nanos();
        self.modified.max(self.changed) < i128::try_from(limit).unwrap_or(0)
    }

    /// Where the digest of a file with this stamp is noted.
    fn key(&self, path: &Path) -> [u8; 32] {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let mut hasher = Hasher::new();
        hasher.update(SALT);
        for number in [i128::from(self.length), self.modified, self.changed, i128::from(self.inode), i128::from(self.device)] {
            hasher.update(&number.to_le_bytes());
        }
        hasher.update(path.as_os_str().as_encoded_bytes());
        *hasher.finalize().as_bytes()
    }
}

impl<'a> Files<'a> {
    /// Files of which nothing is known but what `memo` remembers.
    pub fn new(memo: Option<&'a dyn Memo>) -> Self {
        Self { memo, now: SystemTime::now, seen: Mutex::default() }
    }

    /// The digest of a file's content: found once, and then the same whatever happens to the file.
    ///
    /// Cost: a stat where the stamp is remembered, else one reading of the file.
    ///
    /// # Errors
    /// Where the file cannot be read, or does not stop changing.
    pub fn digest(&self, path: &Path) -> Result<[u8; 32], NodeError> {
        if let Some(seen) = self.lock().get(path) {
            return Ok(seen.digest);
        }
        let seen = self.look(path)?;
        // Of two threads that read the same file the first has the word.
        Ok(self.lock().entry(path.to_owned()).or_insert(seen).digest)
    }

    /// The digest of a file's content as it is now.
    ///
    /// # Errors
    /// As of [`Files::digest`].
    pub fn content(&self, path: &Path) -> Result<[u8; 32], NodeError> {
        Ok(self.look(path)?.digest)
    }

    /// Finds the digests of many files on up to `threads` threads.
    ///
    /// # Errors
    /// That of the first of `paths` that cannot be read.
    pub fn prefetch(&self, paths: &[PathBuf], threads: usize) -> Result<(), NodeError> {
        let next = AtomicUsize::new(0);
        let errors = Mutex::new(BTreeMap::new());
        let work = || {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                match paths.get(i).map(|path| self.digest(path)) {
                    None => break,
                    Some(Ok(_)) => {}
                    Some(Err(error)) => drop(errors.lock().unwrap_or_else(PoisonError::into_inner).insert(i, error)),
                }
            }
        };
        std::thread::scope(|scope| {
            (1..threads.min(paths.len())).for_each(|_| drop(scope.spawn(work)));
            work();
        });
        errors.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().next().map_or(Ok(()), Err)
    }

    /// To be asked before a node reads a file, for [`Files::unchanged`]; `None` where it is not there.
    pub fn stamp(&self, path: &Path) -> Option<Stamp> {
        std::fs::metadata(path).ok().map(|m| Stamp::of(&m))
    }

    /// To be asked after a node has read a file, with its stamp from before: was it the one whose digest went into the keys?
    ///
    /// That its content is right now is not enough: it may have been another and been put back while the node read it.
    ///
    /// # Errors
    /// Where its content is another than when its digest was found, it was written while the node ran, or nobody has asked for its digest.
    pub fn unchanged(&self, path: &Path, started: Option<Stamp>) -> Result<(), NodeError> {
        let Some(before) = self.lock().get(path).copied() else {
            return Err(changed(path, "one that was not there when the keys were made"));
        };
        let stamp = std::fs::metadata(path).map(|m| Stamp::of(&m)).map_err(|e| changed(path, &format!("it gone: {e}")))?;
        if before.is_settled && stamp == before.stamp {
            return Ok(());
        }
        // Touched, or so new that its stamp says little: its content has the word.
        let now = self.look(path)?;
        if now.digest != before.digest || Some(now.stamp) != started {
            return Err(changed(path, "it changed"));
        }
        self.lock().insert(path.to_owned(), now);
        Ok(())
    }

    /// Every file whose digest was asked for, in the order of the paths.
    pub fn table(&self) -> Vec<(PathBuf, [u8; 32])> {
        self.lock().iter().map(|(path, seen)| (path.clone(), seen.digest)).collect()
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<PathBuf, Seen>> {
        // Nothing panics under the lock, so what it guards is whole.
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The file as it is now, from memory or by reading it.
    fn look(&self, path: &Path) -> Result<Seen, NodeError> {
        let io = |error: std::io::Error| NodeError::io(path, error);
        for _ in 0..TRIES {
            let stamp = Stamp::of(&std::fs::metadata(path).map_err(io)?);
            // By the time before it is read: whatever changes from here on has a later one.
            let is_settled = stamp.is_settled((self.now)());
            if let Some(digest) = self.recall(path, &stamp).filter(|_| is_settled) {
                return Ok(Seen { stamp, digest, is_settled });
            }
            let mut hasher = Hasher::new();
            hasher.update_reader(std::fs::File::open(path).map_err(io)?).map_err(io)?;
            let digest = *hasher.finalize().as_bytes();
            if Stamp::of(&std::fs::metadata(path).map_err(io)?) == stamp {
                if let Some(memo) = self.memo.filter(|_| is_settled) {
                    memo.note(&stamp.key(path), &digest);
                }
                return Ok(Seen { stamp, digest, is_settled });
            }
        }
        Err(changed(path, "it changed while it was read"))
    }

    fn recall(&self, path: &Path, stamp: &Stamp) -> Option<[u8; 32]> {
        self.memo?.recall(&stamp.key(path))?.try_into().ok()
    }
}

fn changed(path: &Path, found: &str) -> NodeError {
    let message = format!("expected {} to stay as it was while the graph runs, found {found}", path.display());
    NodeError::new(Fault::Io, message).help("run again once nothing writes to it")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Notes {
        kept: Mutex<BTreeMap<[u8; 32], Vec<u8>>>,
        recalled: AtomicUsize,
    }

    impl Memo for Notes {
        fn recall(&self, key: &[u8; 32]) -> Option<Vec<u8>> {
            let found = self.kept.lock().unwrap().get(key).cloned();
            self.recalled.fetch_add(usize::from(found.is_some()), Ordering::Relaxed);
            found
        }
        fn note(&self, key: &[u8; 32], text: &[u8]) {
            self.kept.lock().unwrap().insert(*key, text.to_vec());
        }
    }

    fn later() -> SystemTime {
        SystemTime::now() + Duration::from_secs(60)
    }

    /// Files a minute from now, when all that a test writes has settled.
    fn files(memo: &Notes) -> Files<'_> {
        Files { now: later, ..Files::new(Some(memo)) }
    }

    /// A node reads the file.
    fn check(files: &Files, path: &Path) -> Result<(), NodeError> {
        files.unchanged(path, files.stamp(path))
    }

    fn put(folder: &tempfile::TempDir, name: &str, text: &str) -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn a_digest_is_that_of_the_content() {
        let folder = tempfile::tempdir().unwrap();
        let big = "x".repeat(3 << 20);
        for text in ["", "a", &big] {
            let path = put(&folder, "f", text);
            assert_eq!(Files::new(None).digest(&path).unwrap(), *blake3::hash(text.as_bytes()).as_bytes());
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_has_settled_is_read_once_in_all_runs() {
        let (folder, notes) = (tempfile::tempdir().unwrap(), Notes::default());
        let path = put(&folder, "f", "one");
        let first = files(&notes).digest(&path).unwrap();
        assert_eq!((notes.recalled.load(Ordering::Relaxed), notes.kept.lock().unwrap().len()), (0, 1));
        assert_eq!(files(&notes).digest(&path).unwrap(), first);
        assert_eq!(notes.recalled.load(Ordering::Relaxed), 1);
        // What the memory holds is believed, which shows that the file was not read.
        notes.kept.lock().unwrap().values_mut().for_each(|v| *v = vec![7; 32]);
        assert_eq!(files(&notes).digest(&path).unwrap(), [7; 32]);
        notes.kept.lock().unwrap().values_mut().for_each(|v| *v = vec![7; 31]);
        assert_eq!(files(&notes).digest(&path).unwrap(), first, "what cannot be a digest is none");
    }

    #[test]
    fn a_file_that_is_new_or_of_the_future_is_not_remembered() {
        let (folder, notes) = (tempfile::tempdir().unwrap(), Notes::default());
        let path = put(&folder, "f", "one");
        Files::new(Some(&notes)).digest(&path).unwrap();
        assert!(notes.kept.lock().unwrap().is_empty());
        let file = std::fs::File::options().append(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() + Duration::from_secs(3600)).unwrap();
        files(&notes).digest(&path).unwrap();
        assert!(notes.kept.lock().unwrap().is_empty());
        // Nor does a time that was set back make a file old: the file system has noted that it was set.
        file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
        Files::new(Some(&notes)).digest(&path).unwrap();
        assert!(notes.kept.lock().unwrap().is_empty());
    }

    #[test]
    fn another_stamp_is_another_file() {
        let (folder, notes) = (tempfile::tempdir().unwrap(), Notes::default());
        let path = put(&folder, "f", "one");
        let first = files(&notes).digest(&path).unwrap();
        put(&folder, "f", "two!");
        assert_ne!(files(&notes).digest(&path).unwrap(), first, "another length");
        std::fs::rename(put(&folder, "g", "six!"), &path).unwrap();
        assert_eq!(files(&notes).digest(&path).unwrap(), *blake3::hash(b"six!").as_bytes(), "another inode");
    }

    #[test]
    fn a_file_that_changes_while_the_graph_runs_is_told() {
        let (folder, notes) = (tempfile::tempdir().unwrap(), Notes::default());
        let path = put(&folder, "f", "one");
        let other = put(&folder, "other", "x");
        for files in [files(&notes), Files::new(None)] {
            put(&folder, "f", "one");
            files.digest(&path).unwrap();
            check(&files, &path).unwrap();
            put(&folder, "f", "one");
            check(&files, &path).unwrap_or_else(|e| panic!("written again with the same content: {e}"));
            put(&folder, "f", "two");
            let error = check(&files, &path).unwrap_err();
            let expected = format!("expected {} to stay as it was while the graph runs, found it changed", path.display());
            assert_eq!((error.message, error.fault), (expected, Fault::Io));
            assert_eq!(error.help.as_deref(), Some("run again once nothing writes to it"));
            assert_eq!(files.digest(&path).unwrap(), *blake3::hash(b"one").as_bytes(), "the keys stay");
            std::fs::remove_file(&path).unwrap();
            assert!(check(&files, &path).unwrap_err().message.contains("found it gone"));
            assert!(check(&files, &other).unwrap_err().message.contains("not there when the keys were made"));
        }
    }

    #[test]
    fn a_file_that_is_another_while_a_node_reads_it_and_is_put_back_is_told() {
        let (folder, notes) = (tempfile::tempdir().unwrap(), Notes::default());
        let path = put(&folder, "f", "one");
        let set = |text: &str, hours: u64| {
            put(&folder, "f", text);
            let file = std::fs::File::options().append(true).open(&path).unwrap();
            file.set_modified(UNIX_EPOCH + Duration::from_secs(hours * 3600)).unwrap();
        };
        for files in [files(&notes), Files::new(None)] {
            set("one", 1);
            files.digest(&path).unwrap();
            // Put back before the node starts, it is what it was.
            set("two", 2);
            set("one", 3);
            let started = files.stamp(&path);
            files.unchanged(&path, started).unwrap();
            set("two", 4);
            set("one", 5);
            assert!(files.unchanged(&path, started).unwrap_err().message.contains("found it changed"));
            let two = {
                set("two", 6);
                files.stamp(&path)
            };
            set("one", 7);
            assert!(files.unchanged(&path, two).is_err());
            assert!(files.unchanged(&path, None).is_err(), "it was not there when the node started");
        }
    }

    #[test]
    fn many_files_are_read_by_many_threads_with_one_outcome() {
        let folder = tempfile::tempdir().unwrap();
        let mut paths: Vec<PathBuf> = (0..50).map(|i| put(&folder, &format!("f{i:02}"), &format!("{}", i % 7))).collect();
        let tables: Vec<_> = [1, 3, 80]
            .into_iter()
            .map(|threads| {
                let files = Files::new(None);
                files.prefetch(&paths, threads).unwrap();
                files.table()
            })
            .collect();
        assert!(tables[0].len() == 50 && tables.iter().all(|t| *t == tables[0]));
        paths.insert(9, folder.path().join("none"));
        paths.push(folder.path().join("never"));
        for threads in [1, 3] {
            let error = Files::new(None).prefetch(&paths, threads).unwrap_err();
            assert!(error.message.contains("/none: "), "{error}");
        }
    }
}
