//! The gate: who may start, so that what is counted never passes the budget and somebody can always go on.
//!
//! A task enters with all that it will need at once, and nothing that runs ever waits for memory. A task that does not fit waits at the gate until
//! somebody leaves. When nobody runs, everything that lies idle can be given up, so the first in the queue fits, or never will.

use crate::sync::{AtomicU64, Mutex, MutexGuard, Ordering, PoisonError};

/// Bytes are counted in the lower bits.
const BYTES: u64 = (1 << 47) - 1;
/// One task that runs.
const ONE: u64 = 1 << 47;
/// Somebody decides or waits: all who want to enter go through the lock.
const CLOSED: u64 = 1 << 63;

/// The answer to a task that wants to enter.
#[derive(Debug, PartialEq)]
pub(super) enum Pass {
    /// It runs, with so many bytes counted for it.
    Go(u64),
    /// It will be handed to somebody who leaves.
    Wait,
    /// So many bytes do not fit, and nobody is there to wait for.
    Never(u64),
}

/// Bytes that a task needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Need {
    /// What it is thought to need.
    pub(super) bytes: u64,
    /// What it is let in with where it is alone and there is no more.
    pub(super) least: u64,
}

/// A task that asks to be let in. All of it is called under the gate's lock.
pub(super) trait Ask {
    /// What it needs, and will go on to need until it is let in or withdraws.
    fn need(&mut self) -> Need;
    /// Gives up one thing that lies idle; false where there is none. `is_alone` where nobody runs: then all that is not its own lies idle.
    fn make_room(&mut self, is_alone: bool) -> bool;
    /// Lets go of what it holds, as it is not let in.
    fn withdraw(&mut self);
}

/// The bytes that are counted, the tasks that run, and those that wait.
pub(super) struct Gate<T> {
    limit: u64,
    state: AtomicU64,
    peak: AtomicU64,
    queue: Mutex<Vec<T>>,
}

fn running(state: u64) -> u64 {
    (state & !CLOSED) / ONE
}

impl<T> Gate<T> {
    /// A gate to so many bytes; `None` for as many as there may be.
    pub(super) fn new(limit: Option<u64>) -> Self {
        let limit = limit.unwrap_or(BYTES).min(BYTES);
        Self { limit, state: AtomicU64::new(0), peak: AtomicU64::new(0), queue: Mutex::new(Vec::new()) }
    }

    pub(super) fn is_limited(&self) -> bool {
        self.limit < BYTES
    }

    pub(super) fn limit(&self) -> u64 {
        self.limit
    }

    /// Bytes that are counted now.
    pub(super) fn used(&self) -> u64 {
        self.state.load(Ordering::Relaxed) & BYTES
    }

    /// Most bytes that were counted at once.
    pub(super) fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }

    /// Adds to the state where the bytes fit and `shut` is not set.
    fn add(&self, bytes: u64, tasks: u64, shut: u64) -> bool {
        let fits = |state: u64| (state & shut == 0 && (state & BYTES) + bytes <= self.limit).then(|| state + bytes + tasks);
        match self.state.fetch_update(Ordering::SeqCst, Ordering::SeqCst, fits) {
            Ok(before) => {
                let now = (before & BYTES) + bytes;
                if now > self.peak.load(Ordering::Relaxed) {
                    self.peak.fetch_max(now, Ordering::Relaxed);
                }
                true
            }
            Err(_) => false,
        }
    }

    /// Enters, where nobody waits and the bytes fit.
    pub(super) fn enter(&self, bytes: u64) -> bool {
        self.add(bytes, ONE, CLOSED)
    }

    /// Enters, or leaves the task in the queue.
    pub(super) fn enter_or_wait(&self, task: T, ask: &mut impl Ask) -> Pass {
        let mut queue = self.lock();
        let need = ask.need();
        // From here on nobody enters but through the lock that we hold, so that the number of those who run only falls.
        self.state.fetch_or(CLOSED, Ordering::SeqCst);
        let pass = self.decide(need, ask);
        if !matches!(pass, Pass::Go(_)) {
            // Before anybody else decides, who would find it held by one who does not run.
            ask.withdraw();
        }
        if pass == Pass::Wait {
            queue.push(task);
        }
        self.open(&queue);
        pass
    }

    /// Decides, for one who has closed the gate and holds its lock.
    fn decide(&self, need: Need, ask: &mut impl Ask) -> Pass {
        loop {
            let is_alone = running(self.state.load(Ordering::SeqCst)) == 0;
            if self.add(need.bytes, ONE, 0) {
                return Pass::Go(need.bytes);
            }
            if ask.make_room(is_alone) {
                continue;
            }
            // Whoever ran when we looked finds the gate closed when it leaves, and comes for the queue as soon as we let go of it.
            if !is_alone {
                return Pass::Wait;
            }
            return if self.add(need.least, ONE, 0) { Pass::Go(need.least) } else { Pass::Never(need.least) };
        }
    }

    /// Enters in any case, without bytes: for one who only gives back. Nobody who decides takes what is on its way back for something that stays.
    pub(super) fn step_in(&self) {
        let _queue = self.lock();
        self.state.fetch_add(ONE, Ordering::SeqCst);
    }

    /// Leaves: gives the bytes back, and takes all who wait along, to be tried again.
    #[must_use]
    pub(super) fn leave(&self, bytes: u64) -> Vec<T> {
        let before = self.state.fetch_sub(bytes + ONE, Ordering::SeqCst);
        if before & CLOSED == 0 {
            return Vec::new();
        }
        let mut queue = self.lock();
        let waiting = std::mem::take(&mut *queue);
        self.open(&queue);
        waiting
    }

    /// Counts more bytes for somebody who is inside, where they fit.
    pub(super) fn reserve(&self, bytes: u64) -> bool {
        self.add(bytes, 0, 0)
    }

    /// Counts bytes no more.
    pub(super) fn release(&self, bytes: u64) {
        self.state.fetch_sub(bytes, Ordering::SeqCst);
    }

    /// Makes room for somebody who is inside; false where there is none to be made.
    pub(super) fn reserve_with(&self, bytes: u64, mut make_room: impl FnMut() -> bool) -> bool {
        if self.reserve(bytes) {
            return true;
        }
        let _queue = self.lock();
        loop {
            if self.reserve(bytes) {
                return true;
            }
            if !make_room() {
                return false;
            }
        }
    }

    fn open(&self, queue: &[T]) {
        if queue.is_empty() {
            self.state.fetch_and(!CLOSED, Ordering::SeqCst);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<T>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
