//! What the index says, in memory. It is the same in whatever order logs are read, so that several processes need not agree on one.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use super::log::Data;
use super::record::{Held, Record};
use super::{Digest, Entry, Key};

/// About what a key or a note costs in a log beside its bytes.
const RECORD: u64 = 144;

/// Where the bytes of a value are.
#[derive(Clone, Debug)]
pub(super) enum Place {
    /// In a file of their own.
    Blob,
    /// In the data beside a log, from a place on.
    Inline(Arc<Data>, u64),
}

/// A value that is there.
#[derive(Debug)]
pub(super) struct Content {
    pub(super) bytes: u64,
    pub(super) stored: u64,
    pub(super) ty: Arc<str>,
    pub(super) place: Place,
    /// Generation in which it was stored.
    pub(super) born: u64,
    /// Generation of the last use that is on the disk.
    pub(super) noted: u64,
    /// Generation of the last use.
    pub(super) used: AtomicU64,
}

/// A small record of the caller's.
#[derive(Debug)]
pub(super) struct Note {
    pub(super) born: u64,
    pub(super) noted: u64,
    pub(super) used: AtomicU64,
    pub(super) text: Arc<[u8]>,
}

/// Keys are digests already: some of their bytes are as good a hash as any.
#[derive(Default)]
pub(super) struct Taken(u64);

impl Hasher for Taken {
    fn write(&mut self, bytes: &[u8]) {
        if let Some(chunk) = bytes.last_chunk::<8>() {
            self.0 = u64::from_le_bytes(*chunk);
        }
    }
    fn finish(&self) -> u64 {
        self.0
    }
}

pub(super) type Map<V> = HashMap<[u8; 32], V, BuildHasherDefault<Taken>>;

/// A map in parts, so that threads seldom meet.
#[derive(Debug)]
pub(super) struct Sharded<V>(Vec<RwLock<Map<V>>>);

impl<V> Default for Sharded<V> {
    fn default() -> Self {
        Self((0..64).map(|_| RwLock::default()).collect())
    }
}

impl<V> Sharded<V> {
    pub(super) fn read(&self, id: &[u8; 32]) -> RwLockReadGuard<'_, Map<V>> {
        self.0[usize::from(id[0]) % self.0.len()].read().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn write(&self, id: &[u8; 32]) -> RwLockWriteGuard<'_, Map<V>> {
        self.0[usize::from(id[0]) % self.0.len()].write().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn len(&self) -> u64 {
        self.0.iter().map(|s| s.read().unwrap_or_else(PoisonError::into_inner).len() as u64).sum()
    }

    pub(super) fn each(&self, mut each: impl FnMut(&[u8; 32], &V)) {
        for shard in &self.0 {
            shard.read().unwrap_or_else(PoisonError::into_inner).iter().for_each(|(id, v)| each(id, v));
        }
    }

    pub(super) fn each_mut(&self, mut each: impl FnMut(&[u8; 32], &mut V)) {
        for shard in &self.0 {
            shard.write().unwrap_or_else(PoisonError::into_inner).iter_mut().for_each(|(id, v)| each(id, v));
        }
    }

    fn retain(&self, mut keep: impl FnMut(&V) -> bool) {
        for shard in &self.0 {
            shard.write().unwrap_or_else(PoisonError::into_inner).retain(|_, v| keep(v));
        }
    }
}

/// Keys to digests to values, notes, and what was removed.
#[derive(Debug, Default)]
pub(super) struct Index {
    pub(super) keys: Sharded<Digest>,
    pub(super) contents: Sharded<Content>,
    pub(super) notes: Sharded<Note>,
    /// For each value that was removed, the generation up to which what was stored of it is gone.
    removed: Sharded<u64>,
    types: Mutex<Vec<Arc<str>>>,
    newest: AtomicU64,
    pub(super) blob_bytes: AtomicU64,
    inline_bytes: AtomicU64,
    note_bytes: AtomicU64,
}

impl Index {
    /// The highest generation seen.
    pub(super) fn newest(&self) -> u64 {
        self.newest.load(Relaxed)
    }

    /// Bytes in logs and their data that are of use, about.
    pub(super) fn live_in_logs(&self) -> u64 {
        let records = (self.keys.len() + self.notes.len()) * RECORD;
        records + self.inline_bytes.load(Relaxed) + self.note_bytes.load(Relaxed)
    }

    /// The value of a key, marked as used in the generation `now`.
    pub(super) fn find(&self, key: &Key, now: u64) -> Option<Entry> {
        let digest = *self.keys.read(key).get(key)?;
        let contents = self.contents.read(&digest);
        let content = contents.get(&digest)?;
        mark(&content.used, now);
        Some(Entry { digest, bytes: content.bytes })
    }

    /// Takes in what a record says. `data` is what lies beside the log that it was read from.
    pub(super) fn apply(&self, record: &Record, data: &Arc<Data>) {
        match record {
            Record::Value(held) => {
                self.newest.fetch_max(held.born, Relaxed);
                self.keys.write(&held.key).insert(held.key, held.digest);
                let place = held.at.map_or(Place::Blob, |at| Place::Inline(data.clone(), at));
                self.put(held, place);
            }
            Record::Link { key, digest } => drop(self.keys.write(key).insert(*key, *digest)),
            Record::Note { born, key, text } => self.put_note(*born, key, text),
            Record::Used(uses) => self.put_uses(uses),
            Record::Removed { upto, digest } => {
                self.newest.fetch_max(*upto, Relaxed);
                self.remove(digest, *upto);
            }
        }
    }

    /// Takes in a value, unless it is there or was removed later.
    pub(super) fn put(&self, held: &Held, place: Place) {
        if held.born < self.next_born(&held.digest, 0) {
            return;
        }
        let ty = self.intern(held.ty);
        let mut contents = self.contents.write(&held.digest);
        let old = contents.get(&held.digest);
        if old.is_some_and(|old| old.born >= held.born) {
            return;
        }
        let noted = old.map_or(held.born, |old| old.noted.max(held.born));
        let used = AtomicU64::new(old.map_or(noted, |old| old.used.load(Relaxed).max(noted)));
        self.counter(&place).fetch_add(held.stored, Relaxed);
        let content = Content { bytes: held.bytes, stored: held.stored, ty, place, born: held.born, noted, used };
        if let Some(old) = contents.insert(held.digest, content) {
            self.counter(&old.place).fetch_sub(old.stored, Relaxed);
        }
    }

    /// The latest note of a key is the one that stays.
    pub(super) fn put_note(&self, born: u64, key: &Key, text: &[u8]) {
        self.newest.fetch_max(born, Relaxed);
        let mut notes = self.notes.write(key);
        if notes.get(key).is_some_and(|old| old.born > born) {
            return;
        }
        let note = Note { born, noted: born, used: AtomicU64::new(born), text: text.into() };
        self.note_bytes.fetch_add(text.len() as u64, Relaxed);
        if let Some(old) = notes.insert(*key, note) {
            self.note_bytes.fetch_sub(old.text.len() as u64, Relaxed);
        }
    }

    /// Takes in the generations in which values and notes were used.
    pub(super) fn put_uses(&self, uses: &[([u8; 32], u64)]) {
        for (id, used) in uses {
            self.newest.fetch_max(*used, Relaxed);
            if let Some(content) = self.contents.write(id).get_mut(id) {
                content.noted = content.noted.max(*used);
                content.used.fetch_max(*used, Relaxed);
            } else if let Some(note) = self.notes.write(id).get_mut(id) {
                note.noted = note.noted.max(*used);
                note.used.fetch_max(*used, Relaxed);
            }
        }
    }

    /// Forgets a value as far as it was stored up to a generation. True where it was there.
    pub(super) fn remove(&self, digest: &Digest, upto: u64) -> bool {
        let mut contents = self.contents.write(digest);
        let mut removed = self.removed.write(digest);
        let last = removed.entry(*digest).or_default();
        *last = (*last).max(upto);
        drop(removed);
        if contents.get(digest).is_none_or(|c| c.born > upto) {
            return false;
        }
        if let Some(old) = contents.remove(digest) {
            self.counter(&old.place).fetch_sub(old.stored, Relaxed);
        }
        true
    }

    pub(super) fn remove_note(&self, key: &Key) {
        if let Some(old) = self.notes.write(key).remove(key) {
            self.note_bytes.fetch_sub(old.text.len() as u64, Relaxed);
        }
    }

    /// The generation to store a value in: `now`, unless it was removed in that one.
    pub(super) fn next_born(&self, digest: &Digest, now: u64) -> u64 {
        let removed = self.removed.read(digest);
        removed.get(digest).map_or(now, |upto| now.max(upto.saturating_add(1)))
    }

    /// The generation up to which a value was removed.
    pub(super) fn removed_upto(&self, digest: &Digest) -> Option<u64> {
        self.removed.read(digest).get(digest).copied()
    }

    /// Forgets keys of values that are gone.
    pub(super) fn prune(&self) {
        self.keys.retain(|digest| self.contents.read(digest).contains_key(digest));
    }

    fn counter(&self, place: &Place) -> &AtomicU64 {
        match place {
            Place::Blob => &self.blob_bytes,
            Place::Inline(..) => &self.inline_bytes,
        }
    }

    fn intern(&self, name: &str) -> Arc<str> {
        let mut types = self.types.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = types.iter().find(|t| ***t == *name) {
            return known.clone();
        }
        let new: Arc<str> = name.into();
        types.push(new.clone());
        new
    }
}

/// Marks as used, with a write only where there is something to say.
pub(super) fn mark(used: &AtomicU64, now: u64) {
    if used.load(Relaxed) < now {
        used.fetch_max(now, Relaxed);
    }
}
