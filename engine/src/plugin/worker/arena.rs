//! Memory that a host and the processes of its plugins share: large arrays lie in it, and are neither copied in nor out.
//!
//! One file without a name, larger than anything that could lie in it, of which only what is used takes memory. A host maps it once. A worker maps it
//! twice: to be read, which is where inputs are looked at, and to be written, where nothing can be reached but the outputs that it was given. Between two
//! blocks lies a gap that nobody maps, so that running over the end of one does not reach the next.
//!
//! A program whose allocator asks here for its large blocks ([`allocate`]) passes its values on as they are. What is called from there allocates nothing.

use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};

use super::fail;
use crate::array::{Bytes, DType, Data, Shared};

/// Bytes of address space.
pub(super) const SPAN: usize = 1 << 42;
/// Blocks begin at multiples of this, which is a multiple of every system's page.
const GRAIN: usize = 1 << 16;
/// The smallest block.
const SMALLEST: usize = 4 * GRAIN;
/// Sizes of blocks: four to each doubling, up to 2^39 bytes.
const SIZES: usize = 4 * 22;
/// Free blocks of a size that are remembered; the addresses of others are not used again.
const PLACES: usize = 256;

static BASE: AtomicUsize = AtomicUsize::new(0);
static FILE: AtomicI32 = AtomicI32::new(-1);
/// Bytes in use, and how many there may be.
static LIVE: AtomicU64 = AtomicU64::new(0);
static MOST: AtomicU64 = AtomicU64::new(0);

struct Free {
    /// In grains.
    next: u32,
    blocks: [[u32; PLACES]; SIZES],
    count: [u16; SIZES],
}

static FREE: Mutex<Free> = Mutex::new(Free { next: 1, blocks: [[0; PLACES]; SIZES], count: [0; SIZES] });

fn free_blocks() -> MutexGuard<'static, Free> {
    FREE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes the memory, where it is not there. False where the system has none.
pub(super) fn start() -> bool {
    static STARTED: Once = Once::new();
    STARTED.call_once(|| {
        let Ok(file) = memory_file(c"pegbar-arrays", SPAN) else { return };
        let Ok(base) = map(file.as_raw_fd(), SPAN, libc::PROT_READ | libc::PROT_WRITE) else { return };
        // SAFETY: advice on a mapping of ours.
        unsafe { libc::madvise(base as *mut libc::c_void, SPAN, libc::MADV_DONTDUMP) };
        MOST.store(super::half_of_memory().saturating_mul(2), Ordering::Relaxed);
        FILE.store(std::os::fd::IntoRawFd::into_raw_fd(file), Ordering::Release);
        BASE.store(base, Ordering::Release);
    });
    BASE.load(Ordering::Acquire) != 0
}

/// The file, to be handed to a worker.
pub(super) fn file() -> std::io::Result<OwnedFd> {
    let file = FILE.load(Ordering::Acquire);
    if file < 0 {
        return Err(std::io::Error::from(std::io::ErrorKind::Unsupported));
    }
    // SAFETY: the file is open for as long as the process lives.
    unsafe { BorrowedFd::borrow_raw(file) }.try_clone_to_owned()
}

/// A file in memory, without a name.
pub(super) fn memory_file(name: &std::ffi::CStr, bytes: usize) -> std::io::Result<OwnedFd> {
    // SAFETY: the name is a text that ends with a nought; what comes back is ours.
    let file = unsafe {
        let file = libc::memfd_create(name.as_ptr(), libc::MFD_CLOEXEC);
        if file < 0 {
            return Err(fail());
        }
        OwnedFd::from_raw_fd(file)
    };
    // SAFETY: the file is ours.
    if unsafe { libc::ftruncate(file.as_raw_fd(), bytes as libc::off_t) } != 0 {
        return Err(fail());
    }
    Ok(file)
}

/// Maps the beginning of a file, for as long as the process lives or until it is unmapped.
pub(super) fn map(file: RawFd, bytes: usize, rights: libc::c_int) -> std::io::Result<usize> {
    // SAFETY: a new mapping, where the system wants it.
    let at = unsafe { libc::mmap(std::ptr::null_mut(), bytes, rights, libc::MAP_SHARED | libc::MAP_NORESERVE, file, 0) };
    if at == libc::MAP_FAILED { Err(fail()) } else { Ok(at as usize) }
}

/// Which size a block of `bytes` has, and how many grains lie from one to the next; `None` for one that is too large.
fn size_of_block(bytes: usize) -> Option<(usize, u32)> {
    let bytes = bytes.clamp(SMALLEST, SPAN);
    let doublings = ((bytes - 1) / SMALLEST).checked_ilog2().map_or(0, |d| d + 1) as usize;
    // The quarter below the doubling that `bytes` fits into.
    let below = if doublings == 0 { SMALLEST / 2 } else { SMALLEST << (doublings - 1) };
    let quarter = below / 4;
    let steps = (bytes - below).div_ceil(quarter);
    let size = doublings * 4 + steps - 1;
    let grains = (below + steps * quarter).div_ceil(GRAIN) + 1;
    (size < SIZES).then_some(u32::try_from(grains).ok().map(|grains| (size, grains)))?
}

/// A block of noughts; null where there is none, or no plugin has a process.
pub fn allocate(bytes: usize) -> *mut u8 {
    let base = BASE.load(Ordering::Acquire);
    let Some((size, grains)) = size_of_block(bytes).filter(|_| base != 0) else { return std::ptr::null_mut() };
    let live = LIVE.fetch_add(bytes as u64, Ordering::Relaxed);
    if live.saturating_add(bytes as u64) > MOST.load(Ordering::Relaxed) {
        LIVE.fetch_sub(bytes as u64, Ordering::Relaxed);
        return std::ptr::null_mut();
    }
    let mut free = free_blocks();
    let at = match free.count[size] {
        0 if free.next as usize + grains as usize > SPAN / GRAIN => {
            LIVE.fetch_sub(bytes as u64, Ordering::Relaxed);
            return std::ptr::null_mut();
        }
        0 => {
            free.next += grains;
            free.next - grains
        }
        count => {
            free.count[size] = count - 1;
            free.blocks[size][usize::from(count) - 1]
        }
    };
    (base + at as usize * GRAIN) as *mut u8
}

/// Gives a block back that [`allocate`] gave for so many bytes; false where it is none.
///
/// # Safety
/// Nobody uses it any longer.
pub unsafe fn free(at: *mut u8, bytes: usize) -> bool {
    let Some(offset) = offset(at, bytes) else { return false };
    // SAFETY: the file is ours; nobody has the block any longer. What cannot be given back takes memory and does no other harm, but would not be noughts.
    let emptied = unsafe {
        let how = libc::FALLOC_FL_PUNCH_HOLE | libc::FALLOC_FL_KEEP_SIZE;
        libc::fallocate(FILE.load(Ordering::Acquire), how, offset as libc::off_t, bytes.next_multiple_of(GRAIN) as libc::off_t) == 0
    };
    LIVE.fetch_sub(bytes as u64, Ordering::Relaxed);
    if let Some((size, _)) = size_of_block(bytes).filter(|_| emptied) {
        let mut free = free_blocks();
        let count = free.count[size];
        if usize::from(count) < PLACES {
            free.blocks[size][usize::from(count)] = (offset as usize / GRAIN) as u32;
            free.count[size] = count + 1;
        }
    }
    true
}

/// Where bytes lie in the memory that is shared; `None` where they lie elsewhere.
pub fn offset(at: *const u8, bytes: usize) -> Option<u64> {
    let base = BASE.load(Ordering::Acquire);
    let offset = (at as usize).checked_sub(base).filter(|_| base != 0)?;
    (offset < SPAN && bytes <= SPAN - offset).then_some(offset as u64)
}

/// A block of a host whose own allocator does not ask here.
struct Block {
    at: usize,
    bytes: usize,
}

impl Bytes for Block {
    fn bytes(&self) -> &[u8] {
        // SAFETY: the block is as long as it says, and is this one's until it is dropped.
        unsafe { std::slice::from_raw_parts(self.at as *const u8, self.bytes) }
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        spare(self.at, self.bytes);
    }
}

/// Bytes of blocks that are kept to be used again.
const SPARE: usize = 256 << 20;

/// Blocks that are kept, whose pages are there already: address and bytes.
static SPARES: Mutex<Vec<(usize, usize)>> = Mutex::new(Vec::new());

fn spare(at: usize, bytes: usize) {
    let mut spares = SPARES.lock().unwrap_or_else(PoisonError::into_inner);
    spares.push((at, bytes));
    while spares.iter().map(|(_, bytes)| bytes).sum::<usize>() > SPARE {
        let (at, bytes) = spares.remove(0);
        // SAFETY: it was given up, and is given back once.
        unsafe { free(at as *mut u8, bytes) };
    }
}

fn block(bytes: usize, zeroed: bool) -> Option<Block> {
    let kept = {
        let mut spares = SPARES.lock().unwrap_or_else(PoisonError::into_inner);
        let at = spares.iter().rposition(|(_, b)| *b == bytes);
        at.map(|at| spares.remove(at).0)
    };
    if let Some(at) = kept {
        if zeroed {
            // SAFETY: the block is ours alone, and as long as that.
            unsafe { std::ptr::write_bytes(at as *mut u8, 0, bytes) };
        }
        return Some(Block { at, bytes });
    }
    let at = allocate(bytes);
    (!at.is_null()).then_some(Block { at: at as usize, bytes })
}

/// A copy of bytes in the memory that is shared, and where it lies; `None` where there is no more of it.
pub(super) fn copy(bytes: &[u8]) -> Option<(Arc<dyn Bytes>, u64)> {
    let block = block(bytes.len(), false)?;
    let offset = offset(block.at as *const u8, block.bytes)?;
    // SAFETY: the block is new, and as long as what is copied.
    unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), block.at as *mut u8, bytes.len()) };
    Some((Arc::new(block), offset))
}

/// A block into which small arrays are copied, one behind the other.
#[derive(Default)]
pub(super) struct Packed {
    block: Option<Arc<Block>>,
    used: usize,
}

impl Packed {
    /// Where an array begins.
    const ALIGNED: usize = 64;

    /// Copies bytes, of which there are fewer than a block has: what holds them, and where they lie. `None` where there is no more memory.
    pub(super) fn copy(&mut self, bytes: &[u8]) -> Option<(Arc<dyn Bytes>, u64)> {
        let block = match self.block.take() {
            // Nobody looks at what lies there any longer.
            Some(block) if Arc::strong_count(&block) == 1 => {
                self.used = 0;
                block
            }
            Some(block) if bytes.len() <= SMALLEST - self.used => block,
            // Whoever holds the last one lets it go.
            _ => {
                self.used = 0;
                Arc::new(block(SMALLEST, false)?)
            }
        };
        let at = block.at + self.used;
        // SAFETY: there is room behind what others look at, and nobody else writes there.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), at as *mut u8, bytes.len()) };
        self.used = (self.used + bytes.len()).next_multiple_of(Self::ALIGNED);
        let offset = offset(at as *const u8, bytes.len())?;
        Some((self.block.insert(block).clone(), offset))
    }
}

/// Memory of noughts for an array that a worker writes, and where it lies.
pub(super) fn output(dtype: DType, count: usize) -> Option<(Data, u64)> {
    let bytes = count.checked_mul(dtype.size())?;
    // Where the allocator of the program asks here, the elements are the program's own from the beginning.
    let own = Data::zeroed(dtype, count)?;
    let at = own.bytes().as_ptr();
    if let Some(offset) = offset(at, bytes).filter(|offset| offset % GRAIN as u64 == 0) {
        return Some((own, offset));
    }
    drop(own);
    let block = block(bytes, true)?;
    let offset = offset(block.at as *const u8, bytes)?;
    Some((Data::Shared(Shared::new(dtype, Arc::new(block))?), offset))
}

/// The memory as a worker sees it.
pub(super) struct Attached {
    read: usize,
    write: usize,
    /// Bytes that can be written, by where they begin.
    opened: Mutex<std::collections::BTreeMap<u64, usize>>,
}

impl Attached {
    pub(super) fn new(file: &OwnedFd) -> std::io::Result<Self> {
        let read = map(file.as_raw_fd(), SPAN, libc::PROT_READ)?;
        let write = map(file.as_raw_fd(), SPAN, libc::PROT_NONE)?;
        for at in [read, write] {
            // SAFETY: advice on a mapping of ours.
            unsafe { libc::madvise(at as *mut libc::c_void, SPAN, libc::MADV_DONTDUMP) };
        }
        Ok(Self { read, write, opened: Mutex::default() })
    }

    /// Where inputs lie.
    pub(super) fn inputs(&self) -> std::ops::Range<usize> {
        self.read..self.read + SPAN
    }

    /// Bytes of an input; `None` where none can lie.
    pub(super) fn input(&self, offset: u64, bytes: usize) -> Option<Seen> {
        within(offset, bytes).then(|| Seen { at: self.read + offset as usize, bytes })
    }

    /// Bytes of an output, which can be written from here on.
    pub(super) fn output(&self, offset: u64, bytes: usize) -> Option<*mut u8> {
        if !within(offset, bytes) {
            return None;
        }
        let at = (self.write + offset as usize) as *mut u8;
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let known = opened.entry(offset).or_insert(0);
        if *known < bytes {
            // SAFETY: the pages are of a mapping of ours. Those behind the block's last byte are the block's, too.
            let done = unsafe { libc::mprotect(at.cast(), bytes, libc::PROT_READ | libc::PROT_WRITE) };
            if done != 0 {
                return None;
            }
            *known = bytes;
        }
        // SAFETY: what lies behind it up to the end of its last page is the block's, and nobody else's.
        unsafe { super::rooms::fill_behind(at.add(bytes), behind(bytes)) };
        Some(at)
    }

    /// Ends the writing of an output. True where more was written than it has.
    pub(super) fn close(&self, offset: u64, bytes: &[u8], made_by: (u32, i64)) -> bool {
        let from = self.write + offset as usize;
        self.opened.lock().unwrap_or_else(PoisonError::into_inner).remove(&offset);
        for at in fences(bytes.len()) {
            let fence = FENCE.min(bytes.len() - at);
            // SAFETY: the pages are of a mapping of ours.
            unsafe { libc::mprotect((from + at) as *mut libc::c_void, fence, libc::PROT_READ) };
        }
        // SAFETY: what lies behind it is there.
        let is_overrun = unsafe { super::rooms::is_overrun(bytes, behind(bytes.len())) };
        super::rights::add_past(from..from + bytes.len().next_multiple_of(super::page()), made_by);
        is_overrun
    }
}

/// Bytes of a block that are shut once it was put out, in one piece.
const FENCE: usize = GRAIN;
/// How many of them a block has at most. To shut all of a picture, and open all of it for the next, takes a seventh of a filter's time.
const FENCES: usize = 16;

/// Where the fences of a block begin: all of a small one, the beginning and the end of a large one and pieces between.
fn fences(bytes: usize) -> impl Iterator<Item = usize> {
    let pieces = bytes.div_ceil(FENCE);
    let count = pieces.min(FENCES);
    (0..count).map(move |i| if count < 2 { 0 } else { i * (pieces - 1) / (count - 1) * FENCE })
}

/// Bytes between the end of a block and that of its last page.
fn behind(bytes: usize) -> usize {
    bytes.next_multiple_of(super::page()) - bytes
}

impl Attached {
    /// Which block begins where these bytes do; `None` where they lie elsewhere.
    pub(super) fn output_at(&self, bytes: &[u8]) -> Option<u64> {
        let at = (bytes.as_ptr() as usize).checked_sub(self.write)?;
        (at < SPAN).then_some(at as u64)
    }
}

fn within(offset: u64, bytes: usize) -> bool {
    offset <= SPAN as u64 && bytes <= SPAN - offset as usize
}

/// Bytes of an input as a worker sees them.
pub(super) struct Seen {
    at: usize,
    bytes: usize,
}

impl Bytes for Seen {
    fn bytes(&self) -> &[u8] {
        // SAFETY: they lie within a mapping that is there as long as the process; the host leaves them as they are for as long as this is held.
        unsafe { std::slice::from_raw_parts(self.at as *const u8, self.bytes) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fences_shut_small_blocks_and_both_ends_of_large_ones() {
        for bytes in [1, FENCE, FENCE + 1, FENCES * FENCE] {
            let all: Vec<usize> = (0..bytes.div_ceil(FENCE)).map(|i| i * FENCE).collect();
            assert_eq!(fences(bytes).collect::<Vec<_>>(), all);
        }
        let large: Vec<usize> = fences(1000 * FENCE + 5).collect();
        assert_eq!((large[0], large[FENCES - 1], large.len()), (0, 1000 * FENCE, FENCES));
        assert!(large.windows(2).all(|pair| pair[1] - pair[0] > 60 * FENCE));
    }

    #[test]
    fn sizes_grow_by_quarters_and_leave_a_gap() {
        let mut last = 0;
        for bytes in (1..400).map(|n| n * 50_000) {
            let (size, grains) = size_of_block(bytes).unwrap();
            assert!(size >= last && (grains as usize - 1) * GRAIN >= bytes, "{bytes}");
            assert!(bytes <= SMALLEST || (grains as usize - 1) * GRAIN <= bytes + bytes / 4 + GRAIN, "{bytes}: {grains}");
            assert_eq!(size_of_block((grains as usize - 1) * GRAIN).map(|(s, _)| s), Some(size), "{bytes}");
            last = size;
        }
        assert!(size_of_block(1 << 41).is_none());
    }

    #[test]
    fn small_arrays_are_packed_and_stay_for_as_long_as_they_are_held() {
        assert!(start());
        let worker = Attached::new(&file().unwrap()).unwrap();
        let mut packed = Packed::default();
        let (first, at) = packed.copy(&[1; 100]).unwrap();
        let (second, next) = packed.copy(&[2; 3]).unwrap();
        assert_eq!(next, at + 128);
        for n in 0..2 * SMALLEST / 1000 {
            let (_copy, at) = packed.copy(&[n as u8; 1000]).unwrap();
            assert!(worker.input(at, 1000).unwrap().bytes().iter().all(|b| *b == n as u8), "{n}");
        }
        assert_eq!((worker.input(at, 100).unwrap().bytes(), worker.input(next, 3).unwrap().bytes()), (&[1; 100][..], &[2; 3][..]));
        drop((first, second));
        let (held, at) = packed.copy(&[3; 5]).unwrap();
        drop(held);
        assert_eq!(packed.copy(&[4; 5]).unwrap().1, at);
    }

    #[test]
    fn what_a_worker_may_write_is_what_the_host_reads() {
        assert!(start());
        let worker = Attached::new(&file().unwrap()).unwrap();
        let (data, at) = output(DType::F64, 100_000).unwrap();
        assert!(data.bytes().iter().all(|b| *b == 0));
        let to = worker.output(at, 800_000).unwrap();
        // SAFETY: the block is that long, and nobody reads it now.
        unsafe { to.cast::<f64>().add(7).write(2.5) };
        let Data::Shared(shared) = &data else { panic!("{data:?}") };
        assert_eq!(bytemuck::cast_slice::<u8, f64>(shared.bytes())[7], 2.5);
        let (_copy, at) = copy(shared.bytes()).unwrap();
        assert_eq!(worker.input(at, 800_000).unwrap().bytes(), shared.bytes());
        drop(data);
        let (again, _) = output(DType::F64, 100_000).unwrap();
        assert!(again.bytes().iter().all(|b| *b == 0));
        assert!(worker.input(SPAN as u64, 1).is_none() && allocate(usize::MAX).is_null());
    }
}
