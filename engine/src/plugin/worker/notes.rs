//! What a host and a worker tell each other beside their messages: a wish to stop, signs of life, and what ended the worker.

use std::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering};

/// What was at fault when a worker was ended by a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Near {
    /// Nothing that is known.
    Unknown,
    /// It wrote to an input; which one, where that is known.
    Input(Option<u32>),
    /// Memory ran out.
    Memory,
    /// It was refused memory, and went on without.
    Refused,
    /// It wrote to an output of a task that had ended: of that node, at that frame.
    Late(u32, i64),
}

/// Stands for an input that is not known, and for a state.
pub(super) const NO_INPUT: u32 = u32::MAX;
pub(super) const STATE_INPUT: u32 = u32::MAX - 1;

/// Read by both ends at any time. Any bits are a value.
#[repr(C)]
#[derive(Default)]
pub(super) struct Notes {
    /// The task that the host wants to stop; nought for none.
    pub(super) cancel: AtomicU32,
    /// The signal that ends the worker.
    pub(super) signal: AtomicU32,
    near: AtomicU32,
    /// Which input, or which node.
    which: AtomicU32,
    pub(super) address: AtomicU64,
    frame: AtomicI64,
    /// Counts signs of life.
    pub(super) beats: AtomicU32,
    /// How much of the task is done, as bits of a float.
    done: AtomicU64,
}

impl Notes {
    pub(super) fn near(&self) -> Near {
        let which = self.which.load(Ordering::Relaxed);
        match self.near.load(Ordering::Relaxed) {
            1 => Near::Input(Some(which).filter(|which| *which != NO_INPUT)),
            2 => Near::Memory,
            3 => Near::Refused,
            4 => Near::Late(which, self.frame.load(Ordering::Relaxed)),
            _ => Near::Unknown,
        }
    }

    pub(super) fn set_near(&self, near: Near) {
        let (kind, which, frame) = match near {
            Near::Unknown => (0, 0, 0),
            Near::Input(which) => (1, which.unwrap_or(NO_INPUT), 0),
            Near::Memory => (2, 0, 0),
            Near::Refused => (3, 0, 0),
            Near::Late(node, frame) => (4, node, frame),
        };
        self.which.store(which, Ordering::Relaxed);
        self.frame.store(frame, Ordering::Relaxed);
        self.near.store(kind, Ordering::Relaxed);
    }

    /// A sign of life, with how much is done.
    pub(super) fn beat(&self, done: f64) {
        self.done.store(done.to_bits(), Ordering::Relaxed);
        self.beats.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn done(&self) -> f64 {
        f64::from_bits(self.done.load(Ordering::Relaxed))
    }
}

/// Notes of a worker as they go over a pipe.
pub(super) const RECORD: usize = 40;

impl Notes {
    /// All that a worker notes. Does nothing but what a signal's handler may.
    pub(super) fn record(&self) -> [u8; RECORD] {
        let mut record = [0; RECORD];
        let words = [&self.signal, &self.near, &self.which, &self.beats].map(|word| u64::from(word.load(Ordering::Relaxed)));
        let wide =
            [self.address.load(Ordering::Relaxed), self.frame.load(Ordering::Relaxed).cast_unsigned(), self.done.load(Ordering::Relaxed)];
        let all = [words[0] | words[1] << 32, words[2] | words[3] << 32, wide[0], wide[1], wide[2]];
        for (to, word) in record.chunks_exact_mut(8).zip(all) {
            to.copy_from_slice(&word.to_ne_bytes());
        }
        record
    }

    /// Notes what was noted there.
    pub(super) fn read(&self, record: &[u8; RECORD]) {
        let (words, _) = record.as_chunks::<8>();
        let word = |i: usize| u64::from_ne_bytes(words[i]);
        let halves = |i: usize| ((word(i) & u64::from(u32::MAX)) as u32, (word(i) >> 32) as u32);
        let ((signal, near), (which, beats)) = (halves(0), halves(1));
        for (to, word) in [(&self.signal, signal), (&self.near, near), (&self.which, which), (&self.beats, beats)] {
            to.store(word, Ordering::Relaxed);
        }
        self.address.store(word(2), Ordering::Relaxed);
        self.frame.store(word(3).cast_signed(), Ordering::Relaxed);
        self.done.store(word(4), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_go_over_as_they_are() {
        for near in [Near::Unknown, Near::Input(None), Near::Input(Some(3)), Near::Memory, Near::Refused, Near::Late(2, -7)] {
            let (from, to) = (Notes::default(), Notes::default());
            from.set_near(near);
            from.signal.store(11, Ordering::Relaxed);
            from.address.store(u64::MAX - 5, Ordering::Relaxed);
            from.beat(0.25);
            to.read(&from.record());
            let words = (to.signal.load(Ordering::Relaxed), to.address.load(Ordering::Relaxed), to.beats.load(Ordering::Relaxed));
            assert_eq!((to.near(), words, to.done()), (near, (11, u64::MAX - 5, 1), 0.25));
        }
    }
}
