//! Memory that shows who reaches beyond it or comes back to it, and how much memory is in use.
#![allow(unsafe_code, reason = "maps pages and takes the right to touch them away; each block says what it relies on")]

/// True where memory can be guarded here.
pub(super) const GUARDS: bool = cfg!(target_os = "linux");

/// Bytes that this process has taken from the C library and not given back; `None` where that cannot be asked.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(super) fn in_use() -> Option<u64> {
    // SAFETY: it reads the allocator's own counts, under its locks.
    let info = unsafe { libc::mallinfo2() };
    Some((info.uordblks + info.hblkhd) as u64)
}

/// As above.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn in_use() -> Option<u64> {
    None
}

#[cfg(target_os = "linux")]
pub(super) use linux::guarded;

/// As it is.
#[cfg(not(target_os = "linux"))]
pub(super) fn guarded(array: crate::array::Array) -> Option<crate::array::Array> {
    Some(array)
}

#[cfg(target_os = "linux")]
mod linux {
    use std::ptr::NonNull;
    use std::sync::Arc;

    use crate::array::{Array, Bytes, Data, Shared};

    /// Bytes at the very end of their pages, read-only, with a page before and behind that nobody may touch. Once it is dropped nobody may touch it either;
    /// the addresses are never used again, so that whoever comes back to them is seen.
    struct Guarded {
        pages: NonNull<u8>,
        /// Bytes of all pages.
        all: usize,
        start: usize,
        len: usize,
    }

    // SAFETY: the bytes are written before it is shared, and never again.
    unsafe impl Send for Guarded {}
    // SAFETY: as above.
    unsafe impl Sync for Guarded {}

    impl Guarded {
        fn new(bytes: &[u8]) -> Option<Self> {
            // SAFETY: it asks for a number.
            let page = usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).ok()?;
            let within = bytes.len().max(1).next_multiple_of(page);
            let all = within + 2 * page;
            // SAFETY: new pages, wherever the system has place for them.
            let mapped = unsafe { libc::mmap(std::ptr::null_mut(), all, libc::PROT_NONE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS, -1, 0) };
            if mapped == libc::MAP_FAILED {
                return None;
            }
            let pages = NonNull::new(mapped.cast::<u8>())?;
            let start = page + within - bytes.len();
            // SAFETY: the pages between the first and the last were mapped above, and nobody else has them; what is written lies within them.
            unsafe {
                let inner = pages.as_ptr().add(page).cast();
                if libc::mprotect(inner, within, libc::PROT_READ | libc::PROT_WRITE) != 0 {
                    return None;
                }
                std::ptr::copy_nonoverlapping(bytes.as_ptr(), pages.as_ptr().add(start), bytes.len());
                if libc::mprotect(inner, within, libc::PROT_READ) != 0 {
                    return None;
                }
            }
            Some(Self { pages, all, start, len: bytes.len() })
        }
    }

    impl Bytes for Guarded {
        fn bytes(&self) -> &[u8] {
            // SAFETY: they were written when it was made, and stay readable until it is dropped.
            unsafe { std::slice::from_raw_parts(self.pages.as_ptr().add(self.start), self.len) }
        }
    }

    impl Drop for Guarded {
        fn drop(&mut self) {
            // SAFETY: the pages are this one's; without rights they stay mapped, so that nothing else comes to lie there.
            unsafe {
                libc::madvise(self.pages.as_ptr().cast(), self.all, libc::MADV_DONTNEED);
                libc::mprotect(self.pages.as_ptr().cast(), self.all, libc::PROT_NONE);
            }
        }
    }

    /// The array in guarded memory; `None` where there is none.
    pub(in super::super) fn guarded(array: Array) -> Option<Array> {
        let view = array.view();
        let data = Shared::new(view.dtype, Arc::new(Guarded::new(view.bytes)?))?;
        Some(Array { shape: view.shape.to_vec(), data: Data::Shared(data) })
    }
}
