//! The way of messages between a host and a worker: a page that says whose turn it is, and a buffer that both write in turn.
//!
//! Nothing that a worker wrote is trusted: lengths are held against the buffer, and what is read is copied out before it is looked at.

use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use super::arena::{map, memory_file};
use super::link::Broken;
use super::notes::Notes;

/// Bytes of the buffer; longer messages go in several pieces.
const BUFFER: usize = 1 << 18;
/// Where it begins.
const HEAD: usize = 1 << 16;
/// Looks at whose turn it is before going to sleep, some tens of microseconds long: to sleep, and to be woken, takes longer than most tasks of little work. Nothing is yielded between: on a busy machine that costs whole slices of time,
/// where whoever sleeps is woken at once.
const LOOKS: u32 = 1000;

const HOST: u32 = 1;
const WORKER: u32 = 2;

/// What the page holds.
#[repr(C)]
struct Control {
    notes: Notes,
    turn: AtomicU32,
    /// Not nought while somebody sleeps until it is their turn: of the host, of the worker.
    sleeps: [AtomicU32; 2],
    /// Not nought where another piece of the message follows.
    more: AtomicU32,
    length: AtomicU64,
}

/// One end.
pub(super) struct Lane {
    at: usize,
    is_host: bool,
}

impl Drop for Lane {
    fn drop(&mut self) {
        if self.is_host {
            // SAFETY: the mapping is this end's, and nobody uses it any longer.
            unsafe { libc::munmap(self.at as *mut libc::c_void, HEAD + BUFFER) };
        }
    }
}

impl Lane {
    /// A lane, and the file by which a worker comes to it.
    pub(super) fn new() -> std::io::Result<(Self, OwnedFd)> {
        let file = memory_file(c"pegbar-lane", HEAD + BUFFER)?;
        let lane = Self { at: map(file.as_raw_fd(), HEAD + BUFFER, libc::PROT_READ | libc::PROT_WRITE)?, is_host: true };
        lane.control().turn.store(HOST, Ordering::SeqCst);
        Ok((lane, file))
    }

    /// The worker's end.
    pub(super) fn attach(file: &OwnedFd) -> std::io::Result<Self> {
        Ok(Self { at: map(file.as_raw_fd(), HEAD + BUFFER, libc::PROT_READ | libc::PROT_WRITE)?, is_host: false })
    }

    pub(super) fn notes(&self) -> &Notes {
        &self.control().notes
    }

    fn control(&self) -> &Control {
        // SAFETY: the mapping begins with it, is aligned for it, and is there as long as the lane; all fields are atomic, and any bits are a value.
        unsafe { &*(self.at as *const Control) }
    }

    /// The page of a worker's end, which stays mapped for as long as the process.
    pub(super) fn forever(&self) -> &'static Notes {
        debug_assert!(!self.is_host);
        // SAFETY: as of `control`; a worker's end is never unmapped.
        unsafe { &(*(self.at as *const Control)).notes }
    }

    fn mine(&self) -> u32 {
        if self.is_host { HOST } else { WORKER }
    }

    /// Sends a message. `wait` is asked now and then whether to go on waiting.
    pub(super) fn send(&self, message: &[u8], wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        let mut pieces = message.chunks(BUFFER).peekable();
        let mut piece = pieces.next().unwrap_or_default();
        loop {
            // SAFETY: the buffer is that long, and it is this end's turn to write it.
            unsafe { std::ptr::copy_nonoverlapping(piece.as_ptr(), (self.at + HEAD) as *mut u8, piece.len()) };
            let control = self.control();
            control.length.store(piece.len() as u64, Ordering::Relaxed);
            control.more.store(u32::from(pieces.peek().is_some()), Ordering::Relaxed);
            self.pass();
            let Some(next) = pieces.next() else { return Ok(()) };
            self.await_turn(wait)?;
            piece = next;
        }
    }

    /// Receives a message of at most `most` bytes.
    pub(super) fn receive(&self, message: &mut Vec<u8>, most: usize, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        message.clear();
        loop {
            self.await_turn(wait)?;
            let control = self.control();
            let length = usize::try_from(control.length.load(Ordering::Relaxed)).unwrap_or(usize::MAX);
            if length > BUFFER || length > most - message.len() {
                return Err(Broken::Garbage);
            }
            let before = message.len();
            message.resize(before + length, 0);
            // SAFETY: the buffer is that long, and the message was made longer by as much. Whatever is written there meanwhile, bytes are bytes.
            unsafe { std::ptr::copy_nonoverlapping((self.at + HEAD) as *const u8, message.as_mut_ptr().add(before), length) };
            if control.more.load(Ordering::Relaxed) == 0 {
                return Ok(());
            }
            self.pass();
        }
    }

    /// Hands the turn over.
    fn pass(&self) {
        let theirs = if self.is_host { WORKER } else { HOST };
        self.set_turn(theirs);
    }

    fn set_turn(&self, turn: u32) {
        let control = self.control();
        control.turn.store(turn, Ordering::SeqCst);
        if control.sleeps[turn as usize - 1].load(Ordering::SeqCst) != 0 {
            // SAFETY: wakes whoever sleeps on a word that is there.
            unsafe { libc::syscall(libc::SYS_futex, &raw const control.turn, libc::FUTEX_WAKE, i32::MAX) };
        }
    }

    /// Wakes a host that waits for a worker which is gone.
    pub(super) fn wake_host(&self) {
        self.set_turn(HOST);
    }

    fn await_turn(&self, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        let (turn, mine) = (&self.control().turn, self.mine());
        for _ in 0..LOOKS {
            if turn.load(Ordering::Acquire) == mine {
                return Ok(());
            }
            std::hint::spin_loop();
        }
        let sleeps = &self.control().sleeps[mine as usize - 1];
        let mut outcome = Ok(());
        sleeps.store(1, Ordering::SeqCst);
        loop {
            let found = turn.load(Ordering::SeqCst);
            if found == mine {
                break;
            }
            sleep(turn, found, Duration::from_millis(10));
            if turn.load(Ordering::SeqCst) != mine && !wait() {
                outcome = Err(Broken::GivenUp);
                break;
            }
        }
        sleeps.store(0, Ordering::SeqCst);
        outcome
    }
}

/// Sleeps until somebody wakes who sleeps on `word`, it is not `value` any longer, or the time is up.
fn sleep(word: &AtomicU32, value: u32, time: Duration) {
    let time = libc::timespec { tv_sec: time.as_secs() as libc::time_t, tv_nsec: libc::c_long::from(time.subsec_nanos()) };
    // SAFETY: word and time are there for as long as the call.
    unsafe { libc::syscall(libc::SYS_futex, std::ptr::from_ref(word), libc::FUTEX_WAIT, value, &raw const time) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_any_length_go_there_and_back() {
        let (host, file) = Lane::new().unwrap();
        let lengths = [0, 1, BUFFER - 1, BUFFER, BUFFER + 1, 5 * BUFFER + 3];
        let worker = std::thread::spawn(move || {
            let worker = Lane::attach(&file).unwrap();
            let mut message = Vec::new();
            for _ in lengths {
                worker.receive(&mut message, usize::MAX, &mut || true).unwrap();
                message.iter_mut().for_each(|b| *b ^= 1);
                worker.send(&message, &mut || true).unwrap();
            }
        });
        let mut back = Vec::new();
        for length in lengths {
            let message: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
            host.send(&message, &mut || true).unwrap();
            host.receive(&mut back, usize::MAX, &mut || true).unwrap();
            assert!(back.len() == length && back.iter().zip(&message).all(|(a, b)| *a == *b ^ 1), "{length}");
        }
        worker.join().unwrap();
    }

    #[test]
    fn what_is_no_message_is_told_and_waiting_can_be_given_up() {
        let (host, file) = Lane::new().unwrap();
        let worker = Lane::attach(&file).unwrap();
        host.send(b"task", &mut || true).unwrap();
        let mut message = Vec::new();
        assert_eq!(host.receive(&mut message, 100, &mut || false), Err(Broken::GivenUp));
        worker.receive(&mut message, 100, &mut || true).unwrap();
        worker.control().length.store(u64::MAX, Ordering::SeqCst);
        worker.pass();
        assert_eq!(host.receive(&mut message, 100, &mut || true), Err(Broken::Garbage));
    }
}
