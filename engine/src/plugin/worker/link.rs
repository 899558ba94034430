//! The way between a host and a worker, over memory that both have or over sockets.

use std::os::fd::OwnedFd;

#[cfg(target_os = "linux")]
use super::lane::Lane;
use super::notes::Notes;
use super::pipe::Pipe;
use super::wire::Writer;

/// Why a message did not come.
#[derive(Debug, PartialEq)]
pub(super) enum Broken {
    /// What lies there is no message.
    Garbage,
    /// Whoever waited gave it up.
    GivenUp,
    /// The other end is gone.
    Closed,
}

/// One end.
pub(super) enum Link {
    #[cfg(target_os = "linux")]
    Shared(Lane),
    Piped(Pipe),
}

impl Link {
    /// A host's end and the two files that a worker gets: for messages, and for arrays or notes.
    pub(super) fn new(pipes: bool) -> std::io::Result<(Self, OwnedFd, OwnedFd)> {
        #[cfg(target_os = "linux")]
        if !pipes {
            let (lane, file) = Lane::new()?;
            return Ok((Self::Shared(lane), file, super::arena::file()?));
        }
        let _ = pipes;
        Pipe::new().map(|(pipe, main, side)| (Self::Piped(pipe), main, side))
    }

    pub(super) fn is_piped(&self) -> bool {
        matches!(self, Self::Piped(_))
    }

    /// What the worker noted.
    pub(super) fn notes(&self) -> &Notes {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.notes(),
            Self::Piped(pipe) => {
                pipe.look();
                pipe.notes()
            }
        }
    }

    /// The notes of a worker's end, which stay for as long as the process.
    pub(super) fn forever(&self) -> &'static Notes {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.forever(),
            // SAFETY: what is leaked stays.
            Self::Piped(pipe) => unsafe { &*std::sync::Arc::into_raw(pipe.notes().clone()) },
        }
    }

    /// Tells the worker which task is to stop.
    pub(super) fn cancel(&self, task: u32) {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.notes().cancel.store(task, std::sync::atomic::Ordering::Relaxed),
            Self::Piped(pipe) => pipe.cancel(task),
        }
    }

    /// Wakes a host that waits for a worker which is gone. A socket does so by itself.
    pub(super) fn wake_host(&self) {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.wake_host(),
            Self::Piped(_) => {}
        }
    }

    /// Sends a message. `wait` is asked now and then whether to go on waiting.
    pub(super) fn send(&self, message: &Writer, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.send(&message.bytes, wait),
            Self::Piped(pipe) => pipe.send(message, wait),
        }
    }

    /// Receives a message of at most `most` bytes.
    pub(super) fn receive(&self, message: &mut Vec<u8>, most: usize, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        match self {
            #[cfg(target_os = "linux")]
            Self::Shared(lane) => lane.receive(message, most, wait),
            Self::Piped(pipe) => pipe.receive(message, most, wait),
        }
    }

    /// Reads the next array that the message told of.
    pub(super) fn read(&self, bytes: &mut [u8], wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        match self {
            // None goes along there.
            #[cfg(target_os = "linux")]
            Self::Shared(_) => Err(Broken::Garbage),
            Self::Piped(pipe) => pipe.read(bytes, wait),
        }
    }
}
