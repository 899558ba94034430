//! Keeping the cache below its limit: what goes first, and how what is dead in logs is given back.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, PoisonError};

use super::index::Place;
use super::log::{Data, Log};
use super::record::{Held, MAX_USES, Record, scan};
use super::{Cache, Trouble, lock};

/// Values that one call removes at most beyond what it needs itself, so that no thread is held up for long.
const STEP: usize = 64;
/// Bytes that are copied between logs at a time.
const CHUNK: usize = 1 << 20;

/// A value or note that may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Victim {
    /// Generation of its last use.
    used: u64,
    /// Bytes short of all that there can be, so that larger ones go first: fewer have to be computed again for the same room.
    rest: u64,
    id: [u8; 32],
    is_note: bool,
}

/// What was removed from a cache folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Freed {
    /// Values.
    pub values: u64,
    /// Bytes on the disk.
    pub bytes: u64,
    /// Bytes on the disk now.
    pub left: u64,
}

impl Cache {
    /// Removes what was not used for longest until at most `to` bytes are left, and whatever processes that are gone left behind. What this run
    /// stored or used stays.
    pub fn gc(&self, to: u64) -> Freed {
        self.refresh();
        self.index.prune();
        self.note_uses();
        let (bytes, values) = (self.bytes(), self.index.contents.len());
        let mut gone = Vec::new();
        for victim in self.victims() {
            if self.lean() <= to {
                break;
            }
            self.evict(&victim, &mut gone);
        }
        self.say_removed(&gone);
        self.index.prune();
        // Logs that cannot be compacted now are compacted another time.
        let _ = self.compact(95);
        self.sweep();
        let left = self.bytes();
        Freed { values: values.saturating_sub(self.index.contents.len()), bytes: bytes.saturating_sub(left), left }
    }

    /// Makes room for so many bytes. False where there is none, which is told once.
    pub(super) fn reserve(&self, need: u64) -> bool {
        if self.unheard.fetch_add(need, Relaxed) > self.limit / 32 {
            self.unheard.store(0, Relaxed);
            self.refresh();
        }
        let fits = |bytes: u64| bytes.saturating_add(need) <= self.limit;
        let is_draining = self.is_draining.load(Relaxed);
        if !is_draining && (fits(self.bytes()) || self.is_full.load(Relaxed)) {
            return fits(self.bytes());
        }
        let mut victims = lock(&self.victims);
        if victims.is_empty() {
            self.refresh();
            self.index.prune();
            *victims = self.victims().into();
        }
        let goal = (self.limit / 10 * 9).saturating_sub(need);
        let mut gone = Vec::new();
        while self.lean() > goal && (gone.len() < STEP || !fits(self.lean())) {
            let Some(victim) = victims.pop_front() else { break };
            self.evict(&victim, &mut gone);
        }
        self.say_removed(&gone);
        self.is_draining.store(self.lean() > goal && !victims.is_empty(), Relaxed);
        if !fits(self.bytes()) && fits(self.lean()) {
            // With the tenth that was made free, what little is left dead in logs fits.
            let _ = self.compact(95);
        }
        if fits(self.bytes()) {
            return true;
        }
        if !self.is_full.swap(true, Relaxed) {
            self.tell(Trouble::Full { folder: self.folder.0.clone(), limit: self.limit });
        }
        false
    }

    /// Makes room on a full disk, once in a run.
    pub(super) fn rescue(&self) {
        let goal = self.lean() / 4 * 3;
        let mut gone = Vec::new();
        for victim in self.victims() {
            if self.lean() <= goal {
                break;
            }
            self.evict(&victim, &mut gone);
        }
        self.say_removed(&gone);
    }

    /// Writes down what was used, and gives back what is dead in logs where that is most of them.
    pub(super) fn close(&self) {
        if self.is_stopped.load(Relaxed) || !self.folder.index().is_dir() {
            return;
        }
        self.note_uses();
        let logs = self.own_log.load(Relaxed) + self.other_logs.load(Relaxed);
        // Only so much, that copying costs less than what was written since.
        if logs > (2 * self.index.live_in_logs()).max(4 << 20) {
            let _ = self.compact(70);
        }
    }

    /// Bytes that would be left if nothing in logs were dead.
    fn lean(&self) -> u64 {
        let logs = self.own_log.load(Relaxed) + self.other_logs.load(Relaxed);
        self.index.blob_bytes.load(Relaxed) + self.index.live_in_logs().min(logs)
    }

    /// What may go, first to last.
    fn victims(&self) -> Vec<Victim> {
        let mut victims = Vec::new();
        let mut add = |id: &[u8; 32], used: u64, size: u64, is_note| {
            if used < self.generation {
                victims.push(Victim { used, rest: u64::MAX - size, id: *id, is_note });
            }
        };
        self.index.contents.each(|id, c| add(id, c.used.load(Relaxed), c.stored, false));
        self.index.notes.each(|id, n| add(id, n.used.load(Relaxed), n.text.len() as u64, true));
        victims.sort_unstable();
        victims
    }

    /// Removes a value or note, unless it was used since it was chosen.
    fn evict(&self, victim: &Victim, gone: &mut Vec<Record<'static>>) {
        let id = &victim.id;
        if victim.is_note {
            let used = self.index.notes.read(id).get(id).map(|n| n.used.load(Relaxed));
            if used == Some(victim.used) {
                self.index.remove_note(id);
            }
            return;
        }
        let found = self.index.contents.read(id).get(id).map(|c| (c.used.load(Relaxed), c.born, matches!(c.place, Place::Blob)));
        let Some((used, born, is_blob)) = found else { return };
        if used == victim.used && self.index.remove(id, born) {
            if is_blob {
                let _ = std::fs::remove_file(self.folder.blob(id));
            }
            gone.push(Record::Removed { upto: born, digest: *id });
        }
    }

    fn say_removed(&self, gone: &[Record]) {
        if !gone.is_empty() {
            // A record that is not written costs that the value is found missing.
            let _ = self.append(gone);
        }
    }

    /// Writes down what this run used.
    fn note_uses(&self) {
        let mut uses = Vec::new();
        self.index.contents.each_mut(|id, c| {
            let used = c.used.load(Relaxed);
            if used > c.noted {
                c.noted = used;
                uses.push((*id, used));
            }
        });
        self.index.notes.each_mut(|id, n| {
            let used = n.used.load(Relaxed);
            if used > n.noted {
                n.noted = used;
                uses.push((*id, used));
            }
        });
        if !uses.is_empty() {
            let records: Vec<Record> = uses.chunks(MAX_USES).map(|u| Record::Used(u.to_vec())).collect();
            // In a folder that is read-only the order in which values go is not to be had.
            let _ = self.append(&records);
        }
    }

    /// Copies what is alive in logs that nobody writes into a new one, and removes them: those that are small, or less alive than so many per cent.
    fn compact(&self, alive: u64) -> io::Result<()> {
        let mut writer = lock(&self.writer);
        let Some(_maintenance) = self.folder.maintenance()? else { return Ok(()) };
        self.release(&mut writer);
        self.refresh();
        let (dead, is_alone) = self.dead_logs()?;
        let mut copy = Copy { cache: self, to: None, records: Vec::new(), keeps_removals: true };
        let mut done: Vec<(String, File)> = Vec::new();
        let mut kept = 0;
        for (name, lock_file) in dead {
            if copy.is_worth(&name, alive)? {
                done.push((name, lock_file));
            } else {
                kept += 1;
            }
        }
        copy.keeps_removals = !is_alone || kept > 0;
        let copied = done.iter().try_for_each(|(name, _)| copy.log(name)).and_then(|()| copy.sync());
        if let Some(log) = copy.to {
            self.own_log.store(log.bytes(), Relaxed);
            *writer = Some(log);
        }
        copied?;
        done.iter().for_each(|(name, _)| self.remove_log(name));
        drop(done);
        self.refresh();
        Ok(())
    }

    /// Removes blobs that no record tells of, if this process is the only one here.
    fn sweep(&self) {
        let mut present = self.presence.write().unwrap_or_else(PoisonError::into_inner);
        let is_alone = present.take().is_some_and(|file| file.unlock().is_ok() && file.try_lock().is_ok());
        if is_alone {
            self.refresh();
            self.sweep_in(&self.folder.blobs());
            self.sweep_in(&self.folder.temporary());
        }
        *present = self.folder.presence();
    }

    fn sweep_in(&self, folder: &Path) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                self.sweep_in(&path);
                continue;
            }
            let name = entry.file_name().to_string_lossy().into_owned();
            let digest = name.strip_suffix(".npz").and_then(|hex| blake3::Hash::from_hex(hex).ok());
            let is_known = digest.is_some_and(|d| {
                let contents = self.index.contents.read(d.as_bytes());
                contents.get(d.as_bytes()).is_some_and(|c| matches!(c.place, Place::Blob))
            });
            if !is_known {
                let _ = std::fs::remove_file(path);
            }
        }
    }
}

/// Copies what is alive in logs.
struct Copy<'a> {
    cache: &'a Cache,
    to: Option<Log>,
    records: Vec<u8>,
    /// Whether a log that stays may tell of values that were removed.
    keeps_removals: bool,
}

impl Copy<'_> {
    /// Whether so much of a log is dead, or it is so small, that it is worth a copy.
    fn is_worth(&self, name: &str, percent: u64) -> io::Result<bool> {
        let (bytes, data, total) = self.cache.whole_log(name)?;
        let mut alive = 0;
        scan(&bytes, |record, length| {
            if self.is_alive(&record) {
                alive += length as u64;
                if let (Record::Value(held), Some(data)) = (&record, &data)
                    && self.is_here(held, data)
                {
                    alive += held.stored;
                }
            }
        });
        Ok(total < self.cache.segment / 4 || alive < total / 100 * percent)
    }

    fn is_alive(&self, record: &Record) -> bool {
        let index = &self.cache.index;
        match record {
            Record::Value(Held { key, digest, .. }) | Record::Link { key, digest } => {
                index.keys.read(key).get(key) == Some(digest) && index.contents.read(digest).contains_key(digest)
            }
            Record::Note { born, key, text } => index.notes.read(key).get(key).is_some_and(|n| n.born == *born && *n.text == **text),
            // Uses are written anew for all that is copied.
            Record::Used(_) => false,
            Record::Removed { digest, upto } => self.keeps_removals && index.removed_upto(digest) == Some(*upto),
        }
    }

    /// Whether the bytes of a value are those beside the log that is copied.
    fn is_here(&self, held: &Held, data: &Arc<Data>) -> bool {
        let contents = self.cache.index.contents.read(&held.digest);
        matches!(contents.get(&held.digest).map(|c| (&c.place, held.at)), Some((Place::Inline(d, at), Some(here))) if Arc::ptr_eq(d, data) && *at == here)
    }

    fn log(&mut self, name: &str) -> io::Result<()> {
        let (bytes, data, _) = self.cache.whole_log(name)?;
        let Some(data) = data else { return Ok(()) };
        let mut uses = Vec::new();
        let mut result = Ok(());
        scan(&bytes, |record, _| {
            if result.is_ok() && self.is_alive(&record) {
                result = self.record(&record, &data, &mut uses);
            }
        });
        result?;
        for uses in uses.chunks(MAX_USES) {
            Record::Used(uses.to_vec()).write(&mut self.records);
        }
        self.flush(0)
    }

    fn record(&mut self, record: &Record, data: &Arc<Data>, uses: &mut Vec<([u8; 32], u64)>) -> io::Result<()> {
        let index = &self.cache.index;
        match record {
            Record::Value(held) => {
                uses.extend(index.contents.read(&held.digest).get(&held.digest).map(|c| (held.digest, c.noted)));
                if self.is_here(held, data) {
                    self.inline(held, data)?;
                } else {
                    let is_blob = matches!(index.contents.read(&held.digest).get(&held.digest).map(|c| &c.place), Some(Place::Blob));
                    let record = if is_blob && held.at.is_none() { record } else { &Record::Link { key: held.key, digest: held.digest } };
                    record.write(&mut self.records);
                }
            }
            Record::Note { key, .. } => {
                uses.extend(index.notes.read(key).get(key).map(|n| (*key, n.noted)));
                record.write(&mut self.records);
            }
            other => drop(other.write(&mut self.records)),
        }
        self.flush(CHUNK)
    }

    /// Copies a value from the data beside one log to that beside another.
    fn inline(&mut self, held: &Held, data: &Arc<Data>) -> io::Result<()> {
        let bytes = data.read(held.at.unwrap_or(0), held.stored)?;
        let to = self.to()?;
        let at = to.append_data(&bytes)?;
        let place = Place::Inline(to.source.clone(), at);
        if let Some(content) = self.cache.index.contents.write(&held.digest).get_mut(&held.digest) {
            content.place = place;
        }
        Record::Value(Held { at: Some(at), ..*held }).write(&mut self.records);
        Ok(())
    }

    fn to(&mut self) -> io::Result<&mut Log> {
        match &mut self.to {
            Some(log) => Ok(log),
            none => Ok(none.insert(self.cache.new_log()?)),
        }
    }

    /// Writes records where there are more bytes of them than so many.
    fn flush(&mut self, above: usize) -> io::Result<()> {
        if self.records.len() > above {
            let records = std::mem::take(&mut self.records);
            self.to()?.append(&records)?;
        }
        Ok(())
    }

    /// Makes sure that the copy is on the disk, before what was copied is removed.
    fn sync(&self) -> io::Result<()> {
        self.to.as_ref().map_or(Ok(()), Log::sync)
    }
}
