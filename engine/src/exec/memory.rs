//! The memory of a run: one slot for each value, held until its last reader is done, in memory, or on disk where the budget asks for it.

use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use super::gate::Gate;
use super::lock;
use super::run::Task;
use super::spill::{Spill, Spilled};
use crate::cache::{Cache, Digest, Key};
use crate::node::{Fault, NodeError, Values};
use crate::registry::Types;
use crate::sync::{AtomicI64, AtomicU64, AtomicUsize, Mutex, Ordering};
use crate::value::{ValueRef, ValueType};

/// What a value costs beside its arrays.
const OVERHEAD: u64 = 64;
/// Values below this never leave memory: what is gained is less than what is to be remembered.
pub(super) const LEAST: u64 = 1024;

/// Bytes that are counted for a value.
pub(super) fn bytes_of(value: &ValueRef) -> u64 {
    value.size() as u64 + OVERHEAD
}

fn address(value: &ValueRef) -> usize {
    Arc::as_ptr(value).cast::<()>() as usize
}

/// A value, with the number of reads still to come.
#[derive(Default)]
struct Slot {
    readers: u32,
    /// Tasks that hold the value now, so that it cannot leave memory.
    pins: u32,
    /// Seconds that it would take to have it again.
    cost: f32,
    held: Held,
}

#[derive(Default)]
enum Held {
    #[default]
    None,
    /// In memory; and what is known of it.
    Here(ValueRef, Option<Box<Known>>),
    Away(Box<Away>),
}

/// What is known of a value beside itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) digest: Digest,
    /// Where it lies in the cache, if it does.
    pub(super) key: Option<Key>,
}

struct Away {
    bytes: u64,
    at: At,
}

enum At {
    Spill(Spilled),
    Cache(Key, Digest),
}

/// A value that was fetched for a task.
pub(super) struct Fetched {
    pub(super) slot: usize,
    pub(super) value: ValueRef,
    /// True where the task is its last reader, and holds it alone.
    pub(super) taken: bool,
}

/// Why a value could not be fetched.
pub(super) enum Missed {
    /// It does not fit beside what the task holds: to be tried again.
    Full,
    /// It is gone from the disk: to be made again.
    Lost,
}

/// Bytes alive of one node's values.
#[derive(Default)]
pub(super) struct Meter {
    live: AtomicI64,
    peak: AtomicI64,
}

impl Meter {
    fn grow(&self, bytes: u64) {
        let now = self.live.fetch_add(bytes as i64, Ordering::Relaxed) + bytes as i64;
        if now > self.peak.load(Ordering::Relaxed) {
            self.peak.fetch_max(now, Ordering::Relaxed);
        }
    }

    fn shrink(&self, bytes: u64) {
        self.live.fetch_sub(bytes as i64, Ordering::Relaxed);
    }

    pub(super) fn live(&self) -> u64 {
        self.live.load(Ordering::Relaxed).max(0) as u64
    }

    pub(super) fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed).max(0) as u64
    }
}

/// All slots of a run.
pub(super) struct Memory {
    pub(super) gate: Gate<Task>,
    slots: Vec<Mutex<Slot>>,
    /// The node of each slot's value.
    nodes: Vec<u32>,
    /// How late each value is read: what is read last is given up first.
    ranks: Vec<u32>,
    meters: Vec<Meter>,
    total: Meter,
    states: Vec<Option<ValueType>>,
    types: Types,
    cache: Option<Arc<Cache>>,
    spill: Spill,
    /// What may be given up, the last to be read on top. An entry may be stale.
    victims: Mutex<BinaryHeap<(u32, u32)>>,
    /// How many slots hold a value, by its address: a node that hands a value on gives it to a second slot.
    shares: Mutex<HashMap<usize, usize>>,
    /// Values that lie on disk.
    away: AtomicUsize,
    spilled: AtomicU64,
    spilled_bytes: AtomicU64,
    trouble: Mutex<Option<String>>,
}

/// What a memory is made from.
pub(super) struct Make {
    pub(super) limit: Option<u64>,
    /// Readers, node, and how late it is read, of each slot.
    pub(super) slots: Vec<(u32, u32, u32)>,
    /// For each node, the type of its state.
    pub(super) states: Vec<Option<ValueType>>,
    pub(super) types: Types,
    pub(super) cache: Option<Arc<Cache>>,
    pub(super) spill: std::path::PathBuf,
}

impl Memory {
    pub(super) fn new(make: Make) -> Self {
        let slot = |&(readers, _, _): &(u32, u32, u32)| Mutex::new(Slot { readers, ..Slot::default() });
        Self {
            gate: Gate::new(make.limit),
            slots: make.slots.iter().map(slot).collect(),
            nodes: make.slots.iter().map(|(_, node, _)| *node).collect(),
            ranks: make.slots.iter().map(|(_, _, rank)| *rank).collect(),
            meters: make.states.iter().map(|_| Meter::default()).collect(),
            total: Meter::default(),
            states: make.states,
            types: make.types,
            cache: make.cache,
            spill: Spill::new(&make.spill),
            victims: Mutex::default(),
            shares: Mutex::default(),
            away: AtomicUsize::new(0),
            spilled: AtomicU64::new(0),
            spilled_bytes: AtomicU64::new(0),
            trouble: Mutex::default(),
        }
    }

    pub(super) fn meter(&self, node: usize) -> &Meter {
        &self.meters[node]
    }

    /// Bytes alive of all results.
    pub(super) fn total(&self) -> &Meter {
        &self.total
    }

    fn grow(&self, slot: usize, bytes: u64) {
        self.meters[self.nodes[slot] as usize].grow(bytes);
        self.total.grow(bytes);
    }

    fn shrink(&self, slot: usize, bytes: u64) {
        self.meters[self.nodes[slot] as usize].shrink(bytes);
        self.total.shrink(bytes);
    }

    /// Values and bytes that went to the spill file.
    pub(super) fn spilled(&self) -> (u64, u64) {
        (self.spilled.load(Ordering::Relaxed), self.spilled_bytes.load(Ordering::Relaxed))
    }

    /// A value that the cache has stands in a slot, without having been made.
    pub(super) fn preset(&self, slot: usize, known: Known, bytes: u64) {
        let Some(key) = known.key else { return };
        let mut guard = lock(&self.slots[slot]);
        if guard.readers > 0 {
            guard.held = Held::Away(Box::new(Away { bytes: bytes + OVERHEAD, at: At::Cache(key, known.digest) }));
            self.away.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Bytes that are to be loaded before the values of `slots` are there.
    pub(super) fn away_bytes(&self, slots: impl Iterator<Item = usize>) -> u64 {
        if self.away.load(Ordering::Relaxed) == 0 {
            return 0;
        }
        let bytes = |slot: usize| if let Held::Away(away) = &lock(&self.slots[slot]).held { away.bytes } else { 0 };
        let mut slots: Vec<usize> = slots.collect();
        slots.sort_unstable();
        slots.dedup();
        slots.into_iter().map(bytes).sum()
    }

    /// Holds the values of `slots` that are in memory, so that they do not leave it; gives the bytes of those that are not.
    pub(super) fn pin(&self, slots: impl Iterator<Item = usize>, pins: &mut Vec<usize>) -> u64 {
        let mut slots: Vec<usize> = slots.collect();
        slots.sort_unstable();
        slots.dedup();
        let mut bytes = 0;
        for slot in slots {
            let mut guard = lock(&self.slots[slot]);
            match &guard.held {
                Held::Here(..) => {
                    guard.pins += 1;
                    pins.push(slot);
                }
                Held::Away(away) => bytes += away.bytes,
                Held::None => {}
            }
        }
        bytes
    }

    /// Bytes of the largest of the values of `slots` that can be on disk when it is read.
    pub(super) fn largest(&self, slots: impl Iterator<Item = usize>) -> u64 {
        let bytes = |slot: usize| match &lock(&self.slots[slot]).held {
            Held::Here(value, _) => Some(bytes_of(value)).filter(|b| *b >= LEAST),
            Held::Away(away) => Some(away.bytes),
            Held::None => None,
        };
        if self.gate.is_limited() { slots.filter_map(bytes).max().unwrap_or(0) } else { 0 }
    }

    /// Seconds that it would take to have a value again.
    pub(super) fn cost(&self, slot: usize) -> f32 {
        lock(&self.slots[slot]).cost
    }

    /// True for a value that somebody will read.
    pub(super) fn is_read(&self, slot: usize) -> bool {
        lock(&self.slots[slot]).readers > 0
    }

    /// The digest of a value; `None` where it is not known and the value has more than `most` bytes, which are used up.
    pub(super) fn digest(&self, slot: usize, most: &mut u64) -> Option<Digest> {
        let value = match &lock(&self.slots[slot]).held {
            Held::Here(_, Some(known)) => return Some(known.digest),
            Held::Here(value, None) => value.clone(),
            Held::Away(away) => return if let At::Cache(_, digest) = &away.at { Some(*digest) } else { None },
            Held::None => return None,
        };
        *most = most.checked_sub(value.size() as u64)?;
        let digest = *crate::value::digest(value.as_ref()).as_bytes();
        if let Held::Here(_, known @ None) = &mut lock(&self.slots[slot]).held {
            *known = Some(Box::new(Known { digest, key: None }));
        }
        Some(digest)
    }

    /// The value of a slot for a task, for which `charge` bytes are counted: what is loaded comes out of them, and what is taken goes to them.
    pub(super) fn fetch(&self, slot: usize, charge: &mut u64) -> Result<Fetched, Missed> {
        let mut guard = lock(&self.slots[slot]);
        match std::mem::take(&mut guard.held) {
            Held::None => Err(Missed::Lost),
            Held::Here(value, _) if guard.readers == 1 => {
                let bytes = bytes_of(&value);
                self.unshare(&value, bytes);
                *charge += bytes;
                self.shrink(slot, bytes);
                Ok(Fetched { slot, value, taken: true })
            }
            Held::Here(value, stored) => {
                guard.held = Held::Here(value.clone(), stored);
                guard.pins += 1;
                Ok(Fetched { slot, value, taken: false })
            }
            Held::Away(away) => self.load(slot, &mut guard, away, charge),
        }
    }

    fn load(&self, slot: usize, guard: &mut Slot, away: Box<Away>, charge: &mut u64) -> Result<Fetched, Missed> {
        let is_last = guard.readers == 1;
        if self.gate.is_limited() && *charge < away.bytes {
            guard.held = Held::Away(away);
            return Err(Missed::Full);
        }
        let Some(value) = self.bring(slot, &away.at) else {
            self.away.fetch_sub(1, Ordering::Relaxed);
            return Err(Missed::Lost);
        };
        self.away.fetch_sub(1, Ordering::Relaxed);
        let stored = match &away.at {
            At::Spill(spilled) => {
                self.spill.free(spilled);
                None
            }
            At::Cache(key, digest) => Some(Box::new(Known { digest: *digest, key: Some(*key) })),
        };
        let bytes = bytes_of(&value);
        if is_last {
            // Its bytes are in the charge already, and stay there.
            if !self.gate.is_limited() {
                *charge += bytes;
                self.count(bytes);
            }
            return Ok(Fetched { slot, value, taken: true });
        }
        if self.gate.is_limited() {
            *charge = charge.saturating_sub(bytes)
        } else {
            self.count(bytes)
        }
        self.grow(slot, bytes);
        self.share(&value, bytes);
        guard.held = Held::Here(value.clone(), stored);
        guard.pins += 1;
        self.offer(slot, bytes);
        Ok(Fetched { slot, value, taken: false })
    }

    /// Counts bytes where nothing limits them.
    fn count(&self, bytes: u64) {
        let _ = self.gate.reserve(bytes);
    }

    fn bring(&self, slot: usize, at: &At) -> Option<ValueRef> {
        let state = self.states[self.nodes[slot] as usize].as_ref();
        match at {
            At::Cache(key, _) => self.cache.as_ref()?.load(key, state, &self.types),
            At::Spill(spilled) => {
                let ty = self.types.get(spilled.type_name()).or(state)?;
                (ty.from_parts)(self.spill.read(spilled).ok()?).ok()
            }
        }
    }

    /// Puts what was taken back, for a task that has to be tried again.
    pub(super) fn put_back(&self, fetched: Fetched, charge: &mut u64) {
        if !fetched.taken {
            return self.unpin(fetched.slot);
        }
        let bytes = bytes_of(&fetched.value);
        *charge = charge.saturating_sub(bytes);
        self.grow(fetched.slot, bytes);
        self.share(&fetched.value, bytes);
        lock(&self.slots[fetched.slot]).held = Held::Here(fetched.value, None);
        self.offer(fetched.slot, bytes);
    }

    /// One holder less.
    pub(super) fn unpin(&self, slot: usize) {
        let mut guard = lock(&self.slots[slot]);
        guard.pins = guard.pins.saturating_sub(1);
    }

    /// One reader less, who never held it; gives the bytes that are free then.
    pub(super) fn release(&self, slot: usize) -> u64 {
        self.drop_reader(slot, 0)
    }

    /// One reader less, who held it; gives the bytes that are free then.
    pub(super) fn release_held(&self, slot: usize) -> u64 {
        self.drop_reader(slot, 1)
    }

    fn drop_reader(&self, slot: usize, pins: u32) -> u64 {
        let mut guard = lock(&self.slots[slot]);
        guard.pins = guard.pins.saturating_sub(pins);
        guard.readers = guard.readers.saturating_sub(1);
        if guard.readers > 0 {
            return 0;
        }
        match std::mem::take(&mut guard.held) {
            Held::None => 0,
            Held::Here(value, _) => {
                let bytes = bytes_of(&value);
                self.unshare(&value, bytes);
                self.shrink(slot, bytes);
                bytes
            }
            Held::Away(away) => {
                self.away.fetch_sub(1, Ordering::Relaxed);
                if let At::Spill(spilled) = &away.at {
                    self.spill.free(spilled);
                }
                0
            }
        }
    }

    /// Puts a result where its readers find it, out of the bytes counted for its task or more; to disk where there is no room at all.
    ///
    /// # Errors
    /// Where it fits neither here nor there.
    pub(super) fn put(&self, slot: usize, value: ValueRef, known: Option<Known>, cost: f32, charge: &mut u64) -> Result<(), NodeError> {
        let mut guard = lock(&self.slots[slot]);
        guard.cost = cost;
        if guard.readers == 0 {
            return Ok(());
        }
        let bytes = bytes_of(&value);
        if *charge >= bytes {
            *charge -= bytes;
        } else if !self.gate.reserve(bytes - *charge) && !self.gate.reserve_with(bytes - *charge, || self.spill_one(Some(slot), false)) {
            let at = match known {
                Some(Known { digest, key: Some(key) }) => At::Cache(key, digest),
                _ => At::Spill(self.spill.write(value.as_ref()).map_err(|e| self.no_room(bytes, &e))?),
            };
            self.note_spill(bytes);
            guard.held = Held::Away(Box::new(Away { bytes, at }));
            return Ok(());
        } else {
            *charge = 0;
        }
        self.grow(slot, bytes);
        self.share(&value, bytes);
        guard.held = Held::Here(value, known.map(Box::new));
        drop(guard);
        self.offer(slot, bytes);
        Ok(())
    }

    fn no_room(&self, bytes: u64, error: &std::io::Error) -> NodeError {
        let folder = self.spill.folder().display();
        NodeError::new(Fault::Limit, format!("expected room for a result of {bytes} bytes in memory or in {folder}, found none: {error}"))
            .help("free the disk, choose another folder with --cache, or allow more with --memory")
    }

    fn note_spill(&self, bytes: u64) {
        self.away.fetch_add(1, Ordering::Relaxed);
        self.spilled.fetch_add(1, Ordering::Relaxed);
        self.spilled_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn is_shareable(&self, bytes: u64) -> bool {
        bytes >= LEAST && self.gate.is_limited()
    }

    /// A slot more holds the value.
    fn share(&self, value: &ValueRef, bytes: u64) {
        if self.is_shareable(bytes) {
            *lock(&self.shares).entry(address(value)).or_insert(0) += 1;
        }
    }

    /// A slot less holds the value.
    fn unshare(&self, value: &ValueRef, bytes: u64) {
        if self.is_shareable(bytes) {
            let mut shares = lock(&self.shares);
            if let Some(share) = shares.get_mut(&address(value)) {
                *share -= 1;
                if *share == 0 {
                    shares.remove(&address(value));
                }
            }
        }
    }

    /// Slots that hold the value.
    fn shares(&self, value: &ValueRef) -> usize {
        lock(&self.shares).get(&address(value)).copied().unwrap_or(1)
    }

    /// Offers a value to be given up when room is sought.
    fn offer(&self, slot: usize, bytes: u64) {
        if self.is_shareable(bytes) {
            lock(&self.victims).push((self.ranks[slot], slot as u32));
        }
    }

    /// Gives up one value that lies idle; false where there is none. Only where `is_alone`, so that nobody who runs may hold a lock, is it sure that
    /// there is none.
    pub(super) fn make_room(&self, is_alone: bool) -> bool {
        self.spill_one(None, is_alone)
    }

    /// As [`Memory::make_room`], by one who holds the lock of the slot `mine`.
    fn spill_one(&self, mine: Option<usize>, is_alone: bool) -> bool {
        let mut kept = Vec::new();
        let mut found = false;
        while let Some((rank, slot)) = { lock(&self.victims).pop() } {
            if Some(slot as usize) == mine {
                continue;
            }
            // Whoever runs and holds the lock of a slot is reading or filling it, so that it is no victim now, and may wait for us. Whoever does not
            // run only has a look.
            let guard = if is_alone { Some(lock(&self.slots[slot as usize])) } else { self.slots[slot as usize].try_lock().ok() };
            let Some(mut guard) = guard else {
                kept.push((rank, slot));
                continue;
            };
            let (value, stored) = match std::mem::take(&mut guard.held) {
                Held::Here(value, stored) if guard.pins == 0 => (value, stored),
                Held::Here(value, stored) => {
                    guard.held = Held::Here(value, stored);
                    kept.push((rank, slot));
                    continue;
                }
                // What was offered is gone from here; what took its place stays.
                other => {
                    guard.held = other;
                    continue;
                }
            };
            let bytes = bytes_of(&value);
            let at = match stored.as_deref() {
                Some(Known { digest, key: Some(key) }) => Ok(At::Cache(*key, *digest)),
                _ => self.spill.write(value.as_ref()).map(At::Spill),
            };
            match at {
                Ok(at) => {
                    guard.held = Held::Away(Box::new(Away { bytes, at }));
                    self.unshare(&value, bytes);
                    drop(value);
                    self.shrink(slot as usize, bytes);
                    self.note_spill(bytes);
                    self.gate.release(bytes);
                    found = true;
                }
                Err(error) => {
                    guard.held = Held::Here(value, stored);
                    lock(&self.trouble).get_or_insert_with(|| format!("{}: {error}", self.spill.folder().display()));
                    kept.push((rank, slot));
                }
            }
            break;
        }
        lock(&self.victims).extend(kept);
        found
    }

    /// Why the last value could not be spilled.
    pub(super) fn trouble(&self) -> Option<String> {
        lock(&self.trouble).clone()
    }

    /// The value of a slot that is kept for the caller.
    pub(super) fn kept(&self, slot: usize) -> Option<ValueRef> {
        let guard = lock(&self.slots[slot]);
        match &guard.held {
            Held::Here(value, _) => Some(value.clone()),
            Held::Away(away) => self.bring(slot, &away.at),
            Held::None => None,
        }
    }
}

/// The values of a sequence for a node that runs once. What is in memory is handed out as it is; what is on disk comes into a window of the node's
/// own, and leaves it again when the node has let go of it and something else is asked for.
pub(super) struct SlotValues {
    memory: Arc<Memory>,
    slots: Vec<usize>,
    window: Mutex<Window>,
}

struct Window {
    /// Bytes that are counted for the window and hold nothing.
    room: u64,
    /// All bytes that are counted for it.
    total: u64,
    held: Vec<(usize, ValueRef, u64)>,
    /// Values that were in memory and that the node may still hold.
    lent: Vec<(usize, ValueRef)>,
    lost: bool,
}

impl SlotValues {
    /// A handle on the values of `slots`, with so many bytes counted for what has to be loaded.
    pub(super) fn new(memory: Arc<Memory>, slots: Vec<usize>, room: u64) -> Self {
        Self { memory, slots, window: Mutex::new(Window { room, total: room, held: Vec::new(), lent: Vec::new(), lost: false }) }
    }

    /// Lets go of all; gives the bytes that were counted.
    pub(super) fn close(&self) -> u64 {
        let mut window = lock(&self.window);
        window.held.clear();
        window.lent.drain(..).for_each(|(slot, _)| self.memory.unpin(slot));
        window.room = 0;
        std::mem::take(&mut window.total)
    }

    /// True where a value was gone from the disk.
    pub(super) fn is_lost(&self) -> bool {
        lock(&self.window).lost
    }

    /// Lets those values leave memory that the node has let go of.
    fn sweep(&self, window: &mut Window) {
        window.lent.retain(|(slot, value)| {
            let is_held = Arc::strong_count(value) > self.memory.shares(value) + 1;
            if !is_held {
                self.memory.unpin(*slot);
            }
            is_held
        });
    }

    /// Makes room for `bytes` in the window.
    fn widen(&self, window: &mut Window, bytes: u64) -> Result<(), NodeError> {
        let gate = &self.memory.gate;
        if window.room < bytes && gate.used() + bytes <= gate.limit() / 2 && gate.reserve(bytes) {
            (window.room, window.total) = (window.room + bytes, window.total + bytes);
        }
        while window.room < bytes {
            let Some(idle) = window.held.iter().position(|(_, value, _)| Arc::strong_count(value) == 1) else { break };
            window.room += window.held.remove(idle).2;
        }
        if window.room >= bytes {
            return Ok(());
        }
        let more = bytes - window.room;
        if gate.reserve_with(more, || self.memory.make_room(false)) {
            (window.room, window.total) = (window.room + more, window.total + more);
            return Ok(());
        }
        let held = window.held.len();
        let message =
            format!("expected room for one more frame of a sequence of {}, found {held} held at once and no memory left", self.len());
        Err(NodeError::new(Fault::Limit, message).help("allow more with --memory, or ask for fewer frames at once"))
    }
}

impl Values for SlotValues {
    fn len(&self) -> usize {
        self.slots.len()
    }

    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        let lost = |what: &str| NodeError::internal(format!("frame {idx} of a sequence of {} {what}", self.slots.len()));
        let slot = self.slots.get(idx).copied().ok_or_else(|| lost("was read"))?;
        let mut window = lock(&self.window);
        self.sweep(&mut window);
        let mut guard = lock(&self.memory.slots[slot]);
        if let Held::Here(value, _) = &guard.held {
            let value = value.clone();
            guard.pins += 1;
            window.lent.push((slot, value.clone()));
            return Ok(value);
        }
        let Held::Away(away) = &guard.held else { return Err(lost("was never made")) };
        if let Some((_, value, _)) = window.held.iter().find(|(i, _, _)| *i == idx) {
            return Ok(value.clone());
        }
        self.widen(&mut window, away.bytes)?;
        let Some(value) = self.memory.bring(slot, &away.at) else {
            window.lost = true;
            return Err(lost("is gone from the disk"));
        };
        window.room -= away.bytes;
        window.held.push((idx, value.clone(), away.bytes));
        Ok(value)
    }
}
