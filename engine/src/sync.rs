//! What the executor is made of. A model checker builds the same sources with its own of each, to see them under every order of events.

use std::time::Duration;

pub(crate) use crossbeam::deque::{Injector, Steal, Stealer, Worker};
pub(crate) use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Ordering, fence};
pub(crate) use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
pub(crate) use std::thread::scope;

/// Waits until it is told, and no longer than `most`.
pub(crate) fn wait<'a, T>(condvar: &Condvar, guard: MutexGuard<'a, T>, most: Duration) -> MutexGuard<'a, T> {
    condvar.wait_timeout(guard, most).unwrap_or_else(PoisonError::into_inner).0
}
