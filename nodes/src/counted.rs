//! For tests: sequences that make each value when it is asked for, and count how many are alive at once.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, Weak};

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Input, NodeError, SequenceRef, Values};
use pegbar_engine::value::{Value, ValueRef};

/// What was asked of a sequence.
#[derive(Default)]
pub(crate) struct Count {
    /// Most values alive at once.
    pub(crate) peak: AtomicUsize,
    /// Values made.
    pub(crate) reads: AtomicUsize,
}

impl Count {
    pub(crate) fn peak(&self) -> usize {
        self.peak.load(Ordering::Relaxed)
    }

    pub(crate) fn reads(&self) -> usize {
        self.reads.load(Ordering::Relaxed)
    }
}

struct Counted<T, F> {
    len: usize,
    make: F,
    alive: Mutex<Vec<Weak<T>>>,
    count: Arc<Count>,
}

impl<T: Value, F: Fn(usize) -> T + Send + Sync> Values for Counted<T, F> {
    fn len(&self) -> usize {
        self.len
    }

    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        let value = Arc::new((self.make)(idx));
        let mut alive = self.alive.lock().unwrap();
        alive.retain(|v| v.strong_count() > 0);
        alive.push(Arc::downgrade(&value));
        self.count.peak.fetch_max(alive.len(), Ordering::Relaxed);
        self.count.reads.fetch_add(1, Ordering::Relaxed);
        Ok(value)
    }
}

/// A clock of so many frames from 1.
pub(crate) fn clock(len: usize) -> Clock {
    Clock { name: "frames".to_owned(), first: 1, last: len as i64, fps: (24, 1) }
}

/// An input that reads `len` frames, each made by `make` from its position, and the count of them.
pub(crate) fn counted<T: Value, I: Input>(len: usize, make: impl Fn(usize) -> T + Send + Sync + 'static) -> (I, Arc<Count>) {
    let count = Arc::new(Count::default());
    let values = Counted { len, make, alive: Mutex::default(), count: count.clone() };
    let sequence = SequenceRef::new(Some(Arc::new(clock(len))), values);
    (I::from_arg(Arg::Sequence(sequence)).unwrap(), count)
}
