//! The allocator of the `pegbar` program: large blocks are used again rather than given back to the system, and each thread counts what it allocates.
//!
//! Frames are large, all of one size, and made and dropped all the time. Given back to the system each would be unmapped, and its successor mapped,
//! faulted in page by page and zeroed, under a lock that all threads share: with two threads on 1080p frames that takes a third of all time. The few
//! blocks that are kept here count as a part of the memory budget.
#![allow(
    unsafe_code,
    reason = "an allocator is unsafe by its signature; what it hands out comes from the system's own, and is given back as it came"
)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Blocks below this are left to the system's allocator, which is good at them.
const LARGE: usize = 1 << 20;
/// Large blocks are rounded up to a multiple of this, so that those of nearly one size can stand in for each other.
const GRAIN: usize = 1 << 16;
/// Blocks kept at most.
const PLACES: usize = 64;

/// The allocator.
pub struct Pool;

static KEPT: Mutex<Kept> = Mutex::new(Kept { blocks: [(0, 0); PLACES], len: 0, bytes: 0 });
static MOST: AtomicUsize = AtomicUsize::new(64 << 20);

thread_local! {
    /// Bytes that this thread has allocated and not freed, and the most of it.
    static COUNT: Cell<(i64, i64)> = const { Cell::new((0, 0)) };
}

/// Free blocks: address and size. The oldest are given back first.
struct Kept {
    blocks: [(usize, usize); PLACES],
    len: usize,
    bytes: usize,
}

fn kept() -> MutexGuard<'static, Kept> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The layout of the block behind a large request.
fn block(layout: Layout) -> Layout {
    // Rounding up what is within the address space by a grain stays within it.
    Layout::from_size_align(layout.size().next_multiple_of(GRAIN), layout.align()).unwrap_or(layout)
}

fn is_large(layout: Layout) -> bool {
    layout.size() >= LARGE && layout.align() <= 4096
}

fn count(bytes: i64) {
    // A thread that is being taken down no longer counts.
    let _ = COUNT.try_with(|count| {
        let (live, most) = count.get();
        count.set((live + bytes, most.max(live + bytes)));
    });
}

impl Kept {
    /// Takes the newest block of a size.
    fn take(&mut self, size: usize) -> Option<usize> {
        let at = self.blocks[..self.len].iter().rposition(|(_, s)| *s == size)?;
        let (address, _) = self.blocks[at];
        self.remove(at);
        Some(address)
    }

    fn remove(&mut self, at: usize) {
        self.bytes -= self.blocks[at].1;
        self.blocks.copy_within(at + 1..self.len, at);
        self.len -= 1;
    }

    /// Takes the oldest block out where there are more bytes than `most`, or no place.
    fn excess(&mut self, most: usize) -> Option<(usize, usize)> {
        if self.bytes <= most && self.len < PLACES {
            return None;
        }
        let oldest = self.blocks[..self.len].first().copied()?;
        self.remove(0);
        Some(oldest)
    }

    fn put(&mut self, address: usize, size: usize) {
        self.blocks[self.len] = (address, size);
        self.len += 1;
        self.bytes += size;
    }
}

/// Bytes of free blocks that are kept at most; what is beyond goes back to the system.
pub(crate) fn keep_at_most(bytes: usize) {
    map_large_blocks();
    MOST.store(bytes, Ordering::Relaxed);
    give_back(bytes);
}

/// Runs `work`, and tells the most bytes that this thread had allocated meanwhile beyond what it had before.
pub(crate) fn measure(work: &mut dyn FnMut()) -> u64 {
    let (live, most) = COUNT.replace((0, 0));
    work();
    let (more, peak) = COUNT.get();
    COUNT.set((live + more, most.max(live + peak)));
    u64::try_from(peak).unwrap_or(0)
}

/// Has large blocks mapped each by itself, so that what is freed is gone. The GNU allocator else takes them from its heaps once it has seen some, and a
/// heap with one live block in it keeps all the others: a run within 400 MB was seen to hold 1.3 GB.
fn map_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it sets a number of the allocator.
    let _ = unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 18) };
}

fn give_back(most: usize) {
    while let Some((address, size)) = { kept().excess(most) } {
        free(address, size);
    }
}

fn free(address: usize, size: usize) {
    #[cfg(target_os = "linux")]
    // SAFETY: every block that comes here is nobody's now.
    if unsafe { pegbar_engine::plugin::arena::free(address as *mut u8, size) } {
        return;
    }
    if let Ok(layout) = Layout::from_size_align(size, 4096) {
        // SAFETY: every block that is kept was allocated by `System` with this size and alignment, and is nobody's now.
        unsafe { System.dealloc(address as *mut u8, layout) };
    }
}

/// The layout with which a large block is asked of the system: always page-aligned, so that any block can stand in for any other of its size.
fn system(layout: Layout) -> Layout {
    block(layout).align_to(4096).unwrap_or(layout)
}

// SAFETY: small requests go to `System` as they are. Large ones are met by blocks of `system(layout)`, which is at least as large and as aligned; the
// same function of the same layout says what they are when they come back.
unsafe impl GlobalAlloc for Pool {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        if !is_large(layout) {
            // SAFETY: the caller's promise is handed on.
            return unsafe { System.alloc(layout) };
        }
        let layout = system(layout);
        let found = kept().take(layout.size());
        match found {
            Some(address) => address as *mut u8,
            // SAFETY: the size is not nought.
            None => fresh(layout, |layout| unsafe { System.alloc(layout) }),
        }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if is_large(layout) {
            let found = kept().take(system(layout).size());
            if let Some(address) = found {
                count(layout.size() as i64);
                // SAFETY: the block has that many bytes, and is ours alone.
                unsafe { std::ptr::write_bytes(address as *mut u8, 0, layout.size()) };
                return address as *mut u8;
            }
        }
        count(layout.size() as i64);
        if !is_large(layout) {
            // SAFETY: the caller's promise is handed on.
            return unsafe { System.alloc_zeroed(layout) };
        }
        // SAFETY: a rounded size is not nought.
        fresh(system(layout), |layout| unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn dealloc(&self, address: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        if !is_large(layout) {
            // SAFETY: the caller's promise is handed on.
            return unsafe { System.dealloc(address, layout) };
        }
        let size = system(layout).size();
        let most = MOST.load(Ordering::Relaxed);
        if size > most {
            return free(address as usize, size);
        }
        give_back(most - size);
        kept().put_or(address as usize, size);
    }

    unsafe fn realloc(&self, address: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count(new_size as i64 - layout.size() as i64);
        let Ok(new) = Layout::from_size_align(new_size, layout.align()) else { return std::ptr::null_mut() };
        if is_large(layout) == is_large(new) {
            let (old, size) = if is_large(layout) { (system(layout), system(new).size()) } else { (layout, new_size) };
            if !is_shared(address, old.size()) {
                // SAFETY: the block was allocated with this layout.
                return unsafe { System.realloc(address, old, size) };
            }
        }
        count(layout.size() as i64 - new_size as i64);
        // SAFETY: the caller's promise is handed on.
        unsafe { self.moved(address, layout, new) }
    }
}

impl Pool {
    /// The block's content in another.
    ///
    /// # Safety
    /// As of `realloc`.
    unsafe fn moved(&self, address: *mut u8, layout: Layout, new: Layout) -> *mut u8 {
        // SAFETY: both layouts are sound, and the two blocks are two.
        unsafe {
            let moved = self.alloc(new);
            if !moved.is_null() {
                std::ptr::copy_nonoverlapping(address, moved, layout.size().min(new.size()));
                self.dealloc(address, layout);
            }
            moved
        }
    }
}

/// A large block that nobody had: where plugins have processes of their own it lies where they can see it, and holds noughts.
fn fresh(layout: Layout, otherwise: impl FnOnce(Layout) -> *mut u8) -> *mut u8 {
    #[cfg(target_os = "linux")]
    {
        let shared = pegbar_engine::plugin::arena::allocate(layout.size());
        if !shared.is_null() {
            return shared;
        }
    }
    otherwise(layout)
}

/// True for a block that processes of plugins can see.
fn is_shared(address: *mut u8, size: usize) -> bool {
    #[cfg(target_os = "linux")]
    return pegbar_engine::plugin::arena::offset(address, size).is_some();
    #[cfg(not(target_os = "linux"))]
    false
}

impl Kept {
    /// Puts a block there, or frees it where another thread took the last place meanwhile.
    fn put_or(&mut self, address: usize, size: usize) {
        if self.len < PLACES { self.put(address, size) } else { free(address, size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_used_again_and_zeroed_where_that_is_asked() {
        let layout = Layout::from_size_align(LARGE + 12345, 16).unwrap();
        // SAFETY: the size is not nought, the block is written within its bounds, and freed once with its layout.
        unsafe {
            let first = Pool.alloc(layout);
            first.write_bytes(7, layout.size());
            Pool.dealloc(first, layout);
            let second = Pool.alloc_zeroed(layout);
            assert!(std::slice::from_raw_parts(second, layout.size()).iter().all(|b| *b == 0));
            let third = Pool.realloc(second, layout, 3 * LARGE);
            third.add(3 * LARGE - 1).write(1);
            let small = Pool.realloc(third, Layout::from_size_align(3 * LARGE, 16).unwrap(), 100);
            assert!(std::slice::from_raw_parts(small, 100).iter().all(|b| *b == 0));
            Pool.dealloc(small, Layout::from_size_align(100, 16).unwrap());
        }
        assert!(kept().bytes <= MOST.load(Ordering::Relaxed));
    }

    #[test]
    fn what_a_thread_allocates_is_counted() {
        let layout = Layout::from_size_align(1000, 8).unwrap();
        let most = measure(&mut || {
            // SAFETY: the size is not nought, and each block is freed once with its layout.
            unsafe {
                let one = Pool.alloc(layout);
                let other = Pool.alloc(layout);
                Pool.dealloc(one, layout);
                Pool.dealloc(other, layout);
                Pool.dealloc(Pool.alloc(layout), layout);
            }
        });
        assert_eq!(most, 2000);
    }

    #[test]
    fn what_is_kept_stays_within_its_bound() {
        let layout = Layout::from_size_align(5 * LARGE, 16).unwrap();
        // SAFETY: as above.
        unsafe {
            let blocks: Vec<*mut u8> = (0..20).map(|_| Pool.alloc(layout)).collect();
            blocks.into_iter().for_each(|b| Pool.dealloc(b, layout));
        }
        assert!(kept().bytes <= MOST.load(Ordering::Relaxed));
    }
}
