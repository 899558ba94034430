//! Memory of a worker's outputs: pages that can be written while their task runs, and can be read alone once it has ended, so that whoever comes back to
//! them is found out. Behind each array lie bytes that nobody may change, and behind each room a page that is not there.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::message::LARGE;
use super::sheet::Pages;
use super::{fail, rights};
use crate::array::{Bytes, DType, Data, Shared};

/// Bytes of a room for small arrays of several tasks.
const ROOM: usize = 1 << 17;
/// Where an array begins, and how many bytes at least lie behind it.
const ALIGNED: usize = 64;
/// What these are.
const FILL: u8 = 0xa5;
/// Tasks, and large arrays, whose rooms are kept as they are, for whoever comes back to them.
const KEPT: usize = 8;

struct Room {
    pages: Pages,
    /// Without the page that is not there.
    bytes: usize,
}

impl Room {
    fn new(bytes: usize) -> std::io::Result<Self> {
        let page = super::page();
        let bytes = bytes.checked_next_multiple_of(page).ok_or_else(fail)?;
        let pages = Pages::new(bytes.checked_add(page).ok_or_else(fail)?)?;
        // SAFETY: the last page of what is new.
        unsafe { libc::mprotect((pages.at + bytes) as *mut libc::c_void, page, libc::PROT_NONE) };
        Ok(Self { pages, bytes })
    }

    /// Says what may be done with a part of it, which begins and ends with a page.
    fn allow(&self, part: Range<usize>, rights: libc::c_int) {
        // SAFETY: the pages are ours.
        unsafe { libc::mprotect((self.pages.at + part.start) as *mut libc::c_void, part.len(), rights) };
    }

    fn range(&self) -> Range<usize> {
        self.pages.at..self.pages.at + self.bytes
    }
}

struct Piece {
    room: Arc<Room>,
    from: usize,
    bytes: usize,
}

impl Bytes for Piece {
    fn bytes(&self) -> &[u8] {
        // SAFETY: they lie within the room, which is held.
        unsafe { std::slice::from_raw_parts((self.room.pages.at + self.from) as *const u8, self.bytes) }
    }
}

/// A room for small arrays, which is filled from its beginning.
struct Filled {
    room: Arc<Room>,
    /// Bytes that tasks have taken, and how many of those cannot be written any longer.
    used: usize,
    shut: usize,
    /// Tasks that put something out while it was filled.
    tasks: usize,
}

impl Filled {
    fn new() -> Option<Self> {
        Some(Self { room: shared(Room::new(ROOM).ok()?), used: 0, shut: 0, tasks: 0 })
    }

    /// True where nobody holds an array in it.
    fn is_free(&self) -> bool {
        Arc::strong_count(&self.room) == 1
    }

    /// Has what was taken since the last time be read alone.
    fn shut(&mut self, made_by: (u32, i64)) {
        let from = std::mem::replace(&mut self.shut, self.used.next_multiple_of(super::page()));
        self.room.allow(from..self.shut, libc::PROT_READ);
        let at = self.room.pages.at;
        rights::add_past(at + from..at + self.used, made_by);
        self.used = self.shut;
    }

    /// The room, to be filled from its beginning.
    fn emptied(mut self) -> Self {
        self.room.allow(0..self.shut, libc::PROT_READ | libc::PROT_WRITE);
        // SAFETY: the room is nobody's, and can be written.
        unsafe { std::ptr::write_bytes(self.room.pages.at as *mut u8, 0, self.shut) };
        (self.used, self.shut, self.tasks) = (0, 0, 0);
        self
    }
}

#[derive(Default)]
struct State {
    /// Rooms for small arrays: the last is being filled.
    small: VecDeque<Filled>,
    /// Rooms of one large array each that can be written.
    large: Vec<Arc<Room>>,
    past_large: VecDeque<Arc<Room>>,
}

impl State {
    /// A room that has so many bytes left.
    fn with_room(&mut self, bytes: usize) -> Option<&mut Filled> {
        if self.small.back().is_none_or(|last| bytes > last.room.bytes - last.used) {
            let emptied = self.oldest().and_then(|at| self.small.remove(at)).map(Filled::emptied);
            self.small.push_back(emptied.map_or_else(Filled::new, Some)?);
        }
        self.small.back_mut()
    }

    /// The oldest room that nobody uses, if enough tasks ended in those behind it.
    fn oldest(&self) -> Option<usize> {
        let mut behind: usize = self.small.iter().map(|filled| filled.tasks).sum();
        self.small.iter().position(|filled| {
            behind -= filled.tasks;
            behind >= KEPT && filled.is_free() && filled.shut == filled.used
        })
    }
}

/// All rooms of a worker.
#[derive(Default)]
pub(super) struct Rooms(Mutex<State>);

impl Rooms {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Memory of noughts for an array, and where it begins.
    pub(super) fn array(&self, dtype: DType, count: usize) -> Option<(Data, *mut u8)> {
        let bytes = count.checked_mul(dtype.size())?;
        let all = bytes.checked_add(ALIGNED)?.checked_next_multiple_of(ALIGNED)?;
        let mut state = self.state();
        let (room, from) = if bytes < LARGE {
            let filled = state.with_room(all)?;
            filled.used += all;
            (filled.room.clone(), filled.used - all)
        } else {
            let room = shared(Room::new(all).ok()?);
            state.large.push(room.clone());
            // It ends where the page is not there.
            let from = room.bytes - all;
            (room, from)
        };
        let start = (room.pages.at + from) as *mut u8;
        // SAFETY: the bytes behind the array are within the room, and nobody else's.
        unsafe { std::ptr::write_bytes(start.add(bytes), FILL, all - bytes) };
        let data = Data::Shared(Shared::new(dtype, Arc::new(Piece { room, from, bytes }))?);
        Some((data, start))
    }

    /// An array of one of the rooms that is put out: it is not written from here on.
    pub(super) fn seal(&self, bytes: &[u8], made_by: (u32, i64)) {
        let at = bytes.as_ptr() as usize;
        let mut state = self.state();
        if let Some(i) = state.large.iter().position(|room| room.range().contains(&at)) {
            let room = state.large.swap_remove(i);
            room.allow(0..room.bytes, libc::PROT_READ);
            rights::add_past(room.range(), made_by);
            state.past_large.push_back(room);
            if state.past_large.len() > KEPT {
                state.past_large.pop_front();
            }
        }
    }

    /// Ends a task: what it put out is not written from here on. What the plugin holds to put out later still is.
    pub(super) fn end(&self, made_by: (u32, i64)) {
        let mut state = self.state();
        state.large.retain(|room| Arc::strong_count(room) > 1);
        let mut has_made = false;
        for filled in state.small.iter_mut().filter(|filled| filled.used > filled.shut && filled.is_free()) {
            filled.shut(made_by);
            has_made = true;
        }
        if let Some(last) = state.small.back_mut().filter(|_| has_made) {
            last.tasks += 1;
        }
    }

    /// Gives the memory back of large arrays that have gone to the host; their addresses stay taken for a while.
    pub(super) fn empty(&self) {
        for room in self.state().past_large.iter().filter(|room| Arc::strong_count(room) == 1) {
            // SAFETY: the pages are ours, and nobody reads them any longer.
            unsafe { libc::madvise(room.pages.at as *mut libc::c_void, room.bytes, libc::MADV_DONTNEED) };
        }
    }
}

#[allow(clippy::arc_with_non_send_sync, reason = "it is both")]
fn shared(room: Room) -> Arc<Room> {
    Arc::new(room)
}

/// Fills the bytes behind an array, as many as there are up to a multiple of the alignment.
///
/// # Safety
/// They are there, and nobody else's.
#[cfg(target_os = "linux")]
pub(super) unsafe fn fill_behind(end: *mut u8, bytes: usize) {
    // SAFETY: as the caller says.
    unsafe { std::ptr::write_bytes(end, FILL, bytes.min(ALIGNED)) };
}

/// True where the bytes behind an array are not what they were; `room` are those that lie there.
///
/// # Safety
/// They are there.
pub(super) unsafe fn is_overrun(bytes: &[u8], room: usize) -> bool {
    // SAFETY: as the caller says.
    let behind = unsafe { std::slice::from_raw_parts(bytes.as_ptr().add(bytes.len()), room.min(ALIGNED)) };
    behind.iter().any(|b| *b != FILL)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(data: &Data) -> &[u8] {
        data.bytes()
    }

    #[test]
    fn what_lies_behind_an_array_is_looked_at() {
        let rooms = Rooms::default();
        for count in [1, 7, 8, 64, 1000, LARGE, LARGE + 3] {
            let (data, start) = rooms.array(DType::U8, count).unwrap();
            assert!(bytes(&data).iter().all(|b| *b == 0) && bytes(&data).len() == count && start.cast_const() == bytes(&data).as_ptr());
            // SAFETY: the array and the bytes behind it are there.
            unsafe {
                start.add(count - 1).write(7);
                assert!(!is_overrun(bytes(&data), ALIGNED), "{count}");
                start.add(count).write(7);
                assert!(is_overrun(bytes(&data), ALIGNED), "{count}");
            }
        }
        assert!(rooms.array(DType::F64, usize::MAX / 8).is_none());
    }

    #[test]
    fn rooms_are_used_again_after_a_while_and_hold_noughts() {
        let rooms = Rooms::default();
        let mut seen = Vec::new();
        let tasks = 8 * (KEPT + ROOM / super::super::page());
        for task in 0..tasks {
            let (data, start) = rooms.array(DType::F64, 5).unwrap();
            assert!(bytes(&data).iter().all(|b| *b == 0), "{task}");
            // SAFETY: the array is that long.
            unsafe { start.write(9) };
            let before = seen.iter().rev().position(|at| *at == start as usize);
            assert!(before.is_none_or(|before| before >= KEPT), "{task}");
            seen.push(start as usize);
            drop(data);
            rooms.end((0, task as i64));
        }
        seen.sort_unstable();
        seen.dedup();
        assert!(seen.len() < tasks / 2, "{}", seen.len());
        // What is held stays as it is, and can be written.
        let (held, start) = rooms.array(DType::U8, 3).unwrap();
        rooms.end((0, 0));
        // SAFETY: the array is that long.
        unsafe { start.write(3) };
        assert_eq!(bytes(&held), [3, 0, 0]);
    }
}
