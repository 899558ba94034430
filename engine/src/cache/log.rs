//! The files of the index: one log for each process that writes, and beside it the data of values too small for files of their own.
//!
//! A log `x.log` belongs to whoever holds the lock of `x.lock`; a process takes over the log of one that is gone. Every record is one write, so that a
//! process that is killed loses at most the record that it was at. Whoever holds the lock of the file `lock` may take over and remove logs.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

use super::record::{Record, scan};
use super::{Cache, Digest, Trouble, lock};

/// Paths inside a cache folder.
#[derive(Clone, Debug)]
pub(super) struct Folder(pub(super) PathBuf);

impl Folder {
    pub(super) fn index(&self) -> PathBuf {
        self.0.join("index")
    }

    pub(super) fn blobs(&self) -> PathBuf {
        self.0.join("blobs")
    }

    pub(super) fn temporary(&self) -> PathBuf {
        self.0.join("tmp")
    }

    pub(super) fn blob(&self, digest: &Digest) -> PathBuf {
        let hex = blake3::Hash::from_bytes(*digest).to_hex();
        self.blobs().join(&hex[..2]).join(format!("{hex}.npz"))
    }

    pub(super) fn log(&self, name: &str, kind: &str) -> PathBuf {
        self.index().join(format!("{name}.{kind}"))
    }

    /// Names of all logs, in order.
    pub(super) fn logs(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(self.index())? {
            if let Some(name) = entry?.file_name().to_string_lossy().strip_suffix(".log") {
                names.push(name.to_owned());
            }
        }
        names.sort_unstable();
        Ok(names)
    }

    /// False where the folder was removed under this process, or part of it.
    pub(super) fn is_whole(&self) -> bool {
        [self.index(), self.blobs(), self.temporary()].iter().all(|f| f.is_dir())
    }

    /// The sign that this process uses the folder, for as long as the file is open; `None` where it cannot be given.
    pub(super) fn presence(&self) -> Option<File> {
        let file = OpenOptions::new().create(true).append(true).open(self.0.join("users")).ok()?;
        file.try_lock_shared().ok().map(|()| file)
    }

    /// The right to take over and remove logs, until the file is dropped; `None` where another process has it.
    pub(super) fn maintenance(&self) -> io::Result<Option<File>> {
        locked(&self.0.join("lock"))
    }
}

/// The file at `path`, made if need be, under a lock; `None` where another has the lock.
fn locked(path: &Path) -> io::Result<Option<File>> {
    let file = OpenOptions::new().create(true).append(true).open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(std::fs::TryLockError::WouldBlock) => Ok(None),
        Err(std::fs::TryLockError::Error(error)) => Err(error),
    }
}

/// What lies beside a log, to be read. It stays readable after another process removed it.
#[derive(Debug)]
pub(super) struct Data {
    path: PathBuf,
    file: Mutex<Option<File>>,
}

impl Data {
    fn open(path: PathBuf) -> Arc<Self> {
        let file = Mutex::new(File::open(&path).ok());
        Arc::new(Self { path, file })
    }

    #[cfg(test)]
    pub(super) fn none() -> Self {
        Self { path: PathBuf::new(), file: Mutex::default() }
    }

    /// Some of the bytes; fewer where the file ends.
    pub(super) fn read(&self, at: u64, length: u64) -> io::Result<Vec<u8>> {
        let mut file = lock(&self.file);
        let file = match &mut *file {
            Some(file) => file,
            // It was not there yet when the log was first read.
            none => none.insert(File::open(&self.path)?),
        };
        file.seek(SeekFrom::Start(at))?;
        let mut bytes = Vec::new();
        file.take(length).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

/// A log as far as it was read.
#[derive(Debug)]
pub(super) struct Known {
    data: Arc<Data>,
    read_to: u64,
    /// Bytes of the log and its data.
    bytes: u64,
    /// Whether it is the one that this process writes, and so has no need to read.
    is_own: bool,
}

/// The log that this process writes.
#[derive(Debug)]
pub(super) struct Log {
    name: String,
    _lock: File,
    log: File,
    data: File,
    log_bytes: u64,
    data_bytes: u64,
    pub(super) source: Arc<Data>,
}

impl Log {
    fn open(folder: &Folder, name: String, lock: File, source: Option<Arc<Data>>) -> io::Result<Self> {
        let append = |kind| OpenOptions::new().create(true).append(true).open(folder.log(&name, kind));
        let (log, data) = (append("log")?, append("data")?);
        let (log_bytes, data_bytes) = (log.metadata()?.len(), data.metadata()?.len());
        let source = source.unwrap_or_else(|| Data::open(folder.log(&name, "data")));
        Ok(Self { name, _lock: lock, log, data, log_bytes, data_bytes, source })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.log_bytes + self.data_bytes
    }

    /// Appends whole records.
    pub(super) fn append(&mut self, records: &[u8]) -> io::Result<()> {
        put(&mut self.log, &mut self.log_bytes, records).map(drop)
    }

    /// Appends the bytes of a value, and says where they begin.
    pub(super) fn append_data(&mut self, bytes: &[u8]) -> io::Result<u64> {
        put(&mut self.data, &mut self.data_bytes, bytes)
    }

    pub(super) fn sync(&self) -> io::Result<()> {
        self.data.sync_data()?;
        self.log.sync_data()
    }
}

fn put(file: &mut File, length: &mut u64, bytes: &[u8]) -> io::Result<u64> {
    let at = *length;
    if let Err(error) = file.write_all(bytes) {
        // A part of it is of no use to anybody, and what comes next must lie where the record says.
        file.set_len(at)?;
        return Err(error);
    }
    *length += bytes.len() as u64;
    Ok(at)
}

impl Cache {
    /// Reads what other processes wrote since it was last read.
    pub(super) fn refresh(&self) {
        let mut uses = Vec::new();
        // A log that is compacted between being listed and being read has its records in another by then.
        for _ in 0..4 {
            let Ok(names) = self.folder.logs() else { break };
            lock(&self.known).retain(|name, known| known.is_own || names.contains(name));
            let mut is_gone = false;
            for name in names {
                match self.read_log(&name, &mut uses) {
                    Err(error) if error.kind() == io::ErrorKind::NotFound => is_gone = true,
                    Err(error) => self.tell(Trouble::Unread { file: self.folder.log(&name, "log"), reason: error.to_string() }),
                    Ok(_) => {}
                }
            }
            if !is_gone {
                break;
            }
        }
        // A value may be in one log and its uses in another that was read before.
        self.index.put_uses(&uses);
        let others = lock(&self.known).values().filter(|k| !k.is_own).map(|k| k.bytes).sum();
        self.other_logs.store(others, Relaxed);
    }

    /// Reads what is new in a log, and says where its last whole record ends.
    fn read_log(&self, name: &str, uses: &mut Vec<([u8; 32], u64)>) -> io::Result<u64> {
        let mut all = lock(&self.known);
        let path = self.folder.log(name, "log");
        let from = all.get(name).map_or(0, |k| k.read_to);
        if all.get(name).is_some_and(|k| k.is_own) {
            return Ok(from);
        }
        let bytes = tail(&path, from)?;
        let fresh = || Known { data: Data::open(self.folder.log(name, "data")), read_to: 0, bytes: 0, is_own: false };
        let known = all.entry(name.to_owned()).or_insert_with(fresh);
        let data = known.data.clone();
        let scanned = scan(&bytes, |record, _| match record {
            Record::Used(more) => uses.extend(more),
            record => self.index.apply(&record, &data),
        });
        let beside = std::fs::metadata(&data.path).map_or(0, |m| m.len());
        known.bytes = known.read_to + bytes.len() as u64 + beside;
        known.read_to += scanned.end as u64;
        if scanned.damaged > 0 {
            self.tell(Trouble::Index { file: path, bytes: scanned.damaged });
        }
        Ok(known.read_to)
    }

    /// Does something with the log that this process writes.
    pub(super) fn with_log<T>(&self, act: impl FnOnce(&mut Log) -> io::Result<T>) -> io::Result<T> {
        let mut writer = lock(&self.writer);
        let log = match &mut *writer {
            Some(log) => log,
            none => none.insert(self.acquire()?),
        };
        let done = act(log);
        self.own_log.store(log.bytes(), Relaxed);
        if log.bytes() > self.segment {
            self.release(&mut writer);
        }
        done
    }

    /// Appends records.
    pub(super) fn append(&self, records: &[Record]) -> io::Result<()> {
        let mut bytes = Vec::new();
        for record in records {
            record.write(&mut bytes);
        }
        self.with_log(|log| log.append(&bytes))
    }

    /// Leaves the log that this process writes to whoever takes it over.
    pub(super) fn release(&self, writer: &mut Option<Log>) {
        if let Some(log) = writer.take() {
            if let Some(known) = lock(&self.known).get_mut(&log.name) {
                *known = Known { data: log.source.clone(), read_to: log.log_bytes, bytes: log.bytes(), is_own: false };
            }
            self.other_logs.fetch_add(log.bytes(), Relaxed);
            self.own_log.store(0, Relaxed);
        }
    }

    /// A log of a process that is gone, or a new one.
    fn acquire(&self) -> io::Result<Log> {
        if let Some(_maintenance) = self.folder.maintenance()? {
            self.refresh();
            for name in self.folder.logs()? {
                let bytes = lock(&self.known).get(&name).map_or(0, |k| k.bytes);
                if bytes <= self.segment / 2
                    && let Some(log) = self.take_over(&name)?
                {
                    return Ok(log);
                }
            }
        }
        self.new_log()
    }

    fn take_over(&self, name: &str) -> io::Result<Option<Log>> {
        let Some(lock_file) = locked(&self.folder.log(name, "lock"))? else { return Ok(None) };
        let mut uses = Vec::new();
        let Ok(end) = self.read_log(name, &mut uses) else { return Ok(None) };
        self.index.put_uses(&uses);
        let source = lock(&self.known).get(name).map(|k| k.data.clone());
        let mut log = Log::open(&self.folder, name.to_owned(), lock_file, source)?;
        // What was torn off when its writer was killed.
        if log.log_bytes > end {
            log.log.set_len(end)?;
            log.log_bytes = end;
        }
        self.own(&log);
        Ok(Some(log))
    }

    /// A log of its own name. Its lock is there before it, so that nobody takes it for left behind.
    pub(super) fn new_log(&self) -> io::Result<Log> {
        let file =
            tempfile::Builder::new().prefix("").rand_bytes(12).suffix(".lock").disable_cleanup(true).tempfile_in(self.folder.index())?;
        let (file, path) = file.into_parts();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        file.try_lock().map_err(io::Error::from)?;
        let log = Log::open(&self.folder, name, file, None)?;
        self.own(&log);
        Ok(log)
    }

    fn own(&self, log: &Log) {
        let mut known = lock(&self.known);
        known.insert(log.name.clone(), Known { data: log.source.clone(), read_to: 0, bytes: 0, is_own: true });
        self.other_logs.store(known.values().filter(|k| !k.is_own).map(|k| k.bytes).sum(), Relaxed);
        self.own_log.store(log.bytes(), Relaxed);
    }

    /// The logs whose writers are gone, each with its lock, and whether those are all. To be called under the lock of maintenance.
    pub(super) fn dead_logs(&self) -> io::Result<(Vec<(String, File)>, bool)> {
        let names = self.folder.logs()?;
        let all = names.len();
        let mut dead = Vec::new();
        for name in names {
            if let Some(lock) = locked(&self.folder.log(&name, "lock"))? {
                dead.push((name, lock));
            }
        }
        let is_all = dead.len() == all;
        Ok((dead, is_all))
    }

    /// The bytes of a log, what lies beside it, and the bytes of both.
    pub(super) fn whole_log(&self, name: &str) -> io::Result<(Vec<u8>, Option<Arc<Data>>, u64)> {
        let data = lock(&self.known).get(name).map(|k| k.data.clone());
        let bytes = std::fs::read(self.folder.log(name, "log"))?;
        let beside = std::fs::metadata(self.folder.log(name, "data")).map_or(0, |m| m.len());
        let total = bytes.len() as u64 + beside;
        Ok((bytes, data, total))
    }

    /// Removes a log whose lock is held.
    pub(super) fn remove_log(&self, name: &str) {
        // The lock goes last: without it the log is anybody's.
        for kind in ["log", "data", "lock"] {
            let _ = std::fs::remove_file(self.folder.log(name, kind));
        }
        lock(&self.known).remove(name);
    }
}

/// The bytes of a file from a place on.
fn tail(path: &Path, from: u64) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(from))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}
