//! The crew: threads that take tasks from their own stack, from what came back, from what was admitted, or from each other; and sleep when there is
//! nothing to be had.

use std::time::Duration;

use crate::sync::{
    AtomicBool, AtomicUsize, Condvar, Injector, Mutex, MutexGuard, Ordering, PoisonError, Steal, Stealer, Worker, fence, wait,
};

/// What the threads share.
pub(super) struct Crew<T> {
    threads: usize,
    /// Tasks that were begun and have to be tried again; taken before all that is new.
    back: Injector<T>,
    /// Tasks that were admitted, first frames first.
    roots: Injector<T>,
    stealers: Vec<Stealer<T>>,
    /// Threads that wait, and the count of wake-ups that they wait on.
    sleepers: AtomicUsize,
    wakes: Mutex<u64>,
    wake: Condvar,
    stopped: AtomicBool,
}

/// Why a thread woke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Woken {
    /// There may be something to do.
    Called,
    /// Every thread slept, and there is nothing to be had: nothing can move any more.
    Stuck,
}

impl<T> Crew<T> {
    /// A crew of the owners of `workers`.
    pub(super) fn new(workers: &[Worker<T>]) -> Self {
        Self {
            threads: workers.len(),
            back: Injector::new(),
            roots: Injector::new(),
            stealers: workers.iter().map(Worker::stealer).collect(),
            sleepers: AtomicUsize::new(0),
            wakes: Mutex::new(0),
            wake: Condvar::new(),
            stopped: AtomicBool::new(false),
        }
    }

    /// Something to do: the newest of its own, then the oldest of what there is.
    pub(super) fn find(&self, own: &Worker<T>) -> Option<T> {
        if let Some(task) = own.pop() {
            return Some(task);
        }
        loop {
            let mut again = false;
            let shared = [&self.back, &self.roots].into_iter().map(Injector::steal);
            for stolen in shared.chain(self.stealers.iter().map(Stealer::steal)) {
                match stolen {
                    Steal::Success(task) => return Some(task),
                    Steal::Retry => again = true,
                    Steal::Empty => {}
                }
            }
            if !again {
                return None;
            }
        }
    }

    pub(super) fn push_root(&self, task: T) {
        self.roots.push(task);
    }

    /// Hands back tasks that could not run yet.
    pub(super) fn hand_back(&self, tasks: Vec<T>) {
        if !tasks.is_empty() {
            tasks.into_iter().for_each(|task| self.back.push(task));
            self.rouse();
        }
    }

    /// Sleeps until somebody calls. `may_admit` tells whether there is something to do beside the queues; `ends` whether the run is ended from outside.
    pub(super) fn sleep(&self, may_admit: impl Fn() -> bool, ends: impl Fn() -> bool) -> Woken {
        // A thread that is counted here holds no task.
        let all = self.sleepers.fetch_add(1, Ordering::SeqCst) + 1 == self.threads;
        let seen = *self.lock();
        fence(Ordering::SeqCst);
        // Not under the lock: whoever rouses may hold what `may_admit` waits for. A call from here on changes the count, and is not missed.
        let empty = self.back.is_empty() && self.roots.is_empty() && self.stealers.iter().all(Stealer::is_empty);
        let something = !empty || may_admit();
        let stuck = all && !something && !self.is_stopped() && !ends();
        let mut wakes = self.lock();
        while !something && !stuck && *wakes == seen && !self.is_stopped() && !ends() {
            // A run that is ended from outside has nobody to wake the sleepers, hence the bound.
            wakes = wait(&self.wake, wakes, Duration::from_millis(20));
        }
        drop(wakes);
        self.sleepers.fetch_sub(1, Ordering::SeqCst);
        if stuck { Woken::Stuck } else { Woken::Called }
    }

    /// Calls all who sleep, if somebody does.
    pub(super) fn rouse(&self) {
        fence(Ordering::SeqCst);
        if self.sleepers.load(Ordering::SeqCst) > 0 {
            *self.lock() += 1;
            self.wake.notify_all();
        }
    }

    /// Sends everybody home.
    pub(super) fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        *self.lock() += 1;
        self.wake.notify_all();
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Acquire)
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.wakes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
