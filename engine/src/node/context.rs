//! What a node knows of its surroundings.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::NodeError;
use crate::clock::Clock;

/// A wish to stop, shared by the run and whoever may end it.
#[derive(Clone, Default)]
pub struct Cancel {
    own: Arc<AtomicBool>,
    outer: Option<Arc<dyn Fn() -> bool + Send + Sync>>,
}

impl std::fmt::Debug for Cancel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Cancel").field(&self.is_cancelled()).finish()
    }
}

impl Cancel {
    /// A wish that somebody else has, who is asked for it.
    pub fn asking(outer: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self { own: Arc::default(), outer: Some(Arc::new(outer)) }
    }

    /// True where nobody but its holder could ask it any longer.
    #[doc(hidden)]
    pub fn is_unshared(&self) -> bool {
        Arc::strong_count(&self.own) == 1
    }

    /// Asks the run to stop.
    pub fn cancel(&self) {
        self.own.store(true, Ordering::Relaxed);
    }

    /// True once asked.
    pub fn is_cancelled(&self) -> bool {
        self.own.load(Ordering::Relaxed) || self.outer.as_ref().is_some_and(|outer| outer())
    }
}

/// What a node knows of its surroundings while it runs.
#[derive(Clone, Debug)]
pub struct Context<'a> {
    /// The frame that is being made; the clock's first for a node that runs once.
    pub frame: i64,
    /// The clock of the node's outputs.
    pub clock: &'a Clock,
    /// The clock of each input that is wired to a stream.
    pub input_clocks: &'a [(&'static str, Arc<Clock>)],
    /// To be asked now and then by whatever takes long.
    pub cancel: &'a Cancel,
}

impl Context<'_> {
    /// The clock of what is wired to `input`; the node's own where that is a single value.
    pub fn input_clock(&self, input: &str) -> &Clock {
        self.input_clocks.iter().find(|(name, _)| *name == input).map_or(self.clock, |(_, clock)| clock)
    }

    /// To be called now and then by whatever takes long.
    ///
    /// # Errors
    /// Once the run is asked to stop.
    pub fn check(&self) -> Result<(), NodeError> {
        if self.cancel.is_cancelled() { Err(NodeError::stopped()) } else { Ok(()) }
    }
}

/// A wrong combination of settings, found before anything runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The input that is to be changed.
    pub input: &'static str,
    /// `expected X, found Y`.
    pub message: String,
}
