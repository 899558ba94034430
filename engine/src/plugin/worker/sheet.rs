//! Inputs of a task that came in or behind a message: copied into pages that cannot be written while the plugin runs.

use std::sync::{Arc, Mutex, PoisonError};

use super::fail;
use crate::array::Bytes;

/// Where an array begins.
const ALIGNED: usize = 64;
/// Sheets that are kept to be used again.
const KEPT: usize = 8;

/// Pages of this process alone.
pub(super) struct Pages {
    pub(super) at: usize,
    bytes: usize,
}

impl Pages {
    pub(super) fn new(bytes: usize) -> std::io::Result<Self> {
        let rights = libc::PROT_READ | libc::PROT_WRITE;
        // SAFETY: a new mapping, where the system wants it.
        let at = unsafe { libc::mmap(std::ptr::null_mut(), bytes, rights, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS, -1, 0) };
        if at == libc::MAP_FAILED { Err(fail()) } else { Ok(Self { at: at as usize, bytes }) }
    }

    fn allow(&self, rights: libc::c_int) {
        // SAFETY: the pages are ours.
        unsafe { libc::mprotect(self.at as *mut libc::c_void, self.bytes, rights) };
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        // SAFETY: nobody looks at them any longer.
        unsafe { libc::munmap(self.at as *mut libc::c_void, self.bytes) };
    }
}

/// Pages that are being filled, or are sealed.
pub(super) struct Sheet {
    pages: Arc<Pages>,
    used: usize,
}

/// Bytes on a sheet.
struct Piece {
    pages: Arc<Pages>,
    from: usize,
    bytes: usize,
}

impl Bytes for Piece {
    fn bytes(&self) -> &[u8] {
        // SAFETY: they lie within the pages, which are held, and are not written once they are sealed.
        unsafe { std::slice::from_raw_parts((self.pages.at + self.from) as *const u8, self.bytes) }
    }
}

impl Sheet {
    /// A sheet for one array of so many bytes.
    pub(super) fn new(bytes: usize) -> Option<Self> {
        #[allow(clippy::arc_with_non_send_sync, reason = "it is both")]
        let pages = Arc::new(Pages::new(bytes.max(1)).ok()?);
        Some(Self { pages, used: bytes })
    }

    /// The bytes of that array, to be filled.
    pub(super) fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: the pages are as many, can be written, and nobody else has them yet.
        unsafe { std::slice::from_raw_parts_mut(self.pages.at as *mut u8, self.used) }
    }

    /// That array, which can be read alone from here on.
    pub(super) fn whole(self) -> Arc<dyn Bytes> {
        self.seal();
        Arc::new(Piece { pages: self.pages, from: 0, bytes: self.used })
    }

    /// Copies bytes onto it; `None` where there is no room.
    pub(super) fn add(&mut self, bytes: &[u8]) -> Option<Arc<dyn Bytes>> {
        let (from, end) = (self.used, self.used.checked_add(bytes.len())?);
        if end > self.pages.bytes {
            return None;
        }
        // SAFETY: there is room, nobody else has the sheet while it is filled, and its pages can be written.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), (self.pages.at + from) as *mut u8, bytes.len()) };
        self.used = end.next_multiple_of(ALIGNED);
        Some(Arc::new(Piece { pages: self.pages.clone(), from, bytes: bytes.len() }))
    }

    /// From here on it can be read alone.
    pub(super) fn seal(&self) {
        if self.used > 0 {
            self.pages.allow(libc::PROT_READ);
        }
    }

    /// Where it lies.
    pub(super) fn range(&self) -> std::ops::Range<usize> {
        self.pages.at..self.pages.at + self.pages.bytes
    }
}

/// Sheets to be used again.
#[derive(Default)]
pub(super) struct Sheets(Mutex<Vec<Sheet>>);

impl Sheets {
    /// A sheet for what is in a message of so many bytes.
    pub(super) fn take(&self, message: usize) -> Option<Sheet> {
        // Each array takes more bytes in a message than what it may be moved by, to be aligned.
        let bytes = (3 * message).next_multiple_of(1 << 14);
        let kept = {
            let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let at = kept.iter().position(|sheet| sheet.pages.bytes >= bytes && Arc::strong_count(&sheet.pages) == 1);
            at.map(|at| kept.swap_remove(at))
        };
        if let Some(kept) = kept {
            if kept.used > 0 {
                kept.pages.allow(libc::PROT_READ | libc::PROT_WRITE);
            }
            return Some(Sheet { pages: kept.pages, used: 0 });
        }
        #[allow(clippy::arc_with_non_send_sync, reason = "it is both")]
        let pages = Arc::new(Pages::new(bytes.max(1 << 14)).ok()?);
        Some(Sheet { pages, used: 0 })
    }

    /// Puts a sheet by, to be used again once nobody looks at it; of many the oldest are let go of.
    pub(super) fn put(&self, sheet: Sheet) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT {
            kept.remove(0);
        }
        kept.push(sheet);
    }
}
