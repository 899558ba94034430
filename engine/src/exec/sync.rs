//! What the scheduler is made of. A model checker builds the same sources with its own of each.

pub(super) use crossbeam::deque::{Injector, Steal, Stealer, Worker};
pub(super) use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, fence};
pub(super) use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
