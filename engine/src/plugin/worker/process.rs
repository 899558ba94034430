//! A worker as its host sees it: a process that is started, asked, watched and ended.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::{FromRawFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::link::{Broken, Link};
use super::notes::Near;
use super::wire::Writer;
use super::{ARGUMENT, PIPES, Workers, fail};
use crate::array::{Bytes, Data};
use crate::node::{Cancel, Meter};
use crate::value::ValueRef;

/// How long a worker may take to end by itself once it is asked to.
const FAREWELL: Duration = Duration::from_millis(500);
/// How long a task may go on once the run is cancelled.
const CANCELLED: Duration = Duration::from_secs(2);

/// What the one who waits for a process shares with those who use it.
struct Watch {
    pid: libc::pid_t,
    is_dead: AtomicBool,
    ended: Mutex<Option<ExitStatus>>,
    ends: Condvar,
    link: Arc<Link>,
}

impl Watch {
    /// Waits for the process, whose parent this thread is, and so must stay for as long as it runs.
    fn wait(&self, child: &mut std::process::Child) {
        // SAFETY: the struct is ours; the process stays known by its number until it is reaped below.
        unsafe {
            let mut info: libc::siginfo_t = std::mem::zeroed();
            while libc::waitid(libc::P_PID, self.pid as libc::id_t, &raw mut info, libc::WEXITED | libc::WNOWAIT) != 0
                && fail().kind() == std::io::ErrorKind::Interrupted
            {}
        }
        let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        // What the plugin started goes with it. The number is still the process's.
        self.signal();
        *ended = Some(child.wait().unwrap_or_else(|_| ExitStatus::from_raw(0)));
        self.is_dead.store(true, Ordering::SeqCst);
        self.link.wake_host();
        self.ends.notify_all();
    }

    fn signal(&self) {
        // SAFETY: the number is that of a process which is not reaped, and of its group.
        unsafe {
            libc::kill(-self.pid, libc::SIGKILL);
            libc::kill(self.pid, libc::SIGKILL);
        }
    }

    fn kill(&self) {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        if ended.is_none() {
            self.signal();
        }
    }

    fn ended(&self, within: Duration) -> Option<ExitStatus> {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        let (ended, _) = self.ends.wait_timeout_while(ended, within, |e| e.is_none()).unwrap_or_else(PoisonError::into_inner);
        *ended
    }
}

/// Why a process gave no answer.
#[derive(Debug)]
pub(super) enum End {
    /// It ended.
    Ended { status: Option<ExitStatus>, signal: u32, address: u64, near: Near },
    /// What it said is no message.
    Garbage,
    /// It closed what leads to its host.
    Closed,
    /// It gave no sign of life for so long.
    Hung(Duration),
    /// It took more memory than that.
    Memory(u64),
    /// It went on after the run was cancelled.
    Stopped,
}

/// What was lent to a worker: a value, and copies of its arrays where it does not lie in the memory that is shared.
pub(super) struct Loan {
    pub(super) value: ValueRef,
    /// Held, and looked at there.
    pub(super) _copies: Vec<Arc<dyn Bytes>>,
}

/// A worker.
pub(super) struct Process {
    pub(super) link: Arc<Link>,
    watch: Arc<Watch>,
    thread: Option<std::thread::JoinHandle<()>>,
    /// Tasks that it has done.
    pub(super) tasks: u64,
    /// Which one it is given, from 1 on.
    pub(super) task: u32,
    /// Settings that it knows.
    pub(super) settings: BTreeSet<u64>,
    /// What it may still be looking at, by number.
    pub(super) lent: BTreeMap<u64, Loan>,
    pub(super) next: u64,
    /// Copies of small arrays among that.
    #[cfg(target_os = "linux")]
    pub(super) small: super::arena::Packed,
    /// Memory that it has for outputs, by where it lies.
    pub(super) blocks: BTreeMap<u64, Data>,
    /// For messages and answers.
    pub(super) buffers: (Writer, Vec<u8>),
}

impl Process {
    pub(super) fn start(workers: &Workers, pipes: bool) -> std::io::Result<Self> {
        let (link, messages, other) = Link::new(pipes)?;
        let mut command = Command::new(&workers.program);
        // The two files come as its input and output, which it moves elsewhere.
        command.args([ARGUMENT, &std::process::id().to_string()]).args(pipes.then_some(PIPES));
        command.stdin(messages).stdout(Stdio::from(other)).process_group(0);
        let link = Arc::new(link);
        let (to, from) = std::sync::mpsc::sync_channel(1);
        let shared = link.clone();
        // A process that is to end with its parent ends with the thread that started it.
        let thread = std::thread::Builder::new().name("plugin".to_owned()).stack_size(1 << 18).spawn(move || {
            let mut child = match command.spawn() {
                Ok(child) => child,
                Err(error) => return drop(to.send(Err(error))),
            };
            // Its files are not held open here.
            drop(command);
            let pid = libc::pid_t::try_from(child.id()).unwrap_or(-1);
            let watch =
                Arc::new(Watch { pid, is_dead: AtomicBool::new(false), ended: Mutex::default(), ends: Condvar::new(), link: shared });
            drop(to.send(Ok(watch.clone())));
            watch.wait(&mut child);
        })?;
        let watch = from.recv().unwrap_or_else(|_| Err(std::io::Error::other("the thread that starts it ended")))?;
        let (settings, lent, blocks, buffers) = Default::default();
        Ok(Self {
            link,
            watch,
            thread: Some(thread),
            tasks: 0,
            task: 0,
            settings,
            lent,
            next: 0,
            #[cfg(target_os = "linux")]
            small: super::arena::Packed::default(),
            blocks,
            buffers,
        })
    }

    pub(super) fn is_alive(&self) -> bool {
        !self.watch.is_dead.load(Ordering::SeqCst)
    }

    /// Sends a message and receives the answer.
    pub(super) fn exchange(&self, message: &Writer, answer: &mut Vec<u8>, patience: &mut Patience) -> Result<(), End> {
        let most = usize::try_from(patience.workers.memory).unwrap_or(usize::MAX);
        let mut wait = || patience.waits(self);
        let exchanged = self.link.send(message, &mut wait).and_then(|()| self.link.receive(answer, most, &mut wait));
        self.outcome(exchanged, patience)
    }

    /// Reads an array that an answer told of.
    pub(super) fn read(&self, bytes: &mut [u8], patience: &mut Patience) -> Result<(), End> {
        let read = self.link.read(bytes, &mut || patience.waits(self));
        self.outcome(read, patience)
    }

    fn outcome(&self, result: Result<(), Broken>, patience: &mut Patience) -> Result<(), End> {
        match result {
            // Its end is told by a socket before it is by the system.
            Err(Broken::Closed) if self.watch.ended(FAREWELL).is_none() => {
                self.watch.kill();
                Err(End::Closed)
            }
            _ if !self.is_alive() => Err(self.end(patience.workers.memory)),
            Ok(()) => Ok(()),
            Err(Broken::Closed) => Err(End::Closed),
            Err(Broken::Garbage) => {
                self.watch.kill();
                Err(End::Garbage)
            }
            Err(Broken::GivenUp) => {
                self.watch.kill();
                Err(patience.why.take().unwrap_or(End::Garbage))
            }
        }
    }

    /// Ends it.
    pub(super) fn kill(&self) {
        self.watch.kill();
    }

    /// How it ended.
    pub(super) fn end(&self, most: u64) -> End {
        let status = self.watch.ended(FAREWELL);
        let notes = self.link.notes();
        let (signal, address) = (notes.signal.load(Ordering::Acquire), notes.address.load(Ordering::Relaxed));
        match notes.near() {
            Near::Memory => End::Memory(most),
            near => End::Ended { status, signal, address, near },
        }
    }

    /// Bytes of memory that it has to itself, where the system tells.
    fn memory(&self) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/statm", self.watch.pid)).unwrap_or_default();
        let mut pages = text.split(' ').skip(1).map(|n| n.parse::<u64>().unwrap_or(0));
        let (resident, shared) = (pages.next().unwrap_or(0), pages.next().unwrap_or(0));
        let own = resident.saturating_sub(shared).saturating_mul(super::page() as u64);
        own.saturating_add(self.blocks.values().map(|block| block.bytes().len() as u64).sum())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.is_alive() {
            let mut quit = Writer::default();
            quit.u32(super::message::QUIT);
            // One that is in the middle of something does not listen, and is ended.
            let asked = self.tasks > 0 && self.link.send(&quit, &mut || false).is_ok();
            if !asked || self.watch.ended(FAREWELL).is_none() {
                self.watch.kill();
            }
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// How long a task is waited for.
pub(super) struct Patience<'a> {
    workers: &'a Workers,
    cancel: &'a Cancel,
    since: Instant,
    beats: u32,
    cancelled: Option<Instant>,
    meter: Option<Arc<Meter>>,
    why: Option<End>,
}

impl<'a> Patience<'a> {
    /// To be made before the task is sent.
    pub(super) fn new(workers: &'a Workers, cancel: &'a Cancel, process: &Process) -> Self {
        let beats = process.link.notes().beats.load(Ordering::Relaxed);
        Self { workers, cancel, since: Instant::now(), beats, cancelled: None, meter: Meter::current(), why: None }
    }

    /// Bytes of memory that a worker may take.
    pub(super) fn most(&self) -> u64 {
        self.workers.memory
    }

    /// It gave a sign of life.
    pub(super) fn renew(&mut self) {
        self.since = Instant::now();
    }

    fn waits(&mut self, process: &Process) -> bool {
        if !process.is_alive() {
            return false;
        }
        let notes = process.link.notes();
        let beats = notes.beats.load(Ordering::Relaxed);
        if beats != self.beats {
            self.beats = beats;
            self.renew();
            if let Some(meter) = &self.meter {
                meter.set(notes.done());
            }
        }
        if self.cancel.is_cancelled() {
            process.link.cancel(process.task);
            let since = *self.cancelled.get_or_insert_with(Instant::now);
            if since.elapsed() > CANCELLED {
                self.why = Some(End::Stopped);
                return false;
            }
        }
        if let Some(most) = self.workers.timeout.filter(|most| self.since.elapsed() > *most) {
            self.why = Some(End::Hung(most));
            return false;
        }
        if process.memory() > self.workers.memory {
            self.why = Some(End::Memory(self.workers.memory));
            return false;
        }
        true
    }
}

/// The files that a worker's host handed over as its input and output, which become what a process without a terminal has. Where they are needed for
/// as long as the process, they come to lie where few plugins look for files to close.
pub(super) fn inherited(pipes: bool) -> Option<(OwnedFd, OwnedFd)> {
    // SAFETY: duplicates of files that are open; what comes back is ours. The input is nothing from here on, and the output goes where errors go.
    unsafe {
        let mut limit: libc::rlimit = std::mem::zeroed();
        libc::getrlimit(libc::RLIMIT_NOFILE, &raw mut limit);
        let most = limit.rlim_max.min(1 << 16);
        let raised = libc::rlimit { rlim_cur: most, ..limit };
        let is_raised = pipes && most > limit.rlim_cur && libc::setrlimit(libc::RLIMIT_NOFILE, &raw const raised) == 0;
        let has_room = pipes && (is_raised || limit.rlim_cur >= most);
        let from = if has_room { libc::c_int::try_from(most).unwrap_or(64) - 16 } else { 3 };
        let (messages, other) = (libc::fcntl(0, libc::F_DUPFD_CLOEXEC, from), libc::fcntl(1, libc::F_DUPFD_CLOEXEC, from));
        if is_raised {
            libc::setrlimit(libc::RLIMIT_NOFILE, &raw const limit);
        }
        if messages < 0 || other < 0 {
            return None;
        }
        let nothing = libc::open(c"/dev/null".as_ptr(), libc::O_RDWR | libc::O_CLOEXEC);
        libc::dup2(nothing, 0);
        libc::close(nothing);
        libc::dup2(2, 1);
        Some((OwnedFd::from_raw_fd(messages), OwnedFd::from_raw_fd(other)))
    }
}
