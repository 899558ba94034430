//! What a worker may do: less than the user who started it; and what it writes down where a signal ends it.

#[cfg(target_os = "linux")]
mod linux;

use std::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, AtomicUsize, Ordering};

#[cfg(target_os = "linux")]
pub(super) use linux::forget_errors;
#[cfg(target_os = "linux")]
pub(super) use linux::give_up;
#[cfg(target_os = "linux")]
use linux::{data_of_process, end_with_parent};

use super::fail;
use super::notes::{Near, Notes};
use super::pipe;

/// Ends this process when its host is gone. Where the system does not see to it, whoever listens to the host does.
pub(super) fn end_with(host: u32) -> bool {
    // SAFETY: asks for a number of this process.
    end_with_parent() && unsafe { libc::getppid() }.cast_unsigned() == host
}

#[cfg(not(target_os = "linux"))]
fn end_with_parent() -> bool {
    true
}

/// Nothing is known here that could be given up.
#[cfg(not(target_os = "linux"))]
pub(super) fn give_up(_writable: &[std::path::PathBuf]) {}

#[cfg(not(target_os = "linux"))]
fn data_of_process() -> u64 {
    0
}

/// Refuses memory beyond `most` bytes, and a quarter more, as whoever looks now and then should have seen it before. Leaves no core files.
pub(super) fn limit_memory(most: u64) {
    let limit = data_of_process().saturating_add(most);
    LIMIT.store(limit, Ordering::Relaxed);
    let most = limit.saturating_add(most / 4);
    let most = most as libc::rlim_t;
    let limit = libc::rlimit { rlim_cur: most, rlim_max: most };
    let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: lowers limits of this process.
    unsafe {
        libc::setrlimit(libc::RLIMIT_DATA, &raw const limit);
        libc::setrlimit(libc::RLIMIT_CORE, &raw const none);
    }
}

/// Bytes beyond which memory has run out.
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);

static NOTES: AtomicUsize = AtomicUsize::new(0);
/// Where inputs lie: first and last address, of the memory that is shared and of what came in messages.
static ALL_INPUTS: [AtomicUsize; 4] = [const { AtomicUsize::new(0) }; 4];

/// Where some of this task lie, and which they are.
struct Place {
    from: AtomicUsize,
    to: AtomicUsize,
    input: AtomicU32,
}

/// Arrays of inputs that are told from others; those of what has more are inputs, and no more is known.
const PLACES: usize = 256;
static PLACE: [Place; PLACES] = [const { Place { from: AtomicUsize::new(0), to: AtomicUsize::new(0), input: AtomicU32::new(0) } }; PLACES];
static PLACED: AtomicUsize = AtomicUsize::new(0);

/// Says where inputs lie, of one kind.
pub(super) fn set_inputs(kind: usize, range: std::ops::Range<usize>) {
    ALL_INPUTS[2 * kind].store(range.start, Ordering::Relaxed);
    ALL_INPUTS[2 * kind + 1].store(range.end, Ordering::Relaxed);
}

/// Says where an array of an input lies.
pub(super) fn add_input(bytes: &[u8], input: u32) {
    let at = PLACED.load(Ordering::Relaxed);
    if let Some(place) = PLACE.get(at).filter(|_| !bytes.is_empty()) {
        let from = bytes.as_ptr() as usize;
        place.from.store(from, Ordering::Relaxed);
        place.to.store(from + bytes.len(), Ordering::Relaxed);
        place.input.store(input, Ordering::Relaxed);
        PLACED.store(at + 1, Ordering::Relaxed);
    }
}

/// Before a task: it has inputs of its own.
pub(super) fn forget_inputs() {
    PLACED.store(0, Ordering::Relaxed);
}

/// Before a task: what the system refuses from here on, it refuses this.
#[cfg(not(target_os = "linux"))]
pub(super) fn forget_errors() {
    // SAFETY: closes nothing, which is refused for another reason than want of memory.
    unsafe { libc::close(-1) };
}

/// What was put out and may not be written any longer.
struct Past {
    from: AtomicUsize,
    to: AtomicUsize,
    node: AtomicU32,
    frame: AtomicI64,
}

/// As many as are remembered.
const PASTS: usize = 64;
static PAST: [Past; PASTS] =
    [const { Past { from: AtomicUsize::new(0), to: AtomicUsize::new(0), node: AtomicU32::new(0), frame: AtomicI64::new(0) } }; PASTS];
static PASSED: AtomicUsize = AtomicUsize::new(0);

/// Says that nobody may write there from here on, as it was put out by a node at a frame.
pub(super) fn add_past(range: std::ops::Range<usize>, (node, frame): (u32, i64)) {
    let past = &PAST[PASSED.fetch_add(1, Ordering::Relaxed) % PASTS];
    past.to.store(0, Ordering::Relaxed);
    past.node.store(node, Ordering::Relaxed);
    past.frame.store(frame, Ordering::Relaxed);
    past.from.store(range.start, Ordering::Relaxed);
    past.to.store(range.end, Ordering::Relaxed);
}

/// What an address is near. Does nothing but what a signal's handler may.
fn near(address: usize) -> Near {
    let load = |word: &AtomicUsize| word.load(Ordering::Relaxed);
    let placed = PLACE.iter().take(load(&PLACED)).find(|place| (load(&place.from)..load(&place.to)).contains(&address));
    if let Some(place) = placed {
        return Near::Input(Some(place.input.load(Ordering::Relaxed)));
    }
    if ALL_INPUTS.as_chunks::<2>().0.iter().any(|[from, to]| (load(from)..load(to)).contains(&address)) {
        return Near::Input(None);
    }
    let newest = load(&PASSED);
    let past = (1..=PASTS.min(newest)).map(|back| &PAST[(newest - back) % PASTS]);
    let mut past = past.filter(|past| (load(&past.from)..load(&past.to)).contains(&address));
    past.next().map_or(Near::Unknown, |past| Near::Late(past.node.load(Ordering::Relaxed), past.frame.load(Ordering::Relaxed)))
}

/// Writes down which signal ends this process, and at which address, for the host to say.
pub(super) fn note_signals(notes: &'static Notes) {
    NOTES.store(std::ptr::from_ref(notes) as usize, Ordering::Release);
    for signal in [libc::SIGSEGV, libc::SIGBUS, libc::SIGABRT, libc::SIGFPE, libc::SIGILL] {
        // SAFETY: the handler does nothing but what a handler may.
        unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = note as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigaction(signal, &raw const action, std::ptr::null_mut());
        }
    }
}

extern "C" fn note(signal: libc::c_int, info: *mut libc::siginfo_t, _context: *mut libc::c_void) {
    /// Where nothing lies, and what is reached by way of null.
    const NOWHERE: usize = 1 << 16;
    // What the system refused last.
    let is_refused = fail().raw_os_error() == Some(libc::ENOMEM);
    // SAFETY: the system hands over what it knows; the page is there as long as the process; atomic writes, `send` and `signal` are what a handler may do.
    unsafe {
        let has_address = signal == libc::SIGSEGV || signal == libc::SIGBUS;
        let address = if has_address { (*info).si_addr() as usize } else { 0 };
        let found = if has_address { near(address) } else { Near::Unknown };
        let gave_up = signal == libc::SIGABRT || has_address && address < NOWHERE;
        if let Some(notes) = (NOTES.load(Ordering::Acquire) as *const Notes).as_ref() {
            notes.address.store(address as u64, Ordering::Relaxed);
            let is_out = data_of_process() > LIMIT.load(Ordering::Relaxed);
            notes.set_near(match found {
                _ if is_out => Near::Memory,
                Near::Unknown if is_refused && gave_up => Near::Refused,
                found => found,
            });
            notes.signal.store(signal as u32, Ordering::Release);
            pipe::send_notes(notes);
        }
        // What was at fault is at fault again, and ends the process as it would have.
        libc::signal(signal, libc::SIG_DFL);
    }
}
