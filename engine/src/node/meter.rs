//! How much of a task is done, as it tells itself.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

thread_local! {
    static METER: RefCell<Option<Arc<Meter>>> = const { RefCell::new(None) };
}

/// How much of the task of a thread is done, for whoever shows it.
#[derive(Debug)]
pub struct Meter(AtomicU64);

impl Default for Meter {
    fn default() -> Self {
        Self(AtomicU64::new(f64::NAN.to_bits()))
    }
}

impl Meter {
    /// That of this thread; `None` where nobody looks.
    pub fn current() -> Option<Arc<Self>> {
        METER.with_borrow(Clone::clone)
    }

    /// Has this thread use it from here on, for all of its tasks.
    pub fn install(meter: Option<Arc<Self>>) {
        METER.set(meter);
    }

    /// Says how much is done, 0 to 1.
    pub fn set(&self, done: f64) {
        self.0.store(done.to_bits(), Ordering::Relaxed);
    }

    /// Begins another task.
    pub fn reset(&self) {
        self.set(f64::NAN);
    }

    /// How much is done, 0 to 1; `None` where the task has not said.
    pub fn done(&self) -> Option<f64> {
        let done = f64::from_bits(self.0.load(Ordering::Relaxed));
        (!done.is_nan()).then(|| done.clamp(0.0, 1.0))
    }
}
