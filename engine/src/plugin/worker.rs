//! Workers: processes that run plugins, so that what a plugin does to its process it does to no other.
//!
//! A host starts itself, or another program, as a worker ([`serve_if_asked`]), one for each task of a plugin that runs at once. Messages go over a buffer
//! that both write in turn (`lane`); large arrays lie in memory that both have (`arena`), where a worker can write its outputs and nothing else. Where the
//! system has no such memory all of it goes over sockets (`pipe`), in the same messages. A worker is a host of its plugin by the same code as any other
//! (`serve`).
#![cfg_attr(unix, allow(unsafe_code, reason = "memory that processes share, and what a process may do; each block says what it relies on"))]

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[cfg(target_os = "linux")]
pub mod arena;
#[cfg(unix)]
mod isolated;
#[cfg(target_os = "linux")]
mod lane;
#[cfg(unix)]
mod link;
#[cfg(unix)]
mod message;
#[cfg(unix)]
mod notes;
#[cfg(unix)]
mod pipe;
#[cfg(unix)]
mod process;
#[cfg(unix)]
mod rights;
#[cfg(unix)]
mod rooms;
#[cfg(unix)]
mod serve;
#[cfg(unix)]
mod sheet;
#[cfg(unix)]
mod wire;

#[cfg(unix)]
pub(super) use isolated::Isolated;

/// First argument of a program that is started as a worker.
pub(super) const ARGUMENT: &str = "plugin-worker";
/// Third argument of one that is reached over sockets alone.
#[cfg(unix)]
const PIPES: &str = "pipes";

/// How plugins run in processes of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Workers {
    /// The program that is started: one that calls [`serve_if_asked`].
    pub program: PathBuf,
    /// The longest time that a task may give no sign of life: neither progress nor log, no value fetched, no memory asked for. `None` for ever.
    pub timeout: Option<Duration>,
    /// Most bytes of memory that one worker may take.
    pub memory: u64,
    /// Folders that plugins may write to.
    pub writable: Vec<PathBuf>,
    /// Names of plugins that run in the host's process instead.
    pub trusted: Vec<String>,
    /// True to reach them over sockets even where there is memory that processes share: it takes longer, and gives the same bits. From the beginning so
    /// where the variable `PEGBAR_PLUGIN_PIPES` is set.
    pub pipes: bool,
}

impl Workers {
    /// Workers of a program, with ten minutes and half of the machine's memory each, and nothing to write to.
    pub fn new(program: impl Into<PathBuf>) -> Self {
        Self {
            program: program.into(),
            timeout: Some(Duration::from_secs(600)),
            memory: half_of_memory(),
            writable: Vec::new(),
            trusted: Vec::new(),
            pipes: std::env::var_os("PEGBAR_PLUGIN_PIPES").is_some_and(|v| !v.is_empty()),
        }
    }
}

#[cfg(unix)]
fn half_of_memory() -> u64 {
    // SAFETY: asks for two numbers.
    let (pages, page) = unsafe { (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)) };
    u64::try_from(pages).unwrap_or(0).saturating_mul(u64::try_from(page).unwrap_or(0)) / 2
}

#[cfg(not(unix))]
fn half_of_memory() -> u64 {
    u64::MAX
}

/// Where in a program plugins run.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Isolation {
    /// In workers of this program, where it has called [`serve_if_asked`]; else in its own process. Where the system has not what workers take (Unix),
    /// plugins that are not trusted are refused.
    #[default]
    Auto,
    /// In its own process.
    Off,
    /// In workers.
    Workers(Box<Workers>),
}

impl Isolation {
    /// The workers, where there are to be some.
    pub(crate) fn workers(&self) -> Option<Workers> {
        match self {
            Self::Auto => own_program().map(Workers::new),
            Self::Off => None,
            Self::Workers(workers) => Some((**workers).clone()),
        }
    }
}

static SERVES: AtomicBool = AtomicBool::new(false);

/// The program that can serve as a worker: this one, where it calls [`serve_if_asked`].
pub fn own_program() -> Option<PathBuf> {
    let own = if cfg!(target_os = "linux") { Some(PathBuf::from("/proc/self/exe")) } else { std::env::current_exe().ok() };
    own.filter(|_| SERVES.load(Ordering::Relaxed))
}

/// To be called by a program before anything else: where it was started as a worker, serves a plugin and ends the process. Else returns, and from then on
/// plugins run in workers of this program where nothing else is said.
pub fn serve_if_asked() {
    #[cfg(unix)]
    serve::serve_if_asked();
    SERVES.store(true, Ordering::Relaxed);
}

/// Bytes of a page of memory.
#[cfg(unix)]
fn page() -> usize {
    // SAFETY: asks for a number.
    usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096)
}

/// What the system says of a call that failed.
#[cfg(unix)]
fn fail() -> std::io::Error {
    std::io::Error::last_os_error()
}
