//! Memory of a worker's outputs: pages that can be written while their task runs, and can be read alone once it has ended, so that whoever comes back to
//! them is found out. Behind each array lie bytes that nobody may change, and behind each room a page that is not there.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::message::LARGE;
use super::sheet::Pages;
use super::{fail, rights};
use crate::array::{Bytes, DType, Data, Shared};

/// Bytes of a room for small arrays.
const ROOM: usize = 1 << 18;
/// Where an array begins, and how many bytes at least lie behind it.
const ALIGNED: usize = 64;
/// What these are.
const FILL: u8 = 0xa5;
/// Rooms that are kept as they are, for whoever comes back to them.
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

    fn allow(&self, rights: libc::c_int) {
        // SAFETY: the pages are ours.
        unsafe { libc::mprotect(self.pages.at as *mut libc::c_void, self.bytes, rights) };
    }

    fn range(&self) -> std::ops::Range<usize> {
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

#[derive(Default)]
struct State {
    /// The room for small arrays, and how much of it is used.
    open: Option<(Arc<Room>, usize)>,
    /// Rooms of one large array each that can be written.
    large: Vec<Arc<Room>>,
    /// Rooms of tasks that have ended, and how much of each they used.
    past: VecDeque<(Arc<Room>, usize)>,
    past_large: VecDeque<Arc<Room>>,
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
            let open = state.open.take().filter(|(room, used)| used + all <= room.bytes);
            let (room, used) = match open {
                Some(open) => open,
                None => (shared(Room::new(ROOM).ok()?), 0),
            };
            state.open = Some((room.clone(), used + all));
            (room, used)
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
            room.allow(libc::PROT_READ);
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
        let Some((room, used)) = state.open.take_if(|(room, used)| *used > 0 && Arc::strong_count(room) == 1) else { return };
        room.allow(libc::PROT_READ);
        rights::add_past(room.pages.at..room.pages.at + used, made_by);
        state.past.push_back((room, used));
        if state.past.len() > KEPT {
            state.open = state.past.pop_front().map(|(room, used)| {
                room.allow(libc::PROT_READ | libc::PROT_WRITE);
                // SAFETY: the room is nobody's, and can be written.
                unsafe { std::ptr::write_bytes(room.pages.at as *mut u8, 0, used) };
                (room, 0)
            });
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
        let mut seen = std::collections::BTreeSet::new();
        for task in 0..4 * KEPT as i64 {
            let (data, start) = rooms.array(DType::F64, 5).unwrap();
            assert!(bytes(&data).iter().all(|b| *b == 0), "{task}");
            // SAFETY: the array is that long.
            unsafe { start.write(9) };
            seen.insert(start as usize);
            drop(data);
            rooms.end((0, task));
        }
        assert_eq!(seen.len(), KEPT + 1);
        // What is held stays as it is, and can be written.
        let (held, start) = rooms.array(DType::U8, 3).unwrap();
        rooms.end((0, 0));
        // SAFETY: the array is that long.
        unsafe { start.write(3) };
        assert_eq!(bytes(&held), [3, 0, 0]);
    }
}
